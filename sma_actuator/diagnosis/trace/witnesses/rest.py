"""Resistance and displacement where the wire stands still, cold and hot, against what they were at the calibration."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sma_actuator.base.calibration import Calibration
from sma_actuator.calibration.rest import AtRest, Rest, Usual
from sma_actuator.config import Config
from sma_actuator.diagnosis.trace.prepared import Prepared

from .witness import Prediction

ON_ITS_WAY = 0.1  #: of full stroke: so far from where it will rest, a wire still transforms


class Rests:
    """R and δ of every rest, one row after the other."""

    names = (
        "resistance at cold rest",
        "displacement at cold rest",
        "resistance at hot rest",
        "displacement at hot rest",
    )

    def __init__(self, logs: Prepared, unit: Sequence[np.ndarray], config: Config, calibration: Calibration):
        self.logs, self.calibration = logs, calibration
        self._full_stroke_m = config.wire.full_stroke_m
        self._time_constant_s = config.thermal.heat_capacity / config.thermal.heat_loss
        known_Ohm = calibration.resistance_range
        range_Ohm = known_Ohm if math.isfinite(known_Ohm) else _range_Ohm(logs)
        self._usual = Usual(calibration, config.thermal.heat_loss, range_Ohm, self._full_stroke_m)
        units = [int(unit[i][r.start]) for i, rests in enumerate(logs.rests) for r in rests]
        hot = np.array([r.hot for rests in logs.rests for r in rests], dtype=int)
        self.row_units = np.repeat(units, 2).astype(int)
        self.row_names = np.repeat(2 * hot, 2) + np.tile((0, 1), len(hot))

    def off(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """R and δ of every rest against the calibration's, in its standard deviations, shape (2 · rests,)."""
        rests = [self._shown(i, rest, p) for i, p in enumerate(predictions) for rest in self.logs.rests[i]]
        return self._usual.off(rests).ravel()

    def _shown(self, number: int, rest: Rest, p: Prediction) -> AtRest:
        """What a rest of a log shows, if a prediction is right about circuit, load cell and sensor."""
        here = slice(rest.start, rest.stop)
        signals, stress_Pa = self.logs.experiments[number].signals, float(np.mean(p.stress_Pa[here]))
        creeps_m = self.logs.measured_m[number] - (p.shown_m - p.model_m)
        further_Ohm, further_m = (
            rest.further(values, signals.time_s, self._time_constant_s) for values in (p.resistance_Ohm, creeps_m)
        )
        read_C = np.broadcast_to(signals.ambient_temperature_C, len(creeps_m))[here]
        warmer_K = float(np.mean(read_C)) - self.calibration.ambient_temperature
        shown_m = self.logs.measured_m[number] - p.beside_m
        return AtRest(
            hot=rest.hot,
            resistance_Ohm=float(np.mean(p.resistance_Ohm[here])) + (further_Ohm if rest.hot else 0.0),
            displacement_m=float(np.mean(shown_m[here])) + (0.0 if rest.hot else further_m),
            further_m=further_m,
            stress_Pa=stress_Pa,
            since_Pa=stress_Pa - float(p.stress_Pa[self._on_its_way(number, rest)]),
            heat_W=float(np.mean(p.heat_W[here])),
            beside_W=float(np.mean(p.heat_W[here] - p.power_W[here])),
            warmer_K=warmer_K if math.isfinite(warmer_K) else 0.0,
        )

    def _on_its_way(self, number: int, rest: Rest) -> int:
        """The last sample before a rest at which the wire was still a good way from it; the rest's first, where it
        never was."""
        measured_m = self.logs.measured_m[number]
        away_m = np.abs(measured_m[: rest.start] - measured_m[rest.start])
        moving = np.flatnonzero(away_m > ON_ITS_WAY * self._full_stroke_m)
        return int(moving[-1]) if len(moving) else rest.start


def _range_Ohm(logs: Prepared) -> float:
    return float(max(np.subtract(*np.nanpercentile(t.resistance_Ohm, (99.5, 0.5))) for t in logs.experiments))
