"""What bends a command: each limit, in the order in which they are named."""

from __future__ import annotations

from .formula import longest, parameter_value, seconds
from .reach import BACK_OFF, BEYOND_K, MOTION, PATIENCE_TIMES, WARM, PATIENCE_s
from .records import Limit
from .timing import ONE_STEP, TWO_STEPS

SETPOINT_RANGE = Limit(
    "setpoint_range",
    "setpoint clipped to the working range",
    "Ask for positions inside model.displacement_range",
    "setpoint outside the model's displacement range",
    ONE_STEP,
)
SETPOINT_RATE = Limit(
    "setpoint_rate",
    "setpoint rate limited",
    "The wire follows as fast as controller.setpoint_rate_limit allows",
    "setpoint changes faster than controller.setpoint_rate_limit",
    ONE_STEP,
)
SETPOINT_PACE = Limit(
    "setpoint_pace",
    "setpoint shaped to what the wire can follow",
    "Ask for slower motion; a wire cools no faster than its surroundings let it",
    "controller.type feed_forward_pid: the setpoint moves faster than the wire can heat with the current there is, or cool",
    ONE_STEP,
)
CURRENT_MAX = Limit(
    "current_max",
    "current saturated at its upper limit",
    "The wire heats as fast as its limits allow",
    "controller asks for more than supply.max_current, or than what derating leaves of it",
    seconds(0.0),
)
CURRENT_BIAS = Limit(
    "current_bias",
    "current saturated at the bias",
    "The wire cools as fast as its surroundings let it",
    "controller asks for less than supply.bias_current: the wire cannot cool any faster",
    seconds(0.0),
)
STRESS_NEAR_LIMIT = Limit(
    "stress_near_limit",
    "stress near its bound: no further contraction",
    "Take load off the wire",
    "stress above safety.stress_limit_fraction × wire.max_stress; neither current nor setpoint may go beyond where they are",
    ONE_STEP,
)
TEMPERATURE_DERATING = Limit(
    "temperature_derating",
    "current limit lowered by temperature",
    "Give the wire time to cool",
    "the largest current that could flow on until supply.watchdog_timeout cuts it (for ever, where there is no watchdog) "
    "and leave the wire below thermal.max_temperature even if it lost only heat_loss / heat_loss_margin; and above "
    "thermal.derate_temperature, by the parameters' heat_loss, from supply.max_current linearly down to "
    "supply.bias_current at max_temperature. A wire of which nothing is known yet counts as that hot",
    ONE_STEP,
)

SETPOINT_REACH = Limit(
    "setpoint_reach",
    "no further contraction: all the current there is does not move the wire",
    "Ask for positions that the wire can hold under this load, where its resistance tells where it is",
    f"all the current there is, a wire that is warm from it ({100 * WARM:g} % of what it will be, or {BEYOND_K:g} K more "
    "than a contracted wire was at its calibration), and for the longer of "
    f"{PATIENCE_s:g} s and {PATIENCE_TIMES:g} of its time constants not {100 * MOTION:g} % of the full stroke of motion towards "
    f"the setpoint; the shortest setpoint is then {100 * BACK_OFF:g} % longer than the wire seems to be, until a longer one "
    "is asked for or the load changes",
    longest(
        PATIENCE_s, PATIENCE_TIMES * parameter_value("thermal.heat_capacity") / parameter_value("thermal.heat_loss")
    )
    + TWO_STEPS,
)

LIMITS: dict[str, Limit] = {limit.name: limit for limit in list(vars().values()) if isinstance(limit, Limit)}
