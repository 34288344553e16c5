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


def ending_signals() -> list[signal.Signals]:
    """What asks a program to end, besides Ctrl-C; a SIGHUP that is ignored (``nohup``) stays ignored."""
    hang_up = [] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [signal.SIGHUP]
    return [signal.SIGTERM, signal.SIGQUIT, *hang_up]


@contextlib.contextmanager
def noted_signals() -> Iterator[Interrupts]:
    """Note SIGINT, also where it was ignored, and :func:`ending_signals` while the block runs; afterwards they do what
    they did before.

    In a thread other than the main one nothing is noted, since Python lets only the main thread have handlers.
    """
    interrupts = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    before = {number: signal.signal(number, interrupts.note) for number in (signal.SIGINT, *ending_signals())}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
