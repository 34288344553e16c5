"""Starts programs quickly: one process imports most of what they do and loads the kernels, and forks itself for each
that is asked for.

What runs in the fork is the program's own ``main``; only the end of its interpreter is left out.  A node and its bench
take three seconds of processor time to start by themselves, which is most of what a short test of them takes, and one
in this way.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import inspect
import json
import multiprocessing
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from multiprocessing.connection import wait
from pathlib import Path

SHOW_STACKS = signal.SIGWINCH  #: which ends nothing: has a program write into its log where its threads are
_SOON_s = 150.0  #: to import everything, on a busy machine


class Process:
    """A started program, with the methods of :class:`subprocess.Popen` that serve without pipes."""

    def __init__(self, pid: int):
        self.pid, self.returncode = pid, None
        self._ended = threading.Event()

    def has_ended(self, code: int) -> None:
        """Its parent says so."""
        self.returncode = code
        self._ended.set()

    def poll(self) -> int | None:
        """Exit code (minus the signal's number where one ended it), None while it runs."""
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code, once it has one.  Raises subprocess.TimeoutExpired."""
        if not self._ended.wait(timeout):
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, if it still runs."""
        if self.returncode is None:
            try:
                os.kill(self.pid, number)
            except ProcessLookupError:  # it has just ended
                self.wait(_SOON_s)

    def terminate(self) -> None:
        """SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """SIGKILL."""
        self.send_signal(signal.SIGKILL)


class Nursery:
    """The process that forks, seen from the one that asks."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "attack.nursery"],
            cwd=Path(__file__).resolve().parents[1],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for whoever asks
        )
        self._started: queue.Queue[Process] = queue.Queue()
        self._running: dict[int, Process] = {}
        threading.Thread(target=self._listen, name="nursery", daemon=True).start()

    def start(self, program: Sequence[str], arguments: Sequence[str], log: Path | str) -> Process:
        """Fork ``-m`` with one of :data:`PROGRAMS`, or ``-c`` with code, as the interpreter takes them; what it writes
        goes to the end of ``log``."""
        with Path(log).open("ab"):
            pass  # it is there from now on
        request = {
            "program": [*program],
            "arguments": [*arguments],
            "log": str(log),
            "folder": str(Path.cwd()),
            "environment": dict(os.environ),
        }
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return self._started.get(timeout=_SOON_s)

    def close(self) -> None:
        """Start no more."""
        self._process.stdin.close()
        self._process.wait(_SOON_s)

    def _listen(self) -> None:
        for line in self._process.stdout:
            word, pid, *code = line.split()
            if word == "started":
                self._running[int(pid)] = Process(int(pid))
                self._started.put(self._running[int(pid)])
            else:
                self._running.pop(int(pid)).has_ended(int(code[0]))


def _become(request: dict) -> None:
    """Run a program in this process, which was forked for it."""
    log = os.open(request["log"], os.O_WRONLY | os.O_APPEND)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for stream, instead in ((0, nothing), (1, log), (2, log)):
        os.dup2(instead, stream)
    os.close(log)
    os.close(nothing)
    faulthandler.register(SHOW_STACKS, 2)
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    (kind, what), arguments = request["program"], request["arguments"]
    sys.argv = [what if kind == "-m" else kind, *arguments]
    if kind == "-m":
        sys.exit(PROGRAMS[what](arguments))
    exec(compile(what, "<string>", "exec"), {"__name__": "__main__"})


def _command(arguments: list[str]) -> int:
    from sma_actuator.cli.main import main

    return main(arguments)


def _node(arguments: list[str]) -> int:
    from sma_actuator.ros.node import main

    return main(arguments)


PROGRAMS = {"sma_actuator": _command, "sma_actuator.ros.node": _node}


def _load() -> None:
    """Import what programs import, and load what their first step would read from disk.  Not rclpy: the nodes that are
    forked of one process in which Fast DDS is loaded take each other for one participant, and lose messages."""
    import sma_msgs_py  # noqa: F401
    from sma_actuator.base.share import shared_file
    from sma_actuator.bench.server import BenchServer, VirtualBench
    from sma_actuator.config import Config, read_parameter_file
    from sma_actuator.driver.warm_up import warm_up

    BenchServer(VirtualBench.from_name("flexinol"))
    warm_up(Config.from_mapping(read_parameter_file(shared_file("config/flexinol.yaml"))))
    with contextlib.suppress(ModuleNotFoundError):
        import rosidl_generator_py  # noqa: F401 - what rclpy wants first of all, and is Python alone
    # With a node's first word rclpy asks this, and Python looks through all modules that there are: 40 ms.
    inspect.getframeinfo(inspect.currentframe())
    assert "rclpy" not in sys.modules
    # What is loaded stays: a program that begins by looking for garbage would look through all of it, and copy it.
    gc.freeze()


def _serve() -> None:
    """Fork for each request, one JSON object a line, answer ``started PID`` and in the end ``ended PID CODE``."""
    waiting = b""
    children: dict[int, multiprocessing.Process] = {}
    while True:
        ready = wait([sys.stdin, *children])
        if sys.stdin in ready:
            part = os.read(sys.stdin.fileno(), 65536)
            if not part:  # whoever asked is gone, and what was started with it
                for child in children.values():
                    child.kill()
                return
            waiting += part
            *lines, waiting = waiting.split(b"\n")
            for line in lines:
                child = multiprocessing.get_context("fork").Process(target=_become, args=(json.loads(line),))
                child.start()
                children[child.sentinel] = child
                print(f"started {child.pid}", flush=True)
        for sentinel in ready:
            if sentinel in children:
                child = children.pop(sentinel)
                child.join()
                print(f"ended {child.pid} {child.exitcode}", flush=True)


if __name__ == "__main__":
    _load()
    _serve()
    os._exit(0)  # who was killed is not waited for
