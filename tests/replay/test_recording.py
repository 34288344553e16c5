"""What a node has recorded goes through every tool as it is, and replay says again what the node said."""

import json

import numpy as np
import pytest
import yaml
from characterised import identified

from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.characterise.operators import BenchOperator
from sma_actuator.cli.main import main
from sma_actuator.config import NODE_NAME, Config
from sma_actuator.driver import Driver
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.logs.recorder import BenchLogRecorder

PULSES = (0.0040, 0.0005)  #: setpoints [m] beyond the working range: the driver takes the wire to its ends


@pytest.fixture(scope="module")
def model_file(identified_flexinol, tmp_path_factory):
    """The identified wire, with a loop that bears a hiccup."""
    found = identified_flexinol.mapping
    mapping = {**found, "safety": {**found["safety"], "reading_timeout": 1.0, "load_spike": 2.0}}
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    path.write_text(yaml.safe_dump({NODE_NAME: {"ros__parameters": mapping}}))
    return path


class Recorded:
    """A wire that was switched on and off, tared, loaded, stalled and tuned under a recorder."""

    def __init__(self, model_file, folder, max_file_size=50_000_000):
        mapping = Config.load(model_file).to_mapping()
        mapping["recorder"] = {"folder": str(folder), "max_file_size": max_file_size, "max_files": 100}
        self.config = Config.from_mapping(mapping)
        self.bench = VirtualBench.from_name("flexinol", seed=3)
        wire = self.config.wire
        self.operator = BenchOperator(self.bench, wire.max_stress * wire.area_m2, wire.full_stroke_m)
        self.recorder = BenchLogRecorder(self.config)
        instruments = (InProcessSupply(self.bench, self.config), InProcessDaq(self.bench, self.config))
        self.driver = Driver(self.config, *instruments, VirtualClock(self.bench), recorder=self.recorder)

    def drive(self, load_N, cycles):
        """Off, on, some cycles, off."""
        self.operator.hang_load(load_N)
        self.driver.run_for(3.0)
        done, words = self.driver.enable(True)
        assert done, words
        self.driver.run_for(2.0)
        for _ in range(cycles):
            for place_m in PULSES[::-1]:
                for _ in range(8):
                    self.driver.offer_setpoint(place_m)
                    self.driver.run_for(0.5)
        self.driver.enable(False)
        self.driver.run_for(4.0)

    def session(self):
        self.operator.hang_load(0.02)
        self.driver.run_for(1.0)
        done, words = self.driver.tare_load()
        assert done, words
        for load_N in (0.3, 0.6, 1.2, 2.0):
            self.drive(load_N, 2)
            mapping = self.config.to_mapping()
            mapping["controller"]["kp"] *= 1.0 + load_N / 10.0
            self.driver.update(Config.from_mapping(mapping))
        self.driver.enable(True)
        self.driver.run_for(2.0)
        self.driver.offer_setpoint(0.002)
        self.driver.run_for(2.0)
        self.bench.advance(self.bench.time_s + 0.53)  # the machine has a hiccup
        self.driver.run_for(2.0)
        assert self.driver.reset_estimator()[0]
        self.driver.run_for(1.0)
        self.driver.stop()
        self.recorder.close()
        assert self.recorder.lost_rows == 0
        return self


@pytest.fixture(scope="module")
def recording(model_file, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    Recorded(model_file, folder).session()
    (path,) = folder.glob("*.csv")
    return path


def test_the_log_says_what_was_done(recording):
    log = read_bench_log(recording, allow_gaps=True)
    events = "; ".join(text for _, text in log.events)
    for word in ("tared 0.0", "estimator reset", "enabled", "disabled", "controller.kp"):
        assert word in events
    assert events.count("enabled") == 5 and len(np.unique(log["tare_N"])) == 2


def test_replay_says_what_the_node_said_to_the_bit(recording, model_file, tmp_path, capsys):
    code = main(["replay", str(recording), "--config", str(model_file), "--json", str(tmp_path / "e.json")])
    out = capsys.readouterr()
    assert code == 0, out.err
    (row,) = json.loads((tmp_path / "e.json").read_text())
    assert row["from_live_m"] == 0.0 and row["live_readings"] > 1000
    assert row["full_percent"] < 5.0
    assert "differs by at most 0 mm from what the node had estimated" in out.err
    assert out.err.splitlines()[-1].startswith("next: flexinol errs by ")


def test_a_recording_in_many_files_is_one(model_file, tmp_path, capsys):
    Recorded(model_file, tmp_path / "logs", max_file_size=60_000).session()
    assert len(list((tmp_path / "logs").glob("*.csv"))) > 5
    code = main(["replay", str(tmp_path / "logs"), "--config", str(model_file), "--json", str(tmp_path / "e.json")])
    assert code == 0, capsys.readouterr().err
    (row,) = json.loads((tmp_path / "e.json").read_text())
    assert row["from_live_m"] == 0.0 and row["live_readings"] > 1000


def test_a_recording_has_its_part_in_a_model_beside_pulses(recording, flexinol, tmp_path):
    pulses = str(flexinol.folder / "pulses_*.csv")
    bench = flexinol.folder / "bench.yaml"
    found = identified([recording, pulses], bench, tmp_path / "model.yaml", "--no-extension")
    assert max(e["working_percent"] for e in found["errors"]) < 3.0
    loads_N = [e["load_N"] for e in found["errors"] if recording.name in e["name"]]
    for load_N in (0.3, 0.6, 1.2, 2.0):
        assert any(abs(found_N - load_N) < 0.03 for found_N in loads_N), loads_N
    assert not any("partial" in note for note in found["notes"])


def test_a_recording_is_traced(recording, model_file, tmp_path, capsys):
    words = ["--out", str(tmp_path / "t"), "--only", "creep", "--jobs", "1"]
    code = main(["trace", str(recording), "--config", str(model_file), *words])
    assert code == 0, capsys.readouterr().err
    report = json.loads((tmp_path / "t" / "report.json").read_text())
    assert report["error_before_pct_stroke"] < 5.0
