"""How far an estimate may be off: from its calibration, and from how it began.

Half of a 95 % interval.  A model of the whole range says it by itself; of the others it has two parts.  What the model
leaves on its own calibration logs, at this place and branch: the mean residual and twice the scatter about it.  And
where on its loop the wire is: after the output was off a measurement at the bias current tells the resistance, and the
wire may be anywhere between the heating and the cooling curve there; as it moves, the loop forgets where it began, and
so does this.  Of any model that was calibrated on a wire in training: how far that has moved since.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import exp, hypot, isfinite, nan

import numpy as np

from sma_actuator.base.calibration import Calibration, unknown_since_then_m
from sma_actuator.base.signals import Branch, Estimate, Quality, Signals

from .models import StrainModel, ThermalStrainModel

#: Motion, as a share of the working range, after which a third is left of what was not known at the beginning.
FORGOTTEN_SHARE = 0.15


class Uncertainty:
    """Of one wire's estimate; remembers how much is left of what was not known when it began."""

    def __init__(self, model: StrainModel | ThermalStrainModel, calibration: Calibration):
        left = calibration.interval
        self._since_then_m = unknown_since_then_m(calibration.training)
        #: None where the model says it by itself.
        self._model = None if isinstance(model, ThermalStrainModel) else model
        low_m, high_m = model.displacement_range_m
        self._forgotten_m = FORGOTTEN_SHARE * (high_m - low_m)
        self._unknown_share = 1.0  #: of the loop's width
        self._before_m = nan  #: the displacement of the sample before, NaN after a gap
        self._position_m = tuple(left.residual_position)
        stresses = len(left.residual_stress)
        #: From one stress on, the next is nearer.
        self._between_Pa = [0.5 * (low + high) for low, high in pairwise(left.residual_stress)]
        self._tables_m = (
            {
                Branch.HEATING: (
                    np.reshape(left.residual_heating, (stresses, -1)).tolist(),
                    tuple(left.scatter_heating),
                ),
                Branch.COOLING: (
                    np.reshape(left.residual_cooling, (stresses, -1)).tolist(),
                    tuple(left.scatter_cooling),
                ),
            }
            if len(self._position_m)
            else {}
        )

    def step(self, signals: Signals, estimate: Estimate) -> float:
        """Half of the 95 % interval of one sample [m]; NaN where nothing is known."""
        if estimate.quality is Quality.INVALID:
            self._before_m = nan
            return nan
        if self._model is None or not self._tables_m:
            return estimate.uncertainty_m + self._since_then_m
        position_m = estimate.displacement_m
        if isfinite(self._before_m):
            self._unknown_share *= exp(-abs(position_m - self._before_m) / self._forgotten_m)
        else:
            self._unknown_share = 1.0
        self._before_m = position_m
        heating_m, cooling_m = self._model.limits_m(signals.resistance_Ohm, signals.stress_Pa)
        width_m = max(abs(position_m - heating_m), abs(position_m - cooling_m))
        usual_m = hypot(self._of_calibration(estimate, signals.stress_Pa), self._unknown_share * width_m)
        return usual_m + self._since_then_m

    def _of_calibration(self, estimate: Estimate, stress_Pa: float) -> float:
        residual_m, scatter_m = self._tables_m[estimate.branch]
        position_m = estimate.displacement_m
        mean_m = abs(_interpolated(position_m, self._position_m, residual_m[bisect_left(self._between_Pa, stress_Pa)]))
        return mean_m + 2.0 * _interpolated(position_m, self._position_m, scatter_m)


def _interpolated(x: float, known: Sequence[float], values: Sequence[float]) -> float:
    """Between the known places linear, beyond them as at the last; for one float faster than numpy's."""
    right = bisect_right(known, x)
    if right == 0 or right == len(known):
        return values[max(right - 1, 0)]
    share = (x - known[right - 1]) / (known[right] - known[right - 1])
    return values[right - 1] + share * (values[right] - values[right - 1])
