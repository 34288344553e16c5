"""The board in this process and in its own time: the firmware as it is, by this Python, with simulated parts and a
wire."""

import contextlib
import os
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "boards" / "rp2040" / "simulated"))

import firmware
from world import Reset, World

from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.bench import VirtualBench
from sma_actuator.config import Config
from sma_actuator.instruments import open_instruments
from sma_actuator.plant.loads import Weight

CONFIG = Path(__file__).resolve().parents[2] / "config" / "board.yaml"


class VirtualBoard:
    """``ask`` and ``tell`` are the other end of its line, ``run`` lets its time pass.  It is a clock, too."""

    def __init__(self, load_N=0.98):
        self.bench = VirtualBench.from_name("flexinol", load=Weight(load_N))
        self.said = bytearray()
        self.world = World(self.bench, send=self.said.extend)
        self.program = self.start()
        self.stands_still = self.is_unplugged = False
        self.on_its_way = lambda data, direction: data  #: what becomes of lines to it (questions) and from it (answers)

    def start(self):
        """The program from its beginning."""
        return firmware.load(self.world.call).Program()

    @property
    def board(self):
        return self.program.board

    def now_s(self):
        return self.world.time_s

    def sleep_until_s(self, deadline_s):
        while self.world.time_s < deadline_s:
            self._turn()

    def _turn(self):
        if self.stands_still or self.world.was_reset:
            self.world.pass_by(1e-3)
        else:
            with contextlib.suppress(Reset):
                self.program.turn()

    def run(self, seconds):
        self.sleep_until_s(self.now_s() + seconds)

    def tell(self, line):
        self.world.hear(line.encode() + b"\n")
        self.run(0.006)
        assert not self.said

    def ask(self, line):
        self.world.hear(line.encode() + b"\n")
        self.run(0.006)
        answer = self.said.decode()
        self.said.clear()
        assert answer.endswith("\n")
        return answer[:-1]

    def drive(self, current_A):
        """A current, for the time that a pulse or two take."""
        self.tell(f"VOLT 3;VOLT:PROT 3.3;CURR:PROT 0.5;OUTP:PROT:WDOG:DEL 10;CURR {current_A};OUTP ON")
        self.run(0.3)

    def mapping(self):
        """The parameters of the board, for a port that no other test of this machine claims."""
        mapping = read_parameter_file(CONFIG)
        for role in ("supply", "daq"):
            mapping["instruments"][role]["resource"] = f"ASRL/dev/board_of_{os.getpid()}_{id(self)}::INSTR"
        return mapping

    def instruments(self, monkeypatch, **of_daq):
        """Configuration, supply and DAQ, whose line ends here instead of at a port."""
        from sma_actuator.instruments.session import Session

        monkeypatch.setattr(Session, "_connect", lambda *_: VirtualLine(self))
        mapping = self.mapping()
        mapping["instruments"]["daq"] |= of_daq
        self.config = Config.from_mapping(mapping)
        return self.config, *open_instruments(self.config, self)


class VirtualLine:
    """Bytes to and from the board."""

    resumes = True

    def __init__(self, board):
        if board.is_unplugged:
            raise OSError("unplugged")
        self._board = board
        board.said.clear()

    def send(self, data, deadline_s):
        if self._board.is_unplugged:
            raise OSError("unplugged")
        for line in data.splitlines(keepends=True):
            self._board.world.hear(self._board.on_its_way(line, "questions"))

    def receive(self, deadline_s):
        until_s = self._board.now_s() + deadline_s - time.monotonic()
        while self._board.now_s() < until_s:
            if self._board.said:
                lines = bytes(self._board.said).splitlines(keepends=True)
                self._board.said.clear()
                if data := b"".join(self._board.on_its_way(line, "answers") for line in lines):
                    return data
            if self._board.is_unplugged:
                raise OSError("unplugged")
            self._board.run(0.002)
        time.sleep(max(deadline_s - time.monotonic(), 0.0))
        raise TimeoutError

    def unread(self):
        return b""

    def cut(self):
        pass

    def close(self):
        pass
