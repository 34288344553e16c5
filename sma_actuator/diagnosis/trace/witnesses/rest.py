"""Resistance and displacement where the wire stands still, cold and hot, against what they were at the calibration."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np

from sma_actuator.base.calibration import Calibration
from sma_actuator.calibration.rest import AtRest, Rest, Usual
from sma_actuator.config import Config
from sma_actuator.diagnosis.trace.prediction import Prediction
from sma_actuator.diagnosis.trace.prepared import Prepared

from .witness import Witness

#: Of full stroke: so far from where it will rest, a wire still transforms; and half of its martensite is yet to form.
ON_ITS_WAY, HALF_WAY = 0.1, 0.5


class Rests(Witness):
    """R and δ of every rest, one row after the other."""

    names = (
        "resistance at cold rest",
        "displacement at cold rest",
        "resistance at hot rest",
        "displacement at hot rest",
    )

    def __init__(self, logs: Prepared, config: Config, calibration: Calibration):
        self.logs, self.calibration = logs, calibration
        self._full_stroke_m = config.wire.full_stroke_m
        self._time_constant_s = config.thermal.heat_capacity / config.thermal.heat_loss
        known_Ohm = calibration.resistance_range
        range_Ohm = known_Ohm if math.isfinite(known_Ohm) else _range_Ohm(logs)
        self._usual = Usual(calibration, config.thermal.heat_loss, range_Ohm, self._full_stroke_m)
        units = [int(logs.unit[i][r.start]) for i, rests in enumerate(logs.rests) for r in rests]
        hot = np.array([r.hot for rests in logs.rests for r in rests], dtype=int)
        self.row_units = np.repeat(units, 2).astype(int)
        self.row_names = np.repeat(2 * hot, 2) + np.tile((0, 1), len(hot))
        self._windows = [_Windows(rests) for rests in logs.rests]
        self._on_its_way, self._half_way = (
            [np.array([self._last(i, r, away) for r in rests], dtype=int) for i, rests in enumerate(logs.rests)]
            for away in (ON_ITS_WAY, HALF_WAY)
        )

    def off(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """R and δ of every rest against the calibration's, in its standard deviations, shape (2 · rests,)."""
        return self._usual.off(self._all(predictions)).ravel()

    def unknown(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How much further off they are where martensite keeps the variants of the load that it formed under, shape
        (2 · rests,): a spring takes that back all the way, and no calibration under weights shows what is kept."""
        rests = self._all(predictions)
        formed_Pa = [p.stress_Pa[half_way] for p, half_way in zip(predictions, self._half_way, strict=True)]
        kept = self._usual.as_formed(rests, np.concatenate(formed_Pa))
        return (self._usual.off(kept) - self._usual.off(rests)).ravel()

    def _all(self, predictions: Sequence[Prediction]) -> AtRest:
        shown = [self._shown(i, p) for i, p in enumerate(predictions)]
        return AtRest(**{f.name: np.concatenate([getattr(s, f.name) for s in shown]) for f in fields(AtRest)})

    def _shown(self, number: int, p: Prediction) -> AtRest:
        """What the rests of a log show, if a prediction is right about circuit, load cell and sensor."""
        windows, signals = self._windows[number], self.logs.experiments[number].signals
        measured_m, stress_Pa = self.logs.measured_m[number], windows.mean(p.stress_Pa)
        further_Ohm, further_m = (
            windows.further(values, signals.time_s, self._time_constant_s)
            for values in (p.resistance_Ohm, measured_m - (p.shown_m - p.model_m))
        )
        around_C = np.broadcast_to(signals.ambient_temperature_C, len(measured_m))
        warmer_K = windows.mean(around_C) - self.calibration.ambient_temperature
        return AtRest(
            hot=windows.hot,
            resistance_Ohm=windows.mean(p.resistance_Ohm) + np.where(windows.hot, further_Ohm, 0.0),
            displacement_m=windows.mean(measured_m - p.beside_m) + np.where(windows.hot, 0.0, further_m),
            further_m=further_m,
            further_Ohm=np.where(windows.hot, 0.0, further_Ohm),
            stress_Pa=stress_Pa,
            since_Pa=stress_Pa - p.stress_Pa[self._on_its_way[number]],
            heat_W=windows.mean(p.heat_W),
            beside_W=windows.mean(p.heat_W - p.power_W),
            warmer_K=np.where(np.isfinite(warmer_K), warmer_K, 0.0),
        )

    def _last(self, number: int, rest: Rest, away: float) -> int:
        """The last sample before a rest at which the wire was still so far away from it, of full stroke; the rest's
        first, where it never was."""
        measured_m = self.logs.measured_m[number]
        away_m = np.abs(measured_m[: rest.start] - measured_m[rest.start])
        moving = np.flatnonzero(away_m > away * self._full_stroke_m)
        return int(moving[-1]) if len(moving) else rest.start


class _Windows:
    """The rests of one log: means of a signal over all of them at once, since every step of every fit asks."""

    def __init__(self, rests: Sequence[Rest]):
        self.hot = np.array([r.hot for r in rests], dtype=bool)
        start, stop = np.array([(r.start, r.stop) for r in rests], dtype=int).reshape(-1, 2).T
        middle = (start + stop) // 2
        self._long = stop - start >= 2
        self._whole = _sums(start, stop)
        self._halves = [_sums(start, np.maximum(middle, start + 1)), _sums(np.minimum(middle, stop - 1), stop)]

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Of every rest, shape (rests,)."""
        return self._whole(values)

    def further(self, values: np.ndarray, time_s: np.ndarray, time_constant_s: float) -> np.ndarray:
        """How far ``values`` (n,) would go after each, where they go on as in it and come to rest in so long."""
        (from_, to), (from_s, to_s) = ([half(v) for half in self._halves] for v in (values, time_s))
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self._long, (to - from_) / (to_s - from_s) * time_constant_s, 0.0)


def _sums(start: np.ndarray, stop: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """What gives the means of a signal from each start to each stop."""
    edges = np.column_stack((start, stop)).ravel()

    def means(values: np.ndarray) -> np.ndarray:
        # the last stop may be the signal's end, where reduceat has no place
        return np.add.reduceat(np.append(values, 0.0), edges)[::2] / (stop - start)

    return means


def _range_Ohm(logs: Prepared) -> float:
    return float(max(np.subtract(*np.nanpercentile(t.resistance_Ohm, (99.5, 0.5))) for t in logs.experiments))
