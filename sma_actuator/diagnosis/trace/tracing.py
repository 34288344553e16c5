"""What the model lacks in some logs: all that may have happened, how probable each is, and what follows from that."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

from sma_actuator.base.one_thread import one_thread
from sma_actuator.estimation.effects import EFFECTS, NOT_THE_MODEL

from .candidates import field
from .errors import Errors, errors_of
from .evidence import Evidence
from .fitting import Fit, fit_of
from .hypotheses import hypotheses
from .lacking import lacking
from .limits import LIMITS
from .probability import NO_NAMES, Probabilities, weighed
from .rows import Hypothesis, Progress
from .scales import scales_of


@dataclass(frozen=True, slots=True)
class Tracing:
    """The result."""

    evidence: Evidence  #: the logs, as they were held against what is usual in the end
    verdict: str  #: none, traced or unexplained
    names: list[str]  #: that are given, where traced (:attr:`Probabilities.verdict`)
    probabilities: Probabilities
    hypotheses: dict[tuple[str, ...], Hypothesis]  #: by their names
    fit: Fit | None  #: of the most probable effects, given or not; None of those without a name that mend nothing
    untestable: dict[str, str]
    before: Errors  #: without any effect
    after: Errors  #: with the fit
    prior: dict[tuple[str, ...], float]  #: probabilities before the logs
    lets_be_left: float = math.inf  #: squares of the residual that such a fit may leave, over those of the calibration

    @property
    def share(self) -> float:
        """Share of the excess loss that is explained."""
        before, after, expected = self.before.losses.mean(), self.after.losses.mean(), self.evidence.expected_loss
        return float(min((before - after) / (before - expected), 1.0)) if before > expected else 0.0

    @property
    def leaves_more(self) -> bool:
        """Whether the most probable effects are not all of it, or others: where they were not fitted they leave more
        than a session in which nothing has happened, and than their own forms."""
        return self.fit is not None and self.after.left > self.lets_be_left

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
    of_the_beginning = evidence.beyond_floor and not only
    scales = scales_of(evidence)
    looked_at = field(scales, only, without, explain, of_the_beginning)
    if of_the_beginning:
        rows, tried = lacking(evidence, looked_at.candidates, jobs, progress)
    else:
        rows, tried = hypotheses(evidence, looked_at.candidates, bool(only), jobs, progress)
    explained = [rows.effects([c]) for c in looked_at.explained]
    probabilities = weighed(tried)
    verdict, names = probabilities.verdict
    if of_the_beginning:  # every effect that pays counts, and what remains is the model's as it is
        names = [n for n in probabilities.best if n not in NO_NAMES]
        verdict = "traced" if names else "none"
    before = errors_of(rows.evidence.compare({}))
    result = Tracing(
        evidence=rows.evidence,
        verdict=verdict,
        names=names,
        probabilities=probabilities,
        hypotheses={one.names: one for one in (*(one for _, one in tried), *explained)},
        fit=None,
        untestable=looked_at.untestable,
        before=before,
        after=before,
        prior={one.names: prior for prior, one in tried},
    )
    if verdict == "none" or not any(one.found for one in result.hypotheses.values()):
        return result
    best = result.chosen
    found = fit_of(result.evidence, best.fitted, best.covariance or rows.usual)
    # Of what has no name, the most probable effect is worth a word where the model is better with it, and no other.
    if verdict == "unexplained" and found.held_out.unexpected_percent.mean() >= before.unexpected_percent.mean():
        return result
    may = rows.lets_be_left(found.held_out.comparison)
    result = dataclasses.replace(result, fit=found, after=found.held_out, lets_be_left=may)
    return dataclasses.replace(result, verdict="unexplained", names=[]) if result.leaves_more else result


def of_the_model(names: Sequence[str]) -> list[str]:
    """Those of the effects that belong into a model file; the others are named and left alone."""
    return [n for n in names if EFFECTS[n].PART not in NOT_THE_MODEL]
