"""Sections of parameters that several rooms share: the wire, its heat balance, the time of the loop, the limits of the supply."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .parameters import parameter, section

#: The over-voltage trip sits this much above the compliance voltage, so that noise does not trip it.
OVER_VOLTAGE_MARGIN = 1.1


@dataclass(frozen=True, slots=True)
class Wire:
    """The wire itself."""

    alloy: str = parameter(description="alloy of the wire", choices=("ni-ti", "ni-ti-cu"))
    length: float = parameter(
        description="length between the crimps, slack taken out",
        unit="m",
        lo=0.005,
        hi=20.0,
        hint="metres are wanted: 100 mm is 0.100",
    )
    diameter: float = parameter(
        description="diameter of the wire",
        unit="m",
        lo=10e-6,
        hi=2e-3,
        hint="metres are wanted: 0.1524 mm is 0.1524e-3",
    )
    full_stroke_strain: float = parameter(
        0.04, "strain that counts as 100 % of stroke in every error", "1", 0.001, 0.12
    )
    max_stress: float = parameter(175e6, "stress the wire must never see", "Pa", 1e6, 1e9, live=True, stricter="lower")

    @property
    def area_m2(self) -> float:
        """Cross-section of the wire."""
        return math.pi * self.diameter**2 / 4.0

    @property
    def full_stroke_m(self) -> float:
        """Displacement that counts as 100 % in every error."""
        return self.full_stroke_strain * self.length


@dataclass(frozen=True, slots=True)
class Realtime:
    """What the operating system gives the thread of the loop; Linux, and only where it allows it."""

    priority: int = parameter(
        0, "SCHED_FIFO priority of the loop's thread, before all that has none; 0: as any other", "1", 0, 98
    )
    lock_memory: bool = parameter(False, "no memory of the process is swapped out")
    cpus: tuple[int, ...] = parameter(
        (), "processors that the loop's thread runs on; empty: any", "1", 0, 1023, optional=True
    )


@dataclass(frozen=True, slots=True)
class Loop:
    """Timing of the control loop."""

    rate: float = parameter(20.0, "readings, estimates and commands per second", "Hz", 1.0, 1000.0)
    sample_rate: float = parameter(1000.0, "raw samples per second and channel, averaged in blocks", "Hz", 1.0, 1e6)
    samples_per_block: int = parameter(50, "raw samples averaged into one reading", "1", 1, 100000)
    overruns_to_fault: int = parameter(
        10,
        "missed deadlines that count as a fault, less half of those met since",
        "1",
        1,
        10000,
        live=True,
        stricter="lower",
    )
    realtime: Realtime = section(Realtime, "real time")


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
    over_voltage_trip: float = parameter(
        0.0, "the supply's own over-voltage trip; 0: a tenth above supply.max_voltage", "V", 0.0, 66.0
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

    @property
    def over_voltage_V(self) -> float:
        """What its over-voltage trip is programmed to [V]."""
        return self.over_voltage_trip or OVER_VOLTAGE_MARGIN * self.max_voltage


@dataclass(frozen=True, slots=True)
class ThermalParameters:
    """Heat balance on measured power, C dT/dt = P − h (T − T_ambient), latent heat left out (so it errs hot)."""

    heat_capacity: float = parameter(description="heat capacity of the wire", unit="J/K", lo=1e-6, hi=1e3)
    heat_loss: float = parameter(description="heat lost per kelvin above ambient", unit="W/K", lo=1e-6, hi=1e2)
    heat_loss_margin: float = parameter(
        3.0,
        "the wire stays below max_temperature even where it loses this many times less heat than heat_loss",
        "1",
        1.0,
        10.0,
        live=True,
        stricter="higher",
    )
    ambient_temperature: float = parameter(
        24.0, "temperature of the surroundings where none is measured", "°C", -60.0, 100.0, live=True, stricter="higher"
    )
    ambient_tolerance: float = parameter(
        15.0,
        "the surroundings are never colder than ambient_temperature by more than this; a sensor that says so is not "
        "believed",
        "K",
        0.0,
        100.0,
        live=True,
        stricter="lower",
    )
    ambient_stuck_time: float = parameter(
        600.0,
        "time with not one changed digit after which an ambient sensor is believed only where it reads more than "
        "ambient_temperature",
        "s",
        1.0,
        1e6,
        live=True,
        stricter="lower",
    )
    transformed_temperature: float = parameter(
        150.0,
        "a wire that is hotter transforms no more at any stress: one whose resistance still falls as it is heated is not",
        "°C",
        40.0,
        400.0,
        live=True,
        stricter="higher",
    )
    derate_temperature: float = parameter(
        180.0,
        "estimated temperature where the current limit starts to fall",
        "°C",
        40.0,
        400.0,
        live=True,
        stricter="lower",
    )
    max_temperature: float = parameter(
        200.0, "temperature that the wire must never have", "°C", 40.0, 400.0, live=True, stricter="lower"
    )
