"""Signals that are noted, not raised, for commands that drive something.

An exception that a signal raises comes up between any two instructions, also inside a library's wait, a ``finally``
or a callback that catches everything: it can be lost, and the command goes on driving.  A note cannot.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator


class Interrupts:
    """What has been noted; true once there is something."""

    def __init__(self) -> None:
        self.number = 0  #: of the first signal, 0 while there was none

    def __bool__(self) -> bool:
        return self.number != 0

    def note(self, number: int, _frame: object = None) -> None:
        """Note a signal; the first one stays."""
        self.number = self.number or number

    def raise_noted(self) -> None:
        """Raise KeyboardInterrupt where a signal was noted: at a place that is ready for it."""
        if self:
            raise KeyboardInterrupt


@contextlib.contextmanager
def noted_signals() -> Iterator[Interrupts]:
    """Note SIGINT, SIGTERM, SIGQUIT and SIGHUP while the block runs; afterwards they do what they did before.

    A SIGHUP that is ignored (``nohup``) stays ignored.  In a thread other than the main one nothing is noted, since
    Python lets only the main thread have handlers.
    """
    interrupts = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGQUIT]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, interrupts.note) for number in numbers}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
