"""Real time for a thread: its priority, its processors, and memory that is not swapped out (Linux, sched(7))."""

from __future__ import annotations

import contextlib
import ctypes
import os

from .parameters import ConfigError
from .sections import Realtime

_CURRENT_AND_FUTURE = 3  #: MCL_CURRENT | MCL_FUTURE of mman(2)


class RealtimeRefused(ConfigError):
    """The system does not allow what ``loop.realtime`` asks for."""


def begin(wanted: Realtime) -> None:
    """Give the calling thread what is wanted; nothing where nothing is.

    The memory is locked for the whole process.  Raises RealtimeRefused, with what the system would have to allow; the
    thread is then as it was.
    """
    if wanted.cpus:
        here = os.sched_getaffinity(0)
        if missing := sorted(set(wanted.cpus) - here):
            raise RealtimeRefused(
                f"loop.realtime.cpus: this process may not run on {_listed(missing)}; it may on {_listed(sorted(here))}"
            )
    if wanted.lock_memory and _lock_memory() != 0:
        raise RealtimeRefused(
            "loop.realtime.lock_memory: the system does not let this process lock its memory; give its user "
            "'memlock unlimited' in /etc/security/limits.conf, LimitMEMLOCK=infinity in systemd, or --ulimit "
            "memlock=-1 in a container"
        )
    if wanted.priority:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(wanted.priority))
        except OSError as error:
            raise RealtimeRefused(
                f"loop.realtime.priority: the system does not let this process run with priority {wanted.priority} "
                f"({error.strerror}); give its user 'rtprio {wanted.priority}' in /etc/security/limits.conf, "
                f"LimitRTPRIO={wanted.priority} in systemd, or --cap-add SYS_NICE to a container"
            ) from None
    if wanted.cpus:
        os.sched_setaffinity(0, wanted.cpus)


def _lock_memory() -> int:
    with contextlib.suppress(OSError, AttributeError):
        return int(ctypes.CDLL(None, use_errno=True).mlockall(_CURRENT_AND_FUTURE))
    return -1


def _listed(cpus: list[int]) -> str:
    return "processor " + str(cpus[0]) if len(cpus) == 1 else "processors " + ", ".join(map(str, cpus))
