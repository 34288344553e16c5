"""What current to drive when: the experiments of chapter 4 as generators.

A program yields :class:`Drive` and is sent the :class:`~sma_actuator.signals.Signals` that were
measured while it was in force.  It knows nothing of instruments, so it runs on any bench.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from math import isnan, nan
from statistics import fmean
from typing import Protocol

import numpy as np

from sma_actuator.base.signals import Signals
from sma_actuator.control.setpoints import constant, sine, triangle


@dataclass(frozen=True, slots=True)
class Drive:
    """What the supply is to do until the next reading."""

    current_A: float
    setpoint_m: float = nan  #: where the program is heading, for the log
    held_back: bool = False  #: the heat limit holds the wire back: let it cool first


Program = Generator[Drive, Signals, None]


class Following(Protocol):
    """A control law and what it goes by."""

    rest_A: float  #: before anything is known
    held_back: bool  #: the heat limit holds the wire back, so far and so long that it is better let cool first

    def __call__(self, signals: Signals, setpoint_m: float) -> float:
        """The current [A] for what was measured and where the wire should be; NaN: nowhere."""


#: A wire that moves more of a pulse's stroke in the last STILL_PART of a pause is not at rest.  Stricter than what
#: ``identify`` takes for a full cycle (``kinds``: 0.08 in the same part), so that what is measured here is one.
STILL, STILL_PART = 0.06, 0.15


#: Share of the current that was asked for, below which a limit holds a wire back.
HELD_BACK = 0.98
#: One that a limit holds back, and that stands for this share of a pause, two time constants, gets no further so.
STANDS = 1.0 / 3.0

#: While a wire still contracts it is given so many times the power, each time for so much of a pulse's heating; and it
#: does where that made it shorter by this share of all that it has contracted.
MORE_POWER, MORE_TIME, STILL_CONTRACTS = 1.15, 0.5, 0.02


#: In the second round one position in so many is come to from the cold wire, as the first after every `enable` is: from
#: others alone a model errs there by the most, by 2.6 % where a wire transforms near room temperature.
FROM_COLD = 4


def hold(current_A: float, duration_s: float) -> Program:
    """A constant current for some time."""
    signals = yield Drive(current_A)
    end_s = signals.time_s + duration_s
    while signals.time_s < end_s:
        signals = yield Drive(current_A)


def rest(current_A: float, least_s: float, longest_s: float, from_m: float = nan) -> Program:
    """A constant current until the wire is at rest: for ``least_s``, and on up to ``longest_s`` while it moves.

    ``from_m``: where it came from, if that is not where it is now.
    """
    signals = yield Drive(current_A)
    start_s, from_m = signals.time_s, signals.reference_displacement_m if isnan(from_m) else from_m
    shown: deque[tuple[float, float]] = deque()
    moves = True
    while (elapsed_s := signals.time_s - start_s) < least_s or (moves and elapsed_s < longest_s):
        signals = yield Drive(current_A)
        shown.append((signals.time_s, signals.reference_displacement_m))
        while shown[0][0] < signals.time_s - STILL_PART * (signals.time_s - start_s):
            shown.popleft()
        # Where no displacement is measured nothing moves.
        moves = abs(shown[-1][1] - shown[0][1]) > STILL * abs(shown[-1][1] - from_m)


def warmed(from_A: float, to_A: float, ramp_s: float) -> Generator[Drive, Signals, float]:
    """From one current to another with a power that grows evenly; where the wire was before."""
    signals = yield Drive(from_A)
    start_s, before_m = signals.time_s, signals.reference_displacement_m
    while (share := (signals.time_s - start_s) / ramp_s) < 1.0:
        signals = yield Drive((from_A**2 + share * (to_A**2 - from_A**2)) ** 0.5)
    return before_m


def contracted(
    current_A: float,
    heat_s: float,
    most_A: float,
    longest_s: float = 0.0,
    cold_m: float = nan,
    expands_m: float = 0.0,
) -> Generator[Drive, Signals, float]:
    """``heat_s`` at the current, then more of it, up to ``most_A``, while the wire contracts further with more, or has
    moved by less than ``expands_m``, which a wire does that does not transform yet; the last that it did with.

    With ``most_A`` it is given as long as it contracts, up to ``longest_s`` in all: under a heavy load it may be warm
    enough by then, and not be there yet.  ``cold_m``: as ``from_m`` of :func:`rest`.
    """
    signals = yield Drive(current_A)
    end_s = signals.time_s + longest_s
    cold_m = signals.reference_displacement_m if isnan(cold_m) else cold_m
    yield from hold(current_A, heat_s)
    signals = yield Drive(current_A)
    while current_A < most_A or signals.time_s < end_s:
        before_m, more_A = signals.reference_displacement_m, min(MORE_POWER**0.5 * current_A, most_A)
        yield from hold(more_A, MORE_TIME * heat_s)
        signals = yield Drive(more_A)
        here_m = signals.reference_displacement_m
        # Where no displacement is measured nothing moves.
        further = abs(here_m - cold_m) - abs(before_m - cold_m) > STILL_CONTRACTS * abs(here_m - cold_m)
        if not (further or abs(here_m - cold_m) < expands_m):
            break
        current_A = more_A
    return current_A


def square_pulses(
    cycles: int,
    heat_current_A: float,
    bias_current_A: float,
    heat_s: float,
    cool_s: float,
    longest_cool_s: float = 0.0,
    most_A: float = 0.0,
    longest_heat_s: float = 0.0,
    ramp_s: float = 0.0,
    expands_m: float = 0.0,
) -> Program:
    """Open-loop square pulses: ``heat_s`` at the heating current, ``cool_s`` at the bias current (4.1.1).

    While the wire has not come to rest a pause goes on, up to ``longest_cool_s``, and a pulse, up to
    ``longest_heat_s``: a guard may hold its current back.  While it still contracts, the first pulse goes on with more
    current, up to ``most_A``, which those after it then have (``expands_m``: :func:`contracted`).  For ``ramp_s`` a
    pulse begins with less: a wire that is quicker than the readings would be contracted between two of them.
    """
    yield from hold(bias_current_A, 1.0)
    for _ in range(cycles):
        cold_m = (yield from warmed(bias_current_A, heat_current_A, ramp_s)) if ramp_s else nan
        if most_A > heat_current_A:
            heat_current_A = yield from contracted(heat_current_A, heat_s, most_A, longest_heat_s, cold_m, expands_m)
            most_A = 0.0
        else:
            yield from rest(heat_current_A, heat_s, longest_heat_s, cold_m)
        yield from rest(bias_current_A, cool_s, longest_cool_s)


def trained(
    stand: Callable[[float, float], bool],
    cycles: int,
    heat_current_A: float,
    bias_current_A: float,
    heat_s: float,
    cool_s: float,
    most_A: float,
    expands_m: float = 0.0,
) -> Program:
    """Square pulses until ``stand`` says of the hot and the cold end [m] of a cycle that they do, or so many.

    Each contracts the wire as far as those that are measured afterwards.  The first is not looked at: before it the
    wire was loaded, and not as warm.
    """
    yield from hold(bias_current_A, 1.0)
    heat_current_A = yield from contracted(heat_current_A, heat_s, most_A, expands_m=expands_m)
    yield from hold(bias_current_A, cool_s)
    for _ in range(cycles - 1):
        hot_m = yield from _end_of(heat_current_A, heat_s)
        cold_m = yield from _end_of(bias_current_A, cool_s)
        if stand(hot_m, cold_m):
            return


def _end_of(current_A: float, duration_s: float) -> Generator[Drive, Signals, float]:
    """A constant current for some time; where the wire is in the last part of it, in the mean [m]."""
    yield from hold(current_A, (1.0 - STILL_PART) * duration_s)
    signals = yield Drive(current_A)
    end_s, shown_m = signals.time_s + STILL_PART * duration_s, [signals.reference_displacement_m]
    while signals.time_s < end_s:
        signals = yield Drive(current_A)
        shown_m.append(signals.reference_displacement_m)
    return fmean(shown_m)


def partial_cycles(
    set_points_m: Sequence[float], heat_current_A: float, bias_current_A: float, move_timeout_s: float, cool_s: float
) -> Program:
    """On-off control on the measured position between every ordered pair of set points (4.1.3).

    A move that has not arrived after ``move_timeout_s`` is given up for the next one.  A wire whose resistance does not
    tell half way how hot it is may be held there by the heat limit: it is let cool, and goes there in one go.
    """
    yield from hold(bias_current_A, 1.0)
    signals = yield Drive(bias_current_A)
    stands_m, patience_s = STILL_CONTRACTS * float(np.ptp(set_points_m)), STANDS * cool_s
    for place in every_ordered_pair(len(set_points_m)):
        target_m = set_points_m[place]
        if signals.reference_displacement_m > target_m:
            drive = Drive(heat_current_A, target_m)
            signals = yield from _shortened(signals, drive, move_timeout_s, stands_m, patience_s)
            if signals.reference_displacement_m > target_m and signals.current_A < HELD_BACK * heat_current_A:
                yield from hold(bias_current_A, cool_s)
                signals = yield Drive(bias_current_A)
                signals = yield from _shortened(signals, drive, move_timeout_s, stands_m, patience_s)
        else:
            end_s = signals.time_s + move_timeout_s
            while signals.time_s < end_s and not signals.reference_displacement_m > target_m:
                signals = yield Drive(bias_current_A, target_m)
    yield from hold(bias_current_A, cool_s)


def _shortened(
    signals: Signals, drive: Drive, longest_s: float, stands_m: float, patience_s: float
) -> Generator[Drive, Signals, Signals]:
    """A current until the wire is as short as the setpoint, for so long, or until a limit holds it back and it stands;
    what was measured last."""
    end_s, since_s, from_m = signals.time_s + longest_s, signals.time_s, signals.reference_displacement_m
    while signals.reference_displacement_m > drive.setpoint_m and signals.time_s < end_s:
        signals = yield drive
        here_m, is_held_back = signals.reference_displacement_m, signals.current_A < HELD_BACK * drive.current_A
        if not is_held_back or abs(here_m - from_m) > stands_m:
            since_s, from_m = signals.time_s, here_m
        elif signals.time_s - since_s >= patience_s:
            break
    return signals


def held_currents(currents_A: Sequence[float], hold_s: float, cool_s: float) -> Program:
    """Every step from one of the currents to another, each held for some time and every second one for half of it.

    So the wire is seen at temperatures where on/off moves only pass, and on the way to them with every power.  The
    first current is the one it rests with.

    A wire whose resistance does not tell half way how hot it is may be held there by the heat limit, however much is
    asked for: where it has not come as far as with this current before, it is let cool, and goes there in one go.
    """
    yield from hold(currents_A[0], 1.0)
    cold_m = (yield Drive(currents_A[0])).reference_displacement_m
    furthest_m = dict[int, float]()
    for move, place in enumerate(every_ordered_pair(len(currents_A))):
        current_A, held_s = currents_A[place], hold_s if move % 2 else 0.5 * hold_s
        yield from hold(current_A, held_s)
        signals = yield Drive(current_A)
        way_m = abs(signals.reference_displacement_m - cold_m)
        if signals.current_A < HELD_BACK * current_A and way_m < (1.0 - STILL) * furthest_m.get(place, 0.0):
            yield from hold(currents_A[0], cool_s)
            yield from hold(current_A, held_s)
            signals = yield Drive(current_A)
            way_m = abs(signals.reference_displacement_m - cold_m)
        furthest_m[place] = max(way_m, furthest_m.get(place, 0.0))
    yield from hold(currents_A[0], cool_s)


def every_ordered_pair(n: int) -> list[int]:
    """A closed walk over 0 … n−1 that takes each step from one number to another exactly once."""
    walk = [0]
    for i in range(n - 1):
        for j in range(i + 2, n):
            walk += [j, i]
        walk.append(i + 1)
    return walk + list(range(n - 2, -1, -1))


def followed(
    law: Following, positions_m: Sequence[float], contracted_m: float, dwell_s: float, period_s: float
) -> Program:
    """What a controller does: each position held for some time, then a sine and a triangle between the outermost.

    Before them the wire rests for as long, by which the rig knows its sensors' noise, and is contracted: under another
    load it is as long as the one before has made it until then.  To the first position and every FROM_COLD-th it comes
    from a rest, asked to be nowhere: held at its cold end it is as long, but warm yet, and its start from room
    temperature is then in no log.  ``law`` makes a current of what is measured and where the wire should be.
    """
    low_m, high_m = min(positions_m), max(positions_m)
    middle_m, half_m = 0.5 * (low_m + high_m), 0.5 * (high_m - low_m)
    visits = [_nowhere, constant(contracted_m)]
    for number, position_m in enumerate(positions_m):
        visits += [constant(position_m)] if number % FROM_COLD else [_nowhere, constant(position_m)]
    parts = (
        *((dwell_s, visit) for visit in visits),
        (2.0 * period_s, sine(middle_m, half_m, period_s)),
        (2.0 * period_s, triangle(middle_m, 0.7 * half_m, period_s)),
    )
    signals = yield Drive(law.rest_A, nan)
    for lasts_s, setpoint in parts:
        start_s = signals.time_s
        while (elapsed_s := signals.time_s - start_s) < lasts_s:
            setpoint_m = setpoint(elapsed_s)
            signals = yield Drive(law(signals, setpoint_m), setpoint_m, law.held_back)


def _nowhere(time_s: float) -> float:
    return nan
