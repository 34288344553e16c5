"""The recorder keeps every row it can, and says what it could not keep."""

import ctypes
import dataclasses
import errno
import fcntl
import fnmatch
import json
import math
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
from waiting import STARTS_SOON, wait_until

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Branch, Command, Estimate, Mode, Output, Quality, Reading, Signals, Status
from sma_actuator.config import Config
from sma_actuator.logs import manifest as manifest_module
from sma_actuator.logs import recorder as recorder_module
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.logs.manifest import LARGEST_B
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
    status = Status(Mode.TRACKING)
    return reading, Output(Signals(*[math.nan] * 6), estimate, Command(0.21, True), status, 0.002, tare_N=0.01)


def _record(recorder, steps):
    for number in steps:
        recorder.record(*_step(number))


def _files(config, pattern="*.csv"):
    return sorted(
        (
            path
            for path in os.scandir(config.recorder.folder)
            if fnmatch.fnmatch(path.name, pattern) and path.name[0] != "."
        ),
        key=lambda p: p.name,
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
        "tare_N",
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
    assert recorder.lost_rows == 0


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
    assert 100 - 6 <= recorder.lost_rows <= 100 - 5  # one row may already be with the writer
    release.set()
    recorder.close()
    assert len(read_bench_log(_files(config)[0].path, allow_gaps=True)) == 100 - recorder.lost_rows


def test_numbers_come_back_to_the_bit(config):
    config = config()
    recorder = BenchLogRecorder(config)
    _, output = _step(0)
    values = [1.0 / (3 + k) for k in range(50)]
    for k, value in enumerate(values):
        recorder.record(Reading(100.0 + k / 7.0, value, value / 3, value / 7), output)
    recorder.close()
    log = read_bench_log(_files(config)[0].path)
    assert log["supply_voltage_V"].tolist() == values
    assert log["time_s"].tolist() == [100.0 + k / 7.0 for k in range(50)]
    assert log["load_cell_voltage_V"].tolist() == [value / 7 for value in values]


def test_what_happened_stands_in_the_next_row_that_is_kept(config):
    config = config()
    recorder = BenchLogRecorder(config)
    reading, output = _step(1)
    recorder.record(_step(0)[0], output)
    recorder.record(None, dataclasses.replace(output, events=("tared 0.01 N", 'a "quoted", word')))
    recorder.record(reading, dataclasses.replace(output, events=("enabled",)))
    recorder.record(_step(2)[0], output)
    recorder.close()
    log = read_bench_log(_files(config)[0].path)
    assert log.events == ((reading.time_s, "tared 0.01 N; a 'quoted', word; enabled"),)
    assert log["tare_N"].tolist() == [0.01] * 3


def test_a_disk_that_fills_ends_the_log_with_a_sentence_and_not_the_loop(config, monkeypatch):
    def full(self, row):
        raise OSError(errno.ENOSPC, "No space left on device")

    config = config()
    monkeypatch.setattr(BenchLogRecorder, "_write_row", full)
    recorder = BenchLogRecorder(config)
    _record(recorder, range(10))
    recorder.close()
    assert recorder.problem == f"the bench log in {config.recorder.folder} ended: No space left on device"
    assert recorder.lost_rows == 10


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


def test_what_a_killed_process_left_is_completed_and_named_by_the_next_one(config, caplog):
    config = config()
    process = subprocess.Popen(
        [sys.executable, "-c", _KILLED, json.dumps(config.to_mapping())],
        stdout=subprocess.PIPE,
        text=True,
        env={**STARTS_SOON, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])},
    )
    try:
        assert process.stdout.readline() == "ready\n"
        BenchLogRecorder(config).close()
        assert len(_files(config, "*.csv.part")) == 1, "a file whose writer lives was taken from it"
        assert not caplog.text
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate(timeout=60.0)
    (part,) = _files(config, "*.csv.part")
    with Path(part.path).open("ab") as stream:
        stream.write(b"110.0,1.5,0.")  # a line cut short
    BenchLogRecorder(config).close()
    assert not _files(config, "*.csv.part")
    assert f"who wrote {Path(part.path).with_suffix('')} was killed, crashed or lost its folder" in caplog.text
    lengths = [len(read_bench_log(file.path)) for file in _files(config) if file.stat().st_size > 500]
    assert len(lengths) == 1
    assert lengths[0] >= 199  # the row that is being written when the kill comes may be lost


# --- whose files they are -------------------------------------------------------------------------


def _record_many(config, name="left", steps=1000):
    recorder = BenchLogRecorder(config, name)
    _record(recorder, range(steps))
    recorder.close()
    return recorder


def test_only_its_own_files_are_removed_however_they_are_called(config, tmp_path, caplog):
    config = config(recorder={"max_file_size": 10_000, "max_files": 3})
    folder = tmp_path / "logs"
    folder.mkdir()
    for name in ("left_calibration.csv", "left_calibration.json", "left_20200101_000000_1_0001.csv"):
        (folder / name).write_text("a person's")
    _record_many(config, "left_arm")
    others = {path.name: path.read_bytes() for path in folder.glob("left_arm_*")}
    _record_many(config, "left")
    assert (folder / "left_calibration.csv").read_text() == "a person's"
    assert (folder / "left_calibration.json").read_text() == "a person's"
    assert (folder / "left_20200101_000000_1_0001.csv").read_text() == "a person's"
    assert {path.name: path.read_bytes() for path in folder.glob("left_arm_*")} == others
    own = [p for p in folder.glob("left_2*.csv") if "20200101" not in p.name]
    assert len(own) == 3
    removed = [record.getMessage() for record in caplog.records if "removed the oldest log" in record.getMessage()]
    assert len(removed) >= 2 * 2 and all("recorder.max_files is 3" in sentence for sentence in removed)


def test_a_log_that_was_replaced_is_not_removed(config, tmp_path):
    config = config(recorder={"max_file_size": 10_000, "max_files": 2})
    _record_many(config, steps=50)
    (mine,) = (tmp_path / "logs").glob("left_*.csv")
    kept = tmp_path / "kept.csv"
    kept.write_text("worth keeping")
    mine.unlink()
    mine.symlink_to(kept)
    _record_many(config)
    assert mine.is_symlink() and kept.read_text() == "worth keeping"


def test_a_part_that_is_a_link_leads_nowhere(config, tmp_path):
    config = config()
    folder = tmp_path / "logs"
    folder.mkdir()
    target = tmp_path / "thesis.txt"
    target.write_text("line\nhalf a line")
    (folder / "left_20200101_000000_1_0001.csv.part").symlink_to(target)
    _record_many(config, steps=5)
    assert target.read_text() == "line\nhalf a line"
    assert (folder / "left_20200101_000000_1_0001.csv.part").is_symlink()


def _text(path):
    path.write_text("{}")


def _nested(path):
    path.write_text("[" * 100_000)


def _huge(path):
    path.touch()
    os.truncate(path, LARGEST_B + 1)


@pytest.mark.parametrize("put", [_text, _nested, _huge, os.mkfifo, Path.mkdir], ids=lambda put: put.__name__)
def test_what_stands_in_the_place_of_the_list_is_refused(config, tmp_path, put):
    """A pipe was awaited, for ever; deep nesting ended in a traceback."""
    (tmp_path / "logs").mkdir()
    put(tmp_path / "logs" / ".left.manifest.json")
    with pytest.raises(ConfigError, match=r"left.manifest.json is not the list of the files"):
        BenchLogRecorder(config(), "left")


@pytest.fixture
def lock(tmp_path):
    """A handle by which somebody has locked the folder of the logs."""
    (tmp_path / "logs").mkdir()
    handle = os.open(tmp_path / "logs", os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    yield handle
    os.close(handle)


def test_a_folder_that_somebody_keeps_locked_is_refused(config, lock, monkeypatch):
    monkeypatch.setattr(manifest_module, "LOCKED_s", 0.05)
    with pytest.raises(ConfigError, match=r"logs cannot be written \(another process keeps it locked\)"):
        BenchLogRecorder(config())


def test_a_folder_that_another_recorder_lets_go_is_waited_for(config, lock, monkeypatch):
    monkeypatch.setattr(manifest_module.time, "sleep", lambda _: fcntl.flock(lock, fcntl.LOCK_UN))
    recorder = BenchLogRecorder(config())
    _record(recorder, range(3))
    recorder.close()
    assert recorder.lost_rows == 0 and recorder.words == ""


# --- what somebody does to the file that is being written ------------------------------------------


def _unlinked(part):
    part.unlink()


def _folder_removed(part):
    shutil.rmtree(part.parent, ignore_errors=True)  # it stays where the recorder has gone on in it meanwhile


def _folder_moved(part):
    part.parent.rename(part.parent.with_name("elsewhere"))


def _exchange(folder, other):
    """In one step: between two, the recorder may make the folder anew."""
    here, exchange = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of Linux
    done = ctypes.CDLL(None, use_errno=True).renameat2(here, os.fsencode(folder), here, os.fsencode(other), exchange)
    assert done == 0, os.strerror(ctypes.get_errno())


def _folder_moved_and_another_there(part):
    another = part.parent.with_name("elsewhere")
    another.mkdir()
    _exchange(part.parent, another)


def _folder_replaced_by_a_link(part):
    target, link = part.parent.with_name("target"), part.parent.with_name("elsewhere")
    target.mkdir()
    link.symlink_to(target)
    _exchange(part.parent, link)


def _moved(part):
    part.rename(part.parent / "mine.csv")


def _replaced_by_a_link(part):
    part.rename(part.parent / "mine.csv")
    part.symlink_to(part.parent / "mine.csv")


def _removed_for_a_link(part):
    part.unlink()
    part.symlink_to("/dev/null")


def _replaced_by_a_folder(part):
    part.unlink()
    part.mkdir()


def _replaced_by_a_file(part):
    part.unlink()
    part.write_text("somebody's")


def _metadata_removed(part):
    part.with_suffix("").with_suffix(".json").unlink()


MISCHIEF = (
    _unlinked,
    _folder_removed,
    _folder_moved,
    _folder_moved_and_another_there,
    _folder_replaced_by_a_link,
    _moved,
    _replaced_by_a_link,
    _removed_for_a_link,
    _replaced_by_a_folder,
    _replaced_by_a_file,
    _metadata_removed,
)


@pytest.fixture
def recorded(config, monkeypatch):
    """A recorder that has written 167 rows, and the file they are in."""
    monkeypatch.setattr(recorder_module, "LOOK_s", 0.02)
    config = config()
    recorder = BenchLogRecorder(config)
    _record(recorder, range(167))
    wait_until(lambda: not recorder.waiting_rows, what="the rows with the system")
    (part,) = Path(config.recorder.folder).glob("*.csv.part")
    yield recorder, part
    recorder.close()


def _rows_below(folder):
    """Times of all rows in complete logs, also in folders that links do not lead to."""
    return sorted(
        float(line.split(",")[0])
        for path in folder.rglob("*.csv")
        if path.is_file() and not path.is_symlink()
        for line in path.read_text().splitlines()[1:]
    )


@pytest.mark.parametrize("mischief", MISCHIEF, ids=lambda mischief: mischief.__name__.strip("_"))
def test_no_row_is_lost_whatever_becomes_of_the_file(recorded, tmp_path, mischief):
    recorder, part = recorded
    assert recorder.words == ""
    mischief(part)
    wait_until(lambda: recorder.words, what="a word")
    assert "the bench log goes on in " in recorder.words and recorder.problem == ""
    _record(recorder, range(167, 200))
    recorder.close()
    assert recorder.lost_rows == 0
    assert _rows_below(tmp_path) == pytest.approx([100.0 + 0.05 * number for number in range(200)])
    (goes_on,) = Path(recorder.words.partition(" goes on in ")[2]).parent.glob("*_0002.csv")
    assert read_bench_log(goes_on).metadata["parameters"]["recorder"]["folder"] == str(part.parent)


def test_what_is_moved_between_two_looks_is_found_at_the_end(config, tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "LOOK_s", 1000.0)
    recorder = BenchLogRecorder(config())
    _record(recorder, range(10))
    wait_until(lambda: not recorder.waiting_rows, what="the rows with the system")
    shutil.rmtree(tmp_path / "logs")
    recorder.close()
    assert recorder.lost_rows == 0 and len(_rows_below(tmp_path)) == 10


def test_rows_that_somebody_cuts_off_are_counted_and_what_follows_is_another_recording(recorded, tmp_path):
    recorder, part = recorded
    header, *rows = part.read_text().splitlines(keepends=True)
    os.truncate(part, len(header + "".join(rows[:40])))
    wait_until(lambda: recorder.words, what="a word")
    assert "was changed by somebody else" in recorder.words
    assert recorder.lost_rows == 127
    _record(recorder, range(167, 170))
    recorder.close()
    first, second = (read_bench_log(path).metadata for path in sorted((tmp_path / "logs").glob("*.csv")))
    assert first["recording"] != second["recording"] and second["part"] == 1


def _shut_out(folder, mapping):
    """Run in a process of its own, which becomes a user whom permissions bind."""
    if os.geteuid() == 0:
        os.setuid(65534)
    recorder_module.LOOK_s, recorder_module.RETRY_s = 0.02, 0.05
    config = Config.from_mapping(mapping)
    recorder = BenchLogRecorder(config)
    _record(recorder, range(10))
    wait_until(lambda: not recorder.waiting_rows, what="the rows with the system")
    (folder / "logs").chmod(0)
    _record(recorder, range(10, 200))  # more than one file's worth
    wait_until(lambda: not recorder.waiting_rows and recorder.lost_rows, what="rows to be lost")
    assert recorder.problem == f"the bench log in {folder / 'logs'} ended: Permission denied"
    (folder / "logs").chmod(0o700)
    number = 200
    while recorder.problem and number < 2000:
        _record(recorder, [number])
        number += 1
        time.sleep(0.01)
    recorder.close()
    assert "it goes on in" in recorder.words
    BenchLogRecorder(config).close()  # completes what it could not name
    assert len(_rows_below(folder)) + recorder.lost_rows == number


def test_a_folder_that_may_not_be_entered_any_more_costs_no_row_until_a_new_file_is_due(make_config):
    folder = Path(tempfile.mkdtemp(dir="/tmp"))  # pytest's own may be entered by its user alone
    try:
        if os.geteuid() == 0:
            os.chown(folder, 65534, 65534)
        recorder = {"folder": str(folder / "logs"), "max_file_size": 10_000}
        child = multiprocessing.get_context("spawn").Process(
            target=_shut_out, args=(folder, make_config(recorder=recorder)), daemon=True
        )
        child.start()
        child.join(120.0)
        assert child.exitcode == 0, "what it said is on standard error"
    finally:
        shutil.rmtree(folder)


def test_a_disk_that_does_not_answer_holds_nothing_up_and_is_said(config, monkeypatch):
    monkeypatch.setattr(recorder_module, "HELD_UP_s", 0.05)
    release = threading.Event()
    write = os.write
    monkeypatch.setattr(BenchLogRecorder, "_write", lambda self, data: (release.wait(20.0), write(self._handle, data)))
    release.set()
    recorder = BenchLogRecorder(config())
    release.clear()
    _record(recorder, range(20))
    wait_until(lambda: "is held up" in recorder.problem, what="a word")
    release.set()
    wait_until(lambda: not recorder.problem, what="the rest")
    recorder.close()
    assert recorder.lost_rows == 0


def test_rows_that_wait_for_such_a_disk_at_the_end_are_counted(config, monkeypatch, caplog):
    release = threading.Event()
    recorder = BenchLogRecorder(config())
    monkeypatch.setattr(BenchLogRecorder, "_write", lambda *_: release.wait(20.0))
    _record(recorder, range(20))
    recorder.close(timeout_s=0.05)
    release.set()
    assert "20 rows of the bench log are lost" in caplog.text
    recorder.close()


@pytest.mark.parametrize(
    "spoil",
    [os.mkfifo, _text, Path.touch, lambda path: path.symlink_to("/dev/null")],
    ids=["pipe", "another", "empty", "link"],
)
def test_a_list_that_is_spoilt_while_it_is_recorded_is_written_anew_and_no_row_is_lost(
    spoil, recorded, tmp_path, caplog
):
    recorder, part = recorded
    listed = part.with_name(".sma_actuator.manifest.json")
    listed.unlink()
    spoil(listed)
    part.unlink()
    wait_until(lambda: recorder.words, what="a word")
    assert "was removed or moved; the bench log goes on in" in recorder.words
    assert f"{listed} was spoilt by somebody else; it is written anew" in caplog.text
    _record(recorder, range(167, 170))
    recorder.close()
    assert recorder.lost_rows == 0 and len(_rows_below(tmp_path)) == 170
    (log,) = (tmp_path / "logs").glob("*.csv")
    assert json.loads(listed.read_text())["files"][log.name] == log.stat().st_ino


def test_what_the_writer_stumbles_over_does_not_end_it(config, monkeypatch):
    monkeypatch.setattr(recorder_module, "RETRY_s", 0.0)
    recorder = BenchLogRecorder(config())
    reading, output = _step(0)
    recorder.record(reading, dataclasses.replace(output, events=("\ud800",)))  # no text that a file takes
    _record(recorder, range(1, 10))
    recorder.close()
    assert recorder.lost_rows == 1 and "it goes on in" in recorder.words


_ON_A_FULL_DISK = """
import json, os, subprocess, sys, time
from pathlib import Path
from test_recorder import _record
from sma_actuator.config import Config
from sma_actuator.logs import recorder as module
module.RETRY_s = 0.05
folder = Path(sys.argv[2])
subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)], check=True)
print("mounted", flush=True)
config = Config.from_mapping({**json.loads(sys.argv[1]), "recorder": {"folder": str(folder)}})
module.BenchLogRecorder(config).close()
with (folder / "ballast").open("wb", buffering=0) as stream:
    try:
        while True:
            stream.write(b"x" * 4096)
    except OSError:
        pass
recorder = module.BenchLogRecorder(config)
_record(recorder, range(20))
deadline = time.monotonic() + 20
while recorder.lost_rows < 20 and time.monotonic() < deadline:
    time.sleep(0.01)
before = (recorder.problem, recorder.lost_rows)
(folder / "ballast").unlink()
number = 20
while recorder.problem and time.monotonic() < deadline:
    _record(recorder, [number])
    number += 1
    time.sleep(0.01)
_record(recorder, range(number, number + 10))
recorder.close()
sizes = [len(p.read_text().splitlines()) for p in sorted(folder.glob("*.csv"))]
print(json.dumps([*before, recorder.problem, sizes]))
"""


def test_a_full_disk_prevents_no_start_and_the_log_goes_on_when_there_is_room(config, tmp_path):
    folder = tmp_path / "disk"
    folder.mkdir()
    done = subprocess.run(
        ["unshare", "-rm", sys.executable, "-c", _ON_A_FULL_DISK, json.dumps(config().to_mapping()), str(folder)],
        capture_output=True,
        text=True,
        timeout=150,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])},
    )
    if "mounted" not in done.stdout:
        pytest.skip(f"no file system of its own to fill: {done.stderr[-200:]}")
    assert done.returncode == 0, done.stderr
    problem, dropped, after, sizes = json.loads(done.stdout.splitlines()[-1])
    assert "No space left on device" in problem and dropped == 20
    assert after == "" and sizes[-1] >= 11  # the header and what was recorded after there was room
