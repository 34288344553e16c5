"""What may have happened, each with the evidence that logs give for it: nothing, each effect, pairs of them, and
something else.

An effect moves the rows of the evidence by its sizes and shapes, of which something is known before the logs, and has
its form but nearly; *something else* moves them by smooth errors that are larger than a model's usual ones and go with
more (Kennedy and O'Hagan 2001).  The evidence of each is Laplace's at its likeliest parameters (Kass and Raftery 1995).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sma_actuator.base.parameters import declaration_of
from sma_actuator.estimation.effects import EFFECTS
from sma_actuator.fleet import spread

from .candidates import Candidate
from .covariance import FORMS, Covariance, SmoothErrors
from .evidence import Evidence
from .likeliest import Likeliest, likeliest
from .limits import LIMITS

NOTHING, SOMETHING_ELSE = "nothing", "something else"
LARGER = (3.0, 10.0, 30.0)  #: σ: how large the smooth errors of something else may be, each as likely
LEADERS = 4  #: best single effects that are held in pairs with every other
BESIDE = 2  #: best single effects that something else is held beside
IN_EARNEST, WITHIN = 4, math.log(100.0)  #: pairs that are fitted; as far as they come so near to the best, in nats
NEAR_SIZE, NEAR_SHAPE = 0.01, 0.05  #: of what is possible, so near its end counts as at it: a shape comes there slowly

#: What tracing is doing, and how far it is, from 0 to 1.
Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """What may have happened, and what the logs say of it."""

    names: tuple[str, ...]
    log_evidence: float  #: up to what is common to all
    log_likelihood: float  #: the part of it that the rows have, at the likeliest parameters
    by_row: np.ndarray  #: each row's part of the squares under its covariance
    found: Likeliest | None = None  #: None of nothing and of something else
    covariance: Covariance | None = None  #: the likeliest of those that its effects may have
    objection: str = ""  #: why it is none, whatever its evidence: a parameter at the end of the possible
    #: Of something else: what it goes with, and how probably.
    goes_with: Mapping[str, float] = field(default_factory=dict)

    @property
    def fitted(self) -> Likeliest:
        """Its effects; raises ValueError where it has none that were fitted."""
        if self.found is None:
            raise ValueError(f"{' and '.join(self.names)}: not fitted")
        return self.found


class Rows:
    """What all hypotheses about some logs are held against."""

    def __init__(self, evidence: Evidence):
        self.evidence = evidence
        predictions = evidence.predict({})
        #: Rows of the model as it is, and the same without Huber's limit.
        self.plain, self.off = evidence.rows(predictions), evidence.off(predictions)
        #: What is off together; None where a model's own errors are what is looked for.
        self.smooth = None if evidence.beyond_floor else SmoothErrors(evidence, predictions)
        #: Readings that share their error: they count as one.
        self.as_one = 1.0 if self.smooth is None else self.smooth.as_one(evidence, self.plain)
        #: Of a session in which nothing has happened.
        self.usual = self._covariance()

    def _covariance(self, *more: np.ndarray) -> Covariance:
        columns = (LIMITS.smooth * self.smooth.repeating, *more) if self.smooth is not None else ()
        return Covariance(*columns, as_one=self.as_one)

    def of(self, found: Likeliest) -> list[Covariance]:
        """Covariances where some effects have happened whose form is known but nearly, each as likely."""
        if self.smooth is None:
            return [self.usual]
        moved = self.evidence.off(self.evidence.predict(found.effects)) - self.off
        off = self.smooth.of_form(moved)
        return [self._covariance(share * off) if share else self.usual for share in FORMS]

    def nothing(self) -> Hypothesis:
        """Nothing has happened."""
        likelihood, by_row = _likelihood(self.usual, self.plain)
        return Hypothesis((NOTHING,), likelihood, likelihood, by_row)

    def something_else(self, beside: Sequence[Hypothesis] = (), number: int = 1) -> Hypothesis:
        """Something has that is none of the effects: alone, or, as likely, beside one of ``number`` effects.

        ``beside``: those of them that are the best; the others add nothing.  Raises ValueError without smooth errors.
        """
        if self.smooth is None:
            raise ValueError("without smooth errors there is nothing that something else could be")
        by_what: dict[str, list[float]] = {}
        alone = []
        for what, columns in self.smooth.new.items():
            for size in LARGER:
                covariance = self._covariance(size * columns)
                alone.append(_likelihood(covariance, self.plain))
                evidence = alone[-1][0]
                if beside:
                    with_one = [one.fitted.log_evidence(covariance) for one in beside]
                    evidence = _mean([evidence, float(np.logaddexp.reduce(with_one)) - math.log(number)])
                by_what.setdefault(what, []).append(evidence)
        evidence = _mean([one for each in by_what.values() for one in each])
        goes_with = {what: float(np.exp(_mean(each) - evidence)) / len(by_what) for what, each in by_what.items()}
        best = max(alone, key=lambda one: one[0])
        return Hypothesis((SOMETHING_ELSE,), evidence, *best, goes_with=goes_with)

    def effects(
        self, candidates: Sequence[Candidate], known: Mapping[str, Mapping[str, float]] | None = None
    ) -> Hypothesis:
        """These effects have, together; ``known``: parameters of some of them, to start from."""
        found = likeliest(self.evidence, candidates, self.usual, known)
        covariances = self.of(found)
        evidence = [found.log_evidence(covariance) for covariance in covariances]
        best = covariances[int(np.argmax(evidence))]
        likelihood, by_row = _likelihood(best, found.rows)
        names = tuple(c.name for c in candidates)
        return Hypothesis(names, _mean(evidence), likelihood, by_row, found, best, objection(found))

    def sketch(self, first: Hypothesis, others: Sequence[Hypothesis]) -> list[float]:
        """About the logarithms of the evidence of one effect with each of some others: by one linear step from it.

        Minus infinity where that asks for what is not possible.
        """
        covariances = self.of(first.fitted)
        return [_mean([_beside(first.fitted, other.fitted, one) for one in covariances]) for other in others]


def _mean(logarithms: Sequence[float]) -> float:
    """Logarithm of the mean of what is as likely."""
    return float(np.logaddexp.reduce(logarithms)) - math.log(len(logarithms))


def _likelihood(covariance: Covariance, rows: np.ndarray) -> tuple[float, np.ndarray]:
    """Its logarithm, and each row's part of the squares."""
    by_row = rows * covariance.whiten(covariance.whiten(rows))
    return covariance.log_likelihood(float(np.sum(by_row))), by_row


def _beside(first: Likeliest, other: Likeliest, covariance: Covariance) -> float:
    p, q = first.problem, other.problem
    rows, slopes = covariance.whiten(first.rows), covariance.whiten(np.column_stack((first.slopes, other.slopes)))
    spread = np.concatenate((p.spread, q.spread))
    off = np.concatenate(((first.u - p.usual) / p.spread, np.zeros(len(q.spread))))
    information = (slopes.T @ slopes) * np.outer(spread, spread) + np.eye(len(off))
    step = -np.linalg.solve(information, spread * (slopes.T @ rows) + off)
    there = q.usual + step[len(p.spread) :] * q.spread
    if np.any((there < q.low) | (there > q.high)):
        return -np.inf
    squares = float(np.sum((rows + slopes @ (step * spread)) ** 2))
    known = 0.5 * float(np.sum((off + step) ** 2))
    return covariance.log_likelihood(squares) - known - 0.5 * float(np.linalg.slogdet(information)[1])


def singles(
    rows: Rows,
    candidates: Sequence[Candidate],
    jobs: int,
    progress: Progress,
    beside: Sequence[Candidate] = (),
    known: Mapping[str, Mapping[str, float]] | None = None,
) -> list[Hypothesis]:
    """Each of some effects alone, or ``beside`` others whose parameters are ``known``."""
    return list(_tried(rows, [((*beside, c), known) for c in candidates], jobs, progress, "effects"))


def _tried(rows: Rows, calls: Sequence[tuple], jobs: int, progress: Progress, what: str) -> Iterator[Hypothesis]:
    """:meth:`Rows.effects` with each of some arguments."""
    with spread(jobs) as run:
        for number, one in enumerate(run([(rows.effects, call) for call in calls]), 1):
            progress(what, number / len(calls))
            yield one


def pairs(rows: Rows, alone: Sequence[Hypothesis], jobs: int, progress: Progress) -> list[tuple[float, Hypothesis]]:
    """Two effects at once, with what each had before the logs: the best few single ones with every other.

    Before the logs any two were as likely.  Each of these few is sketched, and those that come near to the best are
    fitted; none is the best by a sketch alone.  One that happens once is fitted beside the best single one whatever its
    sketch: when it was, it was looked for alone.
    """
    ranked = sorted(alone, key=lambda one: -one.log_evidence)
    sketched: list[tuple[float, Hypothesis, Hypothesis]] = []
    for position, first in enumerate(ranked[:LEADERS]):
        others = ranked[position + 1 :]
        sketched += zip(rows.sketch(first, others), [first] * len(others), others, strict=True)
    sketched.sort(key=lambda one: -one[0])
    if not sketched:
        return []
    best = max(ranked[0].log_evidence, sketched[0][0])
    near, rest = [], []
    for number, (evidence, first, other) in enumerate(sketched):
        once = first is ranked[0] and any(c.scanned for c in other.fitted.candidates)
        if once or (number < IN_EARNEST and evidence > best - WITHIN):
            near.append((first, other))
        elif evidence > -np.inf:
            rest.append((evidence, first, other))
    out = list(_tried(rows, [_together(*two) for two in near], jobs, progress, "pairs"))
    kept = [one for one in (*alone, *out) if not one.objection]
    for evidence, a, b in rest:
        names, objected = (*a.names, *b.names), a.objection or b.objection
        if objected or any(one.log_evidence >= evidence for one in kept):
            out.append(Hypothesis(names, evidence, evidence, np.zeros(0), objection=objected))
            continue
        out.append(rows.effects(*_together(a, b)))
        kept += [] if out[-1].objection else [out[-1]]
    return [(LIMITS.rare / math.comb(len(alone), 2), one) for one in out]


def _together(first: Hypothesis, other: Hypothesis) -> tuple:
    """What :meth:`Rows.effects` asks: two effects, of which one is known from when it was alone."""
    return (*first.fitted.candidates, *other.fitted.candidates), first.fitted.values


def objection(found: Likeliest) -> str:
    """Why effects with these parameters are none, or others; empty if they are what they are called."""
    out, p = [], found.problem
    for (c, f), x, low, high in zip(p.slots, found.u, p.low, p.high, strict=True):
        near = (NEAR_SIZE if f.is_size else NEAR_SHAPE) * (high - low)
        ends = (("high", "low") if f.low < 0.0 else ("high",)) if f.is_size else f.other_at
        if ("high" in ends and high - x < near) or ("low" in ends and x - low < near):
            unit = declaration_of(next(d for d in dataclasses.fields(EFFECTS[c.name]) if d.name == f.name)).unit  # type: ignore[arg-type]
            unit = "" if unit == "1" else f" {unit}"
            value = found.values[c.name][f.name]
            out.append(
                f"{c.name}'s {f.name} comes to {value:.3g}{unit}, the end of what is possible: there it is another "
                "effect"
            )
    return "; ".join(out)
