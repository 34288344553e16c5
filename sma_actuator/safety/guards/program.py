"""The program itself: exceptions, the node, the clock, commands that are none."""

from __future__ import annotations

from math import inf

from sma_actuator.safety.formula import parameter_value, seconds
from sma_actuator.safety.records import Action, Fault, Step, guard
from sma_actuator.safety.timing import ONE_STEP, READING_TIMEOUT

#: A step later than this many periods after the one before is an overrun.
OVERRUN_PERIODS = 1.5

unhandled_exception: Fault = Fault(
    "unhandled_exception",
    words="an exception nobody handled",
    remedy="This is a defect of the program; please report it with this log",
    detector="the control step, or the driver around it, raises",
    within=ONE_STEP,
    action=Action.OFF,
    latches=True,
    while_off=True,
)

node_lost: Fault = Fault(
    "node_lost",
    words="the node is gone",
    remedy="Look for what keeps the computer busy, or ended the node",
    detector="the driver: the ROS 2 context ended, or the node no longer feeds it",
    within=0.95 + ONE_STEP,
    action=Action.OFF,
    latches=True,
    while_off=True,
)

loop_hung: Fault = Fault(
    "loop_hung",
    words="the control loop hangs",
    remedy="Look for what stopped this process, or an instrument that does not keep its time-out",
    detector="the driver's watchman, a thread of its own: no step for safety.reading_timeout; where most of that is an "
    "instrument's, waited for within its time-outs, it is supply_lost or daq_lost",
    within=READING_TIMEOUT + 0.5,
    action=Action.OFF,
    latches=True,
    while_off=True,
)

partner_off: Fault = Fault(
    "partner_off",
    words="the other wire of the joint has a fault",
    remedy="See what its own status says; a wire alone would pull the joint over",
    detector="the pair: a fault has switched the other wire off, or its loop does not answer",
    within=ONE_STEP,
    action=Action.OFF,
    latches=True,
)


@guard(
    words="the command is not a current",
    remedy="This is a defect of the controller; please report it with the parameters",
    detector="last gate before the supply: the command is not finite, or below zero",
    within=seconds(0.0),
    action=Action.OFF,
    latches=True,
    each_step=False,
)
def command_invalid(wanted_A: float) -> str:
    """The command is not finite, or outside 0 to the highest current."""
    return "" if 0.0 <= wanted_A < inf else f"{wanted_A} A; a finite current of at least zero is wanted"


@guard(
    words="the clock jumped",
    remedy="Look for what stopped this process: a suspended computer, a full processor",
    detector="monotonic time of the loop not finite, running backwards, or ahead by more than "
    "safety.reading_timeout in one step; where most of that is an instrument's, it is supply_lost or daq_lost",
    within=ONE_STEP,
    action=Action.OFF,
    latches=True,
)
def clock_jump(step: Step) -> str:
    """The clock went back, or forward by more than readings may be late, while the wire is driven."""
    if not step.driven or step.is_timely or step.held_up_by("supply") or step.held_up_by("daq"):
        return ""
    return f"{step.dt_s:g} s since the step before; 0 to {step.config.safety.reading_timeout:g} s is plausible"


@guard(
    words="the control loop overruns",
    remedy="Lower loop.rate, or take other work off this computer; `sma-actuator check` says which rate the instruments allow",
    detector="loop.overruns_to_fault steps running, each later than 1.5 periods of loop.rate after the one before",
    within=parameter_value("loop.overruns_to_fault") * READING_TIMEOUT,
    action=Action.OFF,
    latches=True,
)
def loop_overrun(step: Step) -> str:
    """Steps came too late, several in a row."""
    late = step.memory.running("loop_overrun", step.driven and not step.dt_s <= OVERRUN_PERIODS / step.config.loop.rate)
    if late < step.config.loop.overruns_to_fault:
        return ""
    return f"{late} steps running came later than {OVERRUN_PERIODS:g} periods after the one before (loop.overruns_to_fault)"
