"""What may have happened, with the evidence that logs give for it.

An effect moves the rows of the evidence by its sizes and shapes, of which something is known before the logs, and has
its form, or very nearly; *something else* moves them by smooth errors that are larger than a model's usual ones and go
with more, or looks like an effect and has another form (Kennedy and O'Hagan 2001).  The evidence of each is Laplace's
at its likeliest parameters (Kass and Raftery 1995).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from sma_actuator.fleet import spread

from .bent import moved_by_bends
from .candidates import Candidate
from .covariance import Covariance
from .evidence import Comparison, Evidence
from .likeliest import likeliest
from .limits import LIMITS
from .problem import Likeliest
from .quantities import quantities
from .shared import as_one
from .smooth_errors import SmoothErrors
from .witnesses import Residual

NOTHING, SOMETHING_ELSE = "nothing", "something else"
GOES_WITH_NOTHING = "nothing that was looked at"
KINDS = 3.0  #: of what is ``rare``, each as likely: like no effect, looking like one, or two things at once
BESIDE = 0.5  #: of two things at once, share of those of which one has no name
UNNAMED = 2.0 + BESIDE  #: of these, how many have no name: the third only beside one
BEST_FEW = 4  #: single effects that something else is held beside, and may look like

#: What tracing is doing, and how far it is, from 0 to 1.
Progress = Callable[[str, float], None]
#: Effects that are tried together, and what is known of their parameters, to start from.
Asked = tuple[Sequence[Candidate], Mapping[str, Mapping[str, float]] | None]


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
    def happens_once(self) -> bool:
        """Whether one of its effects does: when that was, it was looked for as nothing else was there."""
        return any(c.scanned for c in self.fitted.candidates)

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
        self.smooth = None if evidence.beyond_floor else SmoothErrors(as_it_is, quantities(as_it_is))
        #: As how much of one each reading counts.  Without smooth errors nobody says what is off together; what is
        #: found so is held against other logs later.
        self.share = 1.0
        if self.smooth is not None:
            independent = float(evidence.independent.sum())
            self.share = evidence.readings / independent / as_one(evidence, self.smooth, self.plain)
        #: Of a session in which nothing has happened.
        self.usual = self._covariance()

    def lets_be_left(self, with_effects: Comparison) -> float:
        """Squares of the residual that may be left, over those of the calibration, with the probability that a name
        needs: with the smooth errors that a model makes on any session, and with the form of the effects as far off as
        one may be; without such, all.

        Such squares scatter as those of a few errors, as many as these have in common (Satterthwaite 1946).
        """
        if self.smooth is None:
            return math.inf
        from scipy.stats import chi2

        samples = slice(self.evidence.rows_of_samples)
        moved = LIMITS.form * (with_effects.off - self.off)[samples, None]
        together = np.column_stack((LIMITS.smooth * self.smooth.repeating[samples], moved))
        squares = np.linalg.eigvalsh(together.T @ together)
        errors = squares.sum() ** 2 / np.sum(squares**2)
        most = squares.sum() * float(chi2.ppf(LIMITS.enough, errors)) / errors
        return 1.0 + most / float(np.sum(self.smooth.weight[samples] ** 2))

    def _covariance(self, *more: np.ndarray, alone: tuple[np.ndarray, np.ndarray] | None = None) -> Covariance:
        columns = (LIMITS.smooth * self.smooth.repeating, *more) if self.smooth is not None else ()
        return Covariance(*columns, share=self.share, alone=alone)

    def _unnamed(self) -> Iterator[tuple[str, list[Covariance]]]:
        """What something else may go with, and the covariances that it may have."""
        if self.smooth is None:
            raise ValueError("without smooth errors there is nothing that something else could be")
        counts = self.smooth.weight**2
        louder = {
            name: [self._covariance(alone=(np.where(rows, times, 1.0), counts)) for times in LIMITS.larger]
            for name, rows in self.evidence.rows_by_witness().items()
        }
        for what, columns in self.smooth.new.items():
            yield what, [self._covariance(size * columns) for size in LIMITS.larger] + louder.get(what, [])
        yield GOES_WITH_NOTHING, louder[Residual.names[0]]

    def of(self, found: Likeliest, shares: Sequence[float]) -> tuple[float, Covariance]:
        """Logarithm of the evidence of some effects whose form is off by one of these shares of what they move, each as
        likely, over any one thing that errors may go with; and the likeliest covariance."""
        if self.smooth is None:
            return found.log_evidence(self.usual), self.usual
        return self._off_by(found, shares, self._in_the_rows(found))

    def _like(self, one: Hypothesis, best: Hypothesis) -> float:
        """The same of what looks like an effect and is not it: its form is off in the rows, as that of an effect may
        be, or at its stage of the chain, over any one thing, each as likely.

        Where the logs tell it from the ``best`` effect it is off in the rows alone: bent at its stage it may be that
        one, which has a name.
        """
        off = self._in_the_rows(one.fitted)
        if best.log_evidence - one.log_evidence <= LIMITS.told:
            off += moved_by_bends(self.evidence, one.fitted.effects).values()
        return self._off_by(one.fitted, LIMITS.nearly, off)[0]

    def _in_the_rows(self, found: Likeliest) -> list[np.ndarray]:
        """What is off together where the form of some effects is, over each thing that errors may go with; nothing
        without smooth errors."""
        if (smooth := self.smooth) is None:
            return []
        moved = self.evidence.compare(found.effects).off - self.off
        return [smooth.of_form(moved, what) for what in smooth.of_forms]

    def _off_by(
        self, found: Likeliest, shares: Sequence[float], over: Sequence[np.ndarray]
    ) -> tuple[float, Covariance]:
        """:meth:`of` with what is off together over each thing, (rows, …) each."""
        # What is usual is taken off once, and not by each of some two dozen covariances anew.
        beside, rest = [self.usual.whiten(off) for off in over], found.whitened(self.usual)
        forms = [[(share, k) for k in range(len(over))] if share else [(0.0, 0)] for share in shares]
        usual = self.usual.log_likelihood(0.0)
        evidence = [[usual + rest.log_evidence(Covariance(share * beside[k])) for share, k in some] for some in forms]
        share, k = list(chain(*forms))[int(np.argmax(np.concatenate(evidence)))]
        return _mean([_mean(some) for some in evidence]), self._covariance(share * over[k]) if share else self.usual

    def nothing(self) -> Hypothesis:
        """Nothing has happened."""
        likelihood, by_row = self.usual.likelihood(self.plain)
        return Hypothesis((NOTHING,), likelihood, likelihood, by_row)

    def something_else(self, effects: Sequence[Hypothesis] = ()) -> Hypothesis:
        """Something has that is none of the ``effects``: alone, looking like one of them, or beside one.

        Of these the best few count, the others add nothing; and those that are others at the ends of their parameters.
        Raises ValueError without smooth errors.
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
        like = {" and ".join(one.names): self._like(one, best_few[0]) - math.log(UNNAMED * number) for one in best_few}
        # At the end where it is another effect it is one that was tried too and does better, or one without a name.
        for one in effects:
            if one.objection and not one.worse:
                like[" and ".join(one.names)] = one.log_evidence - math.log(UNNAMED * number)
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
        return Hypothesis(names, evidence, likelihood, by_row, found, best, found.objection, self.worse(found.rows))

    def worse(self, rows: np.ndarray) -> bool:
        """Whether these rows are further off than without an effect: all in all, for errors that are usual as one are
        cheap together, so a fit may raise them all to get rid of what is not; or the displacement alone, and more than
        is usual, for nobody wants to hear of what makes its error larger."""
        n = self.evidence.rows_of_samples
        usual = float(self.evidence.independent.sum())
        off, before = (float(np.sum(some[:n] ** 2)) for some in (rows, self.plain))
        return bool(np.sum(rows**2) > np.sum(self.plain**2)) or off > max(before, usual)


def fitted(
    rows: Rows,
    asked: Sequence[Asked],
    jobs: int,
    progress: Progress,
    what: str,
) -> list[Hypothesis]:
    """:meth:`Rows.effects` of all that are asked about."""
    found = []
    with spread(jobs) as run:
        for number, one in enumerate(run([(rows.effects, each) for each in asked]), 1):
            progress(what, number / len(asked))
            found.append(one)
    return found


def _mean(logarithms: Sequence[float]) -> float:
    """Logarithm of the mean of what is as likely."""
    return float(np.logaddexp.reduce(logarithms)) - math.log(len(logarithms))
