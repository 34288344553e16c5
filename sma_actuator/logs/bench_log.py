"""Bench logs: what was measured on a wire, in a CSV file with the units in the column names.

One header row, one row per reading.  The columns of :data:`COLUMNS` are known; any other is kept.  What was
measured may stand in several ways: resistance and current as voltages over the circuit and its sense resistor, as
voltage and current of the wire, or as they are; the load and the displacement raw or in N and m.  What was known
when the log was made (the wire, the load, the part of the experiment) stands beside it in a JSON file of the same name.
"""

from __future__ import annotations

import dataclasses
import datetime
import difflib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np

from sma_actuator.base.content import json_of
from sma_actuator.base.errors import named
from sma_actuator.base.sections import SupplyParameters
from sma_actuator.base.signals import Reading, Signals
from sma_actuator.estimation.circuit import CircuitSections, signals_from_reading, without_undriven

from .errors import BenchLogError
from .files import write_atomically
from .tables import EVENT_COLUMN, Table
from .text import read_text


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
    "wire_voltage_V": _Column(-100.0, 100.0, "is it in millivolts?"),
    "current_A": _Column(-20.0, 20.0, "is it in milliamperes?"),
    "resistance_Ohm": _Column(-1e4, 1e4, "is it in milliohms?"),
    "power_W": _Column(-1e3, 1e3, "is it in milliwatts?"),
    "tare_N": _Column(-1e4, 1e4, "is it in grams?"),
    "load_N": _Column(-1e4, 1e4, "is it in grams?"),
    "lvdt_current_A": _Column(-1.0, 1.0, "is it in milliamperes?"),
    "displacement_m": _Column(-0.5, 0.5, "is it in millimetres?"),
    "current_command_A": _Column(-20.0, 20.0, "is it in milliamperes?"),
    "ambient_temperature_C": _Column(-60.0, 100.0, "is it in kelvin or fahrenheit?"),
    "setpoint_m": _Column(-0.5, 0.5, "is it in millimetres?"),
}
#: Pairs of columns that tell resistance and current; the first that is there counts.
ELECTRICAL = (
    ("supply_voltage_V", "reference_voltage_V"),
    ("resistance_Ohm", "current_A"),
    ("resistance_Ohm", "reference_voltage_V"),
    ("resistance_Ohm", "power_W"),
    ("wire_voltage_V", "current_A"),
    ("wire_voltage_V", "reference_voltage_V"),
    ("wire_voltage_V", "power_W"),
    ("power_W", "current_A"),
)
LOAD = ("load_cell_voltage_V", "load_N")
REFERENCE = ("lvdt_current_A", "displacement_m")
_MAY_BE_NAN = {"ambient_temperature_C", "setpoint_m", "current_command_A"}
_SLOWEST_PERIOD_s = 1.0  #: a wire moves through its stroke within seconds


@dataclass(frozen=True, slots=True)
class BenchLog:
    """A log in memory: every column an array of shape (n,), float64, in the unit its name ends with."""

    columns: Mapping[str, np.ndarray]
    metadata: Mapping[str, Any] = field(default_factory=dict)
    source: str = "(in memory)"
    events: tuple[tuple[float, str], ...] = ()  #: time [s] of the row before which it happened, and what
    first_line: int = 2  #: of the file, where the readings begin
    began: datetime.datetime | None = None  #: when its clock was at zero, where its stamps are dates

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
        return any(name in self for name in REFERENCE)

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
    log = log_of(read_text(path, progress), read_metadata(path))
    check_bench_log(log, allow_gaps)
    return log


def log_of(table: Table, metadata: Mapping[str, Any]) -> BenchLog:
    """A table whose columns have the names used here, as a log, unchecked; empty columns are left out."""
    columns = {n: values for n, values in table.columns.items() if not len(values) or not np.isnan(values).all()}
    time_s = columns.get("time_s", np.empty(0))
    events = tuple((float(time_s[row]), text) for row, text in sorted(table.texts.items()) if row < len(time_s))
    return BenchLog(columns, metadata, table.source, events, table.first_line, table.moments.get("time_s"))


def write_bench_log(path: str | Path, log: BenchLog) -> None:
    """Write a log, and its metadata beside it, so that neither is ever half a file."""
    path = Path(path)
    names = [n for n in COLUMNS if n in log] + [n for n in log.columns if n not in COLUMNS]
    formats = ["%.6f" if n == "time_s" else "%.9g" for n in names]

    events = dict(log.events)

    def write(stream: IO[bytes]) -> None:
        stream.write(",".join([*names, EVENT_COLUMN] if events else names).encode() + b"\n")
        row = ",".join(formats) + "\n"
        for start in range(0, len(log), 50_000):
            block = np.column_stack([log[n][start : start + 50_000] for n in names])
            if not events:
                stream.write((row * len(block) % tuple(block.ravel())).encode())
                continue
            for values in block:
                event = events.get(float(values[0]), "")
                stream.write(
                    (
                        (row.rstrip() + ',"%s"\n') % (*values, event) if event else row.rstrip() % tuple(values) + ",\n"
                    ).encode()
                )

    if log.metadata:
        text = json.dumps(dict(log.metadata), indent=1, allow_nan=False) + "\n"
        write_atomically(_metadata_path(path), lambda stream: stream.write(text.encode()))
    write_atomically(path, write)


def to_reading(log: BenchLog) -> Reading:
    """The raw channels of a log as one Reading whose fields are arrays of shape (n,); NaN where there is none."""
    missing = np.full(len(log), np.nan)
    channels = [f.name for f in dataclasses.fields(Reading)]
    return Reading(**{name: log.columns.get(name, missing) for name in channels})


class LogSections(CircuitSections, Protocol):
    """The parameters that make physical quantities of a log."""

    @property
    def supply(self) -> SupplyParameters:
        """From which current on a row counts as driven."""


def signals_from_log(log: BenchLog, config: LogSections) -> Signals:
    """Physical quantities of a whole log, arrays of shape (n,), with ``config``'s calibrations.

    A wire that was not driven has no resistance; the tare is that of the log.  ``displacement_m`` in the log is used
    as it is, also where ``config`` has no reference sensor.
    """
    signals = signals_from_reading(to_reading(log), config, log.columns.get("tare_N", 0.0))
    pair = electrical_columns(log)
    if "reference_voltage_V" in pair and not math.isfinite(config.circuit.reference_resistance):
        raise BenchLogError(
            f"{log.source}: line 1, column reference_voltage_V: is the voltage over a sense resistor that is not "
            "known; circuit.reference_resistance in ohms is wanted (in the bench file, or --set "
            "circuit.reference_resistance=OHM)"
        )
    if pair != ELECTRICAL[0]:
        resistance_Ohm, current_A = _resistance_and_current(log, pair, config.circuit.reference_resistance)
        power_W = current_A * current_A * resistance_Ohm
        signals = dataclasses.replace(signals, resistance_Ohm=resistance_Ohm, current_A=current_A, power_W=power_W)
    if not ("load_cell_voltage_V" in log and config.load_cell.calibrated):
        if "load_N" not in log:
            raise BenchLogError(
                f"{log.source}: line 1, column load_cell_voltage_V: is the voltage of a load cell that is not "
                "calibrated; load_cell.slope in N/V and load_cell.offset in N are wanted (in the bench file, or --set "
                "load_cell.slope=… --set load_cell.offset=…), or a column load_N"
            )
        signals = dataclasses.replace(signals, load_N=log["load_N"], stress_Pa=log["load_N"] / config.wire.area_m2)
    if "displacement_m" in log and not ("lvdt_current_A" in log and config.reference_sensor.fitted):
        signals = dataclasses.replace(signals, reference_displacement_m=log["displacement_m"])
    if pair[0] == "resistance_Ohm":
        return signals  # however it was measured, it is one
    return without_undriven(signals, config.supply.bias_current)


def electrical_columns(log: BenchLog) -> tuple[str, str]:
    """The pair of columns that tells resistance and current.  Raises BenchLogError where there is none."""
    for pair in ELECTRICAL:
        if all(name in log for name in pair):
            return pair
    raise BenchLogError(f"{log.source}: line 1: {_missing_electrical(log)}")


def _resistance_and_current(log: BenchLog, pair: tuple[str, str], sense_Ohm: float) -> tuple[np.ndarray, np.ndarray]:
    """Resistance [Ω] and current [A] of the wire from any pair but the first."""
    first, second = log[pair[0]], log[pair[1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        if pair[1] == "reference_voltage_V":
            second = second / sense_Ohm
        if pair[0] == "resistance_Ohm":
            current_A = np.sqrt(second / first) if pair[1] == "power_W" else second
            return first, current_A
        if pair[0] == "wire_voltage_V":
            current_A = second / first if pair[1] == "power_W" else second
            resistance_Ohm = first / current_A
        else:
            current_A, resistance_Ohm = second, first / (second * second)
    return np.where(np.isfinite(resistance_Ohm), resistance_Ohm, np.nan), current_A


def uncalibrated_resistance_and_current(log: BenchLog) -> tuple[np.ndarray, np.ndarray]:
    """What rises with resistance and with current, where nothing is known of the circuit."""
    pair = electrical_columns(log)
    if pair != ELECTRICAL[0]:
        return _resistance_and_current(log, pair, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return log[pair[0]] / log[pair[1]], log[pair[1]]


def averaged(log: BenchLog, least_period_s: float = 0.02) -> BenchLog:
    """A log with readings closer together than so averaged, as many as make a step of it: what a wire does takes
    longer.

    Voltages and currents are averaged before anything is made of them, as a DAQ averages its blocks; blocks that hold a
    pause are left out.  Raises BenchLogError where all of it is shorter than that.
    """
    together = int(least_period_s / log.period_s * (1.0 + 1e-6)) if len(log) > 1 else 1
    if together < 2:
        return log
    if len(log) < together:
        lasts_s = log["time_s"][-1] - log["time_s"][0]
        raise BenchLogError(
            f"{log.source}: all of it lasts {lasts_s:.3g} s, in which no wire does anything; is the time in hours "
            "(--unit time_s=h)?"
        )
    rows = len(log) // together * together
    blocks = {name: values[:rows].reshape(-1, together) for name, values in log.columns.items()}
    whole = (np.diff(blocks["time_s"], axis=1) <= longest_pause_s(log)).all(axis=1)
    return dataclasses.replace(log, columns={name: values[whole].mean(axis=1) for name, values in blocks.items()})


def longest_pause_s(log: BenchLog) -> float:
    """Time between two readings above which nobody knows what the wire did meanwhile."""
    return max(10.0 * log.period_s, 0.5) if len(log) > 1 else np.inf


def with_rising_stamps(log: BenchLog, say: Callable[[str], None] = lambda sentence: None) -> BenchLog:
    """A log whose readings have stamps of their own; ``say`` is told.

    Rows that stand twice count once, and where a coarse clock gives several readings one stamp, they are spread until
    the next.  Time that runs back is left as it is.
    """
    time_s = log.columns.get("time_s", np.empty(0))
    if (
        len(time_s) < 2
        or not np.isfinite(time_s).all()
        or (np.diff(time_s) != 0.0).all()
        or (np.diff(time_s) < 0.0).any()
    ):
        return log
    table = np.column_stack(list(log.columns.values()))
    twice = np.zeros(len(time_s), dtype=bool)
    twice[1:] = ((table[1:] == table[:-1]) | (np.isnan(table[1:]) & np.isnan(table[:-1]))).all(axis=1)
    if twice.any():
        log = dataclasses.replace(log, columns={name: values[~twice] for name, values in log.columns.items()})
        time_s = log["time_s"]
        say(f"{log.name}: {np.count_nonzero(twice)} rows stand twice, with all they hold; each counts once")
    stamps, first = np.unique(time_s, return_index=True)
    if len(stamps) == len(time_s) or len(stamps) < 2:
        return log
    step_s = float(np.median(np.diff(stamps)))
    count = np.diff(np.append(first, len(time_s)))
    within = np.minimum(np.append(np.diff(stamps), step_s), step_s)  # a pause is none of theirs
    place = (np.arange(len(time_s)) - np.repeat(first, count)) / np.repeat(count, count)
    spread_s = np.repeat(stamps, count) + place * np.repeat(within, count)
    say(
        f"{log.name}: {len(time_s) - len(stamps)} readings have the stamp of the one before, as of a clock with steps "
        f"of {step_s:.3g} s; they are spread evenly until the next stamp"
    )
    return dataclasses.replace(log, columns={**log.columns, "time_s": spread_s})


def with_slow_load_filled(log: BenchLog, say: Callable[[str], None] = lambda sentence: None) -> BenchLog:
    """A log with a load at every row, also where the instrument that measures it is slower; ``say`` is told.

    A load with readings in fewer than half of the rows is so: between two of them stands what lies on the line that
    joins them, unless one is missing there.  Of voltage and current that would be wrong wherever one is switched.
    """
    time_s, columns = log["time_s"], dict(log.columns)
    for name in [name for name in LOAD if name in columns]:
        known = np.flatnonzero(np.isfinite(columns[name]))
        step_s = np.diff(time_s[known])
        if not 2 <= len(known) < 0.5 * len(log) or (usual_s := float(np.median(step_s))) > _SLOWEST_PERIOD_s:
            continue
        gap_s = step_s[np.clip(np.searchsorted(known, np.arange(len(log))), 1, len(known) - 1) - 1]
        line = np.interp(time_s, time_s[known], columns[name][known], left=np.nan, right=np.nan)
        columns[name] = np.where((gap_s < 1.5 * usual_s) | np.isfinite(columns[name]), line, np.nan)
        say(f"{name} stands in {len(known) / len(log):.0%} of the rows; between them it is on the line that joins them")
    return dataclasses.replace(log, columns=columns)


def check_bench_log(log: BenchLog, allow_gaps: bool = False) -> None:
    """Raise BenchLogError where a log lacks columns, or holds values or times that cannot be."""
    source, first = log.source, log.first_line
    if "time_s" not in log:
        raise BenchLogError(f"{source}: line 1: {_missing_column(('time_s',), log)}")
    electrical_columns(log)
    if not any(name in log for name in LOAD):
        raise BenchLogError(
            f"{source}: line 1: {_missing_column(LOAD, log)}; of one weight all the time its number will do, as "
            "--map load_N=0.98"
        )
    if len(log) == 0:
        raise BenchLogError(f"{source}: line {first}: there are no readings after the header row")
    time_s = log["time_s"]
    if not np.isfinite(time_s).all():
        raise BenchLogError(
            f"{source}: line {first + int(np.argmin(np.isfinite(time_s)))}, column time_s: a time is missing or not "
            "finite"
        )
    step_s = np.diff(time_s)
    if (step_s <= 0.0).any():
        bad = int(np.argmax(step_s <= 0.0))
        word = "stands still" if step_s[bad] == 0.0 else "runs back"
        raise BenchLogError(
            f"{source}: line {first + bad + 1}, column time_s: time {word}, {time_s[bad]:.6g} s then "
            f"{time_s[bad + 1]:.6g} s; times must increase (split a file that holds several recordings)"
        )
    period_s = log.period_s
    if period_s >= _SLOWEST_PERIOD_s:
        raise BenchLogError(
            f"{source}: line {first + 1}, column time_s: {period_s:.4g} s from one reading to the next is too slow for "
            "a wire; is the time in milliseconds?"
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
                f"{source}: line {first + bad}, column {name}: {values[bad]:.6g} {unit} cannot be "
                f"({known.lo:g} to {known.hi:g} {unit} is possible); {known.hint}"
            )
        if not allow_gaps and name not in _MAY_BE_NAN and not np.isfinite(values).all():
            raise BenchLogError(
                f"{source}: line {first + int(np.argmin(np.isfinite(values)))}, column {name}: not a finite number; "
                "cut the log there, or allow gaps"
            )
    if not allow_gaps and len(step_s) and step_s.max() > (limit_s := longest_pause_s(log)):
        bad = int(np.argmax(step_s > limit_s))
        raise BenchLogError(
            f"{source}: line {first + bad + 1}, column time_s: a gap, {step_s[bad]:.4g} s without a reading where the "
            f"period is {period_s:.4g} s; "
            "split the log there, or allow gaps"
        )


def require_reference(log: BenchLog, config: CircuitSections | None = None) -> None:
    """Raise BenchLogError where the displacement was not measured, or ``config`` does not know by what."""
    if not log.has_reference:
        raise BenchLogError(
            f"{log.source}: line 1: {_missing_column(REFERENCE, log)}: nothing to compare an estimate with"
        )
    if config is not None and "displacement_m" not in log and not config.reference_sensor.fitted:
        raise BenchLogError(
            f"{log.source}: line 1, column lvdt_current_A: is the current of a sensor that is not calibrated; "
            "reference_sensor.slope in m/A and reference_sensor.offset in m are wanted (in the bench file, or "
            "--set reference_sensor.slope=… --set reference_sensor.offset=…), or a column displacement_m"
        )


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
    return f"column {wanted} is missing (or holds no number); found {named(log.columns)}"


def _missing_electrical(log: BenchLog) -> str:
    """What to say of a log that tells no resistance."""
    if "supply_voltage_V" in log and "current_A" in log:
        return (
            "supply_voltage_V and current_A tell the resistance of wire, leads and sense resistor together; name the "
            "voltage wire_voltage_V if it is that over the wire alone, else give reference_voltage_V (over the sense "
            "resistor)"
        )
    if "supply_voltage_V" in log:
        return _missing_column(("reference_voltage_V",), log)
    if "reference_voltage_V" in log:
        return _missing_column(("supply_voltage_V",), log)
    pairs = "; ".join(" and ".join(pair) for pair in ELECTRICAL)
    return (
        f"{_missing_column(('supply_voltage_V', 'reference_voltage_V'), log)}; resistance and current come from one of "
        f"these pairs: {pairs}"
    )


def _metadata_path(path: Path) -> Path:
    return path.with_suffix(".json")


def read_metadata(path: Path) -> dict[str, Any]:
    """What was known when a log was made, from the JSON file beside it; {} where there is none.  Raises
    BenchLogError."""
    beside = _metadata_path(path)
    if not beside.exists():
        return {}
    try:
        metadata = json_of(beside)
    except (OSError, ValueError) as error:
        raise BenchLogError(f"{beside}: is not JSON ({error}); it describes {path.name}") from error
    if not isinstance(metadata, dict):
        raise BenchLogError(f"{beside}: holds no JSON object; it describes {path.name}")
    return metadata
