"""The main job as a user runs it: three processes, a picture, errors at the end, and the output off."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
WAIT_s = 60.0


@pytest.fixture
def demo(tmp_path):
    """Starts ``sma-actuator demo`` in a ROS domain of its own; kills what is left of it."""
    processes = []

    def start(*arguments):
        environment = {
            **os.environ,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": str(100 + os.getpid() % 100),
        }
        process = subprocess.Popen(
            [sys.executable, "-m", "sma_actuator", "demo", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment,
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.kill()
        process.wait()


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


@pytest.mark.parametrize("wire", ("flexinol", "furukawa"))
def test_it_ends_by_itself_with_the_three_errors_and_the_output_off(demo, tmp_path, wire):
    process = demo("--wire", wire, "--duration", "6", "--json", str(tmp_path / "errors.json"))
    output, _ = process.communicate(timeout=WAIT_s)
    assert process.returncode == 0, output
    assert "supply output off; node and bench have ended" in output
    for word in ("setpoint", "estimate", "true displacement (LVDT)", "load", "current", "status"):
        assert word in output
    errors = json.loads((tmp_path / "errors.json").read_text())
    assert errors["samples"] > 40
    assert errors["judged_share"] == 1.0
    # Six seconds are mostly the first contraction; what matters here is that the estimate follows the wire.
    assert errors["model_error_pct_stroke"] < 5.0


def test_ctrl_c_leaves_nothing_running_and_the_output_off(demo):
    process = demo("--duration", "0")
    deadline_s = time.monotonic() + WAIT_s
    started = []
    while len(started := children(process.pid)) < 2:  # bench and node
        assert time.monotonic() < deadline_s and process.poll() is None
        time.sleep(0.01)
    assert any("estimate" in line for line in iter(process.stdout.readline, ""))
    process.send_signal(signal.SIGINT)
    rest = process.stdout.read()
    process.wait(WAIT_s)
    assert process.returncode == 0, rest
    assert "supply output off; node and bench have ended (Ctrl-C)" in rest
    assert not [pid for pid in started if alive(pid)]
