"""What may have happened, with the evidence that logs give for it.

An effect moves the rows of the evidence by its sizes and shapes, of which something is known before the logs, and has
its form, or very nearly; *something else* moves them by smooth errors that are larger than a model's usual ones and go
with more, or looks like an effect and has another form (Kennedy and O'Hagan 2001).  The evidence of each is Laplace's
at its likeliest parameters (Kass and Raftery 1995).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, combinations, product

import numpy as np

from sma_actuator.base.parameters import declaration_of
from sma_actuator.estimation.effects import EFFECTS

from .candidates import Candidate
from .covariance import Covariance
from .evidence import Evidence
from .likeliest import PROBE, Likeliest, beside, changed, likeliest
from .limits import LIMITS
from .smooth_errors import SmoothErrors

NOTHING, SOMETHING_ELSE = "nothing", "something else"
GOES_WITH_NOTHING = "nothing that was looked at"
BESIDE = 0.5  #: of two things at once, share of those of which one has no name
UNNAMED = 2.0 + BESIDE  #: how probable something else is, in ``rare``: like no effect, looking like one, or beside one
PROMISING = 20  #: pairs that are sketched, of all
BEST_FEW = 4  #: single effects that something else is held beside, and may look like
NEAR_SIZE, NEAR_SHAPE = 0.01, 0.05  #: of what is possible, so near its end counts as at it: a shape comes there slowly


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """What may have happened, and what the logs say of it."""

    names: tuple[str, ...]
    log_evidence: float  #: up to what is common to all
    log_likelihood: float  #: the part of it that the rows have, at the likeliest parameters
    by_row: np.ndarray  #: each row's part of the squares under its covariance
    found: Likeliest | None = None  #: None of nothing and of something else
    covariance: Covariance | None = None  #: the likeliest of those that its effects may have
    objection: str = ""  #: why it is another: a parameter at the end of the possible
    worse: bool = False  #: whether the model is worse with it on these logs than without
    #: Of something else: what it goes with or drifts in, and how probably …
    goes_with: Mapping[str, float] = field(default_factory=dict)
    #: … and which effect it looks like.
    looks_like: Mapping[str, float] = field(default_factory=dict)

    @property
    def why_none(self) -> str:
        """Why it has no probability, whatever its evidence; empty if it may have happened."""
        return self.objection or ("the model is worse with it on these logs than without" if self.worse else "")

    @property
    def fitted(self) -> Likeliest:
        """Its effects; raises ValueError where it has none that were fitted."""
        if self.found is None:
            raise ValueError(f"{' and '.join(self.names)}: not fitted")
        return self.found


class Rows:
    """What all hypotheses about some logs are held against."""

    def __init__(self, evidence: Evidence, forms: Sequence[float] = LIMITS.forms):
        """``forms``: how far off the form of an effect may be, each as likely."""
        self.evidence = evidence
        self._forms = forms
        as_it_is = evidence.compare({})
        #: Rows of the model as it is, and the same without Huber's limit.
        self.plain, self.off = as_it_is.rows, as_it_is.off
        #: What is off together; None where a model's own errors are what is looked for.
        self.smooth = None if evidence.beyond_floor else SmoothErrors(as_it_is)
        #: As how much of one each reading counts.  Without smooth errors nobody says what is off together; what is
        #: found so is held against other logs later.
        self.share = 1.0
        if self.smooth is not None:
            as_one = self.smooth.as_one(evidence, self.plain)
            self.share = evidence.readings / float(evidence.independent.sum()) / as_one
        #: Of a session in which nothing has happened.
        self.usual = self._covariance()

    def _covariance(self, *more: np.ndarray, alone: tuple[np.ndarray, np.ndarray] | None = None) -> Covariance:
        columns = (LIMITS.smooth * self.smooth.repeating, *more) if self.smooth is not None else ()
        return Covariance(*columns, share=self.share, alone=alone)

    def _unnamed(self) -> Iterator[tuple[str, list[Covariance]]]:
        """What something else may go with, and the covariances that it may have."""
        if self.smooth is None:
            raise ValueError("without smooth errors there is nothing that something else could be")
        for what, columns in self.smooth.new.items():
            yield what, [self._covariance(size * columns) for size in LIMITS.larger]
        counts = self.smooth.weight**2
        of_sample = np.arange(len(counts)) < self.evidence.rows_of_samples
        louder = [(np.where(of_sample, times, 1.0), counts) for times in LIMITS.louder]
        yield GOES_WITH_NOTHING, [self._covariance(alone=alone) for alone in louder]

    def of(self, found: Likeliest, shares: Sequence[float]) -> tuple[float, Covariance]:
        """Logarithm of the evidence of some effects whose form is off by one of these shares of what they move, each as
        likely, over any one thing that errors may go with; and the likeliest covariance."""
        if self.smooth is None:
            return found.log_evidence(self.usual), self.usual
        moved = self.evidence.compare(found.effects).off - self.off
        over = [self.smooth.of_form(moved, what) for what in self.smooth.of_forms]
        each = [[self._covariance(share * off) for off in over] if share else [self.usual] for share in shares]
        evidence = [[found.log_evidence(covariance) for covariance in some] for some in each]
        best = int(np.argmax(np.concatenate(evidence)))
        return _mean([_mean(some) for some in evidence]), list(chain(*each))[best]

    def nothing(self) -> Hypothesis:
        """Nothing has happened."""
        likelihood, by_row = self.usual.likelihood(self.plain)
        return Hypothesis((NOTHING,), likelihood, likelihood, by_row)

    def something_else(self, effects: Sequence[Hypothesis] = ()) -> Hypothesis:
        """Something has that is none of the ``effects``: alone, looking like one of them, or beside one.

        Of these the best few count; the others add nothing.  Raises ValueError without smooth errors.
        """
        parts: dict[str, float] = {}
        alone, number = [], len(effects)
        possible = [one for one in effects if not one.why_none]
        best_few = sorted(possible, key=lambda one: -one.log_evidence)[:BEST_FEW]
        for what, covariances in self._unnamed():
            each = [covariance.likelihood(self.plain) for covariance in covariances]
            alone += each
            parts[what] = _mean([one[0] for one in each])
            # What an effect leaves is always a little louder: its form is not quite its own.
            if best_few and what != GOES_WITH_NOTHING:
                with_one = [[one.fitted.log_evidence(covariance) for one in best_few] for covariance in covariances]
                beside = _mean([float(np.logaddexp.reduce(some)) for some in with_one]) - math.log(number)
                parts[what] = float(np.logaddexp(parts[what], math.log(BESIDE) + beside))
        parts = {what: part - math.log(UNNAMED * len(parts)) for what, part in parts.items()}
        like = {
            " and ".join(one.names): self.of(one.fitted, LIMITS.nearly)[0] - math.log(UNNAMED * number)
            for one in best_few
        }
        evidence = float(np.logaddexp.reduce([*parts.values(), *like.values()]))
        goes_with, looks_like = (
            {k: math.exp(v - evidence) for k, v in sorted(some.items(), key=lambda item: -item[1])}
            for some in (parts, like)
        )
        best = max(alone, key=lambda one: one[0])
        return Hypothesis((SOMETHING_ELSE,), evidence, *best, goes_with=goes_with, looks_like=looks_like)

    def effects(
        self, candidates: Sequence[Candidate], known: Mapping[str, Mapping[str, float]] | None = None
    ) -> Hypothesis:
        """These effects have, together; ``known``: parameters of some of them, to start from."""
        found = likeliest(self.evidence, candidates, self.usual, known)
        evidence, best = self.of(found, self._forms)
        likelihood, by_row = best.likelihood(found.rows)
        names = tuple(c.name for c in candidates)
        return Hypothesis(names, evidence, likelihood, by_row, found, best, objection(found), self.worse(found.rows))

    def worse(self, rows: np.ndarray) -> bool:
        """Whether these rows are further off than without an effect: all in all, for errors that are usual as one are
        cheap together, so a fit may raise them all to get rid of what is not; or the displacement alone, and more than
        is usual, for nobody wants to hear of what makes its error larger."""
        n = self.evidence.rows_of_samples
        usual = float(self.evidence.independent.sum())
        off, before = (float(np.sum(some[:n] ** 2)) for some in (rows, self.plain))
        return bool(np.sum(rows**2) > np.sum(self.plain**2)) or off > max(before, usual)

    def where_it_was(self, one: Hypothesis) -> float:
        """Logarithm of the evidence of what may have happened, were each reading held against the floor of where the
        wire was by that; a narrower one makes the same readings likelier, if they keep to it.

        Of hypotheses whose forms are their own.
        """
        effects = one.found.effects if one.found else {}
        there = self.evidence.held_where(effects)
        likelihood, _ = self.usual.likelihood(there.compare(effects).rows)
        floor, here = (np.concatenate(evidence.of_displacement.floor_m) for evidence in (there, self.evidence))
        counts = self.evidence.sample_weight**2
        return one.log_evidence - one.log_likelihood + likelihood - 0.5 * self.usual.of_sizes(floor / here, counts)

    def promising(self, alone: Sequence[Hypothesis]) -> list[tuple[int, int]]:
        """Of all pairs of effects, by their numbers, those that promise most: by one linear step of their sizes, with
        any shape of each, from where nothing has happened."""
        moved = [[self.usual.whiten(columns) for columns in self._moved(one.fitted)] for one in alone]
        off = self.usual.whiten(self.off)

        def gain(columns: tuple[np.ndarray, np.ndarray]) -> float:
            a = np.column_stack(columns)
            information, uphill = a.T @ a + np.eye(a.shape[1]), a.T @ off
            return 0.5 * float(uphill @ np.linalg.solve(information, uphill) - np.linalg.slogdet(information)[1])

        two = list(combinations(range(len(alone)), 2))
        gains = [max(map(gain, product(moved[i], moved[k]))) for i, k in two]
        return [two[n] for n in np.argsort(gains)[::-1][:PROMISING]]

    def _moved(self, alone: Likeliest) -> list[np.ndarray]:
        """By how much an effect moves the rows, of each shape that it may have: of its sizes as they may be before the
        logs, (rows, sizes), or of the shape where it has no size."""
        p, evidence = alone.problem, self.evidence
        sizes, out = np.flatnonzero(p.is_size), []
        for u in p.shapes(p.usual, ~p.is_size):
            more = [changed(u, i, PROBE if p.high[i] >= PROBE else -PROBE) for i in sizes] or [u]
            step = [at[i] / LIMITS.size for i, at in zip(sizes, more, strict=False)] or [1.0]
            off = [evidence.compare(p.effects(at)).off - self.off for at in more]
            out.append(np.column_stack(off) / step)
        return out

    def sketches(self, first: Likeliest, others: Sequence[Likeliest]) -> list[float]:
        """About the logarithms of the evidence of some effects with each of others, which are known alone."""
        return [beside(first, other, self.usual) for other in others]


def _mean(logarithms: Sequence[float]) -> float:
    """Logarithm of the mean of what is as likely."""
    return float(np.logaddexp.reduce(logarithms)) - math.log(len(logarithms))


def objection(found: Likeliest) -> str:
    """Why effects with these parameters are none, or others; empty if they are what they are called."""
    out, p = [], found.problem
    for (c, f), x, low, high in zip(p.slots, found.u, p.low, p.high, strict=True):
        near = (NEAR_SIZE if f.is_size else NEAR_SHAPE) * (high - low)
        ends = f.other_at + ((("high", "low") if f.low < 0.0 else ("high",)) if f.is_size else ())
        if ("high" in ends and high - x < near) or ("low" in ends and x - low < near):
            unit = declaration_of(next(d for d in dataclasses.fields(EFFECTS[c.name]) if d.name == f.name)).unit  # type: ignore[arg-type]
            unit = "" if unit == "1" else f" {unit}"
            value = found.values[c.name][f.name]
            out.append(
                f"{c.name}'s {f.name} comes to {value:.3g}{unit}, the end of what is possible: there it is another "
                "effect"
            )
    return "; ".join(out)
