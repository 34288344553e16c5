"""Every command of the pages is run as its reader would run it, in the order of the page, on the virtual bench.

What a reader has of their own (a bench, logs, a table) stands in ``OURS``, less of it than a real wire wants; what
other tests run in ``ELSEWHERE`` and ``NOT_HERE``.  What the commands said stands in ``said.txt`` in the folder of the
test.
"""

import functools
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from steady_points import write_table
from test_commands_of_the_pages import BLOCK, PAGES
from waiting import AS_ARGUMENTS

from sma_actuator.logs.bench_log import read_bench_log

ROOT = Path(__file__).parents[1]
LONGEST_s = 3600.0  #: of a command on a busy machine
STARTED_s = 300.0
COMMAND = re.compile(r"\s*(?:\$ )?(sma-actuator|sma_actuator_node|python(?= boards/)) (.+)")
MODULES = {"sma-actuator": ("-m", "sma_actuator"), "sma_actuator_node": ("-m", "sma_actuator.ros.node"), "python": ()}
LESS = " --loads 0.5,1,2 --training-cycles 2 --fatigue-cycles 2 --average 2"
#: What a reader puts in place of a text, by regular expression.
OURS = {
    r"(characterise (?!.*--skip fatigue).*)$": r"\1" + LESS,
    r"^(characterise (?!.*--virtual).*)$": r"\1 --virtual flexinol",
    r"LOG\.csv …|session_1\.csv session_2\.csv|session_\*\.csv": "out/later/pulses_*.csv",
    r"LOG…": "lab/*.csv",
    r"my_logs/(?!\*)": "lab",
    r"my_logs/\*\.xlsx": "lab/*.xlsx",
    r"resistance_Ohm=R --map current_A=I --map load_N=F": "time_s=t --unit time_s=ms --map resistance_Ohm=R --map "
    "current_A=I --map load_N=0.98 "
    "--map displacement_m=Pos",
    r"^(.*--params-file.*)$": rf"\1{AS_ARGUMENTS}",
    r"^boards/": f"{ROOT}/boards/",
    r"trained_": str(ROOT.parent / "shared" / "data" / "flexinol_381um" / "trained_"),
    r"^(enable|stop|status|watch.*|call .*)$": r"\1 --patience 300",
    r"^(move .*)$": r"\1 --patience 300 --within 120",
}
ELSEWHERE = {
    "a_strangers_log": "tests/test_tutorial.py runs it",
    "fleet": "tests/fleet drives its commands against a store and a cluster of its own",
    "pair": "tests/ros/test_joint_node.py turns its joint",
}
#: Commands that take four minutes in real time: the same with --virtual is run, and by a node in
#: tests/ros/test_tune.py.
NOT_HERE = ("tune --config my_wire.yaml --running", "tune --config my_wire.yaml")
#: The page of the first real wire is gone through in a physics that no model here was made in.
PHYSICS = {"first_wire": "foreign"}
RUNNING = {  #: what a page takes for running already
    "first_wire": [("sma-actuator", "bench --supply-port 5025 --daq-port 5026 --physics foreign")],
    "robot": [
        ("sma-actuator", "bench --supply-port 5025 --daq-port 5026"),
        ("sma_actuator_node", "--ros-args --params-file config/flexinol.yaml"),
    ],
}
ENDLESS = ("bench", "view", "watch", "boards/rp2040/simulated/run.py")  #: ended here, once they have said something
#: Commands, by how they begin → codes they may end with, and what they say then: a verdict is no failure.
VERDICTS = {
    "check-log": ((0, 1), "These logs are "),
    "check": ((0,), "watchdog"),
    "identify": ((0, 3), "verdict: "),
}


def commands_of(page):
    """Of a page, in order: (program, its words as they stand there)."""
    for block in BLOCK.finditer(page.read_text(encoding="utf-8")):
        lines = re.sub(r"\\[ \t]*(#.*)?\n\s*", " ", block[0])
        for line in lines.splitlines():
            if found := COMMAND.match(line):
                words = shlex.split(found[2].rstrip(" &"), comments=True)
                if words and not words[0].startswith("COMMAND"):
                    yield found[1], " ".join(words)


class Reader:
    """Somebody at a terminal in a folder of their own."""

    def __init__(self, folder, physics="measured"):
        self.folder, self.physics, self.running = folder, physics, []
        self.environment = {
            **os.environ,
            "ROS_LOG_DIR": str(folder / "ros"),
            "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
            "COLUMNS": "160",
            "ROS_DOMAIN_ID": str(1 + os.getpid() % 19),  # beyond 101 the ports may be somebody's already
        }

    def words(self, program, text):
        for pattern, ours in OURS.items():
            text = re.sub(pattern, ours, text)
        text = with_our_ports(text)
        if "--virtual" in text and self.physics != "measured":
            text += f" --physics {self.physics}"
        words = [sys.executable, *MODULES[program]]
        for word in shlex.split(text):
            found = sorted(self.folder.glob(word)) if "*" in word and not word.startswith("/") else []
            words += [str(path.relative_to(self.folder)) for path in found] or [word]
        return words

    def run(self, program, text):
        """Its code and what it said; a command without an end goes on beside the next ones."""
        words = self.words(program, text)
        if program == "sma_actuator_node" or (text.split()[0] in ENDLESS and "--duration" not in text):
            return self._beside(words)
        done = subprocess.run(
            words,
            cwd=self.folder,
            env=self.environment,
            input=with_our_ports(ANSWERS) if text.startswith("init") else "\n" * 200,
            capture_output=True,
            text=True,
            timeout=LONGEST_s,
            check=False,
        )
        with (self.folder / "said.txt").open("a") as said:
            said.write(f"$ {shlex.join(words[1:])}\n{done.stdout}{done.stderr}ended with {done.returncode}\n")
        return done.returncode, done.stdout + done.stderr

    def _beside(self, words):
        said = self.folder / f"beside_{len(self.running)}.txt"
        with said.open("wb") as stream:
            process = subprocess.Popen(words, cwd=self.folder, env=self.environment, stdout=stream, stderr=stream)
        self.running.append(process)
        until_s = time.monotonic() + STARTED_s
        while not said.stat().st_size and process.poll() is None and time.monotonic() < until_s:
            time.sleep(0.1)
        return process.poll() or 0, said.read_text()

    def close(self):
        for process in reversed(self.running):
            process.send_signal(signal.SIGINT)
            try:
                process.wait(60.0)
            except subprocess.TimeoutExpired:
                process.kill()


#: To the questions of ``init``, where a reader answers them one after the other: the bench of the virtual wire.
ANSWERS = "\n".join(
    (
        "ni-ti",
        "",  # a straight wire
        "100mm",
        "0.006in",
        "1ohm",
        "TCPIP::127.0.0.1::5025::SOCKET",
        "virtual_bench_supply",
        "",
        "TCPIP::127.0.0.1::5026::SOCKET",
        "virtual_bench_daq",
        "",
        "",
        "",
        "",
        "104",
        "",
        "",
    )
)


@functools.cache
def our_port(_theirs):
    """A free one in place of one of the pages and parameter files."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return str(probe.getsockname()[1])


def with_our_ports(text):
    return re.sub(r"\b502[56]\b", lambda port: our_port(port[0]), text)


def write_lab(folder, spool):
    """Logs of the same wire as others write them: milliseconds, millimetres of contraction; CSV and Excel."""
    import openpyxl

    (folder / "lab").mkdir()
    log = read_bench_log(next(iter(sorted(spool.glob("pulses_*.csv")))), allow_gaps=True)
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


@pytest.fixture(scope="module")
def spool(tmp_path_factory):
    """What the first commands of README leave behind, and a later session: other pages begin with it."""
    reader = Reader(tmp_path_factory.mktemp("spool"))
    shutil.copytree(ROOT / "config", reader.folder / "config")
    for path in (reader.folder / "config").glob("*.yaml"):
        path.write_text(with_our_ports(path.read_text()))
    pages = {page.stem: page for page in PAGES}
    first = [text for _, text in commands_of(pages["README"]) if text.split()[0] in ("characterise", "identify")]
    later = [text for _, text in commands_of(pages["new_wire"]) if "out/later" in text and text.startswith("char")]
    for text in (*first, *later):
        code, said = reader.run("sma-actuator", text)
        assert code in (0, 3), said
    write_lab(reader.folder, reader.folder / "out" / "spool")
    write_table(reader.folder / "table.csv")
    return reader.folder


@pytest.mark.long
@pytest.mark.timeout(3 * LONGEST_s)
@pytest.mark.parametrize("page", [p for p in PAGES if p.stem not in ELSEWHERE], ids=lambda page: page.stem)
def test_every_command_of_a_page_does_what_the_page_says(page, spool, tmp_path):
    if not (listed := list(commands_of(page))):
        pytest.skip("no command on it")
    shutil.copytree(spool, tmp_path, dirs_exist_ok=True)
    for made in re.findall(r"--out (out/\S+|my_wire)", " ".join(text for _, text in listed)):
        for path in tmp_path.glob(f"{made}*"):  # what this page makes itself
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    reader = Reader(tmp_path, PHYSICS.get(page.stem, "measured"))
    try:
        for program, text in RUNNING.get(page.stem, ()):
            code, said = reader.run(program, text)
            assert code == 0, said
        for program, text in listed:
            if text in NOT_HERE:
                continue
            codes, words = VERDICTS.get(text.split()[0], ((0,), ""))
            for _ in range(20 if text == "enable" else 1):  # a node that has just started has no reading yet
                code, said = reader.run(program, text)
                if code in codes:
                    break
            assert code in codes and words in said, f"{page.stem}: {text}: ended with {code}\n{said[-3000:]}"
            assert "Traceback" not in said, said[-3000:]
    finally:
        reader.close()
