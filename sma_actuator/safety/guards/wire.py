"""The wire: its circuit, its load, its heat."""

from __future__ import annotations

from math import isnan

from sma_actuator.base.signals import Quality
from sma_actuator.safety.ambient import AMBIENT_FALL_K_s
from sma_actuator.safety.formula import longest, parameter_value
from sma_actuator.safety.records import Action, Step, guard
from sma_actuator.safety.timing import ONE_STEP, RATE, SETTLING_READINGS, THREE_STEPS, TWO_STEPS, SETTLING_TIME_s
from sma_actuator.safety.transformed import returns_at_C

#: Share of supply.max_voltage that counts as being at the compliance voltage.
COMPLIANCE = 0.95
#: Time constants of the wire that it must have been contracted for although the balance calls it cold.
COOLING_TIMES = 1.5
#: Share of the rise above the surroundings at which the cooling wire has come back, below which one that is still
#: contracted is hotter than the balance says.
LEAST_RISE = 0.5


def seems_open(step: Step) -> bool:
    """Whether this one reading looks like that of an open wire."""
    return (
        step.told.output_on
        and step.reading is not None
        and step.reading.supply_voltage_V >= COMPLIANCE * step.config.supply.max_voltage
        and not step.signals.current_A >= step.config.safety.open_wire_current_fraction * step.told.current_A
    )


@guard(
    words="the wire is open",
    remedy="Check the crimps and clamps of the wire, and supply.max_voltage against its resistance",
    detector="voltage at the compliance voltage, supply.max_voltage, with less than safety.open_wire_current_fraction "
    "of "
    "the commanded current",
    within=THREE_STEPS,
    action=Action.OFF,
    latches=True,
)
def open_wire(step: Step) -> str:
    """The supply is at its compliance voltage, and less current flows than was commanded."""
    reading = step.reading
    if reading is None or step.memory.running("open_wire", seems_open(step)) < 2:
        return ""
    return f"{step.signals.current_A:.3g} A flow of {step.told.current_A:.3g} A at {reading.supply_voltage_V:.3g} V"


@guard(
    words="the wire is shorted",
    remedy="Look for what bridges the wire, and compare safety.resistance_min with it",
    detector="resistance below safety.resistance_min (after enabling: once settled at the bias current)",
    within=longest(SETTLING_TIME_s, SETTLING_READINGS / RATE) + TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def short(step: Step) -> str:
    """The resistance is below what the wire can have."""
    if not (
        step.settled and step.reading is not None and step.signals.resistance_Ohm < step.config.safety.resistance_min
    ):
        return ""
    return f"{step.signals.resistance_Ohm:.3g} Ω; safety.resistance_min is {step.config.safety.resistance_min:g} Ω"


@guard(
    words="stress above its limit",
    remedy="Take load off the wire, or correct wire.max_stress and the load cell's calibration",
    detector="stress above wire.max_stress",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def stress_above_limit(step: Step) -> str:
    """The stress is above ``wire.max_stress``."""
    if step.reading is None or step.signals.stress_Pa <= step.config.wire.max_stress:
        return ""
    wire = step.config.wire
    return f"{wire.stress_text(step.signals.stress_Pa)}; wire.max_stress is {wire.stress_text(wire.max_stress)}"


@guard(
    words="the load jumped",
    remedy="Look for what knocked or caught the load",
    detector="load changes by more than safety.load_spike from one reading to the next",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def load_spike(step: Step) -> str:
    """The load changed from one reading to the next by more than a wire can make it change."""
    if step.reading is None:
        return ""
    change_N = step.signals.load_N - step.memory.load_N
    step.memory.load_N = step.signals.load_N
    if not abs(change_N) > step.config.safety.load_spike:
        return ""
    return f"{change_N:+.3g} N from one reading to the next; safety.load_spike is {step.config.safety.load_spike:g} N"


@guard(
    words="the wire is too hot",
    remedy="Let the wire cool, and ask less of it; see thermal.max_temperature",
    detector="heat balance on measured power, with heat_loss / heat_loss_margin and no more than the resistance says, "
    "above "
    "thermal.max_temperature",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
    while_off=True,
)
def too_hot(step: Step) -> str:
    """The heat balance on the measured power is above ``thermal.max_temperature``."""
    thermal, heat = step.config.thermal, step.heat
    if heat.at_most_C <= thermal.max_temperature:
        return ""
    return (
        f"estimated {heat.temperature_C:.0f} °C, at most {heat.at_most_C:.0f} °C; thermal.max_temperature is "
        f"{thermal.max_temperature:g} °C"
    )


@guard(
    words="the heat loss is not that of the parameters",
    remedy="Let air to the wire, or correct thermal.heat_loss and ambient_temperature",
    detector=f"for {COOLING_TIMES:g} of its time constants, heat_capacity / heat_loss, or longer the wire stays "
    "contracted, by more than half of the estimate's 95 % interval, though the heat balance has it cooled to "
    f"{LEAST_RISE:g} of the rise at which it came back when it was calibrated: it is enclosed, or the surroundings "
    "are warmer than believed (never without a calibration, or where it does not come back so far)",
    within=COOLING_TIMES * parameter_value("thermal.heat_capacity") / parameter_value("thermal.heat_loss") + TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def heat_loss_wrong(step: Step) -> str:
    """The cooling wire stays contracted for longer than the heat balance allows: it loses less heat than
    ``thermal.heat_loss`` says."""
    calibration, thermal, heat, estimate = step.config.calibration, step.config.thermal, step.heat, step.estimate
    half_m = 0.0 if isnan(estimate.uncertainty_m) else estimate.uncertainty_m
    contracted = (
        step.settled
        and estimate.quality <= Quality.INDETERMINATE_HOT
        and estimate.displacement_m - step.longer_m + half_m < calibration.hot_end.cooling_position
    )
    # A wire transforms at a temperature, not at a rise: in a warm room it may stay contracted by itself; and under a
    # light load it may be shorter than that when it is cold.
    ambient_C, stress_Pa = heat.ambient.temperature_C, step.signals.stress_Pa
    contracted = contracted and (
        not calibration.ends_known or calibration.ends_m(stress_Pa)[1] > calibration.hot_end.cooling_position
    )
    still_hot = contracted and heat.temperature_C - ambient_C < LEAST_RISE * (
        returns_at_C(calibration, thermal, stress_Pa) - ambient_C
    )
    lasts_s = step.memory.lasts_s("heat_loss_wrong", still_hot, step.now_s)
    if not lasts_s >= COOLING_TIMES * thermal.heat_capacity / thermal.heat_loss:
        return ""
    return (
        f"for {lasts_s:.3g} s the wire is contracted to {estimate.displacement_m * 1e3:.3g} mm and the balance "
        f"says {heat.temperature_C:.0f} °C; it cools more slowly than thermal.heat_loss, {thermal.heat_loss:g} W/K, "
        f"has it, or the surroundings are warmer than {ambient_C:.0f} °C"
    )


@guard(
    words="the ambient sensor is not believed",
    remedy="Check the ambient sensor; thermal.ambient_temperature is taken instead",
    detector="ambient temperature below ambient_temperature − ambient_tolerance, above 100 °C, below "
    "ambient_temperature without one changed digit for thermal.ambient_stuck_time, or no number from "
    "instruments.daq.ambient_temperature_channel; what was believed falls from then on, as below a sensor that falls, "
    f"by no more than {AMBIENT_FALL_K_s:g} K/s",
    within=ONE_STEP,
    action=Action.NOTE,
)
def ambient_doubted(step: Step) -> str:
    """The ambient sensor is not believed."""
    nothing = step.gives_no_number(step.signals.ambient_temperature_C, "ambient_temperature_channel")
    return nothing or step.heat.ambient.doubt
