"""The parts of the self-test with the output off: who the instruments are, how quick, their zeros and the load."""

from __future__ import annotations

import contextlib
import dataclasses
import logging

import numpy as np

from sma_actuator.base.calibration import through
from sma_actuator.base.parameters import to_mapping
from sma_actuator.config import Config
from sma_actuator.derived import derived, not_survived
from sma_actuator.instruments import Daq, InstrumentError, PowerSupply

from .found import Level, passed
from .pace import LEAST_RATE_Hz
from .probe import WORDS, Probe

#: Volts that may stand at a channel: a share of what the bias makes of it, and beside that.
ZERO_SHARE, ZERO_V = 0.03, 1e-3
OTHER_SHARE = 0.3  #: the same, ten times as much, from which it is no zero error any more
NOISE_SHARE = 0.02  #: the same of a channel's noise; for the load, of the load at wire.max_stress
LEAST_LOAD_SHARE = 0.01  #: of the load at wire.max_stress, below which the sign of the load cell cannot be told
PERIOD_SHARE = 0.2  #: by which the DAQ may be slower than the loop

#: What of a supply is not safe is logged by this module, which loads pyvisa: the node's processes begin without it.
_UNSAFE = "sma_actuator.instruments.supply"


def identity(probe: Probe) -> str:
    """Open both, output off: who are they?"""
    probe.supply.open()
    probe.opened = True
    probe.daq.open()
    probe.identity = probe.supply.identity
    return f"the supply is {probe.supply.identity}; the DAQ is {probe.daq.identity}"


def opening(probe: Probe, supply: PowerSupply, daq: Daq) -> bool:
    """Do both answer when they are opened within the time-outs of the parameters, as the node opens them?

    Whether the output is off still, which was read back before.
    """
    opened = False
    unsafe = logging.getLogger(_UNSAFE)  # of what it cannot do was said when it was opened first
    level = unsafe.level
    unsafe.setLevel(logging.ERROR)
    try:
        supply.open()
        opened = True
        daq.open()
        probe.say("opening", "both are opened once more within the time-outs that the node has for that")
    except InstrumentError as error:
        probe.wrong("opening", f"within the time-outs that the node has for that they are not: {error}")
    finally:
        unsafe.setLevel(level)
        off = supply.shut_down() or not opened
        for instrument in (supply, daq):
            instrument.close()
    return off


def limits(probe: Probe) -> None:
    """Has the supply taken what holds whatever the computer does, and would the wire survive that?"""
    state = probe.supply.read_back()
    if state.tripped:
        probe.end("trips", f"a protection of the supply has tripped already ({state.tripped}): find out why")
    if state.output_on:
        probe.end("trips", "the output is on although it was told to be off: somebody else commands the supply")
    probe.supply.check_settings()
    limits = probe.config.supply
    settings = {
        "voltage_setting": ("compliance voltage", f"{limits.max_voltage:g} V"),
        "over_current_trip": ("over-current trip", f"{limits.over_current_trip:g} A"),
    }
    told = probe.supply.reads_back
    held = " and ".join(f"{what} {value}" for name, (what, value) in settings.items() if name in told)
    lacking = " and no ".join(what for name, (what, _) in settings.items() if name not in told)
    hot = not_survived(probe.config.wire, limits, probe.config.thermal)
    probe.say(
        "trips",
        (f"{held} read back as programmed; " if held else "")
        + "nothing has tripped"
        + (f"; this supply has no {lacking} that can be read back" if lacking else "")
        + (f"; {hot}" if hot else ""),
        Level.WARNING if hot else Level.OK,
    )


def displacement(probe: Probe) -> None:
    """Is it measured, where a model is still to be made?"""
    if not isinstance(probe.config, Config) and not probe.config.instruments.daq.lvdt_channel:
        probe.say(
            "displacement",
            "not measured: instruments.daq.lvdt_channel is 0; `sma-actuator characterise` needs a sensor there",
            Level.WARNING,
        )


def speed(probe: Probe) -> None:
    """Output off: both quick enough for the loop and its time-outs?  Slower ones give no later part a chance."""
    _block(probe)
    pace = probe.pace()
    if pace.too_slow:
        probe.end("speed", pace.sentence)


def gains(probe: Probe) -> None:
    """Are they those of a quicker loop, as where ``loop.rate`` was lowered in the file that ``init`` had written?"""
    kp = getattr(probe.config.controller, "kp", None)
    mapping = to_mapping(probe.config)
    del mapping["controller"]
    here = derived(mapping)
    del mapping["loop"]
    quick_A_m = derived(mapping)["controller.kp"].value  # at the rate that such a wire gets
    here_A_m, here_A_m_s = (here[f"controller.{name}"].value for name in ("kp", "ki"))
    if kp == quick_A_m > here_A_m:
        probe.say(
            "gains",
            f"controller.kp, {kp:g} A/m, is that of a quicker loop: at {probe.config.loop.rate:g} Hz the wire hunts to "
            f"and fro about its setpoint; write controller.kp: {here_A_m:g}, controller.ki: {here_A_m_s:g}",
            Level.WARNING,
        )


def _block(probe: Probe) -> None:
    """Is a block of several readings one that any loop could wait for?  What a shorter one takes is not known."""
    samples, began_s = probe.config.loop.samples_per_block, probe.clock.now_s()
    late: InstrumentError | None = None
    try:
        probe.daq.read_block()
    except InstrumentError as error:
        late = error
    took_s = probe.clock.now_s() - began_s
    if samples > 1 and took_s > 1.0 / LEAST_RATE_Hz:
        more = "more than " if late else ""
        wanted = {"loop.samples_per_block": 1.0} | _with_one_reading(probe)
        probe.end(
            "speed",
            f"a block of {samples} readings of each channel takes the DAQ {more}{took_s:.2g} s, as where it reads "
            f"one channel after the other, and a step may take {1.0 / LEAST_RATE_Hz:g} s at the most; write "
            + ", ".join(f"{name}: {value:g}" for name, value in wanted.items()),
        )
    if late is not None:
        raise late


def _with_one_reading(probe: Probe) -> dict[str, float]:
    """What else is to be written where a block is one reading, by a DAQ that is opened anew for such; nothing where
    that cannot be seen now."""
    if probe.other_daq is None:
        return {}
    probe.daq.close()
    probe.config = dataclasses.replace(probe.config, loop=dataclasses.replace(probe.config.loop, samples_per_block=1))
    probe.daq = probe.other_daq(probe.config)
    with contextlib.suppress(InstrumentError):
        probe.daq.open()
        return probe.pace().wanted
    return {}


def at_rest(probe: Probe) -> None:
    """Output off: rate, zeros, noise and the load."""
    config = probe.config
    values = probe.read()
    _rate(probe, values["time_s"])
    for name, channel in values.items():
        if not np.isfinite(channel).all() or (
            name != "time_s" and (np.abs(channel) >= config.safety.channel_max_voltage).any()
        ):
            probe.end(
                "channels",
                f"the channel of the {WORDS[name]} reads {channel[-1]:g} V: is it connected, and its range right?",
            )
    bias_V = config.supply.bias_current * config.circuit.reference_resistance
    wire_V = config.supply.bias_current * probe.expected_Ohm()[0]
    most_N = config.wire.max_stress * config.wire.area_m2
    bounds_V = {
        "reference_voltage_V": bias_V,
        "supply_voltage_V": wire_V,
        "load_cell_voltage_V": most_N / abs(config.load_cell.slope),
    }
    for name, full_V in bounds_V.items():
        noise_V = float(np.std(values[name]))
        if noise_V > NOISE_SHARE * full_V:
            probe.wrong(
                "noise",
                f"the channel of the {WORDS[name]} has {noise_V * 1e3:.3g} mV of noise; "
                f"{NOISE_SHARE * full_V * 1e3:.3g} mV is the most that can be used: screen and ground it",
            )
    for name in ("reference_voltage_V", "supply_voltage_V"):
        zero_V = float(np.mean(values[name]))
        if abs(zero_V) > OTHER_SHARE * bounds_V[name] + ZERO_V:
            probe.end(
                "zeros",
                f"the channel of the {WORDS[name]} reads {zero_V * 1e3:.3g} mV with the output off, no zero error but "
                "another sensor, as the load cell's amplifier or that of displacement; compare "
                f"instruments.daq.{name.removesuffix('_V')}_channel with the cables",
            )
        if abs(zero_V) > ZERO_SHARE * bounds_V[name] + ZERO_V:
            probe.wrong(
                "zeros",
                f"the channel of the {WORDS[name]} reads {zero_V * 1e3:.3g} mV with the output off, not zero",
            )
    if passed(probe.found):
        probe.say("noise", "zeros and noise of the channels are what they may be")
    _load(probe, values)


def _rate(probe: Probe, time_s: np.ndarray) -> None:
    # A slow DAQ is slow with every block, a busy computer with some: the quickest tenth are the DAQ's.
    period_s, wanted_s = float(np.quantile(np.diff(time_s), 0.1)), 1.0 / probe.config.loop.rate
    if not period_s <= (1.0 + PERIOD_SHARE) * wanted_s:
        probe.wrong(
            "rate",
            f"the DAQ gives a new block every {period_s * 1e3:.3g} ms; loop.rate wants one every "
            f"{wanted_s * 1e3:.3g} ms",
        )
    else:
        probe.say("rate", f"a new block every {period_s * 1e3:.3g} ms")


def _load(probe: Probe, values: dict[str, np.ndarray]) -> None:
    cell, wire = probe.config.load_cell, probe.config.wire
    if not cell.calibrated:
        probe.say(
            "load cell", "not told: it has no calibration yet; `sma-actuator characterise` makes it", Level.WARNING
        )
        return
    most_N = wire.max_stress * wire.area_m2
    load_N = float(np.mean(values["load_cell_voltage_V"])) * cell.slope + cell.offset
    if load_N < -LEAST_LOAD_SHARE * most_N:
        probe.wrong(
            "load cell",
            f"the load is {load_N:.3g} N: a wire cannot push; swap the load cell's leads, or the sign of "
            f"load_cell.slope",
        )
    elif load_N > most_N:
        probe.end(
            "load cell",
            f"the load is {load_N:.3g} N, more than wire.max_stress allows, {most_N:.3g} N: take load off, or "
            "correct load_cell.slope and offset",
        )
    elif load_N < LEAST_LOAD_SHARE * most_N:
        probe.say(
            "load cell",
            f"the load is {load_N:.3g} N: hang something on the wire, so that the sign can be told",
            Level.WARNING,
        )
    else:
        probe.say("load cell", f"the load is {load_N:.3g} N and pulls")
    # While nothing flows: a first curve is slow, and meanwhile nobody would feed the watchdog.
    rest = probe.config.calibration.rest
    if rest.cold_resistance:
        probe.cold_Ohm = float(through(rest.cold_stress, rest.cold_resistance, load_N / wire.area_m2))
