"""The publishers of a node: what goes out with each step and of the node itself, and who is woken for it.

What flows is published in the thread of the hand-over (``publishing.py``), and only what somebody listens to; what is
said in words, in the ROS thread, which is woken where there is news.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from math import inf, isfinite
from typing import Any, Generic, Protocol, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.event_handler import PublisherEventCallbacks

from .publishing import Handoff, is_heard
from .topics import Of, Published, Step

#: How often the ROS thread has a turn, and looks who listens.
TURN_PERIOD_s = 0.3
STATUS_PERIOD_s = 1.0
_MOST_HAPPENED = 50  #: events kept while nobody listens
#: A listener that asks for more than is offered is told so by its own side; to look for that at each publisher is a
#: third of what the executor does whenever it is woken.
_UNWATCHED = PublisherEventCallbacks(use_default_callbacks=False)

Output = TypeVar("Output")
_Output_contra = TypeVar("_Output_contra", contravariant=True)


class Reporter(Protocol[_Output_contra]):
    """What there is to say, and of what."""

    @property
    def config(self) -> Any:
        """The parameters."""

    @property
    def is_active(self) -> bool:
        """Whether its steps are published."""

    @property
    def has_to_act(self) -> bool:
        """Whether the ROS thread is wanted for each step now."""

    def time_of(self, output: _Output_contra) -> float:
        """When it was measured [s]."""

    def events_of(self, output: _Output_contra) -> Sequence[str]:
        """What has happened in it, in words."""

    def in_short(self, output: _Output_contra) -> tuple[Any, ...]:
        """What of it is said in words: news, where it differs from the one before."""

    def say(self, output: _Output_contra | None) -> None:
        """Say in the log what is new in it."""

    def statuses(self, output: _Output_contra | None) -> list[DiagnosticStatus]:
        """The status, and what else goes into the diagnostics."""

    def callback_failed(self, error: Exception) -> None:
        """Take an exception that no message is to blame for."""


class Publishers(Generic[Output]):
    """The topics of one node, made from their rows."""

    def __init__(self, node: Any, reporter: Reporter[Output], rows: Sequence[Published]):
        self._reporter = reporter
        self._made: list[tuple[Published, Any]] = []
        for row in rows:
            if row.is_made(reporter.config):
                # The state of a node is of interest in every state of its life.
                lasts = row.of is Of.STATUS or not hasattr(node, "create_lifecycle_publisher")
                make = node.create_publisher if lasts else node.create_lifecycle_publisher
                self._made.append((row, make(row.kind, row.name, row.qos, event_callbacks=_UNWATCHED)))
        self._heard: list[tuple[Published, Any]] = []  #: those of steps that somebody listens to
        self._looked_s = self._status_due_s = -inf
        self._told: tuple[Any, ...] = ()  #: of what the ROS thread was last woken for
        self._published: tuple[Any, ...] = ()  #: of what the last status said
        self._happened: list[str] = []  #: what no message has told yet
        self._woken = node.create_guard_condition(self._take_news)
        self._handoff: Handoff[Output] = Handoff(self._publish, reporter.callback_failed)

    @property
    def latest(self) -> Output | None:
        """The latest output."""
        return self._handoff.latest

    # --- in the control thread ---------------------------------------------------------------------

    def take(self, output: Output) -> None:
        """Hand an output over: to be published where anybody listens, or where it is news."""
        self._handoff.put(output, bool(self._heard) or bool(self._reporter.events_of(output)) or self._is_news(output))

    def _is_news(self, output: Output) -> bool:
        return self._reporter.has_to_act or self._reporter.in_short(output) != self._told

    # --- in the thread of the hand-over ------------------------------------------------------------

    def _publish(self, output: Output, waiting: Sequence[Output]) -> None:
        """Publish what flows of the latest output, and of all that have come; have said what is new in it."""
        heard = self._heard if self._reporter.is_active else []
        if heard:
            step = self._step(output)
            if isfinite(step.time_s):
                self._send(step, [each for each in heard if each[0].of is Of.LATEST])
        every = [each for each in heard if each[0].of is Of.EVERY]
        for each in waiting:
            self._happened += self._reporter.events_of(each)
            if every and self._send(self._step(each, "; ".join(self._happened)), every):
                self._happened = []
        del self._happened[:-_MOST_HAPPENED]
        if self._is_news(output):
            self._told = self._reporter.in_short(output)
            self._woken.trigger()

    def _step(self, output: Output, happened: str = "") -> Step:
        return Step(output, self._reporter.config, self._reporter.time_of(output), happened)

    @staticmethod
    def _send(step: Step, heard: Sequence[tuple[Published, Any]]) -> bool:
        sent = False
        for row, publisher in heard:
            message = row.message(step)
            if message is not None:
                publisher.publish(message)
                sent = True
        return sent

    # --- in the ROS thread -------------------------------------------------------------------------

    def _take_news(self) -> None:
        output = self.latest
        self._reporter.say(output)
        if output is not None and self._reporter.in_short(output) != self._published:
            self.publish_status()

    def publish_status(self) -> None:
        """Say how the node is."""
        output = self.latest
        self._published = self._reporter.in_short(output) if output is not None else ()
        statuses = self._reporter.statuses(output)
        for row, publisher in self._made:
            if row.of is Of.STATUS and (row.is_kept or is_heard(publisher)):
                publisher.publish(row.message(statuses))

    def turn(self) -> None:
        """What the ROS thread does between callbacks, at the latest after ``TURN_PERIOD_s``.

        Timers would have the executor look through all that the node has, twice for each.
        """
        now_s = time.monotonic()
        if now_s - self._looked_s >= TURN_PERIOD_s:
            self._looked_s = now_s
            self._heard = [each for each in self._made if each[0].of is not Of.STATUS and is_heard(each[1])]
        if now_s >= self._status_due_s - 0.5 * TURN_PERIOD_s:  # the next turn may be further from it
            self._status_due_s = max(self._status_due_s + STATUS_PERIOD_s, now_s)
            # what goes on without being new is noted as well, so that it is not said again
            self._reporter.say(self.latest)
            self.publish_status()

    def moves(self) -> bool:
        """Whether the thread of the hand-over does."""
        return self._handoff.moves()

    def close(self) -> None:
        """Publish no more of steps, so that ROS can be shut down."""
        self._handoff.close()
