"""Where resistance stops telling displacement: the wire that is contracted as far as it goes.

Up to there resistance falls as the wire heats and contracts.  Beyond, it rises with temperature, as
that of any metal, and a strain model takes the rise for extension: a controller that believed it
would heat the more, the hotter the wire.  So the sign of that feedback is looked up where the
calibration knows it.  A wire that has become austenite all through has the resistance that was
measured at the hot end, plus its slope times the temperature by the heat balance; one that has any
martensite left has more.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, isnan, nan
from typing import Protocol

import numpy as np

from sma_actuator.base.calibration import Calibration, interpolated
from sma_actuator.base.jit import Floats, jit
from sma_actuator.base.lookup import looked_up, row_of
from sma_actuator.base.sections import ThermalParameters

#: Shares of the calibration's range of resistance above that of the contracted wire, within which the wire counts as
#: contracted from now on, and beyond which it does no more.
ENTER, LEAVE = 0.015, 0.03


@jit
def is_contracted(
    row: Floats,
    stress: float,
    time: float,
    resistance: float,
    power: float,
    ambient: float,
    state: np.ndarray,
    line: np.ndarray,
) -> bool:
    """Whether the wire is contracted as far as it goes, in surroundings that are believed where they are about usual.

    ``row``: of a :class:`HotEnd`, the resistance of the contracted wire by stress, where it was calibrated; ``state`` =
    [time, temperature above ambient, contracted]; ``line`` = [heat loss, time constant, slope, its temperature, enter,
    leave, usual ambient, its tolerance].
    """
    if isnan(ambient) or abs(ambient - line[6]) > line[7]:
        ambient = line[6]
    step = max(time - state[0], 0.0) if state[0] == state[0] else 0.0
    settled = power / line[0]
    if state[0] != state[0]:
        state[1] = settled
    state[0] = time
    state[1] = settled + (state[1] - settled) * exp(-step / line[1])
    austenite = looked_up(row, 0, stress) + line[2] * (ambient + state[1] - line[3])
    state[2] = 1.0 if resistance - austenite < (line[5] if state[2] > 0.5 else line[4]) else 0.0
    return state[2] > 0.5


@jit
def _are_contracted(
    row: Floats,
    stress: np.ndarray,
    time: np.ndarray,
    resistance: np.ndarray,
    power: np.ndarray,
    ambient: np.ndarray,
    state: np.ndarray,
    line: np.ndarray,
    out: np.ndarray,
) -> None:
    for i in range(len(time)):
        out[i] = is_contracted(row, stress[i], time[i], resistance[i], power[i], ambient[i], state, line)


class HotEndSections(Protocol):
    """The parameters that tell where the hot end is."""

    @property
    def calibration(self) -> Calibration:
        """What the model's own logs looked like."""

    @property
    def thermal(self) -> ThermalParameters:
        """The heat balance."""


class HotEnd:
    """Says of each sample whether the wire is contracted as far as it goes; remembers its temperature.

    Without a calibration of the hot end it never says so.
    """

    def __init__(self, config: HotEndSections):
        hot_end = config.calibration.hot_end
        self.known = config.calibration.hot_end_known
        self._stress_Pa, self._displacement_m = hot_end.contracted_stress, hot_end.contracted_displacement
        self.row = row_of((self._stress_Pa, hot_end.contracted_resistance))
        self.state = np.zeros(3)
        self.update(config)
        self.reset()

    def update(self, config: HotEndSections) -> None:
        """Take over live parameters; the memory stays."""
        calibration, thermal = config.calibration, config.thermal
        self.line = np.array(
            [
                thermal.heat_loss,
                thermal.heat_capacity / thermal.heat_loss,
                max(calibration.hot_end.contracted_slope, 0.0),
                calibration.hot_end.contracted_temperature,
                ENTER * calibration.resistance_range,
                LEAVE * calibration.resistance_range,
                thermal.ambient_temperature,
                thermal.ambient_tolerance,
            ]
        )

    def reset(self) -> None:
        """Forget the past: the next sample is taken for one in thermal balance."""
        self.state[:] = nan, 0.0, 0.0

    def displacement_m(self, stress_Pa: float | np.ndarray) -> float | np.ndarray:
        """Where a wire is that is contracted as far as it goes."""
        line: Callable = interpolated if isinstance(stress_Pa, float) else np.interp
        return line(stress_Pa, self._stress_Pa, self._displacement_m)

    def run(
        self,
        time_s: np.ndarray,
        resistance_Ohm: np.ndarray,
        stress_Pa: np.ndarray,
        power_W: np.ndarray,
        ambient_C: np.ndarray,
    ) -> np.ndarray:
        """Of n samples, whether each is that of a contracted wire: arrays of shape (n,), bool."""
        contracted = np.empty(len(time_s), dtype=np.bool_)
        _are_contracted(
            self.row, stress_Pa, time_s, resistance_Ohm, power_W, ambient_C, self.state, self.line, contracted
        )
        return contracted
