"""The power that it takes to transform the wire, against the heat balance of its calibration."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.remembered import Remembered
from sma_actuator.calibration.power import passages, warmer_K
from sma_actuator.config import Config
from sma_actuator.diagnosis.trace.limits import LIMITS
from sma_actuator.diagnosis.trace.prediction import Prediction
from sma_actuator.diagnosis.trace.prepared import Prepared

from .witness import Witness


class Power(Witness):
    """How much warmer than at the calibration the heat balance calls the wire in each passage, a row each."""

    names = ("power in the transformation",)

    def __init__(self, logs: Prepared, config: Config, calibration: Calibration):
        self.logs, self.calibration = logs, calibration
        # where none is logged, it is that until an effect says otherwise
        usual_C = calibration.usual_ambient_C(config.thermal.ambient_temperature)
        self._thermal = dataclasses.replace(config.thermal, ambient_temperature=usual_C)
        self._passages = [self._found(number) for number in range(len(logs.experiments))]
        self._remembered = Remembered()
        units = [int(logs.unit[i][rows[0]]) for i, found in enumerate(self._passages) for _, rows in found]
        self.row_units = np.array(units, dtype=int)
        self.row_names = np.zeros(len(units), dtype=int)

    @property
    def known(self) -> bool:
        """Whether the calibration says what it takes to transform the wire, and how surely."""
        usual = self.calibration.power
        sure = math.isfinite(usual.transformation_scatter) and len(usual.transformation_speed) == 4
        return self.calibration.transformation_known and sure

    def _found(self, number: int) -> list[tuple[bool, np.ndarray]]:
        """Where a log's power is held against the calibration's: see :func:`passages`."""
        if not self.known:
            return []
        stress_Pa = self.logs.experiments[number].stress_Pa
        return passages(self.calibration.share_of_stroke(self.logs.measured_m[number], stress_Pa))

    def off(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How much warmer, in standard deviations, shape (passages,)."""
        out = [np.empty(0)]
        for number, (found, p) in enumerate(zip(self._passages, predictions, strict=True)):
            if found:  # a quarter of the steps of a fit leave it as it was
                decides = np.full(1, number), p.heat_W, p.beside_m, p.stress_Pa
                out.append(self._remembered.of(partial(self._off, number, p), *decides))
        return np.concatenate(out)

    def _off(self, number: int, p: Prediction) -> np.ndarray:
        """The same of one log."""
        found, c, curves = self._passages[number], self.calibration, self.calibration.power
        signals = dataclasses.replace(self.logs.experiments[number].signals, stress_Pa=p.stress_Pa)
        share = c.share_of_stroke(self.logs.measured_m[number] - p.beside_m, p.stress_Pa)
        off_K, ahead = warmer_K(signals, p.heat_W, share, curves, self._thermal, found)
        usual = np.mean(np.reshape(curves.transformation_speed, (2, 2)), axis=1)[[int(heating) for heating, _ in found]]
        rise_K = np.mean([*curves.transformation_heating, *curves.transformation_cooling])
        rise_K -= self._thermal.ambient_temperature
        known_K = math.hypot(curves.transformation_scatter, LIMITS.heat_balance * rise_K)
        # What rests on the latent heat is as unknown as that at another speed than the one at which it was learned.
        return off_K / np.hypot(known_K, curves.latent_rise * (ahead - usual))
