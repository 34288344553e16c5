"""What current to drive when: the experiments of chapter 4 as generators.

A program yields :class:`Drive` and is sent the :class:`~sma_actuator.signals.Signals` that were
measured while it was in force.  It knows nothing of instruments, so it runs on any bench.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from math import nan

from sma_actuator.base.signals import Signals


@dataclass(frozen=True, slots=True)
class Drive:
    """What the supply is to do until the next reading."""

    current_A: float
    setpoint_m: float = nan  #: where the program is heading, for the log


Program = Generator[Drive, Signals, None]


def hold(current_A: float, duration_s: float) -> Program:
    """A constant current for some time."""
    signals = yield Drive(current_A)
    end_s = signals.time_s + duration_s
    while signals.time_s < end_s:
        signals = yield Drive(current_A)


def square_pulses(cycles: int, heat_current_A: float, bias_current_A: float, heat_s: float, cool_s: float) -> Program:
    """Open-loop square pulses: ``heat_s`` at the heating current, ``cool_s`` at the bias current (4.1.1)."""
    yield from hold(bias_current_A, 1.0)
    for _ in range(cycles):
        yield from hold(heat_current_A, heat_s)
        yield from hold(bias_current_A, cool_s)


def partial_cycles(
    set_points_m: Sequence[float], heat_current_A: float, bias_current_A: float, move_timeout_s: float, cool_s: float
) -> Program:
    """On-off control on the measured position between every ordered pair of set points (4.1.3).

    A move that has not arrived after ``move_timeout_s`` is given up for the next one.
    """
    yield from hold(bias_current_A, 1.0)
    signals = yield Drive(bias_current_A)
    for place in every_ordered_pair(len(set_points_m)):
        target_m = set_points_m[place]
        contract = signals.reference_displacement_m > target_m
        end_s = signals.time_s + move_timeout_s
        while signals.time_s < end_s and (signals.reference_displacement_m > target_m) == contract:
            signals = yield Drive(heat_current_A if contract else bias_current_A, target_m)
    yield from hold(bias_current_A, cool_s)


def held_currents(currents_A: Sequence[float], hold_s: float, cool_s: float) -> Program:
    """Every step from one of the currents to another, each held for some time and every second one for half of it.

    So the wire is seen at temperatures where on/off moves only pass, and on the way to them with every power.  The
    first current is the one it rests with.
    """
    yield from hold(currents_A[0], 1.0)
    for move, place in enumerate(every_ordered_pair(len(currents_A))):
        yield from hold(currents_A[place], hold_s if move % 2 else 0.5 * hold_s)
    yield from hold(currents_A[0], cool_s)


def every_ordered_pair(n: int) -> list[int]:
    """A closed walk over 0 … n−1 that takes each step from one number to another exactly once."""
    walk = [0]
    for i in range(n - 1):
        for j in range(i + 2, n):
            walk += [j, i]
        walk.append(i + 1)
    return walk + list(range(n - 2, -1, -1))
