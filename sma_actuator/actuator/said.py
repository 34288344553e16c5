"""What a step has to say of itself: the status in words and numbers, what has happened, what has changed."""

from __future__ import annotations

from functools import cache
from math import nan

from sma_actuator.base.signals import Branch, Estimate, Mode, Quality, Signals, Status
from sma_actuator.control.commanding import Commanding
from sma_actuator.control.setpoints import in_words
from sma_actuator.safety.faults import gravest
from sma_actuator.safety.guards.setpoints import setpoint_stale
from sma_actuator.safety.limits import LIMITS, SETPOINT_RANGE
from sma_actuator.safety.records import Fault, Limit
from sma_actuator.safety.supervisor import Supervisor

from .following import Following
from .tuner import Tuner

#: An event without duration (a refused setpoint) stays in the status for this long.
EVENT_SHOWN_s = 1.0
#: How the message of a latched fault ends.
AFTER_A_FAULT = "; ~/clear_fault, then ~/enable"
#: And of one that passes when its instrument answers again.
AFTER_A_LOSS = "; ~/enable once it answers again"
_BRANCHES, _QUALITIES = (tuple(each.name.lower() for each in kind) for kind in (Branch, Quality))
_WORDS_OF_MODE = {
    Mode.OFF.value: "off",
    Mode.HOLD.value: "holding",
    Mode.TRACKING.value: "tracking",
    Mode.TUNING.value: "tuning",
}


def without_advice(message: str) -> str:
    """What a status says of a latched fault, without what to do about it."""
    return message.removesuffix(AFTER_A_FAULT).removesuffix(AFTER_A_LOSS)


def words_of_latched(supervisor: Supervisor) -> str:
    """The latched fault and why, "" where there is none."""
    return f"{supervisor.latched.words} ({supervisor.detail})" if supervisor.latched is not None else ""


def refusal_to_enable(supervisor: Supervisor) -> str:
    """Why no current may flow, as far as faults are the reason; "" where none is."""
    latched, present = supervisor.latched, supervisor.present
    if latched is not None:
        then = "ask again once it answers" if latched.until_back else "call ~/clear_fault first"
        return f"{words_of_latched(supervisor)}; {then}"
    blocking = [fault for fault in present if fault.prevents_enabling]
    if not blocking:
        return ""
    fault = gravest(blocking)
    return f"{fault.words}: {present[fault]}"


class Said:
    """What no output has told yet, and what is told for a while."""

    def __init__(self) -> None:
        self._changes: list[str] = []
        self._events: dict[Fault, tuple[float, str]] = {}  #: fault without duration → when, detail
        self._latched_told: Fault | None = None

    def changed(self, *words: str) -> None:
        """Something has changed; without words, nothing."""
        self._changes += [each for each in words if each]

    def event(self, now_s: float, fault: Fault, detail: str) -> None:
        """A fault without duration has come."""
        self._events[fault] = (now_s, detail)

    def forget_events(self) -> None:
        """They were looked at."""
        self._events.clear()

    def show_events(self, now_s: float, faults: dict[Fault, str], lost: str) -> None:
        """Let faults without duration stay in the status for a while, a ``lost`` setpoint until the next."""
        if lost:
            faults.setdefault(setpoint_stale, lost)
        if not self._events:
            return
        for fault, (when_s, detail) in list(self._events.items()):
            if 0.0 <= now_s - when_s <= EVENT_SHOWN_s:
                faults.setdefault(fault, detail)
            else:
                del self._events[fault]

    def take_changes(self, supervisor: Supervisor) -> tuple[str, ...]:
        """What has changed since this was last asked, a fault that latched among it."""
        latched = supervisor.latched
        if latched is not self._latched_told and latched is not None:
            self._changes.append(f"fault {latched.name}: {supervisor.detail}")
        self._latched_told = latched
        changes, self._changes = tuple(self._changes), []
        return changes


@cache  # no more than there are sets of a dozen limits; those of one step are those of the next
def _in_order(limits: frozenset[Limit]) -> tuple[tuple[Limit, ...], tuple[str, ...]]:
    """They and their names, in the order in which limits are named."""
    shown = tuple(limit for limit in LIMITS.values() if limit in limits)
    return shown, tuple(limit.name for limit in shown)


def _message(
    words: str, supervisor: Supervisor, faults: dict[Fault, str], limits: tuple[Limit, ...], following: Following
) -> tuple[Fault | None, str]:
    """The fault that a status names, and its message, which begins with ``words``: a latched fault, else the gravest
    that is there, else the limits."""
    fault = supervisor.latched
    if fault is not None:
        return fault, f"off: {words_of_latched(supervisor)}{AFTER_A_LOSS if fault.until_back else AFTER_A_FAULT}"
    if faults:
        fault = gravest(faults)
        return fault, f"{words}: {fault.words} ({faults[fault]})"
    if not limits:
        return None, words
    said = [f"{limit.words} {following.end_in_words}" if limit is SETPOINT_RANGE else limit.words for limit in limits]
    return None, f"{words}: {', '.join(said)}"


def status_of(
    faults: dict[Fault, str],
    limits: set[Limit],
    limit_A: float,
    supervisor: Supervisor,
    commanding: Commanding,
    signals: Signals,
    estimate: Estimate,
    loses: float,
    following: Following,
    joint_commands: str,
    tuner: Tuner,
    now_s: float,
) -> Status:
    """The status of a step with these faults and limits; ``loses``: heat, over what it lost at its calibration."""
    mode = commanding.mode
    words = _WORDS_OF_MODE[mode._value_]  # a member of an enumeration is a key that takes long to look up
    if tuner.running is not None:
        words += f" ({tuner.words})"
    words += in_words(commanding.begins_in_s(now_s))
    shown, names = _in_order(frozenset(limits))
    fault, message = _message(words, supervisor, faults, shown, following)
    heat = supervisor.heat
    # With the mode "off" no position is said, though the last reading may be of before the output went off:
    # this status stands for a while, and the wire moves.
    known = mode is not Mode.OFF and estimate.quality is not Quality.INVALID
    return Status(
        mode=mode,
        fault=fault.name if fault is not None else "",
        limits=names,
        message=message,
        values={
            "displacement_m": estimate.displacement_m if known else nan,
            "uncertainty_m": estimate.uncertainty_m if known else nan,
            "resistance_Ohm": signals.resistance_Ohm,
            "current_A": signals.current_A,
            "power_W": signals.power_W,
            "load_N": signals.load_N,
            "stress_Pa": signals.stress_Pa,
            "temperature_C": heat.temperature_C,
            "temperature_at_most_C": heat.at_most_C,
            "temperature_guessed_K": heat.guessed_K,
            "heat_loss_times": loses,
            "current_limit_A": limit_A,
            "limited_setpoint_m": following.limited_setpoint_m,
            "shortest_m": following.short_m,
            "longest_m": following.long_m,
            "branch": _BRANCHES[estimate.branch],
            "quality": _QUALITIES[estimate.quality],
            "joint_commands": joint_commands,
            "tuning": tuner.words,
        },
    )
