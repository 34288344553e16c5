"""The heat balance of a wire, fitted together with one learner: each number is drawn to what is known of such wires.

The learner is one of the model's.  A poorer one, of a wire whose resistance hardly tells where it is, makes the heat
balance do what it cannot: with 14 units the latent heat came out at nearly twice what it is.

The near surroundings are drawn to what the contracted wire showed of them (:mod:`sma_actuator.identify.measured`);
where it showed none, there are none.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sma_actuator.estimation.models.heat_content import NEAR, known_of

from .data import Data
from .learner import Equations, Learner, robust

JOINT_ITERATIONS = 60
# How far what is known of wires before a log is seen (KNOWN) may be off, and between what it must lie.
_UNSURE = np.array([0.2, 0.0015, 3.0, 5.0, 6.0, 0.025, 0.02, 0.3, 1.0])
LEAST = np.array([0.2, 0.0, -30.0, 0.0, -60.0, 0.02, 0.02, 0.0, 0.3])
MOST = np.array([5.0, 0.03, 60.0, 120.0, 90.0, 0.5, 0.5, 0.9, 30.0])
#: Of the wire itself; of surroundings that take no share the logs cannot determine anything.
NAMES = (
    "the time constant over C/h",
    "the growth of the heat loss",
    "the latent heat of the R-phase",
    "the latent heat",
    "the apparent temperature per resistance",
    "the shift of the loop with stress",
    "the shift of the narrow loop with stress",
)
_PRIOR_WEIGHT = 3.0


def heat_balance(data: Data, progress: Callable[[float], None]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The heat balance, fitted together with one learner; then centre and scale of the features."""
    before = known_of(data.thermal)
    known = before.copy()
    free = len(known) if known[NEAR] > 0.0 else NEAR  #: so many of its numbers may move
    rows = data.rows[data.measured & data.fewer]
    target = data.displacement[rows]
    seen = data.features(known)[data.scaling_rows]
    centre, scale = seen.mean(axis=0), seen.std(axis=0) + 1e-12
    learner = Learner(seen.shape[1], 0, data.along_stress)

    def scaled(numbers: np.ndarray) -> np.ndarray:
        return (data.features(numbers, measured=True)[rows] - centre) / scale

    def cost_of(error: np.ndarray, weights: np.ndarray, numbers: np.ndarray) -> float:
        off = (numbers - before) / _UNSURE
        return robust(error) + float(learner.shrinkage @ weights**2) + _PRIOR_WEIGHT * float(off @ off)

    z = scaled(known)
    weights, damping = learner.start(z, target), 1e-2
    value, jacobian = learner.jacobian(weights, z)
    cost = cost_of(target - value, weights, known)
    stiffness = np.concatenate([learner.shrinkage, np.full(free, _PRIOR_WEIGHT)])
    for i in range(JOINT_ITERATIONS):
        progress(i / JOINT_ITERATIONS)
        columns = []
        for k in range(free):
            moved = known.copy()
            moved[k] += 1e-3 * _UNSURE[k]
            columns.append((learner.value(weights, scaled(moved)) - value) / 1e-3)
        slopes = np.column_stack([jacobian, *columns])
        pull = stiffness * np.concatenate([weights, ((known - before) / _UNSURE)[:free]])
        equations = Equations.of(slopes, target - value)
        for _ in range(6):
            step = _step(equations, pull, stiffness, damping, known[:free])
            tried, numbers = weights + step[:-free], known.copy()
            numbers[:free] = np.clip(known[:free] + step[-free:] * _UNSURE[:free], LEAST[:free], MOST[:free])
            new_z = scaled(numbers)
            new_cost = cost_of(target - learner.value(tried, new_z), tried, numbers)
            if new_cost < cost:
                break
            damping *= 8.0
        else:
            break
        weights, known, z, cost, damping = tried, numbers, new_z, new_cost, max(damping / 5.0, 1e-9)
        value, jacobian = learner.jacobian(weights, z)
    return known, centre, scale


def _step(
    equations: Equations, pull: np.ndarray, stiffness: np.ndarray, damping: float, known: np.ndarray
) -> np.ndarray:
    """A step in which numbers stay that stand at a bound and would leave it; the others move as if these were fixed."""
    free = len(known)
    moves = np.ones(len(pull), dtype=bool)
    while True:
        step = np.zeros(len(moves))
        step[moves] = equations.among(moves).step(pull[moves], stiffness[moves], damping)
        by = step[-free:]
        leaves = (known <= LEAST[:free]) & (by < 0.0) | (known >= MOST[:free]) & (by > 0.0)
        if not leaves.any():
            return step
        moves[-free:] &= ~leaves
