"""Sections of parameters that several rooms share: the wire, its heat balance, the time of the loop, the limits of the
supply."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from math import nan
from typing import Any

from .balance import Balance
from .parameters import parameter, section

#: The over-voltage trip sits this much above the compliance voltage, so that noise does not trip it.
OVER_VOLTAGE_MARGIN = 1.1
#: Coils are wound between these ratios of their mean diameter to that of the wire; Wahl's factor has a pole at 1.
LEAST_INDEX, LARGEST_INDEX = 3.0, 25.0


@dataclass(frozen=True)
class Wire:
    """The wire itself: a straight one, a coil of one, or several straight ones side by side.

    Whatever the form, all that is below works with the straight wire that does the same: ``area_m2`` makes a stress of
    a load, ``strain_length_m`` a displacement of a strain, :meth:`resistance_Ohm` a resistance of a resistivity, and
    current and power are those at the terminals.  Stress and strain of a coil are those of the surface of its wire in
    tension by von Mises, σ = √3 τ and ε = γ/√3, so that what is known of wires in MPa and in % holds for coils.

    Sources
        A. M. Wahl, *Mechanical Springs*, 2nd ed., McGraw-Hill 1963: τ = 8 F D K/(π d³), γ = δ d/(π D² n), K.
        C. Liang, C. A. Rogers, J. Intell. Mater. Syst. Struct. 8 (1997) 314, and S.-M. An and others, Smart Mater.
        Struct. 21 (2012) 055009: the same of coils of shape memory alloy.
    """

    alloy: str = parameter(description="alloy of the wire", choices=("ni-ti", "ni-ti-cu"))
    form: str = parameter(
        "wire",
        "one straight wire, a coil of one, or a bundle of several on one load",
        choices=("wire", "coil", "bundle"),
    )
    length: float = parameter(
        description="length between the crimps, slack taken out; of a coil: of its wire, π · coil_diameter · active "
        "turns",
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
    coil_diameter: float = parameter(
        nan,
        "of a coil: mean diameter, which is the outer one less that of the wire",
        "m",
        30e-6,
        0.1,
        optional=True,
        hint="metres are wanted: 3 mm is 0.003",
    )
    wires: int = parameter(1, "of a bundle: how many wires pull side by side", "1", 1, 1000)
    connection: str = parameter(
        "", "of a bundle: how the current goes through its wires", choices=("series", "parallel"), optional=True
    )
    full_stroke_strain: float = parameter(
        0.04, "strain that counts as 100 % of stroke in every error", "1", 0.001, 0.12
    )
    full_stroke: float = parameter(
        nan, "the same as a displacement; it counts before the strain", "m", 1e-6, 20.0, optional=True
    )
    max_stress: float = parameter(175e6, "stress the wire must never see", "Pa", 1e6, 1e9, live="lower")

    def contradictions(self) -> list[str]:
        """What of the form is missing or does not fit it: sentences, each beginning with a parameter's name."""
        coil, bundle = self.form == "coil", self.form == "bundle"
        problems = []
        if coil and not LEAST_INDEX <= self.index <= LARGEST_INDEX:
            problems.append(
                f"coil_diameter: {self.coil_diameter:g} m; of a coil {LEAST_INDEX:g} to {LARGEST_INDEX:g} times the "
                f"diameter of its wire is wanted, {LEAST_INDEX * self.diameter:g} to {LARGEST_INDEX * self.diameter:g} "
                "m"
            )
        if bundle and (self.wires < 2 or not self.connection):
            problems.append(
                "wires, connection: of a bundle two wires or more are wanted, and whether the current goes through "
                "them in series or in parallel"
            )
        if not coil and math.isfinite(self.coil_diameter):
            problems.append(f"coil_diameter: is of a coil, and form is {self.form}")
        if not bundle and (self.wires != 1 or self.connection):
            problems.append(f"wires, connection: are of a bundle, and form is {self.form}")
        return problems

    @property
    def index(self) -> float:
        """Spring index of a coil, D/d; NaN of anything else."""
        return self.coil_diameter / self.diameter

    @property
    def turns(self) -> float:
        """Active turns of a coil; NaN of anything else."""
        return self.length / (math.pi * self.coil_diameter)

    @property
    def wahl_factor(self) -> float:
        """By how much curvature and transverse shear raise the stress at the inner side of a coil (Wahl)."""
        return (4.0 * self.index - 1.0) / (4.0 * self.index - 4.0) + 0.615 / self.index

    @cached_property
    def area_m2(self) -> float:
        """Load over stress: the cross-section of all wires; of a coil by its torsion."""
        area_m2 = self.wires * self._section_m2
        return area_m2 / (2.0 * math.sqrt(3.0) * self.index * self.wahl_factor) if self.form == "coil" else area_m2

    @cached_property
    def strain_length_m(self) -> float:
        """Displacement over strain: the length; of a coil √3 π D² n/d."""
        return math.sqrt(3.0) * self.index * self.length if self.form == "coil" else self.length

    @cached_property
    def full_stroke_m(self) -> float:
        """Displacement that counts as 100 % in every error."""
        by_strain_m = self.full_stroke_strain * self.strain_length_m
        return self.full_stroke if math.isfinite(self.full_stroke) else by_strain_m

    @cached_property
    def surface_m2(self) -> float:
        """What loses heat to the air."""
        return self.wires * (math.pi * self.diameter * self.length)

    @property
    def volume_m3(self) -> float:
        """What is heated."""
        return self.wires * (self._section_m2 * self.length)

    def resistance_Ohm(self, resistivity_Ohm_m: Any) -> Any:
        """Resistance at the terminals, of all wires in series or in parallel; of a number or an array."""
        length_m, section_m2 = self._path
        return resistivity_Ohm_m * length_m / section_m2

    def resistivity_Ohm_m(self, resistance_Ohm: float) -> float:
        """The other way round."""
        length_m, section_m2 = self._path
        return resistance_Ohm * section_m2 / length_m

    @property
    def size(self) -> dict[str, Any]:
        """What the wire is, as logs and manifests keep it beside what was measured."""
        size: dict[str, Any] = {"alloy": self.alloy, "length_m": self.length, "diameter_m": self.diameter}
        return size | ({"form": self.form_text} if self.form_text else {})

    @property
    def form_text(self) -> str:
        """The form and its measures, to be compared; "" of a straight wire."""
        if self.form == "coil":
            return f"coil of {self.coil_diameter * 1e3:.4g} mm"
        return f"bundle of {self.wires} in {self.connection}" if self.form == "bundle" else ""

    @property
    def words(self) -> str:
        """The wire as a person reads it."""
        text = f"{self.length * 1e3:g} mm × {self.diameter * 1e3:g} mm"
        return f"{text}, {self.form_text}" if self.form_text else text

    def stress_text(self, stress_Pa: float) -> str:
        """A stress as a person reads it; where several wires or turns bear the load, with the load."""
        text = f"{stress_Pa / 1e6:.4g} MPa"
        return text if self.form == "wire" else f"{text} ({stress_Pa * self.area_m2:.3g} N)"

    @property
    def _section_m2(self) -> float:
        return math.pi * self.diameter**2 / 4.0

    @property
    def _path(self) -> tuple[float, float]:
        """Length and cross-section of what the current goes through."""
        if self.connection == "series":
            return self.wires * self.length, self._section_m2
        return self.length, self.wires * self._section_m2


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
        live="lower",
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
        "drive a supply whose watchdog anybody's words feed: a bystander then keeps the current of a killed computer "
        "on",
    )
    allow_single_session: bool = parameter(
        False,
        "drive a supply that has no watchdog and is not known to take a second session: one that hangs then leaves the "
        "current on",
    )
    allow_no_trips: bool = parameter(
        False,
        "drive a supply without an over-voltage or an over-current trip of its own: nothing in it then stands against "
        "a wrong setting",
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
        1000.0,
        live="higher",
    )
    unwatched_margin: float = parameter(
        3.0,
        "the same for a current that flows on for ever, as that of a dead computer whose supply has no watchdog; no "
        "more than heat_loss_margin counts",
        "1",
        1.0,
        1000.0,
        live="higher",
    )
    near_share: float = parameter(
        0.0,
        "share of the wire's rise that near surroundings which warm up with it take in balance: a tube, a coating",
        "1",
        0.0,
        0.9,
    )
    near_time: float = parameter(1.0, "time constant with which they follow the wire", "s", 1e-3, 1e4)
    ambient_temperature: float = parameter(
        24.0, "temperature of the surroundings where none is measured", "°C", -60.0, 100.0, live="higher"
    )
    ambient_tolerance: float = parameter(
        15.0,
        "the surroundings are never colder than ambient_temperature by more than this; a sensor that says so is not "
        "believed",
        "K",
        0.0,
        100.0,
        live="lower",
    )
    ambient_stuck_time: float = parameter(
        600.0,
        "time with not one changed digit after which an ambient sensor is believed only where it reads more than "
        "ambient_temperature",
        "s",
        1.0,
        1e6,
        live="lower",
    )
    transformed_temperature: float = parameter(
        150.0,
        "a wire that is hotter transforms no more at any stress: one whose resistance still falls as it is heated is "
        "not",
        "°C",
        40.0,
        400.0,
        live="higher",
    )
    derate_temperature: float = parameter(
        180.0,
        "estimated temperature where the current limit starts to fall",
        "°C",
        40.0,
        400.0,
        live="lower",
    )
    max_temperature: float = parameter(
        200.0, "temperature that the wire must never have", "°C", 40.0, 400.0, live="lower"
    )

    @property
    def balance(self) -> Balance:
        """By what the wire's temperature follows its power."""
        return Balance(self.heat_capacity / self.heat_loss, self.near_share, self.near_time)
