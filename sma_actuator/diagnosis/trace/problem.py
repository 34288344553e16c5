"""The parameters of some effects as one vector, and where the logs make them likeliest.

What is likely is reckoned under the covariance of a session in which nothing has happened, and with what is known of an
effect before the logs: a size is some times what is typical, a shape is somewhere in its range.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from sma_actuator.base.parameters import declaration_of
from sma_actuator.estimation.effects import EFFECTS, Effect

from .bounded import log_share_between, log_share_within
from .candidates import Candidate
from .covariance import Covariance
from .evidence import Evidence
from .limits import LIMITS

STEP = 1e-3, 0.01  #: of finite differences, in the optimiser's units: of a size, of a shape
#: Of a size, in what is typical: from so large an effect one linear step says how large it is.
PROBE = 0.5
APART = 0.3  #: in the optimiser's units: shapes nearer to each other lead to the same end
WIDEST = 50.0  #: of a range, in the optimiser's units
NEAR_SIZE, NEAR_SHAPE = 0.01, 0.05  #: of what is possible, so near its end counts as at it: a shape comes there slowly
EDGE = 1e-9  #: in the optimiser's units, beyond what is possible: a range without any width has one


class Problem:
    """The parameters of some candidates as one vector, in what is typical of each."""

    def __init__(self, evidence: Evidence, candidates: Sequence[Candidate]):
        self.evidence = evidence
        self.candidates = tuple(candidates)
        self.slots = [(c, f) for c in candidates for f in c.free]
        self.low = np.array([f.to_unit(f.low) for _, f in self.slots])
        self.high = np.array([f.to_unit(f.high) for _, f in self.slots])
        self.is_size = np.array([f.is_size for _, f in self.slots], dtype=bool)
        #: What is likeliest before the logs, and its standard deviation.
        self.usual = np.array([0.0 if f.is_size or not f.starts else f.to_unit(f.starts[0]) for _, f in self.slots])
        half = 0.5 * (np.minimum(self.high, WIDEST) - np.maximum(self.low, -WIDEST))
        self.spread = np.where(self.is_size, LIMITS.size, np.maximum(half, 1e-3))
        self.scanned: dict[str, dict[str, float]] = {}

    def values(self, u: np.ndarray) -> dict[str, dict[str, float]]:
        """The parameters by effect and name."""
        out: dict[str, dict[str, float]] = {c.name: dict(self.scanned.get(c.name, {})) for c in self.candidates}
        for (c, f), x in zip(self.slots, u, strict=True):
            out[c.name][f.name] = f.from_unit(float(x))
        return out

    def effects(self, u: np.ndarray) -> dict[str, Effect]:
        """The effects, for a chain."""
        values = self.values(u)
        return {c.name: c.build(values[c.name]) for c in self.candidates}

    def differ(self, u: np.ndarray, other: np.ndarray) -> bool:
        """Whether two starts lead, as far as can be known, to different ends: another shape, or another sign of a
        size."""
        return bool(np.any((u * other)[self.is_size] < 0.0) or np.any(np.abs(u - other)[~self.is_size] > APART))

    def apart(self, starts: Sequence[tuple[float, np.ndarray, dict]]) -> list[tuple[float, np.ndarray, dict]]:
        """The cheapest of some starts that lead to different ends, and when."""
        kept: list[tuple[float, np.ndarray, dict]] = []
        for start in starts:
            if all(start[2] != other[2] or self.differ(start[1], other[1]) for other in kept):
                kept.append(start)
        return kept

    def shapes(self, u: np.ndarray, of: np.ndarray) -> list[np.ndarray]:
        """The same parameters, and with every other shape to start from of those ``of`` which (bool), one after the
        other."""
        others = [(i, self.slots[i][1]) for i in np.flatnonzero(of & ~self.is_size)]
        return [u, *(changed(u, i, f.to_unit(start)) for i, f in others for start in f.starts[1:])]

    def clipped(self, u: np.ndarray) -> np.ndarray:
        """The same within what is possible."""
        return np.clip(u, self.low, self.high)

    def room(self, u: np.ndarray, axis: np.ndarray) -> float:
        """How many times an axis it is from there to the end of what is possible."""
        some = axis != 0.0
        ends = np.where(axis > 0.0, self.high, self.low)
        return float(np.min((ends - u)[some] / axis[some]))

    @cached_property
    def without(self) -> list[np.ndarray]:
        """Which sizes may be nothing at once (their numbers), each choice as likely before the logs: of an effect that
        has several, some, but not all; a zero that was moved need not move on."""
        of_each = []
        for c in self.candidates:
            own = [i for i, (other, f) in enumerate(self.slots) if other is c and f.is_size]
            may = [i for i in own if "low" not in self.slots[i][1].other_at]
            of_each.append([some for n in range(len(may) + 1) for some in combinations(may, n) if n < len(own)] or [()])
        return [np.array(sum(choice, ()), dtype=int) for choice in product(*of_each)]

    def possible(self, u: np.ndarray, covariance: np.ndarray) -> float:
        """Logarithm of how much of a normal distribution of the parameters is possible, over how much of it was before
        the logs: a size of one sign has half of one, and nothing is paid for the half that cannot be.

        The mean over what may be nothing (:meth:`without`): there the distribution is that on condition that it is, and
        has the weight of its density there over that before the logs (J. M. Dickey, Ann. Math. Statist. 42 (1971)
        204-223), so nothing is paid either for a size that an effect has no need of.
        """
        low, high = self.low - EDGE, self.high + EDGE
        before = log_share_between((low - self.usual) / self.spread, (high - self.usual) / self.spread)
        found = []
        for none in self.without:
            some = np.setdiff1d(np.arange(len(u)), none)
            given = np.linalg.solve(covariance[np.ix_(none, none)], np.column_stack((u[none], covariance[none])))
            mean = u - covariance[:, none] @ given[:, 0]
            left = covariance - covariance[:, none] @ given[:, 1:]
            density = -0.5 * (u[none] @ given[:, 0] + np.linalg.slogdet(covariance[np.ix_(none, none)])[1])
            within = log_share_within(mean[some], left[np.ix_(some, some)], low[some], high[some])
            found.append(density + float(np.sum(np.log(self.spread[none]))) + within - float(np.sum(before[some])))
        return float(np.logaddexp.reduce(found)) - math.log(len(found))

    def cost(self, covariance: Covariance, rows: np.ndarray, u: np.ndarray) -> float:
        """Squares under the covariance, and of what is known of the parameters."""
        return float(np.sum(covariance.whiten(rows) ** 2) + np.sum(((u - self.usual) / self.spread) ** 2))

    def step(
        self, covariance: Covariance, rows: np.ndarray, slopes: np.ndarray, u: np.ndarray, free: Any = slice(None)
    ) -> np.ndarray:
        """The linear step of the ``free`` parameters that costs least, within what is possible; ``slopes``: of these
        alone."""
        spread, u, usual = self.spread[free], u[free], self.usual[free]
        a = np.vstack((covariance.whiten(slopes), np.diag(1.0 / spread)))
        b = np.concatenate((covariance.whiten(rows), (u - usual) / spread))
        room = (self.low[free] - u - EDGE, self.high[free] - u + EDGE)
        return lsq_linear(a, -b, room).x

    def residual(self, u: np.ndarray) -> np.ndarray:
        """Rows of the evidence."""
        return self.evidence.compare(self.effects(u)).rows

    def jacobian(self, u: np.ndarray, at_u: np.ndarray) -> np.ndarray:
        """Its slopes, (rows, len(u)); ``at_u``: the rows there."""
        columns = []
        for i, x in enumerate(u):
            step = STEP[0] * max(1.0, abs(x)) if self.is_size[i] else STEP[1]
            if x + step > self.high[i]:
                step = -step
            moved = u.copy()
            moved[i] += step
            columns.append((self.residual(moved) - at_u) / step)
        return np.column_stack(columns) if columns else np.zeros((len(at_u), 0))


@dataclass(frozen=True, slots=True)
class Likeliest:
    """Where some effects are likeliest."""

    problem: Problem
    u: np.ndarray
    rows: np.ndarray  #: of the evidence there
    #: Along each axis of what is as likely, how far from there it is about a nat less likely, (len(u), len(u)), and the
    #: rows so far off to either side, (rows, len(u)).
    axes: np.ndarray
    sides: tuple[np.ndarray, np.ndarray]
    #: Along each, how much more curved the likelihood is than the slopes say, as a root.
    curved: np.ndarray
    #: Logarithm of the share of all times that are as likely as those of what happens once.
    when: float = 0.0

    @property
    def slopes(self) -> np.ndarray:
        """Of the rows, (rows, len(u)), over all that is as likely: an estimate jumps where a branch turns a sample
        earlier, and what lies within a jump says nothing."""
        before, behind = self.sides
        return np.linalg.solve(self.axes.T, 0.5 * (behind - before).T).T

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """The effects."""
        return self.problem.candidates

    @property
    def values(self) -> dict[str, dict[str, float]]:
        """Their parameters, by effect and name."""
        return self.problem.values(self.u)

    @property
    def effects(self) -> dict[str, Effect]:
        """The effects, for a chain."""
        return self.problem.effects(self.u)

    @property
    def objection(self) -> str:
        """Why these effects are none, or others; empty if they are what they are called."""
        out, p = [], self.problem
        for (c, f), x, low, high in zip(p.slots, self.u, p.low, p.high, strict=True):
            near = (NEAR_SIZE if f.is_size else NEAR_SHAPE) * (high - low)
            ends = f.other_at + ((("high", "low") if f.low < 0.0 else ("high",)) if f.is_size else ())
            if ("high" in ends and high - x < near) or ("low" in ends and x - low < near):
                unit = declaration_of(next(d for d in dataclasses.fields(EFFECTS[c.name]) if d.name == f.name)).unit  # type: ignore[arg-type]
                unit = "" if unit == "1" else f" {unit}"
                value = self.values[c.name][f.name]
                out.append(
                    f"{c.name}'s {f.name} comes to {value:.3g}{unit}, the end of what is possible: there it is another "
                    "effect"
                )
        return "; ".join(out)

    def whitened(self, covariance: Covariance) -> Likeliest:
        """The same with rows that are independent of each other under a covariance."""
        before, behind = self.sides
        sides = covariance.whiten(before), covariance.whiten(behind)
        return dataclasses.replace(self, rows=covariance.whiten(self.rows), sides=sides)

    def log_evidence(self, covariance: Covariance) -> float:
        """Laplace's logarithm of the evidence, after one more step under this covariance, within what is possible.

        How steep the likelihood is along each axis is seen in itself, and not in the slopes; so is how curved, where
        the parameters were made likeliest.  Under another covariance they are not quite that, and between two jumps it
        may be the other way about.
        """
        p, sides = self.problem, self.sides
        off, axes = (self.u - p.usual) / p.spread, self.axes / p.spread[:, None]
        here, left, right = (np.sum(covariance.whiten(rows) ** 2, axis=0) for rows in (self.rows, *sides))
        straight = covariance.whiten(0.5 * (sides[1] - sides[0]))
        curvature = (straight.T @ straight + axes.T @ axes) * np.outer(self.curved, self.curved)
        uphill = 0.25 * (left - right) - axes.T @ off
        step, higher = self._step(uphill, curvature)
        volume = float(np.linalg.slogdet(axes)[1]) - 0.5 * float(np.linalg.slogdet(curvature)[1])
        possible = p.possible(self.u + self.axes @ step, self.axes @ np.linalg.solve(curvature, self.axes.T))
        return covariance.log_likelihood(float(here)) - 0.5 * float(off @ off) + higher + volume + possible + self.when

    def _step(self, uphill: np.ndarray, curvature: np.ndarray) -> tuple[np.ndarray, float]:
        """Along the axes, where the top of a normal distribution is that goes on as the likelihood does where it was
        seen, and by how much more likely that is than here.

        Nobody saw what lies beyond the ends of an axis, so the top is no further than these.  Where the end of what is
        possible comes first, all that counts lies before it, however far beyond it the top would be.
        """
        step = np.linalg.solve(curvature, uphill)
        if np.abs(step).max(initial=0.0) <= 1.0:
            return step, 0.5 * float(uphill @ step)
        reach = np.array([[self.problem.room(self.u, sign * axis) for axis in self.axes.T] for sign in (-1.0, 1.0)])
        root, ends = np.linalg.cholesky(curvature), np.minimum(reach, 1.0) + EDGE
        near = lsq_linear(root.T, np.linalg.solve(root, uphill), (-ends[0], ends[1]), method="bvls").x
        left = uphill - curvature @ near
        beyond = np.linalg.solve(curvature, np.where(np.where(left > 0.0, reach[1], reach[0]) < 1.0, left, 0.0))
        higher = near @ (uphill - 0.5 * curvature @ near) + 0.5 * beyond @ curvature @ beyond
        return near + beyond, float(higher)


def curved(
    covariance: Covariance, rows: np.ndarray, axes: np.ndarray, sides: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Along each axis, the root of how much more curved the likelihood is than the slopes say.

    ``axes``: in standard deviations of what is known before the logs; ``sides``: the rows at either end of each.
    """
    here, left, right = (np.sum(covariance.whiten(some) ** 2, axis=0) for some in (rows, *sides))
    straight, known = covariance.whiten(0.5 * (sides[1] - sides[0])), np.sum(axes**2, axis=0)
    return np.sqrt((np.maximum(0.5 * (left + right) - here, 0.0) + known) / (np.sum(straight**2, axis=0) + known))


def changed(u: np.ndarray, i: Any, value: float) -> np.ndarray:
    """The same parameters with another value of one."""
    out = u.copy()
    out[i] = value
    return out
