"""At which temperature the wire transforms, seen through its heat balance: what feed-forward needs to know.

With the share X of the stroke (0 contracted, 1 cold) and λ the latent heat over the heat capacity, the balance
``C dT/dt = P − h (T − T_ambient) + λ C dX/dt`` has the solution ``T = u + λ (X − X̄)``, where u and X̄ are
``P/h + T_ambient`` and X through the wire's thermal lag, near surroundings and all.  On either branch the temperature
is a curve of X, shifted in proportion to the stress, so that the curves, the shifts and λ come out of one linear fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sma_actuator.base.balance import followed
from sma_actuator.base.calibration import Calibration, PowerSection
from sma_actuator.base.sections import ThermalParameters
from sma_actuator.base.signals import Signals
from sma_actuator.config import Config
from sma_actuator.logs.experiments import Experiment
from sma_actuator.logs.kinds import FULL

SHARES = np.linspace(0.0, 1.0, 11)  #: where the curves have a value, between them they are straight
#: What is known of such wires before: latent over specific heat [K], shift with stress [K/Pa]; and how well.
LATENT_K, LATENT_WITHIN_K = 25.0, 4.0
SHIFT_K_Pa, SHIFT_WITHIN_K_Pa = 1.0 / 8e6, 0.3 / 8e6
_MOVES_1_s = 0.01  #: share of the stroke per second that counts as motion
_BEND_K = 3.0  #: what two neighbouring pieces of a curve may well differ by in slope, per distance of two values
_SCATTER_K = 1.5  #: of a sample about its curve
_FEWEST = 30  #: samples of a branch
ENDS = 0.1, 0.9  #: shares of the stroke beyond which a transformation counts as complete
MIDDLE = 0.25, 0.75  #: and between which a passage is judged
_BACK = 0.05  #: share by which a wire that goes through may go back
_BEYOND = 0.1  #: share of the stroke by which a wire may be beyond its ends, and be taken for what it is


def learn(experiments: Sequence[Experiment], config: Config, calibration: Calibration) -> PowerSection:
    """At which temperatures the wire transforms between the ends that ``calibration`` knows; nothing where the logs do
    not say."""
    if not calibration.ends_known:
        return PowerSection()
    thermal = config.thermal
    rows, wanted = [], []
    for experiment in experiments:
        if experiment.kind != FULL:
            continue
        signals = experiment.signals
        share = _share(experiment, calibration)
        settled_C = _settled_C(signals, signals.power_W, thermal)
        warm_C, fresh = _lagged(signals.time_s, settled_C, share, thermal)
        rate_1_s = np.gradient(share, signals.time_s)
        inside = (share > 0.03) & (share < 0.97) & np.isfinite(experiment.stress_Pa + warm_C + share)
        for branch, moving in enumerate((rate_1_s > _MOVES_1_s, rate_1_s < -_MOVES_1_s)):
            here = inside & moving & (experiment.driven if branch else ~experiment.driven)
            rows.append(_rows(branch, share[here], experiment.stress_Pa[here], fresh[here]))
            wanted.append(warm_C[here])
    if not rows:
        return PowerSection()
    matrix, value_C = np.concatenate(rows), np.concatenate(wanted)
    n = len(SHARES)
    if min(np.count_nonzero(matrix[:, :n].any(axis=1)), np.count_nonzero(matrix[:, n : 2 * n].any(axis=1))) < _FEWEST:
        return PowerSection()
    before, expected_K = _known_before(n)
    weight = 1.0 / (_SCATTER_K * np.sqrt(len(value_C) / (4 * n)))  # samples of one passage repeat each other
    found = np.linalg.lstsq(
        np.concatenate((matrix * weight, before)), np.concatenate((value_C * weight, expected_K)), rcond=None
    )[0]
    values: dict[str, Any] = {
        "transformation_cooling": tuple(round(float(v), 2) for v in found[:n]),
        "transformation_heating": tuple(round(float(v), 2) for v in found[n : 2 * n]),
        "transformation_shift": (float(found[2 * n] * 1e-6), float(found[2 * n + 1] * 1e-6)),
        "latent_rise": round(float(found[-1]), 2),
    }
    return _with_scatter(PowerSection(**values), experiments, thermal, calibration)


def _share(experiment: Experiment, calibration: Calibration) -> np.ndarray:
    """How far the wire is along the stroke that it comes back to.

    One that does not come back by itself at a light load began far beyond that: it does not count how far.
    """
    share = calibration.share_of_stroke(experiment.displacement_m, experiment.stress_Pa)
    return np.clip(share, -_BEYOND, 1.0 + _BEYOND)


def _with_scatter(
    curves: PowerSection, experiments: Sequence[Experiment], thermal: ThermalParameters, calibration: Calibration
) -> PowerSection:
    """With how far off passages are, of all logs, and how fast they were."""
    off_K: list[float] = []
    ahead: tuple[list[float], list[float]] = [], []
    for experiment in experiments:
        share = _share(experiment, calibration)
        found = passages(share)
        warm_K, before = warmer_K(experiment.signals, experiment.signals.power_W, share, curves, thermal, found)
        for (heating, _), warm, far in zip(found, warm_K, before, strict=True):
            if np.isfinite(warm):
                off_K.append(float(warm))
                ahead[heating].append(float(far))
    if not all(ahead):
        return curves
    speeds = tuple(round(f(values), 3) for values in ahead for f in (min, max))
    scatter_K = round(float(np.sqrt(np.mean(np.square(off_K)))), 2)
    return replace(curves, transformation_scatter=scatter_K, transformation_speed=speeds)


def passages(share: np.ndarray) -> list[tuple[bool, np.ndarray]]:
    """Each time that a wire goes from one end of its stroke to the other: whether heating, and its samples in the
    middle.

    ``share``: of the stroke, 0 contracted.  Their temperatures are those of the whole loop, whatever came before.
    """
    end = np.where(share <= ENDS[0], 0, np.where(share >= ENDS[1], 1, -1))
    at = np.flatnonzero(end >= 0)
    out = []
    for i in np.flatnonzero(np.diff(end[at])):
        here = np.arange(at[i], at[i + 1] + 1)
        heating = bool(end[at[i]])
        way = share[here] * (-1.0 if heating else 1.0)
        middle = (share[here] > MIDDLE[0]) & (share[here] < MIDDLE[1])
        if middle.any() and np.all(np.maximum.accumulate(way) - way < _BACK):
            out.append((heating, here[middle]))
    return out


def warmer_K(
    signals: Signals,
    heat_W: np.ndarray,
    share: np.ndarray,
    curves: PowerSection,
    thermal: ThermalParameters,
    found: Sequence[tuple[bool, np.ndarray]],
) -> tuple[np.ndarray, np.ndarray]:
    """How much warmer than at the calibration the balance calls the wire in each of the :func:`passages` found.

    And how far ahead of its thermal lag the share of the stroke was, which says how much of that rests on the latent
    heat.  ``heat_W``: what heats it.
    """
    if not found:
        return np.empty(0), np.empty(0)
    settled_C = _settled_C(signals, heat_W, thermal)
    warm_C, fresh = _lagged(signals.time_s, settled_C, share, thermal)
    number = np.array([len(rows) for _, rows in found])
    begins, rows = np.cumsum(number) - number, np.concatenate([rows for _, rows in found])
    heating = np.repeat([heating for heating, _ in found], number)
    places = np.linspace(0.0, 1.0, len(curves.transformation_heating))
    curves_C = [
        np.interp(share[rows], places, c) for c in (curves.transformation_cooling, curves.transformation_heating)
    ]
    shift_C_Pa = np.array(curves.transformation_shift)[heating.astype(int)]
    there_C = np.where(heating, curves_C[1], curves_C[0]) + shift_C_Pa * signals.stress_Pa[rows]
    ahead = np.add.reduceat(fresh[rows], begins) / number
    warmer = np.add.reduceat(warm_C[rows] - there_C, begins) / number
    return warmer + curves.latent_rise * ahead, ahead


def _settled_C(signals: Signals, heat_W: np.ndarray, thermal: ThermalParameters) -> np.ndarray:
    """The temperature that a wire goes to."""
    read_C = np.broadcast_to(signals.ambient_temperature_C, np.shape(signals.time_s))
    settled_C = np.where(np.isfinite(read_C), read_C, thermal.ambient_temperature)
    return settled_C + np.nan_to_num(heat_W) / thermal.heat_loss


def _lagged(
    time_s: np.ndarray, settled_C: np.ndarray, share: np.ndarray, thermal: ThermalParameters
) -> tuple[np.ndarray, np.ndarray]:
    """u [°C] and X − X̄ of a log."""
    nothing = np.zeros(len(time_s))
    return (
        followed(time_s, settled_C, nothing, thermal.balance),
        followed(time_s, nothing, share, thermal.balance),
    )


def _rows(branch: int, share: np.ndarray, stress_Pa: np.ndarray, latent: np.ndarray) -> np.ndarray:
    """What u is made of: the curves' values, cooling and heating, their shifts [K/MPa], and λ."""
    n = len(SHARES)
    out = np.zeros((len(share), 2 * n + 3))
    place = np.clip(share, 0.0, 1.0) * (n - 1)
    below = np.minimum(place.astype(int), n - 2)
    each = np.arange(len(share))
    out[each, branch * n + below] = 1.0 - (place - below)
    out[each, branch * n + below + 1] = place - below
    out[:, 2 * n + branch] = stress_Pa * 1e-6
    out[:, -1] = -latent
    return out


def _known_before(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Smooth curves, a shift and a latent heat as such wires have them; as rows of the fit."""
    rows, values = [], []
    for branch in range(2):
        for i in range(1, n - 1):
            row = np.zeros(2 * n + 3)
            row[branch * n + i - 1 : branch * n + i + 2] = 1.0, -2.0, 1.0
            rows.append(row / _BEND_K)
            values.append(0.0)
        row = np.zeros(2 * n + 3)
        row[2 * n + branch] = 1e-6 / SHIFT_WITHIN_K_Pa
        rows.append(row)
        values.append(SHIFT_K_Pa / SHIFT_WITHIN_K_Pa)
    row = np.zeros(2 * n + 3)
    row[-1] = 1.0 / LATENT_WITHIN_K
    return np.array([*rows, row]), np.array([*values, LATENT_K / LATENT_WITHIN_K])
