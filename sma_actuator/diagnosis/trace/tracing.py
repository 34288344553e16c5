"""What the model lacks in some logs: all that may have happened, how probable each is, and what follows from that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import log

import numpy as np

from sma_actuator.base.one_thread import one_thread
from sma_actuator.estimation.effects import EFFECTS, NOT_THE_MODEL
from sma_actuator.logs.errors import BenchLogError

from .amounts import unexpected_percent
from .candidates import Candidate, candidate, scales_of, untestable
from .evidence import Evidence, errors_percent
from .fitting import Fit, fit_of
from .hypotheses import UNNAMED, Hypothesis, Progress, Rows, fitted, pairs
from .limits import LIMITS
from .probability import NO_NAMES, Probabilities, weighed
from .witnesses import Prediction


@dataclass(slots=True)
class Tracing:
    """The result."""

    evidence: Evidence  #: the logs, as they were held against what is usual in the end
    verdict: str  #: none, traced or unexplained
    names: list[str]  #: that are given, where traced (:attr:`Probabilities.verdict`)
    probabilities: Probabilities
    hypotheses: dict[tuple[str, ...], Hypothesis]  #: by their names
    fit: Fit | None  #: of the most probable effects, given or not; None of those without a name that mend nothing
    untestable: dict[str, str]
    losses: dict[str, np.ndarray]  #: held-out loss of every unit, before and after
    errors_percent: dict[str, np.ndarray]  #: mean absolute error of every unit, % of full stroke, before and after
    unexpected_percent: dict[str, np.ndarray]  #: what of that the calibration does not let expect, likewise
    predictions: dict[str, list[Prediction]]  #: before and after
    expected_loss: float  #: of a cycle that is like those of the calibration
    witnesses: dict[str, dict[str, float]]  #: how far each is off, before and after (:meth:`Evidence.witnesses`)
    before: dict[tuple[str, ...], float] = field(default_factory=dict)  #: probabilities before the logs

    @property
    def share(self) -> float:
        """Share of the excess loss that is explained."""
        before, after = (float(self.losses[which].mean()) for which in ("before", "after"))
        return min((before - after) / (before - self.expected_loss), 1.0) if before > self.expected_loss else 0.0

    @property
    def chosen(self) -> Hypothesis:
        """The most probable effects, whether they are given or not."""
        return next(self.hypotheses[n] for n in self.probabilities.of if self.hypotheses[n].found)

    @property
    def beside(self) -> list[str]:
        """Names of which some have probably happened beside those that are given, the most probable first."""
        if {*self.probabilities.best} <= {*self.names} or not self.names:
            return []
        others = [n for n in self.probabilities.by_name if n not in (*self.names, *NO_NAMES)]
        return others[: LIMITS.names - len(self.names)]

    @property
    def alternatives(self) -> dict[str, Hypothesis]:
        """Of each name that is given, or is probable beside those, and is not the most probable hypothesis's, the most
        probable one that was fitted and has it."""
        out = {}
        for name in (*self.names, *self.beside):
            if name not in self.probabilities.best:
                fitted = (self.hypotheses[n] for n in self.probabilities.of if name in n and self.hypotheses[n].found)
                out[name] = next(fitted)
        return out


@one_thread()
def trace(
    evidence: Evidence,
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    jobs: int = 2,
    progress: Progress = lambda what, fraction: None,
    explain: Sequence[str] = (),
) -> Tracing:
    """Find what the model lacks in these logs.

    ``only``: names of the only effects, which have happened together or have not; ``without``: of those left out.
    ``explain``: names that are tried whether they could be given or not, to say what speaks for and against them.
    ``jobs``: fits at a time, by joblib, so that ``joblib.parallel_config("dask")`` around the call spreads them over
    a cluster.  Raises BenchLogError where an effect of ``only`` cannot be fitted on these logs.
    """
    candidates, reasons = _field(evidence, only, without)
    if evidence.beyond_floor and not only:
        rows = Rows(evidence)
        weighed_before = _lacking(rows, candidates, jobs, progress)
    elif only:
        rows, (together,) = _alone(evidence, [candidates], jobs, progress)
        without_a_name = _without_a_name(rows, [together], LIMITS.rare)
        weighed_before = [*without_a_name, (1.0 - LIMITS.nothing - LIMITS.rare, together)]
    else:
        rows, alone = _alone(evidence, [(c,) for c in candidates], jobs, progress)
        weighed_before = _all(rows, alone, jobs, progress)
    beside = [n for n in explain if n not in {c.name for c in candidates} and n not in reasons]
    scales = scales_of(evidence)
    reasons |= untestable(beside, scales)
    tried = [(0.0, rows.effects([candidate(n, scales)])) for n in beside if n not in reasons]
    return _concluded(rows, weighed_before, reasons, tried, asked=bool(only))


def _field(evidence: Evidence, only: Sequence[str], without: Sequence[str]) -> tuple[list[Candidate], dict[str, str]]:
    """Which effects may have happened, and why others cannot be told."""
    scales = scales_of(evidence)
    names = [n for n in EFFECTS if (not only or n in only) and n not in without]
    if evidence.beyond_floor and not only:  # what circuit and sensors did at the calibration, it has absorbed
        names = [n for n in names if EFFECTS[n].PART == "wire"]
    reasons = untestable(names, scales)
    if only and reasons:
        raise BenchLogError("; ".join(f"{n} cannot be fitted on these logs: {why}" for n, why in reasons.items()))
    return [candidate(n, scales) for n in names if n not in reasons], reasons


def _without_a_name(rows: Rows, alone: Sequence[Hypothesis], other: float) -> list[tuple[float, Hypothesis]]:
    """Nothing, and something else where that can be, with its probability before the logs."""
    found = [(LIMITS.nothing, rows.nothing())]
    if rows.smooth is not None:
        found.append((other, rows.something_else(alone)))
    return found


def _alone(
    evidence: Evidence, candidates: Sequence[Sequence[Candidate]], jobs: int, progress: Progress
) -> tuple[Rows, list[Hypothesis]]:
    """Each of some effects, held against the floor of where the wire was by the likeliest of them.

    How far a model is usually off depends on the place, and what has happened may make it mistake that: a resistance
    that is off by a lead has the floor of another one.  So effects are looked for with one floor everywhere, in fewer
    readings and by their own forms; that is the likeliest which is so with the floor of where it has the wire; and then
    all are held against that one: the same for all, so none can buy its rest.  What a model leaves beyond its floor has
    one everywhere anyway.
    """
    if evidence.beyond_floor:
        rows = Rows(evidence)
        return rows, fitted(rows, [(each, None) for each in candidates], jobs, progress, "effects")
    anywhere = Rows(evidence.seldom_and_anywhere(), forms=(0.0,))
    found = fitted(anywhere, [(each, None) for each in candidates], jobs, progress, "effects")
    best = max([anywhere.nothing(), *(one for one in found if not one.why_none)], key=anywhere.where_it_was)
    if best.found:
        evidence = evidence.held_where(best.found.effects)
    rows = Rows(evidence)
    known = [(one.fitted.candidates, one.fitted.values) for one in found]
    return rows, fitted(rows, known, jobs, progress, "effects again")


def _all(rows: Rows, alone: Sequence[Hypothesis], jobs: int, progress: Progress) -> list[tuple[float, Hypothesis]]:
    """Everything, each with its probability before the logs."""
    each = (1.0 - LIMITS.nothing - 3.0 * LIMITS.rare) / max(len(alone), 1)
    without_a_name = _without_a_name(rows, alone, UNNAMED * LIMITS.rare)
    return [*without_a_name, *((each, one) for one in alone), *pairs(rows, alone, jobs, progress)]


def _lacking(
    rows: Rows, candidates: Sequence[Candidate], jobs: int, progress: Progress
) -> list[tuple[float, Hypothesis]]:
    """What a model lacked from its beginning: one effect after the other, as long as one more is probable."""
    found = [(LIMITS.nothing, rows.nothing())]
    for number in range(1, LIMITS.missing + 1):
        before, best = max(found, key=lambda one: log(one[0]) + one[1].log_evidence)
        if len(best.names) + (best.found is not None) < number:
            break
        has = best.found.candidates if best.found else ()
        more = [c for c in candidates if c not in has]
        known = best.found.values if best.found else None
        tried = fitted(rows, [((*has, c), known) for c in more], jobs, progress, f"effect {number}")
        found += [((1.0 - LIMITS.nothing) * before / max(len(more), 1), one) for one in tried if not one.why_none]
    return found


def _concluded(
    rows: Rows,
    weighed_before: Sequence[tuple[float, Hypothesis]],
    reasons: dict[str, str],
    beside: Sequence[tuple[float, Hypothesis]],
    asked: bool,
) -> Tracing:
    """What follows."""
    evidence = rows.evidence
    probabilities = weighed(weighed_before)
    hypotheses = {one.names: one for _, one in (*weighed_before, *beside)}
    predictions = evidence.predict({})
    losses, errors = evidence.losses(rows.plain), errors_percent(evidence, predictions)
    every = np.ones(evidence.units, dtype=bool)
    unexpected, off = unexpected_percent(evidence, predictions), evidence.witnesses(rows.plain, every)
    verdict, names = probabilities.verdict
    if evidence.beyond_floor and not asked:  # every effect that pays counts, and what remains is the model's as it is
        names = [n for n in probabilities.best if n not in NO_NAMES]
        verdict = "traced" if names else "none"
    result = Tracing(
        evidence=evidence,
        verdict=verdict,
        names=names,
        probabilities=probabilities,
        hypotheses=hypotheses,
        fit=None,
        untestable=reasons,
        losses={"before": losses, "after": losses},
        errors_percent={"before": errors, "after": errors},
        unexpected_percent={"before": unexpected, "after": unexpected},
        predictions={"before": predictions, "after": predictions},
        expected_loss=_expected_loss(evidence),
        witnesses={"before": off, "after": off},
        before={one.names: before for before, one in weighed_before},
    )
    if verdict != "none" and any(one.found for one in hypotheses.values()):
        best = result.chosen
        found = fit_of(evidence, best.fitted, best.covariance or rows.usual)
        # Of what has no name, the most probable effect is worth a word where the model is better with it, and no other.
        if verdict == "unexplained" and found.held_out_unexpected_percent.mean() >= unexpected.mean():
            return result
        result.fit = found
        result.predictions["after"] = evidence.predict(found.effects)
        result.losses["after"] = found.held_out
        result.errors_percent["after"] = found.held_out_percent
        result.unexpected_percent["after"] = found.held_out_unexpected_percent
        result.witnesses["after"] = evidence.witnesses(found.held_out_rows, every)
    return result


def _expected_loss(evidence: Evidence) -> float:
    """Mean loss of a cycle that is like those of the calibration."""
    if evidence.beyond_floor:
        return 0.0
    others = len(evidence.unit_of_row) - evidence.rows_of_samples
    return 0.5 * (float(evidence.independent.mean()) + others / evidence.units)


def of_the_model(names: Sequence[str]) -> list[str]:
    """Those of the effects that belong into a model file; the others are named and left alone."""
    return [n for n in names if EFFECTS[n].PART not in NOT_THE_MODEL]
