"""What the measuring circuit may do to the resistance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter

from .effect import Effect
from .frame import Frame, Place


def _set(frame: Frame, resistance_Ohm, current_A) -> None:
    frame.resistance_Ohm, frame.current_A = resistance_Ohm, current_A
    frame.power_W = current_A**2 * resistance_Ohm


@dataclass(frozen=True, slots=True)
class LeadResistance(Effect):
    """The leads have more (or less) resistance than ``circuit.lead_resistance``: R moves by a constant."""

    STAGE = "circuit"
    STATES = 0
    resistance: float = parameter(0.0, "lead resistance beyond circuit.lead_resistance", "Ω", -100.0, 100.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the excess off."""
        _set(frame, frame.resistance_Ohm - self.resistance, frame.current_A)


@dataclass(frozen=True, slots=True)
class ContactDrift(Effect):
    """A contact or lead whose resistance moves with time: ``r (1 − e^(−t/τ))`` since the session began."""

    STAGE = "circuit"
    STATES = 0
    resistance: float = parameter(0.0, "change of the lead resistance in the end", "Ω", -100.0, 100.0)
    time_constant: float = parameter(1e3, "how slowly it comes", "s", 1.0, 1e7)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the change so far off."""
        change_Ohm = -self.resistance * np.expm1(-frame.elapsed_s / self.time_constant)
        _set(frame, frame.resistance_Ohm - change_Ohm, frame.current_A)


@dataclass(frozen=True, slots=True)
class VoltageOffset(Effect):
    """Zero error of a voltage channel, referred to the supply voltage: the error of R is u/I."""

    STAGE = "circuit"
    STATES = 0
    offset: float = parameter(0.0, "zero error of the supply-voltage channel", "V", -10.0, 10.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the offset off the voltage."""
        with np.errstate(divide="ignore", invalid="ignore"):
            _set(frame, frame.resistance_Ohm - self.offset / frame.current_A, frame.current_A)


@dataclass(frozen=True, slots=True)
class ReferenceSelfHeating(Effect):
    """The sense resistor heats itself: ``R_ref (1 + k P_lagged)``, with its own dissipation ``P = I² R_ref``."""

    STAGE = "circuit"
    STATES = 2
    coefficient: float = parameter(0.0, "relative change of the sense resistor per watt in it", "1/W", -10.0, 10.0)
    time_constant: float = parameter(20.0, "its thermal lag", "s", 0.01, 1e5)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Measure with the resistance that the sense resistor has now."""
        dissipated_W = frame.current_A**2 * place.reference_resistance_Ohm
        factor = 1.0 + self.coefficient * frame.lag(dissipated_W, state, self.time_constant)
        # V_net/V_ref is what was measured: the wire and its leads against the sense resistor.
        beside_Ohm = frame.resistance_Ohm + place.lead_resistance_Ohm
        _set(frame, beside_Ohm * factor - place.lead_resistance_Ohm, frame.current_A / factor)


@dataclass(frozen=True, slots=True)
class Shunt(Effect):
    """A leak parallel to the wire; it also takes current that then does not heat the wire."""

    STAGE = "circuit"
    STATES = 0
    conductance: float = parameter(0.0, "conductance of the leak", "S", 0.0, 100.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Resistance and current of the wire alone."""
        share = 1.0 - frame.resistance_Ohm * self.conductance  # of the current goes through the wire
        share = np.where(share > 0.0, share, np.where(np.isnan(share), 1.0, np.nan))  # unknown: the current stays
        _set(frame, frame.resistance_Ohm / share, frame.current_A * share)
