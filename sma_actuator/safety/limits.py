"""What bends a command: each limit, in the order in which they are named."""

from __future__ import annotations

from .formula import seconds
from .records import Limit
from .timing import ONE_STEP

SETPOINT_RANGE = Limit(
    "setpoint_range",
    "setpoint clipped to the working range",
    "setpoint outside the model's displacement range",
    ONE_STEP,
)
SETPOINT_RATE = Limit(
    "setpoint_rate",
    "setpoint rate limited",
    "setpoint changes faster than controller.setpoint_rate_limit",
    ONE_STEP,
)
CURRENT_MAX = Limit(
    "current_max",
    "current saturated at its upper limit",
    "controller asks for more than supply.max_current, or than what derating leaves of it",
    seconds(0.0),
)
CURRENT_BIAS = Limit(
    "current_bias",
    "current saturated at the bias",
    "controller asks for less than supply.bias_current: the wire cannot cool any faster",
    seconds(0.0),
)
STRESS_NEAR_LIMIT = Limit(
    "stress_near_limit",
    "stress near its bound: no further contraction",
    "stress above safety.stress_limit_fraction × wire.max_stress; neither current nor setpoint may go beyond where they are",
    ONE_STEP,
)
TEMPERATURE_DERATING = Limit(
    "temperature_derating",
    "current limit lowered by temperature",
    "heat balance above thermal.derate_temperature; the limit falls linearly from supply.max_current there to "
    "supply.bias_current at thermal.max_temperature",
    ONE_STEP,
)

LIMITS: dict[str, Limit] = {limit.name: limit for limit in list(vars().values()) if isinstance(limit, Limit)}
