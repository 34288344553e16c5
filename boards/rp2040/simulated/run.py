"""The board without the board: its firmware, simulated parts and a wire of the virtual bench at the end of a serial line.

python boards/rp2040/simulated/run.py --config-out out/board.yaml
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from world import Reset, World

from sma_actuator.bench import VirtualBench
from sma_actuator.plant.loads import Weight

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
NODE_MODULES = ROOT / ".node" / "node_modules"
MICROPYTHON = NODE_MODULES / "@micropython" / "micropython-webassembly-pyscript"


class SimulatedBoard:
    """A pseudo-terminal with the board behind it: ``resource``.  The firmware is a process of its own."""

    def __init__(self, bench: VirtualBench, micropython: bool = False):
        self._ours, theirs = os.openpty()
        tty.setraw(theirs)
        self._theirs = theirs  # kept: else nobody may be at the other end, and reading fails
        self.path = os.ttyname(theirs)
        self.resource = f"ASRL{self.path}::INSTR"
        self.world = World(bench, clock=time.monotonic, send=self._send)
        world, firmware = socket.socketpair()
        number = str(firmware.fileno())
        program = (
            ["node", str(HERE / "firmware.mjs"), number, str(NODE_MODULES)]
            if micropython
            else [sys.executable, str(HERE / "firmware.py"), number]
        )
        self.firmware = subprocess.Popen(program, pass_fds=[firmware.fileno()], start_new_session=True)
        firmware.close()
        self._threads = [
            threading.Thread(target=self._answer, args=(world,), daemon=True),
            threading.Thread(target=self._listen, daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def _answer(self, connection: socket.socket) -> None:
        with connection, connection.makefile("rw", newline="\n") as line, contextlib.suppress(Reset, OSError):
            for text in line:
                answer = self.world.call(text[:-1])
                line.write(answer + "\n")
                line.flush()

    def _listen(self) -> None:
        with contextlib.suppress(OSError):
            while data := os.read(self._ours, 4096):
                self.world.hear(data)

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            os.write(self._ours, data)

    def cut_line(self) -> None:
        """Pull the cable: nothing comes or goes any more."""
        ours, self._ours = self._ours, -1
        for end in (self._theirs, ours):
            os.close(end)

    def close(self) -> None:
        """End the firmware."""
        self.firmware.send_signal(signal.SIGCONT)
        self.firmware.kill()
        self.firmware.wait()
        if self._ours >= 0:
            self.cut_line()

    def __enter__(self) -> SimulatedBoard:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def main() -> None:
    """Serve until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--load", type=float, default=0.98, metavar="N", help="weight on the wire (default %(default)s)"
    )
    parser.add_argument(
        "--micropython", action="store_true", help="run the firmware by MicroPython (`make micropython` installs it)"
    )
    parser.add_argument(
        "--config-out", type=Path, metavar="FILE", help="write config/board.yaml with the line's name in it"
    )
    args = parser.parse_args()
    if args.micropython and not MICROPYTHON.exists():
        parser.error("MicroPython is not there: `make micropython` installs it")
    with SimulatedBoard(VirtualBench.from_name("flexinol", load=Weight(args.load)), args.micropython) as board:
        if args.config_out:
            text = (ROOT / "config" / "board.yaml").read_text(encoding="utf-8")
            args.config_out.parent.mkdir(parents=True, exist_ok=True)
            args.config_out.write_text(text.replace("ASRL/dev/ttyACM0::INSTR", board.resource), encoding="utf-8")
        print(f"the board is at {board.resource}; Ctrl-C ends it", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            board.firmware.wait()


if __name__ == "__main__":
    main()
