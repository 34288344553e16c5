"""What the wire is asked for."""

from __future__ import annotations

from math import inf, isfinite, nan

from sma_actuator.safety.formula import longest, parameter_value, seconds
from sma_actuator.safety.parameters import SafetySections
from sma_actuator.safety.reach import PATIENCE_TIMES, TRIES, PATIENCE_s
from sma_actuator.safety.records import Action, guard
from sma_actuator.safety.timing import ONE_STEP, TWO_STEPS

#: Setpoints that may arrive at once, in seconds' worth of safety.setpoint_flood_rate, and in number.
FLOOD_BURST_s = 0.1
FLOOD_BURST_MIN = 10


@guard(
    words="the setpoint is lost",
    remedy="Send setpoints again, faster than controller.setpoint_timeout, joint commands than joint_command_timeout",
    detector="no setpoint for controller.setpoint_timeout while tracking (0: never), while joint commands are followed "
    "none "
    "for controller.joint_command_timeout; action controller.on_setpoint_loss, latched where that is off",
    within=longest(parameter_value("controller.setpoint_timeout"), parameter_value("controller.joint_command_timeout"))
    + ONE_STEP,
    action=Action.HOLD,
    action_by="controller.on_setpoint_loss",
    each_step=False,
)
def setpoint_stale(age_s: float, by_joint_command: bool, config: SafetySections) -> str:
    """No setpoint has come for too long."""
    controller = config.controller
    name = "joint_command_timeout" if by_joint_command else "setpoint_timeout"
    timeout_s = controller.joint_command_timeout if by_joint_command else controller.setpoint_timeout
    if timeout_s == 0.0 or -timeout_s <= age_s <= timeout_s:
        return ""
    return f"none for {age_s:.3g} s; controller.{name} is {timeout_s:g} s"


@guard(
    words="all the current there is does not move the wire",
    remedy="See whether the wire is held fast, slack or fully contracted, and whether the model is still its own",
    detector=f"limit setpoint_reach {TRIES} times running, and the wire never came to where it was backed off to",
    within=(TRIES + 1)
    * longest(
        PATIENCE_s, PATIENCE_TIMES * parameter_value("thermal.heat_capacity") / parameter_value("thermal.heat_loss")
    )
    + TWO_STEPS,
    action=Action.OFF,
    latches=True,
    each_step=False,
)
def no_motion(tries: int) -> str:
    """Full current moved nothing, and backing off did not help."""
    if tries < TRIES:
        return ""
    return f"backed off {tries} times running; is the estimate that of this wire and load?"


class Bucket:
    """Tokens, one for each setpoint, that come in at ``safety.setpoint_flood_rate``."""

    def __init__(self) -> None:
        self._tokens = inf
        self._filled_s = nan

    def take(self, now_s: float, rate_Hz: float) -> bool:
        """Take a token; whether there was one."""
        passed_s = now_s - self._filled_s
        if passed_s > 0.0:
            self._tokens += passed_s * rate_Hz
        self._tokens = min(self._tokens, max(FLOOD_BURST_MIN, FLOOD_BURST_s * rate_Hz))
        if isfinite(now_s):
            self._filled_s = now_s
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True


@guard(
    words="setpoints flood in",
    remedy="Find the source that publishes so fast; the last setpoint that was taken stands",
    detector=f"setpoints faster than safety.setpoint_flood_rate, after a burst of {FLOOD_BURST_s:g} s of them (at "
    f"least "
    f"{FLOOD_BURST_MIN}); those above the rate are refused",
    within=longest(FLOOD_BURST_s, FLOOD_BURST_MIN / parameter_value("safety.setpoint_flood_rate")),
    action=Action.HOLD,
    each_step=False,
)
def setpoint_flood(bucket: Bucket, now_s: float, config: SafetySections) -> str:
    """Setpoints come faster than they can mean anything."""
    rate_Hz = config.safety.setpoint_flood_rate
    if bucket.take(now_s, rate_Hz):
        return ""
    return f"setpoints come faster than safety.setpoint_flood_rate, {rate_Hz:g} Hz; this one is refused"


@guard(
    words="a setpoint was not finite",
    remedy="Mend the program that sent it; the last setpoint stands",
    detector="NaN or infinity in a setpoint or trajectory: refused on entry, the last one stands",
    within=seconds(0.0),
    action=Action.HOLD,
    each_step=False,
)
def setpoint_not_finite(position_m: float) -> str:
    """The setpoint is NaN or infinite."""
    return "" if isfinite(position_m) else f"setpoint {position_m}: a finite position in metres is wanted"
