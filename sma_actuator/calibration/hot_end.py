"""The contracted wire, and the way back: resistance over temperature at the hot end, and how warm a wire is that cools.

:class:`sma_actuator.estimation.hot_end.HotEnd` and the supervisor look it up: beyond the hot end resistance no longer
tells displacement, and a wire that has not cooled so far cannot have gone back.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

import numpy as np

from sma_actuator.base.calibration import HotEndSection
from sma_actuator.base.sections import ThermalParameters
from sma_actuator.config import Config
from sma_actuator.logs.experiments import Experiment
from sma_actuator.logs.kinds import FULL
from sma_actuator.safety.thermal import HeatBalance

from .stresses import clusters, nearest, rounded

STILL_SHARE = (
    0.03  #: of the full stroke, within which of its shortest a wire counts as contracted: it shrinks as it cools
)

FEWEST = 6  #: readings of a contracted wire
FORGETS = 5.0  #: thermal time constants in which the balance forgets what latent heat took
SPANS_K = 5.0  #: temperatures over which resistance shows how it rises


def learn(experiments: Sequence[Experiment], config: Config) -> HotEndSection:
    """What the contracted wire showed, and on the way back."""
    return HotEndSection(**_cooling(experiments, config), **_contracted(experiments, config))


def _cooling(experiments: Sequence[Experiment], config: Config) -> dict:
    """How warm the heat balance called the wire when, cooling, it passed the middle of its working range."""
    middle_m = float(np.mean(config.model.build(config.wire).displacement_range_m))
    rows = []
    for experiment in experiments:
        wire_C, ambient_C = _heat_balance_C(experiment, config.thermal)
        long = experiment.displacement_m > middle_m
        passed = np.flatnonzero(long[1:] & ~long[:-1] & ~experiment.driven[1:]) + 1
        rows += [(float(experiment.stress_Pa[i]), float(wire_C[i] - ambient_C[i])) for i in passed]
    table = np.array(rows).reshape(-1, 2)
    table = table[np.isfinite(table).all(axis=1)]
    if not len(table):
        return {}
    stress_Pa, rise_K = table.T
    loads_Pa = clusters(stress_Pa)
    load = nearest(stress_Pa, loads_Pa)
    return {
        "cooling_position": round(middle_m, 8),
        "cooling_stress": rounded(loads_Pa, 0),
        "cooling_rise": tuple(round(float(rise_K[load == i].min()), 2) for i in range(len(loads_Pa))),
    }


def _contracted(experiments: Sequence[Experiment], config: Config) -> dict:
    """Resistance over temperature of the wire that does not move any more: contracted, and cooling after a pulse.

    Not while it is heated: the balance leaves latent heat out, so right after the transformation it is hot by what
    that took, and forgets it in a few time constants.  A quick wire cools in too few readings, and is
    heated: of that count those since it has forgotten, or the last of a pulse, where it stands.  What stands tells
    where it ends, and not how its resistance rises.
    """
    still_m = STILL_SHARE * config.wire.full_stroke_m
    forgets_s = FORGETS * config.thermal.balance.time_constant_s
    rows = []
    for experiment in experiments:
        if experiment.kind != FULL:
            continue
        wire_C, _ = _heat_balance_C(experiment, config.thermal)
        values = np.column_stack((experiment.stress_Pa, experiment.resistance_Ohm, experiment.displacement_m, wire_C))
        time_s, shortest_m = experiment.signals.time_s, np.nanpercentile(experiment.displacement_m, 0.5)
        good = np.isfinite(values).all(axis=1)
        contracted = experiment.displacement_m < shortest_m + still_m
        cools, heated = contracted & ~experiment.driven, contracted & experiment.driven
        for off in np.flatnonzero(experiment.driven[:-1] & ~experiment.driven[1:]) + 1:
            cooling = slice(off + 1, off + 1 + _how_many(cools[off + 1 :]))
            still = values[cooling][good[cooling]]
            if len(still) >= FEWEST:
                rows.append(still[: max(int(np.argmin(still[:, 1])), FEWEST - 1)])  # then another phase comes
                continue
            hot = slice(off - _how_many(heated[:off][::-1]), off)
            still = values[hot][good[hot]]
            since = _how_many((time_s[hot] <= time_s[hot.start] + forgets_s)[good[hot]])
            if len(still) - since >= FEWEST:
                rows.append(still[since:])
            elif len(still) >= FEWEST and np.ptp(still[-FEWEST:, 3]) < SPANS_K:
                rows.append(still[-FEWEST:])
    if not rows:
        return {}
    tell = [r for r in rows if np.ptp(r[:, 3]) >= SPANS_K]
    slope_Ohm_K = nan
    if tell:
        x, y = (np.concatenate([r[:, k] - r[:, k].mean() for r in tell]) for k in (3, 1))
        slope_Ohm_K = float(x @ y / (x @ x))
    means = np.array([r.mean(axis=0) for r in rows])
    reference_C = float(np.median(means[:, 3]))
    if tell:
        means[:, 1] += slope_Ohm_K * (reference_C - means[:, 3])
    stress_Pa = clusters(means[:, 0])
    load = nearest(means[:, 0], stress_Pa)
    middle = np.array([np.median(means[load == i], axis=0) for i in range(len(stress_Pa))])
    return {
        "contracted_stress": rounded(middle[:, 0], 0),
        "contracted_resistance": rounded(middle[:, 1], 6),
        "contracted_displacement": rounded(middle[:, 2], 8),
        "contracted_temperature": round(reference_C, 2),
        "contracted_slope": slope_Ohm_K,
    }


def _how_many(flags: np.ndarray) -> int:
    """So many are true at the beginning."""
    return len(flags) if flags.all() else int(np.argmin(flags))


def _heat_balance_C(experiment: Experiment, thermal: ThermalParameters) -> tuple[np.ndarray, np.ndarray]:
    """Temperature of the wire by the heat balance, and of its surroundings, of each sample."""
    signals = experiment.signals
    read_C = np.broadcast_to(signals.ambient_temperature_C, signals.time_s.shape)
    ambient_C = np.where(np.isfinite(read_C), read_C, thermal.ambient_temperature)
    heat = HeatBalance(float(ambient_C[0]))
    wire_C = np.empty(len(ambient_C))
    steps_s = np.diff(signals.time_s, prepend=signals.time_s[0])
    power_W = np.nan_to_num(signals.power_W)
    for i, step_s in enumerate(steps_s):
        wire_C[i] = heat.step(
            float(power_W[i]), float(step_s), float(ambient_C[i]), thermal.heat_capacity, thermal.heat_loss
        )
    return wire_C, ambient_C
