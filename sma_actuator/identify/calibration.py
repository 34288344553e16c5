"""What a model leaves on the logs it was fitted on: its floor, and what a wire at rest shows.

``trace`` compares new logs with it: an error that was there at the calibration is the model's, one
that was not has a cause.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from sma_actuator.config import Config
from sma_actuator.estimation.calibration import Calibration
from sma_actuator.estimation.chain import Chain
from sma_actuator.safety.thermal import HeatBalance, ThermalParameters

from .expectation import learn
from .experiments import Experiment
from .rests import find_rests

STILL_SHARE = (
    0.03  #: of the full stroke, within which of its shortest a wire counts as contracted: it shrinks as it cools
)
SAME_STRESS = 0.06  #: share of the largest stress within which two are one


def calibration_of(traces: Sequence[Experiment], config: Config, at_rest: bool = True) -> Calibration:
    """The section ``calibration`` for a model and its own logs.

    ``at_rest``: with what a resting wire shows; left out for models of wires of any size.
    """
    known = _of_the_wire(traces, config) if at_rest else Calibration()
    config = dataclasses.replace(config, calibration=known)  # the hot end that the node will know decides errors too
    found = [Chain(config).run(t.signals) for t in traces]
    full_m = config.wire.full_stroke_m
    errors = [
        float(np.nanmean(np.abs(e.displacement_m - t.displacement_m))) / full_m * 100
        for e, t in zip(found, traces, strict=True)
    ]
    known = dataclasses.replace(known, error=float(np.mean(errors)), largest_error=max(errors))
    return dataclasses.replace(known, **learn(traces, found, config)) if at_rest else known


def _of_the_wire(traces: Sequence[Experiment], config: Config) -> Calibration:
    """What the wire shows whatever the model makes of it."""
    config = dataclasses.replace(config, calibration=Calibration())
    traces = [t.through(Chain(config).run(t.signals)) for t in traces]
    measured_C = [np.atleast_1d(t.signals.ambient_temperature_C) for t in traces]
    ambient = np.concatenate([a[np.isfinite(a)] for a in measured_C])
    resistance_Ohm = np.concatenate([t.resistance_Ohm for t in traces])
    return Calibration(
        resistance_range=float(np.subtract(*np.nanpercentile(resistance_Ohm, (99.5, 0.5)))),
        ambient_temperature=float(ambient.mean()) if len(ambient) else np.nan,
        **_cooling(traces, config),
        **_at_rest(traces, config.thermal.heat_capacity / config.thermal.heat_loss),
        **_contracted(traces, config),
    )


def _rounded(values: np.ndarray, digits: int) -> tuple[float, ...]:
    return tuple(round(float(v), digits) for v in values)


def _clusters(values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Values that differ by more than SAME_STRESS of the largest, those nearer averaged; ascending."""
    ordered = np.sort(np.asarray(values, dtype=float))
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > SAME_STRESS * np.max(np.abs(ordered))) + 1)
    return np.array([g.mean() for g in groups])


def _at_rest(traces: Sequence[Experiment], thermal_time_constant_s: float) -> dict:
    points: dict[bool, list] = {False: [], True: []}
    for trace in traces:
        for rest in find_rests(trace, thermal_time_constant_s):
            here = slice(rest.start, rest.stop)
            values = (trace.stress_Pa, trace.resistance_Ohm, trace.displacement_m, trace.signals.power_W)
            points[rest.hot].append([float(np.mean(v[here])) for v in values])
    out: dict = {}
    deviations = []
    power_W = np.median([p[3] for p in points[True]]) if points[True] else np.nan
    for hot, name in ((False, "cold"), (True, "hot")):
        rows = np.array(points[hot]).reshape(-1, 4)
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
            rows[:, 1:3] - np.column_stack([np.interp(rows[:, 0], middle[:, 0], middle[:, k]) for k in (1, 2)])
        )
    if deviations:
        together = np.concatenate(deviations)
        out["resistance_scatter"] = float(np.sqrt(np.mean(together[:, 0] ** 2)))
        out["displacement_scatter"] = float(np.sqrt(np.mean(together[:, 1] ** 2)))
    if "hot_stress" in out:
        out["hot_power"] = float(power_W)
    return out


def _heat_balance_C(trace: Experiment, thermal: ThermalParameters) -> tuple[np.ndarray, np.ndarray]:
    """Temperature of the wire by the heat balance, and of its surroundings, of each sample."""
    signals = trace.signals
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


def _cooling(traces: Sequence[Experiment], config: Config) -> dict:
    """How warm the heat balance called the wire when, cooling, it passed the middle of its working range."""
    middle_m = float(np.mean(config.model.build(config.wire).displacement_range_m))
    rows = []
    for trace in traces:
        wire_C, ambient_C = _heat_balance_C(trace, config.thermal)
        long = trace.displacement_m > middle_m
        passed = np.flatnonzero(long[1:] & ~long[:-1] & ~trace.driven[1:]) + 1
        rows += [(float(trace.stress_Pa[i]), float(wire_C[i] - ambient_C[i])) for i in passed]
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


def _contracted(traces: Sequence[Experiment], config: Config) -> dict:
    """Resistance over temperature of the wire that does not move any more: contracted, and cooling after a pulse.

    Not while it is heated: the balance leaves latent heat out, so right after the transformation it is hot by what
    that took, and forgets it in a few time constants.
    """
    still_m = STILL_SHARE * config.wire.full_stroke_m
    rows = []
    for trace in traces:
        if trace.kind != "pulses" or not trace.constant_load:
            continue
        wire_C, _ = _heat_balance_C(trace, config.thermal)
        values = np.column_stack((trace.stress_Pa, trace.resistance_Ohm, trace.displacement_m, wire_C))
        shortest_m = np.nanpercentile(trace.displacement_m, 0.5)
        for off in np.flatnonzero(trace.driven[:-1] & ~trace.driven[1:]) + 2:
            moves = np.flatnonzero(~(trace.displacement_m[off:] < shortest_m + still_m) | trace.driven[off:])
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
