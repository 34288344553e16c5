"""A driver that drives a wire of the virtual bench through a power supply that somebody else wrote."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
import os
import select
import socket
import subprocess
import sys
import threading
import time
import tty
from pathlib import Path

from emulators import State
from liar import Liar
from waiting import Elapsed

from sma_actuator.base.signals import Mode
from sma_actuator.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.instruments import open_supply
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.plant.loads import Weight

HERE = Path(__file__).parent
#: Where `make counterparts` puts the emulators that want a Python or packages of their own.
OWN_PYTHON = HERE.parents[1] / ".counterparts" / "bin" / "python"
ANSWER_s = 30.0  #: for the back door, which no fault touches
SOON_s = 60.0  #: bound of every wait; none is expected to take long
TOLERANCE_m = 2e-4
COLD_Ohm = 8.0  #: what hangs on the output until current has flown


@functools.cache
def python_with(module: str) -> str | None:
    """The Python that can import it: this one, or that of `make counterparts`."""
    for python in (sys.executable, str(OWN_PYTHON)):
        look = f"import importlib.util as i, sys; sys.exit(i.find_spec({module!r}) is None)"
        if Path(python).exists() and subprocess.run([python, "-c", look], capture_output=True).returncode == 0:
            return python
    return None


class BackDoor:
    """Asks an emulator what it holds its output for."""

    def __init__(self, port: int):
        self._socket = socket.create_connection(("127.0.0.1", port), ANSWER_s)
        self._stream = self._socket.makefile("rw", newline="\n")
        self._lock = threading.Lock()

    def state(self, **request: float) -> State:
        """Its state, after ``load_Ohm`` was hung on its output where that is given."""
        with self._lock:
            self._stream.write(json.dumps(request) + "\n")
            self._stream.flush()
            return State(**json.loads(self._stream.readline()))

    def close(self) -> None:
        self._stream.close()
        self._socket.close()


class Emulator:
    """One of ``emulators.py`` in a process of its own."""

    def __init__(self, name: str, python: str):
        self.name = name
        errors = None if os.environ.get("COUNTERPARTS_LOUD") else subprocess.DEVNULL
        self._process = subprocess.Popen(
            [python, str(HERE / "emulators.py"), name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
        self.ports = json.loads(self._process.stdout.readline())
        self.back_door = BackDoor(self.ports["back_door"])

    def close(self) -> None:
        self.back_door.close()
        self._process.communicate("")  # the end of its input is its end


class SerialLine:
    """A serial line (a pseudo-terminal) before an instrument on TCP: it never hangs up, whatever becomes of the
    connection."""

    def __init__(self, port: int, end: bytes):
        self._port, self._end = port, end
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.resource = f"ASRL{os.ttyname(self._theirs)}::INSTR"
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def _carry(self) -> None:
        said, target = b"", None
        while not self._ended.is_set():
            ends = [self._ours] if target is None else [self._ours, target]
            ready = select.select(ends, [], [], 0.02)[0]
            if self._ours in ready:
                said += os.read(self._ours, 4096)
                target = target or socket.create_connection(("127.0.0.1", self._port), ANSWER_s)
                line, found, said = said.rpartition(self._end)
                with contextlib.suppress(OSError):
                    target.sendall(line + found)
            if target in ready:
                data = b""
                with contextlib.suppress(OSError):
                    data = target.recv(4096)
                if data:
                    os.write(self._ours, data)
                else:
                    target = target.close()
        if target is not None:
            target.close()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        os.close(self._ours)
        os.close(self._theirs)


class WireBehind:
    """The DAQ of a bench whose wire carries what the emulator lets flow; the emulator feels the wire's resistance."""

    identity = "a wire behind somebody else's supply"

    def __init__(self, config: Config, clock: MonotonicClock, back_door: BackDoor):
        self.bench = VirtualBench.from_name("flexinol", seed=1, load=Weight(0.49))
        self._clock, self._back_door = clock, back_door
        self._daq = InProcessDaq(self.bench, config)
        self._began_s = clock.now_s()

    def open(self) -> None:
        self._daq.open()
        self._advance()

    def _advance(self) -> None:
        bench = self.bench
        flows = bench.current_A > 1e-3
        state = self._back_door.state(load_Ohm=bench.voltage_V / bench.current_A if flows else COLD_Ohm)
        bench.supply.set_voltage(state.setting_V)
        bench.supply.set_current(state.setting_A)
        bench.supply.set_output(state.on)
        bench.advance(self._clock.now_s() - self._began_s)

    def read_block(self):
        self._advance()
        reading = self._daq.read_block()
        return dataclasses.replace(reading, time_s=self._clock.now_s())

    def close(self) -> None:
        self._daq.close()


class Rig:
    """Driver, emulator and wire, in real time."""

    def __init__(self, mapping: dict, back_door: BackDoor, liar: Liar | None = None):
        self.back_door = back_door
        self.liar = liar  #: the line to the emulator
        self.config = Config.from_mapping(mapping)
        self.outputs: list = []
        clock = MonotonicClock()
        self.supply = open_supply(self.config)
        self.wire = WireBehind(self.config, clock, back_door)
        self.driver = Driver(self.config, self.supply, self.wire, clock, on_output=self.outputs.append)

    def until(self, condition, within_s: float = SOON_s) -> float:
        """Seconds until it holds."""
        elapsed = Elapsed()
        while not condition():
            assert elapsed.look() < within_s, self.outputs[-1:]
            time.sleep(0.005)
        return elapsed.look()

    def drive(self) -> None:
        """Have current flow; a machine that stalls may lose an instrument meanwhile."""
        self.until(lambda: self.outputs)
        self.until(self.drives)

    def reach(self, position_m: float) -> None:
        """Have the wire itself come there; enabled anew where a machine that stalls has switched it off on the way."""

        def is_there() -> bool:
            if self.drives():
                self.driver.offer_setpoint(position_m)
            return abs(self.wire.bench.truth.displacement_m - position_m) < TOLERANCE_m

        self.until(is_there)

    def drives(self) -> bool:
        """Whether current flows, enabled anew where it does not."""
        if self.status.mode is Mode.OFF:
            self.driver.clear_fault()
            self.driver.enable(True)
        return self.is_on and self.wire.bench.current_A > 0.04

    @property
    def status(self):
        return self.outputs[-1].status

    @property
    def is_on(self) -> bool:
        return self.back_door.state().on

    def close(self) -> None:
        self.driver.stop()
