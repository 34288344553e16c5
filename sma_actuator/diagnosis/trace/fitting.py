"""Fits effects to evidence with the calibration frozen, and says how each fit does on cycles it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import least_squares, lsq_linear, minimize_scalar

from sma_actuator.estimation.effects import Effect

from .candidates import Candidate
from .evidence import Evidence

FOLDS = 4
STEP = 1e-3  #: of the finite differences, in the optimiser's units
MAX_EVALUATIONS = 12
#: Of a size, in units of what is typical: from so large an effect one linear step says how large it is.  What is far
#: off counts linearly, so that step falls short of a large effect: so many at once are tried too, where no shape is
#: sought as well, which takes a wrong one with a large size; and, of a single size, so many times what is typical: a
#: rest that counts only where the wire is as hot as it was may lie between nothing and a large effect like a wall.
PROBE = 0.5
STRIDES = (1.0, 2.0, 4.0)
SIZES = (-3.0, -1.0, 1.0, 3.0)
APART = 0.3  #: in the optimiser's units: shapes nearer to each other lead to the same end
STUCK = 0.01  #: share of the squares: where a fit takes off less, it begins somewhere else once more …
LOOKS = 12  #: along a line, where a single size is all that is sought
PROMISING = 0.75  #: … and also where that other start takes off so much of what the fit did, before any step
NEARLY, TRIED = 0.9, 8  #: of what the best time of a slip explains: with which others are tried too, and how many
NEAR_SIZE, NEAR_SHAPE = 0.01, 0.05  #: of what is possible, so near its end counts as at it: a shape comes there slowly


@dataclass(frozen=True, slots=True)
class Fit:
    """Effects with fitted parameters."""

    candidates: tuple[Candidate, ...]
    values: dict[str, dict[str, float]]  #: by effect and parameter
    intervals: dict[str, dict[str, tuple[float, float]]]  #: 95 %, cycles taken as independent, samples not
    losses: np.ndarray  #: of every unit, by the fit to all of them, shape (units,)
    held_out: np.ndarray  #: of every unit, by a fit that has not seen it, shape (units,)
    held_out_rows: np.ndarray  #: rows of the evidence by the same fits
    held_out_percent: np.ndarray  #: mean absolute error of every unit by the same fits, % of full stroke
    held_out_news_percent: np.ndarray  #: and what of it the calibration does not let expect
    at_bound: tuple[str, ...] = ()  #: parameters at the end of what is physically possible, or essential and nothing

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(c.name for c in self.candidates)

    @property
    def effects(self) -> dict[str, Effect]:
        """The effects, for a chain."""
        return {c.name: c.build(self.values[c.name]) for c in self.candidates}

    @property
    def parameters(self) -> int:
        """Number of parameters."""
        return sum(c.parameters for c in self.candidates)


class _Problem:
    """The parameters of some candidates as one vector."""

    def __init__(self, evidence: Evidence, candidates: Sequence[Candidate]):
        self.evidence = evidence
        self.candidates = tuple(candidates)
        self.slots = [(c, f) for c in candidates for f in c.free]
        self.low = np.array([f.to_unit(f.low) for _, f in self.slots])
        self.high = np.array([f.to_unit(f.high) for _, f in self.slots])
        self.scanned: dict[str, dict[str, float]] = {}

    def values(self, u: np.ndarray) -> dict[str, dict[str, float]]:
        out: dict[str, dict[str, float]] = {c.name: dict(self.scanned.get(c.name, {})) for c in self.candidates}
        for (c, f), x in zip(self.slots, u, strict=True):
            out[c.name][f.name] = f.from_unit(float(x))
        return out

    def effects(self, u: np.ndarray) -> dict[str, Effect]:
        values = self.values(u)
        return {c.name: c.build(values[c.name]) for c in self.candidates}

    def differ(self, u: np.ndarray, other: np.ndarray) -> bool:
        """Whether two starts lead, as far as can be known, to different ends: another shape, or another sign of a
        size."""
        sizes = np.array([f.is_size for _, f in self.slots])
        return bool(np.any(u[sizes] * other[sizes] < 0.0) or np.any(np.abs(u - other)[~sizes] > APART))

    def residual(self, u: np.ndarray) -> np.ndarray:
        return self.evidence.residual(self.effects(u))

    def jacobian(self, u: np.ndarray, at_u: np.ndarray) -> np.ndarray:
        columns = []
        for i in range(len(u)):
            step = STEP * max(1.0, abs(u[i])) if self.slots[i][1].is_size else 0.01
            if u[i] + step > self.high[i]:
                step = -step
            moved = u.copy()
            moved[i] += step
            columns.append((self.residual(moved) - at_u) / step)
        return np.column_stack(columns)

    def solve(self, u: np.ndarray, rows: np.ndarray | None = None):
        """Least squares from ``u``; only the ``rows`` (bool) where given."""
        pick = (lambda r: r) if rows is None else (lambda r: r[rows])
        inside = np.clip(u, self.low + 1e-9, self.high - 1e-9)
        return least_squares(
            lambda x: pick(self.residual(x)),
            inside,
            jac=lambda x: pick(self._both(x)),
            bounds=(self.low, self.high),
            x_scale=1.0,
            max_nfev=MAX_EVALUATIONS,
            ftol=1e-4,
            xtol=1e-4,
            gtol=1e-8,
        )

    def _both(self, u: np.ndarray) -> np.ndarray:
        return self.jacobian(u, self.residual(u))


def fit(
    evidence: Evidence, candidates: Sequence[Candidate], train: np.ndarray, known: Fit | None = None, folds: int = FOLDS
) -> Fit:
    """Fit ``candidates`` together on the units ``train`` (bool, shape (units,)); the others are held out of every fit.

    ``known``: a fit of some of them, to start from.  Units in ``train`` are predicted by fits to the
    other folds of ``train``; units outside it by the fit to all of ``train``.
    """
    problem, u, new, rows = _begun(evidence, candidates, train, known)
    u = _solved(problem, u, new, rows)
    for c in candidates:
        if c.scanned:  # the others are known now, so its time may be another
            before = problem.scanned[c.name]
            times = [{c.scanned: time_s} for time_s in _scan(problem, c, u, rows)]
            problem.scanned[c.name] = min([before, *times], key=partial(_squares, problem, u, rows, c.name))
            again = problem.solve(u, rows).x
            if np.sum(problem.residual(again)[rows] ** 2) < _squares(problem, u, rows, c.name, before):
                u = again
            else:
                problem.scanned[c.name] = before
    at_u = problem.residual(u)
    J = problem.jacobian(u, at_u)
    losses = evidence.losses(at_u)
    intervals = _intervals(problem, u, J, at_u, rows)
    nothing = [
        f"{c.name}.{name}"
        for c in candidates
        for name in c.effect.ESSENTIAL
        if intervals[c.name][name][0] <= 0.0 <= intervals[c.name][name][1]
    ]
    held_out_rows, held_out_percent, held_out_news_percent = _held_out(problem, u, J, at_u, train, folds)
    return Fit(
        candidates=problem.candidates,
        values=problem.values(u),
        intervals=intervals,
        losses=losses,
        held_out=evidence.losses(held_out_rows),
        held_out_rows=held_out_rows,
        held_out_percent=held_out_percent,
        held_out_news_percent=held_out_news_percent,
        at_bound=(*_at_bound(problem, u), *nothing),
    )


def sketch(
    evidence: Evidence, candidates: Sequence[Candidate], train: np.ndarray, known: Fit | None = None
) -> np.ndarray:
    """About how much ``candidates`` together would lose on each unit of ``train``: by one linear step of their
    sizes."""
    problem, u, new, rows = _begun(evidence, candidates, train, known)
    everything = [i for i, (_, f) in enumerate(problem.slots) if f.is_size or i in new]
    return evidence.losses(problem.residual(_starts(problem, u, everything, rows)[0]))[train]


def _begun(
    evidence: Evidence, candidates: Sequence[Candidate], train: np.ndarray, known: Fit | None
) -> tuple[_Problem, np.ndarray, list[int], np.ndarray]:
    """The problem, where ``known`` lets it begin, which of its parameters are new, and its rows in ``train``."""
    problem = _Problem(evidence, candidates)
    rows = train[evidence.unit_of_row]
    u = np.zeros(len(problem.slots))
    new = []
    for i, (c, f) in enumerate(problem.slots):
        if known is not None and c.name in known.values:
            u[i] = f.to_unit(known.values[c.name][f.name])
        else:
            u[i] = f.to_unit(f.starts[0]) if f.starts else 0.0
            new.append(i)
    for c in candidates:
        if c.scanned and known is not None and c.name in known.values:
            problem.scanned[c.name] = {c.scanned: known.values[c.name][c.scanned]}
        elif c.scanned:
            problem.scanned[c.name] = {c.scanned: _scan(problem, c, u, rows)[0]}
    return problem, u, new, rows


def _starts(problem: _Problem, u: np.ndarray, new: list[int], rows: np.ndarray) -> list[np.ndarray]:
    """Where it is worth to begin, best first: every start of the new shapes, each with several sizes; none of them
    nothing.

    Nothing is no place to begin at: there no shape makes a difference, at the end of a size that has but one sign no
    step leads away, and what a small effect does to a residual that is far off may point the wrong way.
    """
    shapes = [i for i in new if problem.slots[i][1].starts]
    sizes = [i for i in new if problem.slots[i][1].is_size]
    tries = [u.copy()]
    for i in shapes:  # one at a time from the first start of the others: their number stays small
        tries += [_with(u, i, problem.slots[i][1].to_unit(s)) for s in problem.slots[i][1].starts[1:]]
    low = np.minimum(0.5 * problem.low, u)
    high = np.maximum(0.5 * problem.high, u)
    found: list[tuple[float, np.ndarray]] = []

    def look(there: np.ndarray) -> np.ndarray:
        """The residual there, which is kept in mind as a start."""
        at = problem.residual(there)[rows]
        found.append((float(at @ at), there))
        return at

    for guess in tries:
        if not sizes:
            look(guess)
            continue
        at = problem.residual(guess)[rows]
        probes = [PROBE if guess[i] + PROBE <= high[i] else -PROBE for i in sizes]
        columns = [(look(_with(guess, i, guess[i] + p)) - at) / p for i, p in zip(sizes, probes, strict=True)]
        room = (low[sizes] - guess[sizes], high[sizes] - guess[sizes])
        change = lsq_linear(np.column_stack(columns), -at, room).x
        further = [times * change for times in ((1.0,) if shapes else STRIDES)]
        if len(sizes) == 1 and not shapes:
            further += [np.array([size]) for size in SIZES]
        for step in further:
            there = guess.copy()
            there[sizes] = np.clip(guess[sizes] + step, low[sizes], high[sizes])
            if np.any(np.abs(there - guess) > 1e-3):
                look(there)
    return [there for _, there in sorted(found, key=lambda pair: pair[0])]


def _solved(problem: _Problem, u: np.ndarray, new: list[int], rows: np.ndarray) -> np.ndarray:
    """Least squares from the best start, and from the best that is another where that promises as much; nothing, if
    that is better."""

    def squares(there: np.ndarray) -> float:
        return float(np.sum(problem.residual(there)[rows] ** 2))

    starts = _starts(problem, u, new, rows) if new else [u]
    ends = [u, problem.solve(starts[0], rows).x]
    nothing, best = map(squares, ends)
    other = next((start for start in starts[1:] if problem.differ(start, starts[0])), None)
    if other is not None:
        stuck = nothing - best < STUCK * nothing
        if stuck or nothing - squares(other) > PROMISING * (nothing - best):
            ends.append(problem.solve(other, rows).x)
    if len(u) == 1:
        ends.append(_along(problem, [u, *starts], min(starts, key=squares), squares))
    return min(ends, key=squares)


def _along(
    problem: _Problem, tried: list[np.ndarray], best: np.ndarray, squares: Callable[[np.ndarray], float]
) -> np.ndarray:
    """The least squares of a single size between the sizes tried on either side of the best of them.

    A rest that counts here and not a little further is a step, which no slope sees: the solver may stay where it began.
    """
    sizes = sorted({float(problem.low[0]), float(problem.high[0]), *(float(there[0]) for there in tried)})
    at = sizes.index(float(best[0]))
    bounds = (sizes[max(at - 1, 0)], sizes[min(at + 1, len(sizes) - 1)])
    found = minimize_scalar(
        lambda size: squares(np.array([size])), bounds=bounds, method="bounded", options={"maxiter": LOOKS}
    )
    return np.array([float(found.x)])


def _squares(problem: _Problem, u: np.ndarray, rows: np.ndarray, name: str, scanned: dict[str, float]) -> float:
    """Loss with another value of a scanned parameter."""
    now, problem.scanned[name] = problem.scanned[name], scanned
    try:
        return float(np.sum(problem.residual(u)[rows] ** 2))
    finally:
        problem.scanned[name] = now


def _with(u: np.ndarray, i: int, value: float) -> np.ndarray:
    out = u.copy()
    out[i] = value
    return out


def _scan(problem: _Problem, candidate: Candidate, u: np.ndarray, rows: np.ndarray) -> list[float]:
    """When a slip explains most, and some of the times that do nearly as well: what is at rest has no say in it here.

    Its length is linear in the residual, so every time is tried on one residual.  Returns seconds since the session
    began.
    """
    evidence = problem.evidence
    problem.scanned[candidate.name] = {candidate.scanned: 0.0}
    sizes = [i for i, (c, f) in enumerate(problem.slots) if c is candidate]
    at = problem.residual(_with(u, sizes[0], 0.0))
    n = evidence.rows_of_samples
    weight, rows = evidence.sample_weight, rows[:n]
    predictions = evidence.predict({})
    elapsed_s = np.concatenate([p.elapsed_s[rows] for p, rows in zip(predictions, evidence.logs.compared, strict=True)])
    order = np.argsort(elapsed_s, kind="stable")
    order = order[rows[order]]
    w2, wr = np.cumsum(weight[order] ** 2), np.cumsum((weight * at[:n])[order])
    # The best two levels, before and after: what the split takes off the squares, the level before fixed at zero.
    after_w2, after_wr = w2[-1] - w2, wr[-1] - wr
    gain = after_wr**2 / np.maximum(after_w2, 1e-12)
    # A slip does not happen within the first or last 3 %: there it is an offset, or nothing.
    share = np.arange(len(order)) / len(order)
    gain[(share < 0.03) | (share > 0.97)] = 0.0
    near = np.flatnonzero(gain >= NEARLY * gain.max())
    spread = near[np.linspace(0, len(near) - 1, TRIED).astype(int)]
    return [float(elapsed_s[order[i]]) for i in (np.argmax(gain), *spread)]


def _held_out(problem: _Problem, u: np.ndarray, J: np.ndarray, at_u: np.ndarray, train: np.ndarray, folds: int):
    """Rows and errors by fits that have not seen each unit: one Gauss–Newton step from the joint fit is as good as a
    new one."""
    evidence = problem.evidence
    held_out_rows = at_u.copy()
    at = evidence.predict(problem.effects(u))
    percent, news_percent = evidence.errors_percent(at), evidence.news_percent(at)
    numbered = np.flatnonzero(train)
    for k in range(folds):
        left_out = numbered[k::folds]
        seen = train.copy()
        seen[left_out] = False
        rows = seen[evidence.unit_of_row]
        A, b = J[rows], at_u[rows]
        step = -np.linalg.lstsq(A, b, rcond=1e-6)[0]
        moved = np.clip(u + np.clip(step, -2.0, 2.0), problem.low, problem.high)
        predictions = evidence.predict(problem.effects(moved))
        there = evidence.rows(predictions)
        if np.sum(there[rows] ** 2) > 1.02 * np.sum(b**2):  # too curved for a whole step
            moved = np.clip(u + 0.3 * np.clip(step, -2.0, 2.0), problem.low, problem.high)
            predictions = evidence.predict(problem.effects(moved))
            there = evidence.rows(predictions)
        hidden = np.isin(evidence.unit_of_row, left_out)
        held_out_rows[hidden] = there[hidden]
        percent[left_out] = evidence.errors_percent(predictions)[left_out]
        news_percent[left_out] = evidence.news_percent(predictions)[left_out]
    return held_out_rows, percent, news_percent


def _intervals(problem: _Problem, u: np.ndarray, J: np.ndarray, at_u: np.ndarray, rows: np.ndarray) -> dict:
    """95 % intervals by the sandwich, cycles as its clusters."""
    evidence = problem.evidence
    A = J[rows]
    inverse = np.linalg.pinv(A.T @ A, rcond=1e-10)
    scores = np.zeros((evidence.units, len(u)))
    np.add.at(scores, evidence.unit_of_row[rows], A * at_u[rows, None])
    n = len(np.unique(evidence.unit_of_row[rows]))
    spread = 1.96 * np.sqrt(np.maximum(np.diag(inverse @ (scores.T @ scores) @ inverse), 0.0) * n / max(n - len(u), 1))
    out: dict[str, dict[str, tuple[float, float]]] = {c.name: {} for c in problem.candidates}
    for i, (c, f) in enumerate(problem.slots):
        wide = min(spread[i], 50.0)
        out[c.name][f.name] = (f.from_unit(u[i] - wide), f.from_unit(u[i] + wide))
    for c in problem.candidates:
        if c.scanned:
            value = problem.scanned[c.name][c.scanned]
            out[c.name][c.scanned] = (value, value)
    return out


def _at_bound(problem: _Problem, u: np.ndarray) -> tuple[str, ...]:
    """Parameters at an end at which the effect is not possible, or is another."""
    found = []
    for (c, f), x, low, high in zip(problem.slots, u, problem.low, problem.high, strict=True):
        near = (NEAR_SIZE if f.is_size else NEAR_SHAPE) * (high - low)
        ends = (("high", "low") if f.low < 0.0 else ("high",)) if f.is_size else f.other_at
        if ("high" in ends and high - x < near) or ("low" in ends and x - low < near):
            found.append(f"{c.name}.{f.name}")
    return tuple(found)
