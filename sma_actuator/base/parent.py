"""A process that ends with the one that began it, whatever ends that: also what nobody can catch."""

from __future__ import annotations

import ctypes
import os

_SET_DEATH_SIGNAL = 1  #: PR_SET_PDEATHSIG of prctl(2)


def end_with(parent: int, number: int) -> None:
    """Have this process sent the signal ``number`` when the thread of process ``parent`` that began it ends."""
    ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, number)
    if os.getppid() != parent:
        os._exit(1)  # it has ended before
