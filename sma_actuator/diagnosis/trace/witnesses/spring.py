"""The load against the displacement, where the wire pulls a spring: it is straight, whatever the calibration says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sma_actuator.diagnosis.trace.limits import LIMITS
from sma_actuator.diagnosis.trace.prediction import Prediction
from sma_actuator.diagnosis.trace.prepared import Prepared

from .witness import Witness

LOADS_DIFFER = 0.1  #: spread of the load, over the load, from which it counts as changing
PART = 0.2  #: share of a unit below which the mean of its heating, or cooling, is that of a few readings on the way
SPRING = 0.9  #: correlation squared of load and displacement from which the load is that of a spring


class Springs(Witness):
    """How far displacement and load lie off a straight line: the mean of every heating and cooling, a row each.

    What drifts or lags in sensor or load cell bends the line of a spring; what the wire does, does not.
    """

    names = ("load against displacement",)

    def __init__(self, logs: Prepared, full_stroke_m: float):
        self.logs, self._usual_m = logs, LIMITS.straight * full_stroke_m
        self._springs = _springs(logs)
        #: Of each sample on a spring, which half of a unit it lies in: cooling or heating.
        halves = [
            2 * np.concatenate([logs.unit[i] for i in on]) + np.concatenate([logs.experiments[i].heating for i in on])
            for on in self._springs
        ]
        self._half = [_numbered(half) for half in halves]
        self.row_units = np.concatenate([half // 2 for half, _ in self._half] or [np.empty(0, dtype=int)])
        self.row_names = np.zeros(len(self.row_units), dtype=int)

    def off(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How far off the line, in how straight springs are, shape (halves of units,)."""
        return self._off(predictions, [p.stress_Pa for p in predictions])

    def unknown(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How much further off it is where the load is read one reading later: converters take one channel after the
        other, and filter each, shape (halves of units,).  The calibration may have seen no spring."""
        before_Pa = [np.concatenate((p.stress_Pa[:1], p.stress_Pa[:-1])) for p in predictions]
        return self._off(predictions, before_Pa) - self.off(predictions)

    def _off(self, predictions: Sequence[Prediction], of_stress_Pa: Sequence[np.ndarray]) -> np.ndarray:
        out = [np.empty(0)]
        for on, (half, which) in zip(self._springs, self._half, strict=True):
            true_m = np.concatenate([self.logs.measured_m[i] - predictions[i].sensor_m for i in on])
            stress_Pa = np.concatenate([of_stress_Pa[i] for i in on])
            good = np.isfinite(true_m + stress_Pa)
            x, y = stress_Pa - stress_Pa[good].mean(), true_m - true_m[good].mean()
            off_m = np.where(good, y - x * (x[good] @ y[good]) / (x[good] @ x[good]), 0.0)
            sums_m, number = (np.bincount(which, weights, minlength=len(half) + 1)[1:] for weights in (off_m, None))
            out.append(sums_m / number / self._usual_m)
        return np.concatenate(out)


def _numbered(half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The halves of units that are a part of theirs; and of each sample the number of its half among these, from 1 on,
    or 0."""
    found, which, number = np.unique(half, return_inverse=True, return_counts=True)
    unit, of_unit = np.unique(found // 2, return_inverse=True)
    whole = np.bincount(of_unit, number, minlength=len(unit))[of_unit]
    counts = number >= PART * whole
    return found[counts], np.where(counts, np.cumsum(counts), 0)[which]


def _springs(logs: Prepared) -> list[list[int]]:
    """Numbers of the logs in which the wire pulls a spring; those of one session together."""
    found = []
    for on in logs.sessions:
        load_N = np.concatenate([logs.experiments[i].signals.load_N for i in on])
        measured_m = np.concatenate([logs.measured_m[i] for i in on])
        changes = np.subtract(*np.percentile(load_N, (99.0, 1.0))) > LOADS_DIFFER * abs(np.median(load_N))
        if changes and np.corrcoef(load_N, measured_m)[0, 1] ** 2 >= SPRING:
            found.append(on)
    return found
