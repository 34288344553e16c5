"""What would hold up the first steps with current, done before."""

from __future__ import annotations

import math

from sma_actuator.actuator import Actuator
from sma_actuator.base.signals import Output, Reading, SupplyState
from sma_actuator.config import Config
from sma_actuator.safety.timing import SETTLING_READINGS, SETTLING_TIME_s


def warm_up(config: Config) -> Output:
    """Drive a wire that does not exist, so that nothing is compiled or imported while the real one is driven; what it
    says last.

    Loading the kernels takes some tenths of a second, and compiling them, once on a machine, many seconds, which the
    loop would miss in its first step with current.
    """
    actuator, sensor, place_m = Actuator(config), config.reference_sensor, 0.0
    current_A, circuit, safety = config.supply.bias_current, config.circuit, config.safety
    ambient_C = config.thermal.ambient_temperature
    wire_Ohm = math.sqrt(safety.resistance_min * safety.resistance_max)
    load_V = (0.5 * config.wire.max_stress * config.wire.area_m2 - config.load_cell.offset) / config.load_cell.slope
    for number in range(3 + max(SETTLING_READINGS, math.ceil(2.0 * SETTLING_TIME_s * config.loop.rate))):
        now_s, less = number / config.loop.rate, 1.0 - 1e-5 * number  # nothing real stands still to the last digit
        total_Ohm = circuit.reference_resistance + circuit.lead_resistance + wire_Ohm * less
        # The step after enabling tells the supply to switch on, the one after that sees it.
        is_on = number > 1
        flows_A = current_A * less if is_on else 0.0
        voltages_V = (flows_A * total_Ohm, flows_A * circuit.reference_resistance, load_V * less)
        lvdt_A = (place_m - sensor.offset) / sensor.slope if sensor.fitted else 0.0
        reading = Reading(now_s, *voltages_V, lvdt_current_A=lvdt_A, ambient_temperature_C=ambient_C)
        supply = SupplyState(now_s, current_A, is_on, flows_A * total_Ohm, flows_A)
        output = actuator.step(now_s, reading, supply)
        if math.isfinite(output.estimate.displacement_m):
            place_m = output.estimate.displacement_m  # no other sensor contradicts it
        if number == 0:
            actuator.enable(now_s, True)
    return output
