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
    """How far displacement and load lie off a straight line: the mean of every heating and cooling, a row each; and
    the middle of every unit's way against its ends.

    What drifts or lags in sensor or load cell moves the one, what is not straight the other; what the wire does, moves
    neither.
    """

    names = ("load against displacement", "bend of load against displacement")

    def __init__(self, logs: Prepared, full_stroke_m: float):
        self.logs, self._usual_m = logs, LIMITS.straight * full_stroke_m
        self._springs = _springs(logs)
        #: Of each sample on a spring, which half of a unit it lies in: cooling or heating.
        halves = [
            2 * np.concatenate([logs.unit[i] for i in on]) + np.concatenate([logs.experiments[i].heating for i in on])
            for on in self._springs
        ]
        self._half = [_numbered(half) for half in halves]
        self._thirds = [_thirds(logs, on) for on in self._springs]
        units = [x for half, thirds in zip(self._half, self._thirds, strict=True) for x in (half[0] // 2, thirds[0])]
        self.row_units = np.concatenate(units or [np.empty(0, dtype=int)])
        self.row_names = np.repeat(np.arange(len(units)) % 2, [len(x) for x in units])

    def off(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How far off the line, in how straight springs are, shape (halves of units, and units, of every spring)."""
        return self._off(predictions, [p.stress_Pa for p in predictions])

    def unknown(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How much further off it is where the load is read one reading later: converters take one channel after the
        other, and filter each, of the same shape.  The calibration may have seen no spring."""
        before_Pa = [np.concatenate((p.stress_Pa[:1], p.stress_Pa[:-1])) for p in predictions]
        return self._off(predictions, before_Pa) - self.off(predictions)

    def _off(self, predictions: Sequence[Prediction], of_stress_Pa: Sequence[np.ndarray]) -> np.ndarray:
        out = [np.empty(0)]
        for on, (half, of_half), (unit, of_third) in zip(self._springs, self._half, self._thirds, strict=True):
            true_m = np.concatenate([self.logs.measured_m[i] - predictions[i].sensor_m for i in on])
            stress_Pa = np.concatenate([of_stress_Pa[i] for i in on])
            good = np.isfinite(true_m + stress_Pa)
            x, y = stress_Pa - stress_Pa[good].mean(), true_m - true_m[good].mean()
            off_m = np.where(good, y - x * (x[good] @ y[good]) / (x[good] @ x[good]), 0.0)
            short_m, middle_m, long_m = _means(off_m, of_third, 3 * len(unit)).reshape(-1, 3).T
            out += [_means(off_m, of_half, len(half)), middle_m - 0.5 * (short_m + long_m)]
        return np.concatenate(out) / self._usual_m


def _means(values: np.ndarray, which: np.ndarray, number: int) -> np.ndarray:
    """Mean of the values of each of so many parts, numbered from 1 on, shape (number,)."""
    sums, counts = (np.bincount(which, weights, minlength=number + 1)[1:] for weights in (values, None))
    return sums / counts


def _numbered(half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The halves of units that are a part of theirs; and of each sample the number of its half among these, from 1 on,
    or 0."""
    found, which, number = np.unique(half, return_inverse=True, return_counts=True)
    unit, of_unit = np.unique(found // 2, return_inverse=True)
    whole = np.bincount(of_unit, number, minlength=len(unit))[of_unit]
    counts = number >= PART * whole
    return found[counts], np.where(counts, np.cumsum(counts), 0)[which]


def _thirds(logs: Prepared, on: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """The units that go all the way of a spring; and of each sample the number of its third of the way of its unit
    among these, from 1 on, or 0."""
    measured_m = np.concatenate([logs.measured_m[i] for i in on])
    short_m, long_m = np.nanpercentile(measured_m, (1.0, 99.0))
    third = np.clip(np.nan_to_num(3.0 * (measured_m - short_m) / (long_m - short_m)), 0.0, 2.0).astype(int)
    found, which = np.unique(3 * np.concatenate([logs.unit[i] for i in on]) + third, return_inverse=True)
    unit, of_unit, parts = np.unique(found // 3, return_inverse=True, return_counts=True)
    whole = parts[of_unit] == 3
    return unit[parts == 3], np.where(whole, np.cumsum(whole), 0)[which]


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
