"""What the surroundings of a wire are taken for, whatever their sensor reads."""

from __future__ import annotations

import math

from sma_actuator.base.sections import ThermalParameters

#: Surroundings no wire is driven in [°C]; a sensor that reads more is not believed.
HOTTEST_AMBIENT_C = 100.0
#: A sensor that falls below the usual temperature is followed at this rate: surroundings cool no faster.
AMBIENT_FALL_K_s = 0.1


class Ambient:
    """What the surroundings are taken for, from a sensor that may be broken and the parameters.

    Too warm only costs current, too cold costs the wire: a sensor is followed upwards at once,
    downwards slowly and not far.
    """

    def __init__(self, parameters: ThermalParameters):
        self.temperature_C = parameters.ambient_temperature
        self.doubt = ""  #: why the sensor is not believed
        self._was_believed = False  #: it has been, in this run
        self._read_C = math.nan
        self._stands_s = 0.0

    def step(self, read_C: float, dt_s: float, parameters: ThermalParameters) -> float:
        """Advance by ``dt_s`` with what a sensor reads, NaN where there is none; the temperature to reckon with
        [°C]."""
        dt_s = dt_s if 0.0 <= dt_s < math.inf else 0.0
        self._stands_s = self._stands_s + dt_s if read_C == self._read_C else 0.0
        self._read_C = read_C
        usual_C = parameters.ambient_temperature
        self.doubt = "" if math.isnan(read_C) else self._doubt(read_C, parameters)
        is_believed = not (self.doubt or math.isnan(read_C))
        self._was_believed = self._was_believed or is_believed
        believed_C = read_C if is_believed else usual_C
        is_broken = self._was_believed and not is_believed
        from_C = self.temperature_C if is_broken else min(self.temperature_C, usual_C)  # a sensor breaks, a room stays
        self.temperature_C = max(believed_C, from_C - AMBIENT_FALL_K_s * dt_s)
        return self.temperature_C

    def _doubt(self, read_C: float, parameters: ThermalParameters) -> str:
        usual_C, tolerance_K = parameters.ambient_temperature, parameters.ambient_tolerance
        if not read_C <= HOTTEST_AMBIENT_C:
            return f"it reads {read_C:.4g} °C; up to {HOTTEST_AMBIENT_C:g} °C is plausible"
        if not read_C >= usual_C - tolerance_K:
            return (
                f"it reads {read_C:.4g} °C; thermal.ambient_temperature is {usual_C:g} °C and "
                f"thermal.ambient_tolerance {tolerance_K:g} K"
            )
        if read_C < usual_C and self._stands_s > parameters.ambient_stuck_time:
            return (
                f"it reads {read_C:.4g} °C for {self._stands_s:.0f} s to the last digit; thermal.ambient_stuck_time is "
                f"{parameters.ambient_stuck_time:g} s"
            )
        return ""
