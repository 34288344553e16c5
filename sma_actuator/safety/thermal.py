"""How hot the wire must be, from the power that was measured in it.

Lumped heat balance ``C dT/dt = P − h (T − T_amb)``.  Latent heat is left out, so the answer errs
on the hot side while the wire transforms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sma_actuator.base.parameters import parameter


@dataclass(frozen=True, slots=True)
class ThermalParameters:
    """Heat balance on measured power, C dT/dt = P − h (T − T_ambient), latent heat left out (so it errs hot)."""

    heat_capacity: float = parameter(description="heat capacity of the wire", unit="J/K", lo=1e-6, hi=1e3)
    heat_loss: float = parameter(description="heat lost per kelvin above ambient", unit="W/K", lo=1e-6, hi=1e2)
    ambient_temperature: float = parameter(
        24.0, "temperature of the surroundings where none is measured", "°C", -60.0, 100.0, live=True
    )
    derate_temperature: float = parameter(
        160.0, "estimated temperature where the current limit starts to fall", "°C", 40.0, 400.0, live=True
    )
    max_temperature: float = parameter(200.0, "estimated temperature that is a fault", "°C", 40.0, 400.0, live=True)


class HeatBalance:
    """Temperature of a wire, stepped exactly for power that is constant over the step."""

    __slots__ = ("temperature_C",)

    def __init__(self, temperature_C: float):
        self.temperature_C = temperature_C

    def step(self, power_W: float, dt_s: float, ambient_C: float, parameters: ThermalParameters) -> float:
        """Advance by ``dt_s`` ≥ 0 and return the temperature [°C].

        Exact: ``T ← T_∞ + (T − T_∞) exp(−h dt / C)`` with ``T_∞ = T_amb + P/h``.  Arguments that
        are not finite leave the temperature as it is: a gap in the readings cannot cool the wire.
        """
        if not (math.isfinite(power_W) and 0.0 <= dt_s < math.inf and math.isfinite(ambient_C)):
            return self.temperature_C
        settled_C = ambient_C + power_W / parameters.heat_loss
        decay = math.exp(-dt_s * parameters.heat_loss / parameters.heat_capacity)
        self.temperature_C = settled_C + (self.temperature_C - settled_C) * decay
        return self.temperature_C


def derated_limit_A(
    temperature_C: float, max_current_A: float, bias_current_A: float, parameters: ThermalParameters
) -> float:
    """Highest current allowed at a temperature [A].

    ``max_current_A`` up to ``derate_temperature``, falling linearly to ``bias_current_A`` at
    ``max_temperature``; the bias also where the temperature is not a number.
    """
    if temperature_C <= parameters.derate_temperature:
        return max_current_A
    if not temperature_C < parameters.max_temperature:
        return bias_current_A
    span_C = parameters.max_temperature - parameters.derate_temperature
    return bias_current_A + (max_current_A - bias_current_A) * (parameters.max_temperature - temperature_C) / span_C
