"""Coefficients of the whole-range model: heat balance and learned residual together, judged on what they did not see.

The fit is a damped Gauss-Newton (Levenberg-Marquardt) with a robust loss, from a start that a fixed seed gives: the
same logs give the same numbers.  The heat balance's numbers are fitted with the weights, each drawn to what is known
of such wires.  While they are fitted the displacement that the heat balance sees is the measured one.

It is judged three times over by logs left out, by loads and by cycles left out, the weights learned afresh
each time.  The intervals are the errors of logs and loads left out over the spread of the learners (normalised conformal
prediction, for every place and branch).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.estimation.models.whole_range import (
    CURVE_TERMS,
    DIRECT,
    KNOWN,
    PLAYS_K,
    PLAYS_OF_RANGE,
    STRESS,
    WholeRangeCoefficients,
    features_all,
    thermal_numbers,
)
from sma_actuator.logs.experiments import Experiment, IdentificationError, begins_anew
from sma_actuator.logs.kinds import load_numbers

from .fitting import at_bound, predict
from .ranges import ONE_LOAD, distinct_stresses
from .unseen import Unseen

LEARNERS = 3
UNITS = 16  #: tanh units of each
PLACES = 6  #: at which the interval is stated, on either branch
FOLDS = 3
NEVER = -1  #: left out
#: A load left out leaves a gap twice as wide as the one that a load between its neighbours finds, and what is between is off
#: by the square of it.
LOAD_LEFT_OUT = 0.25
LEARNERS_OF_LOADS = 2  #: at such a load
JOINT_UNITS = 14  #: of the one learner that the heat balance is fitted with
JOINT_ITERATIONS, ITERATIONS, HELD_OUT_ITERATIONS = 60, 100, 40
EVERY = 3  #: the heat balance moves in every third iteration: it costs eight runs through the logs
MOST_ROWS = 9000  #: that a fit sees; logs of more are thinned
SHORTEST_STEP_s = 0.045  #: readings closer together are averaged: they say the same
ROBUST = 1.0  #: % of the full stroke beyond which an error counts linearly
SHRINKAGE = 0.3  #: of the weights, in squared % of the full stroke
#: Logs have a handful of loads, and between them nothing tells a learner how to bend: bends along stress are shrunk so much more,
#: with fewer than USUAL_LOADS by the square of how much further these are apart, as what is between two of them goes with it.
SMOOTH_IN_STRESS, USUAL_LOADS = 3.0, 5
#: A heat balance fitted to pulses is off by some tenths of a kelvin or more when the wire is driven otherwise.  Copies of
#: the logs with such an error [K] teach the learners not to lean on it where the resistance says more; copies with the
#: other one are for the intervals alone.
LEARNED_ERROR_K, JUDGED_ERROR_K = 0.5, 1.5
COVERAGE = 0.95
_PLACE_WIDTH = 0.8  #: of the window around a place, in distances of places

# How far what is known of wires before a log is seen (KNOWN) may be off, and between what it must lie.
_UNSURE = np.array([0.2, 0.0015, 3.0, 5.0, 6.0, 0.025, 0.02])
_LEAST = np.array([0.2, 0.0, -30.0, 0.0, -60.0, 0.02, 0.02])
_MOST = np.array([5.0, 0.03, 60.0, 120.0, 90.0, 0.5, 0.5])
_NAMES = (
    "the time constant over C/h",
    "the growth of the heat loss",
    "the latent heat of the R-phase",
    "the latent heat",
    "the apparent temperature per resistance",
    "the shift of the loop with stress",
    "the shift of the narrow loop with stress",
)
_PRIOR_WEIGHT = 3.0


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Errors of the model and of its physical curve where they were not fitted, mean absolute, % of full stroke."""

    logs_percent: float  #: logs left out, and loads
    cycles_percent: float  #: cycles left out
    curve_percent: float  #: physical curve alone, logs left out
    regions: dict[str, float]  #: cycles left out, by region (:func:`regions`)


@dataclass(frozen=True, slots=True)
class WholeRangeFit:
    """What was found, and how good it is where it was not fitted."""

    coefficients: WholeRangeCoefficients
    held_out: HeldOut
    unseen: Unseen  #: samples of cycles left out
    bounds: list[str]  #: a sentence for every number of the heat balance that stands at the end of its range


def fit_whole_range(
    experiments: Sequence[Experiment],
    config,
    progress: Callable[[float], None] = lambda fraction: None,
    change_m: float = 0.0,
) -> WholeRangeFit:
    """Fit to all loads, pulses and partial cycles together.

    ``config``: the bench's parameters; ``change_m``: how far the wire moved its hot end in all of the logs together.

    Raises IdentificationError where there are fewer than three logs, and in them fewer than three cycles.
    """
    data = _Data(experiments, config)
    data.change = change_m / data.percent_m
    known, centre, scale = _heat_balance(data, lambda share: progress(0.4 * share))
    z = (data.features(known)[data.rows] - centre) / scale
    by_log = _errors_left_out(z, data, data.log_fold[data.rows])
    by_load = _errors_left_out(z, data, data.load_fold[data.rows], LEARNERS_OF_LOADS)
    by_both = by_log.beside(by_load, LOAD_LEFT_OUT)
    progress(0.6)
    by_cycle = _errors_left_out(z, data, data.cycle[data.rows] % FOLDS)
    progress(0.8)
    team = _Team(z[data.learned], data.displacement[data.rows[data.learned]], ITERATIONS, data.smooth)
    coefficients = _coefficients(data, known, z, (centre, scale), team, by_both)
    progress(1.0)
    measured = data.measured
    errors = [np.abs(e[measured]) for e in (by_log.error, by_cycle.error, by_log.curve_error)]
    partial = np.repeat([t.kind == "partial" for t in experiments], data.lengths)[data.rows[measured]]
    logs_error, cycles_error, curve_error = (float(e.mean()) for e in errors)
    held_out = HeldOut(
        logs_error,
        cycles_error,
        curve_error,
        regions=regions(data.displacement[data.rows[measured]], partial, errors[1]),
    )
    rows = data.rows[measured]
    of_log = np.repeat(np.arange(len(experiments)), data.lengths)[rows]
    unseen = Unseen(
        log=of_log,
        load_N=np.array([float(np.nanmean(t.signals.load_N)) for t in experiments])[of_log],
        place_m=data.displacement[rows] * data.percent_m,
        error_percent=errors[1],
        partial=partial,
    )
    bounds = [
        sentence
        for name, value, least, most in zip(_NAMES, known, _LEAST, _MOST, strict=True)
        if value <= least or value >= most
        for sentence in at_bound(name, value, least, most, "", "these logs do not determine it")
    ]
    return WholeRangeFit(coefficients, held_out, unseen, bounds)


def regions(place: np.ndarray, partial: np.ndarray, size: np.ndarray) -> dict[str, float]:
    """Mean of ``size`` at either end of the stroke (a tenth of it), between them, and in logs of partial cycles."""
    low, high = np.percentile(place, (0.5, 99.5))
    hot, cold = place < low + 0.1 * (high - low), place > high - 0.1 * (high - low)
    chosen = {"hot end": hot, "cold end": cold, "between": ~hot & ~cold, "partial cycles": partial}
    return {name: float(size[rows].mean()) for name, rows in chosen.items() if rows.any()}


def beside_the_thesis(
    experiments: Sequence[Experiment], thesis, found: WholeRangeFit, full_stroke_m: float
) -> tuple[bool, str]:
    """Whether to take the thesis's rather, and why: one sentence.

    ``thesis`` is a model of the thesis fitted on the very logs it is judged on; the whole-range model is judged on
    cycles left out, so what speaks for it is not the fit.
    """
    measured_m = np.concatenate([t.displacement_m for t in experiments])
    size = np.abs(predict(thesis, experiments) - measured_m) / full_stroke_m * 100.0
    good = np.isfinite(size)
    partial = np.repeat([t.kind == "partial" for t in experiments], [len(t.displacement_m) for t in experiments])
    theirs = regions(measured_m[good], partial[good], size[good])
    ours = found.held_out.regions
    words = ", ".join(f"{name} {ours[name]:.2f} against {theirs[name]:.2f} %" for name in ours if name in theirs)
    worse = [name for name in ours if name in theirs and ours[name] > theirs[name]]
    if not worse:
        return (
            False,
            f"take whole_range: on cycles left out it is better in every region than the thesis's model ({words})",
        )
    if found.held_out.cycles_percent < float(size[good].mean()):
        return (
            False,
            f"take whole_range, but not for its sake at {' and '.join(worse)}, where the thesis's model is better ({words})",
        )
    return True, f"take the thesis's model: on cycles left out whole_range is worse ({words}); it may want more logs"


class _Data:
    """The logs' samples one after the other, thinned to what a fit needs; displacement in % of the full stroke."""

    def __init__(self, experiments: Sequence[Experiment], config):
        self.config, self.wire, self.thermal = config, config.wire, config.thermal
        self.percent_m = config.wire.full_stroke_m / 100.0
        parts = [_thinned(t, config.thermal.ambient_temperature) for t in experiments]
        loads = distinct_stresses(experiments)
        rng = np.random.default_rng(0)
        for error_K in (LEARNED_ERROR_K, JUDGED_ERROR_K):
            parts += [_with_other_surroundings(p, error_K, rng) for p in parts[: len(experiments)]]
        if loads == 1:
            parts[len(experiments) :] = [_with_another_load(p, rng) for p in parts[len(experiments) :]]
        copies = len(parts) // len(experiments)
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        self.time, self.power, self.ambient, self.resistance, self.stress = columns[:5]
        self.displacement, self.heating, self.cycle = columns[5] / self.percent_m, columns[6], columns[7]
        self.ends = _ends_of_stroke(experiments, parts) / self.percent_m
        powers = self.stress[:, None] ** np.arange(3)
        hot, cold = powers @ self.ends[0], powers @ self.ends[1]
        self.share = np.clip((self.displacement - hot) / (cold - hot), 0.0, 1.0)
        lengths = [len(p[0]) for p in parts]
        self.lengths = lengths[: len(experiments)]
        self.first = np.zeros(len(self.time), dtype=np.bool_)
        self.first[np.cumsum([0, *lengths[:-1]])] = begins_anew(experiments) * copies
        if (
            len(experiments) < FOLDS
        ):  # of a few long logs a third of the cycles is held out in turn, one beside the other
            thirds = [_thirds(p[7]) for p in parts[: len(experiments)]]
            self.log_fold = np.concatenate(thirds * copies)
        else:
            self.log_fold = np.repeat(np.tile(_log_folds(experiments), copies), lengths)
        self.load_fold = np.repeat(np.tile(_load_folds(experiments), copies), lengths)
        self.cycle = self.cycle + np.repeat(np.tile(np.arange(len(experiments)), copies), lengths)
        cycles = sum(int(t.cycle[-1]) for t in experiments)
        if len(experiments) < FOLDS and cycles < FOLDS:
            raise IdentificationError(
                f"whole_range: {FOLDS} logs or cycles at least are needed, some to be left out while the others are fitted; "
                f"there {'is' if cycles == 1 else 'are'} {cycles}: heat and cool the wire more often"
            )
        stride = max(1, -(-len(self.time) // MOST_ROWS))
        self.rows = np.arange(0, len(self.time), stride)
        self.measured = self.rows < sum(self.lengths)  # the others are of copies
        self.learned = self.rows < 2 * sum(self.lengths)
        self.change = 0.0  #: of the wire meanwhile
        gaps = max(loads - 1, 1)
        #: Rows whose spread is the unit of a feature; a single load has none but in the copies.
        self.scaling_rows = self.rows if loads == 1 else self.rows[self.measured]
        self.smooth = SMOOTH_IN_STRESS * max(1.0, ((USUAL_LOADS - 1) / gaps) ** 2)
        self.span_Ohm = float(np.subtract(*np.percentile(self.resistance, (99, 1))))

    def thermal_numbers(self, known: np.ndarray) -> np.ndarray:
        """The heat balance for the kernels, from numbers in units of what is known."""
        return thermal_numbers(known, self.thermal, self.span_Ohm)

    @property
    def plays_Ohm(self) -> np.ndarray:
        """Half-widths of the plays in resistance."""
        return np.array(PLAYS_OF_RANGE) * self.span_Ohm

    def features(self, known: np.ndarray) -> np.ndarray:
        """What the model sees of every sample, shape (n, features)."""
        out = np.empty((len(self.time), DIRECT + len(PLAYS_K) + len(PLAYS_OF_RANGE)))
        features_all(
            time=self.time,
            power=self.power,
            ambient=self.ambient,
            resistance=self.resistance,
            stress=self.stress,
            share=self.share,
            first=self.first,
            thermal=self.thermal_numbers(known),
            widths_K=np.array(PLAYS_K),
            widths_Ohm=self.plays_Ohm,
            state=np.zeros(4 + out.shape[1] - DIRECT),
            out=out,
        )
        return out


def _thinned(experiment: Experiment, ambient_C: float) -> tuple[np.ndarray, ...]:
    """A log's good samples, as many together as make a step of SHORTEST_STEP_s; their power is the mean."""
    s = experiment.signals
    good = np.isfinite(s.resistance_Ohm + s.stress_Pa + s.power_W + s.reference_displacement_m + s.time_s)
    time_s = s.time_s[good]
    together = max(1, round(SHORTEST_STEP_s / max(float(np.median(np.diff(time_s))), 1e-6)))
    n = len(time_s) // together * together
    ambient = np.broadcast_to(s.ambient_temperature_C, good.shape)[good]
    ambient = np.where(np.isfinite(ambient), ambient, ambient_C)

    def last(values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values[:n].reshape(-1, together)[:, -1])

    return (
        last(time_s),
        s.power_W[good][:n].reshape(-1, together).mean(axis=1),
        last(ambient).astype(float),
        *(last(v[good]) for v in (s.resistance_Ohm, s.stress_Pa, s.reference_displacement_m)),
        last(experiment.heating[good]),
        last(experiment.cycle[good]),
    )


def _ends_of_stroke(experiments: Sequence[Experiment], parts: Sequence[tuple[np.ndarray, ...]]) -> np.ndarray:
    """Hot and cold end [m] as quadratics in stress (lower orders where there are fewer loads), shape (2, 3)."""
    whole = [p for t, p in zip(experiments, parts, strict=False) if t.kind != "partial"] or list(
        parts[: len(experiments)]
    )
    stress_Pa, place_m = np.empty((2, len(whole))), np.empty((2, len(whole)))
    for k, part in enumerate(whole):
        stress, displacement = part[4], part[5]
        low, high = np.percentile(displacement, (0.5, 99.5))
        for end, chosen in enumerate(
            (displacement <= low + 0.02 * (high - low), displacement >= high - 0.02 * (high - low))
        ):
            stress_Pa[end, k], place_m[end, k] = np.median(stress[chosen]), (low, high)[end]
    order = min(2, distinct_stresses(experiments) - 1)
    out = np.zeros((2, 3))
    for end in range(2):
        found = np.polynomial.polynomial.polyfit(stress_Pa[end] / 1e8, place_m[end], order)
        out[end, : order + 1] = found / 1e8 ** np.arange(order + 1)
    return out


def _with_other_surroundings(
    part: tuple[np.ndarray, ...], error_K: float, rng: np.random.Generator
) -> tuple[np.ndarray, ...]:
    """The same log as if the heat balance were off by a slowly changing temperature."""
    time_s, power_W, ambient_C, *rest = part
    off_K = np.zeros(len(time_s))
    for period_s in (11.0, 37.0, 131.0):
        off_K += rng.normal() * np.sin(2.0 * np.pi * (time_s / period_s + rng.uniform()))
    return time_s, power_W, ambient_C + error_K * off_K, *rest


def _with_another_load(part: tuple[np.ndarray, ...], rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """The same log as if the load slowly wandered about, within ONE_LOAD: of how the loop goes with it one load says nothing."""
    phase = 2.0 * np.pi * (part[0] / 23.0 + rng.uniform())
    return *part[:4], part[4] * (1.0 + ONE_LOAD * np.sin(phase)), *part[5:]


def _thirds(cycle: np.ndarray) -> np.ndarray:
    """A fold for every sample of a log: its cycles in as many stretches, one after the other."""
    return np.minimum(np.maximum(cycle - 1, 0) * FOLDS // max(int(cycle[-1]), 1), FOLDS - 1)


def _log_folds(experiments: Sequence[Experiment]) -> np.ndarray:
    """A fold for every log; logs of neighbouring loads, and of one load, are in different ones."""
    stress = np.array([t.mean_stress_Pa for t in experiments])
    out = np.empty(len(stress), dtype=int)
    out[np.argsort(stress, kind="stable")] = np.arange(len(stress)) % FOLDS
    return out


def _load_folds(experiments: Sequence[Experiment]) -> np.ndarray:
    """A fold for every log: all logs of a load in one, but those of the lightest and of the heaviest load in none."""
    load = load_numbers(experiments)
    return np.where((load == 0) | (load == load.max()), NEVER, (load - 1) % FOLDS)


def _terms(z: np.ndarray) -> np.ndarray:
    """The quadratic of the model, then the plays: shape (n, terms)."""
    a, b, c = z[:, 0], z[:, 1], z[:, 2]
    return np.column_stack([np.ones(len(z)), a, b, c, a * a, b * b, c * c, a * b, a * c, b * c, z[:, DIRECT:]])


class _Learner:
    """The learned part: its weights as one vector (linear terms, hidden, bias, output), and its derivatives."""

    def __init__(self, features: int, units: int, seed: int, smooth: float):
        self.n, self.m = features, units
        self.lines = CURVE_TERMS + features - DIRECT
        rng = np.random.default_rng(seed)
        hidden = rng.normal(size=(self.m, self.n))
        reach = 0.7 * self.m ** (1.0 / self.n)  # Nguyen and Widrow's: units spread over what is seen
        hidden *= reach / np.linalg.norm(hidden, axis=1)[:, None]
        bias = np.linspace(-reach, reach, self.m)
        self.weights = np.concatenate([np.zeros(self.lines), hidden.ravel(), bias, np.zeros(self.m)])
        along = np.full(self.n, 0.3)
        along[STRESS] *= smooth
        self.shrinkage = np.concatenate(
            [np.full(self.lines, 0.02), np.tile(along, self.m), np.full(self.m, 0.3), np.full(self.m, 1.0)]
        )
        self.shrinkage = SHRINKAGE * self.shrinkage
        self.shrinkage[0] = 0.0

    def parts(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Linear terms, hidden weights, biases, outputs."""
        cut = np.cumsum([self.lines, self.m * self.n, self.m])
        linear, hidden, bias, output = np.split(weights, cut)
        return linear, hidden.reshape(self.m, self.n), bias, output

    def start(self, z: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Weights whose linear terms and outputs fit best for the hidden layer that there is."""
        _, hidden, bias, _ = self.parts(self.weights)
        basis = np.column_stack([_terms(z), np.tanh(z @ hidden.T + bias)])
        found = np.linalg.solve(basis.T @ basis + np.eye(basis.shape[1]), basis.T @ target)
        out = self.weights.copy()
        out[: self.lines], out[-self.m :] = found[: self.lines], found[self.lines :]
        return out

    def value(self, weights: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Displacement [%]."""
        linear, hidden, bias, output = self.parts(weights)
        return _terms(z) @ linear + np.tanh(z @ hidden.T + bias) @ output

    def jacobian(self, weights: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacement and its derivative with respect to the weights."""
        linear, hidden, bias, output = self.parts(weights)
        terms, act = _terms(z), np.tanh(z @ hidden.T + bias)
        slope = (1.0 - act * act) * output
        by_hidden = (slope[:, :, None] * z[:, None, :]).reshape(len(z), -1)
        return terms @ linear + act @ output, np.concatenate([terms, by_hidden, slope, act], axis=1)


def _robust(error: np.ndarray) -> float:
    size = np.abs(error)
    return float(np.where(size < ROBUST, error * error, 2.0 * ROBUST * size - ROBUST * ROBUST).sum())


def _solve(
    jacobian: np.ndarray, error: np.ndarray, pull: np.ndarray, stiffness: np.ndarray, damping: float
) -> np.ndarray:
    """One damped Gauss-Newton step of the robust, shrunk problem."""
    weight = np.minimum(1.0, ROBUST / np.maximum(np.abs(error), 1e-12))
    weighted = jacobian * weight[:, None]
    normal = weighted.T @ jacobian
    size = np.diag(normal)
    return np.linalg.solve(
        normal + np.diag(stiffness + damping * np.maximum(size, 1e-4 * size.max())), weighted.T @ error - pull
    )


def _learn(learner: _Learner, z: np.ndarray, target: np.ndarray, iterations: int) -> np.ndarray:
    """Weights for features that stand."""
    weights, damping = learner.start(z, target), 1e-2
    value, jacobian = learner.jacobian(weights, z)
    cost = _robust(target - value) + float(learner.shrinkage @ weights**2)
    for _ in range(iterations):
        step = _solve(jacobian, target - value, learner.shrinkage * weights, learner.shrinkage, damping)
        tried = weights + step
        new_cost = _robust(target - learner.value(tried, z)) + float(learner.shrinkage @ tried**2)
        if new_cost >= cost:
            damping *= 8.0
            if damping > 1e6:
                break
            continue
        enough = cost - new_cost < 1e-4 * cost
        weights, cost, damping = tried, new_cost, max(damping / 5.0, 1e-9)
        if enough:
            break
        value, jacobian = learner.jacobian(weights, z)
    return weights


class _Team:
    """Learners that differ in where they began, learned on the same samples."""

    def __init__(self, z: np.ndarray, target: np.ndarray, iterations: int, smooth: float, learners: int = LEARNERS):
        self.learners = [_Learner(z.shape[1], UNITS, seed, smooth) for seed in range(1, learners + 1)]
        for learner in self.learners:
            learner.weights = _learn(learner, z, target, iterations)

    def values(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and spread [%]."""
        each = np.array([learner.value(learner.weights, z) for learner in self.learners])
        return each.mean(axis=0), each.std(axis=0)


def _heat_balance(data: _Data, progress: Callable[[float], None]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The heat balance, fitted together with one learner; then centre and scale of the features."""
    known = KNOWN.copy()
    rows = data.rows[data.measured]
    target = data.displacement[rows]
    seen = data.features(known)[data.scaling_rows]
    centre, scale = seen.mean(axis=0), seen.std(axis=0) + 1e-12
    learner = _Learner(seen.shape[1], JOINT_UNITS, 0, data.smooth)

    def scaled(numbers: np.ndarray) -> np.ndarray:
        return (data.features(numbers)[rows] - centre) / scale

    def cost_of(error: np.ndarray, weights: np.ndarray, numbers: np.ndarray) -> float:
        off = (numbers - KNOWN) / _UNSURE
        return _robust(error) + float(learner.shrinkage @ weights**2) + _PRIOR_WEIGHT * float(off @ off)

    z = scaled(known)
    weights, damping = learner.start(z, target), 1e-2
    value, jacobian = learner.jacobian(weights, z)
    cost = cost_of(target - value, weights, known)
    for i in range(JOINT_ITERATIONS):
        progress(i / JOINT_ITERATIONS)
        both = i % EVERY == 0
        pull, stiffness, slopes = learner.shrinkage * weights, learner.shrinkage, jacobian
        if both:
            columns = []
            for k in range(len(known)):
                moved = known.copy()
                moved[k] += 1e-3 * _UNSURE[k]
                columns.append((learner.value(weights, scaled(moved)) - value) / 1e-3)
            slopes = np.column_stack([jacobian, *columns])
            pull = np.concatenate([pull, _PRIOR_WEIGHT * (known - KNOWN) / _UNSURE])
            stiffness = np.concatenate([stiffness, np.full(len(known), _PRIOR_WEIGHT)])
        for _ in range(6):
            step = _solve(slopes, target - value, pull, stiffness, damping)
            tried = weights + step[: len(weights)]
            numbers, new_z = known, z
            if both:
                numbers = np.clip(known + step[len(weights) :] * _UNSURE, _LEAST, _MOST)
                new_z = scaled(numbers)
            new_cost = cost_of(target - learner.value(tried, new_z), tried, numbers)
            if new_cost < cost:
                break
            damping *= 8.0
        else:
            break
        weights, known, z, cost, damping = tried, numbers, new_z, new_cost, max(damping / 5.0, 1e-9)
        value, jacobian = learner.jacobian(weights, z)
    return known, centre, scale


@dataclass(frozen=True, slots=True)
class _LeftOut:
    """Of every row, by learners that did not see it: error, their spread, error of the curve alone [%]."""

    error: np.ndarray
    spread: np.ndarray
    curve_error: np.ndarray

    def beside(self, other: _LeftOut, share: float) -> _LeftOut:
        """The same with so much of another's error and spread added, which are independent of it."""
        error = np.hypot(self.error, share * other.error)
        return _LeftOut(
            np.where(self.error < 0.0, -error, error), np.hypot(self.spread, share * other.spread), self.curve_error
        )


def _errors_left_out(z: np.ndarray, data: _Data, fold: np.ndarray, learners: int = LEARNERS) -> _LeftOut:
    """Learn afresh without each fold in turn; the heat balance stands.  No error where a row is NEVER left out."""
    target = data.displacement[data.rows]
    found = _LeftOut(*(np.zeros(len(z)) for _ in range(3)))
    for number in range(FOLDS):
        out = fold == number
        if not out.any():
            continue
        learn = ~out & data.learned
        team = _Team(z[learn], target[learn], HELD_OUT_ITERATIONS, data.smooth, learners)
        value, found.spread[out] = team.values(z[out])
        found.error[out] = value - target[out]
        found.curve_error[out] = _terms(z[out])[:, :CURVE_TERMS] @ _curve(z[learn], target[learn]) - target[out]
    return found


def _curve(z: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The physical curve: least squares of a quadratic."""
    return np.linalg.lstsq(_terms(z)[:, :CURVE_TERMS], target, rcond=None)[0]


def _whitening(z: np.ndarray) -> np.ndarray:
    """Lower triangle that makes features white, scaled so that 95 % of them are nearer than 1."""
    square = z.T @ z / len(z) + 1e-3 * np.eye(z.shape[1])
    out = np.linalg.inv(np.linalg.cholesky(square))
    return out / np.percentile(np.linalg.norm(z @ out.T, axis=1), 95)


def _intervals(place: np.ndarray, heating: np.ndarray, score: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The 95 % quantile of a score on either branch near each place, shape (2, PLACES)."""
    out = np.full((2, len(places)), np.quantile(score, COVERAGE))
    reach = _PLACE_WIDTH * (places[1] - places[0])
    for row in range(2):
        for k, middle in enumerate(places):
            near = (heating == bool(row)) & (np.abs(place - middle) < reach)
            if near.sum() >= 40:  # the level is the one that conformal prediction asks for of so many
                out[row, k] = np.quantile(score[near], min(1.0, COVERAGE * (1.0 + 1.0 / near.sum())))
    return out


def _coefficients(
    data: _Data,
    known: np.ndarray,
    z: np.ndarray,
    scaling: tuple[np.ndarray, np.ndarray],
    team: _Team,
    left: _LeftOut,
) -> WholeRangeCoefficients:
    """In metres, rounded to six digits."""
    target, percent_m = data.displacement[data.rows], data.percent_m
    lowest, highest = (float(v) for v in np.percentile(data.displacement, (0.1, 99.9)))
    curve = _curve(z[data.learned], target[data.learned])
    slack = 0.05 * (highest - lowest)
    physical = np.clip(_terms(z[data.learned])[:, :CURVE_TERMS] @ curve, lowest - slack, highest + slack)
    learned = z[data.learned]
    value, _ = team.values(learned)
    whitening = _whitening(learned)
    novelty = np.linalg.norm(learned @ whitening.T, axis=1)
    seen = learned * scaling[1] + scaling[0]
    low, high = seen.min(axis=0), seen.max(axis=0)
    tenth = 0.1 * (high - low)
    floor = float(np.median(left.spread))
    # Of a wire that changed meanwhile the logs say nothing to be sure of: before and after them it was off by half of it.
    score = (np.abs(left.error) + 0.5 * data.change) / (floor + left.spread)
    heating = data.heating[data.rows].astype(bool)
    intervals = _intervals(target + left.error, heating, score, np.linspace(lowest, highest, PLACES))
    linear, hidden, bias, output = (
        np.concatenate([np.ravel(part) for part in parts])
        for parts in zip(*(learner.parts(learner.weights) for learner in team.learners), strict=True)
    )
    thermal = data.thermal_numbers(known)
    return WholeRangeCoefficients(
        calibrated_length=data.wire.length,
        calibrated_diameter=data.wire.diameter,
        thermal=_six(thermal),
        hot_end=_six(data.ends[0] * percent_m),
        cold_end=_six(data.ends[1] * percent_m),
        ambient_temperature=float(f"{np.median(data.ambient):.4g}"),
        play_widths_K=PLAYS_K,
        play_widths_Ohm=_six(data.plays_Ohm),
        feature_centre=_six(scaling[0]),
        feature_scale=_six(scaling[1]),
        feature_low=_six(low - tenth),
        feature_high=_six(high + tenth),
        novelty=_six(whitening[np.tril_indices(len(whitening))]),
        novelty_edge=float(f"{1.3 * np.quantile(novelty, 0.999):.4g}"),
        curve=_six(curve * percent_m),
        learners=LEARNERS,
        linear=_six(linear * percent_m),
        hidden=_six(hidden),
        bias=_six(bias),
        output=_six(output * percent_m),
        largest_residual=float(f"{2.0 * np.abs(value - physical).max() * percent_m:.4g}"),
        intervals=_six(intervals.ravel()),
        spread_floor=float(f"{floor * percent_m:.4g}"),
        curve_interval=float(f"{np.quantile(np.abs(left.curve_error), COVERAGE) * percent_m:.4g}"),
        stress_range=tuple(float(np.round(v)) for v in (data.stress.min(), data.stress.max())),
        displacement_range=_six(np.array([lowest, highest]) * percent_m),
        stroke=_six(np.array([lowest, highest]) * percent_m),
    )


def _six(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(f"{v:.6g}") for v in values)
