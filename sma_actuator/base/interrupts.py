"""What signals do to a command: they are noted where it drives something, and raised where it does not.

An exception that a signal raises comes up between any two instructions, also inside a library's wait, a ``finally``
or a callback that catches everything: it can be lost, and the command goes on driving.  A note cannot.  A command that
only reckons would end at once anyway; the exception lets it take its processes and its temporary files with it.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Sequence


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
            raise KeyboardInterrupt(self.number)


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


def asking_signals() -> list[int]:
    """What asks a program to end, whoever else listens: SIGTERM, SIGQUIT, and SIGHUP where ``nohup`` has not had it
    ignored."""
    asked: list[int] = [signal.SIGTERM, signal.SIGQUIT]
    return asked if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else [*asked, signal.SIGHUP]


def ending_signals() -> list[int]:
    """What would end this program, besides Ctrl-C: :func:`asking_signals`, and any other that is not ignored and has no
    handler but ours."""
    asking = asking_signals()

    def is_ours(number: int) -> bool:
        handler = signal.getsignal(number)
        by_itself = handler is signal.SIG_DFL or isinstance(getattr(handler, "__self__", None), Interrupts)
        return number in asking or by_itself

    return [number for number in every_ending_signal() if number != signal.SIGINT and is_ours(number)]


@contextlib.contextmanager
def raised_signals(*numbers: int) -> Iterator[None]:
    """Let these signals raise KeyboardInterrupt with their number (Ctrl-C's has none) while the block runs; afterwards
    they do what they did before.

    In a thread other than the main one nothing changes, since Python lets only the main thread have handlers.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, _frame: object) -> None:
        raise KeyboardInterrupt(number)

    before = {number: signal.signal(number, interrupt) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def handled_signals() -> list[int]:
    """Those that end a program and have a handler of Python's, which raises an exception or does something else."""
    return [number for number in every_ending_signal() if callable(signal.getsignal(number))]


@contextlib.contextmanager
def noted_signals(numbers: Sequence[int] | None = None) -> Iterator[Interrupts]:
    """Note these signals, or SIGINT, also where it was ignored, and :func:`ending_signals`, while the block runs;
    afterwards they do what they did before.

    In a thread other than the main one nothing is noted, since Python lets only the main thread have handlers.
    """
    interrupts = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    numbers = (signal.SIGINT, *ending_signals()) if numbers is None else numbers
    before = {number: signal.signal(number, interrupts.note) for number in numbers}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def kept_handlers() -> Iterator[None]:
    """Let every signal that ends a program do afterwards what it did before, whatever the block makes of it."""
    if threading.current_thread() is not threading.main_thread():
        yield  # where Python lets nobody have handlers
        return
    before = {number: signal.getsignal(number) for number in every_ending_signal()}
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None and signal.getsignal(number) != handler:  # None: not one of Python's
                signal.signal(number, handler)
