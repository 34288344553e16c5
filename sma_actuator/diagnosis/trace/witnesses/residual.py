"""The displacement all along, against what the calibration lets expect of the model's error there and with that
history."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from sma_actuator.base.calibration import SINCE_THEN, SINCE_THEN_WITHIN, Calibration, left_in_place
from sma_actuator.base.remembered import Remembered
from sma_actuator.calibration.expectation import Expectation, always_so_m
from sma_actuator.calibration.interval import INTERVAL
from sma_actuator.calibration.rest import SPREAD
from sma_actuator.config import Config
from sma_actuator.diagnosis.trace.prediction import Prediction
from sma_actuator.diagnosis.trace.prepared import Prepared
from sma_actuator.estimation.chain import Chain, Judged
from sma_actuator.estimation.effects.frame import Frame, Place

#: Floor of a model whose file does not say how good it was, % of full stroke.
FLOOR_percent = 1.5


class Residual:
    """Measured less shown displacement of the samples compared, a row each."""

    names = ("residual",)

    def __init__(
        self,
        logs: Prepared,
        config: Config,
        calibration: Calibration,
        place: Place,
        chain: Chain,
    ):
        """It knows no floor until :meth:`take_floor` or :meth:`take_typical`.

        ``chain``: of the model as it is.
        """
        self.logs, self.calibration, self._place = logs, calibration, place
        self._full_stroke_m = config.wire.full_stroke_m
        self._says_how_sure = chain.says_how_sure
        expected = calibration.expectation.known and not self._says_how_sure
        #: What the calibration expects; a model that says itself how sure it is has left nothing to expect.
        self.expectation = Expectation(config) if expected else None
        followed = logs.followed_by(chain) if expected else ()
        #: Of every log, what the strain model sees now.
        self._as_it_is = [dataclasses.replace(p.signals, resistance_Ohm=p.resistance_Ohm) for p in followed]
        self._model, self._always_so = Chain(config, {}), Remembered()
        self.floor_m: list[np.ndarray] = []
        self.row_units = np.concatenate([each[rows] for each, rows in zip(logs.unit, logs.compared, strict=True)])
        self.row_names = np.zeros(len(self.row_units), dtype=int)

    def take_floor(self, chain: Chain) -> None:
        """Mean absolute size of what is left beside what is expected [m], of every sample compared, where the wire was
        by a chain."""
        self.floor_m = []
        for i, (p, here) in enumerate(zip(self.logs.followed_by(chain), self.logs.compared_seen, strict=True)):
            floor_m = self._floor_m(i, p, here)
            self.floor_m.append(np.hypot(floor_m, SINCE_THEN_WITHIN * self._changed_m(p)[here]))

    def _floor_m(self, number: int, found: Judged, here: np.ndarray) -> np.ndarray:
        """The same of a wire that did not change while it was calibrated, of the samples ``here`` of a log."""
        if self._says_how_sure:
            return found.uncertainty_m[here] / (INTERVAL * SPREAD)
        if self.expectation is None:
            c = self.calibration
            percent = max(c.error, c.largest_error) if c.known else FLOOR_percent
            return np.full(len(here), percent / 100 * self._full_stroke_m)
        return np.hypot(self.expectation.floor_m(found, here), self._always_so_m(number, found)[here])

    def take_one_floor(self) -> None:
        """Take the floor's root mean square everywhere."""
        self._take_everywhere(_rms(self.floor_m))

    def take_typical(self, predictions: Sequence[Prediction]) -> None:
        """As a floor, what the model as it is leaves: for what is looked for in that itself."""
        self._take_everywhere(_rms(self.unexpected_m(predictions)) / SPREAD)

    def _take_everywhere(self, typical_m: float) -> None:
        self.floor_m = [np.full(len(rows), typical_m) for rows in self.logs.compared]

    def expected_m(self, number: int, found: Judged, here: np.ndarray, ambient_counts: bool) -> np.ndarray:
        """Residual that is expected, of n samples of a log; known at the samples ``here``, with straight lines between
        them."""
        since_m = SINCE_THEN * self._changed_m(found)
        if self.expectation is None:
            return since_m
        usual_m = self.expectation.residual_m(found, here, ambient_counts)
        expected_m = np.interp(found.time_s, found.time_s[here], usual_m)
        return expected_m + self._always_so_m(number, found) + since_m

    def _always_so_m(self, number: int, found: Judged) -> np.ndarray:
        """How far the model is from half the way to one whose load was always what it is, by the loads of its
        calibration, of n samples of a log: under the load that it sees now, for what a load cell shows too much never
        hung there; and at the resistance of the model as it is, which hardly changes what another load does."""
        load_N, stress_Pa = found.signals.load_N, found.signals.stress_Pa
        seen = dataclasses.replace(self._as_it_is[number], load_N=load_N, stress_Pa=stress_Pa)
        loads_Pa = np.array(self.calibration.interval.residual_stress)
        return self._always_so.of(lambda: always_so_m(seen, self._model, loads_Pa), np.array([number]), stress_Pa)

    def _changed_m(self, found: Judged) -> np.ndarray:
        """How far the wire moved while it was calibrated, where it is now, of n samples: the hot end most."""
        if not self.calibration.training.changed:  # of most wires, and every step of every fit asks
            return np.zeros(len(found.time_s))
        frame = Frame.of(found.signals, float(found.time_s[0]))
        frame.displacement_m = found.model_m
        share = self._place.share_of_stroke(frame)
        return self.calibration.training.changed * np.nan_to_num(left_in_place(share), nan=1.0)

    def unexpected_m(self, predictions: Sequence[Prediction]) -> list[np.ndarray]:
        """Measured less shown displacement beyond what the calibration lets expect, of the samples compared, log by
        log."""
        return [
            (measured_m - p.shown_m)[rows] - p.expected_m
            for measured_m, p, rows in zip(self.logs.measured_m, predictions, self.logs.compared, strict=True)
        ]

    def off(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How far off each sample is, in standard deviations of what is left at such a place, shape (samples
        compared,)."""
        return np.concatenate(
            [
                unexpected_m / (SPREAD * floor_m)
                for unexpected_m, floor_m in zip(self.unexpected_m(predictions), self.floor_m, strict=True)
            ]
        )


def _rms(values: Sequence[np.ndarray]) -> float:
    return math.sqrt(np.mean(np.concatenate(values) ** 2))
