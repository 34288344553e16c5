"""Two effects at once: which of all pairs promise most, and the evidence of those."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import combinations, product

import numpy as np

from sma_actuator.fleet import spread

from .covariance import Covariance
from .limits import LIMITS
from .problem import PROBE, Likeliest, Problem, changed
from .rows import BESIDE, Hypothesis, Progress, Rows, fitted

PROMISING = 20  #: pairs that are sketched, of all
IN_EARNEST = 5  #: pairs that are fitted, at the most


def pairs(rows: Rows, alone: Sequence[Hypothesis], jobs: int, progress: Progress) -> list[tuple[float, Hypothesis]]:
    """Two effects at once, with what each had before the logs, of which any two were as likely.

    What each effect moves alone says of all of them at once which promise most; these are sketched from where the
    better of the two was fitted, and so is each other one beside the best: one step from nothing says little of what is
    large.  Of those that do better than any one effect that may have happened the best few are fitted.  One that
    happens once is fitted beside that one whatever its sketch: when it was, it was looked for alone; and from there
    too, since without it the other one had to take its part.
    """
    # What is none alone may be there beside another, which it had to take the part of; it is no measure for them.
    ranked = sorted(alone, key=lambda one: (bool(one.why_none), -one.log_evidence))
    to_beat = max([rows.nothing().log_evidence, *(one.log_evidence for one in ranked if not one.why_none)])
    beside: dict[int, list[Hypothesis]] = {0: list(ranked[1:])}
    for first, other in promising(rows, ranked):
        if first:
            beside.setdefault(first, []).append(ranked[other])
    sketched: list[tuple[float, Hypothesis, Hypothesis]] = []
    with spread(jobs) as run:
        calls = [
            (sketches, (rows, ranked[k].fitted, [other.fitted for other in others])) for k, others in beside.items()
        ]
        for (k, others), found in zip(beside.items(), run(calls), strict=True):
            sketched += zip(found, [ranked[k]] * len(others), others, strict=True)
    sketched.sort(key=lambda one: -one[0])
    better = [(first, other) for evidence, first, other in sketched if evidence > to_beat][:IN_EARNEST]
    better += [(ranked[0], other) for other in ranked[1:] if other.happens_once and (ranked[0], other) not in better]
    better += [(other, first) for first, other in better if other.happens_once]
    out: dict[frozenset[str], Hypothesis] = {}
    for one in fitted(rows, [_together(*two) for two in better], jobs, progress, "pairs"):
        of_two = frozenset(one.names)
        out[of_two] = max(out.get(of_two, one), one, key=lambda two: -np.inf if two.why_none else two.log_evidence)
    return [((1.0 - BESIDE) * LIMITS.rare / math.comb(len(alone), 2), one) for one in out.values()]


def _together(first: Hypothesis, other: Hypothesis) -> tuple:
    """What :meth:`Rows.effects` asks: two effects, of which one is known from when it was alone."""
    return (*first.fitted.candidates, *other.fitted.candidates), first.fitted.values


def promising(rows: Rows, alone: Sequence[Hypothesis]) -> list[tuple[int, int]]:
    """Of all pairs of effects, by their numbers, those that promise most: by one linear step of their sizes, with
    any shape of each, from where nothing has happened."""
    moved = [[rows.usual.whiten(columns) for columns in _moved(rows, one.fitted)] for one in alone]
    off = rows.usual.whiten(rows.off)

    def gain(columns: tuple[np.ndarray, np.ndarray]) -> float:
        a = np.column_stack(columns)
        information, uphill = a.T @ a + np.eye(a.shape[1]), a.T @ off
        return 0.5 * float(uphill @ np.linalg.solve(information, uphill) - np.linalg.slogdet(information)[1])

    two = list(combinations(range(len(alone)), 2))
    gains = [max(map(gain, product(moved[i], moved[k]))) for i, k in two]
    return [two[n] for n in np.argsort(gains)[::-1][:PROMISING]]


def _moved(rows: Rows, alone: Likeliest) -> list[np.ndarray]:
    """By how much an effect moves the rows, of each shape that it may have: of its sizes as they may be before the
    logs, (rows, sizes), or of the shape where it has no size."""
    p, evidence = alone.problem, rows.evidence
    sizes, out = np.flatnonzero(p.is_size), []
    for u in p.shapes(p.usual, ~p.is_size):
        more = [changed(u, i, PROBE if p.high[i] >= PROBE else -PROBE) for i in sizes] or [u]
        step = [at[i] / LIMITS.size for i, at in zip(sizes, more, strict=False)] or [1.0]
        off = [evidence.compare(p.effects(at)).off - rows.off for at in more]
        out.append(np.column_stack(off) / step)
    return out


def sketches(rows: Rows, first: Likeliest, others: Sequence[Likeliest]) -> list[float]:
    """About the logarithms of the evidence of some effects with each of others, which are known alone."""
    return [beside(first, other, rows.usual) for other in others]


def beside(first: Likeliest, alone: Likeliest, covariance: Covariance) -> float:
    """About the logarithm of the evidence of some effects with one more, by one linear step from where they are
    likeliest.

    ``alone``: where the other is likeliest alone.  Each of its shapes is tried, and that: beside another effect it may
    have another shape than alone, where it had to take that one's part too.
    """
    (other,) = alone.candidates
    problem = Problem(first.problem.evidence, (*first.candidates, other))
    problem.scanned = {**first.problem.scanned, **alone.problem.scanned}
    known = len(first.u)
    new = np.arange(len(problem.slots)) >= known
    guesses = problem.shapes(np.concatenate((first.u, problem.usual[known:])), new)
    guesses.append(np.concatenate((first.u, np.where(problem.is_size[known:], 0.0, alone.u))))
    sizes = np.flatnonzero(problem.is_size[known:]) + known
    free = np.append(np.arange(known), sizes)
    found = []
    for guess in guesses:
        rows = first.rows if len(sizes) else problem.residual(guess)
        columns = [first.slopes]
        for i in sizes:
            probe = PROBE if problem.high[i] >= PROBE else -PROBE
            columns.append((problem.residual(changed(guess, i, probe)) - rows)[:, None] / probe)

        def possible(step: np.ndarray, at: np.ndarray = guess) -> np.ndarray:
            return np.clip(at[free] + step, problem.low[free], problem.high[free]) - at[free]

        off = ((guess - problem.usual) / problem.spread)[free]
        found.append(laplace(covariance, rows, np.column_stack(columns), off, problem.spread[free], possible))
    return max(found)


def laplace(
    covariance: Covariance,
    rows: np.ndarray,
    slopes: np.ndarray,
    off: np.ndarray,
    spread: np.ndarray,
    possible: Callable[[np.ndarray], np.ndarray],
) -> float:
    """Laplace's logarithm of the evidence, after one linear step of the parameters.

    ``off``: how far these are from what was likeliest before the logs, in its standard deviations ``spread``;
    ``possible``: of a step, what of it can be gone.
    """
    rows, slopes = covariance.whiten(rows), covariance.whiten(slopes) * spread
    information = slopes.T @ slopes + np.eye(len(off))
    step = possible(-np.linalg.solve(information, slopes.T @ rows + off) * spread) / spread
    squares = float(np.sum((rows + slopes @ step) ** 2))
    known = float(np.sum((off + step) ** 2))
    return covariance.log_likelihood(squares) - 0.5 * known - 0.5 * float(np.linalg.slogdet(information)[1])
