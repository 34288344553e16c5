"""Every way the bench can be told to misbehave."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan


@dataclass(frozen=True, slots=True)
class BenchFault:
    """One misbehaviour: what happens, and what its value means ("" = it takes none)."""

    effect: str
    value: str = ""
    default: float = nan


FAULTS: dict[str, BenchFault] = {
    "open_wire": BenchFault("the wire is broken: no current, the supply at its compliance voltage"),
    "short_wire": BenchFault("the wire is bridged by 0.02 Ω and does not heat"),
    "channel_stuck": BenchFault("a DAQ channel repeats its last sample", "channel", 103.0),
    "channel_saturated": BenchFault("a DAQ channel is over range", "channel", 103.0),
    "channel_nan": BenchFault("a DAQ channel reads NaN", "channel", 103.0),
    "load_spike": BenchFault("something pulls on the wire besides its load", "N", 5.0),
    "supply_silent": BenchFault("the supply does not answer (it still regulates)"),
    "daq_silent": BenchFault("the DAQ does not answer"),
    "supply_hangup": BenchFault("the supply closes its connections and refuses new ones"),
    "daq_hangup": BenchFault("the DAQ closes its connections and refuses new ones"),
    "current_disagrees": BenchFault("the supply delivers its setting times this factor", "factor", 0.5),
    "second_commander": BenchFault("someone at the front panel sets another current, once", "A", 0.2),
    "watchdog_dead": BenchFault("the watchdog takes its settings and never cuts; 0: it also reads back off", "1 or 0", 1.0),
    "draught": BenchFault("heat loss times this factor", "factor", 3.0),
    "hot_ambient": BenchFault("the surroundings are this warm", "°C", 45.0),
    "slow_answers": BenchFault("both instruments answer late", "s", 0.2),
}


def check_fault(name: str, value: float = nan) -> float:
    """The value to inject ``name`` with.  Raises ValueError with the known names."""
    if name not in FAULTS:
        raise ValueError(f"'{name}' is no fault of the bench; one of {', '.join(FAULTS)} is wanted")
    return FAULTS[name].default if value != value else float(value)
