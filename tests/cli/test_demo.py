"""The main job as a user runs it: three processes, a picture, errors at the end, and the output off."""

import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
WAIT_s = 150.0

#: The demonstration, under a library that swallows an exception raised inside its waits, as rclpy's has been seen to.
_SWALLOWING = """
import sys
from rclpy.executors import SingleThreadedExecutor
spin_once = SingleThreadedExecutor.spin_once
def swallowing(self, timeout_sec=None):
    try:
        spin_once(self, timeout_sec)
    except KeyboardInterrupt:
        pass
SingleThreadedExecutor.spin_once = swallowing
from sma_actuator.cli.main import main
sys.exit(main())
"""


class Demo:
    """``sma-actuator demo``; its output goes to a file."""

    def __init__(self, log, program, arguments, environment):
        self._log = log
        with log.open("wb") as stream:
            self.process = subprocess.Popen(
                [sys.executable, *program, "demo", *arguments],
                stdout=stream,
                stderr=stream,
                env={**os.environ, **environment},
            )

    @property
    def words(self):
        return self._log.read_text(errors="replace")

    def wait_for(self, condition):
        deadline_s = time.monotonic() + WAIT_s
        while not (value := condition()):
            assert time.monotonic() < deadline_s, self.words
            assert self.process.poll() is None, self.words
            time.sleep(0.02)
        return value


@pytest.fixture
def demo(tmp_path):
    """Starts a :class:`Demo`; kills what is left of it."""
    demos = []

    def start(*arguments, program=("-m", "sma_actuator"), **environment):
        demos.append(Demo(tmp_path / "demo.log", program, arguments, environment))
        return demos[-1]

    yield start
    for started in demos:
        left = children(started.process.pid)
        started.process.kill()
        started.process.wait()
        for pid in left:  # they have sessions of their own, and outlive it
            if alive(pid):
                os.kill(pid, signal.SIGKILL)


def children(pid):
    """Processes that ``pid`` has started."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            found.append(int(stat.parent.name))
    return found


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.long  # .ci/run has it end by itself before it runs the tests
@pytest.mark.parametrize("wire", ("flexinol", "furukawa"))
def test_it_ends_by_itself_with_the_three_errors_and_the_output_off(demo, tmp_path, wire):
    page = ["--view"] if wire == "flexinol" and importlib.util.find_spec("aiohttp") else []
    started = demo("--wire", wire, "--duration", "6", "--json", str(tmp_path / "errors.json"), *page)
    code = started.process.wait(WAIT_s)
    output = started.words
    assert code == 0, output
    assert "supply output off; node and bench have ended" in output
    assert ("open http://127.0.0.1:" in output) == bool(page)
    for word in ("setpoint", "estimate", "true displacement (LVDT)", "load", "current", "status"):
        assert word in output
    errors = json.loads((tmp_path / "errors.json").read_text())
    assert errors["samples"] > 10  # on a busy machine too
    assert errors["judged_share"] == 1.0
    # Six seconds are mostly the first contraction; what matters here is that the estimate follows the wire.
    assert errors["model_error_pct_stroke"] < 5.0


@pytest.mark.parametrize(
    "program",
    [("-m", "sma_actuator"), pytest.param(("-c", _SWALLOWING), marks=pytest.mark.long)],
    ids=["as it is", "swallowed"],
)
def test_ctrl_c_leaves_nothing_running_and_the_output_off(demo, program):
    started = demo("--duration", "0", program=program)
    running = started.wait_for(lambda: len(pids := children(started.process.pid)) == 2 and pids)  # bench and node
    started.wait_for(lambda: "estimate" in started.words)
    if "-m" in program:  # what a node that stands still told last is not shown as what is so
        (node,) = [pid for pid in running if b"sma_actuator.ros.node" in Path(f"/proc/{pid}/cmdline").read_bytes()]
        os.kill(node, signal.SIGSTOP)
        started.wait_for(lambda: "status nothing has come from the node for" in started.words)
        os.kill(node, signal.SIGCONT)
    started.process.send_signal(signal.SIGINT)
    assert started.process.wait(WAIT_s) == 0, started.words
    assert "supply output off; node and bench have ended (Ctrl-C)" in started.words
    assert not [pid for pid in running if alive(pid)]


def test_killed_it_leaves_nothing_running(demo):
    started = demo("--duration", "0")
    running = started.wait_for(lambda: len(pids := children(started.process.pid)) == 2 and pids)
    started.process.kill()
    deadline_s = time.monotonic() + WAIT_s
    while any(map(alive, running)):
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def test_ended_before_anything_is_driven_it_takes_all_along(demo):
    started = demo("--duration", "0")
    running = started.wait_for(lambda: children(started.process.pid))
    started.process.send_signal(signal.SIGINT)
    assert started.process.wait(WAIT_s) in (0, 130), started.words
    assert "Traceback" not in started.words
    assert not [pid for pid in running if alive(pid)]


@pytest.mark.long
def test_the_first_command_on_a_machine_compiles_and_says_so_before_anything_answers(demo, tmp_path):
    pytest.importorskip("numba")
    started = demo("--duration", "6", NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert started.process.wait(600.0) == 0, started.words
    assert f"virtual bench: compiling kernels, once on this machine; kept in {tmp_path}/cache" in started.words
    assert f"node: compiling kernels, once on this machine; kept in {tmp_path}/cache" in started.words
    assert "supply output off; node and bench have ended" in started.words


@pytest.mark.long
def test_beside_a_program_that_keeps_every_core_busy_it_drives_and_ends_with_the_output_off(demo):
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 2)]
    try:
        started = demo("--duration", "10")
        assert started.process.wait(600.0) == 0, started.words
    finally:
        for each in busy:
            each.kill()
            each.wait()
    assert "supply output off; node and bench have ended" in started.words
    assert re.search(r"status (tracking|holding)", started.words)


def test_one_that_fails_says_what_to_do_and_keeps_what_was_said(demo):
    started = demo("--duration", "0")
    started.wait_for(lambda: "estimate" in started.words)
    (bench,) = [
        pid
        for pid in children(started.process.pid)
        if b"bench" in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    ]
    os.kill(bench, signal.SIGKILL)
    assert started.process.wait(WAIT_s) == 1, started.words
    why, advice = [line for line in started.words.splitlines() if line][-2:]
    assert why.startswith("sma-actuator demo: the virtual bench ended with code -9")
    before, after = "Run it once more; if it fails so again, the logs in ", " say what came before"
    folder = Path(advice.removeprefix(before).removesuffix(after))
    assert "the output is on" in (folder / "node.log").read_text()
    shutil.rmtree(folder)


@pytest.mark.parametrize(("lag_s", "first_s"), [(5.0, 6.0), (13.0, 15.6)])
def test_it_asks_for_what_the_wire_reaches_and_no_sooner_than_it_can(lag_s, first_s):
    from sma_actuator.cli.demo import _program

    asked_m = _program((0.003, 0.050), lag_s, 60.0)
    asked = [asked_m(0.1 * tenth) for tenth in range(600)]
    assert min(asked) >= 0.003 and max(asked) <= 0.050
    assert asked_m(first_s - 0.01) == asked_m(0.0) != asked_m(first_s + 0.01)
