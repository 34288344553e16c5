"""What the last readings measure of the circuit itself: its power, the drift of the load cell, the resistance of the
leads."""

from __future__ import annotations

import collections
from collections.abc import Collection
from math import nan

from sma_actuator.base.signals import Reading
from sma_actuator.config import Config
from sma_actuator.estimation.circuit import is_driven

#: Readings that a measurement averages, at the most.
AVERAGED_READINGS = 20
#: And at the least.
FEWEST_READINGS = 3
#: Share of the load at wire.max_stress that may be tared away: drift of a load cell, not a load.
MOST_TARE = 0.1


class Measured:
    """The last readings, and the tare [N] that was made of them."""

    def __init__(self) -> None:
        self.tare_N = 0.0
        self.power_W = 0.0  #: of wire, leads and leaks: the heat balance errs on the hot side
        #: Loads of the last readings, as they would be without a tare.
        self._loads_N: collections.deque[float] = collections.deque(maxlen=AVERAGED_READINGS)
        #: Those with current since the output went on; they outlast it.
        self._with_current: collections.deque[Reading] = collections.deque(maxlen=AVERAGED_READINGS)

    def enabled(self) -> None:
        """The output goes on: the leads are measured anew."""
        self._with_current.clear()

    def note(self, reading: Reading, current_A: float, load_N: float, bias_current_A: float) -> None:
        """Take a reading, and its current [A] and load [N] with the tare taken off."""
        self._loads_N.append(load_N + self.tare_N)
        self.power_W = 0.0
        if is_driven(current_A, bias_current_A):
            self.power_W = current_A * max(reading.supply_voltage_V - reading.reference_voltage_V, 0.0)
            self._with_current.append(reading)

    def tare(self, config: Config, fresh: bool) -> tuple[bool, str]:
        """Take the mean load for zero, where the last reading is ``fresh``; whether that was done, and a sentence."""
        if len(self._loads_N) < FEWEST_READINGS or not fresh:
            return False, f"not tared: {FEWEST_READINGS} readings of just now are wanted"
        wire = config.wire
        load_N = sum(self._loads_N) / len(self._loads_N)
        bound_N = MOST_TARE * wire.max_stress * wire.area_m2
        if not abs(load_N) <= bound_N:
            why = (
                f"not tared: {load_N:.3g} N is more than the drift of a load cell (up to {bound_N:.3g} N); take "
                "the load off"
            )
            return False, why
        self.tare_N = load_N
        return True, f"tared: {load_N:.4f} N count as zero from now on"

    def lead_resistance(self, config: Config) -> tuple[bool, str, float]:
        """Whether it could be measured with a short in place of the wire, a sentence, and the resistance [Ω]."""
        readings = self._with_current
        if len(readings) < FEWEST_READINGS:
            why = (
                f"not measured: {len(readings)} readings with current since the output went on, {FEWEST_READINGS} "
                "are wanted; put a short in place of the wire and call ~/enable"
            )
            return False, why, nan
        ratio = _sum(readings, "supply_voltage_V") / _sum(readings, "reference_voltage_V")
        total_Ohm = config.circuit.reference_resistance * (ratio - 1.0)
        most_Ohm = config.safety.resistance_min + config.circuit.lead_resistance
        if not 0.0 <= total_Ohm < most_Ohm:
            why = (
                f"not measured: {total_Ohm:.4g} Ω is not that of leads (0 to {most_Ohm:.4g} Ω); "
                "is there a short in place of the wire?"
            )
            return False, why, nan
        return True, f"the leads have {total_Ohm:.4f} Ω; write it to circuit.lead_resistance", total_Ohm


def _sum(readings: Collection[Reading], channel: str) -> float:
    return sum(getattr(reading, channel) for reading in readings)
