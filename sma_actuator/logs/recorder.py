"""The driver's own bench log: every reading and what was made of it, as CSV that every tool reads.

Rows go through a bounded queue to a thread of their own, so that a slow disk costs rows, which are
counted, and never time in the loop.  A file is called ``….csv.part`` while it is written and
``….csv`` when it is complete; every row is with the system before the next is taken, so a killed
process loses next to nothing, and the next recorder on that folder completes what was left behind.
Where the disk is full the wire is driven on without a log, until there is room again.

Whether the file is still where it was begun is looked at every ``LOOK_s``.  One that somebody has
moved away is complete where it is now; of one that was removed the open file still holds every row,
and they are copied.  Either way the log goes on in a new file.

Numbers are written with all their digits: whoever reads them gets the estimator's own numbers back.
The column ``event`` says what changed before its row: output on or off, fault, tare, parameters.

Only files of the recorder's own :class:`Manifest` are ever completed or removed.
"""

from __future__ import annotations

import contextlib
import datetime
import errno
import fcntl
import json
import logging
import os
import queue
import stat
import threading
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any, Protocol

from sma_actuator.base.parameters import ConfigError, parameter
from sma_actuator.base.sections import Wire
from sma_actuator.base.signals import Output, Reading
from sma_actuator.instruments.parameters import Instruments

from .bench_log import COLUMNS
from .manifest import Files, Manifest
from .tables import EVENT_COLUMN, PART

_log = logging.getLogger(__name__)

#: What the estimator made of the reading, beside the columns every bench log has.
ESTIMATE_COLUMNS = ("displacement_estimate_m", "velocity_estimate_m_s", "branch", "quality", "output_on")
RETRY_s = 10.0  #: between two attempts to go on where the disk was full
LOOK_s = 0.25  #: between two looks whether the file is still in its place
HELD_UP_s = 5.0  #: a row that takes longer is held up by the disk; rows wait for it meanwhile, and are not lost
_ALWAYS = ("time_s", "supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V", "tare_N")
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_STOP = None
_Row = tuple[tuple[float, ...], str]  #: numbers, event


@dataclass(frozen=True, slots=True)
class RecorderParameters:
    """Where and how much is recorded."""

    folder: str = parameter("", "folder for bench logs; empty: none are written", optional=True)
    max_file_size: int = parameter(50_000_000, "size at which a new file is begun", "B", 10_000, 10**12)
    max_files: int = parameter(20, "files kept; the oldest go first", "1", 1, 100000)


class RecorderSections(Protocol):
    """The parameters that a recorder reads, and all of them as a mapping, which it writes beside the log."""

    @property
    def recorder(self) -> RecorderParameters:
        """Where and how much."""

    @property
    def instruments(self) -> Instruments:
        """Which channels there are."""

    @property
    def wire(self) -> Wire:
        """Of which wire."""

    def to_mapping(self) -> Mapping[str, Any]:
        """Every parameter."""


class BenchLogRecorder:
    """Writes the bench log of one wire into ``config.recorder.folder``.

    ``current_command_A`` is the command that followed the reading; it acts until the next row.
    Raises ConfigError where the folder cannot be made or written; a full disk is a ``problem``, no reason not to start.
    """

    def __init__(self, config: RecorderSections, name: str = "sma_actuator", queue_rows: int = 10_000):
        self.lost_rows = 0  #: that are in no file
        self.columns = _columns(config)
        self._config = config
        self._name = name.strip("/").replace("/", "_")
        self._folder = Path(config.recorder.folder).expanduser()
        self._manifest = Manifest(self._folder, self._name)
        self._last_time_s = float("-inf")
        self._events: list[str] = []  #: that stand in no row yet
        self._number = 0
        self._begin_recording()
        self._handle = -1  #: the open file; −1 where there is none
        self._own: Files = {}  #: its name and that of the file beside it
        self._size = 0  #: of what was written to it
        self._rows = 0  #: that are in it
        self._failure = ""  #: why there is none
        self._incident = ""  #: why the last one but this was left
        self._retry_s = 0.0  #: when to try again after a failure
        self._look_s = 0.0  #: when to look again whether it is in its place
        self._busy_s = inf  #: since when the thread has been busy with one row
        self._queue: queue.Queue[_Row | None] = queue.Queue(queue_rows)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._complete_left_behind()
            self._begin_file()
        except OSError as error:
            if error.errno not in _NO_ROOM:
                raise ConfigError(
                    f"recorder.folder: {self._folder} cannot be written ({error.strerror}); a folder this process may "
                    f"write is wanted"
                ) from error
            self._end_with(error)
        self._thread = threading.Thread(target=self._run, name=f"{name} recorder", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str:
        """Why nothing is written now, or ""."""
        held_up_s = time.monotonic() - self._busy_s
        if held_up_s > HELD_UP_s:
            return f"the bench log in {self._folder} is held up: the disk does not answer"
        return self._failure

    @property
    def words(self) -> str:
        """What has gone wrong with the log, without how many rows it has cost; "" where nothing has."""
        return self.problem or self._incident

    @property
    def _path(self) -> Path:
        """The name that the file at hand will have."""
        return self._folder / next(iter(self._own)).removesuffix(PART)

    @property
    def waiting_rows(self) -> int:
        """Rows that are not with the system yet."""
        return self._queue.unfinished_tasks

    def record(self, reading: Reading | None, output: Output) -> None:
        """Queue one row; where the queue is full the row is dropped and counted.

        A step without a reading has no row: what happened in it stands in the next.
        """
        self._events += output.events
        if reading is None or not reading.time_s > self._last_time_s:
            return  # the same block again: a log's times increase
        self._last_time_s = reading.time_s
        row = recorded_row(reading, output)
        try:
            self._queue.put_nowait((tuple(row[name] for name in self.columns), "; ".join(self._events)))
        except queue.Full:
            self.lost_rows += 1
        else:
            self._events.clear()

    def close(self, timeout_s: float = 5.0) -> None:
        """Write what is queued, complete the file and end the thread.  May be called twice."""
        waiting = 0
        if self._thread.is_alive():
            waiting = self.waiting_rows
            with contextlib.suppress(queue.Full):
                self._queue.put(_STOP, timeout=timeout_s)
            self._thread.join(timeout_s)
        lost = self.lost_rows + (waiting if self._thread.is_alive() else 0)  # nobody waits for the disk any more
        if lost:
            _log.warning("%s: %d rows of the bench log are lost", self._name, lost)

    # --- in the recorder's thread -----------------------------------------------------------------

    def _run(self) -> None:
        row: _Row | None = None
        while True:
            with contextlib.suppress(queue.Empty):
                row = self._queue.get(timeout=LOOK_s)
                if row is _STOP:
                    break
            self._busy_s = time.monotonic()
            try:
                self._look()
                if row is not None:
                    self._keep(row)
            except Exception as error:  # noqa: BLE001 - whatever it is, it must not end the log without a word
                self._end_with(error)
                self.lost_rows += row is not None
            if row is not None:
                self._queue.task_done()
            row, self._busy_s = None, inf
        try:
            self._look_s = 0.0
            self._look()
            self._complete_file()
        except Exception as error:  # noqa: BLE001
            self._end_with(error)

    def _keep(self, row: _Row) -> None:
        if self._handle < 0:
            if time.monotonic() < self._retry_s:
                self.lost_rows += 1
                return
            self._begin_file()
            self._incident = f"{self._failure}; it goes on in {self._path}"
            self._failure = ""
        elif self._size >= self._config.recorder.max_file_size:
            self._complete_file()
            self._begin_file()
        self._write_row(row)
        self._rows += 1

    def _look(self) -> None:
        """Go on in a new file where the one at hand is not in its place, or not as it was written."""
        if self._handle < 0 or time.monotonic() < self._look_s:
            return
        self._look_s = time.monotonic() + LOOK_s
        why = self._changed()
        if not why:
            return
        if os.fstat(self._handle).st_nlink:
            self._leave()
            self._begin_file()
        else:  # the open file is all that is left of it
            left, rows, self._handle = self._handle, self._rows, -1
            self._part_number -= 1
            try:
                self._begin_file(left)
            finally:
                os.close(left)
                self.lost_rows += rows - self._rows
        self._incident = f"{why}; the bench log goes on in {self._path}"

    def _changed(self) -> str:
        """What has become of the file at hand, or ""."""
        for name, inode in self._own.items():
            try:
                found = os.lstat(self._folder / name)
            except PermissionError:
                continue  # the rows are written all the same
            except (FileNotFoundError, NotADirectoryError):
                return f"{self._folder / name} was removed or moved"
            if not stat.S_ISREG(found.st_mode) or found.st_ino != inode:
                return f"{self._folder / name} was replaced"
        if os.fstat(self._handle).st_size != self._size:
            return f"{self._folder / next(iter(self._own))} was changed by somebody else"
        return ""

    def _write_row(self, row: _Row) -> None:
        numbers, event = row
        quoted = '"' + event.replace('"', "'").replace("\n", " ") + '"' if event else ""
        values = ",".join([repr(v) if type(v) is int else repr(float(v)) for v in numbers])
        self._write(f"{values},{quoted}\n".encode())

    def _write(self, data: bytes) -> None:
        self._size += len(data)
        while data:
            data = data[os.write(self._handle, data) :]  # a disk that fills takes a part of it

    def _begin_file(self, left: int = -1) -> None:
        """Open the next file, with its header, and its metadata beside it; remove the oldest where there are too many.

        With the rows of the file ``left`` that is open still.
        """
        self._rows = 0
        self._folder.mkdir(parents=True, exist_ok=True)
        started = datetime.datetime.now().astimezone()
        self._part_number += 1
        metadata = {
            "recorded_by": self._name,
            "recording": self._recording,
            "part": self._part_number,
            "started": started.isoformat(timespec="seconds"),
            "wire": self._config.wire.size,
            "parameters": self._config.to_mapping(),
        }
        with self._manifest.changing() as files:
            self._remove_oldest(files)
            stem = self._free_stem(started)
            log, beside = stem + ".csv", stem + ".json"
            try:
                part = self._folder / (log + PART)
                self._handle = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
                fcntl.flock(self._handle, fcntl.LOCK_EX)  # says that its writer lives
                files[log] = os.fstat(self._handle).st_ino
                with (self._folder / beside).open("x", encoding="utf-8") as stream:
                    files[beside] = os.fstat(stream.fileno()).st_ino
                    json.dump(metadata, stream, indent=1)
                self._own = {log + PART: files[log], beside: files[beside]}
                self._size = 0
                self._write((",".join((*self.columns, EVENT_COLUMN)) + "\n").encode())
                if left >= 0:
                    self._copy_rows(left)
            except BaseException:
                self._manifest.remove(files, beside)
                if self._handle >= 0:
                    part.unlink()
                    os.close(self._handle)
                    self._handle = -1
                files.pop(log, None)
                raise

    def _copy_rows(self, left: int) -> None:
        """Every row of a file that begins with the same header."""
        at = self._size
        while data := os.pread(left, 1 << 20, at):
            self._write(data)
            at += len(data)
            self._rows += data.count(b"\n")

    def _free_stem(self, started: datetime.datetime) -> str:
        """A name that no file has: a recorder of the same process may have begun in the same second."""
        while True:
            self._number += 1
            stem = f"{self._name}_{started:%Y%m%d_%H%M%S}_{os.getpid()}_{self._number:04d}"
            if not any(os.path.lexists(self._folder / (stem + end)) for end in (".csv", ".csv" + PART, ".json")):
                return stem

    def _complete_file(self) -> None:
        if self._handle >= 0:
            os.fsync(self._handle)
            self._leave()

    def _leave(self) -> None:
        """Give up the file at hand, complete, wherever it is now; rows that are not in it are lost."""
        handle, self._handle, kept = self._handle, -1, 0
        with contextlib.suppress(OSError):
            found = os.fstat(handle)
            if found.st_nlink:
                kept = self._rows if found.st_size == self._size else max(0, _lines(handle) - 1)
        with contextlib.suppress(OSError):
            os.ftruncate(handle, _end_of_last_line(handle))
        with contextlib.ExitStack() as locked, contextlib.suppress(OSError):
            with contextlib.suppress(OSError, ConfigError):  # the folder may be elsewhere
                locked.enter_context(self._manifest.changing())
            self._give_name(Path(f"/proc/self/fd/{handle}").readlink())
        with contextlib.suppress(OSError):
            os.close(handle)
        if kept < self._rows:
            self.lost_rows += self._rows - kept
            self._begin_recording()

    def _begin_recording(self) -> None:
        """What follows is no part of what was before: its files have another number in common."""
        self._recording, self._part_number = str(uuid.uuid4()), 0

    def _end_with(self, error: Exception) -> None:
        """Go on without a log for a while: say why, and keep what is whole of the file at hand."""
        why = error.strerror or error if isinstance(error, OSError) else error
        self._failure = f"the bench log in {self._folder} ended: {why}"
        self._retry_s = time.monotonic() + RETRY_s
        if self._handle >= 0:
            self._leave()
        self._begin_recording()

    def _give_name(self, part: Path) -> None:
        """Take ``.part`` off a name, unless there is somebody's file of the name it would have."""
        path = part.with_suffix("")
        if part.suffix != PART:
            return  # somebody has given it one
        if os.path.lexists(path):
            _log.warning("%s: %s is complete, but %s exists already and is not the recorder's", self._name, part, path)
        else:
            part.rename(path)

    def _remove_oldest(self, files: Files) -> None:
        """Leave room for one more log, and forget files that are gone."""
        for name in list(files):
            if not (self._manifest.is_own(files, name) or self._is_part(files, name)):
                del files[name]
        logs = [name for name in files if name.endswith(".csv")]
        for name in logs[: max(0, len(logs) - (self._config.recorder.max_files - 1))]:
            if self._is_part(files, name):
                continue  # a recorder that lives is writing it
            self._manifest.remove(files, name)
            self._manifest.remove(files, name.removesuffix(".csv") + ".json")
            _log.warning(
                "%s: removed the oldest log, %s (recorder.max_files is %d)",
                self._name,
                self._folder / name,
                self._config.recorder.max_files,
            )

    def _is_part(self, files: Files, name: str) -> bool:
        return self._manifest.is_own({name + PART: files[name]}, name + PART)

    def _complete_left_behind(self) -> None:
        """Give the files of a killed recorder their name, without a last line that is half written."""
        with self._manifest.changing() as files:
            for name in files:
                if not self._is_part(files, name):
                    continue
                path = self._folder / (name + PART)
                handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW)
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except OSError:
                    continue  # its writer lives
                else:
                    os.ftruncate(handle, _end_of_last_line(handle))
                    self._give_name(path)
                    _log.warning(
                        "%s: who wrote %s was killed, crashed or lost its folder; the log goes as far as it came",
                        self._name,
                        path.with_suffix(""),
                    )
                finally:
                    os.close(handle)


def _lines(handle: int) -> int:
    at = count = 0
    while data := os.pread(handle, 1 << 20, at):
        at += len(data)
        count += data.count(b"\n")
    return count


def _end_of_last_line(handle: int) -> int:
    size = os.fstat(handle).st_size
    start = max(0, size - 65536)
    return start + os.pread(handle, 65536, start).rfind(b"\n") + 1


def recorded_row(reading: Reading, output: Output) -> dict[str, float]:
    """One row of the driver's own bench log, by column."""
    return {name: getattr(reading, name) for name in COLUMNS if hasattr(reading, name)} | {
        "tare_N": output.tare_N,
        "current_command_A": output.command.current_A,
        "setpoint_m": output.setpoint_m,
        "displacement_estimate_m": output.estimate.displacement_m,
        "velocity_estimate_m_s": output.estimate.velocity_m_s,
        "branch": int(output.estimate.branch),
        "quality": int(output.estimate.quality),
        "output_on": int(output.command.output_on),
    }


#: Every column that :func:`recorded_row` may give.
RECORDED_COLUMNS = (
    *(name for name in COLUMNS if name in Reading.__dataclass_fields__ or name in ("tare_N", "current_command_A")),
    "setpoint_m",
    *ESTIMATE_COLUMNS,
)


def _columns(config: RecorderSections) -> tuple[str, ...]:
    """Columns of a log of this actuator; a channel that is not wired has none."""
    wired = {
        "lvdt_current_A": config.instruments.daq.lvdt_channel != 0,
        "ambient_temperature_C": config.instruments.daq.ambient_temperature_channel != 0,
        "current_command_A": True,
        "setpoint_m": True,
    }
    return tuple(name for name in COLUMNS if name in _ALWAYS or wired.get(name, False)) + ESTIMATE_COLUMNS
