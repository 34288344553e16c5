"""Off for a supply without a watchdog whose program is gone, or stands still: killed, stopped, or ended by what nobody
can catch.

A process of its own, begun when such a supply is first switched on, waits for the end of the program that drives it,
or for its silence where that has promised to be heard (``last_word.py``).  Here is what the program knows of it.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

from sma_actuator.base.parameters import from_mapping, refuse, to_mapping
from sma_actuator.base.sections import Loop, SupplyParameters

from .parameters import Instruments, InstrumentSections

_SECTIONS = {"instruments": Instruments, "supply": SupplyParameters, "loop": Loop}
#: The promise: off is said so soon after the end of the program, and read back in the time of an answer.
WITHIN_s = 1.0
#: Silence beyond ``safety.reading_timeout`` and an answer after which a program stands still: the watchman of one that
#: runs says off after half of it.
STANDS_STILL_s = 1.0
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
            [sys.executable, "-m", f"{__package__}.last_word", str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            start_new_session=True,  # what ends the program's terminal is not for it
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                "SMA_ACTUATOR_NO_JIT": "1",  # it reckons nothing: half the time to begin, and a third of the memory
            },
        )
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(sections).encode() + b"\n")
        self._process.stdin.flush()
        os.set_blocking(self._process.stdin.fileno(), False)  # nobody waits for one that does not read

    @property
    def waits(self) -> bool:
        """Whether it is still there, and does not stand still, as after SIGSTOP."""
        if self._process.poll() is not None:
            return False
        return os.waitid(os.P_PID, self._process.pid, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is None

    def promise(self, silent_s: float) -> None:
        """The program will be heard again within so long, or have switched off; 0: it need not be."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # that it is gone, :attr:`waits` says
            os.write(self._process.stdin.fileno(), f"{silent_s:g}\n".encode())

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
