"""Bench logs: what was measured on a wire, in a CSV file with the units in the column names.

One header row, one row per reading.  The columns of :data:`COLUMNS` are known; any other is kept.
``load_N`` may stand instead of ``load_cell_voltage_V`` and ``displacement_m`` instead of
``lvdt_current_A``.  What was known when the log was made (the wire, the load, the part of the
experiment) stands beside it in a JSON file of the same name.

Comma, semicolon or tab between the fields; a decimal comma is understood where the separator is
not a comma.  A byte order mark and Windows line ends are accepted.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import os
import tempfile
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sma_actuator.base.errors import UserError
from sma_actuator.base.signals import Reading, Signals
from sma_actuator.estimation.circuit import signals_from_reading

if TYPE_CHECKING:
    from sma_actuator.config import Config


class BenchLogError(UserError, ValueError):
    """A log that cannot be used.  The message names file, line and column, and what would be right."""


@dataclass(frozen=True, slots=True)
class _Column:
    lo: float  #: a smaller value cannot be in this unit
    hi: float  #: nor a larger one
    hint: str  #: what such a value usually means


#: The columns that mean something here, in the order in which they are written.
COLUMNS: dict[str, _Column] = {
    "time_s": _Column(-math.inf, math.inf, ""),
    "supply_voltage_V": _Column(-100.0, 100.0, "is it in millivolts?"),
    "reference_voltage_V": _Column(-20.0, 20.0, "is it in millivolts?"),
    "load_cell_voltage_V": _Column(-100.0, 100.0, "is it in millivolts?"),
    "load_N": _Column(-1e4, 1e4, "is it in grams?"),
    "lvdt_current_A": _Column(-1.0, 1.0, "is it in milliamperes?"),
    "displacement_m": _Column(-0.5, 0.5, "is it in millimetres?"),
    "current_command_A": _Column(-20.0, 20.0, "is it in milliamperes?"),
    "ambient_temperature_C": _Column(-60.0, 100.0, "is it in kelvin or fahrenheit?"),
    "setpoint_m": _Column(-0.5, 0.5, "is it in millimetres?"),
}
_ALWAYS = (("time_s",), ("supply_voltage_V",), ("reference_voltage_V",), ("load_cell_voltage_V", "load_N"))
_REFERENCE = ("lvdt_current_A", "displacement_m")
_MAY_BE_NAN = {"ambient_temperature_C", "setpoint_m", "current_command_A"}
_SLOWEST_PERIOD_s = 1.0  #: a wire moves through its stroke within seconds
_CHUNK_BYTES = 8_000_000
_SEPARATORS = {b",": "comma", b";": "semicolon", b"\t": "tab"}


@dataclass(frozen=True, slots=True)
class BenchLog:
    """A log in memory: every column an array of shape (n,), float64, in the unit its name ends with."""

    columns: Mapping[str, np.ndarray]
    metadata: Mapping[str, Any] = field(default_factory=dict)
    source: str = "(in memory)"

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(self.columns["time_s"])

    @property
    def name(self) -> str:
        """Short name for tables: the file name without its folder."""
        return Path(self.source).name

    @property
    def period_s(self) -> float:
        """Median time between two readings."""
        return float(np.median(np.diff(self["time_s"][:100_001]))) if len(self) > 1 else math.nan

    @property
    def has_reference(self) -> bool:
        """Whether the displacement was measured."""
        return any(name in self for name in _REFERENCE)

    def slice(self, start: int, stop: int) -> BenchLog:
        """The readings start … stop−1 as a log (views, not copies)."""
        return dataclasses.replace(self, columns={k: v[start:stop] for k, v in self.columns.items()})


def read_bench_log(
    path: str | Path, allow_gaps: bool = False, progress: Callable[[float], None] | None = None
) -> BenchLog:
    """Read a bench log.

    ``allow_gaps`` accepts readings that are NaN and pauses in time, as logs of a robot have them
    (the estimator bridges them); without it they are refused.  ``progress`` is called with the
    fraction read.  A column that holds nothing but NaN counts as absent.

    Raises BenchLogError with one sentence naming file, line and column.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            columns = _parse(stream, path, progress)
    except OSError as error:
        raise BenchLogError(
            f"{path}: cannot be read ({error.strerror or error}); a bench log (CSV) is wanted"
        ) from error
    columns = {name: values for name, values in columns.items() if not len(values) or not np.isnan(values).all()}
    log = BenchLog(columns, _read_metadata(path), str(path))
    check_bench_log(log, allow_gaps)
    return log


def write_bench_log(path: str | Path, log: BenchLog) -> None:
    """Write a log, and its metadata beside it, so that neither is ever half a file."""
    path = Path(path)
    names = [n for n in COLUMNS if n in log] + [n for n in log.columns if n not in COLUMNS]
    formats = ["%.6f" if n == "time_s" else "%.9g" for n in names]

    def write(stream):
        stream.write(",".join(names).encode() + b"\n")
        row = ",".join(formats) + "\n"
        for start in range(0, len(log), 50_000):
            block = np.column_stack([log[n][start : start + 50_000] for n in names])
            stream.write((row * len(block) % tuple(block.ravel())).encode())

    if log.metadata:
        text = json.dumps(dict(log.metadata), indent=1, allow_nan=False) + "\n"
        write_atomically(_metadata_path(path), lambda stream: stream.write(text.encode()))
    write_atomically(path, write)


def write_atomically(path: str | Path, write: Callable[[Any], Any]) -> None:
    """Call ``write`` with a binary stream; the file appears under its name only when all of it is on disk."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            write(stream)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, 0o644)  # mkstemp gives 0600
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def to_reading(log: BenchLog, config: Config) -> Reading:
    """The log as one Reading whose fields are arrays of shape (n,).

    Where the log holds ``load_N`` or ``displacement_m``, the calibrations of ``config`` are undone
    to get the raw channel, so that ``signals_from_reading`` gives the logged value again.
    """
    missing = np.full(len(log), np.nan)
    if "load_cell_voltage_V" in log:
        load_cell_V = log["load_cell_voltage_V"]
    else:
        load_cell_V = (log["load_N"] - config.load_cell.offset) / config.load_cell.slope
    if "lvdt_current_A" in log:
        lvdt_A = log["lvdt_current_A"]
    elif "displacement_m" in log and config.reference_sensor.fitted:
        lvdt_A = (log["displacement_m"] - config.reference_sensor.offset) / config.reference_sensor.slope
    else:
        lvdt_A = missing
    return Reading(
        time_s=log["time_s"],
        supply_voltage_V=log["supply_voltage_V"],
        reference_voltage_V=log["reference_voltage_V"],
        load_cell_voltage_V=load_cell_V,
        lvdt_current_A=lvdt_A,
        ambient_temperature_C=log.columns.get("ambient_temperature_C", missing),
    )


def signals_from_log(log: BenchLog, config: Config) -> Signals:
    """Physical quantities of a whole log, arrays of shape (n,), with ``config``'s calibrations.

    ``displacement_m`` in the log is used as it is, also where ``config`` has no reference sensor.
    """
    signals = signals_from_reading(to_reading(log, config), config)
    if "lvdt_current_A" not in log and "displacement_m" in log:
        signals = dataclasses.replace(signals, reference_displacement_m=log["displacement_m"])
    return signals


def check_bench_log(log: BenchLog, allow_gaps: bool = False) -> None:
    """Raise BenchLogError where a log lacks columns, or holds values or times that cannot be."""
    source = log.source
    for alternatives in _ALWAYS:
        if not any(name in log for name in alternatives):
            raise BenchLogError(f"{source}: line 1: {_missing_column(alternatives, log)}")
    if len(log) == 0:
        raise BenchLogError(f"{source}: line 2: there are no readings after the header row")
    time_s = log["time_s"]
    if not np.isfinite(time_s).all():
        raise BenchLogError(
            f"{source}: line {_first(~np.isfinite(time_s))}, column time_s: a time is missing or not finite"
        )
    step_s = np.diff(time_s)
    if (step_s <= 0.0).any():
        bad = int(np.argmax(step_s <= 0.0))
        word = "stands still" if step_s[bad] == 0.0 else "runs back"
        raise BenchLogError(
            f"{source}: line {bad + 3}, column time_s: time {word}, {time_s[bad]:.6g} s then {time_s[bad + 1]:.6g} s; "
            "times must increase (split a file that holds several recordings)"
        )
    period_s = log.period_s
    if period_s >= _SLOWEST_PERIOD_s:
        raise BenchLogError(
            f"{source}: line 3, column time_s: {period_s:.4g} s from one reading to the next is too slow for a wire; "
            "is the time in milliseconds?"
        )
    for name, values in log.columns.items():
        known = COLUMNS.get(name)
        if known is None or name == "time_s":
            continue
        outside = (values < known.lo) | (values > known.hi)
        if outside.any():
            bad = int(np.argmax(outside))
            unit = name.rsplit("_", 1)[1].replace("C", "°C")
            raise BenchLogError(
                f"{source}: line {bad + 2}, column {name}: {values[bad]:.6g} {unit} cannot be "
                f"({known.lo:g} to {known.hi:g} {unit} is possible); {known.hint}"
            )
        if not allow_gaps and name not in _MAY_BE_NAN and not np.isfinite(values).all():
            raise BenchLogError(
                f"{source}: line {_first(~np.isfinite(values))}, column {name}: not a finite number; cut the log "
                "there, or allow gaps"
            )
    if not allow_gaps and len(step_s) and step_s.max() > (limit_s := max(10.0 * period_s, 0.5)):
        bad = int(np.argmax(step_s > limit_s))
        raise BenchLogError(
            f"{source}: line {bad + 3}, column time_s: a gap, {step_s[bad]:.4g} s without a reading where the "
            f"period is {period_s:.4g} s; "
            "split the log there, or allow gaps"
        )


def require_reference(log: BenchLog) -> None:
    """Raise BenchLogError where the displacement was not measured."""
    if not log.has_reference:
        raise BenchLogError(
            f"{log.source}: line 1: {_missing_column(_REFERENCE, log)}: nothing to compare an estimate with"
        )


def _first(mask: np.ndarray) -> int:
    """Line of the file (the header is line 1) where ``mask`` is first true."""
    return int(np.argmax(mask)) + 2


def _missing_column(alternatives: tuple[str, ...], log: BenchLog) -> str:
    unknown = [name for name in log.columns if name not in COLUMNS]
    near = [
        (n, w)
        for w in alternatives
        for n in difflib.get_close_matches(w.lower(), [u.lower() for u in unknown], n=1, cutoff=0.6)
    ]
    wanted = " or ".join(alternatives)
    if near:
        written = next(u for u in unknown if u.lower() == near[0][0])
        return f"column {near[0][1]} is missing; '{written}' is near it, rename it if it is that, in that unit"
    return f"column {wanted} is missing (or holds no number); found {', '.join(log.columns)}"


def _metadata_path(path: Path) -> Path:
    return path.with_suffix(".json")


def _read_metadata(path: Path) -> dict[str, Any]:
    beside = _metadata_path(path)
    if not beside.exists():
        return {}
    try:
        metadata = json.loads(beside.read_text(encoding="utf-8"))
    except ValueError as error:
        raise BenchLogError(f"{beside}: is not JSON ({error}); it describes {path.name}") from error
    if not isinstance(metadata, dict):
        raise BenchLogError(f"{beside}: holds no JSON object; it describes {path.name}")
    return metadata


# --- reading -------------------------------------------------------------------------------------


def _parse(stream, path: Path, progress) -> dict[str, np.ndarray]:
    """All columns of the file, as rows of one array of shape (columns, n): n is counted first, so
    that a log of any length needs little more memory than its columns."""
    header = stream.readline(1_000_000)
    if header.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise BenchLogError(f"{path}: line 1: the file is UTF-16; save it as UTF-8")
    header = header.removeprefix(b"\xef\xbb\xbf").rstrip(b"\r\n")
    if not header.strip():
        raise BenchLogError(f"{path}: line 1: the file is empty; a header row with the columns is wanted")
    separator = max(_SEPARATORS, key=header.count)
    try:
        names = [n.strip().strip('"') for n in header.decode("utf-8").split(separator.decode())]
    except UnicodeDecodeError as error:
        raise BenchLogError(f"{path}: line 1: is not text in UTF-8; a CSV file is wanted") from error
    if all(_is_number(n) for n in names):
        raise BenchLogError(f"{path}: line 1: numbers where the header row with the columns' names is wanted")
    for i, name in enumerate(names):
        if not name or name in names[:i]:
            what = f"the column '{name}' stands twice" if name else f"column {i + 1} has no name"
            raise BenchLogError(f"{path}: line 1: {what}")
    start = stream.tell()
    total_bytes = max(1, os.fstat(stream.fileno()).st_size - start)
    rows = sum(block.count(b"\n") for block in iter(lambda: stream.read(_CHUNK_BYTES), b"")) + 1
    stream.seek(start)
    values = np.empty((len(names), rows))
    parser = _ChunkParser(path, names, separator)
    filled, rest = 0, b""
    while True:
        block = stream.read(_CHUNK_BYTES)
        end = len(block) < _CHUNK_BYTES
        block = rest + block
        cut = len(block) if end else block.rfind(b"\n") + 1
        block, rest = block[:cut], block[cut:]
        parsed = parser.parse(block, first_line=filled + 2)
        values[:, filled : filled + len(parsed)] = parsed.T
        filled += len(parsed)
        if progress:
            progress((stream.tell() - start) / total_bytes)
        if end:
            return dict(zip(names, values[:, :filled]))


class _ChunkParser:
    """Turns whole lines into numbers: all at once where they are regular, one by one where not."""

    def __init__(self, path: Path, names: list[str], separator: bytes):
        self.path, self.names, self.separator = path, names, separator
        translation = b",;\t\n" if separator == b"," else b".,\t\n" if separator == b";" else b".;,\n"
        self._table = bytes.maketrans(b",;\t\n", translation)

    def parse(self, block: bytes, first_line: int) -> np.ndarray:
        """Numbers of the lines in ``block``, shape (lines, columns)."""
        block = block.replace(b"\r\n", b"\n").rstrip(b"\n ")
        if not block:
            return np.empty((0, len(self.names)))
        table = block.translate(self._table)
        width = len(self.names)
        characters = np.frombuffer(table, np.uint8)
        ends = np.flatnonzero((characters == ord(",")) | (characters == ord("\n")))
        newline = characters[ends] == ord("\n")
        lines = np.count_nonzero(newline) + 1
        if len(ends) == lines * width - 1 and newline[width - 1 :: width].all():
            with warnings.catch_warnings():
                warnings.simplefilter("error", DeprecationWarning)  # numpy's way to say: not all of it was numbers
                try:
                    numbers = np.fromstring(table.replace(b"\n", b","), sep=",")
                    if len(numbers) == lines * width:
                        return numbers.reshape(lines, width)
                except (DeprecationWarning, ValueError):
                    pass
        return self._parse_lines(block.decode("utf-8", errors="replace").split("\n"), first_line)

    def _parse_lines(self, lines: list[str], first_line: int) -> np.ndarray:
        out = np.empty((len(lines), len(self.names)))
        separator = self.separator.decode()
        for i, line in enumerate(lines):
            fields = line.strip("\r").split(separator)
            place = f"{self.path}: line {first_line + i}"
            if len(fields) != len(self.names):
                help_ = ""
                if separator == "," and len(fields) > len(self.names):
                    help_ = "; decimal commas need a semicolon between the fields"
                elif i == len(lines) - 1:
                    help_ = "; was the file cut off?"
                raise BenchLogError(f"{place}: {len(fields)} fields where the header has {len(self.names)}{help_}")
            for j, text in enumerate(fields):
                text = text.strip().strip('"')
                if separator != ",":
                    text = text.replace(",", ".")
                try:
                    out[i, j] = float(text) if text else math.nan
                except ValueError:
                    raise BenchLogError(f"{place}, column {self.names[j]}: '{text}' is not a number") from None
        return out


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
