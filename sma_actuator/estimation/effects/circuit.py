"""What the measuring circuit may do to the resistance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter

from .effect import EFFECTS, Effect
from .frame import Frame, Place
from .free import Free, Scales, shape, size


def _set(frame: Frame, resistance_Ohm: np.ndarray, current_A: np.ndarray) -> None:
    frame.resistance_Ohm, frame.current_A = resistance_Ohm, current_A
    frame.power_W = current_A**2 * resistance_Ohm


@EFFECTS.register("lead_resistance")
@dataclass(frozen=True, slots=True)
class LeadResistance(Effect):
    """The leads have more (or less) resistance than ``circuit.lead_resistance``: R moves by a constant."""

    PART = "circuit"
    WORDS = "the leads have another resistance than circuit.lead_resistance says"
    REMEDY = (
        "Measure the leads again with the wire short-circuited, or tighten what was changed in the wiring; until "
        "then the extended model takes it off."
    )
    TELL_TALE = "resistance_Ohm"
    resistance: float = parameter(0.0, "lead resistance beyond circuit.lead_resistance", "Ω", -100.0, 100.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take it off."""
        _set(frame, frame.resistance_Ohm - self.resistance, frame.current_A)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("resistance", 0.3 * scales.resistance_Ohm, 0.02 * scales.resistance_Ohm)]


@EFFECTS.register("contact_drift")
@dataclass(frozen=True, slots=True)
class ContactDrift(Effect):
    """A contact or lead whose resistance moves with time: ``r (1 − e^(−t/τ))`` since the session began."""

    PART = "circuit"
    WORDS = "a contact or a lead changes its resistance as time goes"
    REMEDY = "Tighten the clamp and clean the contacts; measure at the wire itself (four wires) where it comes back."
    TELL_TALE = "time_s"
    resistance: float = parameter(0.0, "change of the lead resistance in the end", "Ω", -100.0, 100.0)
    time_constant: float = parameter(1e3, "how slowly it comes", "s", 1.0, 1e7)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the change so far off."""
        change_Ohm = -self.resistance * np.expm1(-frame.elapsed_s / self.time_constant)
        _set(frame, frame.resistance_Ohm - change_Ohm, frame.current_A)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        slow_s = scales.duration_s
        return [
            size("resistance", 0.5 * scales.resistance_Ohm, 0.02 * scales.resistance_Ohm),
            shape(
                "time_constant",
                0.05 * slow_s,
                5.0 * slow_s,
                0.15 * slow_s,
                0.6 * slow_s,
                4.0 * slow_s,
                other_at=("low",),
            ),
        ]


@EFFECTS.register("voltage_offset")
@dataclass(frozen=True, slots=True)
class VoltageOffset(Effect):
    """Zero error of a voltage channel, referred to the supply voltage: the error of R is u/I."""

    PART = "circuit"
    WORDS = "a voltage channel has a zero error"
    REMEDY = (
        "Measure the channel with its input shorted and let the DAQ calibrate its zero; until then the extended "
        "model takes it off."
    )
    TELL_TALE = "inverse_current_1_A"
    offset: float = parameter(0.0, "zero error of the supply-voltage channel", "V", -10.0, 10.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the offset off the voltage."""
        with np.errstate(divide="ignore", invalid="ignore"):
            _set(frame, frame.resistance_Ohm - self.offset / frame.current_A, frame.current_A)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("offset", 0.2 * scales.voltage_V, 0.01 * scales.voltage_V)]


def _set_by_sense(frame: Frame, place: Place, factor: np.ndarray | float) -> None:
    """Measure with a sense resistor that has ``factor`` times the resistance it is taken for."""
    # V_net/V_ref is what was measured: the wire and its leads against the sense resistor.
    beside_Ohm = frame.resistance_Ohm + place.lead_resistance_Ohm
    _set(frame, beside_Ohm * factor - place.lead_resistance_Ohm, frame.current_A / factor)


def _no_sense_resistor(scales: Scales) -> str:
    """Why logs cannot show what one does; empty where there is one."""
    if scales.sense_Ohm > 0.0:
        return ""
    return "no circuit.reference_resistance: the current was not measured with a sense resistor"


@EFFECTS.register("sense_resistance")
@dataclass(frozen=True, slots=True)
class SenseResistance(Effect):
    """The sense resistor has another value than ``circuit.reference_resistance``: R and I are off in proportion."""

    PART = "circuit"
    WORDS = "the sense resistor has another resistance than circuit.reference_resistance says"
    REMEDY = (
        "Measure the sense resistor with four wires and set circuit.reference_resistance, or take one that ages less; "
        "until then the extended model allows for it."
    )
    TELL_TALE = "resistance_Ohm"
    change: float = parameter(0.0, "its resistance over circuit.reference_resistance, less one", "1", -0.9, 9.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Measure with the resistance that it has."""
        _set_by_sense(frame, place, 1.0 + self.change)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("change", 0.3, 0.02)]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return _no_sense_resistor(scales)


@EFFECTS.register("reference_self_heating")
@dataclass(frozen=True, slots=True)
class ReferenceSelfHeating(Effect):
    """The sense resistor heats itself: ``R_ref (1 + k P_lagged)``, with its own dissipation ``P = I² R_ref``."""

    PART = "circuit"
    WORDS = "the sense resistor warms with its own current"
    REMEDY = "Take a sense resistor of more watts or a smaller temperature coefficient, or cool the one there is."
    TELL_TALE = "power_lagged_10_s_W"
    STATES = 2
    coefficient: float = parameter(0.0, "relative change of the sense resistor per watt in it", "1/W", -10.0, 10.0)
    time_constant: float = parameter(20.0, "its thermal lag", "s", 0.01, 1e5)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Measure with the resistance that the sense resistor has now."""
        dissipated_W = frame.current_A**2 * place.reference_resistance_Ohm
        _set_by_sense(frame, place, 1.0 + self.coefficient * frame.lag(dissipated_W, state, self.time_constant))

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        dissipated_W = scales.current_A**2 * scales.sense_Ohm
        return [
            # A metal's resistance rises as it warms; that of the alloys for which it falls does so by too little to
            # show.
            size("coefficient", 0.3 / dissipated_W, 0.02 / dissipated_W, 0.0),
            # A resistor has more mass than a wire.
            shape("time_constant", max(3.0, 2.0 * scales.thermal_s), 100.0, 5.0, 20.0, 60.0, other_at=("low", "high")),
        ]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return _no_sense_resistor(scales)


@EFFECTS.register("shunt")
@dataclass(frozen=True, slots=True)
class Shunt(Effect):
    """A leak parallel to the wire; it also takes current that then does not heat the wire."""

    PART = "circuit"
    WORDS = "something conducts beside the wire"
    REMEDY = (
        "Look for what conducts beside the wire: a crimp that touches the frame, moisture, a second path through "
        "the load; take it away."
    )
    TELL_TALE = "resistance_Ohm"
    conductance: float = parameter(0.0, "conductance of the leak", "S", 0.0, 100.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Resistance and current of the wire alone."""
        share = 1.0 - frame.resistance_Ohm * self.conductance  # of the current goes through the wire
        share = np.where(share > 0.0, share, np.where(np.isnan(share), 1.0, np.nan))  # unknown: the current stays
        _set(frame, frame.resistance_Ohm / share, frame.current_A * share)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("conductance", 0.3 / scales.resistance_Ohm, 0.02 / scales.resistance_Ohm, 0.0)]
