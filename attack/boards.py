"""Kills at random instants with a board at the end of a serial line: the real node, and the board's own firmware, by
MicroPython where that is there, behind a pseudo-terminal.

Whoever is ended or stopped, node or firmware, and when the cable is pulled: the last pulse comes within the time that
docs/board.md promises, in the board's own time, and what can go on drives again.  What is done to lines, the tests do
to the board's in its own time (tests/boards/test_spoilt_line.py).
"""

from __future__ import annotations

import contextlib
import json
import signal
import sys
from collections.abc import Callable
from types import SimpleNamespace

from sma_actuator.bench import VirtualBench
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.plant.loads import Weight

from .hours import CONFIG
from .nodes import KilledNodes, Node
from .stand import wait_until

sys.path.insert(0, str(CONFIG.parent / "boards" / "rp2040" / "simulated"))

from run import MICROPYTHON, SimulatedBoard  # isort: skip

NAME = "attacked"
#: Of the processor's watchdog, and of what a pulse and the firmware's turn add to that of the line.
FIRMWARE_s, PULSE_s = 0.5, 0.005
#: The wait of the firmware, what the world may lag, and a look of the judge.
MEASURING_s = 0.3
#: What an attack ends or stops, and how.
ENDS = (
    ("node", signal.SIGKILL),
    ("node", signal.SIGTERM),
    ("node", signal.SIGSTOP),
    ("firmware", signal.SIGKILL),
    ("firmware", signal.SIGSTOP),
    ("line", None),
)


class KillingBoards(KilledNodes):
    """A board and a node for each end, one after the other."""

    ATTACK = "boards"

    def kill(self, number: int) -> None:
        """Drive the wire, end something, see the current go."""
        with SimulatedBoard(VirtualBench.from_name("flexinol", load=Weight(0.49)), MICROPYTHON.exists()) as board:
            parameters = read_parameter_file(CONFIG / "board.yaml")
            for role in ("supply", "daq"):  # for a machine that is busy with other things
                parameters["instruments"][role] |= {"resource": board.resource, "timeout": 1.0}
            parameters["safety"]["reading_timeout"] = 3.0
            file = self.folder / f"parameters{number}.yaml"
            file.write_text(json.dumps({NAME: {"ros__parameters": parameters}}))
            node = Node(self.nursery, file, self.folder / f"node{number}.log", NAME)
            try:
                if words := self._drive(board, node):
                    self.broken("a node does not come to drive the wire", f"{words}; {node.last_words()}")
                else:
                    self._attack(board, node, Config.from_mapping(parameters).supply.watchdog_timeout + PULSE_s)
            finally:
                node.end()

    def _drive(self, board: SimulatedBoard, node: Node) -> str:
        shown = SimpleNamespace(now=_Flows(board))
        return self.client.drive(NAME, shown, lambda: node.ended is None, 40.0)

    def _attack(self, board: SimulatedBoard, node: Node, line_s: float) -> None:
        self.client.spin_until(lambda: False, self._chance.uniform(0.0, 1.5))
        what, number = self._chance.choice(ENDS)
        words = f"{what} {number.name}" if number else f"{what} cut"
        self.result.counts["ends"] += 1
        self.result.counts[words] += 1
        before = board.firmware
        begun_s = board.world.time_s
        if what == "node":
            node.send(number)
        elif what == "firmware":
            before.send_signal(number)
        else:
            board.cut_line()
        _soon(lambda: not board.world.heats)
        took_s = (board.world.time_s if board.world.heats else board.world.off_since_s) - begun_s
        if not took_s <= (FIRMWARE_s if what == "firmware" else line_s) + MEASURING_s:
            self.broken(f"pulses go on: {words}", f"for {took_s:.2f} s of the board's time")
        else:
            self.result.see(f"last pulse after {words} [s]", took_s)
        if what == "firmware":
            _soon(lambda: board.firmware is not before)
            if words_of_node := self._drive(board, node):
                self.broken(f"a node does not come back after {words}", f"{words_of_node}; {node.last_words()}")


class _Flows:
    """What flows, as a client asks a stand."""

    def __init__(self, board: SimulatedBoard):
        self._board = board

    @property
    def current_A(self) -> float:
        return 1.0 if self._board.world.heats else 0.0


def _soon(condition: Callable[[], bool]) -> None:
    """Wait for it, not for ever."""
    with contextlib.suppress(TimeoutError):
        wait_until(condition, 10.0)


attack = KillingBoards.attack
