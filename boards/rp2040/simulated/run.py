"""The board without the board: its firmware, simulated parts and a virtual wire at the end of a serial line.

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
from sma_actuator.config import copy_tables
from sma_actuator.plant.loads import Weight

LOOK_s = 0.02
HERE = Path(__file__).parent
ROOT = HERE.parents[2]
NODE_MODULES = ROOT / ".node" / "node_modules"
MICROPYTHON = NODE_MODULES / "@micropython" / "micropython-webassembly-pyscript"


class SimulatedBoard:
    """A pseudo-terminal with the board behind it: ``resource``.  The firmware is a process of its own, started anew
    where the watchdog says so."""

    def __init__(self, bench: VirtualBench, micropython: bool = False):
        self._ours, self._theirs = os.openpty()  # the other end is kept: else reading fails while nobody is there
        tty.setraw(self._theirs)
        self.resource = f"ASRL{os.ttyname(self._theirs)}::INSTR"
        self.world = World(bench, clock=time.monotonic, send=self._send)
        self._program = (
            ["node", str(HERE / "firmware.mjs"), str(NODE_MODULES)]
            if micropython
            else [sys.executable, str(HERE / "firmware.py")]
        )
        self._ended = threading.Event()
        self.firmware = self._start()
        self._watching = threading.Thread(target=self._watch, daemon=True)
        self._watching.start()
        threading.Thread(target=self._listen, daemon=True).start()

    def _start(self) -> subprocess.Popen:
        ours, theirs = socket.socketpair()
        firmware = subprocess.Popen(
            [*self._program, str(theirs.fileno())], pass_fds=[theirs.fileno()], start_new_session=True
        )
        theirs.close()
        threading.Thread(target=self._answer, args=(ours,), daemon=True).start()
        return firmware

    def _answer(self, connection: socket.socket) -> None:
        with contextlib.suppress(Reset, OSError), connection, connection.makefile("rw", newline="\n") as line:
            for text in line:
                answer = self.world.call(text[:-1])
                line.write(answer + "\n")
                line.flush()

    def _watch(self) -> None:
        """The watchdog is the world's: so time goes on there for a program that somebody has stopped, or ended."""
        while not self._ended.wait(LOOK_s):
            with contextlib.suppress(OSError):
                if Path(f"/proc/{self.firmware.pid}/stat").read_text().rpartition(")")[2].split()[0] in "TZ":
                    self.world.keep_up()
            if self.world.was_reset:
                self._end_firmware()
                self.world.boot()
                self.firmware = self._start()

    def _end_firmware(self) -> None:
        self.firmware.kill()
        self.firmware.wait()

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
        self._ended.set()
        self._watching.join()
        self._end_firmware()
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
            shipped = ROOT / "config" / "board.yaml"
            text = shipped.read_text(encoding="utf-8").replace("ASRL/dev/ttyACM0::INSTR", board.resource)
            args.config_out.parent.mkdir(parents=True, exist_ok=True)
            args.config_out.write_text(text, encoding="utf-8")
            copy_tables(shipped, args.config_out)
        print(f"the board is at {board.resource}; Ctrl-C ends it", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            signal.pause()


if __name__ == "__main__":
    main()
