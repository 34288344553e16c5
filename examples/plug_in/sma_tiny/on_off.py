"""A control law: all current above the setpoint, none below."""

from __future__ import annotations

from dataclasses import dataclass

from sma_actuator.base.parameters import parameter
from sma_actuator.control import CONTROL_LAWS, ControllerParameters
from sma_actuator.control.law import LawSections


@CONTROL_LAWS.register("on_off")
@dataclass(frozen=True, slots=True)
class OnOffParameters(ControllerParameters):
    """The section ``controller`` with ``type: on_off``."""

    band: float = parameter(
        1e-4, "distance from the setpoint within which nothing is switched", "m", 0.0, 1.0, live="either"
    )

    def build(self, sections: LawSections) -> OnOff:
        """The law with this band."""
        return OnOff(self, sections.supply.bias_current)


class OnOff:
    """A heated wire contracts, so the current is on where it hangs too low."""

    rate_limited = False

    def __init__(self, parameters: OnOffParameters, bias_A: float):
        self._parameters, self._bias_A = parameters, bias_A
        self.reset(0.0, bias_A)

    def reset(self, position_m: float, output_A: float) -> None:
        """Start at a position and a current."""
        self.reference_m, self.output_A = position_m, output_A
        self.at_max = self.at_bias = False

    def set_gains(self, gains: OnOffParameters) -> None:
        """Take over the band."""
        self._parameters = gains

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """The limit, the bias, or what it was."""
        self.reference_m = setpoint_m
        if position_m > setpoint_m + self._parameters.band:
            self.output_A = limit_A
        elif not position_m >= setpoint_m - self._parameters.band:
            self.output_A = self._bias_A
        self.output_A = min(self.output_A, limit_A)
        self.at_max, self.at_bias = self.output_A == limit_A, self.output_A == self._bias_A
        return self.output_A
