"""What follows from a wire and its surroundings: parameters that nobody needs to be asked for.

``sma-actuator init`` writes them into a bench file with the reason beside each.  Tools that drive nothing fill in what
a file lacks of them, since the loop's parameters are composed with its limits; nothing is written then.

Sources
    V. T. Morgan, "The overall convective heat transfer from smooth circular cylinders", Advances in Heat Transfer 11
    (1975) 199: still air around a thin horizontal wire.
    Dynalloy Inc., *Technical characteristics of Flexinol actuator wires*, F1140: density, specific heat, resistivity.
    K. J. Åström and R. M. Murray, *Feedback Systems* (2008), 10.3: a phase margin of 30 to 60°.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from .base.balance import held_rise_K, holding_A
from .base.calibration import Calibration
from .base.parameters import ConfigError, from_mapping
from .base.sections import Loop, SupplyParameters, ThermalParameters, Wire
from .control.law import OWN_PERIODS
from .instruments.parameters import Instruments, least_reading_timeout_s
from .safety.parameters import SafetyParameters
from .safety.transformed import CAPACITY_WITHIN

DENSITY_kg_m3 = 6450.0
SPECIFIC_HEAT_J_kgK = {"ni-ti": 837.0, "ni-ti-cu": 500.0}
#: Between which they were found: calorimetry has 450 to 620, the maker of Ni-Ti 837.
SPECIFIC_HEATS_J_kgK = {"ni-ti": (450.0, 837.0), "ni-ti-cu": (450.0, 620.0)}
#: Resistivities of such wires lie between; the higher one is hotter for the same current, the lower one cools worse.
LEAST_RESISTIVITY_Ohm_m, LARGEST_RESISTIVITY_Ohm_m = 0.70e-6, 1.00e-6
#: Of a wire so hot that it is austenite all through (the maker's 0.80e-6, warm).
HOT_RESISTIVITY_Ohm_m = 0.90e-6
#: Still air at 55 °C, a wire 60 K above it.
_CONDUCTIVITY_W_mK, _VISCOSITY_m2_s, _DIFFUSIVITY_m2_s, _FILM_K, RISE_K = 0.0283, 1.83e-5, 2.60e-5, 328.0, 60.0
_RADIATION_W_m2K = 5.0  #: emissivity 0.6
#: Upper end of the Rayleigh number, factor, exponent: Nu = factor · Ra^exponent.
_MORGAN = ((1e-2, 0.675, 0.058), (1e2, 1.02, 0.148), (math.inf, 0.850, 0.188))
HALF = 2.0  #: what is promised is a wire that loses half the heat that it should
LEADS_Ohm = 0.5  #: that leads have at the most which nobody has measured yet
LATENT = 3.0  #: by how much latent heat lengthens the lag of the temperature
#: A loop that reads a wire fewer than ten times in heat_capacity / heat_loss may swing about its setpoint, and logs do
#: not tell what the wire loses; so it is read twelve times, as far as usual instruments answer, and where it is not the
#: gains are less.
READINGS, QUICKEST_Hz = 12.0, 100.0
#: A wire on its branch is an integrator of the heat, 90° late; so late is what is answered by then, and 30° are left.
_ANSWERED_rad = math.radians(60.0)
_BIAS_RISE_K = 3.0
_TRIP_HEADROOM_K = 5.0
_BY_DEFAULT = {f.name: f.default for section in (ThermalParameters, SupplyParameters) for f in fields(section)}
_AMBIENT_C, _DERATE_C, _HOTTEST_C, _WATCHDOG_s = (
    _BY_DEFAULT[name] for name in ("ambient_temperature", "derate_temperature", "max_temperature", "watchdog_timeout")
)

#: Without these a parameter file is refused, though only what drives a wire uses them.
_WANTED = (
    "supply.max_current",
    "supply.max_voltage",
    "supply.over_current_trip",
    "controller.kp",
    "thermal.heat_capacity",
    "thermal.heat_loss",
    "safety.resistance_min",
    "safety.resistance_max",
    "safety.load_spike",
)


@dataclass(frozen=True, slots=True)
class Derived:
    """A value, and where it comes from, for the person who reads the file."""

    value: float
    why: str


def derived(mapping: Mapping[str, Any]) -> dict[str, Derived]:
    """Parameters, by dotted name, that follow from the section ``wire`` of ``mapping`` and what else it gives.

    What is given (a measured heat loss, a chosen current) is built upon.  Raises ConfigError where the wire is not
    known.
    """
    wire, problems = from_mapping(Wire, mapping.get("wire") or {}, "wire.")
    if problems:
        raise ConfigError(problems)
    out: dict[str, Derived] = {}

    def given(name: str, default: float = math.nan) -> float:
        section, _, key = name.partition(".")
        there = mapping.get(section)  # which may be empty, or no section
        value = there.get(key, default) if isinstance(there, Mapping) else default
        try:
            return float(value) if isinstance(value, int | float) else default
        except OverflowError:  # of more digits than a number can have: to be told with the others
            return default

    def settle(name: str, value: float, why: str) -> float:
        out[name] = Derived(value, why)
        return given(name, value)

    capacity, loss, still = _settle_heat(wire, given, settle)
    usual_A = _settle_supply(wire, min(loss, still), given, settle)
    lag_s = settle(
        "estimator.thermal_time_constant",
        _digits(LATENT * capacity / loss, 2),
        f"{LATENT:g} · heat_capacity / heat_loss: latent heat makes the wire slower; identify measures it",
    )
    readings = _settle_rate(capacity / loss, given, settle)
    rate_Hz = readings * loss / capacity
    _settle_silence(mapping, rate_Hz, settle)
    usual_A = min(usual_A, given("supply.max_current", usual_A))
    steady_A_m = _steady_A_m(wire, mapping, given, capacity, loss, rate_Hz)
    _settle_gains(wire, usual_A, lag_s, readings, steady_A_m, settle)
    _settle_bounds(wire, settle)
    return out


def _settle_heat(wire: Wire, given: Any, settle: Any) -> tuple[float, float, float]:
    """Heat capacity [J/K], loss and that to still air [W/K], and how far the loss may be off."""
    capacity = settle(
        "thermal.heat_capacity",
        _digits(DENSITY_kg_m3 * SPECIFIC_HEAT_J_kgK[wire.alloy] * wire.volume_m3, 3),
        f"volume · {DENSITY_kg_m3:g} kg/m³ · {SPECIFIC_HEAT_J_kgK[wire.alloy]:g} J/(kg K)",
    )
    transfer = still_air_W_m2K(wire.diameter)
    still = _digits(still_air_W_K(wire), 3)
    loss = settle(
        "thermal.heat_loss",
        still,
        f"surface · {transfer:.0f} W/(m² K): still air (Morgan) and radiation, without the crimps; identify measures "
        f"it",
    )
    # Within so much still air itself may lose it; what is lost beyond that may end when a fan stops.
    fanned = loss > CAPACITY_WITHIN * still
    beyond = f"; of still air's {still:g} W/K: what it loses beyond may end" if fanned else ""
    settle(
        "thermal.heat_loss_margin",
        _digits(HALF * max(loss / still, CAPACITY_WITHIN), 3),
        f"half of a heat loss that is known within a factor of {CAPACITY_WITHIN:g}: by geometry, or by identify with a "
        f"heat capacity that nobody measured{beyond}",
    )
    if given("supply.watchdog_timeout", _WATCHDOG_s) == 0.0:
        settle(
            "thermal.unwatched_margin",
            _digits(max(loss / still, CAPACITY_WITHIN), 3),
            "without a watchdog the current of a dead computer flows on: a wire that loses what is known, within "
            f"{CAPACITY_WITHIN:g}{beyond}, stays below max_temperature; 3: also one that is covered up then",
        )
    return capacity, loss, still


def _settle_supply(wire: Wire, loss_W_K: float, given: Any, settle: Any) -> float:
    """What flows at the least and at the most; returns the current [A] that holds derate_temperature by the usual
    figures.

    A wire that loses more than these say, as far as that is known, is to contract too: where a watchdog ends the
    current of a dead computer, and the heat limit bends what flows before, it gets the current for that.
    """
    hot_Ohm = wire.resistance_Ohm(HOT_RESISTIVITY_Ohm_m)
    ambient_C = given("thermal.ambient_temperature", _AMBIENT_C)
    derate_C = given("thermal.derate_temperature", _DERATE_C)
    hottest_C = given("thermal.max_temperature", _HOTTEST_C) - _TRIP_HEADROOM_K

    watched = given("supply.watchdog_timeout", _WATCHDOG_s) > 0.0
    times = CAPACITY_WITHIN if watched else 1.0
    more = f" in a wire that loses {times:g} times as much" if watched else ""

    def steady_A(temperature_C: float, losing: float = 1.0) -> float:
        exact_A = holding_A(temperature_C - ambient_C, hot_Ohm, losing * loss_W_K)
        unit_A = 10.0 ** (math.floor(math.log10(exact_A)) - 2)
        return _digits(math.floor(exact_A / unit_A) * unit_A, 3)  # rounded down: it is a limit

    settle(
        "supply.bias_current",
        steady_A(ambient_C + _BIAS_RISE_K),
        f"warms the wire by {_BIAS_RISE_K:g} K",
    )
    most_A = settle(
        "supply.max_current",
        steady_A(derate_C, times),
        f"for ever in still air of {ambient_C:g} °C: {derate_C:g} °C (derate_temperature), by I² · {hot_Ohm:.3g} Ω / "
        f"{loss_W_K:.3g} W/K{more}",
    )
    survived_A = steady_A(hottest_C, times)
    settle(
        "supply.over_current_trip",
        max(survived_A, most_A),
        f"for ever in still air of {ambient_C:g} °C: {hottest_C:g} °C, {_TRIP_HEADROOM_K:g} K below max_temperature"
        f"{more}"
        if survived_A >= most_A
        else f"no less than max_current: more than the {survived_A:g} A that the wire survives for ever in still air",
    )
    sense_Ohm, leads_Ohm = given("circuit.reference_resistance", 0.0), given("circuit.lead_resistance", LEADS_Ohm)
    sense_Ohm = 0.0 if math.isnan(sense_Ohm) else sense_Ohm
    total_Ohm = wire.resistance_Ohm(LARGEST_RESISTIVITY_Ohm_m) + sense_Ohm + leads_Ohm
    settle(
        "supply.max_voltage",
        max(compliance_V(most_A * total_Ohm), 0.1),
        f"max_current through wire, sense resistor and leads, {total_Ohm:.3g} Ω, and a quarter more",
    )
    return steady_A(derate_C)


def compliance_V(wanted_V: float) -> float:
    """What a supply is to have [V] where a circuit wants so much: a quarter more, in tenths of a volt."""
    return math.ceil(12.5 * wanted_V) / 10.0


def not_survived(wire: Wire, supply: SupplyParameters, thermal: ThermalParameters) -> str:
    """A sentence where more may flow for ever, while no computer looks, than the wire survives; else ""."""
    loss_W_K = min(thermal.heat_loss, still_air_W_K(wire))
    hot_Ohm = wire.resistance_Ohm(HOT_RESISTIVITY_Ohm_m)
    rise_K = held_rise_K(supply.over_current_trip, hot_Ohm, loss_W_K)
    most_K = thermal.max_temperature - thermal.ambient_temperature
    if rise_K <= CAPACITY_WITHIN * most_K:
        return ""
    most_A = holding_A(most_K - _TRIP_HEADROOM_K, hot_Ohm, loss_W_K)
    return (
        f"supply.over_current_trip: {supply.over_current_trip:g} A for ever heats this wire to "
        f"{thermal.ambient_temperature + rise_K:.0f} °C in still air, and thermal.max_temperature is "
        f"{thermal.max_temperature:g} °C; {most_A:.3g} A is what it survives, whatever the computer does"
    )


def _settle_rate(time_constant_s: float, given: Any, settle: Any) -> float:
    """Only where the wire is too quick for the usual rate, or somebody gave a quicker one; how often it is read in its
    time constant then."""
    usual = Loop()
    rate_Hz = given("loop.rate", usual.rate)
    if quick := time_constant_s * usual.rate < READINGS:
        rate_Hz = settle(
            "loop.rate",
            float(math.ceil(min(READINGS / time_constant_s, QUICKEST_Hz))),
            f"{READINGS:g} readings in heat_capacity / heat_loss, {time_constant_s:.2g} s, at most {QUICKEST_Hz:g} a "
            "second: with fewer the loop may swing. `sma-actuator check` says whether the instruments are as quick",
        )
    if rate_Hz > (0.0 if quick else usual.rate):  # else to be told with the others, or the usual block fits in between
        settle(
            "loop.samples_per_block",
            max(int(given("loop.sample_rate", usual.sample_rate) / rate_Hz), 1),
            "as many as are sampled from one reading to the next",
        )
    return time_constant_s * rate_Hz


def _settle_silence(mapping: Mapping[str, Any], rate_Hz: float, settle: Any) -> None:
    """How old a reading may be, only where loop or instruments are too slow for the usual."""
    instruments, problems = from_mapping(Instruments, mapping.get("instruments") or {}, "instruments.")
    if problems or not rate_Hz > 0.0:
        return  # to be told with the others
    usual_s: Any = next(field.default for field in fields(SafetyParameters) if field.name == "reading_timeout")
    least_s = least_reading_timeout_s(instruments.supply.timeout, instruments.daq.timeout, rate_Hz)
    if least_s > usual_s:
        settle(
            "safety.reading_timeout",
            math.ceil(100.0 * least_s - 1e-6) / 100.0,
            f"both instruments' time-outs and a period of {rate_Hz:g} Hz, or two periods",
        )


def _settle_gains(wire: Wire, usual_A: float, lag_s: float, readings: float, steady_A_m: float, settle: Any) -> None:
    """No kd: it doubles what noise makes of the current, and buys no error (docs/control.md)."""
    slow = min(readings / READINGS, 1.0)
    usual_A_m = 4.0 * slow * usual_A / wire.full_stroke_m
    less = f", times {slow:.2g}: {readings:.2g} readings in heat_capacity / heat_loss instead of {READINGS:g}"
    why = f"an error of a quarter of the full stroke asks for {usual_A:.3g} A{less if slow < 1.0 else ''}"
    times, part = 4.0, "quarter"
    if steady_A_m < usual_A_m:
        more = f"with more, {_digits(usual_A_m, 2):g}"
        why = f"{more}, a wire that transforms within so few kelvins swings about its setpoint"
        times, part = 3.0, "third"  # such a one hunts through its hysteresis as well
    kp = settle("controller.kp", _digits(min(usual_A_m, steady_A_m), 2), why)
    settle(
        "controller.ki",
        _digits(times * kp / lag_s, 2),
        f"kp over a {part} of the lag of the temperature, which it makes up for",
    )


def _steady_A_m(
    wire: Wire, mapping: Mapping[str, Any], given: Any, capacity_J_K: float, loss_W_K: float, rate_Hz: float
) -> float:
    """The largest proportional gain [A/m] with which a calibrated wire comes to rest; ∞ where nothing is known of its
    transformation.

    What a current is more than holds the wire, ΔI, moves it at v = 2 I R ΔI · stroke / Q: with Q, the heat that the
    whole stroke takes along the flatter branch, latent heat included, at the current I that holds it at the top of the
    range of stresses.  So the loop is kp v / (s ΔI), late by its own periods, and kp is that with which it has 30° left
    where its gain is one.
    """
    calibration, problems = from_mapping(Calibration, mapping.get("calibration") or {}, "calibration.")
    if problems or not calibration.transformation_known:
        return math.inf
    power = calibration.power
    heating_C, cooling_C = power.transformation_heating, power.transformation_cooling
    stretch_K = min(max(curve_C) - min(curve_C) for curve_C in (heating_C, cooling_C))
    # Less than none is what a heat balance that errs makes of it.
    stroke_J = capacity_J_K * (max(power.latent_rise, 0.0) + stretch_K)
    (_, short_m), (_, long_m) = calibration.ends
    stroke_m = sum(long_m) / len(long_m) - sum(short_m) / len(short_m)
    hot_Ohm = wire.resistance_Ohm(HOT_RESISTIVITY_Ohm_m)
    hottest_C = max(heating_C) + power.transformation_shift[1] * wire.max_stress
    held_A = holding_A(hottest_C - given("thermal.ambient_temperature", _AMBIENT_C), hot_Ohm, loss_W_K)
    crossover_1_s = _ANSWERED_rad * rate_Hz / OWN_PERIODS
    return crossover_1_s * stroke_J / (stroke_m * 2.0 * held_A * hot_Ohm)


def _settle_bounds(wire: Wire, settle: Any) -> None:
    """Between which resistances the wire is one, what load comes at once, and of a coil or a bundle what it is of its
    wires."""
    least_Ohm, largest_Ohm = (wire.resistance_Ohm(r) for r in (LEAST_RESISTIVITY_Ohm_m, LARGEST_RESISTIVITY_Ohm_m))
    settle(
        "safety.resistance_min",
        _digits(0.4 * least_Ohm, 2),
        f"well below the {least_Ohm:.3g} Ω of {LEAST_RESISTIVITY_Ohm_m * 1e6:g} µΩ m",
    )
    settle(
        "safety.resistance_max",
        _digits(2.5 * largest_Ohm, 2),
        f"well above the {largest_Ohm:.3g} Ω of {LARGEST_RESISTIVITY_Ohm_m * 1e6:g} µΩ m",
    )
    strongest_N = wire.max_stress * wire.area_m2
    settle("safety.load_spike", _digits(0.5 * strongest_N, 2), f"half of {strongest_N:.3g} N, which is max_stress")
    if wire.form != "wire":
        settle(
            "wire.max_stress",
            wire.max_stress,
            f"a load of {strongest_N:.3g} N{_shear(wire, wire.max_stress * 1e-6, ' MPa')}",
        )
        strain = f"{wire.full_stroke_strain:.1%} of strain{_shear(wire, wire.full_stroke_strain * 300.0, ' %')}"
        settle(
            "controller.setpoint_rate_limit",
            _digits(2.5 * wire.full_stroke_m, 2),
            "two and a half full strokes a second",
        )
        settle("wire.full_stroke", _digits(wire.full_stroke_m, 3), strain)


def _shear(wire: Wire, value: float, unit: str) -> str:
    """What a stress or strain of tension is as shear, where the wire is twisted: τ = σ/√3, γ = √3 ε."""
    return f", {value / math.sqrt(3.0):.3g}{unit} as shear at the surface" if wire.form == "coil" else ""


def without_derived(mapping: Mapping[str, Any], other_rate: bool = False) -> tuple[dict[str, Any], list[str]]:
    """``mapping`` without what follows from the rest of it, and the names of that: nobody gave it, so what is measured
    may take its place.  How often the wire is read stays, and how old a reading may be: so its instruments can; unless
    it is to be read at an ``other_rate``.

    Raises ConfigError where the wire is not known.
    """
    out = copy.deepcopy(dict(mapping))
    names = []
    for name, found in derived(mapping).items():
        section, _, key = name.partition(".")
        of_instruments = section == "loop" or name == "safety.reading_timeout"
        inside = out.get(section)
        if (other_rate or not of_instruments) and isinstance(inside, Mapping) and inside.get(key) == found.value:
            del out[section][key]
            names.append(name)
    return out, names


def with_derived(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """``mapping`` with what it lacks of the parameters that every file must have, for tools that drive nothing.

    Raises ConfigError where the wire is not known.
    """
    out = copy.deepcopy(dict(mapping))
    lacking = [name for name in _WANTED if _lacks(out, name)]
    if not lacking:
        return out
    if "supply.max_current" in lacking and _lacks(out, "supply.bias_current"):
        lacking.append("supply.bias_current")
    for name, found in derived(out).items():
        if name in lacking:
            section, _, key = name.partition(".")
            out.setdefault(section, {})[key] = found.value
    return out


def _lacks(mapping: Mapping[str, Any], name: str) -> bool:
    section, _, key = name.partition(".")
    inside = mapping.get(section, {})
    return isinstance(inside, Mapping) and key not in inside


def still_air_W_m2K(diameter_m: float) -> float:
    """Heat that a thin horizontal wire loses to still air and by radiation, per surface and kelvin."""
    rayleigh = 9.81 / _FILM_K * RISE_K * diameter_m**3 / (_VISCOSITY_m2_s * _DIFFUSIVITY_m2_s)
    factor, exponent = next((f, e) for top, f, e in _MORGAN if rayleigh <= top)
    return factor * rayleigh**exponent * _CONDUCTIVITY_W_mK / diameter_m + _RADIATION_W_m2K


def still_air_W_K(wire: Wire) -> float:
    """The same of a whole wire."""
    return still_air_W_m2K(wire.diameter) * wire.surface_m2


def _digits(value: float, number: int) -> float:
    """Rounded to so many digits, as a person would write it."""
    return float(f"{value:.{number}g}")
