"""What a wire shows cold, by which what it shows warmer is told from austenite."""

from __future__ import annotations

from math import inf, isfinite

from sma_actuator.base.jit import Floats, jit

from .transformed import FALLS

#: After so many of the longest time constants that it may have, a wire that rests is cold: 3 K are left of the hottest.
COLD_TIMES = 4.0

#: What is remembered of the cold: what a wire showed when it last was; the most since it certainly had not contracted,
#: ∞ where it may have; how long it has rested, in the longest time constants that it may have, and of that how long its
#: resistance was seen; whether it is the calibrated wire: it may be (0), it is (1), or it was heated before that was
#: known (-1); and the least that it has shown since.
COLD_Ohm, MOST_Ohm, RESTED_times, SEEN_times, IS_IT, LEAST_Ohm = range(6)
SHOWN_COLD = 6


@jit
def keep_cold(
    state: Floats,
    first: int,
    shown_Ohm: float,
    times: float,
    rests: bool,
    is_cold: bool,
    at_most_C: float,
    transformed_C: float,
) -> None:
    """Keep what a wire shows cold, and the most since it certainly had not contracted.

    Time says when it is cold.  Resistance that stands does not, for what cooling takes off austenite's a little
    martensite brings back; but where it stands at what this wire was known to show cold, at the beginning, before it
    is heated: another wire shows as much contracted.  It has not contracted where it shows as much again, no hotter
    than it transforms at, and has shown no less since: hotter austenite shows as much as a wire that rests half
    contracted in a warm room.

    ``shown_Ohm``: smooth, NaN where none was measured; ``times``: how long this step was, in the longest time constants
    that the wire may have; ``rests``: no current flows, or the bias alone; ``is_cold``: it is no hotter than this wire
    is as it begins to return, and shows what that shows cold.  What is remembered begins at the ``first`` of ``state``
    (:func:`begin_cold`).
    """
    if not rests:
        state[first + RESTED_times] = state[first + SEEN_times] = 0.0
    elif 0.0 <= times < inf:
        state[first + RESTED_times] += times
        state[first + SEEN_times] += times if isfinite(shown_Ohm) else 0.0
    if not isfinite(shown_Ohm):
        return
    is_it = is_cold and state[first + IS_IT] >= 0.0
    if (is_it and rests) or (rests and state[first + RESTED_times] >= COLD_TIMES):
        state[first + COLD_Ohm] = shown_Ohm
    if state[first + IS_IT] == 0.0:
        state[first + IS_IT] = 1.0 if is_it else (0.0 if rests else -1.0)
    if state[first + IS_IT] > 0.0:
        state[first + LEAST_Ohm] = min(state[first + LEAST_Ohm], shown_Ohm)
    most_Ohm = state[first + MOST_Ohm]
    if not shown_Ohm < (1.0 - FALLS) * most_Ohm:
        most_Ohm = max(most_Ohm, shown_Ohm)
    elif at_most_C < transformed_C and shown_Ohm >= (1.0 - FALLS) * state[first + COLD_Ohm]:
        most_Ohm = shown_Ohm
    else:
        most_Ohm = inf
    state[first + MOST_Ohm] = most_Ohm


@jit
def ask_anew(state: Floats, first: int) -> None:
    """Another wire may hang there since its resistance was last seen."""
    state[first + IS_IT], state[first + LEAST_Ohm] = 0.0, inf


def begin_cold(state: Floats, first: int) -> None:
    """Nothing is known yet."""
    state[first + COLD_Ohm] = state[first + MOST_Ohm] = state[first + LEAST_Ohm] = inf
