"""From the loop to ROS: one thread of a wire publishes what flows; its executor sleeps until there is something to say.

To wake an executor of rclpy takes longer than a whole step of the loop, since it looks through everything that the node
has.  So what comes with every step is published beside it; and where nobody listens nothing is woken at all.
"""

from __future__ import annotations

import collections
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
#: Some seconds' worth at the usual rates, for a thread that is held up.
OUTPUTS_WAITING = 500
_CLOSING_s = 1.0  #: longest wait for the thread's end


class Handoff(Generic[Output]):
    """Outputs, from the control thread to a thread that publishes them; the control thread never waits.

    ``publish(latest, waiting)`` gets the latest output and all that have come since its last call; ``on_error`` gets
    what it raises, and the thread goes on.
    """

    def __init__(
        self, name: str, publish: Callable[[Output, Sequence[Output]], None], on_error: Callable[[Exception], None]
    ):
        self.latest: Output | None = None
        self._publish, self._on_error = publish, on_error
        self._waiting: collections.deque[Output] = collections.deque(maxlen=OUTPUTS_WAITING)
        self._fresh: queue.SimpleQueue[bool] = queue.SimpleQueue()  #: false: the end
        self._busy = False
        self._turns = self._turns_seen = 0
        self._thread = threading.Thread(target=self._run, name=f"{name} hand-off", daemon=True)
        self._thread.start()

    def put(self, output: Output, publish: bool) -> None:
        """Note an output as the latest, and have it published."""
        self.latest = output
        if publish:
            self._waiting.append(output)
            if self._fresh.empty():  # else the thread will look all the same: one sign is enough for all that wait
                self._fresh.put(True)

    def moves(self) -> bool:
        """Whether the thread waits for an output, or has published one since this was last asked."""
        moves = not self._busy or self._turns != self._turns_seen
        self._turns_seen = self._turns
        return moves

    def close(self) -> None:
        """End the thread; afterwards nothing is published."""
        self._fresh.put(False)
        self._thread.join(_CLOSING_s)

    def _run(self) -> None:
        began_s = -inf
        while self._fresh.get():
            left_s = began_s + LEAST_PERIOD_s - time.monotonic()
            if left_s > 0.0:
                time.sleep(left_s)
            began_s = time.monotonic()
            waiting = [self._waiting.popleft() for _ in range(len(self._waiting))]
            if not waiting:  # taken with the one before
                continue
            self._busy = True
            try:
                self._publish(waiting[-1], waiting)
            except Exception as error:  # noqa: BLE001 - the next output is as good as any
                tell(self._on_error, error)
            self._turns += 1
            self._busy = False


def tell(on_error: Callable[[Exception], None], error: Exception) -> None:
    """Report an error from a thread that must not end, also where reporting is what fails."""
    try:
        on_error(error)
    except Exception:  # noqa: BLE001 - reporting may raise anything
        _log.exception("'%s' could not be reported", error)


def is_heard(publisher: Any) -> bool:
    """Whether anybody subscribes: what nobody hears need not be made."""
    return bool(publisher.get_subscription_count() > 0)
