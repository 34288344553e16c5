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


#: Those that nobody can catch, that end nothing, that only stop a program or let it go on, and that a crash raises:
#: what has crashed runs no handler.
_NOT_ENDING = {
    *(signal.SIGKILL, signal.SIGSTOP),
    *(signal.SIGCHLD, signal.SIGURG, signal.SIGWINCH, signal.SIGCONT),
    *(signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU),
    *(signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGABRT, signal.SIGTRAP, signal.SIGSYS),
}


def every_ending_signal() -> list[int]:
    """All that end a program which does nothing about them, and can be caught."""
    return sorted(set(signal.valid_signals()) - _NOT_ENDING)


def ending_signals() -> list[int]:
    """What would end this program, besides Ctrl-C; what is ignored (as SIGHUP by ``nohup``), or has a handler that is
    none of ours, stays as it is.  SIGTERM, SIGQUIT and SIGHUP ask a program to end, whoever else listens."""

    def is_ours(number: int) -> bool:
        handler = signal.getsignal(number)
        asks = number in (signal.SIGTERM, signal.SIGQUIT) or (number == signal.SIGHUP and handler is not signal.SIG_IGN)
        return asks or handler is signal.SIG_DFL or isinstance(getattr(handler, "__self__", None), Interrupts)

    return [number for number in every_ending_signal() if number != signal.SIGINT and is_ours(number)]


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
