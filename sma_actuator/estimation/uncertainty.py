"""How far an estimate may be off: from its calibration, and from how it began.

Half of a 95 % interval.  A model of the whole range says it by itself; of the others it has two parts.  What the model
leaves on its own calibration logs, at this place and branch: the mean residual and twice the scatter about it.  And
where on its loop the wire is: after the output was off a measurement at the bias current tells the resistance, and the
wire may be anywhere between the heating and the cooling curve there; as it moves, the loop forgets where it began, and
so does this.  Of any model: how far a wire in training has moved since it was calibrated; and where the model does not
follow it, how far off one may be on which another load hung before (:class:`OtherLoad`).
"""

from __future__ import annotations

from itertools import pairwise
from math import exp, hypot, isfinite, nan

import numpy as np

from sma_actuator.base.calibration import Calibration, unknown_since_then_m
from sma_actuator.base.jit import Floats, floats, jit
from sma_actuator.base.lookup import places_below, row_of, values_of
from sma_actuator.base.signals import Estimate, Quality, Signals

from .models import StrainModel, ThermalStrainModel
from .other_load import OtherLoad, apart_m

#: Motion, as a share of the working range, after which a third is left of what was not known at the beginning.
FORGOTTEN_SHARE = 0.15
#: What is remembered: how much of the loop's width is not known, and the displacement of the sample before, NaN after a
#: gap.
_SHARE, _BEFORE_m = range(2)


class Uncertainty:
    """Of one wire's estimate; remembers how much is left of what was not known when it began."""

    def __init__(self, model: StrainModel | ThermalStrainModel, calibration: Calibration):
        left = calibration.interval
        self._since_then_m = unknown_since_then_m(calibration.training)
        #: None where the model says it by itself.
        self._model = None if isinstance(model, ThermalStrainModel) else model
        follows = isinstance(model, ThermalStrainModel) and model.follows_loads
        self._other_load = OtherLoad(Calibration() if follows else calibration)
        low_m, high_m = model.displacement_range_m
        self._forgotten_m = FORGOTTEN_SHARE * (high_m - low_m)
        self._state = floats(2)
        self._state[:] = 1.0, nan
        stresses, places_m = len(left.residual_stress), left.residual_position
        #: From one stress on, the next is nearer.
        self._between_Pa = floats(max(stresses - 1, 0))
        self._between_Pa[:] = [0.5 * (low + high) for low, high in pairwise(left.residual_stress)]
        #: Of the cooling branch (:class:`Branch`), then of the heating one: what is left, stress after stress, and the
        #: scatter.
        self._tables = row_of(
            *(
                (places_m, values_m)
                for residual_m, scatter_m in (
                    (left.residual_cooling, left.scatter_cooling),
                    (left.residual_heating, left.scatter_heating),
                )
                for values_m in (*np.reshape(residual_m, (stresses, -1)).tolist(), scatter_m)
            )
            if places_m
            else ()
        )

    def step(self, signals: Signals, estimate: Estimate) -> float:
        """Half of the 95 % interval of one sample [m]; NaN where nothing is known."""
        if estimate.quality is Quality.INVALID:
            self._state[_BEFORE_m] = nan
            return nan
        place_m, stress_Pa, other = estimate.displacement_m, signals.stress_Pa, self._other_load
        if self._model is None or not len(self._tables):
            return estimate.uncertainty_m + (self._since_then_m + other.step(signals.time_s, stress_Pa, place_m))
        heating_m, cooling_m = self._model.limits_m(signals.resistance_Ohm, stress_Pa)
        left_m, began_m, loaded_m = _parts_m(
            self._state,
            self._tables,
            self._between_Pa,
            place_m,
            stress_Pa,
            int(estimate.branch),
            heating_m,
            cooling_m,
            self._forgotten_m,
            signals.time_s,
            other.row,
            other.state,
        )
        return hypot(left_m, began_m) + (self._since_then_m + loaded_m)


@jit
def _parts_m(
    state: Floats,
    tables: Floats,
    between_Pa: Floats,
    position_m: float,
    stress_Pa: float,
    branch: int,
    heating_m: float,
    cooling_m: float,
    forgotten_m: float,
    time_s: float,
    loads: Floats,
    loaded: Floats,
) -> tuple[float, float, float]:
    """What the model leaves at a position; what is not known of where on its loop the wire is, whose branches are at
    ``heating_m`` and ``cooling_m``; and what another load may have left, by row and state of :class:`OtherLoad`."""
    if isfinite(state[_BEFORE_m]):
        state[_SHARE] *= exp(-abs(position_m - state[_BEFORE_m]) / forgotten_m)
    else:
        state[_SHARE] = 1.0
    state[_BEFORE_m] = position_m
    width_m = max(abs(position_m - heating_m), abs(position_m - cooling_m))
    stresses = len(between_Pa) + 1
    first, nearest = branch * (stresses + 1), 0
    while nearest < stresses - 1 and between_Pa[nearest] < stress_Pa:
        nearest += 1
    mean_m = abs(_left_m(tables, first + nearest, position_m))
    left_m = mean_m + 2.0 * _left_m(tables, first + stresses, position_m)
    return left_m, state[_SHARE] * width_m, apart_m(loads, loaded, time_s, stress_Pa, position_m)


@jit
def _left_m(tables: Floats, table: int, position_m: float) -> float:
    """Between the known places linear, beyond them as at the last."""
    values, count = values_of(tables, table)
    right, place = places_below(tables, table, position_m), values - count
    if right == 0 or right == count:
        return tables[values + max(right - 1, 0)]
    share = (position_m - tables[place + right - 1]) / (tables[place + right] - tables[place + right - 1])
    return tables[values + right - 1] + share * (tables[values + right] - tables[values + right - 1])
