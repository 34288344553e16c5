"""The parts of the self-test at other currents than the bias: are they obeyed, and what would the largest do?"""

from __future__ import annotations

import math

from sma_actuator.derived import compliance_V
from sma_actuator.estimation.circuit import signals_from_reading
from sma_actuator.safety.guards.supply import SETTING_TOLERANCE_A
from sma_actuator.safety.guards.wire import COMPLIANCE
from sma_actuator.safety.supervisor import may_flow_W, unwatched_s
from sma_actuator.safety.thermal import WireHeat

from .found import Level
from .probe import WORDS, Probe
from .resistance import CALIBRATION_SHARE

MORE_CURRENT = 2.0  #: times the bias, for a moment, to tell a zero error from a resistance
BEYOND_V = 1e30  #: no voltage: what instruments say of one that is over range
#: At which most wires have contracted: measured Flexinol by nine tenths at 97 (50 MPa) to 114 °C (200 MPa).
CONTRACTED_C = 115.0
#: Above the bias [A]: so close and so far that steps of 5 mA and more lie SETTING_TOLERANCE_A away from one at least.
BETWEEN_A = tuple(0.7e-3 * number for number in range(1, 9))


def at_more(probe: Probe) -> None:
    """A moment of more current: a resistance stays what it is, a zero error of a channel does not look like one."""
    config = probe.config
    more_A = min(MORE_CURRENT * config.supply.bias_current, config.supply.max_current)
    with probe.other_currents():
        probe.supply.set_current(more_A)
        probe.wait(2.0 / config.loop.rate + config.loop.samples_per_block / config.loop.sample_rate)
        reading = probe.daq.read_block()
        state = probe.flows()
    if not state.output_on:
        probe.end(
            "linearity",
            f"the output went off by itself while {more_A * 1e3:.3g} mA were told: a protection that the dialect does "
            "not name, another program, or a hand at the supply; look at its panel",
        )
    for name in ("supply_voltage_V", "reference_voltage_V"):
        if not abs(getattr(reading, name)) < BEYOND_V:
            probe.end(
                "linearity",
                f"the {WORDS[name]} is beyond the range of its channel at {more_A * 1e3:.3g} mA, and "
                f"{config.supply.max_current * 1e3:.3g} mA may flow: give that channel a larger one, up to "
                f"{config.supply.max_voltage:g} V (supply.max_voltage)",
            )
    signals = signals_from_reading(reading, config)
    away_Ohm = probe.resistance_Ohm - signals.resistance_Ohm
    offset_V = away_Ohm / (1.0 / config.supply.bias_current - 1.0 / more_A)
    if not abs(away_Ohm) <= CALIBRATION_SHARE * probe.resistance_Ohm:
        probe.wrong(
            "linearity",
            f"{probe.resistance_Ohm:.4g} Ω at {config.supply.bias_current * 1e3:.3g} mA and "
            f"{signals.resistance_Ohm:.4g} Ω at {more_A * 1e3:.3g} mA: a voltage channel has a zero error of about "
            f"{offset_V * 1e3:.3g} mV, or a contact is bad",
        )
    else:
        probe.say("linearity", f"the same resistance at {more_A * 1e3:.3g} mA, within {abs(away_Ohm):.2g} Ω")
        circuit_Ohm = config.circuit.reference_resistance * reading.supply_voltage_V / reading.reference_voltage_V
        _at_the_largest(probe, circuit_Ohm)


def _at_the_largest(probe: Probe, circuit_Ohm: float) -> None:
    """Do the supply's voltage and the channels reach as far as the largest current makes of the cold circuit?"""
    config = probe.config
    most_A, max_V, ends_V = config.supply.max_current, config.supply.max_voltage, config.safety.channel_max_voltage
    wanted_V = circuit_Ohm * most_A
    if wanted_V > COMPLIANCE * max_V:
        probe.say(
            "voltage",
            f"supply.max_voltage, {max_V:g} V, drives no more than {max_V / circuit_Ohm:.3g} A through wire, leads and "
            f"sense resistor, {circuit_Ohm:.3g} Ω, and the driver switches off where it asks for supply.max_current, "
            f"{most_A:g} A, in vain: write supply.max_voltage: {compliance_V(wanted_V):g}, or less for "
            "supply.max_current",
            Level.WARNING,
        )
    for name, each_Ohm in (
        ("supply_voltage_V", circuit_Ohm),
        ("reference_voltage_V", config.circuit.reference_resistance),
    ):
        if each_Ohm * most_A >= ends_V:
            probe.say(
                "range",
                f"the channel of the {WORDS[name]} comes to {each_Ohm * most_A:.3g} V at supply.max_current, "
                f"{most_A:g} A, and ends at {ends_V:g} V by safety.channel_max_voltage, where the driver switches off: "
                "give it a larger range in the DAQ's dialect and write that, or supply.max_current: "
                f"{math.floor(0.99e3 * ends_V / each_Ohm) / 1e3:g}, or less",
                Level.WARNING,
            )


def between(probe: Probe) -> None:
    """Currents that a controller asks for: steps that are too coarse look like a second commander to the driver."""
    supply = probe.config.supply
    most_A = min(MORE_CURRENT * supply.bias_current, supply.max_current)
    with probe.other_currents():
        for more_A in BETWEEN_A:
            wanted_A = min(supply.bias_current + more_A, most_A)
            probe.supply.set_current(wanted_A)
            state = probe.flows()
            found_A = state.current_setting_A
            if abs(found_A + state.cut_off_A - wanted_A) > SETTING_TOLERANCE_A:
                probe.wrong(
                    "steps",
                    f"the supply was told {wanted_A * 1e3:.4g} mA and reads back {found_A * 1e3:.4g} mA: it takes "
                    "currents in coarser steps than its dialect writes, as {value:.2f} for 10 mA",
                )
                return


def heat(probe: Probe) -> None:
    """How hot the limit of current lets the wire become, before it has shown what heat it loses."""
    config, thermal = probe.config, probe.config.thermal
    heat = WireHeat(thermal)
    heat.cools, heat.at_most_C = False, thermal.transformed_temperature
    most_W, name = min(
        zip(may_flow_W(heat, config, unwatched_s(config)), ("heat_loss_margin", "unwatched_margin"), strict=True)
    )
    max_W = config.supply.max_current**2 * probe.resistance_Ohm
    flows_W = min(most_W, max_W)
    held_C, comes_C = (thermal.ambient_temperature + each_W / thermal.heat_loss for each_W in (most_W, flows_W))
    said = (
        f"no more than {math.sqrt(flows_W / probe.resistance_Ohm) * 1e3:.3g} mA flow, of which the wire comes to "
        f"{comes_C:.0f} °C by thermal.heat_loss"
    )
    said += " (supply.max_current)" if max_W <= most_W else ", until it has shown what heat it loses"
    if held_C >= CONTRACTED_C:
        probe.say("heat", said)
        return
    sooner = (
        f", or to be looked at more often than every {unwatched_s(config):.2g} s (supply.watchdog_timeout, "
        "safety.reading_timeout; docs/guards.md)"
        if name == "heat_loss_margin"  # the other one holds for ever
        else ""
    )
    said += f": one that contracts only hotter wants a thermal.{name} below {getattr(thermal, name):g}{sooner}"
    probe.say("heat", said, Level.WARNING)
