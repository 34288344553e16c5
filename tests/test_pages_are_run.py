"""Every command of docs/new_wire.md is run as its reader would run it, in the order of the page, on the virtual bench.

What a reader has of their own (a bench, logs, a table) stands in ``OURS``, less of it than a real wire wants.
"""

import functools
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from test_commands_of_the_pages import BLOCK

from sma_actuator.logs.bench_log import read_bench_log

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "new_wire.md"
LONGEST_s = 3600.0  #: of a command on a busy machine
STARTED_s = 300.0
COMMAND = re.compile(r"\s*(sma-actuator|sma_actuator_node) (.+)")
#: What a reader puts in place of a text, by regular expression.
OURS = {
    r"^(characterise (?!.*--skip fatigue).*)$": r"\1 --loads 0.5,1,2 --training-cycles 2 --fatigue-cycles 2 --average 2",
    r"^(characterise (?!.*--virtual).*)$": r"\1 --virtual flexinol",
    r"LOG…": "lab/*.csv",
}
#: To the questions of ``init``, one after the other: the bench of the virtual wire.
ANSWERS = (
    "ni-ti\n100mm\n0.006in\n1ohm\nTCPIP::127.0.0.1::5025::SOCKET\nvirtual_bench_supply\n\n"
    "TCPIP::127.0.0.1::5026::SOCKET\nvirtual_bench_daq\n\n\n\n\n104\n\n\n"
)


@pytest.mark.long
@pytest.mark.timeout(4 * LONGEST_s)
def test_every_command_of_the_page_of_a_new_wire_does_what_it_says(tmp_path):
    (tmp_path / "config").mkdir()
    for path in (ROOT / "config").iterdir():
        text = with_our_ports(path.read_text()).encode() if path.suffix == ".yaml" else path.read_bytes()
        (tmp_path / "config" / path.name).write_bytes(text)
    write_table(tmp_path)
    reader = Reader(tmp_path)
    try:
        for program, text in commands_of_the_page():
            code, said = reader.run(program, text)
            # 3 is a model that is written, and not called good.
            assert code in ((0, 3) if text.startswith("identify") else (0,)), (
                f"{text}: ended with {code}\n{said[-3000:]}"
            )
            assert "Traceback" not in said, said[-3000:]
            if not (tmp_path / "lab").exists():
                write_lab(tmp_path)
    finally:
        reader.close()


def commands_of_the_page():
    """In order: (program, its words as they stand there)."""
    for block in BLOCK.finditer(PAGE.read_text(encoding="utf-8")):
        lines = re.sub(r"\\[ \t]*(#.*)?\n\s*", " ", block[0])
        for line in lines.splitlines():
            if found := COMMAND.match(line):
                yield found[1], shlex.join(shlex.split(found[2], comments=True)).replace("'", "")


class Reader:
    """Somebody at a terminal in a folder of their own."""

    def __init__(self, folder):
        self.folder, self.nodes = folder, []
        self.environment = {
            **os.environ,
            "ROS_LOG_DIR": str(folder / "ros"),
            "ROS_DOMAIN_ID": str(120 + os.getpid() % 80),
            "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        }

    def words(self, program, text):
        for pattern, ours in OURS.items():
            text = re.sub(pattern, ours, text)
        words = [sys.executable, "-m", "sma_actuator" if program == "sma-actuator" else "sma_actuator.ros.node"]
        for word in shlex.split(text):
            found = sorted(self.folder.glob(word)) if "*" in word else []
            words += [str(path.relative_to(self.folder)) for path in found] or [word]
        return words

    def run(self, program, text):
        """Its code and what it said; a node goes on until the page is done."""
        words = self.words(program, text)
        if program == "sma_actuator_node":
            return self._node(words)
        done = subprocess.run(
            words,
            cwd=self.folder,
            env=self.environment,
            input=with_our_ports(ANSWERS) if text.startswith("init") else "",
            capture_output=True,
            text=True,
            timeout=LONGEST_s,
            check=False,
        )
        return done.returncode, done.stdout + done.stderr

    def _node(self, words):
        said = self.folder / f"node_{len(self.nodes)}.txt"
        with said.open("wb") as stream:
            node = subprocess.Popen(words, cwd=self.folder, env=self.environment, stdout=stream, stderr=stream)
        self.nodes.append(node)
        until_s = time.monotonic() + STARTED_s
        while not said.stat().st_size and node.poll() is None and time.monotonic() < until_s:
            time.sleep(0.1)
        return node.poll() or 0, said.read_text()

    def close(self):
        for node in self.nodes:
            node.send_signal(signal.SIGINT)
            try:
                node.wait(60.0)
            except subprocess.TimeoutExpired:
                node.kill()


@functools.cache
def our_port(_theirs):
    """A free one in place of one of the pages and parameter files."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return str(probe.getsockname()[1])


def with_our_ports(text):
    return re.sub(r"\b502[56]\b", lambda port: our_port(port[0]), text)


def write_lab(folder):
    """A log of the same wire as others write it: milliseconds, millimetres of contraction; CSV and Excel."""
    import openpyxl

    (folder / "lab").mkdir()
    log = read_bench_log(min((folder / "out" / "spool").glob("pulses_*.csv")), allow_gaps=True)
    current_A = log["reference_voltage_V"] / 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        resistance_Ohm = (log["supply_voltage_V"] - log["reference_voltage_V"]) / current_A - 0.25
    displacement_m = 0.315842 * log["lvdt_current_A"] - 0.0012195
    good = np.isfinite(resistance_Ohm) & (current_A > 0.01)
    rows = np.column_stack((log["time_s"], resistance_Ohm, current_A, displacement_m))[good]
    text = "time_s,resistance_Ohm,current_A,load_N,displacement_m\n"
    text += "".join(f"{t:.3f},{r:.5f},{i:.5f},0.98,{d:.7f}\n" for t, r, i, d in rows)
    (folder / "lab" / "pulses.csv").write_text(text)
    book = openpyxl.Workbook()
    book.active.append(["t", "R", "I", "Pos"])
    for t, r, i, d in rows:
        book.active.append([1e3 * t, r, i, -1e3 * d])
    book.save(folder / "lab" / "pulses.xlsx")


def write_table(folder):
    """A loop of steady points, up in current and down again."""
    up_A = np.linspace(0.0, 0.8, 25)
    lines = ["branch,current_A,voltage_V,contraction_mm"]
    for branch, current_A, half_A in (("heating", up_A, 0.54), ("cooling", up_A[::-1], 0.36)):
        share = 1.0 / (1.0 + np.exp(-(current_A**2 - half_A**2) / 0.02))
        resistance_Ohm = 3.5 - (0.7 if branch == "heating" else 0.6) * share - 0.1 * (branch == "cooling")
        lines += [
            f"{branch},{i:.4f},{i * r:.5f},{17.0 * s:.3f}"
            for i, r, s in zip(current_A, resistance_Ohm, share, strict=True)
        ]
    (folder / "table.csv").write_text("\n".join(lines) + "\n")
