"""What bends a command: each limit, in the order in which they are named."""

from __future__ import annotations

from .formula import longest, parameter_value, seconds
from .reach import (
    BACK_OFF,
    BEYOND_K,
    FIRST_AGAIN_TIMES,
    LAST_AGAIN_TIMES,
    MOTION,
    PATIENCE_TIMES,
    WARM,
    PATIENCE_s,
)
from .records import Limit
from .thermal import LOSING_TIMES, NOT_CONTRACTED_MARGIN, SUDDENLY
from .timing import ONE_STEP, TWO_STEPS
from .transformed import CAPACITY_WITHIN, LEAST_SLOPE_1_K

SETPOINT_RANGE = Limit(
    "setpoint_range",
    "setpoint held at the end of what can be reached now",
    "Ask for positions between shortest_m and longest_m of the status, or change the load",
    "setpoint shorter or longer than the wire can be held at its present load: the ends of the calibration at this "
    "stress, inside model.displacement_range for the thesis's models; no shorter than the heat reaches that "
    "supply.max_current holds (without a watchdog: thermal.unwatched_margin). Beyond its long end a wire of the "
    "whole-range model is let go, at the bias: no heat holds it back. Without a calibration: model.displacement_range",
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
    "controller.type feed_forward_pid: the setpoint moves faster than the wire can heat with the current there is, or "
    "cool",
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
    "stress above safety.stress_limit_fraction × wire.max_stress; neither current nor setpoint may go beyond where "
    "they are",
    ONE_STEP,
)
TEMPERATURE_DERATING = Limit(
    "temperature_derating",
    "current limit lowered by temperature",
    "Give the wire time to cool. Where it stays short of its setpoint: `sma-actuator check` says how hot it may become "
    "and what decides that",
    "the largest current that leaves the wire below thermal.max_temperature until supply.watchdog_timeout cuts it "
    "(where there is none: for ever, in a wire that loses heat_loss / unwatched_margin), by the closest of "
    "[these](guards.md#heat): its resistance (thermal.transformed_temperature at its least, and 1 K for each "
    f"{LEAST_SLOPE_1_K:g} more, or two thirds of what identify saw; how slowly it falls as it cools; its "
    f"calibration, with {CAPACITY_WITHIN:g} times the rise); heat_loss / "
    f"heat_loss_margin ({NOT_CONTRACTED_MARGIN:g} at the most until it has contracted); {SUDDENLY:g} of what it has "
    f"shown to lose over {LOSING_TIMES:g} time constants. Above thermal.derate_temperature linearly down to "
    "supply.bias_current. A wire of which nothing is known gets the bias until its resistance, which would fall, or "
    "the heat balance with that margin says that it is no hotter than thermal.transformed_temperature",
    ONE_STEP,
)

ANSWER_LATE = Limit(
    "answer_late",
    "an instrument answers late: the bias current until it does",
    "Take other work off this computer, or off the instruments' network; where they are always so slow, raise "
    "instruments.supply.timeout or instruments.daq.timeout",
    "no complete answer within instruments.supply.timeout or instruments.daq.timeout, which may still come, or one "
    "that came later than that; the setpoint stands, and what does not come is supply_lost or daq_lost",
    longest(parameter_value("instruments.supply.timeout"), parameter_value("instruments.daq.timeout")) + ONE_STEP,
)
SETPOINT_REACH = Limit(
    "setpoint_reach",
    "no further contraction: no more heat moves the wire",
    "Ask for positions that the wire can hold under this load, where its resistance tells where it is",
    f"not {100 * MOTION:g} % of the full stroke of motion towards the setpoint for the longer of {PATIENCE_s:g} s and "
    f"{PATIENCE_TIMES:g} of its time constants, with all of supply.max_current in a wire that is {100 * WARM:g} % as "
    f"warm as that makes it and further than {100 * MOTION:g} % from the setpoint, or with all that the limits leave "
    f"in one that is {BEYOND_K:g} K hotter than "
    "it has contracted at this stress. The shortest setpoint is then "
    f"{100 * BACK_OFF:g} % longer than the wire seems to be, until another is asked for, the load changes, or it is "
    f"tried again: after {FIRST_AGAIN_TIMES:g} time constants, in vain twice as long, at most {LAST_AGAIN_TIMES:g}",
    longest(
        PATIENCE_s, PATIENCE_TIMES * parameter_value("thermal.heat_capacity") / parameter_value("thermal.heat_loss")
    )
    + TWO_STEPS,
)

LIMITS: dict[str, Limit] = {limit.name: limit for limit in list(vars().values()) if isinstance(limit, Limit)}
