"""One instrument as the loop sees it: whether it answers, how long it was waited for, when to try again if it does
not."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from sma_actuator.instruments import (
    Daq,
    InstrumentError,
    InstrumentLate,
    InstrumentUnreachable,
    OutputStaysOn,
    PowerSupply,
)

from .statistics import Slowest

NOT_ASKED = "it has not been asked yet"  #: why an instrument does not answer, before the first step
_SHORTEST_WAIT_s = 0.1
#: How long at the most a new connection waits for the watchdog of a supply that says it stays on: a slower watchdog
#: is too slow to be waited for before anything else is tried.
_LONGEST_TRUST_s = 2.0


class Link:
    """One instrument, whether it answers, and when to try again if it does not."""

    def __init__(
        self,
        name: str,
        instrument: PowerSupply | Daq,
        timeout_s: float,
        longest_wait_s: float,
        now_s: Callable[[], float],
    ):
        self.name = name
        self.instrument = instrument
        self.answers = False
        self.late = False  #: it owes an answer
        self.late_answers = 0
        self.slowest = Slowest()
        self._now_s = now_s
        self._timeout_s = timeout_s
        self._waits = 0.0, math.nan, timeout_s  #: how long so far; since when, if now; how long at the most
        self._began_s = self._ended_s = math.nan  #: when it was last asked, and had answered or not
        self._owed = self._owed_since_s = math.nan  #: which answer is late, and since when it is waited for
        self.detail = NOT_ASKED  #: why it does not answer
        self.fault = f"{name}_lost"  #: what that is
        self._longest_wait_s = longest_wait_s
        self._wait_s = 0.0
        self._next_attempt_s = -math.inf
        self._obeys = True  #: as far as is known

    def waited_s(self) -> float:
        """How long it has been waited for since the beginning [s]: for each question no longer than its answer may
        take.  From any thread."""
        so_far_s, since_s, most_s = self._waits
        return so_far_s if math.isnan(since_s) else so_far_s + min(self._now_s() - since_s, most_s)

    def _waited_for(self, question: Callable[[], Any], most_s: float) -> Any:
        """Its answer.  What lasts longer than ``most_s`` is not the instrument's: the program stood still, or its
        library does."""
        so_far_s, self._began_s = self._waits[0], self._now_s()
        self._waits = so_far_s, self._began_s, most_s
        try:
            return question()
        finally:
            self._ended_s = self._now_s()
            self._waits = so_far_s + min(self._ended_s - self._began_s, most_s), math.nan, most_s

    def ask(self, question: Callable[[], Any], most_s: float | None = None) -> Any:
        """Answer of the instrument, or None where it has none: then it is ``late``, or does not answer any more.

        ``most_s``: how long it may take, if not its time-out.
        """
        if not self.answers:
            return None
        try:
            answer = self._waited_for(question, self._timeout_s if most_s is None else most_s)
        except InstrumentLate as error:
            if error.asked_s != self._owed:
                self._owed, self._owed_since_s = error.asked_s, self._began_s
                self.late_answers += 1
            self.late, self.detail = True, str(error)
            self._note_answer(self._owed_since_s)
            return None
        except InstrumentError as error:
            self._note_answer(self._began_s)
            self.lose(error)
            return None
        self._note_answer(self._owed_since_s if self.late and answer is not None else self._began_s)
        if answer is not None:  # what was only told did not wait for what it owes
            self.late = False
        self._wait_s, self._next_attempt_s = 0.0, -math.inf  # where it is lost, the first attempt is made at once
        return answer

    def insist(self, question: Callable[[], Any], patience_s: float) -> None:
        """Ask until it has answered, or is lost, or is ``late`` for so long: its answer is waited for."""
        until_s = self._now_s() + patience_s
        while self.answers:
            self.late = False
            self.ask(question, math.inf)
            if not self.late or self._now_s() >= until_s:
                break

    def _note_answer(self, since_s: float) -> None:
        self.slowest.note(self._ended_s, self._ended_s - since_s)

    def lose(self, error: InstrumentError) -> None:
        """It does not answer any more."""
        self.answers = self.late = False
        self._note(error)
        self._obeys = not isinstance(error, OutputStaysOn)

    def _note(self, error: InstrumentError) -> None:
        self.detail, self.fault = str(error), error.fault or f"{self.name}_lost"

    def reconnect(self, quiet_s: float, unheard_s: float = math.inf) -> None:
        """Try to open it again, not more often than the back-off allows, but every ``unheard_s`` while it hears
        nothing.

        An attempt that was heard and failed is followed by ``quiet_s`` without a word, and so is a word that was heard
        and not obeyed; but no longer than ``_LONGEST_TRUST_s``, for answers that are out of step may have said so.
        """
        if not self._obeys:
            self._obeys, self._next_attempt_s = True, self._now_s() + min(quiet_s, _LONGEST_TRUST_s)
        if self._now_s() < self._next_attempt_s:
            return
        self._wait_s = min(self._longest_wait_s, max(_SHORTEST_WAIT_s, 2.0 * self._wait_s))
        try:
            self._waited_for(self.instrument.open, math.inf)
        except InstrumentUnreachable as error:
            self._note(error)
            self._wait_s, quiet_s = min(self._wait_s, unheard_s), 0.0
        except InstrumentError as error:
            self._note(error)
        else:
            self.answers, quiet_s = True, 0.0
        # Also where it was opened: it may be lost with the first question that matters, each time.
        self._next_attempt_s = self._now_s() + max(self._wait_s, quiet_s)
