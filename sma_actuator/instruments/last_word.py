"""The process that says off for a program that is gone, or stands still (``afterwards.py`` begins it).

Its standard input ends with the program, whatever ended that; on it the program says within how long it will be heard
again.  It then makes a session of its own and says off until that is read back.  While another program has the
instrument it says nothing: that one's first words were off.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import sys
import time

from sma_actuator.base.interrupts import every_ending_signal

from . import InstrumentError, InstrumentRefused, open_supply
from .afterwards import OFF_ANSWERS, sections_of
from .supply import SessionSupply

#: How often it is looked whether the program is silent, or gone though something of it keeps the pipe open.
_LOOK_s = 0.2
_AGAIN_s = 0.25  #: between attempts: the connection of the dead may take a moment to go
_ATTEMPTS_s = 30.0  #: how long it is tried: a supply that cannot be reached for longer is for a person


def switch_off(supply: SessionSupply, program: int, timeout_s: float) -> str:
    """Off for the process ``program`` that is gone, read back; in a sentence, what came of it."""
    until_s = time.monotonic() + _ATTEMPTS_s
    while True:
        try:
            with supply.claimed():
                supply.switch_off_beside(timeout_s)
            return "is off, confirmed by the supply"
        except InstrumentRefused as error:
            holder = supply.driven_by
            if holder is not None and (holder != program or os.getppid() == program):
                return f"is left to process {holder}, which drives it now"
            why: InstrumentError = error
        except InstrumentError as error:
            why = error
        if time.monotonic() >= until_s:
            return f"is NOT CONFIRMED to be off ({why}); look at the supply, and pull its plug if its output is on"
        time.sleep(_AGAIN_s)


def _wait_for_the_end(program: int) -> bool:
    """Until nothing keeps the standard input open any more, or the process is gone; or, then true, until it was silent
    for longer than it has promised.

    That is counted in looks: where the whole computer stood still, so did who looks.
    """
    silent_s = 0.0  # for so long it may be; 0: for ever
    looks = 0
    while os.getppid() == program:
        ready, _, _ = select.select([sys.stdin.fileno()], [], [], _LOOK_s)
        if ready:
            said = os.read(sys.stdin.fileno(), 1 << 16).split()
            if not said:
                return False
            silent_s, looks = float(said[-1]), 0
        elif silent_s and (looks := looks + 1) * _LOOK_s > silent_s:
            return True
    return False


def _switch_off_beside(supply: SessionSupply, program: int, timeout_s: float) -> str:
    """Off for a program that stands still, read back; in a sentence, what came of it.

    One that is in the way, as on a line with room for a single session, is killed: it cannot be asked to go.
    """
    with contextlib.suppress(InstrumentError):
        supply.switch_off_beside(timeout_s)
        return "is off, confirmed by the supply"
    os.kill(program, signal.SIGKILL)
    while os.getppid() == program:  # then its connection and its claim are free
        time.sleep(_AGAIN_s)
    return f"{switch_off(supply, program, timeout_s)} (the process was in the way, and was killed)"


def main() -> None:
    """``python -m sma_actuator.instruments.last_word PROCESS``; the sections as one line of JSON on standard input."""
    for number in every_ending_signal():
        signal.signal(number, signal.SIG_IGN)  # as a service manager sends them to all that it ends
    program = int(sys.argv[1])
    with open(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as begin:
        line = begin.readline()  # and not a byte more
    if not line.endswith(b"\n"):
        return  # it was gone before it had said what to do, and so before current flowed
    config = sections_of(json.loads(line), "what the program said")
    supply = open_supply(config)
    stands_still = _wait_for_the_end(program)
    how, off = ("stands still", _switch_off_beside) if stands_still else ("is gone", switch_off)
    said = off(supply, program, OFF_ANSWERS * config.instruments.supply.timeout)  # type: ignore[arg-type]
    with contextlib.suppress(OSError):
        where = config.instruments.supply.resource
        os.write(2, f"process {program}, which drove the supply at {where}, {how}: the output {said}\n".encode())


if __name__ == "__main__":
    main()
