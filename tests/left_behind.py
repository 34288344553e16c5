"""Whatever ends the tests, Ctrl-C or ``kill -9`` too, ends what they started: benches, nodes, and what those started.

A process of its own waits for the end of this one, which closes a pipe, and kills every process that has this one's
mark in its environment.  So it does not matter who is whose child, or which group or session it is in.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

_MARK = "SMA_TESTS_OF"
_END_OTHERS = """
import os, signal, sys, time
from pathlib import Path
mark = sys.argv[1].encode()
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_IGN)
sys.stdin.buffer.read()
clean = 0
while clean < 2:  # what is just being started has its mark a moment later
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if mark in (process / "environ").read_bytes().split(b"\\0"):
                os.kill(int(process.name), signal.SIGKILL)
                found.append(process)
        except OSError:
            pass
    clean = 0 if found else clean + 1
    time.sleep(0.2)
"""


def end_with_this_process() -> subprocess.Popen[bytes] | None:
    """Let all that is started from now on end with this process, at the latest; None where there is no ``/proc``."""
    if not Path("/proc/self/environ").exists():
        return None
    mark = f"{_MARK}={os.getpid()} {Path('/proc/self/stat').read_text().split()[21]}"  # and when it was started
    unmarked = {name: value for name, value in os.environ.items() if name != _MARK}
    watcher = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", _END_OTHERS, mark],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=unmarked,
        start_new_session=True,
    )
    os.environ[_MARK] = mark.partition("=")[2]
    return watcher
