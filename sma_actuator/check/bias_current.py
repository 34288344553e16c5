"""The part of the self-test at bias current: do all channels read, does what was told flow, and is it a wire?"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from sma_actuator.base.signals import SupplyState
from sma_actuator.safety.alive import RARE

from .found import Level
from .output_off import ZERO_V
from .probe import WORDS, Probe
from .resistance import resistance, wired_otherwise

SETTLING_s = 0.4  #: after a change of the current
ZERO_A = 1e-6  #: what is less does not flow
#: The current may be off by this share of the bias, a voltage by this share of what the wire should show.
CURRENT_SHARE, VOLTAGE_SHARE = 0.1, 0.05


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
    probe.resistance_Ohm = resistance(probe, supply_V, reference_V)


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
            otherwise = wired_otherwise(probe, voltage_V / max(by_supply_A, ZERO_A))
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
