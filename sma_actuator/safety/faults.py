"""What can go wrong and what is done about it, in one table.

A *limit* bends the command and passes by itself; a *fault* means that something is wrong.  The
supervisor works from this table and ``docs/faults.md`` is printed from it
(``python -m sma_actuator.safety.faults``), so the two cannot differ.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any


class Action(enum.Enum):
    """What is done with the current, mildest first."""

    CLIP = "clip"  #: the value is brought into its range and used
    HOLD = "hold"  #: the wire is held: at its position, or at the last good setpoint
    BIAS = "bias"  #: the current falls to supply.bias_current, enough to measure with
    OFF = "off"  #: current zero and output off


class Limit(str, enum.Enum):
    """Limits: the command is bent, nothing is wrong."""

    SETPOINT_RANGE = "setpoint_range"
    SETPOINT_RATE = "setpoint_rate"
    CURRENT_MAX = "current_max"
    CURRENT_BIAS = "current_bias"
    STRESS_NEAR_LIMIT = "stress_near_limit"
    TEMPERATURE_DERATING = "temperature_derating"


class Fault(str, enum.Enum):
    """Faults, in the order in which one is named when several appear in the same step."""

    UNHANDLED_EXCEPTION = "unhandled_exception"
    NODE_LOST = "node_lost"
    COMMAND_INVALID = "command_invalid"
    CLOCK_JUMP = "clock_jump"
    SUPPLY_TRIPPED = "supply_tripped"
    WATCHDOG_NOT_HELD = "watchdog_not_held"
    SECOND_COMMANDER = "second_commander"
    SUPPLY_LOST = "supply_lost"
    DAQ_LOST = "daq_lost"
    READING_SATURATED = "reading_saturated"
    READING_NOT_FINITE = "reading_not_finite"
    READING_STALE = "reading_stale"
    OPEN_WIRE = "open_wire"
    SHORT = "short"
    READING_IMPLAUSIBLE = "reading_implausible"
    SENSOR_STUCK = "sensor_stuck"
    STRESS_ABOVE_LIMIT = "stress_above_limit"
    LOAD_SPIKE = "load_spike"
    TOO_HOT = "too_hot"
    SUPPLY_DISAGREES = "supply_disagrees"
    ESTIMATOR_OUTSIDE = "estimator_outside"
    LOOP_OVERRUN = "loop_overrun"
    SETPOINT_STALE = "setpoint_stale"
    SETPOINT_FLOOD = "setpoint_flood"
    ESTIMATE_INVALID = "estimate_invalid"
    SETPOINT_NOT_FINITE = "setpoint_not_finite"


@dataclass(frozen=True, slots=True)
class Entry:
    """One row of the table.

    ``within`` is the longest time from the cause to the action, as an expression of the
    parameters (sections ``loop``, ``safety``, ``controller``); see :func:`time_to_detect_s`.
    """

    words: str
    detector: str
    within: str
    action: Action
    latches: bool = False
    while_off: bool = False  #: also latched when it appears while the output is off anyway


#: Time after enabling in which only the bias current flows, to find out where the wire is.
SETTLING_TIME_S = 0.25
#: Readings with current that settling takes at least.
SETTLING_READINGS = 3
#: Setpoints that may arrive at once, in seconds' worth of safety.setpoint_flood_rate, and in number.
FLOOD_BURST_S = 0.1
FLOOD_BURST_MIN = 10

LIMITS: dict[Limit, Entry] = {
    Limit.SETPOINT_RANGE: Entry(
        "setpoint clipped to the working range",
        "setpoint outside the model's displacement range",
        "1/loop.rate",
        Action.CLIP,
    ),
    Limit.SETPOINT_RATE: Entry(
        "setpoint rate limited",
        "setpoint changes faster than controller.setpoint_rate_limit",
        "1/loop.rate",
        Action.CLIP,
    ),
    Limit.CURRENT_MAX: Entry(
        "current saturated at its upper limit",
        "controller asks for more than supply.max_current, or than what derating leaves of it",
        "0",
        Action.CLIP,
    ),
    Limit.CURRENT_BIAS: Entry(
        "current saturated at the bias",
        "controller asks for less than supply.bias_current: the wire cannot cool any faster",
        "0",
        Action.CLIP,
    ),
    Limit.STRESS_NEAR_LIMIT: Entry(
        "stress near its bound: no further contraction",
        "stress above safety.stress_limit_fraction × wire.max_stress; neither current nor setpoint may go beyond where they are",
        "1/loop.rate",
        Action.CLIP,
    ),
    Limit.TEMPERATURE_DERATING: Entry(
        "current limit lowered by temperature",
        "heat balance above thermal.derate_temperature; the limit falls linearly from supply.max_current there to "
        "supply.bias_current at thermal.max_temperature",
        "1/loop.rate",
        Action.CLIP,
    ),
}

FAULTS: dict[Fault, Entry] = {
    Fault.UNHANDLED_EXCEPTION: Entry(
        "an exception nobody handled",
        "the control step, or the driver around it, raises",
        "1/loop.rate",
        Action.OFF,
        latches=True,
        while_off=True,
    ),
    Fault.NODE_LOST: Entry(
        "the node is gone",
        "the driver: the ROS 2 context ended, or the node no longer feeds it",
        "1.0",
        Action.OFF,
        latches=True,
        while_off=True,
    ),
    Fault.COMMAND_INVALID: Entry(
        "the command is not a current",
        "last gate before the supply: the command is not finite, or below zero",
        "0",
        Action.OFF,
        latches=True,
    ),
    Fault.CLOCK_JUMP: Entry(
        "the clock jumped",
        "monotonic time of the loop not finite, running backwards, or ahead by more than safety.reading_timeout in one step",
        "1/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.SUPPLY_TRIPPED: Entry(
        "a protection of the supply tripped",
        "the supply's read-back names OVP, OCP, OTP or WDOG",
        "2/loop.rate",
        Action.OFF,
        latches=True,
        while_off=True,
    ),
    Fault.WATCHDOG_NOT_HELD: Entry(
        "the supply's watchdog does not hold",
        "on opening the supply and on every ~/enable: the watchdog was armed and does not read back so",
        "1/loop.rate",
        Action.OFF,
        latches=True,
        while_off=True,
    ),
    Fault.SECOND_COMMANDER: Entry(
        "somebody else commands the supply",
        "current setting or output state reads back as something that was not commanded",
        "2/loop.rate",
        Action.OFF,
        latches=True,
        while_off=True,
    ),
    Fault.SUPPLY_LOST: Entry(
        "the supply is silent",
        "no finite read-back for safety.reading_timeout, or the driver reports the connection lost",
        "safety.reading_timeout + 1/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.DAQ_LOST: Entry(
        "the DAQ is silent",
        "no reading for safety.reading_timeout, or the driver reports the connection lost",
        "safety.reading_timeout + 1/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.READING_SATURATED: Entry(
        "a DAQ channel is saturated",
        "a channel at or beyond ±safety.channel_max_voltage",
        "2/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.READING_NOT_FINITE: Entry(
        "a reading is not finite",
        "NaN or infinity in a voltage, load cell or time of a reading; such a reading reaches neither estimator nor "
        "controller, and becomes reading_stale when it lasts",
        "1/loop.rate",
        Action.BIAS,
    ),
    Fault.READING_STALE: Entry(
        "the readings are stale",
        "readings come, but the last finite one with a new time is older than safety.reading_timeout",
        "safety.reading_timeout + 1/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.OPEN_WIRE: Entry(
        "the wire is open",
        "voltage at the compliance voltage, supply.max_voltage, with less than safety.open_wire_current_fraction of the "
        "commanded current",
        "3/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.SHORT: Entry(
        "the wire is shorted",
        "resistance below safety.resistance_min (after enabling: once settled at the bias current)",
        f"max({SETTLING_TIME_S}, {SETTLING_READINGS}/loop.rate) + 2/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.READING_IMPLAUSIBLE: Entry(
        "a reading is implausible",
        "resistance above safety.resistance_max, load below safety.load_min, or current flowing backwards",
        "2/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.SENSOR_STUCK: Entry(
        "a channel is stuck",
        "not one changed digit for safety.stuck_time on a voltage or load cell channel while current flows",
        "safety.stuck_time + 2/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.STRESS_ABOVE_LIMIT: Entry(
        "stress above its limit",
        "stress above wire.max_stress",
        "2/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.LOAD_SPIKE: Entry(
        "the load jumped",
        "load changes by more than safety.load_spike from one reading to the next",
        "2/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.TOO_HOT: Entry(
        "the wire is too hot",
        "heat balance on measured power above thermal.max_temperature",
        "2/loop.rate",
        Action.OFF,
        latches=True,
        while_off=True,
    ),
    Fault.SUPPLY_DISAGREES: Entry(
        "the supply does not do what it was told",
        "measured current off the command by more than safety.current_disagreement for safety.disagreement_time; "
        "also current that flows while the output is off",
        "safety.disagreement_time + 3/loop.rate",
        Action.OFF,
        latches=True,
        while_off=True,
    ),
    Fault.ESTIMATOR_OUTSIDE: Entry(
        "the estimator is outside its region",
        "no estimate within the model's calibration for safety.outside_calibration_time",
        "safety.outside_calibration_time + 2/loop.rate",
        Action.OFF,
        latches=True,
    ),
    Fault.LOOP_OVERRUN: Entry(
        "the control loop overruns",
        "loop.overruns_to_fault steps running, each later than 1.5 periods of loop.rate after the one before",
        "loop.overruns_to_fault * safety.reading_timeout",
        Action.OFF,
        latches=True,
    ),
    Fault.SETPOINT_STALE: Entry(
        "the setpoint is lost",
        "no setpoint for controller.setpoint_timeout while tracking (0: never); action controller.on_setpoint_loss, "
        "latched where that is off",
        "controller.setpoint_timeout + 1/loop.rate",
        Action.HOLD,
    ),
    Fault.SETPOINT_FLOOD: Entry(
        "setpoints flood in",
        f"setpoints faster than safety.setpoint_flood_rate, after a burst of {FLOOD_BURST_S:g} s of them (at least "
        f"{FLOOD_BURST_MIN}); those above the rate are refused",
        f"max({FLOOD_BURST_S}, {FLOOD_BURST_MIN}/safety.setpoint_flood_rate)",
        Action.HOLD,
    ),
    Fault.ESTIMATE_INVALID: Entry(
        "there is no estimate",
        "the estimate is not finite or of quality INVALID while current flows; becomes estimator_outside when it lasts",
        "1/loop.rate",
        Action.BIAS,
    ),
    Fault.SETPOINT_NOT_FINITE: Entry(
        "a setpoint was not finite",
        "NaN or infinity in a setpoint or trajectory: refused on entry, the last one stands",
        "0",
        Action.HOLD,
    ),
}


def time_to_detect_s(name: Fault | Limit, config: Any) -> float:
    """Longest time from cause to action [s] with the parameters of ``config``."""
    entry = FAULTS[name] if isinstance(name, Fault) else LIMITS[name]
    sections = {section: getattr(config, section) for section in ("loop", "safety", "controller")}
    return float(eval(entry.within, {"__builtins__": {}, "max": max}, sections))  # our own constants, above


def markdown() -> str:
    """The text of ``docs/faults.md``."""
    out = [
        "# Limits and faults",
        "",
        "Printed from `sma_actuator/safety/faults.py` by `python -m sma_actuator.safety.faults > docs/faults.md`.",
        "",
        "Times are from the cause to the command, in seconds, of the parameters named; `0` is the same step.",
        "A latched fault switches the output off in the step that detects it, and the output stays off until",
        "`~/clear_fault` and then a new `~/enable`. What does not latch passes with its cause.",
        "",
        "Actions: **clip** brings a value into its range; **hold** keeps the wire where it is, or at the last good",
        "setpoint; **bias** lowers the current to `supply.bias_current`; **off** is current zero and output off.",
        "",
        "## Limits",
        "",
        "| limit | in words | detected by | within | action |",
        "|---|---|---|---|---|",
    ]
    out += [f"| `{n.value}` | {e.words} | {e.detector} | `{e.within}` | {e.action.value} |" for n, e in LIMITS.items()]
    out += [
        "",
        "## Faults",
        "",
        "In the order in which one is named when several appear in the same step.",
        "",
        "| fault | in words | detected by | within | action | latches |",
        "|---|---|---|---|---|---|",
    ]
    for name, e in FAULTS.items():
        action = "`controller.on_setpoint_loss`" if name is Fault.SETPOINT_STALE else e.action.value
        latches = "where off" if name is Fault.SETPOINT_STALE else "yes" if e.latches else "no"
        out.append(f"| `{name.value}` | {e.words} | {e.detector} | `{e.within}` | {action} | {latches} |")
    return "\n".join(out) + "\n"


if __name__ == "__main__":
    print(markdown(), end="")
