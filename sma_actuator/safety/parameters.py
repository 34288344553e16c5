"""Thresholds of the guards: the section ``safety``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.parameters import parameter
from sma_actuator.base.sections import Loop, SupplyParameters, ThermalParameters, Wire


@dataclass(frozen=True, slots=True)
class SafetyParameters:
    """Thresholds of faults and limits."""

    resistance_min: float = parameter(
        description="resistance below which the wire is shorted", unit="Ω", lo=1e-3, hi=1e4
    )
    resistance_max: float = parameter(
        description="resistance above which the reading is implausible", unit="Ω", lo=1e-3, hi=1e5
    )
    open_wire_current_fraction: float = parameter(
        0.5,
        "share of the commanded current below which, at the compliance voltage, the wire is open",
        "1",
        0.01,
        0.99,
        live="higher",
    )
    load_min: float = parameter(-0.5, "load below which the load cell is implausible", "N", -1e4, 1e4, live="higher")
    load_spike: float = parameter(
        description="change of load from one reading to the next that is a spike",
        unit="N",
        lo=1e-3,
        hi=1e5,
        live="lower",
    )
    channel_max_voltage: float = parameter(10.0, "voltage at which a DAQ channel saturates", "V", 0.01, 1e3)
    stuck_time: float = parameter(
        2.0,
        "time with not one changed digit after which a channel is stuck",
        "s",
        0.05,
        3600.0,
        live="lower",
    )
    current_disagreement: float = parameter(
        0.02,
        "difference of commanded and measured current that is a fault once settled",
        "A",
        1e-4,
        5.0,
        live="lower",
    )
    voltage_disagreement: float = parameter(
        0.5,
        "difference of the voltages that supply and DAQ measure that is a fault: drop along the supply's leads, and "
        "noise",
        "V",
        1e-3,
        60.0,
        live="lower",
    )
    disagreement_time: float = parameter(0.5, "time such a difference must last", "s", 0.0, 60.0, live="lower")
    least_noise: float = parameter(
        0.5,
        "share of the least noise that the load cell has had in this run below which it counts as dead; 0: never",
        "1",
        0.0,
        0.9,
        live="higher",
    )
    current_drift: float = parameter(
        0.005,
        "share by which the DAQ's current may drift from the supply's: 1 % is some 5 % of the stroke; sense resistors "
        "drift by 0.2 %, supplies that warm up by 0.1 %",
        "1",
        1e-3,
        1.0,
        live="lower",
    )
    voltage_drift: float = parameter(
        0.015,
        "share by which the DAQ's voltage may drift from the supply's; contacts between them that warm do too",
        "1",
        1e-3,
        1.0,
        live="lower",
    )
    reading_timeout: float = parameter(
        0.5, "age of the last good reading that is a fault", "s", 0.01, 60.0, live="lower"
    )
    setpoint_flood_rate: float = parameter(
        1000.0,
        "setpoints per second above which their source is taken for broken",
        "Hz",
        1.0,
        1e6,
        live="lower",
    )
    stress_limit_fraction: float = parameter(
        0.9,
        "share of max_stress above which no further contraction is driven",
        "1",
        0.1,
        1.0,
        live="lower",
    )
    outside_calibration_time: float = parameter(
        5.0, "time outside the model's calibration that is a fault", "s", 0.0, 3600.0, live="lower"
    )


class SetpointTimeout(Protocol):
    """How long a setpoint may be awaited, which the control law says."""

    @property
    def setpoint_timeout(self) -> float:
        """Longest silence of the commander [s]."""

    @property
    def joint_command_timeout(self) -> float:
        """Longest silence of a stream of joint commands [s]."""


class FittedSensors(Protocol):
    """The channels of the sensors that a wire can be driven without; 0: there is none."""

    @property
    def lvdt_channel(self) -> int:
        """That of the displacement sensor."""

    @property
    def ambient_temperature_channel(self) -> int:
        """That of the surroundings' thermometer."""


class FittedInstruments(Protocol):
    """The instruments, as far as guards ask."""

    @property
    def daq(self) -> FittedSensors:
        """What is fitted to the DAQ."""


class SafetySections(Protocol):
    """The parameters that the guards read; a ``Config`` has them."""

    @property
    def instruments(self) -> FittedInstruments:
        """Which sensors there are."""

    @property
    def wire(self) -> Wire:
        """The wire."""

    @property
    def loop(self) -> Loop:
        """The time of the loop."""

    @property
    def supply(self) -> SupplyParameters:
        """Limits of the supply."""

    @property
    def thermal(self) -> ThermalParameters:
        """The heat balance."""

    @property
    def safety(self) -> SafetyParameters:
        """Thresholds."""

    @property
    def controller(self) -> SetpointTimeout:
        """How long a setpoint may be awaited."""

    @property
    def calibration(self) -> Calibration:
        """What the model's own logs looked like."""
