"""A position without the noise of its measurement: as much of it as a law can do with, and no later than that costs.

An alpha-beta filter, which follows a steady motion without lag (critically damped: R. J. Kalata, "The tracking index: a
generalized parameter for α-β and α-β-γ target trackers", IEEE Trans. AES-20 (1984) 174).  How noisy the position is,
its own second differences tell, and how each goes with the one before: those of noise turn round, those of a wire that
speeds up or slows down, quickly for so few readings, do not.
"""

from __future__ import annotations

from math import inf, isfinite, nan, sqrt

from sma_actuator.base.jit import Floats, floats, jit

#: Time over which the noise is measured.
NOISE_TIME_s = 2.0
#: The filter's own time is never longer than this: a wire in air is slower.
SLOWEST_s = 0.4
#: What the product of two second differences of white noise, one after the other, is in the mean: so many times its
#: variance.
_IN_A_ROW = -4.0
#: What one reading adds is at the most so many times what was known before, or what is allowed: of white noise one in
#: a hundred would add more.  A load that jumps, and the wire with it, is no noise, and taken for it the position came
#: 0.3 s late for as long as the noise is measured over: the wire swung through its whole stroke.
_MOST = 10.0

#: What is remembered: the position and its velocity; the reading before, the last step and its time, the last second
#: difference; how noisy that is.
_POSITION_m, _VELOCITY_m_s, _BEFORE_m, _STEP_m, _STEP_s, _SECOND_m, _VARIANCE_m2 = range(7)


class Smoother:
    """Follows one position; what it has learned of the noise outlasts :meth:`reset`."""

    __slots__ = ("_state",)

    def __init__(self) -> None:
        self._state = floats(7)  #: for :func:`_smoothed_m`
        self.reset(nan)

    @property
    def noise_m(self) -> float:
        """Noise of the position that comes in, rms [m]."""
        return sqrt(max(float(self._state[_VARIANCE_m2]), 0.0))

    def reset(self, position_m: float) -> None:
        """Begin at rest at a position; NaN: at the next."""
        self._state[:_VARIANCE_m2] = position_m, 0.0, position_m, 0.0, nan, nan

    def step(self, position_m: float, dt_s: float, allowed_m: float = inf) -> float:
        """The smoothed position after ``dt_s`` > 0, which noise moves by ``allowed_m`` from step to step, rms, or
        less."""
        return _smoothed_m(self._state, position_m, dt_s, allowed_m**2)


@jit
def _smoothed_m(state: Floats, position_m: float, dt_s: float, allowed_m2: float) -> float:
    """See :meth:`Smoother.step`; what is allowed comes squared."""
    at_m, velocity_m_s, step_m, second_m = position_m, 0.0, 0.0, nan
    if isfinite(state[_POSITION_m]):
        at_m, velocity_m_s = state[_POSITION_m], state[_VELOCITY_m_s]
        step_m, second_m = position_m - state[_BEFORE_m], state[_SECOND_m]
        if state[_STEP_s] > 0.0:
            before_m, second_m = second_m, step_m - state[_STEP_m] * dt_s / state[_STEP_s]
            if isfinite(before_m):
                part, most_m2 = dt_s / (NOISE_TIME_s + dt_s), _MOST * max(state[_VARIANCE_m2], allowed_m2)
                shown_m2 = min(max(second_m * before_m / _IN_A_ROW, -most_m2), most_m2)
                state[_VARIANCE_m2] += part * (shown_m2 - state[_VARIANCE_m2])
    state[_BEFORE_m], state[_STEP_m], state[_STEP_s], state[_SECOND_m] = position_m, step_m, dt_s, second_m
    share, variance_m2 = 1.0, state[_VARIANCE_m2]  # all of a surprise is believed
    if allowed_m2 != inf and variance_m2 > 0.0:
        # Noise σ moves the position by σ α √(1 + α²) from step to step.
        share = sqrt(0.5 * (sqrt(1.0 + 4.0 * allowed_m2 / variance_m2) - 1.0))
        share = min(max(share, sqrt(2.0) * dt_s / SLOWEST_s), 1.0)
    rate = 2.0 * (2.0 - share) - 4.0 * sqrt(1.0 - share)
    ahead_m = at_m + velocity_m_s * dt_s
    surprise_m = position_m - ahead_m
    state[_POSITION_m] = ahead_m + share * surprise_m
    state[_VELOCITY_m_s] = velocity_m_s + rate * surprise_m / dt_s
    return state[_POSITION_m]
