"""The power supply."""

from __future__ import annotations

from math import isfinite

from sma_actuator.safety.drift import FLOOR_A, FLOOR_V, SCALE, LAG_s, METER_LAG_s, WINDOW_s, WINDOWS_s
from sma_actuator.safety.formula import longest, parameter_value, seconds
from sma_actuator.safety.lately import LAG_READINGS
from sma_actuator.safety.records import Action, Fault, Step, guard
from sma_actuator.safety.timing import ONE_STEP, READING_TIMEOUT, THREE_STEPS, TWO_STEPS, COMES_ON_s

from .readings import silent
from .wire import COMPLIANCE

#: One setting is looked at every half second while driving; there are four.
SETTINGS_CHECKED = seconds(2.0)
#: Settings of supplies are coarser than the command: 0.02 mA in the thesis, up to 1 mA elsewhere.
SETTING_TOLERANCE_A = 2e-3
#: The longer times over which two measurements are averaged, in words.
LONGER = "{} and {:g}".format(", ".join(f"{window_s:g}" for window_s in WINDOWS_s[1:-1]), WINDOWS_s[-1])
#: A difference lasts so long; of it only what a DAQ may be late can be because it is late.
DISAGREES = longest(parameter_value("safety.disagreement_time"), LAG_s, TWO_STEPS)
HOWEVER_LATE = f"and off all that it was in the {LAG_s:g} s or two readings before, by which the DAQ may be late"


@guard(
    words="a protection of the supply tripped",
    remedy="Find out what tripped it before anything else: a short, a limit set too low, a hung computer",
    detector="the supply's read-back names OVP, OCP, OTP or WDOG",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
    while_off=True,
)
def supply_tripped(step: Step) -> str:
    """A protection of the supply has tripped."""
    return step.supply.tripped if step.supply is not None else ""


watchdog_not_held: Fault = Fault(
    "watchdog_not_held",
    words="the supply's watchdog does not hold",
    remedy="See whether somebody has reset the supply, or locks its front panel",
    detector="on opening the supply, on every ~/enable, and in turn with the limits while driving: the watchdog was "
    "armed "
    "and does not read back so; the supply is opened anew, which arms it again",
    within=SETTINGS_CHECKED + ONE_STEP,
    action=Action.OFF,
    latches=True,
    while_off=True,
)
limits_not_held: Fault = Fault(
    "limits_not_held",
    words="a limit of the supply does not hold",
    remedy="See who has changed the supply's limits, or reset it; opening it again sets them",
    detector="on opening the supply, on every ~/enable, and in turn while driving: compliance voltage, over-voltage or "
    "over-current trip does not read back as programmed, or reads back as switched off (by dialects that can ask); the "
    "supply is opened anew, which programs it again",
    within=SETTINGS_CHECKED + ONE_STEP,
    action=Action.OFF,
    latches=True,
    while_off=True,
)


output_not_confirmed: Fault = Fault(
    "output_not_confirmed",
    words="the output is told to be off, not confirmed",
    remedy="Look at the supply: if its output is on, switch it off by hand",
    detector="the driver: the supply was told to switch off and has not read back that it did",
    within=ONE_STEP,
    action=Action.OFF,
    latches=True,
    while_off=True,
)


@guard(
    words="somebody else commands the supply",
    remedy="Let nobody else touch the supply: no second node, no hand at the front panel. If nobody does, it takes "
    "currents in coarser steps than its dialect writes, as {value:.2f} for 10 mA, or not all of them, or its output "
    f"comes on more than {COMES_ON_s:g} s late: shorten that delay",
    detector="current setting (by more than 2 mA, and what its dialect's digits leave out) or output state reads back "
    f"as something that was not commanded; an output that was told to be on may read back as off for {COMES_ON_s:g} s",
    within=TWO_STEPS,
    action=Action.OFF,
    latches=True,
    while_off=True,
)
def second_commander(step: Step) -> str:
    """The supply's settings are not those that were written: somebody else writes to it."""
    supply, told = step.supply, step.told
    if supply is None or supply.tripped or not isfinite(supply.current_setting_A):
        return ""
    if supply.time_s < step.told_s:  # it is late, and of what was told before
        return ""
    setting_A = supply.current_setting_A + supply.cut_off_A
    same_setting = not told.output_on or abs(setting_A - told.current_A) <= SETTING_TOLERANCE_A
    if same_setting and supply.output_on == told.output_on:
        return ""
    return (
        f"the supply says {supply.current_setting_A:g} A, output {'on' if supply.output_on else 'off'}; "
        f"it was told {told.current_A:g} A, output {'on' if told.output_on else 'off'}"
    )


@guard(
    words="the supply is silent",
    remedy="Check the supply's cable, address and mains",
    detector="no finite read-back for safety.reading_timeout, or waiting for the supply took most of a step that long, "
    "or the "
    "driver reports the connection lost",
    within=READING_TIMEOUT + ONE_STEP,
    action=Action.OFF,
    latches=True,
    until_back=True,
)
def supply_lost(step: Step) -> str:
    """The supply has not answered usably for too long."""
    supply = step.supply
    if supply is not None and isfinite(supply.current_setting_A + supply.voltage_V + supply.current_A):
        step.memory.supply_s = step.now_s
    return silent(step, step.memory.supply_s, "read-back of the supply") or step.held_up_by("supply")


def _disagrees(step: Step, names: tuple[str, str], differs: bool, however_late: bool) -> float | None:
    """For how long supply and DAQ have differed [s], in all also however late it may be, by the names of either; None
    where that has not lasted."""
    memory, (name, however) = step.memory, names
    if not differs:
        memory.over(name, however)
        return None
    lasts_s = memory.lasts_s(name, True, step.now_s)
    unlike_s = memory.in_all_s(however, however_late, step.now_s)
    lasts_at_least_s, late_s = step.config.safety.disagreement_time, max(LAG_s, LAG_READINGS / step.config.loop.rate)
    return lasts_s if lasts_s >= lasts_at_least_s and unlike_s >= lasts_at_least_s - late_s else None


@guard(
    words="the supply does not do what it was told",
    remedy="Compare the supply's display with circuit.reference_resistance and the DAQ's channels; where it is at its "
    "compliance voltage, supply.max_voltage with what the circuit wants",
    detector="measured current off the command by more than safety.current_disagreement for safety.disagreement_time, "
    f"{HOWEVER_LATE} (a command that swings through the current that flows hides it for as long); also current that "
    "flows while the output is off",
    within=DISAGREES + THREE_STEPS,
    action=Action.OFF,
    latches=True,
    while_off=True,
)
def supply_disagrees(step: Step) -> str:
    """The measured current is not the commanded one."""
    told_A = step.told.current_A if step.told.output_on else 0.0
    step.memory.told_A.note(step.now_s, told_A)
    if step.reading is None:
        return ""
    measured_A = step.signals.current_A
    tolerance_A = step.config.safety.current_disagreement
    differs = not abs(measured_A - told_A) <= tolerance_A
    however_late = differs and not step.memory.told_A.off_by(measured_A) <= tolerance_A
    lasts_s = _disagrees(step, ("supply_disagrees", "supply_disagrees, however late"), differs, however_late)
    if lasts_s is None:
        return ""
    most_V = step.config.supply.max_voltage
    no_more = measured_A < told_A and step.reading.supply_voltage_V >= COMPLIANCE * most_V
    at_compliance = f"; supply.max_voltage, {most_V:g} V, drives no more through this circuit" if no_more else ""
    return (
        f"{measured_A:.3g} A flow, {told_A:.3g} A were commanded, for {lasts_s:.3g} s; safety.current_disagreement "
        f"is {tolerance_A:g} A{at_compliance}"
    )


@guard(
    words="supply and DAQ measure different things",
    remedy="Compare what the supply displays with the DAQ's channels: one of them is wired wrongly or answers late",
    detector="while current flows: the supply's own measurement off the DAQ's by more than "
    "safety.current_disagreement, or "
    f"safety.voltage_disagreement, for safety.disagreement_time, {HOWEVER_LATE}",
    within=DISAGREES + THREE_STEPS,
    action=Action.OFF,
    latches=True,
)
def measurements_disagree(step: Step) -> str:
    """Supply and DAQ measure different currents or voltages in the same circuit."""
    supply, reading, safety = step.supply, step.reading, step.config.safety
    if supply is None or reading is None:
        return ""
    memory, tolerance_A, tolerance_V = step.memory, safety.current_disagreement, safety.voltage_disagreement
    shown_A, shown_V = step.signals.current_A, reading.supply_voltage_V
    memory.supply_A_V.note(step.now_s, supply.current_A, supply.voltage_V)
    currents_differ = not abs(supply.current_A - shown_A) <= tolerance_A
    differ = step.told.output_on and (currents_differ or not abs(supply.voltage_V - shown_V) <= tolerance_V)
    however_late = differ and not (
        memory.supply_A_V.off_by(shown_A) <= tolerance_A and memory.supply_A_V.off_by(shown_V, 1) <= tolerance_V
    )
    names = "measurements_disagree", "measurements_disagree, however late"
    lasts_s = _disagrees(step, names, differ, however_late)
    if lasts_s is None:
        return ""
    if currents_differ:
        what, unit, by_supply, by_daq, tolerance = "current", "A", supply.current_A, shown_A, tolerance_A
    else:
        what, unit, by_supply, by_daq, tolerance = "voltage", "V", supply.voltage_V, shown_V, tolerance_V
    return (
        f"{what}: the supply measures {by_supply:.3g} {unit}, the DAQ {by_daq:.3g} {unit}, for {lasts_s:.3g} s; "
        f"safety.{what}_disagreement is {tolerance:g} {unit}"
    )


@guard(
    words="the measured current drifts from what the supply delivers",
    remedy="Where the supply's display agrees with what it was told, look at the sense resistor: "
    "circuit.reference_resistance, contacts, warming (one of more watts warms less); else at the supply. Clearing "
    "this fault takes the difference as it is then for right",
    detector="while the supply holds its current: the DAQ's mean current over "
    f"{WINDOW_s:g}, {LONGER} s is off the one that was set by safety.current_drift of it and {FLOOR_A * 1e3:g} mA "
    f"more than when such a current first flowed ({SCALE * 100:g} % more beyond the currents that have), and by more "
    f"than a DAQ that is late by {LAG_s:g} s or two readings explains",
    within=seconds(WINDOW_s + LAG_s) + TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def current_drifts(step: Step) -> str:
    """The sense resistor, or the supply, has another scale than when the wire was first driven."""
    supply, told, currents = step.supply, step.told, step.memory.currents
    if not told.output_on or (supply is not None and supply.voltage_V >= COMPLIANCE * step.config.supply.max_voltage):
        currents.pause()
        return ""
    if step.reading is None or supply is None:
        return ""
    setting_A = supply.current_setting_A if isfinite(supply.current_setting_A) else told.current_A
    share = step.config.safety.current_drift
    change_A, allowed_A = currents.step(
        step.reading.time_s,
        step.signals.current_A,
        min(told.current_A, setting_A),
        max(told.current_A, setting_A),
        share,
    )
    if not abs(change_A) > allowed_A:
        return ""
    if abs(step.signals.current_A - told.current_A) > step.config.safety.current_disagreement:
        return ""  # supply_disagrees, if it lasts
    currents.forget()
    return (
        f"at {told.current_A:.3g} A the DAQ measures {change_A * 1e3:+.3g} mA more than when such a current first "
        f"flowed, the supply {(supply.current_A - told.current_A) * 1e3:+.3g} mA more than it was told; "
        f"safety.current_drift is {share:g}"
    )


@guard(
    words="the measured voltage drifts from what the supply measures",
    remedy="Where a voltmeter at the wire agrees with the supply's display, look at the DAQ's channel and its "
    "divider; else at the contacts between supply and wire. Clearing this fault takes the difference as it is then "
    "for right",
    detector=f"the DAQ's mean voltage over {WINDOW_s:g}, {LONGER} s is off the supply's own by safety.voltage_drift "
    f"of it and {FLOOR_V * 1e3:g} mV more than when such a current first flowed, and by more than either being late by "
    f"{METER_LAG_s:g} s or two readings, and the supply's digits, explain",
    within=seconds(WINDOW_s + METER_LAG_s) + TWO_STEPS,
    action=Action.OFF,
    latches=True,
)
def voltage_drifts(step: Step) -> str:
    """The DAQ's voltage channel has another scale than when the wire was first driven, and the resistance with it."""
    supply, voltages = step.supply, step.memory.voltages
    if not step.told.output_on:
        voltages.pause()
        return ""
    if step.reading is None or supply is None or not isfinite(supply.voltage_V) or not step.signals.current_A > 0.0:
        return ""
    share = step.config.safety.voltage_drift
    change_V, allowed_V = voltages.step(
        step.reading.time_s, step.signals.current_A, step.reading.supply_voltage_V, supply.voltage_V, share
    )
    if not abs(change_V) > allowed_V:
        return ""
    if abs(step.reading.supply_voltage_V - supply.voltage_V) > step.config.safety.voltage_disagreement:
        return ""  # measurements_disagree, if it lasts
    voltages.forget()
    return (
        f"at {supply.voltage_V:.3g} V the DAQ measures {change_V * 1e3:+.3g} mV more than when such a current first "
        f"flowed; safety.voltage_drift is {share:g}"
    )
