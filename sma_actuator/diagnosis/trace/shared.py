"""How many readings share their error in some logs.

How long they do is known of the calibration's sessions.  Another may err for longer at a time: of what not even large
smooth errors over everything at once take off, that is seen in itself.
"""

from __future__ import annotations

import numpy as np

from sma_actuator.calibration.expectation import correlation_time_s

from .covariance import Covariance
from .evidence import Evidence
from .smooth_errors import SmoothErrors

LARGE_sigma = 10.0  #: smooth errors that leave only what goes with nothing
STEPS = 50  #: times at which one may have come at once


def as_one(evidence: Evidence, smooth: SmoothErrors, rows: np.ndarray) -> float:
    """How many readings that the calibration has as independent share their error here; at least one.

    ``rows``: of the model as it is.  What goes with anything that is looked at is taken off them before, so that what
    an effect does is not mistaken for it, and a step where one fits best: what happens once is off ever after.
    """
    logs = evidence.logs
    log = np.repeat(np.arange(len(logs.compared)), [len(here) for here in logs.compared])
    time_s = np.concatenate([t.signals.time_s[here] for t, here in zip(logs.experiments, logs.compared, strict=True)])
    columns = (smooth.repeating, *(LARGE_sigma * columns for columns in smooth.new.values()))
    step = _step(evidence, smooth, rows, time_s - logs.start_s, Covariance(*columns))
    left = Covariance(*columns, LARGE_sigma * step).inverse(rows)[: evidence.rows_of_samples]
    lasts_s = sum(float(np.ptp(time_s[log == k])) for k in np.unique(log))
    shared_s = correlation_time_s(time_s, left / evidence.sample_weight, log)
    return max(shared_s * float(evidence.independent.sum()) / lasts_s, 1.0)


def _step(
    evidence: Evidence, smooth: SmoothErrors, rows: np.ndarray, time_s: np.ndarray, covariance: Covariance
) -> np.ndarray:
    """A step of the displacement beside what else may be off, at the time when it takes most off, (rows, 1)."""
    floor_m = np.concatenate(evidence.of_displacement.floor_m)[:, None]
    off = covariance.whiten(rows)
    first, last = 0.0, 1.0  # of the readings before it
    for _ in range(2):
        shares = np.linspace(first, last, STEPS + 2)
        after = time_s[:, None] >= np.quantile(time_s, shares[1:-1])
        steps = np.zeros((len(rows), STEPS))
        steps[: len(floor_m)] = after * floor_m.mean() / floor_m
        steps *= smooth.weight[:, None]
        whitened = covariance.whiten(steps)
        best = int(np.argmax((off @ whitened) ** 2 / np.maximum(np.sum(whitened**2, axis=0), 1e-9)))
        first, last = shares[best], shares[best + 2]
    return steps[:, [best]]
