"""From the loop to ROS: one thread publishes what flows of all wires; executors sleep until there is something to say.

To wake an executor of rclpy takes longer than a whole step of the loop, since it looks through everything that the node
has.  So what comes with every step is published beside it; and where nobody listens nothing is woken at all.
"""

from __future__ import annotations

import collections
import functools
import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from math import inf
from typing import Any, Generic, TypeVar

_log = logging.getLogger(__name__)
Output = TypeVar("Output")

#: Outputs are published at the loop's rate, but not faster than this: at 1 kHz it would take the loop's own time.
LEAST_PERIOD_s = 5e-3
#: Wires that step together do so one after the other, as Python lets one thread run: sixteen at 20 Hz in some 15 ms.  A
#: thread that publishes in between would take turns with all of them: the first is let wait for the others for this
#: share of the time from one step to the next, and no longer than that.
TOGETHER, LONGEST_s = 0.2, 10e-3
#: Some seconds' worth at the usual rates, for a thread that is held up.
OUTPUTS_WAITING = 500
_CLOSING_s = 1.0  #: longest wait for the thread's end


class Handoff(Generic[Output]):
    """Outputs of one wire, from its control thread to the thread that publishes them; the control thread never waits.

    ``publish(latest, waiting)`` gets the latest output and all that have come since its last call; ``on_error`` gets
    what it raises, and the thread goes on.
    """

    def __init__(self, publish: Callable[[Output, Sequence[Output]], None], on_error: Callable[[Exception], None]):
        self.latest: Output | None = None
        self._publish, self._on_error = publish, on_error
        self._waiting: collections.deque[Output] = collections.deque(maxlen=OUTPUTS_WAITING)
        self._signed = False  #: the thread will look; one sign is enough for all that wait
        self._open = True
        self._publishing = threading.Lock()  #: held meanwhile
        self._turns = self._turns_seen = 0
        self._thread = _thread()

    def put(self, output: Output, publish: bool) -> None:
        """Note an output as the latest, and have it published."""
        self.latest = output
        if publish:
            self._waiting.append(output)
            if not self._signed:
                self._signed = True
                self._thread.look_at(self)

    def moves(self) -> bool:
        """Whether nothing waits, or something has been published since this was last asked."""
        moves = not (self._publishing.locked() or self._waiting) or self._turns != self._turns_seen
        self._turns_seen = self._turns
        return moves

    def close(self) -> None:
        """Nothing is published afterwards; what is being published is waited for."""
        self._open = False
        if self._publishing.acquire(timeout=_CLOSING_s):
            self._publishing.release()

    def publish(self) -> None:
        """Publish what waits, in the thread."""
        self._signed = False
        with self._publishing:
            waiting = [self._waiting.popleft() for _ in range(len(self._waiting))]
            if waiting and self._open:  # else taken with the ones before
                try:
                    self._publish(waiting[-1], waiting)
                except Exception as error:  # noqa: BLE001 - the next output is as good as any
                    tell(self._on_error, error)
        self._turns += 1


class _Thread:
    """Publishes for all wires of a process, one after the other.

    What one wire's thread would look up again and again, the publishers of ROS and what lies below, is at hand for all
    that have stepped at the same time: the second costs a tenth of the first, and those are waited for.
    """

    def __init__(self) -> None:
        self._signs: queue.SimpleQueue[Handoff] = queue.SimpleQueue()
        # A daemon: one that hangs must not keep a process that ends.
        threading.Thread(target=self._run, name="hand-off", daemon=True).start()

    def look_at(self, handoff: Handoff) -> None:
        """It has something to publish."""
        self._signs.put(handoff)

    def _run(self) -> None:
        began_s, number = -inf, 1
        while True:
            first = self._signs.get()
            wait_s = waits_s(time.monotonic() - began_s, number)
            if wait_s > 0.0:
                time.sleep(wait_s)
            began_s, number = time.monotonic(), 1
            first.publish()
            while not self._signs.empty():
                self._signs.get().publish()
                number += 1


def waits_s(since_s: float, number: int) -> float:
    """How long the first waits, so long after the last turn began, in which so many were published."""
    least_s = LEAST_PERIOD_s - since_s
    return max(least_s, min(TOGETHER * since_s, LONGEST_s)) if number > 1 else least_s


@functools.cache
def _thread() -> _Thread:
    """That of this process."""
    return _Thread()


def tell(on_error: Callable[[Exception], None], error: Exception) -> None:
    """Report an error from a thread that must not end, also where reporting is what fails."""
    try:
        on_error(error)
    except Exception:  # noqa: BLE001 - reporting may raise anything
        _log.exception("'%s' could not be reported", error)


def is_heard(publisher: Any) -> bool:
    """Whether anybody subscribes: what nobody hears need not be made."""
    return bool(publisher.get_subscription_count() > 0)
