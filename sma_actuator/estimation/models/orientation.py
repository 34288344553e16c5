"""How long a wire's martensite is: as the load made it under which it formed.

Martensite is oriented by the load under which it forms.  Some wires keep that when the load becomes less, and a heavier
one turns cold martensite not as far as if it had formed there (detwinning).  A model that is calibrated under constant
loads takes all martensite for formed under the present one: this memory says how much longer the wire is than that, and
how much more resistance it has therefore.  Under a spring, after a change of the load, and in a wire that hung
elsewhere before, that is several per cent of the stroke.

Which martensite becomes austenite first is told in two ways.  Where grains transform one after the other, what formed
last goes first, and a small cycle leaves the rest as it is; where all of a wire does what its mean does, each part goes
in its share.  Nothing that is calibrated with tells them apart: the memory keeps both, and takes the mean of what has
formed since the beginning.  What a wire began with, which may be a fifth of its stroke, it forgets as the second has
it, the sooner; that it may be left as the first has it is in the interval.

A cold wire is a strain gauge besides: that its resistance differs from the usual at this load says how much longer it
is, where nobody knows under which load it has cooled.

After H^cur(σ) of D. C. Lagoudas, D. Hartl, Y. Chemisky, L. Machado, P. Popov, "Constitutive model for the numerical
analysis of phase transformation in polycrystalline shape memory alloys", Int. J. Plast. 32–33 (2012) 155, where the
strain at which a transformation turns back goes in its share; that what formed last goes first is the return-point
memory of I. D. Mayergoyz, "Mathematical models of hysteresis" (1991).
"""

from __future__ import annotations

from math import hypot, isnan, nan, sqrt

import numpy as np

from sma_actuator.base.jit import Floats, floats, jit
from sma_actuator.base.lookup import looked_up

from .surroundings import UNMEASURED_K

#: What is remembered: the martensite's share of the stroke, smooth; how much longer the wire was in the beginning [m],
#: half of a 95 % interval of that [m], and how sure it is, 0 to 1; of a cold wire how many readings of its resistance
#: were taken, by how much they are more than usual, mean [Ω], and how warm it was then, at the least [K].  Where each
#: part goes in its share: what is left of the beginning, and the length of what has formed [m].  Where the last goes
#: first: what is left of the beginning, the lowest share since, and the stroke under the load that each layer formed
#: under [m], the first that formed at first.
_SHARE, _BEGAN_m, _UNSURE_m, _SURE, _READINGS, _MORE_Ohm, _READ_AT_K, _LEFT, _MIXED_m, _LOWEST, _FORMED_m = range(11)
LAYERS = 20  #: as fine as a share is followed, twice its play
REMEMBERED = _FORMED_m + LAYERS
#: So far may the share go to and fro before it counts: noise is no transformation.
PLAY = 0.01
#: Up to so many kelvins above its surroundings a wire is cold.
COLD_K = 20.0
#: It rests where its power would make it warmer or colder by no more than this.
RESTS_K = 3.0
#: No wire is so much shorter than its stroke that has cooled under no load at all: one that seems so is warm.
SHORTEST = 0.3
#: How well resistance tells a length: in other physics to a tenth or a fifth.
WITHIN = 0.25
#: How well it is followed, beside how far the two ways of it are apart: the numbers it is followed with are of logs.
FOLLOWED = 0.1
#: Share of its stroke by which a wire that remembers may begin longer or shorter though its resistance is as usual:
#: under springs, in other physics, 1.5 to 5.
USUALLY = 0.03
#: Share by which the resistance of a wire differs that is plugged in again: 5 to 10 mΩ of contacts, of some ohms.
CONTACTS = 0.002
#: The resistance of martensite rises with its temperature, as a share, and how surely it does: 3e-4 to 1.1e-3.
WARMER_1_K, WARMER_WITHIN_1_K = 7e-4, 4e-4
#: What is known of the wire: Ω per m; how far off, rms, the resistance of a cold wire is, and a single reading of it
#: [Ω]; what stays of being longer under a load that has become less; to what share of the stroke under a load its cold
#: martensite is turned at the least; and how much warmer than its surroundings it was as its resistance was measured,
#: which the bias current keeps it [K], NaN where nobody knows.
OHM_PER_m, SCATTER_Ohm, READING_Ohm, STAYS, TURNED, RESTED_K = range(6)
OF_COLD_WIRE = 3  #: numbers of the strain gauge, before those of other loads
#: Of a wire that is as long as its present load makes it.
FOLLOWS_AT_ONCE = (0.0, 1.0)


def nothing_known() -> Floats:
    """The memory of a wire of which nothing is known."""
    state = floats(REMEMBERED)
    forget(state)
    return state


def forget(state: Floats) -> None:
    """The next sample is the first."""
    for each in range(REMEMBERED):
        state[each] = 0.0
    state[_SHARE] = nan


@jit
def ends_m(stress_Pa: float, ends: np.ndarray) -> tuple[float, float]:
    """Where the hot and the cold wire are under a load; ``ends`` (2, 3), quadratics in stress."""
    hot_m = ends[0, 0] + stress_Pa * (ends[0, 1] + stress_Pa * ends[0, 2])
    cold_m = ends[1, 0] + stress_Pa * (ends[1, 1] + stress_Pa * ends[1, 2])
    return hot_m, cold_m


@jit
def stroke_m(stress_Pa: float, ends: np.ndarray) -> float:
    """The stroke under a load."""
    hot_m, cold_m = ends_m(stress_Pa, ends)
    return cold_m - hot_m


@jit
def begin(share: float, longer_m: float, sure: float, stress_Pa: float, ends: np.ndarray, state: Floats) -> None:
    """The wire has this share of martensite, and is so much longer than under this load alone, which is so sure."""
    state[_SHARE], state[_BEGAN_m], state[_SURE] = share, longer_m, sure
    state[_LEFT], state[_LOWEST] = 1.0, 1.0
    here_m = stroke_m(stress_Pa, ends)
    state[_MIXED_m] = share * here_m
    for j in range(LAYERS):
        state[_FORMED_m + j] = here_m


@jit
def _formed_m(here_m: float, known: np.ndarray, state: Floats) -> tuple[float, float]:
    """How much longer what has formed since the beginning is than under a load with this stroke: the mean of what it is
    if the last goes first and if each part goes in its share, and how far these are apart."""
    layers, in_turn_m = state[_SHARE] * LAYERS, 0.0
    for j in range(min(int(layers) + 1, LAYERS)):
        in_turn_m += (state[_FORMED_m + j] - here_m) * min(layers - j, 1.0) / LAYERS
    mixed_m = state[_MIXED_m] - here_m * state[_SHARE]
    in_turn_m *= known[STAYS] if in_turn_m > 0.0 else 1.0
    mixed_m *= known[STAYS] if mixed_m > 0.0 else 1.0
    return 0.5 * (in_turn_m + mixed_m), abs(in_turn_m - mixed_m)


@jit
def longer_m(stress_Pa: float, ends: np.ndarray, known: np.ndarray, state: Floats) -> float:
    """How much longer the wire is than if all its martensite had formed under the present load."""
    formed_m, _ = _formed_m(stroke_m(stress_Pa, ends), known, state)
    return state[_LEFT] * state[_BEGAN_m] + formed_m


@jit
def unsure_m(stress_Pa: float, ends: np.ndarray, known: np.ndarray, state: Floats) -> tuple[float, float]:
    """How far off that may be: half of a 95 % interval by chance, and where one of the two ways holds, and not their
    mean, besides."""
    formed_m, apart_m = _formed_m(stroke_m(stress_Pa, ends), known, state)
    told_m = state[_LOWEST] * state[_UNSURE_m]
    followed_m = FOLLOWED * (state[_LEFT] * state[_BEGAN_m] + formed_m)
    began_m = (state[_LOWEST] - state[_LEFT]) * abs(state[_BEGAN_m])
    return hypot(told_m, followed_m), began_m + 0.5 * apart_m


@jit
def follow(share: float, stress_Pa: float, ends: np.ndarray, known: np.ndarray, state: Floats) -> None:
    """The share of martensite, 0 to 1, is this now, under this load."""
    was, here_m = state[_SHARE], stroke_m(stress_Pa, ends)
    now = min(max(was, share - PLAY), share + PLAY)
    if now > was:
        state[_MIXED_m] += here_m * (now - was)
        before, after = was * LAYERS, now * LAYERS
        for j in range(int(before), min(int(after) + 1, LAYERS)):
            filled = min(after - j, 1.0)
            if filled > 0.0:
                state[_FORMED_m + j] += (here_m - state[_FORMED_m + j]) * (filled - max(before - j, 0.0)) / filled
    elif now < was:
        for each in (_LEFT, _MIXED_m):
            state[each] *= now / was
        # As long as it has only contracted, what is left formed, on the same spring, under the load that it has now.
        guessed = 1.0 - state[_SURE]
        state[_MIXED_m] += guessed * (here_m * now - state[_MIXED_m])
        for j in range(min(int(now * LAYERS) + 1, LAYERS)):
            state[_FORMED_m + j] += guessed * (here_m - state[_FORMED_m + j])
    state[_SHARE], state[_LOWEST] = now, min(state[_LOWEST], now)
    if now > state[_LOWEST] + 1.0 / LAYERS:
        state[_SURE] = 1.0
    state[_MIXED_m] = max(state[_MIXED_m], known[TURNED] * here_m * now)
    for j in range(LAYERS):
        state[_FORMED_m + j] = max(state[_FORMED_m + j], known[TURNED] * here_m)


@jit
def told(state: Floats) -> bool:
    """Whether the wire is still wholly martensite, as it began, whose length was told by its resistance."""
    return state[_READINGS] > 0.0 and state[_LOWEST] >= 1.0 - PLAY


@jit
def no_warmer(rise_K: float, state: Floats) -> bool:
    """Whether a wire that is ``rise_K`` above its surroundings is no warmer than it was read before; what was read of
    one that was warmer counts no more.

    Held warm it rests as well, and its resistance has risen: for 14 K as if the wire were half a per cent longer.
    """
    if state[_READINGS] > 0.0 and rise_K > state[_READ_AT_K] + RESTS_K:
        return False
    if rise_K < state[_READ_AT_K] - RESTS_K:
        state[_READINGS] = state[_MORE_Ohm] = 0.0
    state[_READ_AT_K] = min(rise_K, state[_READ_AT_K]) if state[_READINGS] > 0.0 else rise_K
    return True


@jit
def tell(
    resistance_Ohm: float,
    stress_Pa: float,
    warmer_K: float,
    rise_K: float,
    usual: Floats,
    ends: np.ndarray,
    known: np.ndarray,
    state: Floats,
) -> None:
    """One reading of a cold wire, all martensite, whose length nobody knows.

    ``usual``: the resistance of a cold wire by its stress (:func:`~sma_actuator.base.lookup.row_of`); ``warmer_K``: how
    much warmer its surroundings are than when that was measured, NaN where nobody knows; ``rise_K``: how much warmer
    the wire is than these.  One that has just been switched on is colder than the bias current keeps it.
    """
    usual_Ohm, room = looked_up(usual, 0, stress_Pa), 0.0
    if isnan(warmer_K):
        warmer_K, room = 0.0, WARMER_1_K * UNMEASURED_K
    if not isnan(known[RESTED_K]):
        warmer_K += rise_K - known[RESTED_K]
    warmth = hypot(WARMER_WITHIN_1_K * warmer_K, room)
    warmth_m = warmth * usual_Ohm / known[OHM_PER_m]
    usual_Ohm *= 1.0 + WARMER_1_K * warmer_K
    state[_READINGS] += 1.0
    state[_MORE_Ohm] += (resistance_Ohm - usual_Ohm - state[_MORE_Ohm]) / state[_READINGS]
    measured = sqrt(known[SCATTER_Ohm] ** 2 + known[READING_Ohm] ** 2 / state[_READINGS]) / known[OHM_PER_m]
    contacts = CONTACTS * usual_Ohm / known[OHM_PER_m]
    found, stroke = state[_MORE_Ohm] / known[OHM_PER_m], stroke_m(stress_Pa, ends)
    # What is no more than it may be otherwise off is nothing, or as much as such a wire usually is.
    square = measured**2 + contacts**2 + warmth_m**2
    more = max(found**2 - square, 0.0)
    share = more / (square + more)
    begin(1.0, max(share * found, (SHORTEST - 1.0) * stroke), share, stress_Pa, ends, state)
    more = max(more, (USUALLY * stroke * max(known[STAYS], 1.0 - known[TURNED])) ** 2)
    state[_UNSURE_m] = hypot(2.0 * sqrt(square * more / (square + more)), share * WITHIN * found)


@jit
def longer_all_m(
    displacement_m: np.ndarray,
    stress_Pa: np.ndarray,
    first: np.ndarray,
    cold_at_m: np.ndarray,
    ends: np.ndarray,
    known: np.ndarray,
    state: Floats,
    out: np.ndarray,
) -> None:
    """:func:`longer_m` of n samples whose displacement is measured, ``out`` (n,).

    A log begins where ``first``, bool (n,); a wire that is cold there, and all martensite, is usually at ``cold_at_m``,
    (n,), NaN where it is not cold.  What is usual was measured: ``ends``, a quadratic, is off by as much as a load
    leaves.
    """
    for i in range(len(displacement_m)):
        hot_m, cold_m = ends_m(stress_Pa[i], ends)
        here_m = cold_m - hot_m
        if first[i]:
            cold = not isnan(cold_at_m[i])
            share = 1.0 if cold else min(max((displacement_m[i] - hot_m) / here_m, 0.0), 1.0)
            began_m, sure = (displacement_m[i] - cold_at_m[i], 1.0) if cold else (0.0, 0.0)
            begin(share, began_m, sure, stress_Pa[i], ends, state)
        share = (displacement_m[i] - hot_m - longer_m(stress_Pa[i], ends, known, state)) / here_m
        follow(min(max(share, 0.0), 1.0), stress_Pa[i], ends, known, state)
        out[i] = longer_m(stress_Pa[i], ends, known, state)
