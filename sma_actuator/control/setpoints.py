"""Setpoints as pure functions of time: steps, sine, triangle and trajectories of timed points."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence

from .pid import POSITION_BOUND_m

Setpoint = Callable[[float], float]  #: time since its start [s] → position [m]

_FASTEST_m_s = 100.0  #: beyond it a number is no velocity of a wire; NaN fails the same comparison


def constant(position_m: float) -> Setpoint:
    """One position for ever.  Raises ValueError where it is not finite."""
    _check_finite(position_m=position_m)
    return lambda time_s: position_m


def steps(positions_m: Sequence[float], dwell_s: float) -> Setpoint:
    """Each position for ``dwell_s``, in a circle (thesis, fig. 107).  Raises ValueError."""
    positions_m = tuple(positions_m)
    if not positions_m:
        raise ValueError("positions_m: the list is empty; at least one position is wanted")
    _check_finite(**{f"positions_m[{i}]": p for i, p in enumerate(positions_m)})
    _check_positive(dwell_s=dwell_s)
    return lambda time_s: positions_m[int(time_s // dwell_s) % len(positions_m)]


def sine(offset_m: float, amplitude_m: float, period_s: float, phase_rad: float = 0.0) -> Setpoint:
    """``offset + amplitude sin(2π t / period + phase)``.  Raises ValueError."""
    _check_finite(offset_m=offset_m, amplitude_m=amplitude_m, phase_rad=phase_rad)
    _check_positive(period_s=period_s)
    return lambda time_s: offset_m + amplitude_m * math.sin(2.0 * math.pi * time_s / period_s + phase_rad)


def triangle(offset_m: float, amplitude_m: float, period_s: float) -> Setpoint:
    """A triangle wave about ``offset_m``, that starts there and rises first.  Raises ValueError."""
    _check_finite(offset_m=offset_m, amplitude_m=amplitude_m)
    _check_positive(period_s=period_s)

    def position_m(time_s: float) -> float:
        part = (time_s / period_s + 0.25) % 1.0
        return offset_m + amplitude_m * (1.0 - 4.0 * abs(part - 0.5))

    return position_m


class Trajectory:
    """Timed points, joined by straight lines; before the first point and after the last, that point's position.

    With ``velocities_m_s`` it is the cubic that passes each point at its velocity.
    """

    __slots__ = ("_velocities_m_s", "positions_m", "times_s")

    def __init__(
        self,
        times_s: Sequence[float],
        positions_m: Sequence[float],
        velocities_m_s: Sequence[float] | None = None,
    ):
        """Raises ValueError, in a sentence, for points that cannot be followed."""
        times = tuple(float(t) for t in times_s)
        positions = tuple(float(p) for p in positions_m)
        if not times:
            raise ValueError("trajectory: it has no points; at least one is wanted")
        if len(times) != len(positions):
            raise ValueError(
                f"trajectory: {len(times)} times but {len(positions)} positions; one position per time is wanted"
            )
        for i, (time, position) in enumerate(zip(times, positions, strict=True)):
            if not math.isfinite(time):
                raise ValueError(f"trajectory point {i}: its time, {time}, is not finite")
            if not math.isfinite(position):
                raise ValueError(f"trajectory point {i}: its position, {position}, is not finite")
            if not -POSITION_BOUND_m <= position <= POSITION_BOUND_m:
                raise ValueError(
                    f"trajectory point {i}: its position, {position:g}, is none of a wire or joint; metres are wanted, "
                    f"of a joint radians"
                )
            if time < 0.0:
                raise ValueError(
                    f"trajectory point {i}: its time, {time:g} s, is before the start; 0 or later is wanted"
                )
            if i and not time > times[i - 1]:
                raise ValueError(
                    f"trajectory point {i}: its time, {time:g} s, is not after that of point {i - 1}, {times[i - 1]:g} "
                    f"s"
                )
        self.times_s = times
        self.positions_m = positions
        self._velocities_m_s = None if velocities_m_s is None else _checked_velocities(velocities_m_s, len(times))

    @property
    def duration_s(self) -> float:
        """Time of the last point [s]."""
        return self.times_s[-1]

    def led_in(self, time_s: float, position_m: float) -> Trajectory:
        """The same, from ``position_m`` at ``time_s`` to a first point that is later; else, and for NaN, itself.

        As others follow one (ros2_controllers): to be at its first point at once would be a step.
        """
        if not (time_s < self.times_s[0] and math.isfinite(position_m)):
            return self
        velocities_m_s = None if self._velocities_m_s is None else (0.0, *self._velocities_m_s)
        return Trajectory((time_s, *self.times_s), (position_m, *self.positions_m), velocities_m_s)

    def refusal(self, delay_s: float) -> str:
        """Why it cannot be followed from ``delay_s`` after now, or "": a negative one has begun before."""
        if self.duration_s + delay_s >= 0.0:
            return ""
        return f"trajectory refused: its last point was due {-delay_s - self.duration_s:.3g} s ago"

    def __call__(self, time_s: float) -> float:
        """Position [m] at ``time_s`` since the start."""
        times, positions = self.times_s, self.positions_m
        if not time_s > times[0]:
            return positions[0]
        if time_s >= times[-1]:
            return positions[-1]
        k = bisect_right(times, time_s) - 1
        step_s = times[k + 1] - times[k]
        s = (time_s - times[k]) / step_s
        velocities = self._velocities_m_s
        if velocities is None:
            return positions[k] + s * (positions[k + 1] - positions[k])
        h = s * s * (3.0 - 2.0 * s)
        bend_m = s * (1.0 - s) * step_s * (velocities[k] * (1.0 - s) - velocities[k + 1] * s)
        return positions[k] + h * (positions[k + 1] - positions[k]) + bend_m


def in_words(begins_in_s: float) -> str:
    """What a status adds of a trajectory whose start is still to come; "" where it has come, and for NaN."""
    return f" (a trajectory begins in {begins_in_s:.0f} s, as it is stamped)" if begins_in_s > 0.0 else ""


def _checked_velocities(velocities_m_s: Sequence[float], points: int) -> tuple[float, ...]:
    velocities = tuple(float(v) for v in velocities_m_s)
    if len(velocities) != points:
        raise ValueError(f"trajectory: {len(velocities)} velocities for {points} points; one per point is wanted")
    for i, velocity in enumerate(velocities):
        if not abs(velocity) <= _FASTEST_m_s:
            raise ValueError(
                f"trajectory point {i}: its velocity, {velocity:g}, is none of a wire or joint; metres per second are "
                f"wanted, of a joint radians"
            )
    return velocities


def _check_finite(**values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise ValueError(f"{name}: {value} is not finite")


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name}: {value} is not above zero")
