"""The search for the likeliest sizes and shapes of some effects, by Gauss-Newton steps through the whole recursion."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .candidates import Candidate
from .covariance import Covariance
from .evidence import Evidence
from .limits import LIMITS
from .problem import PROBE, Likeliest, Problem, changed, curved

#: How much less likely, in nats, the ends of each axis of what is likely are: a standard deviation has half a nat, √2
#: of them one.  Their distance is tried so often, each time so many times longer or shorter at the most.
FALL, WIDTHS, LONGER = (0.5, 2.0), 8, 4.0
#: What is far off counts linearly, so a step from PROBE falls short of a large effect, and a rest that counts only
#: where the wire is as hot as it was may lie between nothing and a large effect like a wall: of a single size so many
#: times that step, and so much, is tried too.
STRIDES, SIZES = (2.0, 4.0), (-3.0, 3.0)
STEPS, SHORTER = 8, (1.0, 0.3, 0.1)
LITTLE, ENDS = 2, 4  #: steps from each of so many starts, before it is gone on from where the best of them leads
ENOUGH = 0.002, 0.2  #: share of the squares, and squares, below which a step was the last
TRIED = 100  #: times of something that happens once …
MOST_TIMES, TIMES_APART = 4, 0.03  #: … of which so many are tried, so far apart, in the length of the logs
BESIDE_IT = (-0.02, -0.01, -0.005, -0.002, 0.002, 0.005, 0.01, 0.02)  #: in the length of the logs, looked at in the end


@dataclass(slots=True)
class _End:
    """Where a search has come to."""

    cost: float
    u: np.ndarray
    rows: np.ndarray
    time: dict  #: when what happens once did
    last: bool = False  #: no further step pays
    slopes: np.ndarray | None = None  #: of the rows, where they are known


@dataclass(slots=True)
class _Search:
    """A search for the likeliest of one problem, in some of the rows."""

    problem: Problem
    covariance: Covariance
    seen: np.ndarray | slice  #: which rows count

    def cost(self, rows: np.ndarray, u: np.ndarray) -> float:
        """Of all rows, of which those that are seen count."""
        return self.problem.cost(self.covariance, rows[self.seen], u)

    def step(self, rows: np.ndarray, slopes: np.ndarray, u: np.ndarray, free: Any = slice(None)) -> np.ndarray:
        """Likewise, the linear step."""
        return self.problem.step(self.covariance, rows[self.seen], slopes[self.seen], u, free)

    def gains(
        self, rows: np.ndarray, slopes: np.ndarray, columns: np.ndarray, u: np.ndarray, free: np.ndarray
    ) -> np.ndarray:
        """What each of some columns takes off the squares beside the ``free`` parameters, by a linear step of all."""
        p = self.problem
        spread = p.spread[free]
        known = np.zeros((len(spread), columns.shape[1]))
        a, r, c = (self.covariance.whiten(x[self.seen]) for x in (slopes, rows, columns))
        a, r = np.vstack((a, np.diag(1.0 / spread))), np.append(r, (u - p.usual)[free] / spread)
        q, c = np.linalg.qr(a)[0], np.vstack((c, known))
        r, c = r - q @ (q.T @ r), c - q @ (q.T @ c)
        return (c.T @ r) ** 2 / (np.sum(c**2, axis=0) + 1.0 / LIMITS.size**2)

    def starts(self, u: np.ndarray, new: np.ndarray, times: Sequence[dict]) -> list[tuple[float, np.ndarray, dict]]:
        """Where it is worth to begin, the cheapest first: every shape of what is new, one after the other, with several
        sizes; none of them nothing.

        Nothing is no place to begin at: there no shape makes a difference, at the end of a size that has but one sign
        no step leads away, and what a small effect does to a residual that is far off may point the wrong way.
        """
        p, found = self.problem, []
        sizes = np.flatnonzero(new & p.is_size) if (new & p.is_size).any() else np.flatnonzero(new)[:1]
        guesses = p.shapes(u, new)
        alone = len(u) == 1 and bool(p.is_size.all())
        for time in times:
            p.scanned |= time
            at = p.residual(u)
            for guess in guesses:
                if not p.is_size[sizes].all():
                    at = p.residual(guess)
                columns = []
                for i in sizes:
                    probe = PROBE if guess[i] + PROBE <= p.high[i] else -PROBE
                    there = changed(guess, i, guess[i] + probe)
                    rows = p.residual(there)
                    columns.append((rows - at) / probe)
                    found.append((self.cost(rows, there), there, time))
                step = self.step(at, np.column_stack(columns), guess, sizes)
                for further in (step, *((s * step for s in STRIDES) if alone else ()), *(SIZES if alone else ())):
                    there = guess.copy()
                    there[sizes] = guess[sizes] + further
                    there = p.clipped(there)
                    found.append((self.cost(p.residual(there), there), there, time))
        return sorted(found, key=lambda start: start[0])

    def begin(self, u: np.ndarray, time: dict) -> _End:
        """Where a search is that begins at ``u``."""
        p = self.problem
        p.scanned |= time
        u = p.clipped(u)
        rows = p.residual(u)
        return _End(self.cost(rows, u), u, rows, time)

    def descend(self, end: _End, steps: int = STEPS) -> _End:
        """Steps on from where a search has come to, as long as they pay."""
        p = self.problem
        p.scanned |= end.time
        for _ in range(steps):
            if end.last:
                break
            end.slopes = p.jacobian(end.u, end.rows)
            step = self.step(end.rows, end.slopes, end.u)
            for share in SHORTER:
                there = p.clipped(end.u + share * step)
                at = p.residual(there)
                reached = self.cost(at, there)
                if reached < end.cost:
                    last = end.cost - reached < ENOUGH[0] * reached + ENOUGH[1]
                    end = _End(reached, there, at, end.time, last)
                    break
            else:
                end.last = True
        return end

    def across(self, end: _End) -> Likeliest:
        """What is likeliest with all that is as likely, seen over its own width."""
        p, u, rows, at = self.problem, end.u, end.rows, end.cost
        slopes = p.jacobian(u, rows) if end.slopes is None else end.slopes
        axes = _axes(p, u, self.covariance.whiten(slopes[self.seen]) * p.spread)
        sides = np.repeat(rows[None, :, None], 2, axis=0) * np.ones(len(u))
        for i, axis in enumerate(axes.T):
            reach = p.room(u, -axis), p.room(u, axis)
            farthest = max(reach)
            if not farthest:  # a range without any width
                continue
            length, shorter, longer = min(1.0, farthest), 0.0, math.inf  # as far as a wall that lies behind nothing
            for tries in range(WIDTHS, 0, -1):
                if tries == 1 and shorter:
                    length = shorter
                possible = [(k, u + (-length, length)[k] * axis) for k in (0, 1) if length <= reach[k]]
                for k, there in possible:
                    sides[k, :, i] = p.residual(p.clipped(there))
                fall = float(np.mean([0.5 * (self.cost(sides[k, :, i], there) - at) for k, there in possible]))
                if FALL[0] <= fall <= FALL[1] or (fall < FALL[0] and length == farthest):
                    break
                shorter, longer = (length, longer) if fall < FALL[0] else (shorter, length)
                length /= math.sqrt(min(max(fall, LONGER**-2), LONGER**2))
                if not shorter < length < longer:
                    length = math.sqrt(shorter * longer)
                length = min(length, farthest)
            axes[:, i] *= length
            if len(possible) == 1:  # beyond what is possible it goes on as on the other side
                ((k, _),) = possible
                sides[1 - k, :, i] = 2.0 * rows - sides[k, :, i]
        seen = rows[self.seen], axes / p.spread[:, None], (sides[0][self.seen], sides[1][self.seen])
        return Likeliest(p, u, rows, axes, (sides[0], sides[1]), curved(self.covariance, *seen))


def _axes(problem: Problem, u: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Along what a linear step says of each how likely it is, each so long that its ends are about a nat less likely,
    (len(u), len(u)).

    ``slopes``: of whitened rows, by standard deviations of what is known before the logs.  A parameter with an end of
    the possible nearer than that is an axis of its own, so that one side of it can be gone.
    """
    squares = slopes.T @ slopes + np.eye(len(u))
    lengths = problem.spread * np.sqrt(2.0 / np.diag(squares))
    axes, free = np.diag(lengths), np.minimum(u - problem.low, problem.high - u) >= lengths
    of_free, vectors = np.linalg.eigh(squares[np.ix_(free, free)])
    axes[np.ix_(free, free)] = problem.spread[free, None] * vectors * np.sqrt(2.0 / of_free)
    return axes


def likeliest(
    evidence: Evidence,
    candidates: Sequence[Candidate],
    covariance: Covariance,
    known: Mapping[str, Mapping[str, float]] | None = None,
    seen: np.ndarray | None = None,
) -> Likeliest:
    """Where ``candidates`` together are likeliest.

    ``known``: parameters of some of them, to start from; ``seen``: which rows count (bool), of which the covariance
    then is.
    """
    known = known or {}
    problem = Problem(evidence, candidates)
    search = _Search(problem, covariance, slice(None) if seen is None else seen)
    u, new = problem.usual.copy(), np.ones(len(problem.slots), dtype=bool)
    for i, (c, f) in enumerate(problem.slots):
        if c.name in known:
            u[i], new[i] = f.to_unit(known[c.name][f.name]), False
    times: list[dict] = [{}]
    for c in candidates:
        if c.scanned and c.name in known:
            problem.scanned[c.name] = {c.scanned: known[c.name][c.scanned]}
        elif c.scanned:
            times = [{c.name: {c.scanned: time_s}} for time_s in _scan(search, c, u)]
            problem.scanned |= times[0]
    starts = search.starts(u, new, times) if new.any() else [(0.0, u, {})]
    ends = [search.descend(search.begin(start, when), LITTLE) for _, start, when in problem.apart(starts)[:ENDS]]
    end = search.descend(min(ends, key=lambda one: one.cost))
    for name, when in end.time.items():
        # The size is known now, so the time may be another beside the one that the scan found.
        ((what, time_s),) = when.items()
        near = [{name: {what: time_s + share * evidence.logs.together_s}} for share in BESIDE_IT]
        best = min((search.begin(end.u, other) for other in near), key=lambda one: one.cost)
        if best.cost < end.cost:
            end = search.descend(best)
    problem.scanned |= end.time
    found = search.across(end)
    for _ in range(STEPS):  # a search ends within a jump; what is likelier beyond it shows over the whole width
        further = problem.clipped(found.u + search.step(found.rows, found.slopes, found.u))
        at = problem.residual(further)
        cost = search.cost(at, further)
        if search.cost(found.rows, found.u) - cost < ENOUGH[1]:
            break
        found = search.across(_End(cost, further, at, end.time))
    return replace(found, when=_when(search, found))


def _scan(search: _Search, candidate: Candidate, u: np.ndarray) -> list[float]:
    """When something that happens once does best beside all that else is free, and some other times that do nearly as
    well.  Returns seconds of the sessions one after the other."""
    times_s, gain = _over_time(search, candidate, u)
    best = np.argsort(-gain)
    return _apart((float(times_s[i]) for i in best), TIMES_APART * search.problem.evidence.logs.together_s)


def _over_time(search: _Search, candidate: Candidate, u: np.ndarray, *more_s: float) -> tuple[np.ndarray, np.ndarray]:
    """At many times, and ``more_s``, what something that happens once takes off the squares if it did then [s of the
    sessions one after the other, 1]; before the first and between two of them as well.

    Its size is linear in the rows, so every time is tried on one residual.
    """
    problem, evidence = search.problem, search.problem.evidence
    problem.scanned[candidate.name] = {candidate.scanned: 0.0}
    size = next(i for i, (c, _) in enumerate(problem.slots) if c is candidate)
    others = np.arange(len(u)) != size
    nothing, probe = changed(u, size, 0.0), changed(u, size, PROBE)
    at = problem.residual(nothing)
    there, here = (evidence.compare(problem.effects(values)).off for values in (probe, nothing))
    logs = evidence.logs
    elapsed_s = np.concatenate(
        [p.before_s + p.elapsed_s[rows] for p, rows in zip(evidence.predict({}), logs.compared, strict=True)]
    )
    # A row of another witness is as old as the middle of its unit.
    of_sample, of_other = np.split(evidence.unit_of_row, [len(elapsed_s)])
    number = np.maximum(np.bincount(of_sample, minlength=evidence.units), 1)
    when_s = np.append(elapsed_s, (np.bincount(of_sample, elapsed_s, minlength=evidence.units) / number)[of_other])
    # Within the first 3 % it happened before, within the last not yet.
    begins_s = np.unique(logs.before_s)
    times_s = np.quantile(elapsed_s, np.linspace(TIMES_APART, 1.0 - TIMES_APART, TRIED))
    times_s = np.concatenate((times_s, begins_s, more_s))
    moved = (there - here)[:, None] / PROBE * (when_s[:, None] >= times_s)
    slopes = problem.jacobian(nothing, at)[:, others]
    return times_s, search.gains(at, slopes, moved, u, others)


def _when(search: _Search, found: Likeliest) -> float:
    """Logarithm of the share of all times that are as likely as those at which what happens once did: it may have at
    any, and pays for that as for every other parameter."""
    problem, out = search.problem, 0.0
    for c in problem.candidates:
        if c.scanned:
            when = problem.scanned[c.name]
            _, gain = _over_time(search, c, found.u, when[c.scanned])
            problem.scanned[c.name] = when
            likely = np.exp(np.minimum(0.5 * (gain - gain[-1]), 0.0))
            out += math.log(float(np.mean(likely)))
    return out


def _apart(times_s: Iterable[float], least_s: float) -> list[float]:
    """The first of some times, those that are so far apart from all before."""
    kept: list[float] = []
    for time_s in times_s:
        if all(abs(time_s - other_s) > least_s for other_s in kept):
            kept.append(time_s)
    return kept[:MOST_TIMES]
