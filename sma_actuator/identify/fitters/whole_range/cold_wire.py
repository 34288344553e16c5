"""The cold wire as a strain gauge, from logs: what its resistance says of its length.

A log begins with a wire that has cooled under the load before: how much longer or shorter it is than one that has
cooled under its own, and how much more its resistance is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.calibration import RestSection
from sma_actuator.calibration.rest import cold_rests, learn
from sma_actuator.estimation.models.orientation import COLD_K, FOLLOWS_AT_ONCE, SHORTEST
from sma_actuator.logs.cycles import SAME_LOAD
from sma_actuator.logs.experiments import Experiment

#: A conductor that is drawn out has its length over its section more resistance: so many times its strain at constant
#: volume, of martensite somewhat less in other physics (1.7, 1.8); how far off that is, and the least share of it.
#: What turns further may have another resistivity besides.
PER_STRAIN, WITHIN, LEAST = 1.8, 0.5, 0.5
#: Readings at a log's beginning that are averaged.
BEGINNING = 3
#: From that share on cold martensite that is loaded is as long as if it had formed there.
WHOLLY = 0.97
#: A wire that remembers keeps at least so much of what a heavier load made it longer: 0.9 to 1 in four physics.  What
#: is left in others, up to 0.2, is of another kind: a rest of austenite, a length that training leaves.
MOSTLY = 0.5
#: Share of the stroke by which another load makes it longer or shorter.
ANOTHER = 0.05
#: Share of all its motion by which a wire lengthens, in the beginning of a log, that is still warm.
LENGTHENS = 0.05
#: Of martensite, 20 to 40: what a load that changes makes of its length at once is no orientation.
MODULUS_Pa = 30e9


@dataclass(frozen=True)
class ColdWire:
    """What is known of the cold wire; see :mod:`sma_actuator.estimation.models.orientation`."""

    resistance: tuple[float, float, float]  #: Ω per m, how far off it is, rms, and a reading of it [Ω]
    other_loads: tuple[float, float] | tuple[()]  #: none where no log shows what another load leaves
    stress_Pa: tuple[float, ...]
    resistance_Ohm: tuple[float, ...]
    displacement_m: tuple[float, ...]  #: where it rests cold under those
    rise_K: float  #: how much warmer than its surroundings the bias current keeps it there

    @property
    def known(self) -> np.ndarray:
        """All of it for the kernels."""
        return np.array([*self.resistance, *(self.other_loads or FOLLOWS_AT_ONCE), self.rise_K])


def cold_wire(experiments: Sequence[Experiment], config, ends_m: np.ndarray) -> ColdWire | None:
    """The gauge by these logs; None where no wire of theirs came to rest cold after it was heated, or too seldom to say
    what is usual.

    ``ends_m``: hot and cold end as quadratics in stress, shape (2, 3).
    """
    time_constant_s = config.thermal.balance.time_constant_s
    cooled = [(t, each) for t in experiments for each in cold_rests(t, time_constant_s)]
    if not cooled:
        return None
    rest = learn(experiments, time_constant_s)
    if not rest.cold_stress:
        return None
    rise_K = float(np.mean([np.mean(t.signals.power_W[each.start : each.stop]) for t, each in cooled]))
    rise_K /= config.thermal.heat_loss
    off_Ohm = [(t.resistance_Ohm - _usual_Ohm(rest, t))[each.start : each.stop] for t, each in cooled]
    settled, readings = [float(np.mean(each)) for each in off_Ohm], [float(np.std(each)) for each in off_Ohm]
    scatter_Ohm, reading_Ohm = float(np.sqrt(np.mean(np.square(settled)))), float(np.mean(readings))
    found = _beginnings(experiments, config, rest, ends_m)
    more_Ohm, longer_m = np.array([each[:2] for each in found]).reshape(-1, 2).T
    prior = PER_STRAIN * float(np.mean(rest.cold_resistance)) / config.wire.strain_length_m
    weight = (scatter_Ohm**2 + reading_Ohm**2 / BEGINNING) / (WITHIN * prior) ** 2
    per_m = (float(more_Ohm @ longer_m) + weight * prior) / (float(longer_m @ longer_m) + weight)
    per_m = max(per_m, LEAST * prior)
    if found:  # a wire that is switched on has rested for longer than one between two cycles
        scatter_Ohm = max(scatter_Ohm, float(np.sqrt(np.mean(np.square(more_Ohm - per_m * longer_m)))))
    stays = max((share for *_, share, heavier in found if heavier is False), default=0.0)
    turned = min((share for *_, share, heavier in found if heavier), default=1.0)
    # Where nothing stays the wire may have hung on that very load before.
    return ColdWire(
        (per_m, scatter_Ohm, reading_Ohm),
        (min(stays, 1.0), turned if turned < WHOLLY else 1.0) if stays >= MOSTLY else (),
        rest.cold_stress,
        rest.cold_resistance,
        rest.cold_displacement,
        rise_K,
    )


def begins_cold(rise_K: np.ndarray, displacement_m: np.ndarray, stress_Pa: np.ndarray) -> bool:
    """Whether a log, arrays of shape (n,), begins with a cold wire: by its power [K], and since one that cools
    lengthens; one that was switched off a moment ago is not cold yet."""
    unheated = rise_K < COLD_K
    if not unheated[0]:
        return False
    before = len(rise_K) if unheated.all() else int(np.argmin(unheated))
    own_m = displacement_m[:before][np.abs(stress_Pa[:before] - stress_Pa[0]) <= SAME_LOAD * abs(stress_Pa[0])]
    return float(own_m.max() - own_m[0]) < LENGTHENS * float(np.ptp(displacement_m))


def _usual_Ohm(rest: RestSection, t: Experiment) -> np.ndarray:
    return np.interp(t.stress_Pa, rest.cold_stress, rest.cold_resistance)


def _beginnings(
    experiments: Sequence[Experiment], config, rest: RestSection, ends_m: np.ndarray
) -> list[tuple[float, float, float, bool | None]]:
    """Of each log that begins cold: how much more its resistance is than usual at its load, how much longer the wire
    is; under a heavier load than before what share of its stroke it has, under a lighter one what share of what that
    load made it longer is left; and whether it is heavier, None where it is the same.

    The load before is that of the log before, of the first log the heaviest.
    """
    out = []
    length_m, heaviest_Pa = config.wire.strain_length_m, max(rest.cold_stress)
    for before, t in zip((None, *experiments), experiments, strict=False):
        s = t.signals
        good = np.flatnonzero(np.isfinite(s.resistance_Ohm + s.stress_Pa + s.power_W + t.displacement_m))
        rise_K = s.power_W[good] / config.thermal.heat_loss
        if not len(good) or not begins_cold(rise_K, t.displacement_m[good], s.stress_Pa[good]):
            continue
        good = good[:BEGINNING]
        if np.max(rise_K[:BEGINNING]) >= COLD_K:
            continue
        stress_Pa, was_Pa = float(np.mean(s.stress_Pa[good])), heaviest_Pa if before is None else before.mean_stress_Pa
        here_m, there_m = np.interp((stress_Pa, was_Pa), rest.cold_stress, rest.cold_displacement)
        hot_m, cold_m = (float(np.polynomial.polynomial.polyval(stress_Pa, each)) for each in ends_m)
        off_m = float(np.mean(t.displacement_m[good]) - here_m)
        share = 1.0 + off_m / (cold_m - hot_m)
        if not share > SHORTEST:  # it is warm
            continue
        more_Ohm = float(np.mean((t.resistance_Ohm - _usual_Ohm(rest, t))[good]))
        apart_m = there_m - here_m - (was_Pa - stress_Pa) / MODULUS_Pa * length_m
        heavier = None if abs(apart_m) < ANOTHER * (cold_m - hot_m) else bool(apart_m < 0.0)
        out.append((more_Ohm, off_m, share if heavier else off_m / apart_m if heavier is False else 1.0, heavier))
    return out
