"""What a model's error is expected to be at a place of the loop *and with the history that led there*.

A model errs in the same way again and again: its error depends on where the wire is, how it came there and how warm
it is.  On the model's own logs that is learned once, by ridge regression on many simple bends of what is seen: the
model's displacement, resistance, stress, branch, the temperature that a heat balance keeps beside them, and how far
temperature and resistance have come from their last turns (:mod:`sma_actuator.estimation.models.heat_content`).
What is expected so is not unexpected to anybody who traces a later log.

A model may also depend on the way by which its load came to be what it is, which no wire that was ever loaded by
weights has told it, and between its loads it goes on as its polynomial does, which with few loads goes through all of
them and errs in none.  What it would say at the loads of its calibration if they had always hung there, and between
these a smooth curve, is another opinion.  Between the two lies what is expected, and how far they are apart is part of
how well it is known (:func:`always_so_m`).

How well that is known, a second opinion says: where the wire is, by all of that but the model's displacement.  The two
agree where the logs have been, and not at a place or with a history that is strange to them, or where the model has
lost its way.  How many times their disagreement the error is, is seen where neither was fitted: on loads left out, or,
where these are too few for that, on stretches of time left out of each log (normalised conformal prediction, like the
whole-range model's own interval).  That is the floor.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence

import numpy as np

from sma_actuator.base.calibration import ExpectationSection, through_each
from sma_actuator.base.jit import jit
from sma_actuator.base.remembered import Remembered
from sma_actuator.base.signals import Signals
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain, Estimates
from sma_actuator.estimation.models.heat_content import (
    DIRECT,
    PLAYS_OF_RANGE,
    REMEMBERED,
    features_all,
    usual_heat_balance,
)
from sma_actuator.logs.cycles import SAME_LOAD
from sma_actuator.logs.experiments import Experiment

from .interval import COVERAGE, INTERVAL
from .rest import SPREAD
from .stresses import clusters

UNITS = 240  #: bends, of SEEN_TOGETHER of the features each
SEEN_TOGETHER = 3
PLAYS_K = (1.5, 3.0, 5.0, 8.0, 12.0)  #: half-widths; with others, what was learned in files that exist means nothing
FEATURES = DIRECT + len(PLAYS_K) + len(PLAYS_OF_RANGE) + 2  #: with the model's displacement and the branch
MODEL = FEATURES - 2  #: of these, the model's displacement
RIDGE = 1e-3  #: per row
MOST_ROWS = 8000  #: that the regression sees; logs of more are thinned
FOLDS = 4
BLOCK_s = 20.0  #: left out together: longer than what a residual remembers; less of short logs
FEWEST_LOADS = 3  #: from which all logs of a load are left out together
CHANGES = 0.1  #: spread of the load, over the load, from which it counts as changing
LONGEST_s = 30.0  #: lag up to which a residual is held against itself


class Expectation:
    """What the calibration of a model expects of the residual.  Raises ValueError where it has learned nothing."""

    def __init__(self, config: Config):
        known, range_Ohm = config.calibration.expectation, config.calibration.resistance_range
        if not known.known:
            raise ValueError("the calibration says nothing of its residual")
        self._low_m, self._high_m = known.expected_stroke
        self._ambient_C = config.calibration.usual_ambient_C(config.thermal.ambient_temperature)
        self._thermal = usual_heat_balance(config.thermal, range_Ohm)
        self._widths_Ohm = np.array(PLAYS_OF_RANGE) * range_Ohm
        self._centre, self._scale = np.array(known.expected_centre), np.array(known.expected_scale)
        self._least, self._most = np.array(known.expected_least), np.array(known.expected_most)
        self._weights_m, self._place_m = np.array(known.expected_weights), np.array(known.expected_place)
        self._apart_m, self._times = known.expected_apart, known.expected_times
        self._floor_m = known.floor / 100 * config.wire.full_stroke_m
        self._remembered = Remembered()

    def residual_m(self, found: Estimates, rows: np.ndarray | slice, ambient_counts: bool = False) -> np.ndarray:
        """Measured less estimated displacement that is expected, of some of n samples.

        ``ambient_counts``: with the surroundings as they are logged, not as they were at the calibration.
        """
        decides = [
            found.time_s,
            found.heat_W,
            found.resistance_Ohm,
            found.signals.stress_Pa,
            found.model_m,
            found.branch,
        ]
        decides += [np.arange(len(found.time_s))[rows]]
        decides += [np.asarray(found.signals.ambient_temperature_C)] if ambient_counts else []
        return self._remembered.of(
            lambda: _evaluate(self._seen(found, rows, ambient_counts), self._weights_m), *decides
        )

    def floor_m(self, found: Estimates, rows: np.ndarray | slice) -> np.ndarray:
        """How far off that is in the mean where it was not fitted, of some of n samples.

        Of a file without a second opinion, the same everywhere.
        """
        model_m = found.model_m[rows]
        if not len(self._place_m):
            return np.full(len(model_m), self._floor_m)
        seen = self._seen(found, rows)
        place_m = _evaluate(_without_the_model(seen), self._place_m)
        return self._times * (self._apart_m + np.abs(model_m + _evaluate(seen, self._weights_m) - place_m))

    def _seen(self, found: Estimates, rows: np.ndarray | slice, ambient_counts: bool = False) -> np.ndarray:
        stroke_m = (self._low_m, self._high_m)
        ambient_C: float | np.ndarray = self._ambient_C
        if ambient_counts:
            read_C = np.asarray(found.signals.ambient_temperature_C)
            ambient_C = np.where(np.isfinite(read_C), read_C, self._ambient_C)
        seen = _features(found, self._thermal, self._widths_Ohm, stroke_m, ambient_C)[rows]
        return np.clip((seen - self._centre) / self._scale, self._least, self._most)


def always_so_m(signals: Signals, chain: Chain, loads_Pa: np.ndarray) -> np.ndarray:
    """Half of what a chain would say more if at every sample the load had always been what it is, of n samples.

    Of that it is asked at ``loads_Pa`` alone, those of its calibration.  The chain, with the memory that it has, stays
    as it is.
    """
    least_Pa, middle_Pa, most_Pa = np.nanpercentile(signals.stress_Pa, (0.5, 50.0, 99.5))
    if not most_Pa - least_Pa > CHANGES * abs(middle_Pa):
        signals = _always_at(signals, middle_Pa)  # the noise of a load cell is no way of a load
    said_m = np.array([copy.deepcopy(chain).run(_always_at(signals, load_Pa)).model_m for load_Pa in loads_Pa])
    always_m = through_each(loads_Pa, np.nan_to_num(said_m), np.nan_to_num(signals.stress_Pa))
    return np.nan_to_num(0.5 * (always_m - copy.deepcopy(chain).run(signals).model_m))


def _always_at(signals: Signals, constant_Pa: float) -> Signals:
    """The same under a load that has always been this one."""
    factor = constant_Pa / np.where(signals.stress_Pa == 0.0, np.nan, signals.stress_Pa)
    load_N = np.where(np.isfinite(factor), signals.load_N * factor, signals.load_N)
    return dataclasses.replace(signals, stress_Pa=np.full(len(factor), constant_Pa), load_N=load_N)


def learn(experiments: Sequence[Experiment], found: Sequence[Estimates], config: Config) -> ExpectationSection:
    """Learn what to expect.

    ``found``: what the model's chain makes of each log; ``config`` knows the range of the resistance at the
    calibration.
    """
    full_m = config.wire.full_stroke_m
    range_Ohm = config.calibration.resistance_range
    places_m = np.concatenate([t.displacement_m for t in experiments])
    low_m, high_m = (float(v) for v in np.nanpercentile(places_m, (0.5, 99.5)))
    ambient_C = config.calibration.usual_ambient_C(config.thermal.ambient_temperature)
    thermal = usual_heat_balance(config.thermal, range_Ohm)
    widths_Ohm = np.array(PLAYS_OF_RANGE) * range_Ohm
    loads_Pa = clusters([t.mean_stress_Pa for t in experiments])
    stride = max(1, -(-len(places_m) // MOST_ROWS))
    rows = []
    for number, (experiment, estimates) in enumerate(zip(experiments, found, strict=True)):
        seen = _features(estimates, thermal, widths_Ohm, (low_m, high_m), ambient_C)
        residual_m = experiment.displacement_m - estimates.displacement_m
        residual_m = residual_m - always_so_m(experiment.signals, Chain(config), loads_Pa)
        good = np.isfinite(seen).all(axis=1) & np.isfinite(residual_m)
        time_s = estimates.time_s - estimates.time_s[0]
        block = time_s // min(BLOCK_s, max(time_s[-1], 1e-9) / (2 * FOLDS)) + number
        columns = (seen, residual_m, np.full(len(good), number), block, time_s)
        rows.append(tuple(c[good][::stride] for c in columns))
    seen, residual_m, log, block, time_s = (np.concatenate(c) for c in zip(*rows, strict=True))
    centre, scale = seen.mean(axis=0), seen.std(axis=0) + 1e-12
    z = (seen - centre) / scale
    beside = _without_the_model(z)
    basis, basis_beside = _basis(z), _basis(beside)
    place_m = seen[:, MODEL] + residual_m
    stretches = block.astype(int) % FOLDS
    fold = _of_loads(experiments, log)
    fold = stretches if fold is None else fold
    unexpected_m = _left_out(z, basis, residual_m, fold)
    apart_m = np.abs(_left_out(beside, basis_beside, place_m, fold) - unexpected_m)
    # Of a load that was fitted: what a regression adds beyond the loads that it knows lasts as long as its cycles.
    lasting_m = unexpected_m if fold is stretches else _left_out(z, basis, residual_m, stretches)
    typical_m = float(np.median(apart_m))
    times = float(np.quantile(np.abs(unexpected_m) / (typical_m + apart_m), COVERAGE)) / (INTERVAL * SPREAD)
    return ExpectationSection(
        expected_stroke=(low_m, high_m),
        expected_centre=_rounded(centre),
        expected_scale=_rounded(scale),
        expected_least=_rounded(z.min(axis=0)),
        expected_most=_rounded(z.max(axis=0)),
        expected_weights=_rounded(_ridge(basis, residual_m)),
        expected_place=_rounded(_ridge(basis_beside, place_m)),
        expected_apart=typical_m,
        expected_times=times,
        floor=float(np.abs(unexpected_m).mean()) / full_m * 100,
        independent_time=correlation_time_s(time_s, lasting_m, log),
    )


def how_long(experiments: Sequence[Experiment], found: Sequence[Estimates]) -> ExpectationSection:
    """Of a model that says itself how far off it may be: how long its errors last, and nothing else.

    ``found``: what the model's chain makes of each log.
    """
    rows = []
    for number, (experiment, estimates) in enumerate(zip(experiments, found, strict=True)):
        residual_m = experiment.displacement_m - estimates.displacement_m
        good = np.isfinite(residual_m)
        rows.append((estimates.time_s[good], residual_m[good], np.full(int(good.sum()), number)))
    return ExpectationSection(
        independent_time=correlation_time_s(*(np.concatenate(c) for c in zip(*rows, strict=True)))
    )


def _features(
    found: Estimates,
    thermal: np.ndarray,
    widths_Ohm: np.ndarray,
    stroke_m: tuple[float, float],
    ambient_C: float | np.ndarray,
) -> np.ndarray:
    """What the error may depend on, (n, FEATURES); not a number where a sample is not good."""
    out = np.full((len(found.time_s), FEATURES), np.nan)
    columns = [
        np.broadcast_to(values, (len(out),))
        for values in (
            found.time_s,
            found.heat_W,
            found.resistance_Ohm,
            found.signals.stress_Pa,
            found.model_m,
            ambient_C,
        )
    ]
    good = np.isfinite(np.sum(columns, axis=0))
    time_s, power_W, resistance_Ohm, stress_Pa, model_m, around_C = (np.ascontiguousarray(c[good]) for c in columns)
    seen = np.empty((len(time_s), FEATURES - 2))
    first = np.zeros(len(time_s), dtype=np.bool_)
    first[:1] = True
    features_all(
        time=time_s,
        power=power_W,
        ambient=around_C,
        resistance=resistance_Ohm,
        stress=stress_Pa,
        share=np.clip((model_m - stroke_m[0]) / (stroke_m[1] - stroke_m[0]), 0.0, 1.0),
        first=first,
        thermal=thermal,
        widths_K=np.array(PLAYS_K),
        widths_Ohm=widths_Ohm,
        state=np.zeros(REMEMBERED + FEATURES - 2 - DIRECT),
        out=seen,
    )
    out[good, :-2], out[good, -2] = seen, model_m
    out[good, -1] = np.where(np.broadcast_to(found.branch, good.shape)[good] == 1, 1.0, -1.0)
    return out


def _units() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The bends: which features each sees (UNITS, SEEN_TOGETHER), how steeply, and where it lies (UNITS,).

    Drawn by a generator whose numbers never change, so that a file of weights says all.
    """
    rng = np.random.RandomState(1)
    which = np.array([rng.permutation(FEATURES)[:SEEN_TOGETHER] for _ in range(UNITS)])
    return which, rng.normal(size=(UNITS, SEEN_TOGETHER)), rng.uniform(-2.0, 2.0, UNITS)


_UNITS = _units()


def _evaluate(z: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The regression at ``z`` (n, FEATURES)."""
    out = np.empty(len(z))
    _sum(np.ascontiguousarray(z.T), *_UNITS, weights, np.empty(len(z)), out)
    return out


@jit
def _sum(
    z: np.ndarray,
    which: np.ndarray,
    steep: np.ndarray,
    shift: np.ndarray,
    weights: np.ndarray,
    inner: np.ndarray,
    out: np.ndarray,
) -> None:
    """``z``: (FEATURES, n), so that the innermost loops go over neighbours, which a processor takes several at a
    time; ``inner`` (n,) is room to work in."""
    features, n = z.shape
    out[:] = weights[0]
    for j in range(features):
        for i in range(n):
            out[i] += weights[1 + j] * z[j, i]
    for k in range(len(which)):
        inner[:] = shift[k]
        for j in range(which.shape[1]):
            of = z[which[k, j]]
            for i in range(n):
                inner[i] += steep[k, j] * of[i]
        for i in range(n):
            out[i] += weights[1 + features + k] * inner[i] / (1.0 + abs(inner[i]))


def _basis(z: np.ndarray) -> np.ndarray:
    """What is weighed, (n, 1 + FEATURES + UNITS)."""
    which, steep, shift = _UNITS
    inner = np.einsum("nkj,kj->nk", z[:, which], steep) + shift
    return np.column_stack((np.ones(len(z)), z, inner / (1.0 + np.abs(inner))))


def _without_the_model(z: np.ndarray) -> np.ndarray:
    """The features for one who does not know where the model has the wire."""
    out = z.copy()
    out[:, MODEL] = 0.0
    return out


def _ridge(basis: np.ndarray, target: np.ndarray) -> np.ndarray:
    shrink = np.full(basis.shape[1], RIDGE * len(basis))
    shrink[0] = 1e-9
    return np.linalg.solve(basis.T @ basis + np.diag(shrink), basis.T @ target)


def _of_loads(experiments: Sequence[Experiment], log: np.ndarray) -> np.ndarray | None:
    """Which rows are left out together, by number: all logs of a load, neighbouring loads with different ones; None
    where there are too few loads."""
    stress_Pa = np.array([t.mean_stress_Pa for t in experiments])
    ordered = np.sort(stress_Pa)
    edges_Pa = ordered[1:][np.diff(ordered) > SAME_LOAD * np.abs(ordered[:-1])]
    if len(edges_Pa) + 1 < FEWEST_LOADS:
        return None
    return np.searchsorted(edges_Pa, stress_Pa, side="right")[log] % FOLDS


def _left_out(z: np.ndarray, basis: np.ndarray, target: np.ndarray, fold: np.ndarray) -> np.ndarray:
    """Target less what is expected by a regression that has not seen it; ``basis``: of all of ``z``."""
    out = target.copy()
    for number in range(FOLDS):
        hidden = fold == number
        if hidden.any() and not hidden.all():
            seen = z[~hidden]
            weights = _ridge(basis[~hidden], target[~hidden])
            out[hidden] -= _evaluate(np.clip(z[hidden], seen.min(axis=0), seen.max(axis=0)), weights)
    return out


def correlation_time_s(time_s: np.ndarray, values: np.ndarray, log: np.ndarray) -> float:
    """How long a residual remembers itself: two of its samples so far apart say two things.

    Twice the integral of its autocorrelation up to where that first is nothing, over all logs; what a whole log has in
    common is not counted.
    """
    steps = [np.median(np.diff(time_s[log == k])) for k in np.unique(log) if np.sum(log == k) > 2]
    step_s = float(np.median(steps))
    most = max(2, round(LONGEST_s / step_s))
    total, power = np.zeros(most), 0.0
    for k in np.unique(log):
        x = values[log == k] - values[log == k].mean()
        power += float(x @ x)
        for lag in range(1, min(most, len(x))):
            total[lag] += float(x[lag:] @ x[:-lag])
    correlation = total / max(power, 1e-300)
    gone = np.flatnonzero(correlation[1:] <= 0.0)
    last = int(gone[0]) + 1 if len(gone) else most
    return float(step_s * (1.0 + 2.0 * correlation[1:last].sum()))


def _rounded(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(f"{v:.6g}") for v in values)
