"""The program itself: exceptions, the node, the clock, commands that are none."""

from __future__ import annotations

from math import inf, isfinite
from numbers import Real

from sma_actuator.safety.formula import parameter_value, seconds
from sma_actuator.safety.records import Action, Fault, Step, guard
from sma_actuator.safety.timing import ONE_STEP, READING_TIMEOUT

#: A step later than this many periods after the one before is an overrun.
OVERRUN_PERIODS = 1.5
#: What a deadline that was met pays of those that were missed: up to a third of them may be missed for ever.
MET_COUNTS = 0.5
#: A gap that is shorter than safety.reading_timeout is none, nor are two: what is missed may take as long as so many.
GAPS = 2.0

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
    """The command is no number, not finite, or outside 0 to the highest current."""
    # A law of a plug-in may give anything; to ask an abstract class takes ten times as long.
    is_current = isinstance(wanted_A, (float, Real)) and 0.0 <= wanted_A < inf
    return "" if is_current else f"{wanted_A} A; one finite current of at least zero is wanted"


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
    remedy="Lower loop.rate, or take other work off this computer; `sma-actuator check` says which rate the "
    "instruments allow",
    detector="deadlines of loop.rate that steps missed, less half of those met since, are loop.overruns_to_fault, "
    "where a single gap counts for half of that at the most; or they took twice safety.reading_timeout. So steps are "
    "never further apart, on average, than one and a half periods",
    within=parameter_value("loop.overruns_to_fault") * READING_TIMEOUT,
    action=Action.OFF,
    latches=True,
)
def loop_overrun(step: Step) -> str:
    """Too many steps came too late, in a row or in a stutter: what is acted on is too old on average."""
    missed, most = step.dt_s * step.config.loop.rate - 1.0, step.config.loop.overruns_to_fault
    if not step.driven:
        change = at_most = -inf
    elif step.raw is None or step.supply is None:
        change = at_most = 0.0  # an answer that does not come is not the loop's: daq_lost, supply_lost
    elif -1.0 <= missed <= OVERRUN_PERIODS - 1.0:
        change = at_most = missed - MET_COUNTS  # one before its time makes up for one after it
    else:
        change = missed if isfinite(missed) else 1.0
        at_most = min(change, max(1.0, 0.5 * most))
    owed = step.memory.leaks("loop_overrun", at_most)
    owed_s = step.memory.leaks("missed", change) / step.config.loop.rate
    if owed < most - 1e-9 and owed_s < GAPS * step.config.safety.reading_timeout:
        return ""
    return (
        f"{owed:.3g} deadlines of {step.config.loop.rate:g} Hz were missed, and {owed_s:.3g} s, less half of those met "
        f"since; loop.overruns_to_fault is {most}, safety.reading_timeout {step.config.safety.reading_timeout:g} s"
    )
