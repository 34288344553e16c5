"""Starts nodes quickly: imports everything once, and then forks one process for each node that is asked for.

``python -m attack.nursery`` reads one JSON list of arguments a line and answers ``started PID``; when a node ends it
says ``ended PID CODE`` (minus the signal's number where one ended it).  What runs in the fork is the node's own
``main``.
"""

from __future__ import annotations

import json
import os
import select
import sys

from sma_actuator.ros import node

_REAP_s = 0.02


def _start(request: dict) -> int:
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        log = os.open(request["log"], os.O_CREAT | os.O_WRONLY | os.O_APPEND)
        for stream in (1, 2):
            os.dup2(log, stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        code = node.main(request["arguments"])
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def main() -> None:
    """Start nodes until the input ends."""
    waiting = b""
    children: set[int] = set()
    while True:
        ready, _, _ = select.select([0], [], [], _REAP_s)
        if ready:
            part = os.read(0, 65536)
            if not part:
                return
            waiting += part
            *lines, waiting = waiting.split(b"\n")
            for line in lines:
                pid = _start(json.loads(line))
                children.add(pid)
                print(f"started {pid}", flush=True)
        for pid in list(children):
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                children.discard(pid)
                print(f"ended {pid} {os.waitstatus_to_exitcode(status)}", flush=True)


if __name__ == "__main__":
    main()
