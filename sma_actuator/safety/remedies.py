"""What a person can do about each fault and limit: the sentence that follows it in the log."""

from __future__ import annotations

_AFTER = "Then ~/clear_fault and ~/enable"

REMEDIES: dict[str, str] = {
    # faults
    "unhandled_exception": f"This is a defect of the program; please report it with this log. {_AFTER}",
    "node_lost": f"Look for what keeps the computer busy, or ended the node. {_AFTER}",
    "command_invalid": f"This is a defect of the controller; please report it with the parameters. {_AFTER}",
    "clock_jump": f"Look for what stopped this process: a suspended computer, a full processor. {_AFTER}",
    "supply_tripped": f"Find out what tripped it before anything else: a short, a limit set too low, a hung computer. {_AFTER}",
    "watchdog_not_held": f"See whether somebody has reset the supply, or locks its front panel. {_AFTER}",
    "limits_not_held": f"See who has changed the supply's limits, or reset it; opening it again sets them. {_AFTER}",
    "measurements_disagree": f"Compare what the supply displays with the DAQ's channels: one of them is wired wrongly or answers late. {_AFTER}",
    "second_commander": f"Let nobody else touch the supply: no second node, no hand at the front panel. {_AFTER}",
    "output_not_confirmed": "Look at the supply: if its output is on, switch it off by hand. " + _AFTER,
    "loop_hung": f"Look for the instrument that does not answer, or what stopped this process. {_AFTER}",
    "supply_lost": f"Check the supply's cable, address and mains. {_AFTER}",
    "daq_lost": f"Check the DAQ's cable, address and mains. {_AFTER}",
    "reading_saturated": f"Check the channel's wiring and range, and safety.channel_max_voltage. {_AFTER}",
    "reading_not_finite": "Check the DAQ's channels; the current stays at the bias until readings are finite again",
    "reading_stale": f"Check the DAQ's scan: it answers, but with old or unusable readings. {_AFTER}",
    "open_wire": f"Check the crimps and clamps of the wire, and supply.max_voltage against its resistance. {_AFTER}",
    "short": f"Look for what bridges the wire, and compare safety.resistance_min with it. {_AFTER}",
    "reading_implausible": f"Check the taps, the sense resistor and the load cell. {_AFTER}",
    "sensor_stuck": f"Check that channel's cable and amplifier. {_AFTER}",
    "stress_above_limit": f"Take load off the wire, or correct wire.max_stress and the load cell's calibration. {_AFTER}",
    "load_spike": f"Look for what knocked or caught the load. {_AFTER}",
    "too_hot": f"Let the wire cool, and ask less of it; see thermal.max_temperature. {_AFTER}",
    "heat_loss_wrong": f"Let air to the wire, or correct thermal.heat_loss and ambient_temperature. {_AFTER}",
    "supply_disagrees": f"Compare the supply's display with circuit.reference_resistance and the DAQ's channels. {_AFTER}",
    "no_motion": f"See whether the wire is held fast, slack or fully contracted, and whether the model is still its own. {_AFTER}",
    "estimator_outside": f"Compare load and resistance with what the model was identified on; identify it anew if they left it. {_AFTER}",
    "loop_overrun": f"Lower loop.rate, or take other work off this computer. {_AFTER}",
    "setpoint_stale": "Send setpoints again, faster than controller.setpoint_timeout",
    "setpoint_flood": "Find the source that publishes so fast; the last setpoint that was taken stands",
    "estimate_invalid": "Check the readings; the current stays at the bias until there is an estimate",
    "ambient_doubted": "Check the ambient sensor; thermal.ambient_temperature is taken instead",
    "setpoint_not_finite": "Mend the program that sent it; the last setpoint stands",
    # limits
    "setpoint_range": "Ask for positions inside model.displacement_range",
    "setpoint_reach": "Ask for positions that the wire can hold under this load, where its resistance tells where it is",
    "setpoint_rate": "The wire follows as fast as controller.setpoint_rate_limit allows",
    "current_max": "The wire heats as fast as its limits allow",
    "current_bias": "The wire cools as fast as its surroundings let it",
    "stress_near_limit": "Take load off the wire",
    "temperature_derating": "Give the wire time to cool",
}


def remedy(name: str) -> str:
    """What to do about the fault or limit of this name."""
    return REMEDIES.get(name, f"Find the cause. {_AFTER}")
