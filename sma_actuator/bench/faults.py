"""Every way the bench can be told to misbehave."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isnan, nan

from .chain import CHANNELS


@dataclass(frozen=True, slots=True)
class BenchFault:
    """One misbehaviour: what happens, and what its value means ("" = it takes none)."""

    effect: str
    value: str = ""
    default: float = nan


FAULTS: dict[str, BenchFault] = {
    "open_wire": BenchFault("the wire is broken: no current, the supply at its compliance voltage"),
    "short_wire": BenchFault("the wire is bridged by this resistance and does not heat", "Ω", 0.0),
    "channel_stuck": BenchFault("a DAQ channel repeats its last sample", "channel", 103.0),
    "channel_dithers": BenchFault(
        "a DAQ channel repeats its last sample but for the converter's dither", "channel", 103.0
    ),
    "channel_swapped": BenchFault("a DAQ channel and the next one have changed places", "channel", 103.0),
    "channel_sinks": BenchFault("a DAQ channel sinks by a tenth of what it was each second", "channel", 103.0),
    "block_repeats": BenchFault("the DAQ gives one block again and again, with new times"),
    "channel_saturated": BenchFault("a DAQ channel is over range", "channel", 103.0),
    "channel_reversed": BenchFault("the leads of a DAQ channel are swapped", "channel", 103.0),
    "channel_nan": BenchFault("a DAQ channel reads NaN", "channel", 103.0),
    "load_spike": BenchFault("something pulls on the wire besides its load", "N", 5.0),
    "supply_silent": BenchFault("the supply hears and answers nothing (it still regulates)"),
    "daq_silent": BenchFault("the DAQ hears and answers nothing"),
    "supply_hangup": BenchFault("the supply closes its connections and refuses new ones"),
    "daq_hangup": BenchFault("the DAQ closes its connections and refuses new ones"),
    "current_disagrees": BenchFault("the supply delivers its setting times this factor", "factor", 0.5),
    "sense_drift": BenchFault("the sense resistor drifts, by this factor in ten seconds", "factor", 1.04),
    "voltage_drift": BenchFault(
        "the DAQ's channel of the supply's voltage drifts, by this factor in ten seconds", "factor", 1.04
    ),
    "output_welded": BenchFault("the supply says that its output is off, and delivers its setting all the same"),
    "second_commander": BenchFault("someone at the front panel sets another current, once, lock or not", "A", 0.2),
    "watchdog_dead": BenchFault(
        "the watchdog takes its settings and never cuts; 0: it also reads back off", "1 or 0", 1.0
    ),
    "draught": BenchFault("heat loss times this factor", "factor", 3.0),
    "hot_ambient": BenchFault("the surroundings are this warm", "°C", 45.0),
    "slow_answers": BenchFault("both instruments answer late", "s", 0.2),
}


def check_fault(name: str, value: float = nan) -> float:
    """The value to inject ``name`` with.  Raises ValueError with the known names."""
    if name not in FAULTS:
        raise ValueError(f"'{name}' is no fault of the bench; one of {', '.join(FAULTS)} is wanted")
    value = FAULTS[name].default if isnan(value) else float(value)
    if name.startswith("channel_") and value not in (CHANNELS[:-1] if name == "channel_swapped" else CHANNELS):
        raise ValueError(f"{name}: there is no channel {value:g}; {CHANNELS[0]} to {CHANNELS[-1]} exist")
    if FAULTS[name].value and not 0.0 <= value < inf:
        raise ValueError(f"{name}: {value:g} {FAULTS[name].value} is not a number of at least zero")
    return value


def parse_fault(text: str) -> tuple[str, float, float]:
    """``NAME[=VALUE][@TIME]`` as (name, value or NaN, bench time [s]).  Raises ValueError."""
    body, _, at = text.partition("@")
    name, _, value = body.partition("=")
    try:
        number, at_s = float(value or "nan"), float(at or "0")
    except ValueError:
        raise ValueError(f"'{text}' is no fault; NAME, NAME=VALUE or NAME=VALUE@SECONDS is wanted") from None
    check_fault(name, number)
    return name, number, at_s
