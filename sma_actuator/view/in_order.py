"""Work for the thread of an executor of rclpy, done in the order in which it was given.

The executor itself begins with the task that was given last: where two wait, as on a busy machine, ``~/stop`` would be
sent before the ``~/enable`` that was asked for first, and leaving a topic after taking it.
"""

from __future__ import annotations

import collections
from collections.abc import Callable

from rclpy.executors import Executor


class InOrder:
    """Takes work from any thread."""

    def __init__(self, executor: Executor):
        self._executor = executor
        self._waiting: collections.deque[Callable[[], None]] = collections.deque()

    def put(self, work: Callable[[], None]) -> None:
        """Have something done."""
        self._waiting.append(work)
        self._executor.create_task(self._next)

    def _next(self) -> None:
        self._waiting.popleft()()
