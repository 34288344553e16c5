"""Off for a supply without a watchdog whose program is gone: killed, or ended by what nobody can catch.

A process of its own, begun when such a supply is first switched on, waits for the end of the program that drives it: its
standard input ends then, whatever ended the program.  It then makes a session of its own and says off until that is read
back.  While another program has the instrument it says nothing: that one's first words were off.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from sma_actuator.base.interrupts import every_ending_signal
from sma_actuator.base.parameters import from_mapping, refuse, to_mapping
from sma_actuator.base.sections import Loop, SupplyParameters

from . import InstrumentError, InstrumentRefused, open_supply
from .parameters import Instruments, InstrumentSections

if TYPE_CHECKING:
    from .supply import SessionSupply

_SECTIONS = {"instruments": Instruments, "supply": SupplyParameters, "loop": Loop}
#: The promise: off is said so soon after the end of the program, and read back in the time of an answer.
WITHIN_s = 1.0
_LOOK_s = 0.2  #: how often it is looked whether the program is gone though something of it keeps the pipe open
_AGAIN_s = 0.25  #: between attempts: the connection of the dead may take a moment to go
_ATTEMPTS_s = 30.0  #: how long it is tried: a supply that cannot be reached for longer is for a person
OFF_ANSWERS = 3  #: of instruments.supply.timeout, for each attempt; so long another program waits for it


def sections_of(mapping: dict[str, Any], source: str) -> InstrumentSections:
    """What a supply needs of the parameters and no more: the whole configuration takes seconds to import.

    Raises ConfigError.
    """
    sections = {}
    for name, kind in _SECTIONS.items():
        sections[name], problems = from_mapping(kind, mapping.get(name, {}), f"{name}.")
        refuse(problems, source)
    return SimpleNamespace(**sections)


class Afterwards:
    """The process that waits, as the program sees it."""

    def __init__(self, config: InstrumentSections):
        """Begin it.  Raises OSError where no process can be begun."""
        sections = {name: to_mapping(getattr(config, name)) for name in _SECTIONS}
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            start_new_session=True,  # what ends the program's terminal is not for it
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(sections).encode() + b"\n")
        self._process.stdin.flush()

    @property
    def waits(self) -> bool:
        """Whether it is still there."""
        return self._process.poll() is None

    def dismiss(self) -> None:
        """End it without a word: the supply has read back that it is off."""
        self._process.kill()
        self.leave()
        self._process.wait()

    def leave(self) -> None:
        """Have it say off, as though the program were gone."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()


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


def _wait_for_the_end(program: int) -> None:
    """Until nothing keeps the standard input open any more, or the process is gone."""
    while os.getppid() == program:
        ready, _, _ = select.select([sys.stdin.fileno()], [], [], _LOOK_s)
        if ready and not os.read(sys.stdin.fileno(), 1):
            return


def main() -> None:
    """``python -m sma_actuator.instruments.afterwards PROCESS``; the sections as one line of JSON on standard input."""
    for number in every_ending_signal():
        signal.signal(number, signal.SIG_IGN)  # as a service manager sends them to all that it ends
    program = int(sys.argv[1])
    line = b""
    while not line.endswith(b"\n"):
        piece = os.read(sys.stdin.fileno(), 1 << 16)
        if not piece:
            return  # it was gone before it had said what to do, and so before current flowed
        line += piece
    config = sections_of(json.loads(line), "what the program said")
    supply = open_supply(config)
    _wait_for_the_end(program)
    said = switch_off(supply, program, OFF_ANSWERS * config.instruments.supply.timeout)  # type: ignore[arg-type]
    with contextlib.suppress(OSError):
        where = config.instruments.supply.resource
        os.write(2, f"process {program}, which drove the supply at {where}, is gone: the output {said}\n".encode())


if __name__ == "__main__":
    main()
