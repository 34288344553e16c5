"""The recorder keeps every row it can, and says what it could not keep."""

import errno
import json
import math
import os
import signal
import subprocess
import sys
import threading
import types

import pytest

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Branch, Command, Estimate, Quality, Reading
from sma_actuator.config import Config
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.logs.recorder import ESTIMATE_COLUMNS, BenchLogRecorder


@pytest.fixture
def config(make_config, tmp_path):
    def make(**changes):
        mapping = make_config(**changes)
        mapping["recorder"] = {"folder": str(tmp_path / "logs"), **mapping.get("recorder", {})}
        return Config.from_mapping(mapping)

    return make


def _step(number):
    time_s = 100.0 + 0.05 * number
    reading = Reading(time_s, 1.5, 0.2, 0.08, 0.0151, 22.5)
    estimate = Estimate(time_s, 0.0021, 0.021, -0.001, Branch.HEATING, Quality.DETERMINATE)
    return reading, types.SimpleNamespace(command=Command(0.21, True), estimate=estimate, setpoint_m=0.002)


def _record(recorder, steps):
    for number in steps:
        recorder.record(*_step(number))


def _files(config, pattern="*.csv"):
    return sorted(
        (path for path in os.scandir(config.recorder.folder) if path.name.endswith(pattern[1:])), key=lambda p: p.name
    )


def test_a_log_is_read_back_as_it_was_recorded(config):
    config = config(instruments={"daq": {"lvdt_channel": 104, "ambient_temperature_channel": 105}})
    recorder = BenchLogRecorder(config)
    _record(recorder, range(10))
    recorder.close()
    (file,) = _files(config)
    log = read_bench_log(file.path)
    assert len(log) == 10
    assert log["time_s"] == pytest.approx([100.0 + 0.05 * i for i in range(10)])
    reading, output = _step(3)
    for name in (
        "supply_voltage_V",
        "reference_voltage_V",
        "load_cell_voltage_V",
        "lvdt_current_A",
        "ambient_temperature_C",
    ):
        assert log[name][3] == getattr(reading, name)
    assert log["current_command_A"][3] == output.command.current_A
    assert log["setpoint_m"][3] == output.setpoint_m
    assert log["displacement_estimate_m"][3] == output.estimate.displacement_m
    assert log["velocity_estimate_m_s"][3] == output.estimate.velocity_m_s
    assert (log["branch"][3], log["quality"][3], log["output_on"][3]) == (1, 0, 1)
    assert log.metadata["parameters"] == json.loads(json.dumps(config.to_mapping()))


def test_channels_that_are_not_wired_have_no_column(config):
    assert BenchLogRecorder(config()).columns == (
        "time_s",
        "supply_voltage_V",
        "reference_voltage_V",
        "load_cell_voltage_V",
        "current_command_A",
        "setpoint_m",
        *ESTIMATE_COLUMNS,
    )


def test_the_same_block_twice_is_one_row(config):
    config = config()
    recorder = BenchLogRecorder(config)
    _record(recorder, [0, 1, 1, 2])
    recorder.close()
    assert len(read_bench_log(_files(config)[0].path)) == 3
    assert recorder.dropped_rows == 0


def test_a_reading_that_is_not_a_number_is_kept_as_that(config):
    config = config()
    recorder = BenchLogRecorder(config)
    reading, output = _step(1)
    _record(recorder, [0])
    recorder.record(Reading(reading.time_s, math.nan, 0.2, 0.08), output)
    recorder.close()
    assert math.isnan(read_bench_log(_files(config)[0].path, allow_gaps=True)["supply_voltage_V"][1])


def test_files_rotate_by_size_and_only_the_newest_are_kept(config):
    config = config(recorder={"max_file_size": 10_000, "max_files": 3})
    recorder = BenchLogRecorder(config)
    _record(recorder, range(1000))
    recorder.close()
    files = _files(config)
    assert len(files) == 3
    assert len(_files(config, "*.json")) == 3
    times_s = [t for file in files for t in read_bench_log(file.path)["time_s"]]
    assert times_s == sorted(times_s)
    assert times_s[-1] == pytest.approx(100.0 + 0.05 * 999)
    assert all(file.stat().st_size < 11_000 for file in files)


def test_a_full_queue_drops_rows_counts_them_and_never_waits(config, monkeypatch):
    config = config()
    release = threading.Event()
    write_row = BenchLogRecorder._write_row
    monkeypatch.setattr(BenchLogRecorder, "_write_row", lambda self, row: (release.wait(10.0), write_row(self, row)))
    recorder = BenchLogRecorder(config, queue_rows=5)
    _record(recorder, range(100))  # returns although nothing is written
    assert 100 - 6 <= recorder.dropped_rows <= 100 - 5  # one row may already be with the writer
    release.set()
    recorder.close()
    assert len(read_bench_log(_files(config)[0].path)) == 100 - recorder.dropped_rows


def test_a_disk_that_fills_ends_the_log_with_a_sentence_and_not_the_loop(config, monkeypatch):
    def full(self, row):
        raise OSError(errno.ENOSPC, "No space left on device")

    config = config()
    monkeypatch.setattr(BenchLogRecorder, "_write_row", full)
    recorder = BenchLogRecorder(config)
    _record(recorder, range(10))
    recorder.close()
    assert recorder.problem == f"the bench log in {config.recorder.folder} ended: No space left on device"
    assert recorder.dropped_rows == 10


def test_a_folder_that_cannot_be_made_is_refused_with_its_parameter(config, tmp_path):
    (tmp_path / "logs").write_text("a file, no folder")
    with pytest.raises(ConfigError, match="recorder.folder: .*logs cannot be written"):
        BenchLogRecorder(config())


_KILLED = """
import os, signal, sys, types
from test_recorder import _record
from sma_actuator.config import Config
from sma_actuator.logs.recorder import BenchLogRecorder
import json
recorder = BenchLogRecorder(Config.from_mapping(json.loads(sys.argv[1])))
_record(recorder, range(200))
while not recorder._queue.empty():
    pass
print("ready", flush=True)
signal.pause()
"""


def test_what_a_killed_process_left_is_completed_by_the_next_one(config):
    config = config()
    process = subprocess.Popen(
        [sys.executable, "-c", _KILLED, json.dumps(config.to_mapping())],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.path.dirname(__file__)},
    )
    assert process.stdout.readline() == "ready\n"
    BenchLogRecorder(config).close()
    assert len(_files(config, "*.csv.part")) == 1, "a file whose writer lives was taken from it"
    process.send_signal(signal.SIGKILL)
    process.wait(10.0)
    (part,) = _files(config, "*.csv.part")
    with open(part.path, "ab") as stream:
        stream.write(b"110.0,1.5,0.")  # a line cut short
    BenchLogRecorder(config).close()
    assert not _files(config, "*.csv.part")
    lengths = [len(read_bench_log(file.path)) for file in _files(config) if file.stat().st_size > 500]
    assert len(lengths) == 1
    assert lengths[0] >= 199  # the row that is being written when the kill comes may be lost
