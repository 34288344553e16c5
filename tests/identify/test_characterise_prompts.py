"""Questions to the person at the bench: readable in a terminal and in a pipe, answered by either or by a file."""

import contextlib
import itertools
import os
import pty
import re
import select
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from characterised import bench_mapping
from waiting import PATIENT_NODE, PATIENT_TIMEOUT_s

from sma_actuator.base.signals import Reading
from sma_actuator.bench import VirtualBench
from sma_actuator.bench.server import background
from sma_actuator.characterise.operators import ScpiBenchOperator
from sma_actuator.characterise.watching import LoadWatch
from sma_actuator.cli.main import main
from sma_actuator.config import bench_from_mapping, read_parameter_file, write_parameter_file

GRAMS_N = 9.80665e-3
DEADLINE_s = 90.0


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The virtual bench behind its instruments, its bench file, and hands that hang what is asked for."""
    mapping = bench_mapping("flexinol")
    with background(VirtualBench.from_name("flexinol")) as server:
        for name in ("supply", "daq"):
            resource = f"TCPIP::127.0.0.1::{server.ports[0][name]}::SOCKET"
            mapping["instruments"][name] |= {"resource": resource, "timeout": PATIENT_TIMEOUT_s}
        mapping["safety"]["reading_timeout"] = PATIENT_NODE["safety.reading_timeout"]
        mapping["supply"]["watchdog_timeout"] = PATIENT_NODE["supply.watchdog_timeout"]
        path = tmp_path_factory.mktemp("bench") / "bench.yaml"
        path.write_text(yaml.safe_dump({"sma_actuator": {"ros__parameters": mapping}}))
        hands = ScpiBenchOperator(mapping["instruments"]["daq"]["resource"], 3.0, 0.004)
        yield path, hands
        hands._session.close()


def words(bench, out, *more):
    short = ["--loads", "0.6", "--pulses", "1", "--heat-time", "0.3", "--cool-time", "0.3", "--average", "0.2"]
    skipped = [word for kind in ("partial", "training", "fatigue", "lvdt", "levels") for word in ("--skip", kind)]
    program = [sys.executable, "-m", "sma_actuator", "characterise", "--config", str(bench[0]), "--out", str(out)]
    return [*program, *short, "--masses", "20,100,200", *skipped, *more]


class Person:
    """Reads what the command shows, does what it says, and presses Enter."""

    def __init__(self, command, terminal):
        if terminal:
            ours, theirs = pty.openpty()
            streams = dict.fromkeys(("stdin", "stdout", "stderr"), theirs)
            self.popen = subprocess.Popen(command, **streams, env={**os.environ, "TERM": "xterm", "COLUMNS": "200"})
            os.close(theirs)
            self._reads = self._writes = ours
        else:
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
            self.popen = subprocess.Popen(command, **pipes)
            self._reads, self._writes = self.popen.stderr.fileno(), self.popen.stdin.fileno()
        self.seen = ""
        self.end_s = time.monotonic() + DEADLINE_s

    def wait_for(self, pattern, start=0):
        """What stands from ``start`` on once the pattern is there; fails where the command ends or says nothing."""
        while not (found := re.search(pattern, self.seen[start:])):
            assert time.monotonic() < self.end_s, f"never said {pattern!r}:\n{self.seen[start:][-500:]}"
            if select.select([self._reads], [], [], 0.2)[0]:
                try:
                    more = os.read(self._reads, 65536)
                except OSError:  # a terminal whose other end is gone
                    more = b""
                assert more, f"ended before {pattern!r}:\n{self.seen[-500:]}"
                self.seen += more.decode(errors="replace")
        return found

    def press_enter(self):
        os.write(self._writes, b"\n")

    def ends(self):
        """Exit code, once everything has been read."""
        with contextlib.suppress(AssertionError):
            self.wait_for("this is never said")
        code = self.popen.wait(timeout=120)
        if self.popen.stdin is None:
            os.close(self._reads)
        else:
            self.popen.stdin.close()
            self.popen.stderr.close()
        return code


# A pipe is read by the tests below as well, whose input is closed.
@pytest.mark.parametrize("terminal", [True, pytest.param(False, marks=pytest.mark.long)], ids=["terminal", "pipe"])
def test_every_question_can_be_read_and_says_what_hangs_there(bench, tmp_path, terminal):
    person = Person(words(bench, tmp_path / "out"), terminal)
    hands = bench[1]
    at = 0
    for asked, done in (
        ("Replace the wire by a short", hands.short_wire),
        ("Fit the wire again", hands.fit_wire),
        *((f"Hang {m:.1f} g", lambda m=m: hands.hang_mass(m * GRAMS_N)) for m in (20, 100, 200)),
        ("Hang 61.2 g", lambda: None),  # but presses Enter: 200 g hang there still
        ("Hang 61.2 g", lambda: hands.hang_load(0.6)),
    ):
        at += person.wait_for(f"► {asked}[^\r\n]*press Enter", at).end()
        done()
        if asked.startswith("Hang"):
            person.wait_for(r"load cell: [-\d.]+ V, [-\d.]+ N[^\r\n]*: settled", at)
        shown = person.seen[at:]
        assert "━" not in shown and "\x1b[1A" not in shown, "no progress bar writes over a question that waits"
        person.press_enter()
    assert "0.600 N by its calibration" in person.seen[at:]
    assert len(re.findall(r"the load cell reads 1\.9\d+ N, not 0\.600 N: hang what is asked for", person.seen)) == 1
    assert person.ends() == 0
    assert (tmp_path / "out" / "pulses_0.600N.csv").exists()
    assert "Traceback" not in person.seen


def test_without_a_displacement_sensor_nobody_is_asked_anything(bench, tmp_path, run):
    mapping = read_parameter_file(bench[0])
    mapping["instruments"]["daq"]["lvdt_channel"] = 0
    write_parameter_file(path := tmp_path / "bench.yaml", mapping, "without a displacement sensor")
    refused = run(words((path, bench[1]), tmp_path / "out"))
    assert refused.returncode == 1 and "►" not in refused.stderr
    assert "instruments.daq.lvdt_channel: no displacement is measured" in refused.stderr
    left = [word for kind in ("pulses", "lead_resistance") for word in ("--skip", kind)]
    asked = run(words((path, bench[1]), tmp_path / "out", *left, "--skip", "check"))
    assert "► Hang 20.0 g" in asked.stderr, "of a load cell alone no displacement is wanted"


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        # What the test finds of a wiring: tests/check/test_selftest.py.
        pytest.param("channel_reversed,102", "the taps of the sense resistor are swapped", marks=pytest.mark.long),
        ("open_wire", "the circuit is open"),
    ],
    ids=["a tap that is swapped", "no wire"],
)
def test_nothing_is_heated_where_the_wiring_is_not_what_the_file_says(bench, tmp_path, run, fault, sentence):
    bench[1]._do(f"BENC:FAUL {fault}")
    try:
        refused = run(words(bench, tmp_path / "out"))
        regardless = run(words(bench, tmp_path / "out", "--skip", "check", "--skip", "lead_resistance"))
    finally:
        bench[1]._do("BENC:FAUL:CLE")
    assert refused.returncode == 1
    assert "nothing was heated" in refused.stderr and sentence in refused.stderr and "--skip check" in refused.stderr
    assert "►" not in refused.stderr, "nobody was asked to hang anything"
    assert not list((tmp_path / "out").rglob("*.csv"))
    assert "nothing was heated" not in regardless.stderr and "► Hang 20.0 g" in regardless.stderr


@pytest.fixture
def run(capsys, monkeypatch):
    """Runs the command in this process, with an input that is closed."""

    def run(command):
        with Path(os.devnull).open() as nobody, monkeypatch.context() as patch:
            patch.setattr(sys, "stdin", nobody)
            code = main(command[3:])  # after the interpreter and the module
        return SimpleNamespace(returncode=code, stderr=capsys.readouterr().err)

    return run


def test_a_file_may_answer_and_nobody_at_the_input_is_a_sentence(bench, tmp_path, run):
    bench[1].hang_load(0.6)
    answers = tmp_path / "answers.yaml"
    answers.write_text("hang_load: done\n")
    skipped = ("--skip", "lead_resistance", "--skip", "load_cell", "-q")
    answered = run(words(bench, tmp_path / "out", *skipped, "--answers", str(answers)))
    assert answered.returncode == 0, answered.stderr
    assert "► Hang 61.2 g" in answered.stderr and "done (given)" in answered.stderr
    assert re.search(r"0\.\d+ N of 0.600 N by its calibration: settled", answered.stderr)
    bench[1].hang_load(0.02)
    skipped += ("--skip", "check")  # it was seen above to come before
    missing = run(words(bench, tmp_path / "missing", *skipped, "--answers", str(answers)))
    assert missing.returncode == 1 and "Traceback" not in missing.stderr
    assert re.search(r"hang_load: the load cell reads [-0.]+\d+ N, not 0.600 N: hang what is asked for", missing.stderr)
    assert not list((tmp_path / "missing").glob("*.csv")) and bench[1]._truth(9) == 0.0, "no current flows"
    nobody = run(words(bench, tmp_path / "other", *skipped))
    assert nobody.returncode == 1 and "Traceback" not in nobody.stderr
    assert "'hang_load' was asked, and standard input is closed" in nobody.stderr
    assert not list((tmp_path / "other").glob("*.csv"))


@pytest.mark.parametrize(
    ("expected_N", "load_N", "scatter_N", "right"),
    [
        ((0.98, 0.98), 0.02, 0.0, False),
        ((0.98, 0.98), 0.90, 0.0, True),
        ((0.98, 0.98), 0.86, 0.0, False),
        ((0.98, 0.98), 1.10, 0.0, False),
        ((0.05, 0.05), 0.06, 0.02, True),
        ((0.4, 1.2), 1.1, 0.0, True),
        ((0.4, 1.2), 0.3, 0.0, False),
        ((0.4, 1.2), 1.4, 0.0, False),
    ],
)
def test_what_hangs_there_is_held_against_what_was_asked(expected_N, load_N, scatter_N, right):
    """By a tenth, or by what the cell scatters; of a spring from where the wire is longest to where it is shortest."""
    config = bench_from_mapping(bench_mapping("flexinol"))
    cell, signs = config.load_cell, itertools.cycle((-0.5, 0.5))

    def read_block():
        return Reading(0.0, 0.1, 0.1, (load_N + next(signs) * scatter_N - cell.offset) / cell.slope)

    watch = LoadWatch(SimpleNamespace(daq=SimpleNamespace(read_block=read_block), config=config), expected_N)
    assert not watch.wrong(), "nothing has been read yet"
    watch.look(), watch.look()
    assert (watch.wrong() == "") == right
