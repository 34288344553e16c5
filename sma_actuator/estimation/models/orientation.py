"""How long a wire's martensite is: as the load made it under which it formed.

Martensite is oriented by the load under which it forms.  Some wires keep that when the load becomes less, and a heavier
one turns cold martensite not as far as if it had formed there (detwinning); what becomes austenite takes its share
along.  A model that is calibrated under constant loads takes all martensite for formed under the present one: this
memory says how much longer the wire is than that, and how much more resistance it has therefore.  Under a spring, after
a change of the load, and in a wire that hung elsewhere before, that is several per cent of the stroke.

A cold wire is a strain gauge besides: that its resistance differs from the usual at this load says how much longer it
is, where nobody knows under which load it has cooled.

After H^cur(σ) of D. C. Lagoudas, D. Hartl, Y. Chemisky, L. Machado, P. Popov, "Constitutive model for the numerical
analysis of phase transformation in polycrystalline shape memory alloys", Int. J. Plast. 32–33 (2012) 155, with the
strain at which a transformation turns back.
"""

from __future__ import annotations

from math import nan, sqrt

import numpy as np

from sma_actuator.base.jit import Floats, floats, jit
from sma_actuator.base.lookup import looked_up

#: What is remembered: the martensite's share of the stroke, smooth; the length of what is known to have formed [m]; how
#: much longer the wire was in the beginning, as much of it as has not become austenite [m], and half of a 95 % interval
#: of that [m]; of a cold wire how many readings of its resistance were taken, and by how much they are more than usual,
#: mean [Ω].
_SHARE, _LENGTH_m, _BEGAN_m, _UNSURE_m, _READINGS, _MORE_Ohm = range(6)
REMEMBERED = 6
#: So far may the share go to and fro before it counts: noise is no transformation.
PLAY = 0.01
#: Up to so many kelvins above its surroundings a wire is cold.
COLD_K = 20.0
#: No wire is so much shorter than its stroke that has cooled under no load at all: one that seems so is warm.
SHORTEST = 0.3
#: How well a length is followed, and how well resistance tells it: under springs, in other physics, to a tenth or a
#: fifth.
WITHIN = 0.25
#: Share of its stroke by which a wire that remembers may begin longer or shorter though its resistance is as usual:
#: under springs, in other physics, 1.5 to 5.
USUALLY = 0.03
#: Share by which the resistance of a wire differs that is plugged in again: 5 to 10 mΩ of contacts, of some ohms.
CONTACTS = 0.002
#: What is known of the wire: Ω per m; how far off, rms, the resistance of a cold wire is, and a single reading of it
#: [Ω]; what stays of being longer under a load that has become less; and to what share of the stroke under a load its
#: cold martensite is turned at the least.
OHM_PER_m, SCATTER_Ohm, READING_Ohm, STAYS, TURNED = range(5)
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
def begin(share: float, longer_m: float, stress_Pa: float, ends: np.ndarray, state: Floats) -> None:
    """The wire has this share of martensite, and is so much longer than under this load alone."""
    state[_SHARE], state[_BEGAN_m] = share, longer_m
    state[_LENGTH_m] = share * stroke_m(stress_Pa, ends)


@jit
def longer_m(stress_Pa: float, ends: np.ndarray, known: np.ndarray, state: Floats) -> float:
    """How much longer the wire is than if all its martensite had formed under the present load."""
    formed_m = state[_LENGTH_m] - stroke_m(stress_Pa, ends) * state[_SHARE]
    return state[_BEGAN_m] + (known[STAYS] * formed_m if formed_m > 0.0 else formed_m)


@jit
def unsure_m(stress_Pa: float, ends: np.ndarray, known: np.ndarray, state: Floats) -> float:
    """How far off that may be, half of a 95 % interval."""
    return state[_UNSURE_m] + WITHIN * abs(longer_m(stress_Pa, ends, known, state))


@jit
def follow(share: float, stress_Pa: float, ends: np.ndarray, known: np.ndarray, state: Floats) -> None:
    """The share of martensite is this now, under this load."""
    was, here_m = state[_SHARE], stroke_m(stress_Pa, ends)
    now = min(max(was, share - PLAY), share + PLAY)
    if now > was:
        state[_LENGTH_m] += here_m * (now - was)
    elif was > 0.0:
        for each in (_LENGTH_m, _BEGAN_m, _UNSURE_m):
            state[each] *= now / was
    state[_LENGTH_m] = max(state[_LENGTH_m], known[TURNED] * here_m * now)
    state[_SHARE] = now


@jit
def told(state: Floats) -> bool:
    """Whether the wire is still wholly martensite, whose length was told by its resistance."""
    return state[_READINGS] > 0.0 and state[_SHARE] >= 1.0 - PLAY


@jit
def tell(
    resistance_Ohm: float, stress_Pa: float, usual: Floats, ends: np.ndarray, known: np.ndarray, state: Floats
) -> None:
    """One reading of a cold wire, all martensite, whose length nobody knows.

    ``usual``: the resistance of a cold wire by its stress (:func:`~sma_actuator.base.lookup.row_of`).
    """
    usual_Ohm = looked_up(usual, 0, stress_Pa)
    state[_READINGS] += 1.0
    state[_MORE_Ohm] += (resistance_Ohm - usual_Ohm - state[_MORE_Ohm]) / state[_READINGS]
    measured = sqrt(known[SCATTER_Ohm] ** 2 + known[READING_Ohm] ** 2 / state[_READINGS]) / known[OHM_PER_m]
    contacts = CONTACTS * usual_Ohm / known[OHM_PER_m]
    found, stroke = state[_MORE_Ohm] / known[OHM_PER_m], stroke_m(stress_Pa, ends)
    # What is no more than it may be otherwise off is nothing, or as much as such a wire usually is.
    square = measured**2 + contacts**2
    more = max(found**2 - square, 0.0)
    share = more / (square + more)
    begin(1.0, max(share * found, (SHORTEST - 1.0) * stroke), stress_Pa, ends, state)
    more = max(more, (USUALLY * stroke * max(known[STAYS], 1.0 - known[TURNED])) ** 2)
    state[_UNSURE_m] = 2.0 * sqrt(square * more / (square + more)) + share * WITHIN * abs(found)


@jit
def longer_all_m(
    displacement_m: np.ndarray,
    stress_Pa: np.ndarray,
    first: np.ndarray,
    cold: np.ndarray,
    ends: np.ndarray,
    known: np.ndarray,
    state: Floats,
    out: np.ndarray,
) -> None:
    """:func:`longer_m` of n samples whose displacement is measured, ``out`` (n,).

    A log begins where ``first``, bool (n,); all of a wire that is ``cold`` there, bool (n,), is martensite.
    """
    for i in range(len(displacement_m)):
        hot_m, cold_m = ends_m(stress_Pa[i], ends)
        here_m = cold_m - hot_m
        if first[i]:
            length_m = displacement_m[i] - hot_m
            share = 1.0 if cold[i] else min(max(length_m / here_m, 0.0), 1.0)
            begin(share, length_m - share * here_m if cold[i] else 0.0, stress_Pa[i], ends, state)
        share = (displacement_m[i] - hot_m - longer_m(stress_Pa[i], ends, known, state)) / here_m
        follow(min(max(share, 0.0), 1.0), stress_Pa[i], ends, known, state)
        out[i] = longer_m(stress_Pa[i], ends, known, state)
