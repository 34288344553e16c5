"""Standard input, output and error: a program may be started without them, and nobody may read what it writes."""

from __future__ import annotations

import contextlib
import fcntl
import io
import os
import sys
import threading
import time
from collections.abc import Iterator

_ROOM_B = 1 << 20  #: what may wait to be read; more is left out
_LAST_WORDS_s = 0.5  #: how long the end of the program waits for who reads


def keep_standard_streams() -> None:
    """Give a process that was started with one of them closed (``2>&-``, some service managers) an empty one instead.

    Else the next connection that is opened takes its number, and whatever is written to standard error, also by the
    libraries below Python, goes to the power supply.  What the locale of a terminal lacks, as Ω, comes as Python writes
    it: a program that drives a wire does not end by a letter.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # the lowest free number
            assert opened == number
            setattr(sys, name, os.fdopen(number, mode))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


@contextlib.contextmanager
def unblockable_streams() -> Iterator[None]:
    """Let what is written to standard output and error wait for its reader outside of whoever writes.

    A pager that pauses, a terminal stopped by Ctrl-S, a pipe that nobody empties would hold up the writer; and the
    libraries of ROS 2 write with the interpreter's lock held, so that the whole program, control loop and signals
    included, would stand still.  Where too much waits, words are left out.
    """
    real, threads = {}, []
    for number in (1, 2):
        reader, writer = os.pipe()
        with contextlib.suppress(OSError):  # a system may allow less
            fcntl.fcntl(writer, fcntl.F_SETPIPE_SZ, _ROOM_B)
        os.set_blocking(writer, False)
        real[number] = os.dup(number)
        os.dup2(writer, number)
        os.close(writer)
        threads.append(threading.Thread(target=_pass_on, args=(reader, real[number]), daemon=True))
        threads[-1].name = f"words to {number}"
        threads[-1].start()
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        for number, kept in real.items():
            os.dup2(kept, number)  # the last end for writing is closed: who passes on comes to the end
        deadline_s = time.monotonic() + _LAST_WORDS_s
        for thread in threads:
            thread.join(max(deadline_s - time.monotonic(), 0.0))


def _pass_on(reader: int, to: int) -> None:
    """Everything from one to the other, until the end; where nobody is left to read, to nobody."""
    with contextlib.suppress(OSError):
        while data := os.read(reader, 65536):
            with contextlib.suppress(OSError):
                while data:
                    data = data[os.write(to, data) :]
    os.close(reader)
    os.close(to)
