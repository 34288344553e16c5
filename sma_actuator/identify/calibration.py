"""What a model leaves on the logs it was fitted on: its floor, and what a wire at rest shows.

``trace`` compares new logs with it: an error that was there at the calibration is the model's, one
that was not has a cause.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from sma_actuator.base.jit import jit
from sma_actuator.base.sections import ThermalParameters
from sma_actuator.config import Config
from sma_actuator.estimation.calibration import Calibration, through
from sma_actuator.estimation.chain import Chain, Estimates
from sma_actuator.safety.thermal import HeatBalance

from .balance import balance_of
from .expectation import learn
from .experiments import Experiment, begins_anew
from .rests import Rest, find_rests
from .training import change_while_measured_m

POSITIONS = 13
STILL_SHARE = (
    0.03  #: of the full stroke, within which of its shortest a wire counts as contracted: it shrinks as it cools
)
#: Two stresses are one that differ by less than this share of the larger, or of the largest of all: the cold end bends
#: most where the load is light.
SAME_STRESS, SAME_SHARE_OF_ALL = 0.06, 0.01


def calibration_of(
    experiments: Sequence[Experiment], config: Config, at_rest: bool = True, fresh_percent: float = 0.0
) -> Calibration:
    """The section ``calibration`` for a model and its own logs.

    ``at_rest``: with what a resting wire shows; left out for models of wires of any size.  ``fresh_percent``: error of
    the model on logs left out, where it is not what it leaves on these, which it learned.
    """
    known = _of_the_wire(experiments, config) if at_rest else Calibration()
    config = dataclasses.replace(config, calibration=known)  # the hot end that the node will know decides errors too
    found = _through(config, experiments)
    experiments = [t.through(estimate) for t, estimate in zip(experiments, found, strict=True)]
    estimates = [estimate.displacement_m for estimate in found]
    full_m = config.wire.full_stroke_m
    errors = [
        float(np.nanmean(np.abs(d - t.displacement_m))) / full_m * 100
        for d, t in zip(estimates, experiments, strict=True)
    ]
    if not at_rest:
        return Calibration(error=float(np.mean(errors)), largest_error=max(errors))
    residuals = [t.displacement_m - d for d, t in zip(estimates, experiments, strict=True)]
    model = config.model.build(config.wire)
    position_m = np.linspace(*_widened(model.displacement_range_m, estimates), POSITIONS)
    stress_Pa = _clusters([t.mean_stress_Pa for t in experiments])
    parts = [
        _sums(position_m, stress_Pa, d, t.stress_Pa, t.heating, r)
        for d, t, r in zip(estimates, experiments, residuals, strict=True)
    ]
    total = np.sum(parts, axis=0)
    rests = []  # of each log, with the residuals of the others taken off
    for part, d, t, r in zip(parts, estimates, experiments, residuals, strict=True):
        heating, cooling = _means(total - part if len(parts) > 1 else total)
        rests.append(r - expected_residual_m(position_m, stress_Pa, heating, cooling, d, t.stress_Pa, t.heating))
    scatter = [float(np.nanmean(np.abs(r))) / full_m * 100 for r in rests]
    one_stress = np.zeros(1)
    squares = np.sum(
        [
            _sums(position_m, one_stress, d, np.zeros(len(r)), t.heating, r**2)
            for d, t, r in zip(estimates, experiments, rests, strict=True)
        ],
        axis=0,
    )
    scatter_heating, scatter_cooling = (np.sqrt(m[0]) for m in _means(squares))
    heating, cooling = _means(total)
    values: dict = {
        "error": float(np.mean(errors)),
        "largest_error": max(errors),
        "scatter": float(np.mean(scatter)),
        "residual_stress": _rounded(stress_Pa, 0),
        "residual_position": _rounded(position_m, 8),
        "residual_heating": _rounded(heating.ravel(), 8),
        "residual_cooling": _rounded(cooling.ravel(), 8),
        "scatter_heating": _rounded(scatter_heating, 8),
        "scatter_cooling": _rounded(scatter_cooling, 8),
    }
    learned = learn(experiments, found, config)
    learned["floor"] = max(learned["floor"], fresh_percent)
    return dataclasses.replace(known, **values, **learned)


def _through(config: Config, experiments: Sequence[Experiment]) -> list[Estimates]:
    """Every experiment through the chain, which goes on through stretches of one log that follow each other."""
    chain, out = Chain(config), []
    for experiment, anew in zip(experiments, begins_anew(experiments), strict=True):
        if anew:
            chain = Chain(config)
        out.append(chain.run(experiment.signals))
    return out


def _of_the_wire(experiments: Sequence[Experiment], config: Config) -> Calibration:
    """What the wire shows whatever the model makes of it."""
    config = dataclasses.replace(config, calibration=Calibration())
    experiments = [t.through(found) for t, found in zip(experiments, _through(config, experiments), strict=True)]
    measured_C = [np.atleast_1d(t.signals.ambient_temperature_C) for t in experiments]
    ambient = np.concatenate([a[np.isfinite(a)] for a in measured_C])
    resistance_Ohm = np.concatenate([t.resistance_Ohm for t in experiments])
    known = Calibration(
        changed=change_while_measured_m([t.log for t in experiments], config),
        resistance_range=float(np.subtract(*np.nanpercentile(resistance_Ohm, (99.5, 0.5)))),
        ambient_temperature=float(ambient.mean()) if len(ambient) else np.nan,
        **_cooling(experiments, config),
        **_at_rest(experiments, config.thermal.heat_capacity / config.thermal.heat_loss),
        **_contracted(experiments, config),
    )
    return dataclasses.replace(known, **balance_of(experiments, config, known))


def _rounded(values: np.ndarray, digits: int) -> tuple[float, ...]:
    return tuple(round(float(v), digits) for v in values)


def _widened(range_m: tuple[float, float], estimates: Sequence[np.ndarray]) -> tuple[float, float]:
    everything = np.concatenate(estimates)
    low, high = np.nanpercentile(everything, (0.2, 99.8))
    return min(range_m[0], float(low)), max(range_m[1], float(high))


def _clusters(values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Stresses that are not one, those that are averaged; ascending."""
    ordered = np.sort(np.asarray(values, dtype=float))
    larger = np.maximum(np.abs(ordered[1:]), np.abs(ordered[:-1]))
    apart = np.maximum(SAME_STRESS * larger, SAME_SHARE_OF_ALL * np.max(np.abs(ordered)))
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > apart) + 1)
    return np.array([g.mean() for g in groups])


def _sums(position_m, stress_Pa, estimate_m, sample_stress_Pa, heating, residual_m) -> np.ndarray:
    """Sum and number of residuals by branch, stress and position, shape (2, 2, S, P)."""
    out = np.zeros((2, 2, len(stress_Pa), len(position_m)))
    good = np.isfinite(estimate_m + residual_m + sample_stress_Pa)
    step_m = position_m[1] - position_m[0]
    p = np.clip(np.rint((estimate_m[good] - position_m[0]) / step_m), 0, len(position_m) - 1).astype(int)
    s = np.argmin(np.abs(sample_stress_Pa[good, None] - stress_Pa), axis=1)
    b = np.where(heating[good], 0, 1)
    np.add.at(out[0], (b, s, p), residual_m[good])
    np.add.at(out[1], (b, s, p), 1.0)
    return out


def _means(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean residual of heating and of cooling, each of shape (S, P); an empty place takes its neighbours' value."""
    out = []
    for total, number in zip(*sums, strict=True):
        mean = np.zeros_like(total)
        for s in range(len(total)):
            filled = np.flatnonzero(number[s] > 3)
            if len(filled):
                mean[s] = np.interp(np.arange(total.shape[1]), filled, total[s, filled] / number[s, filled])
        out.append(mean)
    return out[0], out[1]


def expected_residual_m(
    position_m, stress_Pa, heating_m, cooling_m, estimate_m, sample_stress_Pa, heating
) -> np.ndarray:
    """Residual of the calibration at each of n samples, between positions (P,) and stresses (S,) linear, else the nearest."""
    out = np.empty(len(estimate_m))
    table = np.stack((np.reshape(cooling_m, (len(stress_Pa), -1)), np.reshape(heating_m, (len(stress_Pa), -1))))
    _look_up(np.asarray(position_m), np.asarray(stress_Pa), table, estimate_m, sample_stress_Pa, heating, out)
    return out


@jit
def _look_up(position, stress, table, estimate, sample_stress, heating, out):
    step = (position[-1] - position[0]) / (len(position) - 1)
    last = len(stress) - 1
    for i in range(len(out)):
        x = (estimate[i] - position[0]) / step
        if not (x == x and sample_stress[i] == sample_stress[i]):
            out[i] = np.nan
            continue
        x = min(max(x, 0.0), len(position) - 1.0)
        p = min(int(x), len(position) - 2)
        x -= p
        s = 0
        while s < last - 1 and sample_stress[i] > stress[s + 1]:
            s += 1
        y = 0.0
        above = s
        if last > 0:
            above = s + 1
            y = min(max((sample_stress[i] - stress[s]) / (stress[above] - stress[s]), 0.0), 1.0)
        b = 1 if heating[i] else 0
        low = table[b, s, p] * (1.0 - x) + table[b, s, p + 1] * x
        high = table[b, above, p] * (1.0 - x) + table[b, above, p + 1] * x
        out[i] = low * (1.0 - y) + high * y


def _at_rest(experiments: Sequence[Experiment], thermal_time_constant_s: float) -> dict:
    found = [(t, rest) for t in experiments for rest in find_rests(t, thermal_time_constant_s)]
    # A cold wire that creeps is not at rest yet, a hot one is contracted whether or not it grows warmer.
    settled = [x for x in found if x[1].hot or x[1].settled]
    if sum(not rest.hot for _, rest in settled) < 2:
        settled = found
    points = {hot: _means_at([x for x in settled if x[1].hot == hot], thermal_time_constant_s) for hot in (False, True)}
    out: dict = {}
    deviations = []
    power_W = np.median([p[3] for p in points[True]]) if points[True] else np.nan
    for hot, name in ((False, "cold"), (True, "hot")):
        rows = np.array(points[hot]).reshape(-1, 5)
        if hot:
            rows = rows[np.abs(rows[:, 3] - power_W) <= 0.15 * power_W]
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(rows) < 2:
            continue
        stress_Pa = _clusters(rows[:, 0])
        nearest = np.argmin(np.abs(rows[:, :1] - stress_Pa), axis=1)
        middle = np.array([np.median(rows[nearest == i], axis=0) for i in range(len(stress_Pa))])
        out[f"{name}_stress"] = _rounded(middle[:, 0], 0)
        out[f"{name}_resistance"] = _rounded(middle[:, 1], 6)
        out[f"{name}_displacement"] = _rounded(middle[:, 2], 8)
        deviations.append(
            rows[:, 1:3] - np.column_stack([through(middle[:, 0], middle[:, k], rows[:, 0]) for k in (1, 2)])
        )
    if deviations:
        together = np.concatenate(deviations)
        out["resistance_scatter"] = float(np.sqrt(np.mean(together[:, 0] ** 2)))
        out["displacement_scatter"] = float(np.sqrt(np.mean(together[:, 1] ** 2)))
    if "hot_stress" in out:
        out["hot_power"] = float(power_W)
        out["hot_to_go"] = round(float(np.sqrt(np.mean(np.square([row[4] for row in points[True]])))), 8)
    return out


def _means_at(found: Sequence[tuple[Experiment, Rest]], thermal_time_constant_s: float) -> list[list[float]]:
    """Stress, resistance, displacement and power of rests, and how far the displacement had yet to go.

    A cold wire that creeps yet counts with the length that it goes to, a contracted one that grows warmer with the
    resistance: heated on and on, it would always shrink a little.
    """
    out = []
    for t, rest in found:
        here = slice(rest.start, rest.stop)
        values = (t.stress_Pa, t.resistance_Ohm, t.displacement_m, t.signals.power_W)
        means = [float(np.mean(v[here])) for v in values]
        further = [rest.further(v, t.signals.time_s, thermal_time_constant_s) for v in values]
        goes_on = 1 if rest.hot else 2
        means[goes_on] += further[goes_on]
        out.append([*means, further[2]])
    return out


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
    clusters = _clusters(stress_Pa)
    nearest = np.argmin(np.abs(stress_Pa[:, None] - clusters), axis=1)
    return {
        "cooling_position": round(middle_m, 8),
        "cooling_stress": _rounded(clusters, 0),
        "cooling_rise": tuple(round(float(rise_K[nearest == i].min()), 2) for i in range(len(clusters))),
    }


def _contracted(experiments: Sequence[Experiment], config: Config) -> dict:
    """Resistance over temperature of the wire that does not move any more: contracted, and cooling after a pulse.

    Not while it is heated: the balance leaves latent heat out, so right after the transformation it is hot by what
    that took, and forgets it in a few time constants.
    """
    still_m = STILL_SHARE * config.wire.full_stroke_m
    rows = []
    for experiment in experiments:
        if experiment.kind != "pulses" or not experiment.constant_load:
            continue
        wire_C, _ = _heat_balance_C(experiment, config.thermal)
        values = np.column_stack((experiment.stress_Pa, experiment.resistance_Ohm, experiment.displacement_m, wire_C))
        shortest_m = np.nanpercentile(experiment.displacement_m, 0.5)
        for off in np.flatnonzero(experiment.driven[:-1] & ~experiment.driven[1:]) + 2:
            moves = np.flatnonzero(~(experiment.displacement_m[off:] < shortest_m + still_m) | experiment.driven[off:])
            still = values[off : off + moves[0]] if len(moves) else values[off:]
            still = still[np.isfinite(still).all(axis=1)]
            if len(still) > 5:
                rows.append(still[: max(int(np.argmin(still[:, 1])), 5)])  # from there on another phase comes
    if not rows:
        return {}
    x, y = (np.concatenate([r[:, k] - r[:, k].mean() for r in rows]) for k in (3, 1))
    slope_Ohm_K = float(x @ y / (x @ x))
    means = np.array([r.mean(axis=0) for r in rows])
    reference_C = float(np.median(means[:, 3]))
    means[:, 1] += slope_Ohm_K * (reference_C - means[:, 3])
    stress_Pa = _clusters(means[:, 0])
    nearest = np.argmin(np.abs(means[:, :1] - stress_Pa), axis=1)
    middle = np.array([np.median(means[nearest == i], axis=0) for i in range(len(stress_Pa))])
    return {
        "contracted_stress": _rounded(middle[:, 0], 0),
        "contracted_resistance": _rounded(middle[:, 1], 6),
        "contracted_displacement": _rounded(middle[:, 2], 8),
        "contracted_temperature": round(reference_C, 2),
        "contracted_slope": slope_Ohm_K,
    }
