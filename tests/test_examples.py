"""The scripts in examples/ run as they are, and do what their first line says."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.characterise import Rig
from sma_actuator.characterise.programs import Drive
from sma_actuator.config import Config
from sma_actuator.logs.bench_log import write_bench_log

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run(name: str, *arguments: object) -> str:
    """What an example prints."""
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A bench log of half a minute: the wire of the virtual bench under on/off current."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    bench = VirtualBench.from_name("flexinol", seed=3)
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    current_A = np.tile(np.repeat([0.05, 0.32], [80, 120]), 3)
    path = tmp_path_factory.mktemp("log") / "pulses.csv"
    with rig.opened():
        write_bench_log(path, rig.record(Drive(float(a)) for a in current_A))
    return path


def test_a_wire_is_driven():
    lines = run("drive_a_wire.py").splitlines()
    assert "on" in lines[0] and [line.split(",")[0] for line in lines[1:]] == [
        "setpoint 2.60 mm",
        "setpoint 1.20 mm",
        "setpoint 2.10 mm",
    ]


@pytest.mark.long  # tests/driver/test_pair.py turns one
def test_a_joint_is_turned():
    lines = run("turn_a_joint.py").splitlines()
    assert "both wires are on" in lines[0]
    assert [line.split(",")[0] for line in lines[1:]] == [
        "asked +0.25 rad and 0.8 N",
        "asked -0.25 rad and 0.8 N",
        "asked -0.25 rad and 1.4 N",
    ]


def test_a_loop_is_drawn(tmp_path):
    assert "% of the stroke from the truth" in run("draw_a_loop.py", tmp_path / "loop.png")
    assert (tmp_path / "loop.png").read_bytes().startswith(b"\x89PNG")


def test_a_log_is_replayed(log):
    printed = run("replay_a_log.py", log, shared_file("config/flexinol.yaml"))
    assert 0.0 < float(printed.split(",")[1].split("%")[0]) < 5.0


@pytest.mark.long
def test_a_log_is_traced(log):
    verdict, errors = run("trace_a_log.py", shared_file("config/flexinol.yaml"), log).splitlines()
    assert verdict.split(":")[0] in ("none", "traced", "unexplained")
    assert "% of the stroke before" in errors


def test_every_example_is_run():
    here = Path(__file__).read_text()
    assert all(f'"{path.name}"' in here for path in EXAMPLES.glob("*.py"))
