"""A position without the noise of its measurement: as much of it as a law can do with, and no later than that costs.

An alpha-beta filter, which follows a steady motion without lag (critically damped: R. J. Kalata, "The tracking index: a
generalized parameter for α-β and α-β-γ target trackers", IEEE Trans. AES-20 (1984) 174).  How noisy the position is,
its own second differences tell, and how each goes with the one before: those of noise turn round, those of a wire that
speeds up or slows down, quickly for so few readings, do not.
"""

from __future__ import annotations

from math import inf, isfinite, nan, sqrt

#: Time over which the noise is measured.
NOISE_TIME_s = 2.0
#: The filter's own time is never longer than this: a wire in air is slower.
SLOWEST_s = 0.4
#: What the product of two second differences of white noise, one after the other, is in the mean: so many times its
#: variance.
_IN_A_ROW = -4.0


class Smoother:
    """Follows one position; what it has learned of the noise outlasts :meth:`reset`."""

    __slots__ = ("_before_m", "_second_m", "_step_m", "_step_s", "_variance_m2", "position_m", "velocity_m_s")

    def __init__(self) -> None:
        self._variance_m2 = 0.0
        self.reset(nan)

    @property
    def noise_m(self) -> float:
        """Noise of the position that comes in, rms [m]."""
        return sqrt(max(self._variance_m2, 0.0))

    def reset(self, position_m: float) -> None:
        """Begin at rest at a position; NaN: at the next."""
        self.position_m = self._before_m = position_m
        self.velocity_m_s = 0.0
        self._step_m, self._step_s, self._second_m = 0.0, nan, nan

    def step(self, position_m: float, dt_s: float, allowed_m: float = inf) -> float:
        """The smoothed position after ``dt_s`` > 0, which noise moves by ``allowed_m`` from step to step, rms, or
        less."""
        if not isfinite(self.position_m):
            self.reset(position_m)
        self._learn(position_m, dt_s)
        share = self._share(dt_s, allowed_m)
        rate = 2.0 * (2.0 - share) - 4.0 * sqrt(1.0 - share)
        ahead_m = self.position_m + self.velocity_m_s * dt_s
        surprise_m = position_m - ahead_m
        self.position_m = ahead_m + share * surprise_m
        self.velocity_m_s += rate * surprise_m / dt_s
        return self.position_m

    def _learn(self, position_m: float, dt_s: float) -> None:
        step_m = position_m - self._before_m
        if self._step_s > 0.0:
            before_m, self._second_m = self._second_m, step_m - self._step_m * dt_s / self._step_s
            if isfinite(before_m):
                part = dt_s / (NOISE_TIME_s + dt_s)
                self._variance_m2 += part * (self._second_m * before_m / _IN_A_ROW - self._variance_m2)
        self._before_m, self._step_m, self._step_s = position_m, step_m, dt_s

    def _share(self, dt_s: float, allowed_m: float) -> float:
        """How much of a surprise is believed: noise σ moves the position by σ α √(1 + α²) from step to step."""
        if allowed_m == inf or not self._variance_m2 > 0.0:
            return 1.0
        share = sqrt(0.5 * (sqrt(1.0 + 4.0 * allowed_m**2 / self._variance_m2) - 1.0))
        return min(max(share, sqrt(2.0) * dt_s / SLOWEST_s), 1.0)
