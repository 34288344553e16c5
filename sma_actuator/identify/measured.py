"""What the logs say of wire and bench beside the model: parameters that then need not be given."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from sma_actuator.config import BenchConfig
from sma_actuator.derived import LATENT, Derived, derived
from sma_actuator.estimation.branch import BranchDetector, EstimatorParameters
from sma_actuator.logs.bench_log import BenchLog, signals_from_log
from sma_actuator.logs.experiments import Experiment

_STILL = 0.03  #: of the stroke, within which of its shortest a wire has not begun to move
_TRANSFORMS = 0.15  #: share of the time until then that is left out: another phase begins before it shows
_FEWEST = 8  #: samples of a stretch of cooling
_TIMES_s = (0.05, 60.0)
_CLEAR = 1.1  #: by how much worse a time constant half as long or twice must fit
_MOVES = 0.2  #: of the fast motions of a log: slower ones do not say which way the wire goes
_ALIKE = 0.002  #: share of the moving samples by which two lags may differ and be as good
_UNUSUAL = 2.5  #: factor by which a wire may cool faster or more slowly than in still air
_FLOWS = 0.02  #: share of the largest current above which a current counts as one


def lowest_current_A(logs: Sequence[BenchLog], bench: BenchConfig) -> float:
    """The current that flows when the wire is not heated: what its resistance is measured with; NaN where none is."""
    found = [signals_from_log(log, bench).current_A for log in logs]
    current_A = np.concatenate(found) if found else np.empty(0)
    current_A = current_A[np.isfinite(current_A)]
    flows = current_A[current_A > _FLOWS * np.percentile(current_A, 99.0)] if len(current_A) else current_A
    return float(f"{np.percentile(flows, 5.0):.2g}") if len(flows) else math.nan


def measured(experiments: Sequence[Experiment], mapping: Mapping[str, Any], bench: BenchConfig) -> dict[str, Derived]:
    """Parameters by dotted name that the logs tell, each with how."""
    out: dict[str, Derived] = {}
    capacity_J_K = derived(mapping)["thermal.heat_capacity"]
    by_geometry = derived({"wire": mapping["wire"]})
    usual_s = by_geometry["thermal.heat_capacity"].value / by_geometry["thermal.heat_loss"].value
    time_constant_s = thermal_time_constant_s(experiments, bench.wire.full_stroke_m)
    if time_constant_s is not None and not usual_s / _UNUSUAL < time_constant_s < usual_s * _UNUSUAL:
        time_constant_s = None  # the resistance showed something else than cooling
    if time_constant_s is not None:
        capacity = mapping.get("thermal", {}).get("heat_capacity", capacity_J_K.value)
        out["thermal.heat_capacity"] = capacity_J_K
        out["thermal.heat_loss"] = Derived(
            float(f"{capacity / time_constant_s:.3g}"),
            f"heat_capacity over {time_constant_s:.3g} s, in which the contracted wire cooled after the pulses",
        )
    lag_s, right = branch_lag_s(
        experiments, LATENT * (time_constant_s or bench.thermal.heat_capacity / bench.thermal.heat_loss)
    )
    out["estimator.thermal_time_constant"] = Derived(
        lag_s, f"tells heating from cooling in {right:.1%} of the samples in which the wire moves"
    )
    resistance_Ohm = np.concatenate([t.resistance_Ohm for t in experiments])
    least_Ohm, largest_Ohm = np.nanpercentile(resistance_Ohm, (0.5, 99.5))
    out["safety.resistance_min"] = Derived(
        float(f"{0.5 * least_Ohm:.2g}"), f"half of the least measured, {least_Ohm:.3g} Ω"
    )
    out["safety.resistance_max"] = Derived(
        float(f"{2.0 * largest_Ohm:.2g}"), f"twice the largest measured, {largest_Ohm:.3g} Ω"
    )
    ambient_C = np.concatenate([np.atleast_1d(t.signals.ambient_temperature_C) for t in experiments])
    if np.isfinite(ambient_C).any():
        out["thermal.ambient_temperature"] = Derived(float(f"{np.nanmedian(ambient_C):.3g}"), "median of the logs")
    return out


def thermal_time_constant_s(experiments: Sequence[Experiment], full_stroke_m: float) -> float | None:
    """Heat capacity over heat loss, from how the resistance of the contracted wire falls after a pulse.

    It moves with the temperature alone there, and no latent heat is in it.  None where the logs do not tell.
    """
    stretches = [s for experiment in experiments for s in _cooling(experiment, full_stroke_m)]
    if not stretches:
        return None

    def left(log_time: float) -> float:
        """Squares that exponentials of one time constant leave, each with its own ends."""
        total = 0.0
        for time_s, resistance_Ohm in stretches:
            basis = np.column_stack((np.ones(len(time_s)), np.exp(-time_s / math.exp(log_time))))
            coefficients = np.linalg.lstsq(basis, resistance_Ohm, rcond=None)[0]
            total += float(np.sum((resistance_Ohm - basis @ coefficients) ** 2))
        return total

    low, high = (math.log(t) for t in _TIMES_s)
    grid = np.linspace(low, high, 40)
    best = grid[int(np.argmin([left(x) for x in grid]))]
    step = grid[1] - grid[0]
    found = minimize_scalar(left, bounds=(max(best - step, low), min(best + step, high)), method="bounded")
    for factor in (0.5, 2.0):
        if left(found.x + math.log(factor)) < _CLEAR * found.fun:
            return None
    return math.exp(float(found.x))


def _cooling(experiment: Experiment, full_stroke_m: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Time since the current fell and resistance, for every pause after a pulse, while the wire stands contracted."""
    shortest_m = np.nanpercentile(experiment.displacement_m, 0.5)
    stretches = []
    for off in np.flatnonzero(experiment.driven[:-1] & ~experiment.driven[1:]) + 2:
        moves = np.flatnonzero(
            ~(experiment.displacement_m[off:] < shortest_m + _STILL * full_stroke_m) | experiment.driven[off:]
        )
        stop = off + (int(moves[0]) if len(moves) else len(experiment.driven) - off)
        resistance_Ohm = experiment.resistance_Ohm[off:stop]
        if len(resistance_Ohm) < _FEWEST:
            continue
        kept = int((1.0 - _TRANSFORMS) * (int(np.argmin(resistance_Ohm)) + 1))
        if kept >= _FEWEST:
            time_s = experiment.signals.time_s[off : off + kept]
            stretches.append((time_s - time_s[0], resistance_Ohm[:kept]))
    return stretches


def branch_lag_s(experiments: Sequence[Experiment], likely_s: float) -> tuple[float, float]:
    """The lag with which the heat balance best tells which way the wire moves, and the share that is then right.

    The one nearest to ``likely_s`` of those that are as good as the best.
    """
    parts = []
    for experiment in experiments:
        time_s = experiment.signals.time_s
        if len(time_s) < _FEWEST:
            continue
        velocity = np.gradient(_smooth(experiment.displacement_m), time_s)
        moving = np.abs(velocity) > _MOVES * np.percentile(np.abs(velocity), 95.0)
        parts.append((experiment, velocity < 0.0, moving))
    lags_s = likely_s * np.geomspace(0.25, 4.0, 17)
    right = np.zeros(len(lags_s))
    for k, lag_s in enumerate(lags_s):
        detector = BranchDetector(EstimatorParameters(thermal_time_constant=float(lag_s)))
        for experiment, contracts, moving in parts:
            time_s, resistance_Ohm, power_W = (
                np.ascontiguousarray(v)
                for v in (experiment.signals.time_s, experiment.resistance_Ohm, experiment.signals.power_W)
            )
            detector.reset(float(time_s[0]), float(resistance_Ohm[0]), float(power_W[0]))
            right[k] += np.count_nonzero((detector.run(time_s, resistance_Ohm, power_W) == contracts)[moving])
    total = sum(int(np.count_nonzero(moving)) for _, _, moving in parts)
    share = right / max(total, 1)
    good = lags_s[share >= share.max() - _ALIKE]
    chosen = good[int(np.argmin(np.abs(np.log(good / likely_s))))]
    return float(f"{chosen:.2g}"), float(share.max())


def _smooth(values: np.ndarray) -> np.ndarray:
    return np.convolve(np.pad(values, 2, mode="edge"), np.full(5, 0.2), mode="valid")
