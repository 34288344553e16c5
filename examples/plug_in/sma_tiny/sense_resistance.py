"""An effect: the sense resistor is not what the configuration says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter
from sma_actuator.estimation.effects import EFFECTS, Effect
from sma_actuator.estimation.effects.frame import Frame, Place
from sma_actuator.estimation.effects.free import Free, Scales, size


@EFFECTS.register("sense_resistance")
@dataclass(frozen=True, slots=True)
class SenseResistance(Effect):
    """The sense resistor has (1 + gain) of the resistance that the configuration gives it."""

    PART = "circuit"
    WORDS = "the sense resistor has another resistance than circuit.reference_resistance says"
    REMEDY = "Measure the sense resistor and write what it has into circuit.reference_resistance."
    TELL_TALE = "resistance_Ohm"
    gain: float = parameter(0.0, "resistance of the sense resistor over the configured one, less one", "1", -0.5, 1.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Measure with the resistance that it has."""
        whole_Ohm = (frame.resistance_Ohm + place.lead_resistance_Ohm) * (1.0 + self.gain)
        frame.resistance_Ohm = whole_Ohm - place.lead_resistance_Ohm
        frame.current_A = frame.current_A / (1.0 + self.gain)
        frame.power_W = frame.current_A**2 * frame.resistance_Ohm

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("gain", 0.3, 0.02)]
