"""What a wire's node reports, on its topics and in its log: of its steps, and of itself in every state of its life."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.parameter import Parameter

from sma_actuator.base.signals import Health, Mode, Output, Status, Tuned
from sma_actuator.config import Config
from sma_actuator.control.tuning import words_of
from sma_msgs_py import diagnostic_status_from, health_status_from

from .log import ERROR, INFO, WARNING, Events
from .one_wire import OneWire

#: Of the loop's statistics, in the diagnostics.
_OF_THE_LOOP = ("period_mean_s", "period_p99_s", "period_max_s", "overruns", "late_answers", "slowest_answer_s")


class WireReporter:
    """The reporter (``publishers.py``) of one wire."""

    def __init__(self, wire: OneWire):
        self._wire = wire
        self._events = Events()
        self._health = Health.UNKNOWN  #: as it was last said
        self._log = ""  #: what was last said of the bench log
        self._tuned: Tuned | None = None  #: gains that a tuning has found and the parameters do not have yet
        self.callback_failed = wire.callback_failed

    @property
    def config(self) -> Config:
        """The parameters as they are now."""
        return self._wire.config

    @property
    def is_active(self) -> bool:
        """Whether its steps are published."""
        return self._wire.is_active and self._wire.driver is not None

    @property
    def has_to_act(self) -> bool:
        """Whether there are refusals to be said, or a goal to be watched."""
        driver = self._wire.driver
        return (driver is not None and driver.has_refusals) or self._wire.commands.pursues

    def time_of(self, output: Output) -> float:
        """When it was measured [s]."""
        return output.signals.time_s

    def events_of(self, output: Output) -> Sequence[str]:
        """What has happened in it."""
        return output.events

    def in_short(self, output: Output) -> tuple[Any, ...]:
        """What of an output is said in words."""
        status, driver = output.status, self._wire.driver
        lost = driver.lost_instruments if driver is not None else ()
        return (status.mode, status.fault, status.limits, output.health.state, self._words_of_the_log(), *lost)

    def _words_of_the_log(self) -> str:
        recorder = self._wire.recorder
        return recorder.words if recorder is not None else ""

    def note(self, output: Output) -> None:
        """Keep of an output what a later one would hide, in the control thread."""
        if output.tuned is not None:
            self._tuned = output.tuned

    def say(self, output: Output | None) -> None:
        """Say what is new in an output, and what has become of the bench log."""
        wire, driver = self._wire, self._wire.driver
        if output is not None and driver is not None:
            for refusal in driver.refusals():
                wire.report(refusal)
            wire.watch(output)
            for level, sentence in self._events.of_status(output.status, time.monotonic()):
                wire.log.say(level, sentence)
            for level, sentence in self._events.of_instruments(driver.lost_instruments, output.status.fault):
                wire.log.say(level, sentence)
            if output.health.state is not self._health:
                self._health = output.health.state
                level = WARNING if self._health is Health.DUE else INFO
                wire.log.say(level, f"model health: {output.health.words}")
        words = self._words_of_the_log()
        if words != self._log:
            self._log = words
            wire.log.say(WARNING if words else INFO, words or "the bench log is written")

    def statuses(self, output: Output | None) -> list[DiagnosticStatus]:
        """The status, and whether the model still holds."""
        self._take_tuned()  # who reads that the tuning is done finds its gains
        wire, driver = self._wire, self._wire.driver
        output = output if driver is not None else None
        status = self._status(output)
        name = wire.get_fully_qualified_name()
        message = diagnostic_status_from(name, driver.hardware_id if driver is not None else "", status)
        lost = driver.lost_instruments if driver is not None else {}
        if lost or (output is None and wire.refusal):
            message.level = DiagnosticStatus.ERROR
        if lost:
            message.message = "; ".join(f"the {name} does not answer: {detail}" for name, detail in lost.items())
        if wire.recorder is not None and (wire.recorder.problem or wire.recorder.lost_rows):
            message.level = max(message.level, DiagnosticStatus.WARN)  # both are one byte
            message.message += f"; bench log: {status.values['recorder']}"
        if output is None:
            return [message]
        joint_name, now_s = self.config.joint_name, output.signals.time_s
        return [message, health_status_from(f"{name}: model health", joint_name, output.health, now_s)]

    def _status(self, output: Output | None) -> Status:
        wire = self._wire
        if output is not None:
            status = output.status
            if not wire.is_active:
                status = dataclasses.replace(status, message=f"{status.message}; {wire.not_active()}")
        else:
            words = "no reading has come yet" if wire.is_active else wire.not_active()
            status = Status(Mode.OFF, message=wire.refusal or words)
            if wire.driver is None and not wire.left_off:
                status.values["output"] = "not known: look at the supply"
        return dataclasses.replace(status, values={**status.values, **self._key_values()})

    def _key_values(self) -> dict[str, float | str]:
        """Key values of the node and the loop, for diagnostics."""
        wire = self._wire
        values: dict[str, float | str] = {"lifecycle": wire.state, **wire.parameter_values}
        if joint := wire.turned_by():
            values["turned_by"] = joint
        if wire.driver is not None:
            statistics = wire.driver.statistics()
            values |= {name: getattr(statistics, name) for name in _OF_THE_LOOP}
        if wire.recorder is not None:
            words, lost = wire.recorder.words, f"{wire.recorder.lost_rows} rows lost"
            values["recorder"] = f"{words}; {lost}" if words else lost
        return values

    def _take_tuned(self) -> None:
        """Make gains that a tuning has found those of the node, as if somebody had set them."""
        tuned, self._tuned = self._tuned, None
        if tuned is None:
            return
        found = [Parameter(f"controller.{name}", value=value) for name, value in tuned.gains.items()]
        result = self._wire.set_parameters_atomically(found)
        if result.successful:
            words = f"tuned: {words_of(tuned.gains)}, before: {words_of(tuned.before)}"
            hold = "they hold until the node ends, unless they are written to its parameter file"
            self._wire.log.say(INFO, f"{words}; {hold}")
        else:
            self._wire.log.say(ERROR, f"tuned, and the gains were not taken over: {result.reason}")
