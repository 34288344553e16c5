"""What the node says in its log: each event once, each refusal in its own words, nothing as a flood."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Mapping
from math import inf
from typing import Any

from sma_actuator.actuator import without_advice
from sma_actuator.base.signals import Mode, Status
from sma_actuator.driver import NOT_ASKED
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.limits import LIMITS, TEMPERATURE_DERATING

INFO, WARNING, ERROR = "info", "warning", "error"
#: A refusal that only repeats another with different numbers is said again after this time, then after twice that, up
#: to so long: a stream of commands may be refused for a night.
REPEAT_s, RARELY_s = 1.0, 60.0
#: Different refusals that may be said within that time; a flood of them is only counted.
MOST_REFUSALS = 8
#: A limit, or a fault that passes by itself, is said again once it has not acted for so long; so is a refusal.
PAUSE_s = 10.0

#: So much of a temperature that nobody has seen is what a wire is not warned of.
GUESS_K = 10.0
NOTHING_KNOWN = "nothing is known yet of the wire's heat, so it counts as hot: full current in some seconds"

_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?|\bnan\b|\binf\b")


class Refusals:
    """Lets through one refusal of each kind a second, ever more rarely while it goes on, and counts the others."""

    def __init__(self) -> None:
        #: Of each kind: when it was last asked about, when it was last said, and for how long not again.
        self._kinds: dict[str, tuple[float, float, float]] = {}
        self._held_back = 0

    def worth_saying(self, sentence: str, now_s: float) -> str:
        """The sentence as it should be said now, or ""."""
        kind = _NUMBER.sub("#", sentence)
        self._kinds = {kind: times_s for kind, times_s in self._kinds.items() if now_s - times_s[0] < PAUSE_s}
        _, said_s, wait_s = self._kinds.get(kind, (now_s, -inf, 0.0))
        lately = sum(now_s - when_s < REPEAT_s for _, when_s, _ in self._kinds.values())
        if now_s - said_s < wait_s or lately >= MOST_REFUSALS:
            if wait_s:
                self._kinds[kind] = now_s, said_s, wait_s
            self._held_back += 1
            return ""
        self._kinds[kind] = now_s, now_s, min(max(REPEAT_s, 2.0 * wait_s), RARELY_s)
        held_back, self._held_back = self._held_back, 0
        return f"{sentence} ({held_back} more were not shown)" if held_back else sentence


class Events:
    """Turns the states that a wire passes through into sentences, each when it begins."""

    def __init__(self) -> None:
        self._mode = Mode.OFF
        self._latched = ""
        self._acted_s: dict[str, float] = {}  #: limit or passing fault → when it last acted
        self._lost: frozenset[str] = frozenset()

    def of_status(self, status: Status, now_s: float) -> Iterator[tuple[str, str]]:
        """Level and sentence of everything that has begun or ended since the last status."""
        latched = status.fault if _is_latched(status) else ""
        if latched and latched != self._latched:
            yield ERROR, f"{without_advice(status.message)}. {FAULTS[latched].advice}"
        elif self._latched and not latched:
            yield INFO, f"the fault {self._latched} is cleared; the output stays off until ~/enable"
        elif status.mode is not self._mode:
            yield INFO, _words_of_mode(self._mode, status.mode)
        self._latched, self._mode = latched, status.mode
        if status.fault and not latched and status.fault not in _REFUSED and self._begins(status.fault, now_s):
            yield WARNING, f"{status.message}. {FAULTS[status.fault].advice}"
        for limit in status.limits:
            if limit == TEMPERATURE_DERATING.name and _is_guess(status):
                if self._begins(NOTHING_KNOWN, now_s):
                    yield INFO, NOTHING_KNOWN
            elif self._begins(limit, now_s):
                level = INFO if limit in _ROUTINE else WARNING
                yield level, f"limit: {LIMITS[limit].words}{_read(limit, status)}. {LIMITS[limit].advice}"

    def _begins(self, name: str, now_s: float) -> bool:
        begins = now_s - self._acted_s.get(name, -inf) >= PAUSE_s
        self._acted_s[name] = now_s
        return begins

    def of_instruments(self, lost: Mapping[str, str], fault: str) -> Iterator[tuple[str, str]]:
        """Level and sentence of every instrument lost or found since the last call; of a loss that is the fault,
        none."""
        lost = {name: why for name, why in lost.items() if why != NOT_ASKED}
        for name in sorted(set(lost) - self._lost - {fault.removesuffix("_lost")}):
            yield ERROR, f"the {name} does not answer: {lost[name]}"
        for name in sorted(self._lost - set(lost)):
            yield INFO, f"the {name} answers again"
        self._lost = frozenset(lost)


#: Faults that consist in a refusal, which has said so already.
_REFUSED = ("setpoint_flood", "setpoint_not_finite")
#: Limits that a wire meets in normal use, since it cannot be faster than it is.
_ROUTINE = ("setpoint_rate", "current_max", "current_bias")
#: What each limit looked at: names of the values in the status, factor to the unit shown, unit.
_READ = {
    "setpoint_range": (("shortest_m", "longest_m"), 1e3, "mm"),
    "setpoint_rate": (("limited_setpoint_m",), 1e3, "mm is where it is now"),
    "current_max": (("current_limit_A",), 1e3, "mA"),
    "stress_near_limit": (("stress_Pa",), 1e-6, "MPa"),
    "temperature_derating": (("temperature_at_most_C",), 1.0, "°C is the hottest that it can be"),
}


def _is_guess(status: Status) -> bool:
    """Whether the temperature is that of a wire of which nothing is known yet."""
    guessed_K = status.values.get("temperature_guessed_K", 0.0)
    return isinstance(guessed_K, float) and guessed_K >= GUESS_K


def _is_latched(status: Status) -> bool:
    fault = FAULTS.get(status.fault)
    return fault is not None and (fault.latches or (bool(fault.action_by) and status.mode is Mode.OFF))


def _read(limit: str, status: Status) -> str:
    if limit not in _READ:
        return ""
    names, factor, unit = _READ[limit]
    values = [value for name in names if isinstance(value := status.values.get(name), float)]
    return f" ({' to '.join(f'{value * factor:.4g}' for value in values)} {unit})" if values else ""


_WORDS_OF_MODE = {Mode.TRACKING: "following setpoints", Mode.TUNING: "tuning the gains"}


def _words_of_mode(before: Mode, now: Mode) -> str:
    if now is Mode.OFF:
        return "the output is off"
    words = _WORDS_OF_MODE.get(now, "holding the wire where it is")
    return f"the output is on; {words}" if before is Mode.OFF else words


def namesakes(node: Any) -> str:
    """What to add to the answer of a node where another one on the network has its name; "" where none has."""
    if node.count_publishers(node.resolve_topic_name("~/status")) < 2:
        return ""
    return (
        f"; another node on this network is called {node.get_fully_qualified_name()}, or was until it was killed just "
        f"now: what one is asked for, both do; name one anew, or keep them apart by ROS_DOMAIN_ID"
    )


class Log:
    """A node's log."""

    def __init__(self, node: Any):
        self._node = node
        self._refusals = Refusals()

    def say(self, level: str, sentence: str) -> None:
        """Say a sentence."""
        logger = self._node.get_logger()  # which wants a place of its own for each level
        if level == ERROR:
            logger.error(sentence)
        elif level == WARNING:
            logger.warning(sentence)
        else:
            logger.info(sentence)

    def refuse(self, sentence: str) -> None:
        """Say why something was refused; the same again and again only now and then."""
        sentence = self._refusals.worth_saying(sentence, time.monotonic())
        if sentence:
            self.say(WARNING, sentence)
