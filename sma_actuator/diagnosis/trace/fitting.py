"""Some effects fitted to evidence with the calibration frozen, and how the fit does on cycles it has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.estimation.effects import Effect

from .candidates import Candidate
from .covariance import Covariance
from .errors import Errors, errors_by
from .evidence import Evidence
from .likeliest import likeliest
from .limits import LIMITS
from .problem import WIDEST, Likeliest

FOLDS = 4  #: parts of the cycles, each predicted by a fit to the others
#: Of the step to such a fit: what of it is tried, for it may be too curved for a whole one; how far it goes at the
#: most, in the optimiser's units; and how much dearer the other cycles may then be.
SHARES, FURTHEST, DEARER = (1.0, 0.3), 2.0, 1.02
SURE = 1.96  #: standard deviations to either side, 95 % of a normal distribution


@dataclass(frozen=True, slots=True)
class Fit:
    """Effects with fitted parameters."""

    candidates: tuple[Candidate, ...]
    values: dict[str, dict[str, float]]  #: by effect and parameter
    intervals: dict[str, dict[str, tuple[float, float]]]  #: 95 %, cycles taken as independent, samples not
    held_out: Errors  #: by fits that have not seen the unit

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(c.name for c in self.candidates)

    @property
    def effects(self) -> dict[str, Effect]:
        """The effects, for a chain."""
        return {c.name: c.build(self.values[c.name]) for c in self.candidates}


def fit(
    evidence: Evidence,
    candidates: Sequence[Candidate],
    covariance: Covariance,
    known: Mapping[str, Mapping[str, float]] | None = None,
    seen: np.ndarray | None = None,
) -> Fit:
    """Fit ``candidates`` together.

    ``covariance``: of all rows; ``known``: parameters of some of them, to start from; ``seen``: units that the fit sees
    (bool, shape (units,)), by default all.  Units that were seen are predicted by fits to the other folds of these, the
    others by the fit itself.
    """
    if seen is None or seen.all():
        return fit_of(evidence, likeliest(evidence, candidates, covariance, known), covariance)
    rows = seen[evidence.unit_of_row]
    found = likeliest(evidence, candidates, covariance.of(rows), known, rows)
    return fit_of(evidence, found, covariance, seen)


def fit_of(evidence: Evidence, found: Likeliest, covariance: Covariance, seen: np.ndarray | None = None) -> Fit:
    """The same of what is likeliest already."""
    seen = np.ones(evidence.units, dtype=bool) if seen is None else seen
    return Fit(
        candidates=found.candidates,
        values=found.values,
        intervals=_intervals(evidence, found, covariance, seen[evidence.unit_of_row]),
        held_out=_held_out(evidence, found, covariance, seen),
    )


def _held_out(evidence: Evidence, found: Likeliest, covariance: Covariance, seen: np.ndarray) -> Errors:
    """Errors by fits that have not seen each unit: one Gauss-Newton step from the joint fit is as good as a new one."""
    problem, joint = found.problem, evidence.compare(found.effects)
    held_out_rows, percent, unexpected_percent = found.rows.copy(), joint.errors_percent, joint.unexpected_percent
    numbered = np.flatnonzero(seen)
    for k in range(FOLDS):
        left_out = numbered[k::FOLDS]
        others = seen.copy()
        others[left_out] = False
        rows = others[evidence.unit_of_row]
        of_others = covariance.of(rows)
        step = problem.step(of_others, found.rows[rows], found.slopes[rows], found.u)
        before = problem.cost(of_others, found.rows[rows], found.u)
        for share in SHARES:
            moved = problem.clipped(found.u + share * np.clip(step, -FURTHEST, FURTHEST))
            there = evidence.compare(problem.effects(moved))
            if problem.cost(of_others, there.rows[rows], moved) <= DEARER * before:
                break
        hidden = np.isin(evidence.unit_of_row, left_out)
        held_out_rows[hidden] = there.rows[hidden]
        percent[left_out] = there.errors_percent[left_out]
        unexpected_percent[left_out] = there.unexpected_percent[left_out]
    return errors_by(joint, held_out_rows, percent, unexpected_percent)


def _intervals(evidence: Evidence, found: Likeliest, covariance: Covariance, rows: np.ndarray) -> dict:
    """95 % intervals: of the sandwich with cycles as its clusters and of the covariance the wider; and a size is known
    no better than the form that has it."""
    problem, of_rows = found.problem, covariance.of(rows)
    a, off = of_rows.whiten(found.slopes[rows]), of_rows.whiten(found.rows[rows])
    n_parameters = len(found.u)
    inverse = np.linalg.inv(a.T @ a + np.diag(1.0 / problem.spread**2))
    scores = np.zeros((evidence.units, n_parameters))
    np.add.at(scores, evidence.unit_of_row[rows], a * off[:, None])
    n = len(np.unique(evidence.unit_of_row[rows]))
    by_cycles = inverse @ (scores.T @ scores) @ inverse * n / max(n - n_parameters, 1)
    of_form = np.where(problem.is_size, np.mean(np.square((*LIMITS.forms, LIMITS.nearly[0]))) * found.u**2, 0.0)
    spread = SURE * np.sqrt(np.maximum(np.diag(by_cycles), np.diag(inverse)) + of_form)
    out: dict[str, dict[str, tuple[float, float]]] = {c.name: {} for c in problem.candidates}
    for i, (c, f) in enumerate(problem.slots):
        wide = min(spread[i], WIDEST)
        out[c.name][f.name] = (f.from_unit(found.u[i] - wide), f.from_unit(found.u[i] + wide))
    for c in problem.candidates:
        if c.scanned:
            value = problem.scanned[c.name][c.scanned]
            out[c.name][c.scanned] = (value, value)
    return out
