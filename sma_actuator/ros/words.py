"""What the node says in its log: each event once, each refusal in its own words, nothing as a flood."""

from __future__ import annotations

import collections
import re
from collections.abc import Iterator, Mapping

from sma_actuator.base.signals import Mode, Status
from sma_actuator.safety.faults import FAULTS, LIMITS, Fault, Limit
from sma_actuator.safety.remedies import REMEDIES

INFO, WARNING, ERROR = "info", "warning", "error"
#: A refusal that only repeats another with different numbers is said again after this time.
REPEAT_s = 1.0
#: Different refusals that may be said within that time; a flood of them is only counted.
MOST_REFUSALS = 8
#: A limit that comes and goes is said again once it has not acted for so long.
LIMIT_PAUSE_s = 10.0

_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?|\bnan\b|\binf\b")


class Refusals:
    """Lets through one refusal of each kind a second, and counts the others."""

    def __init__(self) -> None:
        self._said_s: dict[str, float] = {}
        self._held_back = 0

    def worth_saying(self, sentence: str, now_s: float) -> str:
        """The sentence as it should be said now, or ""."""
        kind = _NUMBER.sub("#", sentence)
        self._said_s = {kind: when_s for kind, when_s in self._said_s.items() if now_s - when_s < REPEAT_s}
        if kind in self._said_s or len(self._said_s) >= MOST_REFUSALS:
            self._held_back += 1
            return ""
        self._said_s[kind] = now_s
        held_back, self._held_back = self._held_back, 0
        return f"{sentence} ({held_back} more were not shown)" if held_back else sentence


class Events:
    """Turns the states that a wire passes through into sentences, each when it begins."""

    def __init__(self) -> None:
        self._mode = Mode.OFF
        self._fault = ""
        self._passing: frozenset[str] = frozenset()
        self._limits_s: dict[Limit, float] = {}  #: limit → when it last acted
        self._lost: frozenset[str] = frozenset()

    def of_status(self, status: Status, now_s: float) -> Iterator[tuple[str, str]]:
        """Level and sentence of everything that has begun or ended since the last status."""
        if status.fault != self._fault:
            if status.fault:
                yield ERROR, f"{status.message}. {REMEDIES[Fault(status.fault)]}"
            else:
                yield INFO, f"the fault {self._fault} is cleared; the output stays off until ~/enable"
        elif status.mode is not self._mode:
            yield INFO, _words_of_mode(self._mode, status.mode)
        self._fault, self._mode = status.fault, status.mode
        yield from self._of_passing(status)
        yield from self._of_limits(status, now_s)

    def _of_passing(self, status: Status) -> Iterator[tuple[str, str]]:
        for name in sorted(set(status.passing) - self._passing):
            fault = Fault(name)
            yield WARNING, f"{FAULTS[fault].words} ({status.passing[name]}). {REMEDIES[fault]}"
        self._passing = frozenset(status.passing)

    def _of_limits(self, status: Status, now_s: float) -> Iterator[tuple[str, str]]:
        for limit in map(Limit, status.limits):
            if now_s - self._limits_s.get(limit, -LIMIT_PAUSE_s) >= LIMIT_PAUSE_s:
                level = INFO if limit in _ROUTINE else WARNING
                yield level, f"limit: {LIMITS[limit].words}{_read(limit, status)}. {REMEDIES[limit]}"
            self._limits_s[limit] = now_s

    def of_instruments(self, lost: Mapping[str, str]) -> Iterator[tuple[str, str]]:
        """Level and sentence of every instrument lost or found since the last call."""
        for name in sorted(set(lost) - self._lost):
            yield ERROR, f"the {name} does not answer: {lost[name]}"
        for name in sorted(self._lost - set(lost)):
            yield INFO, f"the {name} answers again"
        self._lost = frozenset(lost)


#: Limits that a wire meets in normal use, since it cannot be faster than it is.
_ROUTINE = (Limit.SETPOINT_RATE, Limit.CURRENT_MAX, Limit.CURRENT_BIAS)
#: What each limit looked at: name of the value in the status, factor to the unit shown, unit.
_READ = {
    Limit.SETPOINT_RANGE: ("limited_setpoint_m", 1e3, "mm is held instead"),
    Limit.SETPOINT_RATE: ("limited_setpoint_m", 1e3, "mm is where it is now"),
    Limit.CURRENT_MAX: ("current_limit_A", 1e3, "mA"),
    Limit.STRESS_NEAR_LIMIT: ("stress_Pa", 1e-6, "MPa"),
    Limit.TEMPERATURE_DERATING: ("temperature_C", 1.0, "°C"),
}


def _read(limit: Limit, status: Status) -> str:
    if limit not in _READ:
        return ""
    name, factor, unit = _READ[limit]
    value = status.values.get(name)
    return f" ({value * factor:.4g} {unit})" if isinstance(value, float) else ""


def _words_of_mode(before: Mode, now: Mode) -> str:
    if now is Mode.OFF:
        return "the output is off"
    words = "following setpoints" if now is Mode.TRACKING else "holding the wire where it is"
    return f"the output is on; {words}" if before is Mode.OFF else words


class Recent:
    """The last few things said, for those who ask later."""

    def __init__(self, length: int = 20):
        self._said: collections.deque[str] = collections.deque(maxlen=length)
