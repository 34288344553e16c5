"""The parts of the self-test in which a little current flows: is it a wire, and do both instruments say so?"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from sma_actuator.base.signals import Reading, SupplyState
from sma_actuator.derived import LEADS_Ohm, compliance_V
from sma_actuator.estimation.circuit import signals_from_reading
from sma_actuator.safety.alive import RARE
from sma_actuator.safety.guards.supply import SETTING_TOLERANCE_A
from sma_actuator.safety.guards.wire import COMPLIANCE
from sma_actuator.safety.supervisor import may_flow_W, unwatched_s
from sma_actuator.safety.thermal import WireHeat

from .found import Level
from .output_off import ZERO_V
from .probe import WORDS, Probe

SETTLING_s = 0.4  #: after a change of the current
MORE_CURRENT = 2.0  #: times the bias, for a moment, to tell a zero error from a resistance
BEYOND_V = 1e30  #: no voltage: what instruments say of one that is over range
ZERO_A = 1e-6  #: what is less does not flow
#: The current may be off by this share of the bias, a voltage by this share of what the wire should show.
CURRENT_SHARE, VOLTAGE_SHARE = 0.1, 0.05
#: The wire may differ from its calibration by this share.
CALIBRATION_SHARE = 0.03
#: At which most wires have contracted: measured Flexinol by nine tenths at 97 (50 MPa) to 114 °C (200 MPa).
CONTRACTED_C = 115.0
#: Above the bias [A]: so close and so far that steps of 5 mA and more lie SETTING_TOLERANCE_A away from one at least.
BETWEEN_A = tuple(0.7e-3 * number for number in range(1, 9))


def at_bias(probe: Probe) -> None:
    """Bias current: does what flows agree with what was told, and is it a wire?"""
    config = probe.config
    probe.supply.set_current(config.supply.bias_current)
    probe.feeding = True
    probe.supply.set_output(True)
    probe.wait(SETTLING_s)
    values, state = probe.read(), probe.flows()
    _step(probe)
    for name in ("supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V"):
        if np.ptp(values[name]) == 0.0:
            probe.end(
                "channels",
                f"the channel of the {WORDS[name]} reads {values[name][0]:g} V to the last digit: nothing is "
                "connected to it, it is stuck, or its digits are coarser than any noise",
            )
    _digits(probe, values)
    supply_V, reference_V = (float(np.mean(values[n])) for n in ("supply_voltage_V", "reference_voltage_V"))
    _current(probe, supply_V, reference_V, state)
    _voltage(probe, supply_V, state.voltage_V)
    probe.resistance_Ohm = _resistance(probe, supply_V, reference_V)


def _digits(probe: Probe, values: Mapping[str, np.ndarray]) -> None:
    """Do they change where nothing moves, so that by chance alone no channel is taken for stuck?

    A slow loop reads seldom, so a few alike in a row last for long.
    """
    rate_Hz, stuck_s = probe.config.loop.rate, probe.config.safety.stuck_time
    alike, name = max((_alike(channel), name) for name, channel in values.items() if name != "time_s")
    chance_s = math.log(RARE) / math.log(alike) / rate_Hz if alike else 0.0
    if chance_s <= stuck_s:
        return
    gain = "more gain, or " if name == "load_cell_voltage_V" else ""
    probe.say(
        "digits",
        f"{100.0 * alike:.2g} % of the readings of the {WORDS[name]} are like another to the last digit, so that it "
        f"would be taken for stuck after safety.stuck_time, {stuck_s:g} s: write safety.stuck_time: "
        f"{math.ceil(chance_s)}, or give it {gain}more digits",
        Level.WARNING,
    )


def _alike(values: np.ndarray) -> float:
    """How often one reading is like the one before; where it does not drift, any two of them tell: of so few readings
    neighbours alone may not show what comes once in ten."""
    number = len(values)
    pairs = (np.count_nonzero(values[:, None] == values) - number) / (number * (number - 1))
    return max(float(np.mean(np.diff(values) == 0.0)), float(pairs))


def _step(probe: Probe) -> None:
    """With current: the highest rate that both allow."""
    pace = probe.pace()
    if pace.both_s == 0.0:
        return  # instruments in this process
    if pace.too_slow:
        probe.wrong("speed", pace.sentence)
    else:
        look = pace.is_tight or pace.could_be_twice_as_quick
        probe.say("speed", pace.sentence, Level.WARNING if look else Level.OK)


def _current(probe: Probe, supply_V: float, reference_V: float, state: SupplyState) -> None:
    bias_A, sense_Ohm = probe.config.supply.bias_current, probe.config.circuit.reference_resistance
    by_supply_A, voltage_V = state.current_A, state.voltage_V
    by_daq_A = reference_V / sense_Ohm
    near_A = CURRENT_SHARE * bias_A
    if abs(by_supply_A - bias_A) > near_A:
        if voltage_V >= 0.95 * probe.config.supply.max_voltage:
            otherwise = _wired_otherwise(probe, voltage_V / max(by_supply_A, ZERO_A))
            probe.end(
                "bias",
                f"{otherwise or 'the circuit is open'}: the supply is at its compliance voltage, {voltage_V:.3g} V, "
                f"and {by_supply_A * 1e3:.3g} mA flow{'' if otherwise else '; look at the crimps and the leads'}",
            )
        rounded = "; that is what its dialect's digits leave of supply.bias_current: choose one that they can write"
        probe.end(
            "bias",
            f"the supply was told {bias_A * 1e3:.3g} mA and says that it delivers {by_supply_A * 1e3:.3g} mA"
            f"{rounded if abs(by_supply_A + state.cut_off_A - bias_A) <= near_A else ''}",
        )
    if abs(by_daq_A - bias_A) <= near_A:
        probe.say(
            "bias",
            f"{by_daq_A * 1e3:.4g} mA flow of {bias_A * 1e3:.4g} mA, by the supply and by the sense resistor",
        )
    elif abs(-by_daq_A - bias_A) <= near_A:
        probe.end("sense resistor", "the current reads backwards: the taps of the sense resistor are swapped")
    elif abs(supply_V / sense_Ohm - bias_A) <= near_A:
        probe.end(
            "sense resistor",
            "the channels of supply voltage and sense resistor are swapped: what should be the whole circuit "
            "shows the sense resistor alone",
        )
    elif abs(reference_V) <= ZERO_V:
        probe.end("sense resistor", "no voltage at the sense resistor although the supply delivers: its taps are off")
    else:
        probe.end(
            "sense resistor",
            f"the sense resistor shows {reference_V * 1e3:.4g} mV at {by_supply_A * 1e3:.4g} mA, so it has "
            f"{reference_V / by_supply_A:.4g} Ω; circuit.reference_resistance is {sense_Ohm:g} Ω",
        )


def _voltage(probe: Probe, supply_V: float, by_supply_V: float) -> None:
    if abs(-supply_V - by_supply_V) <= VOLTAGE_SHARE * by_supply_V:
        probe.end("supply voltage", "the supply voltage reads backwards: its taps are swapped")
    if abs(supply_V - by_supply_V) > VOLTAGE_SHARE * by_supply_V + 0.01:
        why = "are the taps across wire, leads and sense resistor?"
        if abs(by_supply_V / probe.config.supply.max_voltage - 1.0) <= VOLTAGE_SHARE:
            why = "to that it was set; does its dialect ask for what it measures?"
        probe.wrong(
            "supply voltage",
            f"the DAQ reads {supply_V:.4g} V where the supply delivers {by_supply_V:.4g} V: {why}",
        )


def _resistance(probe: Probe, supply_V: float, reference_V: float) -> float:
    config = probe.config
    reading = Reading(0.0, supply_V, reference_V, 0.0)
    resistance_Ohm = signals_from_reading(reading, config).resistance_Ohm
    low_Ohm, high_Ohm = probe.expected_Ohm()
    wire = config.wire
    form = f", {wire.form_text}," if wire.form_text else ""
    of_wire = (
        f"{wire.length * 1e3:g} mm of {wire.diameter * 1e6:g} µm {wire.alloy}{form} have {low_Ohm:.3g} to "
        f"{high_Ohm:.3g} Ω (ρL/A, contracted to extended)"
    )
    if otherwise := _wired_otherwise(probe, resistance_Ohm):
        probe.end("resistance", f"{resistance_Ohm:.3g} Ω, and {of_wire}: {otherwise}")
    if resistance_Ohm < config.safety.resistance_min or resistance_Ohm < 0.5 * low_Ohm:
        probe.end("resistance", f"{resistance_Ohm:.3g} Ω: something bridges the wire; {of_wire}")
    more_Ohm, are_measured = resistance_Ohm - high_Ohm, config.circuit.lead_resistance > 0.0
    if not are_measured and not math.isfinite(probe.cold_Ohm) and 0.0 < more_Ohm <= LEADS_Ohm:
        probe.say(
            "leads",
            f"{resistance_Ohm:.4g} Ω with leads whose resistance is not measured yet, of which {more_Ohm:.3g} Ω or "
            f"more are theirs: {of_wire}; `sma-actuator characterise` measures them",
            Level.WARNING,
        )
    elif not low_Ohm <= resistance_Ohm <= high_Ohm:
        probe.wrong(
            "resistance",
            f"{resistance_Ohm:.4g} Ω, and {of_wire}: {_broken(probe, resistance_Ohm)}is wire.length that between "
            "the crimps, wire.diameter that of the wire, circuit.lead_resistance that of the leads?",
        )
    else:
        probe.say("resistance", f"{resistance_Ohm:.4g} Ω; {of_wire}")
        _leads(probe, resistance_Ohm)
    return resistance_Ohm


def _wired_otherwise(probe: Probe, resistance_Ohm: float) -> str:
    """Of a bundle that has what it would have if the current went the other way through its wires, a sentence; else
    ""."""
    wire = probe.config.wire
    if wire.form != "bundle" or wire.wires == 1:
        return ""
    other = dataclasses.replace(wire, connection="parallel" if wire.connection == "series" else "series")
    low_Ohm, high_Ohm = probe.expected_Ohm(other)
    if not low_Ohm <= resistance_Ohm <= high_Ohm + LEADS_Ohm:
        return ""
    return (
        f"in {other.connection} they have {low_Ohm:.3g} to {high_Ohm:.3g} Ω, as here; is wire.connection, "
        f"{wire.connection}, as they are wired?"
    )


def _broken(probe: Probe, resistance_Ohm: float) -> str:
    """Of wires in parallel that have what fewer of them have, a sentence; else ""."""
    wire, cold_Ohm = probe.config.wire, probe.cold_Ohm
    if wire.connection != "parallel" or not math.isfinite(cold_Ohm):
        return ""
    carry = round(wire.wires * cold_Ohm / resistance_Ohm)
    if not 1 <= carry < wire.wires:
        return ""
    if abs(carry * resistance_Ohm / wire.wires - cold_Ohm) > CALIBRATION_SHARE * cold_Ohm:
        return ""
    return f"that is what {carry} of its {wire.wires} wires have: look for one that is broken or out of its crimp; or "


def _leads(probe: Probe, resistance_Ohm: float) -> None:
    config, cold_Ohm = probe.config, probe.cold_Ohm
    if not math.isfinite(cold_Ohm):
        probe.say("leads", "not told: no calibration says what the cold wire has", Level.WARNING)
        return
    more_Ohm = resistance_Ohm - cold_Ohm
    if abs(more_Ohm) <= CALIBRATION_SHARE * cold_Ohm:
        probe.say("leads", f"{more_Ohm:+.3f} Ω beside the calibration at cold rest ({cold_Ohm:.4g} Ω)")
        return
    side = "more" if more_Ohm > 0 else "less"
    probe.wrong(
        "leads",
        f"{abs(more_Ohm):.3g} Ω {side} than the calibration has at cold rest ({cold_Ohm:.4g} Ω): "
        f"{_broken(probe, resistance_Ohm)}the leads have other than circuit.lead_resistance, "
        f"{config.circuit.lead_resistance:g} Ω (~/measure_lead_resistance), the wire is not cold yet, or it is another",
    )


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
        _compliance(probe, reading)


def _compliance(probe: Probe, reading: Reading) -> None:
    """Does the supply's voltage drive the largest current through the cold wire?"""
    config = probe.config
    circuit_Ohm = config.circuit.reference_resistance * reading.supply_voltage_V / reading.reference_voltage_V
    wanted_V = circuit_Ohm * config.supply.max_current
    if wanted_V > COMPLIANCE * config.supply.max_voltage:
        probe.say(
            "voltage",
            f"supply.max_voltage, {config.supply.max_voltage:g} V, drives no more than "
            f"{config.supply.max_voltage / circuit_Ohm:.3g} A through wire, leads and sense resistor, "
            f"{circuit_Ohm:.3g} Ω, and the driver switches off where it asks for supply.max_current, "
            f"{config.supply.max_current:g} A, in vain: write supply.max_voltage: "
            f"{compliance_V(wanted_V):g}, or less for supply.max_current",
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
