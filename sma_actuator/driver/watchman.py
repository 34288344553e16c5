"""The second pair of eyes: a thread that does nothing but look whether the control thread still shows life."""

from __future__ import annotations

import dataclasses
import logging
import math
import time
from collections.abc import Callable

from sma_actuator.base.signals import OFF, Mode, Output
from sma_actuator.instruments import Clock
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.guards.program import loop_hung
from sma_actuator.safety.records import Fault, Waited

from .link import Link
from .output import SupplyOutput

_log = logging.getLogger(__name__)

#: How long it rests at the least between two looks, and at the most: patience may become shorter meanwhile.
_SHORTEST_REST_s, _LONGEST_REST_s = 0.05, 0.25


class Watchman:
    """Shuts the supply down beside a control thread that shows no life, and says so.

    ``show`` takes what there is to say while the control thread says nothing; ``waited`` is how long the loop has
    waited for its instruments since the beginning.
    """

    def __init__(
        self,
        name: str,
        output: SupplyOutput,
        supply: Link,
        clock: Clock,
        waited: Callable[[], Waited],
        patience_s: float,
        period_s: float,
        show: Callable[[Output], None],
    ):
        self.patience_s = patience_s  #: how long no step may come: as old as readings may be
        self.hung = ""  #: what it found, until the control thread goes on
        self.last: Output | None = None  #: what the last step has said
        self.alive_s = math.inf  #: when the control thread last showed life; infinite while there is none
        self._name = name
        self._output = output
        self._supply = supply
        self._clock = clock
        self._waited = waited
        self._waited_alive = Waited()  #: for the instruments, until life was shown
        self._period_s = period_s
        self._show = show

    def show_life(self) -> float:
        """The control thread lives; its time now."""
        self.alive_s = now_s = self._clock.now_s()
        self._waited_alive = self._waited()  # after that: the watchman reads it before
        return now_s

    def watch(self, over: Callable[[], bool]) -> None:
        """Look until it is ``over``, in a thread of its own."""
        left_s = _SHORTEST_REST_s
        while not over():
            # Half of what waiting for an event takes; nobody waits for this thread.
            time.sleep(min(max(left_s, _SHORTEST_REST_s), _LONGEST_REST_s))
            left_s = self.look()

    def look(self) -> float:
        """Cut, once, where no step came for as long as readings may be old; the fault names who the loop waits for.

        How long it will be until then at the least [s].
        """
        waited = self._waited().since(self._waited_alive)
        silent_s, bound_s = self._clock.now_s() - self.alive_s, self.patience_s
        if self.hung or silent_s <= bound_s:
            return bound_s - silent_s
        name, part = waited.most(silent_s, self._period_s)
        fault = FAULTS[f"{name}_lost"] if name else loop_hung
        self.hung = why = f"no step for {silent_s:.3g} s{part}; safety.reading_timeout is {bound_s:g} s"
        if not (self._output.known.may_flow and self._supply.answers):
            return 0.0  # nothing flows, or the control thread is about to say off on a new connection
        try:
            self._output.cut(fault, why)
            _log.error("%s: %s (%s); %s", self._name, fault.words, why, self._output.words)
            self._show_hang(fault, why)
        except Exception:  # noqa: BLE001 - the last pair of eyes must stay open
            _log.exception("%s: the watchman failed", self._name)
        return 0.0

    def _show_hang(self, fault: Fault, why: str) -> None:
        """Put out what is known while the control thread says nothing."""
        last = self.last
        if last is None:
            return
        status = dataclasses.replace(
            last.status,
            mode=Mode.OFF,
            fault=fault.name,
            limits=(),
            message=f"off: {fault.words} ({why})",
            values=dict(last.status.values),
        )
        # What was read before the output went off says nothing of what flows now.
        self._show(self._output.with_truth(dataclasses.replace(last, reading=None, command=OFF, status=status)))
