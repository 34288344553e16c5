"""What is learned: a quadratic and the plays, and one layer of tanh units beside them; by damped Gauss-Newton with a
robust loss.

Values and derivatives have the precision of the samples they are made of; steps are always solved for in double.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sma_actuator.estimation.models.heat_content import DIRECT, STRESS
from sma_actuator.estimation.models.whole_range_kernel import CURVE_TERMS

LEARNERS = 3
UNITS = 32  #: tanh units of each; of 16, 24, 32 and 40 the fewest beyond which nothing was won (docs/whole_range.md)
ROBUST = 1.0  #: % of the full stroke beyond which an error counts linearly
#: Times the least of its team, from which on a learner's cost is that of a search which ended beside the point; the
#: others end within 3.4.  It learns anew from another start, so many times at the most.
AGAIN, STARTS = 5.0, 3
_BOLD = 1e-2  #: damping that a search begins with
SHRINKAGE = 0.3  #: of the weights, in squared % of the full stroke
#: Logs have a handful of loads, and between them nothing tells a learner how to bend: bends along stress are shrunk so
#: much more.
SMOOTH_IN_STRESS = 3.0
#: The square of the stress among the terms.  Two loads do not tell it from a constant: half taken for each, a wire was
#: off by 11 to 49 % midway.  It is shrunk by so many times, and in the physical curve by this weight of each sample.
SQUARE_OF_STRESS, STRAIGHTENED, HELD_STRAIGHT = 5, 256.0, 0.25


class AlongStress(NamedTuple):
    """How little is to bend from one load to the next."""

    further: float  #: so many times as much as of the usual loads bends are shrunk
    straight: bool = False  #: the loads tell of a line alone


def terms_of(z: np.ndarray) -> np.ndarray:
    """The quadratic of the model, then the plays: shape (n, terms)."""
    a, b, c = z[:, 0], z[:, 1], z[:, 2]
    return np.column_stack([np.ones_like(a), a, b, c, a * a, b * b, c * c, a * b, a * c, b * c, z[:, DIRECT:]])


class Learner:
    """The learned part: its weights as one vector (linear terms, hidden, bias, output), and its derivatives."""

    def __init__(self, features: int, seed: int, along_stress: AlongStress, units: int | None = None):
        self.n, self.m = features, units or UNITS
        self.lines = CURVE_TERMS + features - DIRECT
        self.cut = np.cumsum([self.lines, self.m * self.n, self.m])  #: between the parts of the weights
        rng = np.random.default_rng(seed)
        hidden = rng.normal(size=(self.m, self.n))
        reach = 0.7 * self.m ** (1.0 / self.n)  # Nguyen and Widrow's: units spread over what is seen
        hidden *= reach / np.linalg.norm(hidden, axis=1)[:, None]
        bias = np.linspace(-reach, reach, self.m)
        self.weights = np.concatenate([np.zeros(self.lines), hidden.ravel(), bias, np.zeros(self.m)])
        along = np.full(self.n, 0.3)
        along[STRESS] *= SMOOTH_IN_STRESS * along_stress.further
        self.shrinkage = np.concatenate(
            [np.full(self.lines, 0.02), np.tile(along, self.m), np.full(self.m, 0.3), np.full(self.m, 1.0)]
        )
        self.shrinkage = SHRINKAGE * self.shrinkage
        self.shrinkage[0] = 0.0
        self.held = np.ones(self.lines + self.m)  #: where it starts, the linear terms and the outputs
        if along_stress.straight:
            for held in (self.shrinkage, self.held):
                held[SQUARE_OF_STRESS] *= STRAIGHTENED

    def parts(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Linear terms, hidden weights, biases, outputs."""
        linear, hidden, bias, output = np.split(weights, self.cut)
        return linear, hidden.reshape(self.m, self.n), bias, output

    def start(self, z: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Weights whose linear terms and outputs fit best for the hidden layer that there is."""
        _, hidden, bias, _ = self.parts(self.weights)
        basis = np.column_stack([terms_of(z), np.tanh(z @ hidden.T + bias)])
        found = np.linalg.solve(basis.T @ basis + np.diag(self.held), basis.T @ target)
        out = self.weights.copy()
        out[: self.lines], out[-self.m :] = found[: self.lines], found[self.lines :]
        return out

    def value(self, weights: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Displacement [%]."""
        linear, hidden, bias, output = self.parts(weights.astype(z.dtype))
        return terms_of(z) @ linear + np.tanh(z @ hidden.T + bias) @ output

    def cost(self, weights: np.ndarray, z: np.ndarray, target: np.ndarray) -> float:
        """What a search makes least."""
        return robust(target - self.value(weights, z)) + float(self.shrinkage @ weights**2)

    def jacobian(self, weights: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacement and its derivative with respect to the weights."""
        linear, hidden, bias, output = self.parts(weights.astype(z.dtype))
        terms, act = terms_of(z), np.tanh(z @ hidden.T + bias)
        slope = (1.0 - act * act) * output
        out = np.empty((len(z), len(weights)), z.dtype)
        by_line, by_hidden, by_bias, by_output = np.split(out, self.cut, axis=1)
        by_line[:], by_bias[:], by_output[:] = terms, slope, act
        np.multiply(slope[:, :, None], z[:, None, :], out=by_hidden.reshape(len(z), self.m, self.n))
        return terms @ linear + act @ output, out


class Team:
    """Learners that differ in where they began, learned on the same samples.

    In single precision, a hundred-thousandth of the stroke, which takes half the time.
    """

    def __init__(
        self,
        z: np.ndarray,
        target: np.ndarray,
        iterations: int,
        along_stress: AlongStress,
        learners: int = LEARNERS,
        units: int | None = None,
    ):
        z, target = z.astype(np.float32), target.astype(np.float32)

        def learned(seed: int) -> tuple[float, Learner]:
            learner = Learner(z.shape[1], seed, along_stress, units)
            learner.weights = learn(learner, z, target, iterations)
            return learner.cost(learner.weights, z, target), learner

        found = [learned(seed) for seed in range(1, learners + 1)]
        for start in range(1, STARTS):
            least = min(cost for cost, _ in found)
            for place, (cost, _) in enumerate(found):
                if cost > AGAIN * least:
                    found[place] = min(found[place], learned(start * learners + place + 1), key=lambda one: one[0])
        self.learners = [learner for _, learner in found]

    def values(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and spread, as the target."""
        each = np.array([learner.value(learner.weights, z) for learner in self.learners])
        return each.mean(axis=0), each.std(axis=0)

    def parts(self) -> Iterator[np.ndarray]:
        """Linear terms, hidden weights, biases and outputs, learner after learner in each."""
        for parts in zip(*(learner.parts(learner.weights) for learner in self.learners), strict=True):
            yield np.concatenate([np.ravel(part) for part in parts])


def learn(learner: Learner, z: np.ndarray, target: np.ndarray, iterations: int) -> np.ndarray:
    """Weights for features that stand."""
    weights, damping = learner.start(z, target), _BOLD
    value, jacobian = learner.jacobian(weights, z)
    equations = Equations.of(jacobian, target - value)
    cost = robust(target - value) + float(learner.shrinkage @ weights**2)
    for _ in range(iterations):
        step = equations.step(learner.shrinkage * weights, learner.shrinkage, damping)
        tried = weights + step
        new_cost = learner.cost(tried, z, target)
        if new_cost >= cost:
            damping *= 8.0
            if damping > 1e6:
                break
            continue
        # A timid step gains little wherever it is taken: one of 27 learners stopped so at 30 times its cost.
        enough = damping <= _BOLD and cost - new_cost < 1e-4 * cost
        weights, cost, damping = tried, new_cost, max(damping / 5.0, 1e-9)
        if enough:
            break
        value, jacobian = learner.jacobian(weights, z)
        equations = Equations.of(jacobian, target - value)
    return weights


@dataclass(frozen=True, slots=True)
class Equations:
    """Normal equations of a Gauss-Newton step of the robust problem: the same however strongly it is damped."""

    normal: np.ndarray  #: (weights, weights)
    gradient: np.ndarray  #: (weights,)

    @classmethod
    def of(cls, jacobian: np.ndarray, error: np.ndarray) -> Equations:
        """Those where the errors and their derivatives are these."""
        root = np.sqrt(np.minimum(1.0, ROBUST / np.maximum(np.abs(error), 1e-12))).astype(jacobian.dtype)
        weighted = jacobian * root[:, None]
        # Of one matrix with itself: half the work.
        return cls((weighted.T @ weighted).astype(float), weighted.T @ (root * error))

    def among(self, moving: np.ndarray) -> Equations:
        """Those of some of the weights, while the others stay."""
        return Equations(self.normal[np.ix_(moving, moving)], self.gradient[moving])

    def step(self, pull: np.ndarray, stiffness: np.ndarray, damping: float) -> np.ndarray:
        """The damped and shrunk step."""
        size = np.diag(self.normal)
        held = stiffness + damping * np.maximum(size, 1e-4 * size.max())
        return np.linalg.solve(self.normal + np.diag(held), self.gradient - pull)


def robust(error: np.ndarray) -> float:
    """Huber's loss of n errors, twice over."""
    size = np.abs(error)
    return float(np.where(size < ROBUST, error * error, 2.0 * ROBUST * size - ROBUST * ROBUST).sum())


def physical_curve(z: np.ndarray, target: np.ndarray, along_stress: AlongStress) -> np.ndarray:
    """The physical curve: least squares of a quadratic, without the square of the stress where that is not told."""
    terms = terms_of(z)[:, :CURVE_TERMS]
    if along_stress.straight:
        held = np.zeros((1, CURVE_TERMS))
        held[0, SQUARE_OF_STRESS] = np.sqrt(HELD_STRAIGHT * len(z))
        terms, target = np.vstack((terms, held)), np.append(target, 0.0)
    return np.linalg.lstsq(terms, target, rcond=None)[0]


def whitening_of(z: np.ndarray) -> np.ndarray:
    """Lower triangle that makes features white, scaled so that 95 % of them are nearer than 1."""
    square = z.T @ z / len(z) + 1e-3 * np.eye(z.shape[1])
    out = np.linalg.inv(np.linalg.cholesky(square))
    return out / np.percentile(np.linalg.norm(z @ out.T, axis=1), 95)
