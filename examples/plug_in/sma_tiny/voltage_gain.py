"""An effect: the channel of the supply voltage has another slope than it is taken for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter
from sma_actuator.estimation.effects import EFFECTS, Effect
from sma_actuator.estimation.effects.frame import Frame, Place
from sma_actuator.estimation.effects.free import Free, Scales, size


@EFFECTS.register("voltage_gain")
@dataclass(frozen=True, slots=True)
class VoltageGain(Effect):
    """The channel of the supply voltage shows (1 + gain) of what there is."""

    PART = "circuit"
    WORDS = "the channel of the supply voltage shows too much or too little in proportion"
    REMEDY = "Measure the supply voltage with a meter beside the channel, and let the DAQ calibrate its slope."
    TELL_TALE = "resistance_Ohm"
    gain: float = parameter(0.0, "voltage shown over the true one, less one", "1", -0.5, 1.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Measure with the voltage that there is; the current comes from another channel."""
        beside_Ohm = place.reference_resistance_Ohm + place.lead_resistance_Ohm
        frame.resistance_Ohm = (frame.resistance_Ohm + beside_Ohm) / (1.0 + self.gain) - beside_Ohm
        frame.power_W = frame.current_A**2 * frame.resistance_Ohm

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("gain", 0.3, 0.02)]
