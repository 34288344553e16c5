"""Kills at random instants: SIGKILL, SIGTERM, SIGINT, SIGSTOP with SIGCONT later, on the real node."""

from __future__ import annotations

import csv
import hashlib
import itertools
import json
import math
import signal
from pathlib import Path

from sma_actuator.config import Config, read_parameter_file

from .hours import CONFIG, OFF_AT_MOST_s
from .nodes import KilledNodes, Node
from .promises import Promises
from .stand import Stand, wait_until

#: What the bench's tick, its answers and the judge's look add to a time.
MEASURING_s = 0.06
NAME = "attacked"
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGSTOP)
#: The recorder's rows may be this old when the process dies without a word: they were in a buffer.
ROWS_LOST_s = 0.25


class Killing(KilledNodes):
    """One bench, and nodes on it that are killed one after the other."""

    ATTACK = "kills"

    def __init__(self, seed: int):
        super().__init__(seed)
        self.logs = self.folder / "logs"
        self.logs.mkdir()
        self.foreign = self._foreign_files()
        self.stand = Stand("--seed", str(seed))
        parameters = read_parameter_file(CONFIG / "flexinol.yaml")
        parameters["instruments"]["supply"]["resource"] = f"TCPIP::127.0.0.1::{self.stand.supply_port}::SOCKET"
        parameters["instruments"]["daq"]["resource"] = f"TCPIP::127.0.0.1::{self.stand.daq_port}::SOCKET"
        parameters["recorder"] = {"folder": str(self.logs), "max_files": 4, "max_file_size": 20_000}
        self.loop_period_s = 1.0 / parameters.get("loop", {}).get("rate", 20.0)
        self.parameters = self.folder / "parameters.yaml"
        self.parameters.write_text(json.dumps({NAME: {"ros__parameters": parameters}}))
        self.promised_s = min(
            Promises(Config.from_mapping(parameters).to_mapping()).within_s("node_lost"), OFF_AT_MOST_s
        )

    def _close_stand(self) -> None:
        """No file of somebody else may have changed."""
        self.stand.close()
        if self._foreign_now() != self.foreign:
            self.broken("a file of somebody else was touched", str(set(self.foreign) - set(self._foreign_now())))

    def kill(self, number: int) -> None:
        """Start a node, drive the wire, send it a signal, see the current go."""
        node = Node(self.nursery, self.parameters, self.folder / f"node{number}.log", NAME)
        try:
            words = self.client.drive(NAME, self.stand, lambda: node.ended is None)
            if words:
                self.broken("a node does not come to drive the wire", f"{words}; {node.last_words()}")
                return
            self._attack(node)
        finally:
            node.end()

    def _attack(self, node: Node) -> None:
        self.client.spin_until(lambda: False, self._chance.uniform(0.0, 1.5))
        which = self._chance.choice(SIGNALS)
        self.result.counts["kills"] += 1
        self.result.counts[which.name] += 1
        sent_s = node.send(which)
        took_s = self.stand.off_within_s(sent_s, 4.0)
        if not took_s <= self.promised_s + MEASURING_s:
            took = "not within 4 s" if math.isnan(took_s) else f"after {took_s:.2f} s"
            self.broken(f"the current is not off in time after {which.name}", took)
        else:
            self.result.see(f"off after {which.name} [s]", took_s)
        if which == signal.SIGSTOP:
            self._go_on(node)
            return
        try:
            wait_until(lambda: node.ended is not None, 10.0)
        except TimeoutError:
            self.broken(f"the node does not end after {which.name}", node.last_words())
            return
        unconfirmed = "not confirmed; look at the supply" in node.last_words()
        wanted = -signal.SIGKILL if which == signal.SIGKILL else int(unconfirmed)
        if node.ended != wanted:
            self.broken(f"exit code after {which.name}", f"{node.ended}, {wanted} is right; {node.last_words()}")
        self._look_at_rows(which, sent_s)

    def _go_on(self, node: Node) -> None:
        """Continued after the watchdog has cut: it stays off until somebody asks for current again."""
        self.client.spin_until(lambda: False, self._chance.uniform(0.0, 1.0))
        node.send(signal.SIGCONT)
        self.client.spin_until(lambda: self.stand.now.current_A > 0.0, 1.0)
        if self.stand.now.current_A > 0.0:
            self.broken("the current comes back by itself after SIGCONT", f"{self.stand.now.current_A:.3f} A")
        words = self.client.drive(NAME, self.stand, lambda: node.ended is None)
        if words:
            self.broken("a node does not come back after SIGCONT", f"{words}; {node.last_words()}")

    def _look_at_rows(self, which: signal.Signals, sent_s: float) -> None:
        """The log has every row until the end, in order, none of them half."""
        files = [path for path in self.logs.glob(f"{NAME}_*.csv*") if path not in self.foreign]
        newest = max(files, key=lambda path: path.stat().st_mtime_ns, default=None)
        if newest is None:
            self.broken("no row of the log is left", which.name)
            return
        with newest.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
        if newest.suffix != ".csv" and rows and None in rows[-1].values():
            rows.pop()  # the half line of a process that was killed
        times_s = [float(row["time_s"]) for row in rows]
        self.result.counts["rows"] += len(rows)
        gaps_s = [b - a for a, b in itertools.pairwise(times_s)]
        if any(gap_s <= 0.0 for gap_s in gaps_s):
            self.broken("rows of the log are out of order", newest.name)
        if times_s and sent_s - times_s[-1] > ROWS_LOST_s + self.stand.longest_stall_s + self.loop_period_s:
            self.broken("rows of the log are lost", f"{which.name}, the last is {sent_s - times_s[-1]:.2f} s older")

    def _foreign_files(self) -> dict[Path, str]:
        """Files a recorder must leave alone, though their names look like its own."""
        names = (
            f"{NAME}_calibration.csv",
            f"{NAME}_left_20200101_000000_1_0001.csv",
            f"{NAME}_notes.csv.part",
            "wire.csv",
        )
        target = self.folder / "precious.csv"
        target.write_text("time_s,precious\n" + "1,2\n" * 50 + "3,")
        for name in names:
            (self.logs / name).write_text("time_s,mine\n1,2\n3,")
        (self.logs / f"{NAME}_link.csv.part").symlink_to(target)
        return self._foreign_now([*(self.logs / name for name in names), self.logs / f"{NAME}_link.csv.part", target])

    def _foreign_now(self, paths: list[Path] | None = None) -> dict[Path, str]:
        paths = list(self.foreign) if paths is None else paths
        return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths if path.exists()}


attack = Killing.attack
