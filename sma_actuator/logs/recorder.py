"""The driver's own bench log: every reading and what was made of it, as CSV that every tool reads.

Rows go through a bounded queue to a thread of their own, so that a slow disk costs rows, which are
counted, and never time in the loop.  A file is called ``….csv.part`` while it is written and
``….csv`` when it is complete; it is flushed whenever the queue is empty, so a killed process loses
next to nothing, and the next recorder on that folder completes what was left behind.
"""

from __future__ import annotations

import contextlib
import datetime
import fcntl
import json
import logging
import os
import queue
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING

from sma_actuator.base.parameters import ConfigError, parameter
from sma_actuator.base.signals import Reading

from .bench_log import COLUMNS

if TYPE_CHECKING:
    from sma_actuator.config import Config

if TYPE_CHECKING:
    from sma_actuator.actuator import Output

_log = logging.getLogger(__name__)

#: What the estimator made of the reading, beside the columns every bench log has.
ESTIMATE_COLUMNS = ("displacement_estimate_m", "velocity_estimate_m_s", "branch", "quality", "output_on")
_ALWAYS = ("time_s", "supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V")
_PART = ".part"
_STOP = None


@dataclass(frozen=True, slots=True)
class RecorderParameters:
    """Where and how much is recorded."""

    folder: str = parameter("", "folder for bench logs; empty: none are written", optional=True)
    max_file_size: int = parameter(50_000_000, "size at which a new file is begun", "B", 10_000, 10**12)
    max_files: int = parameter(20, "files kept; the oldest go first", "1", 1, 100000)


class BenchLogRecorder:
    """Writes the bench log of one wire into ``config.recorder.folder``.

    ``current_command_A`` is the command that followed the reading; it acts until the next row.
    Raises ConfigError where the folder cannot be made or written.
    """

    def __init__(self, config: Config, name: str = "sma_actuator", queue_rows: int = 10_000):
        self.dropped_rows = 0
        self.problem = ""  #: why nothing is written any more
        self.columns = _columns(config)
        self._config = config
        self._name = name.strip("/").replace("/", "_")
        self._folder = Path(config.recorder.folder).expanduser()
        self._last_time_s = float("-inf")
        self._number = 0
        self._size = 0
        self._file: IO[bytes] | None = None
        self._queue: queue.Queue[tuple[float, ...] | None] = queue.Queue(queue_rows)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._complete_left_behind()
            self._begin_file()
        except OSError as error:
            raise ConfigError(
                f"recorder.folder: {self._folder} cannot be written ({error.strerror}); a folder this process may write is wanted"
            ) from error
        self._thread = threading.Thread(target=self._run, name=f"{name} recorder", daemon=True)
        self._thread.start()

    def record(self, reading: Reading, output: Output) -> None:
        """Queue one row; where the queue is full the row is dropped and counted."""
        if not reading.time_s > self._last_time_s:
            return  # the same block again: a log's times increase
        self._last_time_s = reading.time_s
        row = {name: getattr(reading, name) for name in COLUMNS if hasattr(reading, name)} | {
            "current_command_A": output.command.current_A,
            "setpoint_m": output.setpoint_m,
            "displacement_estimate_m": output.estimate.displacement_m,
            "velocity_estimate_m_s": output.estimate.velocity_m_s,
            "branch": output.estimate.branch,
            "quality": output.estimate.quality,
            "output_on": output.command.output_on,
        }
        try:
            self._queue.put_nowait(tuple(row[name] for name in self.columns))
        except queue.Full:
            self.dropped_rows += 1

    def close(self, timeout_s: float = 5.0) -> None:
        """Write what is queued, complete the file and end the thread.  May be called twice."""
        if self._thread.is_alive():
            with contextlib.suppress(queue.Full):
                self._queue.put(_STOP, timeout=timeout_s)
            self._thread.join(timeout_s)
        if self.dropped_rows:
            _log.warning("%s: %d rows of the bench log were dropped", self._name, self.dropped_rows)

    # --- in the recorder's thread -----------------------------------------------------------------

    def _run(self) -> None:
        try:
            while (row := self._queue.get()) is not _STOP:
                self._write_row(row)
                if self._queue.empty():
                    self._file.flush()
                if self._size >= self._config.recorder.max_file_size:
                    self._complete_file()
                    self._begin_file()
            self._complete_file()
        except OSError as error:
            self.problem = f"the bench log in {self._folder} ended: {error.strerror or error}"
            _log.error("%s: %s", self._name, self.problem)
            self.dropped_rows += 1  # the row at hand
            while self._queue.get() is not _STOP:
                self.dropped_rows += 1

    def _write_row(self, row: tuple[float, ...]) -> None:
        line = (f"{row[0]:.6f}," + ",".join(f"{value:.9g}" for value in row[1:]) + "\n").encode()
        self._file.write(line)
        self._size += len(line)

    def _begin_file(self) -> None:
        """Open the next file, with its header, and its metadata beside it."""
        started = datetime.datetime.now().astimezone()
        self._number += 1
        stem = f"{self._name}_{started:%Y%m%d_%H%M%S}_{os.getpid()}_{self._number:04d}"
        self._file = (self._folder / f"{stem}.csv{_PART}").open("xb")
        fcntl.flock(self._file, fcntl.LOCK_EX)  # says that its writer lives
        header = (",".join(self.columns) + "\n").encode()
        self._file.write(header)
        self._file.flush()
        self._size = len(header)
        metadata = {
            "recorded_by": self._name,
            "started": started.isoformat(timespec="seconds"),
            "wire": self._config.to_mapping()["wire"],
            "parameters": self._config.to_mapping(),
        }
        (self._folder / f"{stem}.json").write_text(json.dumps(metadata, indent=1) + "\n", encoding="utf-8")
        self._remove_oldest()

    def _complete_file(self) -> None:
        path = Path(self._file.name)
        self._file.flush()
        os.fsync(self._file.fileno())
        path.rename(path.with_suffix(""))
        self._file.close()

    def _remove_oldest(self) -> None:
        files = sorted(self._folder.glob(f"{self._name}_*.csv"), key=lambda path: (path.stat().st_mtime_ns, path.name))
        for path in files[: max(0, len(files) - (self._config.recorder.max_files - 1))]:
            path.unlink(missing_ok=True)
            path.with_suffix(".json").unlink(missing_ok=True)

    def _complete_left_behind(self) -> None:
        """Give the files of a killed recorder their name, without a last line that is half written."""
        for path in self._folder.glob(f"{self._name}_*.csv{_PART}"):
            with path.open("r+b") as stream:
                try:
                    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except OSError:
                    continue  # its writer lives
                content_end = _end_of_last_line(stream)
                stream.truncate(content_end)
                path.rename(path.with_suffix(""))


def _end_of_last_line(stream: IO[bytes]) -> int:
    size = stream.seek(0, os.SEEK_END)
    start = max(0, size - 65536)
    stream.seek(start)
    return start + stream.read().rfind(b"\n") + 1


def _columns(config: Config) -> tuple[str, ...]:
    """Columns of a log of this actuator; a channel that is not wired has none."""
    wired = {
        "lvdt_current_A": config.instruments.daq.lvdt_channel != 0,
        "ambient_temperature_C": config.instruments.daq.ambient_temperature_channel != 0,
        "current_command_A": True,
        "setpoint_m": True,
    }
    return tuple(name for name in COLUMNS if name in _ALWAYS or wired.get(name, False)) + ESTIMATE_COLUMNS
