"""Identification ends with the extension: effects that the model just fitted lacks even on its own logs.

Tracing looks for them; what it names must then also help logs that the effects were not fitted on, one effect after the
other, or it is left out.  A form that only follows the cycles beside the one it is judged on stays out
of the model that way.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sma_actuator.base.one_thread import one_thread
from sma_actuator.estimation.effects import EFFECTS
from sma_actuator.identify.identification import Identification, calibrated, foreign_loads_N
from sma_actuator.identify.verdict import judge
from sma_actuator.identify.verdict.errors import LogError, log_error
from sma_actuator.identify.verdict.unseen import Unseen
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.kinds import PARTIAL

from .falls import paired
from .trace.candidates import Candidate
from .trace.evidence import Evidence
from .trace.fitting import Fit, fit
from .trace.prediction import Prediction
from .trace.rows import Rows
from .trace.tracing import trace

MOST_SAMPLES = 15_000  #: of all logs together that are traced; those of more are thinned
FOLDS = 3  #: of logs
LEAST_GAIN = 0.05  #: share of its error that an effect must take off a log it was not fitted on, in the mean
SIGNIFICANT = 2.0  #: standard errors over logs that must be left of that gain
SMALLEST_percent = 0.2  #: of full stroke: an error of a log that is smaller counts as this
WORST_RISE_percent = 0.3  #: of full stroke, by which no log may become worse
FEWEST_LOGS = 4
_SHORTEST = 40  #: samples of a log that is traced; the end of one that was cut holds no whole cycle

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Extended:
    """An identification with what was added to it, and what was said of it."""

    result: Identification
    added: tuple[str, ...]  #: names of effects
    sentences: list[str]
    before_percent: float  #: mean over logs, each by fits of the effects that have not seen it, % of full stroke
    after_percent: float


@one_thread()
def extend(result: Identification, jobs: int = 2, progress: Progress = lambda fraction: None) -> Extended:
    """Look for what the model lacks on its own logs, and add what helps logs it was not fitted on."""
    logs = _thinned(result)
    if len(logs) < FEWEST_LOGS:
        return _nothing(
            result, f"nothing was added: {FEWEST_LOGS} logs at least are wanted to hold some out, these are {len(logs)}"
        )
    try:
        evidence = Evidence(logs, result.config, beyond_floor=True)
        passing = [name for name, effect in EFFECTS.items() if not effect.LASTS]
        tracing = trace(evidence, without=passing, jobs=jobs, progress=lambda what, share: progress(0.8 * share))
    except BenchLogError as error:
        return _nothing(result, f"nothing was added: {error}")
    found = tracing.fit
    if found is None:
        return _nothing(result, "nothing was added: no effect is probable enough")
    kept, sentences, judged = _that_help_other_logs(evidence, found)
    progress(1.0)
    if not kept:
        return _nothing(result, *sentences)
    final = fit(evidence, kept, Rows(evidence).usual, found.values)
    names = tuple(c.name for c in kept)
    sentences.insert(
        0,
        f"added {' and '.join(f'{name} ({c.effect.WORDS})' for name, c in zip(names, kept, strict=True))}: "
        f"{judged.before.mean():.2f} to {judged.after.mean():.2f} % of full stroke, ends included, on logs that the "
        "effects were not fitted on",
    )
    mapping = _with_effects(result.mapping, final, sentences[0])
    config, known = calibrated(mapping, result.experiments)
    range_m = config.model.build(config.wire).displacement_range_m
    verdict = judge(
        judged.unseen(evidence),
        result.experiments,
        range_m,
        config.wire.full_stroke_m,
        model_type=config.model_type,
        seen_too=False,
        bounds=result.bounds,
        foreign_loads_N=foreign_loads_N(result.experiments, config),
    )
    errors = _errors(evidence, final, range_m)
    extended = dataclasses.replace(
        result, mapping=mapping, config=config, notes=[*result.notes, *known], verdict=verdict, errors=errors
    )
    return Extended(extended, names, sentences, float(judged.before.mean()), float(judged.after.mean()))


def _thinned(result: Identification) -> list[BenchLog]:
    """The logs that were fitted and are no mere rest of one, with their kind said, and no more samples than tracing
    needs."""
    seldom = max(1, -(-sum(len(one.log) for one in result.experiments) // MOST_SAMPLES))
    thinned = [one.rows(np.arange(len(one.log)) % seldom == 0) for one in result.experiments]
    thinned = [one for one in thinned if len(one.log) >= _SHORTEST and one.cycle[-1] > 0]
    return [dataclasses.replace(one.log, metadata={**one.log.metadata, "kind": one.kind}) for one in thinned]


def _nothing(result: Identification, *sentences: str) -> Extended:
    error = float(np.mean([e.full_percent for e in result.errors]))
    return Extended(result, (), list(sentences), error, error)


@dataclass(frozen=True, slots=True)
class _OtherLogs:
    """Every log by fits of the effects that have not seen it."""

    before: np.ndarray  #: error of every log without an effect, % of full stroke
    after: np.ndarray
    predictions: list[Prediction]

    def unseen(self, evidence: Evidence) -> Unseen:
        """Its samples."""
        parts = zip(evidence.logs.experiments, evidence.logs.measured_m, self.predictions, strict=True)
        lengths = [len(m) for m in evidence.logs.measured_m]
        errors = [np.abs(m - p.shown_m) / evidence.full_stroke_m * 100.0 for _, m, p in parts]
        return Unseen(
            log=np.repeat(np.arange(len(lengths)), lengths),
            load_N=np.repeat([float(np.nanmean(e.signals.load_N)) for e in evidence.logs.experiments], lengths),
            place_m=np.concatenate(evidence.logs.measured_m),
            error_percent=np.concatenate(errors),
            partial=np.repeat([e.kind == PARTIAL for e in evidence.logs.experiments], lengths),
        )


def _that_help_other_logs(evidence: Evidence, found: Fit) -> tuple[list[Candidate], list[str], _OtherLogs]:
    """Of the effects that were named, one after the other, those that help logs which they were not fitted on."""
    kept: list[Candidate] = []
    sentences: list[str] = []
    plain = evidence.predict({})
    before = _of_logs(evidence, plain)
    best = _OtherLogs(before, before, plain)
    for candidate in found.candidates:
        tried = _on_other_logs(evidence, [*kept, candidate], found, before)
        fall = (best.after - tried.after) / np.maximum(best.after, SMALLEST_percent)
        share, error = paired(fall, np.zeros(len(fall)))
        rise = float(np.max(tried.after - best.after))
        if share - SIGNIFICANT * error > 0.0 and share >= LEAST_GAIN and rise <= WORST_RISE_percent:
            kept.append(candidate)
            best = tried
            continue
        why = (
            f"makes one log worse by {rise:.2f} %"
            if rise > WORST_RISE_percent
            else f"takes {share:.0%} ± {SIGNIFICANT * error:.0%} of the error off logs that it was not fitted on"
        )
        sentences.append(f"{candidate.name} was left out: it pays within the logs, but {why}")
    return kept, sentences, best


def _on_other_logs(evidence: Evidence, candidates: Sequence[Candidate], found: Fit, before: np.ndarray) -> _OtherLogs:
    """Fit without a third of the logs, in turn."""
    fold = _folds(evidence)
    predictions: list[Any] = [None] * len(fold)
    covariance = Rows(evidence).usual
    for number in range(FOLDS):
        seen = np.zeros(evidence.units, dtype=bool)
        for units, of_log in zip(evidence.unit, fold, strict=True):
            seen[units] |= of_log != number
        without = fit(evidence, candidates, covariance, found.values, seen)
        predicted = evidence.predict(without.effects)
        for i, of_log in enumerate(fold):
            if of_log == number:
                predictions[i] = predicted[i]
    return _OtherLogs(before, _of_logs(evidence, predictions), predictions)


def _folds(evidence: Evidence) -> np.ndarray:
    """A fold for every log; those of neighbouring loads, and of one load, are in different ones."""
    stress_Pa = np.array([e.mean_stress_Pa for e in evidence.logs.experiments])
    out = np.empty(len(stress_Pa), dtype=int)
    out[np.argsort(stress_Pa, kind="stable")] = np.arange(len(stress_Pa)) % FOLDS
    return out


def _of_logs(evidence: Evidence, predictions: Sequence[Prediction]) -> np.ndarray:
    """Mean absolute error of every log, % of full stroke."""
    return np.array(
        [
            float(np.nanmean(np.abs(m - p.shown_m))) / evidence.full_stroke_m * 100.0
            for m, p in zip(evidence.logs.measured_m, predictions, strict=True)
        ]
    )


def _with_effects(mapping: dict[str, Any], found: Fit, history: str) -> dict[str, Any]:
    """The parameters with the effects in them."""
    out = copy.deepcopy(mapping)
    effects: dict[str, Any] = {c.name: {**c.fixed, **found.values[c.name]} for c in found.candidates}
    effects["order"] = list(found.names)
    effects["history"] = [f"identify {history}"]
    out["effects"] = effects
    return out


def _errors(evidence: Evidence, found: Fit, range_m: tuple[float, float]) -> list[LogError]:
    """Of the extended model on the logs it was fitted on."""
    return [
        log_error(one.name, one.signals, p.shown_m, range_m, evidence.full_stroke_m)
        for one, p in zip(evidence.logs.experiments, evidence.predict(found.effects), strict=True)
    ]
