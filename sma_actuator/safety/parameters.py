"""Limits of the supply and thresholds of the guards: the sections ``supply`` and ``safety``."""

from __future__ import annotations

from dataclasses import dataclass

from sma_actuator.base.parameters import parameter


@dataclass(frozen=True, slots=True)
class SupplyParameters:
    """What the supply may do to the wire."""

    bias_current: float = parameter(
        0.05,
        "current that always flows while enabled, to measure resistance with",
        "A",
        1e-4,
        5.0,
        hint="amperes are wanted: 50 mA is 0.05",
    )
    max_current: float = parameter(
        description="current that no setpoint, topic or fault can exceed",
        unit="A",
        lo=1e-3,
        hi=20.0,
        hint="amperes are wanted: 400 mA is 0.4",
    )
    max_voltage: float = parameter(
        description="compliance voltage; the supply's over-voltage trip sits just above", unit="V", lo=0.1, hi=60.0
    )
    over_current_trip: float = parameter(
        description="the supply's own over-current trip: what the wire survives for ever", unit="A", lo=1e-3, hi=20.0
    )
    watchdog_timeout: float = parameter(
        1.0, "silence after which the supply cuts its own output; 0: the supply has no watchdog", "s", 0.0, 3600.0
    )
    allow_no_watchdog: bool = parameter(
        False, "drive a supply that has no watchdog: a killed computer then leaves the current on"
    )
    allow_shared_watchdog: bool = parameter(
        False,
        "drive a supply whose watchdog anybody's words feed: a bystander then keeps the current of a killed computer on",
    )
    allow_single_session: bool = parameter(
        False,
        "drive a supply that has no watchdog and is not known to take a second session: one that hangs then leaves the "
        "current on",
    )
    allow_no_trips: bool = parameter(
        False,
        "drive a supply without an over-voltage or an over-current trip of its own: nothing in it then stands against a wrong "
        "setting",
    )


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
        live=True,
    )
    load_min: float = parameter(-0.5, "load below which the load cell is implausible", "N", -1e4, 1e4, live=True)
    load_spike: float = parameter(
        description="change of load from one reading to the next that is a spike", unit="N", lo=1e-3, hi=1e5, live=True
    )
    channel_max_voltage: float = parameter(10.0, "voltage at which a DAQ channel saturates", "V", 0.01, 1e3)
    stuck_time: float = parameter(
        2.0, "time with not one changed digit after which a channel is stuck", "s", 0.05, 3600.0, live=True
    )
    current_disagreement: float = parameter(
        0.02, "difference of commanded and measured current that is a fault once settled", "A", 1e-4, 5.0, live=True
    )
    voltage_disagreement: float = parameter(
        0.5,
        "difference of the voltages that supply and DAQ measure that is a fault: drop along the supply's leads, and noise",
        "V",
        1e-3,
        60.0,
        live=True,
    )
    disagreement_time: float = parameter(0.5, "time such a difference must last", "s", 0.0, 60.0, live=True)
    reading_timeout: float = parameter(0.5, "age of the last good reading that is a fault", "s", 0.01, 60.0, live=True)
    setpoint_flood_rate: float = parameter(
        1000.0, "setpoints per second above which their source is taken for broken", "Hz", 1.0, 1e6, live=True
    )
    stress_limit_fraction: float = parameter(
        0.9, "share of max_stress above which no further contraction is driven", "1", 0.1, 1.0, live=True
    )
    outside_calibration_time: float = parameter(
        5.0, "time outside the model's calibration that is a fault", "s", 0.0, 3600.0, live=True
    )
