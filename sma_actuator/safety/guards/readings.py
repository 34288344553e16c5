"""The DAQ and what it says: silence, nonsense, channels that stand still."""

from __future__ import annotations

from math import isfinite, isnan
from operator import eq

from sma_actuator.base.signals import MEASURABLE, Quality, Reading
from sma_actuator.safety.alive import FOLLOWS, RARE, SEEN, SWING, WINDOW, LoadAlive, Repeats
from sma_actuator.safety.formula import longest, parameter_value
from sma_actuator.safety.records import MOVING, NEVER_READ, Action, Step, guard
from sma_actuator.safety.timing import ONE_STEP, RATE, READING_TIMEOUT, TWO_STEPS

from .estimate import APART_s, contradicted_m
from .wire import seems_open

#: Share of the load at wire.max_stress that a load may differ by though nothing moves.
NOISE_SHARE = 0.01


#: The channels that a reading must have.
CHANNELS = ("supply voltage", "reference voltage", "load cell")


def voltages(reading: Reading) -> tuple[float, float, float]:
    """What they read, in that order."""
    return reading.supply_voltage_V, reading.reference_voltage_V, reading.load_cell_voltage_V


def are_inside(reading: Reading, bound_V: float) -> bool:
    """Whether all of them are numbers inside the converter's range."""
    supply_V, reference_V, load_cell_V = voltages(reading)
    return -bound_V < supply_V < bound_V and -bound_V < reference_V < bound_V and -bound_V < load_cell_V < bound_V


def silent(step: Step, last_s: float, what: str) -> str:
    """Why ``what``, last there at ``last_s``, counts as lost, or ""."""
    if step.now_s - last_s <= step.config.safety.reading_timeout:
        return ""
    return (
        f"no {what} for {step.now_s - last_s:.3g} s; safety.reading_timeout is {step.config.safety.reading_timeout:g} s"
    )


@guard(
    words="the DAQ is silent",
    remedy="Check the DAQ's cable, address and mains",
    detector="no reading for safety.reading_timeout, or waiting for the DAQ took most of a step that long, or the "
    "driver "
    "reports the connection lost",
    within=READING_TIMEOUT + ONE_STEP,
    action=Action.OFF,
    latches=True,
    until_back=True,
)
def daq_lost(step: Step) -> str:
    """The DAQ has not answered for too long."""
    if step.raw is not None:
        step.memory.daq_s = step.now_s
    return silent(step, step.memory.daq_s, "answer of the DAQ") or step.held_up_by("daq")


@guard(
    words="a DAQ channel is saturated",
    remedy="Check the channel's wiring and range, and safety.channel_max_voltage",
    detector="a channel at or beyond ±safety.channel_max_voltage",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def reading_saturated(step: Step) -> str:
    """A channel is at the end of the converter's range."""
    if step.raw is None or step.raw is step.reading:  # one that is usable is inside, and finite
        return ""
    bound_V = step.config.safety.channel_max_voltage
    for name, value in zip(CHANNELS, voltages(step.raw), strict=True):
        if value <= -bound_V or value >= bound_V:
            return f"{name}: {value:g} V; the channel ends at ±{bound_V:g} V (safety.channel_max_voltage)"
    return ""


@guard(
    words="a reading is not finite",
    remedy="Check the DAQ's channels; the current stays at the bias until readings are finite again",
    detector="NaN or infinity in a voltage, load cell or time of a reading; such a reading reaches neither estimator "
    "nor controller, and becomes reading_stale when it lasts",
    within=ONE_STEP,
    action=Action.BIAS,
)
def reading_not_finite(step: Step) -> str:
    """A channel is NaN or infinite."""
    if step.raw is None or step.raw is step.reading:
        return ""
    values = (step.raw.time_s, *voltages(step.raw))
    if isfinite(sum(values)):
        return ""
    bad = [name for name, value in zip(("time", *CHANNELS), values, strict=True) if not isfinite(value)]
    return f"{', '.join(bad)}: not a finite number" if bad else ""


@guard(
    words="the readings are stale",
    remedy="Check the DAQ's scan: it answers, but with old or unusable readings",
    detector="readings come, but the last finite one with a new time is older than safety.reading_timeout",
    within=READING_TIMEOUT + ONE_STEP,
    action=Action.OFF,
    latches=True,
)
def reading_stale(step: Step) -> str:
    """The DAQ answers, but no reading was usable for too long."""
    if step.reading is not None:
        step.memory.reading_s = step.now_s
    return silent(step, step.memory.reading_s, "new and finite reading")


@guard(
    words="a reading is implausible",
    remedy="Check the taps, the sense resistor and the load cell",
    detector="resistance above safety.resistance_max (of a wire that is not open), load below safety.load_min, or "
    "current flowing backwards",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def reading_implausible(step: Step) -> str:
    """The resistance is not that of a wire, or the current is negative."""
    if step.reading is None:
        return ""
    safety, signals = step.config.safety, step.signals
    if signals.resistance_Ohm > safety.resistance_max and not seems_open(step):
        return f"resistance {signals.resistance_Ohm:.3g} Ω; safety.resistance_max is {safety.resistance_max:g} Ω"
    if not signals.load_N >= safety.load_min:
        return f"load {signals.load_N:.3g} N; safety.load_min is {safety.load_min:g} N"
    if not signals.current_A >= -MEASURABLE * step.config.supply.bias_current:
        return (
            f"current {signals.current_A:.3g} A flows backwards; is the sense resistor's channel wired the wrong "
            f"way round?"
        )
    return ""


@guard(
    words="a channel is stuck",
    remedy="Check that channel's cable and amplifier; where its digits are coarse, `sma-actuator check` says how long "
    "it may stand",
    detector="not one changed digit for safety.stuck_time on a voltage or load cell channel while current flows",
    within=parameter_value("safety.stuck_time") + TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def sensor_stuck(step: Step) -> str:
    """A channel has not changed in any digit for too long."""
    if step.reading is None:
        return ""
    if not step.told.output_on:
        step.memory.channels = NEVER_READ
        return ""
    longest_s = 2.0 / step.config.loop.rate  # where readings come late, two that are alike by chance say no more
    before, stood_s, at_s = step.memory.channels
    values = voltages(step.reading)
    if True not in map(eq, values, before):
        step.memory.channels = (values, MOVING, step.now_s)
        return ""
    passed_s = min(step.now_s - at_s, longest_s)
    stand_s = [s + passed_s if v == b else 0.0 for v, b, s in zip(values, before, stood_s, strict=True)]
    step.memory.channels = (values, stand_s, step.now_s)
    for name, value, stands_s in zip(CHANNELS, values, stand_s, strict=True):
        if stands_s > step.config.safety.stuck_time:
            return (
                f"{name}: {value:g} V for {stands_s:.3g} s to the last digit; safety.stuck_time is "
                f"{step.config.safety.stuck_time:g} s"
            )
    return ""


@guard(
    words="the readings repeat",
    remedy="Check the DAQ's scan: it gives old values with new times",
    detector=f"while current flows: no voltage nor the load cell differs by one digit from the reading before, more "
    f"often than chance "
    f"would have it once in {1 / RARE:.0g} readings, by what {SEEN} or more have shown",
    within=10 / RATE,
    action=Action.OFF,
    latches=True,
)
def readings_repeat(step: Step) -> str:
    """The DAQ repeats a block."""
    if step.reading is None or not step.told.output_on:
        return ""
    if not step.memory.repeats.step(*voltages(step.reading)):
        return ""
    step.memory.repeats = Repeats()
    return "all channels have the same values again and again, to the last digit; they never had so often"


@guard(
    words="the load cell does not show the load",
    remedy="Check the load cell, its cable and amplifier. Where all is well (a source of noise was switched off) "
    "clear the fault, and what is usual is seen anew; safety.least_noise 0 leaves noise out",
    detector="of the load cell's channel, once this run has shown what is usual: values repeat as in "
    f"readings_repeat; or its noise is less than safety.least_noise of the least so far over {WINDOW} readings with "
    f"the same command, or of a load that stayed while the wire moved by {100 * SWING:g} % of the full stroke; or "
    f"two motions running, to and fro, by {100 * SWING:g} % of the full stroke or more with less than "
    f"{100 * FOLLOWS:g} % of the change of load that belonged to such motions so far, as on a spring. Or, where "
    "fitted, the displacement sensor contradicts the position (as in position_contradicted) since a load that three "
    "motions had shown changed by itself, without a leap of the displacement beyond its motion in the same reading, "
    "before three have shown what the new one does. While the wire is held a cell that keeps its noise shows none of "
    "this",
    within=longest((WINDOW + 10) / RATE, APART_s + TWO_STEPS),
    action=Action.OFF,
    latches=True,
)
def load_dead(step: Step) -> str:
    """The load cell shows less life than it has."""
    if step.reading is None:
        return ""
    config, alive, value_V = step.config, step.memory.load_alive, step.reading.load_cell_voltage_V
    noise, wire = alive.quiet(value_V, step.told.current_A), config.wire
    swing_m, noise_N = SWING * wire.full_stroke_m, NOISE_SHARE * wire.max_stress * wire.area_m2
    alive.leaps.step(step.signals.load_N, step.signals.reference_displacement_m, noise_N)
    why = ""
    if alive.repeats.step(value_V):
        why = f"{value_V:g} V again and again, to the last digit"
    elif noise < config.safety.least_noise:
        why = (
            f"its noise is {noise:.2g} of the least that it has had; safety.least_noise is "
            f"{config.safety.least_noise:g}"
        )
    elif step.driven and step.settled and step.estimate.quality <= Quality.INDETERMINATE_HOT:
        place_m, contradicted = step.estimate.displacement_m, not isnan(contradicted_m(step))
        why = alive.following.step(place_m, step.signals.load_N, swing_m, noise_N)
        alone = alive.is_suspect(contradicted) and contradicted
        if step.memory.lasts_s("load_dead", alone, step.now_s) >= APART_s:
            why = f"since it changed by itself the displacement sensor contradicts the position, {place_m * 1e3:.3g} mm"
    else:
        alive.following.pause()
    if why:
        step.memory.load_alive = LoadAlive()
    return why


@guard(
    words="the displacement sensor reads what no wire does",
    remedy="Check its channel, reference_sensor and instruments.daq.lvdt_channel: it may be swapped with another, as "
    "that of the ambient "
    "temperature",
    detector="reference displacement further from zero than wire.length, or no number from the channel that "
    "instruments.daq.lvdt_channel names; it is used for identification only",
    within=ONE_STEP,
    action=Action.NOTE,
)
def reference_doubted(step: Step) -> str:
    """The displacement sensor is not believed."""
    place_m, length_m = step.signals.reference_displacement_m, step.config.wire.length
    if step.reading is None:
        return ""
    if nothing := step.gives_no_number(step.reading.lvdt_current_A, "lvdt_channel"):
        return nothing
    if not abs(place_m) > length_m:
        return ""
    return f"{place_m * 1e3:.3g} mm, of a wire of {length_m * 1e3:g} mm"
