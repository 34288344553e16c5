"""From raw channels to the wire's resistance, power, load and stress (thesis, ch. 3, app. A, B).

The functions work on one sample (floats) and on whole logs (arrays) alike.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from math import nan
from typing import Protocol

import numpy as np

from sma_actuator.base.parameters import parameter
from sma_actuator.base.sections import Wire
from sma_actuator.base.signals import MEASURABLE, Reading, Signals, Value


@dataclass(frozen=True, slots=True)
class Circuit:
    """The measuring circuit.  What it is made of has no default: with another's the wire's resistance would be
    false."""

    reference_resistance: float = parameter(
        nan, "sense resistor in series with the wire", "Ω", 1e-4, 1e3, optional=True
    )
    lead_resistance: float = parameter(0.0, "leads between the voltage taps and the wire", "Ω", 0.0, 100.0)


@dataclass(frozen=True, slots=True)
class LoadCell:
    """Calibration of the load cell."""

    slope: float = parameter(
        nan, "load per volt of the load cell's amplifier (thesis, A.1: 12.7297)", "N/V", -1e6, 1e6, optional=True
    )
    offset: float = parameter(nan, "load at zero volts", "N", -1e6, 1e6, optional=True)

    @property
    def calibrated(self) -> bool:
        """Whether a voltage tells a load."""
        return math.isfinite(self.slope) and math.isfinite(self.offset)


@dataclass(frozen=True, slots=True)
class ReferenceSensor:
    """A displacement sensor beside the wire, for identification only.  Without a slope: none."""

    slope: float = parameter(nan, "displacement per ampere of the LVDT (thesis, B.1)", "m/A", -1e3, 1e3, optional=True)
    offset: float = parameter(nan, "displacement at zero amperes", "m", -10.0, 10.0, optional=True)

    @property
    def fitted(self) -> bool:
        """Whether there is such a sensor."""
        return math.isfinite(self.slope) and math.isfinite(self.offset)


class CircuitSections(Protocol):
    """The parameters that make physical quantities of raw channels."""

    @property
    def wire(self) -> Wire:
        """The wire."""

    @property
    def circuit(self) -> Circuit:
        """The measuring circuit."""

    @property
    def load_cell(self) -> LoadCell:
        """The load cell."""

    @property
    def reference_sensor(self) -> ReferenceSensor:
        """The displacement sensor, where there is one."""


def _positive_or_nan(value: Value) -> Value:
    """NaN where ``value`` is not above zero, so that a division by it cannot be infinite."""
    if isinstance(value, np.ndarray):
        return np.where(value > 0.0, value, np.nan)
    return value if value > 0.0 else np.nan


def resistance_and_current(
    supply_voltage_V: Value, reference_voltage_V: Value, reference_resistance_Ohm: float, lead_resistance_Ohm: float
) -> tuple[Value, Value]:
    """Resistance of the wire [Ω] and current through it [A], eq. 3.3 and 3.4.

    Where the reference voltage is not above zero there is no current to measure with: the
    resistance is NaN there, never infinite.
    """
    ratio = supply_voltage_V / _positive_or_nan(reference_voltage_V)
    resistance_Ohm = reference_resistance_Ohm * (ratio - 1.0) - lead_resistance_Ohm
    return resistance_Ohm, reference_voltage_V / reference_resistance_Ohm


def signals_from_reading(reading: Reading, config: CircuitSections, tare_N: float | np.ndarray = 0.0) -> Signals:
    """Apply the calibrations of ``config`` to a reading.

    ``reading`` may hold floats or, for replay, arrays of shape (n,) in every field.
    ``tare_N`` is subtracted from the load (service ``~/tare_load``).
    """
    resistance_Ohm, current_A = resistance_and_current(
        reading.supply_voltage_V,
        reading.reference_voltage_V,
        config.circuit.reference_resistance,
        config.circuit.lead_resistance,
    )
    load_N = config.load_cell.slope * reading.load_cell_voltage_V + config.load_cell.offset - tare_N
    reference_m = config.reference_sensor.slope * reading.lvdt_current_A + config.reference_sensor.offset
    return Signals(
        reading.time_s,
        resistance_Ohm,
        current_A,
        current_A * current_A * resistance_Ohm,
        load_N,
        load_N / config.wire.area_m2,
        reference_m,
        reading.ambient_temperature_C,
        tare_N,
    )


def is_driven(current_A: Value, bias_current_A: float) -> bool | np.ndarray:
    """Whether there is current enough to measure a resistance with; of one sample or of n."""
    return current_A >= MEASURABLE * bias_current_A


def without_undriven(signals: Signals, bias_current_A: float) -> Signals:
    """Signals in which an undriven wire has no resistance: noise divided by noise is none.

    The one rule for the node and for logs of it; of one sample or of n.
    """
    driven = is_driven(signals.current_A, bias_current_A)
    if isinstance(driven, np.ndarray):
        return dataclasses.replace(
            signals,
            resistance_Ohm=np.where(driven, signals.resistance_Ohm, np.nan),
            power_W=np.where(driven, signals.power_W, np.nan),
        )
    return signals if driven else dataclasses.replace(signals, resistance_Ohm=np.nan, power_W=np.nan)
