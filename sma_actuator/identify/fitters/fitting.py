"""Robust least squares over experiments through a model's own ``run``, held-out cycles, bootstrap by cycle."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np
import scipy  # whose modules are loaded where they are first asked for: half of what a program takes to start

from sma_actuator.estimation.models import StrainModel, ThermalStrainModel
from sma_actuator.identify.ranges import determinate_interval_m, distinct_stresses, full_cycles
from sma_actuator.logs.experiments import Experiment, IdentificationError, begins_anew
from sma_actuator.logs.kinds import FULL, PARTIAL

LOSS_SCALE = 0.01  #: residual, as a share of the full stroke, above which it counts linearly
FOLDS = 3
#: Of a transition rate [1/Ω]; a transition narrower than a milliohm drowns in noise.
LOG_RATE = (np.log(0.1), np.log(1000.0))
#: Samples of all experiments together that a fit sees at the most; of more, those between two changes of the branch are
#: thinned.
MOST_SAMPLES = 20_000
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
    """Concatenate experiments; the indeterminate ends, found per load, and the rest before the first cycle do not
    count.

    A log that is not of full cycles takes the ends of the full cycles nearest in stress.  Many samples are thinned:
    the models' steps are exact, so what lies between two changes of the branch says the same again.
    """
    full = full_cycles(experiments)
    intervals = [determinate_interval_m(t) for t in full]
    stresses = np.array([t.mean_stress_Pa for t in full])
    counts, unit, offset = [], [], 0
    seldom = max(1, -(-sum(len(t.log) for t in experiments) // MOST_SAMPLES))
    experiments = [_thinned(experiment, seldom) for experiment in experiments]
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


def _thinned(experiment: Experiment, seldom: int) -> Experiment:
    """Every so many samples of an experiment, and those on either side of a change of the branch."""
    if seldom == 1:
        return experiment
    kept = np.arange(len(experiment.log)) % seldom == 0
    turns = np.flatnonzero(np.diff(experiment.heating.astype(int)))
    kept[turns] = kept[turns + 1] = True
    return experiment.rows(kept)


def predict(model: StrainModel | ThermalStrainModel, experiments: Sequence[Experiment]) -> np.ndarray:
    """Displacement by a model over experiments, each begun cold as the estimator does; concatenated, [m].

    A thermal model goes on through stretches of one log that follow each other.
    """
    out = []
    # Asked once: it looks at every attribute.
    thermal = model if isinstance(model, ThermalStrainModel) else None
    strain = cast(StrainModel, model)
    for experiment, anew in zip(experiments, begins_anew(experiments), strict=True):
        if thermal is not None:
            s = experiment.signals
            if anew:
                thermal.reset()
            ambient_C = np.broadcast_to(s.ambient_temperature_C, s.time_s.shape)
            out.append(
                thermal.observe_all(s.time_s, s.resistance_Ohm, s.stress_Pa, experiment.heating, s.power_W, ambient_C)[
                    0
                ]
            )
            continue
        strain.reset(float(experiment.resistance_Ohm[0]), float(experiment.stress_Pa[0]))
        out.append(strain.run(experiment.resistance_Ohm, experiment.stress_Pa, experiment.heating))
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
    return scipy.optimize.least_squares(
        lambda theta: residuals(build, theta, data, weight),
        start,
        loss="soft_l1",
        f_scale=LOSS_SCALE,
        x_scale="jac",
        tr_solver="lsmr",
        max_nfev=max_evaluations,
    )


def held_out_errors(build: Model, start: np.ndarray, data: Data) -> tuple[np.ndarray, np.ndarray]:
    """Mean absolute error of every cycle, as a share of the full stroke, by fits that did not see it; and the fit to
    all."""
    theta = fit(build, start, data, max_evaluations=25).x
    unit = data.unit[data.counts]
    error = np.empty(len(unit))
    for fold, _, found in _without_each_fold(build, theta, data):
        left_out = unit % FOLDS == fold
        error[left_out] = np.abs(found[left_out])
    _, index = np.unique(unit, return_inverse=True)
    return np.bincount(index, error) / np.bincount(index), theta


def held_out_m(build: Model, theta: np.ndarray, data: Data, used: Model | None = None) -> np.ndarray:
    """Displacement of every sample of ``data``, also of those that do not count, by fits that did not see its cycle.

    ``theta``: the fit to all of them; ``used``: the model that is used, where that is not the one that is fitted.
    """
    out = np.full(len(data.unit), np.nan)
    for fold, moved, _ in _without_each_fold(build, theta, data):
        left_out = data.unit % FOLDS == fold
        out[left_out] = predict((used or build)(moved), data.experiments)[left_out]
    return out


def _without_each_fold(build: Model, theta: np.ndarray, data: Data) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Number of a fold, the fit without it, and what that leaves of the samples that count.

    Every FOLDS-th cycle is held out in turn; the model still runs through it, but nothing is
    learnt from it.  Each fit is one Gauss–Newton step from that to all of them, which is what a refit
    amounts to so near its optimum.
    """
    jacobian, residual, robust = _linearised(build, theta, data)
    unit = data.unit[data.counts]
    for fold in range(FOLDS):
        seen = unit % FOLDS != fold
        scale = np.sqrt(np.maximum(robust @ jacobian**2, 1e-300))
        weighted = jacobian[seen] / scale * robust[seen, None]
        normal, gradient = weighted.T @ (jacobian[seen] / scale), weighted.T @ residual[seen]
        step = np.linalg.lstsq(normal, gradient, rcond=1e-10)[0] / scale
        found, moved = residual, theta
        for share in (1.0, 0.3):  # too curved for a whole step, maybe; where no step helps the fit to all stands
            tried = residuals(build, theta - share * step, data, data.counts.astype(float))
            if _robust(tried[seen]) <= _robust(residual[seen]):
                found, moved = tried, theta - share * step
                break
        yield fold, moved, found


def at_bound(name: str, value: float, low: float, high: float, unit: str, means: str) -> list[str]:
    """A sentence where a fitted value stands at the end of what the fit may take."""
    if low * (1.0 + 1e-6) < value < high * (1.0 - 1e-6):
        return []
    found = f"{value:.4g}, of {low:.4g} to {high:.4g} {unit}".rstrip()
    return [f"{name} stands at the end of what the fit may take ({found}): {means}; its interval says nothing"]


def transition_rate(log_rate: float) -> float:
    """The rate [1/Ω] that a fit's logarithm of it stands for, inside what a fit may take."""
    return float(np.exp(np.clip(log_rate, *LOG_RATE)))


def transition_rate_bounds(rate: float) -> list[str]:
    """A sentence where a fitted transition rate [1/Ω] stands at the end of what a fit may take."""
    low, high = np.exp(LOG_RATE)
    means = "the transition from one curve to the other is sharper or flatter than these logs can show"
    return at_bound("transition_rate", rate, float(low), float(high), "1/Ω", means)


def _robust(residual: np.ndarray) -> float:
    """What :func:`fit` makes small."""
    return float(np.sum(np.sqrt(1.0 + (residual / LOSS_SCALE) ** 2) - 1.0))


def _linearised(build: Model, theta: np.ndarray, data: Data) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Jacobian, residuals and robust weights of the samples that count."""
    solution = scipy.optimize.least_squares(
        lambda x: residuals(build, x, data, data.counts.astype(float)),
        theta,
        loss="linear",
        x_scale="jac",
        max_nfev=1,
    )
    return solution.jac, solution.fun, 1.0 / np.sqrt(1.0 + (solution.fun / LOSS_SCALE) ** 2)


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
    jacobian, residual, robust = _linearised(build, theta, data)
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
    """Raise IdentificationError where a polynomial of ``order`` in stress has more coefficients than there are
    loads."""
    full = full_cycles(experiments)
    loads = distinct_stresses(full)
    if loads < order + 1:
        hurried = [
            t for t in experiments if t.kind == PARTIAL and t.log.metadata.get("kind") == FULL and t.constant_load
        ]
        why = (
            f"; at {_loads_N(hurried)} the wire still moved where a pulse or the pause after it ended, make these "
            "longer (characterise --heat-time, --cool-time)"
            if hurried
            else ""
        )
        raise IdentificationError(
            f"{what}: a polynomial of order {order} in stress needs full cycles at {order + 1} different loads; "
            f"the logs hold {loads} ({_loads_N(full)}){why}; measure at more loads or choose a lower order"
        )


def _loads_N(experiments: Sequence[Experiment]) -> str:
    return ", ".join(f"{np.mean(t.signals.load_N):.3g} N" for t in experiments)
