"""``~/tune`` and ``sma-actuator tune --running`` on a node in a process of its own.

What a tuning finds, and how long it takes, is tested in tests/control in the bench's own time; here it is cut short.
"""

import json
import signal
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")
from processes import Bench, NodeProcess, SOON_s, parameter_file, wait_until

from sma_actuator.base.share import shared_file
from sma_actuator.cli.main import main
from sma_actuator.config import Config, copy_tables

NODE = ("--node", "left", "--namespace", "/tuned")
#: A node whose tunings swing twice each way and try only what follows from that.
SHORT = """
import sys
import sma_actuator.control.tuning as tuning
tuning.LEFT_OUT, tuning.WANTED, tuning.STAY_s, tuning.RAMP_1_s, tuning.MOST_TRIALS = 0, 2, 0.5, 0.5, 1
from sma_actuator.ros.node import main
sys.exit(main())
"""


@pytest.fixture(scope="module")
def node(folder, make_config):
    bench = Bench(folder, "--load", "weight:0.98")
    # Less current than usual: after a start from which the wire counts as hot it may flow sooner, and while the wire is
    # held in the middle of its stroke, which leaves 0.31 A, at any time.
    config = make_config(instruments=bench.instruments(), **{"controller.tuning_current": 0.7})
    path = parameter_file(folder, {"left": config})
    arguments = ["--nodes", "left", "--ros-args", "--params-file", str(path), "-r", "__ns:=/tuned"]
    node = NodeProcess(arguments, folder, program=("-c", SHORT))
    yield node
    node.close()
    bench.close()


@pytest.fixture
def wire_file(tmp_path):
    path = tmp_path / "wire.yaml"
    path.write_text(shared_file("config/flexinol.yaml").read_text(encoding="utf-8"))
    copy_tables(shared_file("config/flexinol.yaml"), path)
    return path


def _status(capsys):
    capsys.readouterr()
    assert main(["status", *NODE, "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_wire_that_is_off_is_not_tuned(node, wire_file, capsys):
    before = wire_file.read_text()
    assert main(["tune", "--running", "--config", str(wire_file), *NODE]) == 1
    assert "not tuned: the output is off" in capsys.readouterr().err
    assert wire_file.read_text() == before


@pytest.mark.long  # the command in its own process, tests/control/test_tuning.py
def test_the_node_takes_the_gains_over_and_the_command_writes_them(node, wire_file, capsys):
    wait_until(lambda: main(["enable", *NODE]) == 0, what="a wire that can be enabled")
    words = []

    def tuned():
        main(["enable", *NODE])  # again, where a machine that stalls had it switched off
        done = main(["tune", "--running", "--config", str(wire_file), *NODE]) == 0
        words.append(capsys.readouterr().err)
        return done

    # It is refused until the wire is cool enough, and given up where a machine that stalls makes a fault of it.
    wait_until(tuned, timeout_s=120.0, what="a tuning to its end")
    node.says("tuned: kp")
    node.says("tuning the gains")
    found, status = Config.load(wire_file).controller, _status(capsys)
    assert found.kp != 400.0, words[-1]
    assert status["mode"] == "hold" and status["fault"] == ""
    assert status["values"]["tuning"].startswith(f"done: kp {found.kp:.4g} A/m")
    assert "# Tuned; before: kp 400 A/m" in wire_file.read_text()


def test_with_instruments_of_its_own_a_signal_ends_it_with_the_output_off(folder, start_bench, make_config):
    bench = start_bench("--load", "weight:0.98")
    path = parameter_file(folder, {"sma_actuator": make_config(instruments=bench.instruments())})
    text = path.read_text()
    tuning = subprocess.Popen([sys.executable, "-m", "sma_actuator", "tune", "--config", str(path)])
    try:
        wait_until(lambda: bench.current_A() > 0.04, what="current")
        tuning.send_signal(signal.SIGINT)
        assert tuning.wait(SOON_s) == 130
    finally:
        tuning.kill()
        tuning.wait()
    assert bench.current_A() == 0.0
    assert path.read_text() == text
