"""How a program of the tests ends where somebody asks it to."""

import contextlib
import signal

from sma_actuator.base.interrupts import ending_signals


@contextlib.contextmanager
def signals_end_the_program():
    """What asks a program to end raises SystemExit, as SIGINT raises KeyboardInterrupt: every ``finally`` and
    atexit function runs, so every driver is stopped.  For tools; in the main thread."""

    def leave(number, _frame):
        raise SystemExit(128 + number)

    before = {number: signal.signal(number, leave) for number in ending_signals()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
