"""How hot a wire can be that cools, by how slowly its resistance falls.

One that is hotter than it transforms at is austenite all through, and cools: by the least heat that it may lose, at a
rate that its temperature gives.  So its resistance falls by that rate times the least slope of austenite's.  One that
falls less is no hotter than that, or transforms.
"""

from __future__ import annotations

from math import inf, isfinite, nan, sqrt

from sma_actuator.base.jit import Floats, jit

#: Share by which a resistance at the bias may be other than it is read, at the least: what shows less may stand still.
LEAST = 3e-3
#: Standard errors by which the resistance may fall faster than it was seen to.  It is looked at with every reading:
#: with 3 one hot wire in ten was called colder than it was, by up to 100 K, where readings scatter by 2e-3.
SURELY = 4.5
#: Readings that tell a scatter.
FEWEST = 8
#: Share of the longest time constant after which it is looked anew: what came before says less of now.
ANEW = 0.25
#: Where its power would leave it so much colder than before, a wire begins to cool, and it is looked anew too.
LESS_K = 10.0

#: A cold wire's resistance rises by no more, warmed by its bias: by 10 K in 2 s or slower, at 1e-3 a kelvin.  One that
#: transforms rises ten times as fast.
WARMS_1_s = 5e-3

#: What is remembered of a look: its first resistance, how long ago that was, and the hottest that the power since would
#: leave the wire; how many readings there are, and their sums of what the resistance rose by as a share, y, and of the
#: time t.
_FIRST_Ohm, _SINCE_s, _SETTLES_C, _COUNT, _Y, _T, _YY, _TY, _TT = range(9)
COOLING = 9


def begin_cooling(state: Floats, first: int) -> None:
    """Nothing is known yet."""
    state[first + _FIRST_Ohm] = nan


@jit
def cooling_C(
    state: Floats,
    first: int,
    resistance_Ohm: float,
    same_load: bool,
    dt_s: float,
    settles_C: float,
    longest_s: float,
    slope_1_K: float,
    returns_C: float,
    shows_cold: bool,
) -> float:
    """How hot a wire can be at most [°C] by its resistance as it cools; ∞ where that does not tell, or not yet.

    ``settles_C``: the hottest that its power would leave it in the end; ``longest_s``: the longest time constant that
    it may have; ``slope_1_K``: the least by which the resistance of its austenite rises, as a share;
    ``returns_C``: the highest at which it begins to transform as it cools; ``shows_cold``: it shows what it is known to
    show cold: then one that stands does not transform, which takes its resistance elsewhere.  What is remembered begins
    at the ``first`` of ``state`` (:func:`begin_cooling`).
    """
    since_s = state[first + _SINCE_s] + dt_s
    if not (same_load and since_s <= ANEW * longest_s and settles_C > state[first + _SETTLES_C] - LESS_K):
        state[first + _FIRST_Ohm] = nan
    if not isfinite(resistance_Ohm):
        state[first + _SINCE_s] = since_s
        return inf
    if not isfinite(state[first + _FIRST_Ohm]):
        for each in range(COOLING):
            state[first + each] = 0.0
        state[first + _FIRST_Ohm] = resistance_Ohm
        state[first + _SETTLES_C] = settles_C
        since_s = 0.0
    rose = resistance_Ohm / state[first + _FIRST_Ohm] - 1.0
    state[first + _SINCE_s] = since_s
    state[first + _SETTLES_C] = max(state[first + _SETTLES_C], settles_C)
    state[first + _COUNT] += 1.0
    state[first + _Y] += rose
    state[first + _T] += since_s
    state[first + _YY] += rose * rose
    state[first + _TY] += since_s * rose
    state[first + _TT] += since_s * since_s
    count = state[first + _COUNT]
    spread_s2 = state[first + _TT] - state[first + _T] ** 2 / count
    if not (count >= FEWEST and spread_s2 > 0.0):
        return inf
    shared = state[first + _TY] - state[first + _T] * state[first + _Y] / count
    rises_1_s = shared / spread_s2
    left = state[first + _YY] - state[first + _Y] ** 2 / count - rises_1_s * shared
    # Few readings tell a scatter badly: Student's t over a normal deviate (Abramowitz and Stegun, 26.7.5, in 1/count).
    told = 1.0 + (SURELY * SURELY + 1.0) / (4.0 * (count - 2.0))
    unsure = max(SURELY * told * sqrt(max(left, 0.0) / (count - 2.0)), LEAST)
    unsure_1_s = unsure / sqrt(spread_s2)
    # One whose resistance rises is being heated, or transforms: it may be as hot as its power leaves it.
    hottest_C = state[first + _SETTLES_C] + max(unsure_1_s - rises_1_s, 0.0) * longest_s / slope_1_K
    return hottest_C if shows_cold and rises_1_s < WARMS_1_s else max(hottest_C, returns_C)
