"""What would hold up the first steps with current, done before."""

from __future__ import annotations

import math

from sma_actuator.actuator import Actuator
from sma_actuator.base.signals import Reading, SupplyState
from sma_actuator.config import Config
from sma_actuator.safety.timing import SETTLING_TIME_s


def warm_up(config: Config) -> None:
    """Drive a wire that does not exist, so that nothing is compiled or imported while the real one is driven.

    Loading the kernels takes some tenths of a second, and compiling them, once on a machine, many seconds, which the
    loop would miss in its first step with current.
    """
    actuator = Actuator(config)
    current_A, circuit, safety = config.supply.bias_current, config.circuit, config.safety
    wire_Ohm = math.sqrt(safety.resistance_min * safety.resistance_max)
    load_V = (0.5 * config.wire.max_stress * config.wire.area_m2 - config.load_cell.offset) / config.load_cell.slope
    for number in range(2 + math.ceil(2.0 * SETTLING_TIME_s * config.loop.rate)):
        now_s = number / config.loop.rate
        total_Ohm = circuit.reference_resistance + circuit.lead_resistance + wire_Ohm * (1.0 - 1e-4 * number)
        reading = Reading(now_s, current_A * total_Ohm, current_A * circuit.reference_resistance, load_V)
        actuator.step(now_s, reading, SupplyState(now_s, current_A, number > 0, current_A * total_Ohm, current_A))
        if number == 0:
            actuator.enable(now_s, True)
