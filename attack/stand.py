"""The bench as a process of its own, what is true on it, and how long this machine stood still meanwhile."""

from __future__ import annotations

import collections
import itertools
import json
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SOON_s = 120.0  #: bound of waits that normally take under a second
COMPILING_s = 180.0  #: the bench may have to be compiled first
LOOK_s = 5e-3
NO_CURRENT_A = 1e-6


def wait_until(condition: Callable[[], Any], timeout_s: float = SOON_s, what: str = "it") -> Any:
    """Poll ``condition`` until it is true; its value.  Raises TimeoutError."""
    deadline_s, is_late = time.monotonic() + timeout_s, False
    while not (value := condition()):
        if is_late:
            raise TimeoutError(f"{what} did not come within {timeout_s:g} s")
        time.sleep(LOOK_s)
        is_late = time.monotonic() > deadline_s  # one more look: this process may not have run meanwhile
    return value


@dataclass(frozen=True, slots=True)
class Seen:
    """What was true on the bench at one instant."""

    at_s: float  #: this machine's monotonic clock, after the answer
    bench_s: float
    displacement_m: float
    temperature_C: float
    stress_Pa: float
    current_A: float


class Stand:
    """A bench process.  Asked on its DAQ's port, which feeds no watchdog, by a thread that looks all the time."""

    def __init__(self, *arguments: str):
        self._folder = tempfile.TemporaryDirectory(prefix="sma_attack_")
        ports_file = Path(self._folder.name) / "ports.json"
        command = [sys.executable, "-m", "sma_actuator", "bench", "--supply-port", "0", "--daq-port", "0"]
        self.process = subprocess.Popen(
            [*command, "--ports-file", str(ports_file), *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            wait_until(lambda: ports_file.exists() or self.process.poll() is not None, COMPILING_s, "the bench")
        except TimeoutError:
            self.process.kill()
            raise
        ports = json.loads(ports_file.read_text())[0]
        self.supply_port, self.daq_port = ports["supply"], ports["daq"]
        self._socket = socket.create_connection(("127.0.0.1", self.daq_port), timeout=SOON_s)
        self._lines = self._socket.makefile("rb")
        self._gate = threading.Lock()
        self.hottest_C = self.most_A = 0.0
        self.off_since_s = time.monotonic()  #: NaN while current flows
        self.longest_stall_s = 0.0
        self.now = self._look()
        self.seen: collections.deque[Seen] = collections.deque(maxlen=1000)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="judge", daemon=True)
        self._thread.start()

    def tell(self, command: str) -> str:
        """A command to the bench; its answer where it is a query."""
        with self._gate:
            self._socket.sendall(command.encode() + b"\n")
            return self._lines.readline().decode().strip() if "?" in command else ""

    def tell_supply(self, command: str) -> str:
        """A command to the supply, from a bystander's connection; its answer where it is a query."""
        with socket.create_connection(("127.0.0.1", self.supply_port), timeout=5.0) as wire:
            wire.sendall(command.encode() + b"\n")
            return wire.makefile("rb").readline().decode().strip() if "?" in command else ""

    def fresh(self) -> None:
        """Nothing of what was before counts any more, and no fault is left."""
        self.tell("BENC:FAUL:CLE")
        self.hottest_C = self.most_A = self.longest_stall_s = 0.0

    def off_within_s(self, since_s: float, longest_s: float) -> float:
        """Seconds from ``since_s`` until no current flowed, NaN where it flowed on for ``longest_s``.

        What this machine stood still is taken off: while the judge could not look, neither could the driver act.
        """
        self.longest_stall_s = 0.0
        while (waited_s := time.monotonic() - since_s) < longest_s + self.longest_stall_s:
            if self.off_since_s == self.off_since_s:
                return max(self.off_since_s - since_s - self.longest_stall_s, 0.0)
            time.sleep(min(LOOK_s, longest_s - waited_s if waited_s < longest_s else LOOK_s))
        return float("nan")

    def stalled_s(self, from_s: float, to_s: float) -> float:
        """The longest that this machine stood still between two instants of the last seconds."""
        times_s = [seen.at_s for seen in list(self.seen)]
        gaps_s = [b - a for a, b in itertools.pairwise(times_s) if b > from_s and a < to_s]
        return max(max(gaps_s, default=0.0) - 4.0 * LOOK_s, 0.0)

    def close(self) -> None:
        """End the process."""
        self._ending.set()
        self._thread.join(SOON_s)
        self._lines.close()
        self._socket.close()
        self.process.kill()
        self.process.wait()
        self._folder.cleanup()

    def _look(self) -> Seen:
        values = [float(value) for value in self.tell("BENC:TRUT?").split(",")]
        return Seen(time.monotonic(), values[0], values[1], values[3], values[8], values[9])

    def _watch(self) -> None:
        before_s = time.monotonic()
        while not self._ending.wait(LOOK_s):
            try:
                self.now = now = self._look()
                self.seen.append(now)
            except (OSError, ValueError, IndexError):
                return
            self.hottest_C, self.most_A = max(self.hottest_C, now.temperature_C), max(self.most_A, now.current_A)
            flows = now.current_A > NO_CURRENT_A
            if flows:
                self.off_since_s = float("nan")
            elif self.off_since_s != self.off_since_s:
                self.off_since_s = now.at_s
            self.longest_stall_s = max(self.longest_stall_s, now.at_s - before_s - 4.0 * LOOK_s)
            before_s = now.at_s
