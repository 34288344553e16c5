"""The heat balance of a wire, fitted together with one learner: each number is drawn to what is known of such wires."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sma_actuator.estimation.models.whole_range import KNOWN

from .data import Data
from .learner import Learner, robust, solve

JOINT_UNITS = 14  #: of the one learner that the heat balance is fitted with
JOINT_ITERATIONS = 60
EVERY = 3  #: the heat balance moves in every third iteration: it costs eight runs through the logs
# How far what is known of wires before a log is seen (KNOWN) may be off, and between what it must lie.
_UNSURE = np.array([0.2, 0.0015, 3.0, 5.0, 6.0, 0.025, 0.02])
LEAST = np.array([0.2, 0.0, -30.0, 0.0, -60.0, 0.02, 0.02])
MOST = np.array([5.0, 0.03, 60.0, 120.0, 90.0, 0.5, 0.5])
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
    known = KNOWN.copy()
    rows = data.rows[data.measured]
    target = data.displacement[rows]
    seen = data.features(known)[data.scaling_rows]
    centre, scale = seen.mean(axis=0), seen.std(axis=0) + 1e-12
    learner = Learner(seen.shape[1], JOINT_UNITS, 0, data.smooth)

    def scaled(numbers: np.ndarray) -> np.ndarray:
        return (data.features(numbers)[rows] - centre) / scale

    def cost_of(error: np.ndarray, weights: np.ndarray, numbers: np.ndarray) -> float:
        off = (numbers - KNOWN) / _UNSURE
        return robust(error) + float(learner.shrinkage @ weights**2) + _PRIOR_WEIGHT * float(off @ off)

    z = scaled(known)
    weights, damping = learner.start(z, target), 1e-2
    value, jacobian = learner.jacobian(weights, z)
    cost = cost_of(target - value, weights, known)
    for i in range(JOINT_ITERATIONS):
        progress(i / JOINT_ITERATIONS)
        both = i % EVERY == 0
        pull, stiffness, slopes = learner.shrinkage * weights, learner.shrinkage, jacobian
        if both:
            columns = []
            for k in range(len(known)):
                moved = known.copy()
                moved[k] += 1e-3 * _UNSURE[k]
                columns.append((learner.value(weights, scaled(moved)) - value) / 1e-3)
            slopes = np.column_stack([jacobian, *columns])
            pull = np.concatenate([pull, _PRIOR_WEIGHT * (known - KNOWN) / _UNSURE])
            stiffness = np.concatenate([stiffness, np.full(len(known), _PRIOR_WEIGHT)])
        for _ in range(6):
            step = solve(slopes, target - value, pull, stiffness, damping)
            tried = weights + step[: len(weights)]
            numbers, new_z = known, z
            if both:
                numbers = np.clip(known + step[len(weights) :] * _UNSURE, LEAST, MOST)
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
