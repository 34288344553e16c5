"""Robust least squares over experiments through a model's own ``run``, held-out cycles, bootstrap by cycle."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from scipy.optimize import least_squares

from sma_actuator.estimation.models import StrainModel, ThermalStrainModel

from .experiments import Experiment, IdentificationError
from .ranges import determinate_interval_m, distinct_stresses, full_cycles

LOSS_SCALE = 0.01  #: residual, as a share of the full stroke, above which it counts linearly
FOLDS = 3
BOOTSTRAP_SAMPLES = 300

Model = Callable[[np.ndarray], StrainModel]  #: of a parameter vector
Choice = TypeVar("Choice", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Data:
    """Experiments with the samples that count, and a number for every cycle of every experiment."""

    experiments: tuple[Experiment, ...]
    counts: np.ndarray  #: bool, shape (N,): the sample is in the determinate part of its stroke
    unit: np.ndarray  #: int, shape (N,): which cycle it belongs to, over all experiments
    displacement_m: np.ndarray  #: shape (N,)
    full_stroke_m: float


def make_data(experiments: Sequence[Experiment], full_stroke_m: float) -> Data:
    """Concatenate experiments; the indeterminate ends, found per load, and the rest before the first cycle do not count.

    A log that is not of full cycles takes the ends of the full cycles nearest in stress.
    """
    full = full_cycles(experiments)
    intervals = [determinate_interval_m(t) for t in full]
    stresses = np.array([t.mean_stress_Pa for t in full])
    counts, unit, offset = [], [], 0
    for experiment in experiments:
        low_m, high_m = intervals[int(np.argmin(np.abs(stresses - experiment.mean_stress_Pa)))]
        displacement_m = experiment.displacement_m
        inside = (displacement_m >= low_m) & (displacement_m <= high_m) & np.isfinite(experiment.resistance_Ohm)
        counts.append(inside & (experiment.cycle > 0))
        unit.append(experiment.cycle + offset)
        offset += int(experiment.cycle.max()) + 1
    return Data(
        tuple(experiments),
        np.concatenate(counts),
        np.concatenate(unit),
        np.concatenate([t.displacement_m for t in experiments]),
        full_stroke_m,
    )


def predict(model: StrainModel | ThermalStrainModel, experiments: Sequence[Experiment]) -> np.ndarray:
    """Displacement by a model over experiments, each begun cold as the estimator does; concatenated, [m]."""
    out = []
    for experiment in experiments:
        if isinstance(model, ThermalStrainModel):
            s = experiment.signals
            model.reset()
            ambient_C = np.broadcast_to(s.ambient_temperature_C, s.time_s.shape)
            out.append(
                model.observe_all(s.time_s, s.resistance_Ohm, s.stress_Pa, experiment.heating, s.power_W, ambient_C)[0]
            )
            continue
        model.reset(float(experiment.resistance_Ohm[0]), float(experiment.stress_Pa[0]))
        out.append(model.run(experiment.resistance_Ohm, experiment.stress_Pa, experiment.heating))
    return np.concatenate(out)


def residuals(build: Model, theta: np.ndarray, data: Data, weight: np.ndarray) -> np.ndarray:
    """Weighted residuals of the samples with weight, as shares of the full stroke."""
    chosen = weight > 0.0
    error = (predict(build(theta), data.experiments) - data.displacement_m)[chosen] / data.full_stroke_m
    return np.clip(np.nan_to_num(error, nan=10.0, posinf=10.0, neginf=-10.0), -10.0, 10.0) * np.sqrt(weight[chosen])


def fit(
    build: Model, start: np.ndarray, data: Data, weight: np.ndarray | None = None, max_evaluations: int = 60
) -> Any:
    """Robust least squares from ``start``; returns scipy's result (``x``, ``jac``, ``fun``)."""
    weight = data.counts.astype(float) if weight is None else weight
    return least_squares(
        lambda theta: residuals(build, theta, data, weight),
        start,
        loss="soft_l1",
        f_scale=LOSS_SCALE,
        x_scale="jac",
        tr_solver="lsmr",
        max_nfev=max_evaluations,
    )


@dataclass(frozen=True, slots=True)
class HeldOut:
    """How a model does on cycles that its fit has not seen."""

    errors: np.ndarray  #: mean absolute error of every cycle, as a share of the full stroke, where samples count
    estimate_m: np.ndarray  #: of every sample, also of those that do not count, shape (N,)


def held_out(build: Model, start: np.ndarray, data: Data, used: Model | None = None) -> HeldOut:
    """Every cycle by a fit that did not see it.

    Every FOLDS-th cycle is held out in turn; the model still runs through it, but nothing is
    learnt from it.  ``used``: the model that the estimates are by, where it is not the one that is fitted.
    """
    errors = {}
    estimate_m = np.full(len(data.unit), np.nan)
    for fold in range(FOLDS):
        left_out = data.unit % FOLDS == fold
        found = fit(build, start, data, (data.counts & ~left_out).astype(float), max_evaluations=25)
        judged = data.counts & left_out
        predicted_m = predict(build(found.x), data.experiments)
        used_m = predict(used(found.x), data.experiments) if used else predicted_m
        estimate_m[left_out] = used_m[left_out]
        error = np.abs(predicted_m - data.displacement_m) / data.full_stroke_m
        errors.update({int(unit): error[judged & (data.unit == unit)].mean() for unit in np.unique(data.unit[judged])})
    return HeldOut(np.array([errors[unit] for unit in sorted(errors)]), estimate_m)


def at_bound(name: str, value: float, low: float, high: float, unit: str, means: str) -> list[str]:
    """A sentence where a fitted value stands at the end of what the fit may take."""
    if low * (1.0 + 1e-6) < value < high * (1.0 - 1e-6):
        return []
    return [
        (
            f"{name} stands at the end of what the fit may take ({value:.4g}, of {low:.4g} to {high:.4g} {unit}): {means}; its "
            "interval says nothing"
        )
    ]


def choose_simplest(errors: Mapping[Choice, np.ndarray], size: Callable[[Choice], float]) -> Choice:
    """The smallest choice that is not clearly worse than the best: by at most one standard error of
    the difference, cycle by cycle.  ``errors`` maps each choice to its held-out errors."""
    best = min(errors, key=lambda choice: errors[choice].mean())

    def as_good(choice: Choice) -> bool:
        worse = errors[choice] - errors[best]
        return worse.mean() <= worse.std() / np.sqrt(len(worse))

    return min((c for c in errors if as_good(c)), key=lambda c: (size(c), errors[c].mean()))


def bootstrap(build: Model, theta: np.ndarray, data: Data, seed: int = 0) -> np.ndarray:
    """Parameter vectors of fits to cycles drawn with replacement, shape (BOOTSTRAP_SAMPLES, parameters).

    Each is one Gauss–Newton step from the fit, which is what a refit amounts to so near its optimum.
    """
    chosen = data.counts
    solution = least_squares(
        lambda x: residuals(build, x, data, chosen.astype(float)), theta, loss="linear", x_scale="jac", max_nfev=1
    )
    jacobian, residual = solution.jac, solution.fun
    robust = 1.0 / np.sqrt(1.0 + (residual / LOSS_SCALE) ** 2)
    unit = data.unit[chosen]
    units, index = np.unique(unit, return_inverse=True)
    normal = np.zeros((len(units), len(theta), len(theta)))
    gradient = np.zeros((len(units), len(theta)))
    for k in range(len(units)):
        rows = index == k
        weighted = jacobian[rows] * robust[rows, None]
        normal[k], gradient[k] = weighted.T @ jacobian[rows], weighted.T @ residual[rows]
    scale = np.sqrt(np.maximum(np.diag(normal.sum(axis=0)), 1e-300))
    random = np.random.default_rng(seed)
    whole = np.linalg.lstsq(normal.sum(0) / np.outer(scale, scale), gradient.sum(0) / scale, rcond=1e-10)[0]
    out = np.empty((BOOTSTRAP_SAMPLES, len(theta)))
    for i in range(BOOTSTRAP_SAMPLES):
        times = np.bincount(random.integers(len(units), size=len(units)), minlength=len(units))
        h, g = np.tensordot(times, normal, 1) / np.outer(scale, scale), (times @ gradient) / scale
        out[i] = theta - (np.linalg.lstsq(h, g, rcond=1e-10)[0] - whole) / scale
    return out


def require_loads(experiments: Sequence[Experiment], order: int, what: str) -> None:
    """Raise IdentificationError where a polynomial of ``order`` in stress has more coefficients than there are "
    "loads."""
    full = full_cycles(experiments)
    loads = distinct_stresses(full)
    if loads < order + 1:
        listed = ", ".join(f"{np.mean(t.signals.load_N):.2f} N" for t in full)
        raise IdentificationError(
            f"{what}: a polynomial of order {order} in stress needs full cycles at {order + 1} different loads; "
            f"the logs hold {loads} ({listed}); measure at more loads or choose a lower order"
        )
