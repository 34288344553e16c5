"""A package adds a strain model, its fitter and an effect; the commands know them as their own."""

import dataclasses
import json
import subprocess
import sys

import pytest
import yaml
from plug_in import environment
from sessions import session, write, write_model

from sma_actuator.config import NODE_NAME

GAIN = 0.05  #: of the channel of the supply voltage, less one


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("plug_in")


@pytest.fixture(scope="module")
def installed(folder):
    return environment(folder)


@pytest.fixture(scope="module")
def logs(wire, folder):
    return write(session(wire[0]), folder)


def command(*arguments, env=None):
    done = subprocess.run(
        [sys.executable, "-m", "sma_actuator", *map(str, arguments), "--jobs", "1"],
        capture_output=True,
        text=True,
        timeout=400,
        env=env,
    )
    return done.returncode, done.stderr


def read(path):
    return yaml.safe_load(path.read_text())[NODE_NAME]["ros__parameters"]


@pytest.mark.long  # of a package's parts an effect is found below, a law and a dialect in tests/ros
def test_a_model_is_identified_and_replayed(wire, folder, logs, installed):
    bench, fitted, errors = write_model(wire[0], folder / "bench.yaml"), folder / "line.yaml", folder / "errors.json"
    identify = ("identify", *logs, "--config", bench, "--model", "straight_line", "--out", fitted)
    code, said = command(*identify, env=installed)
    assert code == 3, said  # written, with the verdict that a straight line should not drive a wire
    assert read(fitted)["model"]["type"] == "straight_line"
    code, said = command("replay", *logs, "--config", fitted, "--json", errors, env=installed)
    assert code == 0, said
    rows = json.loads(errors.read_text())
    assert {row["model"] for row in rows} == {"straight_line"}
    assert all(0.0 < row["full_percent"] < 15.0 for row in rows)
    code, said = command("replay", *logs, "--config", fitted)  # the package is not installed here
    assert code == 1
    assert "model.type: 'straight_line' is not one of flexinol, " in said


@pytest.mark.long  # that it is known to the bench and to commands, below
def test_an_effect_is_traced_written_into_the_model_and_replayed(wire, folder, installed):
    (folder / "shown").mkdir()
    shown = ({**log.columns, "supply_voltage_V": (1.0 + GAIN) * log["supply_voltage_V"]} for log in session(wire[0]))
    logs = write(
        [dataclasses.replace(log, columns=some) for log, some in zip(session(wire[0]), shown, strict=True)],
        folder / "shown",
    )
    model, out = write_model(wire[1], folder / "wire.yaml"), folder / "out"
    traced = ("trace", *logs, "--config", model, "--out", out, "--only", "voltage_gain")
    code, said = command(*traced, env=installed)
    assert code == 0, said
    report = json.loads((out / "report.json").read_text())
    (effect,) = report["effects"]
    assert (effect["name"], effect["part"]) == ("voltage_gain", "circuit")
    assert effect["what"].startswith("the channel of the supply voltage")
    assert effect["parameters"]["gain"]["value"] == pytest.approx(GAIN, rel=0.1)
    extended = read(out / "model.yaml")
    assert extended["effects"]["order"] == ["voltage_gain"]
    errors = folder / "traced.json"
    both = ("--config", model, "--config", out / "model.yaml", "--json", errors)
    code, said = command("replay", *logs, *both, env=installed)
    assert code == 0, said
    before, after = (
        sum(row["full_percent"] for row in json.loads(errors.read_text()) if ("model" in row["model"]) is with_it)
        for with_it in (False, True)
    )
    assert after < 0.5 * before
    code, said = command("replay", *logs, "--config", out / "model.yaml")
    assert code == 1
    assert "effects.voltage_gain: no such effect; known here: lead_resistance" in said


def test_an_effect_can_be_hidden_in_the_virtual_bench(installed):
    """The package brings the twin of its effect: the channel shows another voltage than there is."""
    hides = f"""
import numpy as np
from sma_actuator.bench import HiddenBench, VirtualBench, require_twins
from sma_actuator.bench.hidden import VOLTAGE
from sma_actuator.estimation.effects import EFFECTS
require_twins({{name: effect.PART for name, effect in EFFECTS.items()}})
(hidden,) = HiddenBench.from_name("flexinol", hidden={{"voltage_gain": {GAIN}}}).hidden
rows = np.array([[0.2, 1.5, 1.0, 0.0, 24.0]])
hidden.read(rows, np.zeros(1))
print(rows[0, VOLTAGE] / 1.5 - 1.0)
"""
    done = subprocess.run([sys.executable, "-c", hides], capture_output=True, text=True, timeout=120, env=installed)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == pytest.approx(GAIN)


@pytest.mark.long  # without a command in tests/base/test_registry.py
def test_a_broken_package_is_named_and_stops_no_command_that_needs_nothing_of_it(wire, folder, logs, installed):
    (folder / "site" / "sma_tiny" / "voltage_gain.py").write_text("raise RuntimeError('no licence')\n")
    model = write_model(wire[1], folder / "whole.yaml")
    code, said = command("replay", *logs, "--config", model, env=installed)
    assert code == 0, said
    code, said = command("trace", *logs, "--config", model, "--out", folder / "none", env=installed)
    assert code == 1
    assert "package 'sma-tiny' 0.1.0: its entry point voltage_gain" in said
    assert "RuntimeError: no licence" in said and "Traceback" not in said
