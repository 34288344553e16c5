"""One way in for every tool: logs of any kind, one or many, with what was made of them said."""

from __future__ import annotations

import argparse
import dataclasses
import glob
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sma_actuator.base.options import number_within

from .bags import is_bag, log_from_bag, parse_topics
from .bench_log import (
    COLUMNS,
    BenchLog,
    check_bench_log,
    log_of,
    longest_pause_s,
    read_metadata,
    with_rising_stamps,
    with_slow_load_filled,
)
from .errors import BenchLogError
from .formats import READERS, read_table
from .mapping import ColumnMap, column_map
from .sense import log_counts_contraction
from .static import log_of_points
from .tables import PART

Say = Callable[[str], None]
#: A log of more readings than that which lasts no longer is asked for its unit: a session takes a minute, and more.
_SHORT_s, _MANY = 2.0, 200
ENDINGS = (".csv", ".tsv", ".txt", *READERS, ".mcap", ".db3")


@dataclass(frozen=True, slots=True)
class ReadingOptions:
    """How logs are to be read."""

    columns: ColumnMap = field(default_factory=ColumnMap)
    topics: Mapping[str, str] = field(default_factory=dict)  #: of bags: column → /topic:field
    static_s: float = 0.0  #: tables hold steady points without times: seconds from each to the next; 0: they are logs
    sheet: str = ""  #: of workbooks: the one with the log; "": the only one that has one


def add_map_arguments(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Declare the options that say which column of a table is which."""
    group = parser.add_argument_group("logs of other makers")
    group.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="OURS=THEIRS",
        help="which of their columns is which of ours, as resistance_Ohm=R, or a number for all rows, as load_N=0.49; "
        "may be repeated",
    )
    group.add_argument(
        "--unit",
        action="append",
        default=[],
        metavar="OURS=UNIT",
        help="unit of their column, as displacement_m=mm, or =-mm for a sensor that counts contraction, or what one of "
        "it is, as =1mm; "
        "may be repeated",
    )
    group.add_argument(
        "--offset",
        action="append",
        default=[],
        metavar="OURS=NUMBER",
        help="what is added to their column, in our unit, as displacement_m=0.0041; may be repeated",
    )
    group.add_argument(
        "--map-file", type=Path, metavar="MAP.yaml", help="the same, written once: columns, units, offsets"
    )
    return group


def add_log_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options that say how logs are to be read."""
    group = add_map_arguments(parser)
    group.add_argument(
        "--static",
        type=number_within(0.0, 86400.0),
        default=0.0,
        metavar="SECONDS",
        help="tables of steady points, one a row, without times: go through them in so many seconds each, which should "
        "be several "
        "thermal time constants (0.15 mm: 10, 0.4 mm: 60)",
    )
    group.add_argument("--sheet", default="", metavar="NAME", help="workbooks with several logs: the sheet to read")
    group.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="COLUMN=/TOPIC:FIELD",
        help="rosbag2 recordings: where a column is found; may be repeated",
    )


def place(text: str) -> Path | str:
    """Where a log lies, of an argument: a path, or a URL as it is."""
    return text if "://" in text else Path(text)


def columns_of(args: argparse.Namespace, known: tuple[str, ...]) -> ColumnMap:
    """Which column is which, by the options, of tables whose columns are the ``known``.  Raises BenchLogError."""
    return column_map(args.map, args.unit, args.offset, args.map_file, known)


def said_of_logs(args: argparse.Namespace) -> str:
    """The options that say how logs are to be read, as they were given, for the next command."""
    words = [
        word
        for option, values in (
            ("--map", args.map),
            ("--unit", args.unit),
            ("--offset", args.offset),
            ("--topic", args.topic),
        )
        for value in values
        for word in (option, value)
    ]
    words += ["--map-file", str(args.map_file)] if args.map_file else []
    words += ["--static", f"{args.static:g}"] if args.static else []
    words += ["--sheet", args.sheet] if args.sheet else []
    return shlex.join(words)


def reading_of(args: argparse.Namespace) -> ReadingOptions:
    """How logs are to be read, by the options.  Raises BenchLogError."""
    return ReadingOptions(columns_of(args, tuple(COLUMNS)), parse_topics(args.topic), args.static, args.sheet)


def read_logs(
    places: Sequence[Path | str],
    reading: ReadingOptions,
    say: Say = lambda sentence: None,
    progress: Callable[[float], None] = lambda fraction: None,
    found: list[ColumnMap] | None = None,
) -> list[BenchLog]:
    """The logs at ``places``: files, folders and patterns, bags among them.

    Pauses and readings that are missing are kept as they are; files that follow each other in one recording are joined;
    a displacement that counts contraction is turned round.  A file that cannot be read among others is left out, which
    ``say`` is told.  ``found`` takes what was made of each table's columns.  Raises BenchLogError where none can be
    read.
    """
    paths = find_logs(places)
    found = [] if found is None else found
    logs, errors = [], []
    notes: dict[str, list[str]] = {}  #: on columns → the files in which they are so
    for i, path in enumerate(paths):
        try:
            logs.append(_read(path, reading, say, found, notes))
        except BenchLogError as error:
            errors.append(error)
        progress((i + 1) / len(paths))
    for note, names in notes.items():
        say(f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: {note}")
    if errors and not logs:
        raise errors[0]
    for each in errors:
        say(f"left out: {each}")
    return _extension_positive(_joined(_each_once(logs, say), say), reading, say, found)


def _each_once(logs: list[BenchLog], say: Say) -> list[BenchLog]:
    """Logs without those that are copies of one before them: the same readings twice are no more sure than once."""
    out: list[BenchLog] = []
    for log in logs:
        same = next((one for one in out if _same_readings(one, log)), None)
        if same is None:
            out.append(log)
        else:
            say(f"left out: {log.name}: its readings are those of {same.name}; they count once")
    return out


def _same_readings(one: BenchLog, other: BenchLog) -> bool:
    columns, others = one.columns, other.columns
    return columns.keys() == others.keys() and all(
        len(values) == len(others[name]) and np.array_equal(values, others[name], equal_nan=True)
        for name, values in columns.items()
    )


def find_logs(places: Sequence[Path | str]) -> list[Path]:
    """The files that folders and patterns stand for, each once, in order.  Raises BenchLogError where there is none."""
    found: list[Path] = []
    for place in places:
        if isinstance(place, str):
            raise BenchLogError(f"{place}: a URL is read with --table, where many wires are worked on at once")
        if place.is_dir() and not is_bag(place):
            inside = sorted(
                p for p in place.iterdir() if p.name[0] != "." and (p.suffix.lower() in ENDINGS or is_bag(p))
            )
            if not inside:
                raise BenchLogError(f"{place}: no log in this folder (files that end with {', '.join(ENDINGS)})")
            found += inside
        elif not place.exists() and glob.has_magic(str(place)):
            matching = sorted(Path(name) for name in glob.glob(str(place), recursive=True))  # noqa: PTH207 - absolute patterns too
            if not matching:
                writing = next((name for name in glob.iglob(f"{place}{PART}", recursive=True)), "")  # noqa: PTH207 - as above
                why = f"; {writing} is still being written: end the node, and it has its name" if writing else ""
                raise BenchLogError(f"{place}: no file matches{why}")
            found += matching
        else:
            found.append(place)
    return list(dict.fromkeys(found))


def _read(
    path: Path, reading: ReadingOptions, say: Say, found: list[ColumnMap], notes: dict[str, list[str]]
) -> BenchLog:
    if is_bag(path):
        log = log_from_bag(path, reading.topics)
    else:
        theirs = read_table(path, sheet=reading.sheet)
        if reading.static_s:
            rows = np.arange(len(next(iter(theirs.columns.values()), ())))
            theirs = dataclasses.replace(theirs, columns={**theirs.columns, "time_s": reading.static_s * rows})
        table = reading.columns.apply(theirs)
        found.append(reading.columns.of(theirs))
        for note in table.notes:
            notes.setdefault(note, []).append(path.name)
        log = (
            log_of_points(table, reading.static_s, read_metadata(path), say)
            if reading.static_s
            else with_rising_stamps(log_of(table, read_metadata(path)), say)
        )
    check_bench_log(log, allow_gaps=True)
    if not log.metadata:  # a node knows what it has not read
        log = with_slow_load_filled(log, lambda words: notes.setdefault(words, []).append(path.name))
    if log["time_s"][-1] - log["time_s"][0] < _SHORT_s and len(log) > _MANY:
        words = f"lasts less than {_SHORT_s:g} s; is the time in minutes or hours (--unit time_s=min, or =h)?"
        notes.setdefault(words, []).append(path.name)
    pause_s = longest_pause_s(log)
    pauses = int(np.count_nonzero(np.diff(log["time_s"]) > pause_s))
    if pauses:
        say(f"{log.name}: {pauses} pause{'s' * (pauses > 1)} of more than {pause_s:.2g} s")
    return log


def _joined(logs: list[BenchLog], say: Say) -> list[BenchLog]:
    """Logs in which the files that a recorder wrote one after the other are one."""
    out: list[BenchLog] = []
    for log in logs:
        before = out[-1] if out else None
        if before is not None and _follows(before, on := _on_its_clock(before, log)):
            if len(on) < len(log):
                say(f"{log.name}: begins with the last {len(log) - len(on)} rows of {before.name}; they count once")
            log = on
            columns = {name: np.concatenate((before[name], log[name])) for name in before.columns}
            metadata = {**before.metadata, "part": log.metadata.get("part", 1)}
            out[-1] = dataclasses.replace(before, columns=columns, metadata=metadata, events=before.events + log.events)
            say(f"{log.name}: goes on from {before.name}")
        else:
            out.append(log)
            if log.metadata.get("part", 1) != 1:
                say(
                    f"{log.name}: begins in the middle of a recording; what the estimator remembered by then is not in "
                    f"it"
                )
    return out


#: Dates are read to the microsecond.
_STAMPED_s = 1e-6


def _on_its_clock(before: BenchLog, log: BenchLog) -> BenchLog:
    """``log`` by the clock of the log before it, where the stamps of both are dates, and without the rows with which
    that ends."""
    first, began = before.began, log.began
    if first is not None and began is not None and (first.tzinfo is None) == (began.tzinfo is None):
        later_s = (began - first).total_seconds()
        events = tuple((time_s + later_s, text) for time_s, text in log.events)
        log = dataclasses.replace(log, columns={**log.columns, "time_s": log["time_s"] + later_s}, events=events)
    twice = int(np.count_nonzero(log["time_s"] <= before["time_s"][-1] + _STAMPED_s))
    if log.metadata or set(log.columns) != set(before.columns) or not 0 < twice < min(len(log), len(before)):
        return log
    for name, values in log.columns.items():
        apart = _STAMPED_s if name == "time_s" else 0.0
        if not np.allclose(values[:twice], before[name][-twice:], rtol=0.0, atol=apart, equal_nan=True):
            return log
    return dataclasses.replace(log, columns={name: values[twice:] for name, values in log.columns.items()})


def _follows(before: BenchLog, log: BenchLog) -> bool:
    """Whether it is the next file of one recording: by what its recorder wrote beside it, or, of other makers, since
    the clock goes on without a pause."""
    pause_s = log["time_s"][0] - before["time_s"][-1]
    recording = before.metadata.get("recording")
    if set(log.columns) != set(before.columns) or log.metadata.get("recording") != recording or not pause_s > 0.0:
        return False
    if recording is None:
        return bool(pause_s <= longest_pause_s(before))
    return bool(log.metadata.get("part") == before.metadata.get("part", 0) + 1)


def one_map(found: Sequence[ColumnMap]) -> ColumnMap:
    """The map that holds for all tables.  Raises BenchLogError where they do not name their columns alike."""
    first = found[0]
    if any(each != first for each in found[1:]):
        raise BenchLogError(
            "the files do not name their columns alike, so one map does not hold for all; give them in groups"
        )
    return first


def _extension_positive(
    logs: list[BenchLog], reading: ReadingOptions, say: Say, found: list[ColumnMap]
) -> list[BenchLog]:
    """Logs whose displacement grows with extension: where it falls with the resistance, it counts contraction."""
    if "displacement_m" in reading.columns.units:
        return logs  # somebody said which way it counts
    asked = [log for log in logs if "displacement_m" in log and "recorded_by" not in log.metadata]
    turned = [log for log in asked if log_counts_contraction(log)]
    if not turned:
        return logs
    zero_m = float(max(np.nanmax(log["displacement_m"]) for log in turned))
    names = ", ".join(log.name for log in turned) if len(turned) < len(asked) else "displacement_m"
    say(
        f"{names}: grows while the wire is heated, so it counts contraction; turned round, extension = {zero_m:.6g} m "
        f"less it (to keep this zero for other logs: --unit displacement_m=-UNIT --offset displacement_m={zero_m:.6g})"
    )
    for i, each in enumerate(found):
        unit = each.units.get("displacement_m", "m")
        turning = {**each.units, "displacement_m": f"-{unit}"}
        found[i] = dataclasses.replace(each, units=turning, offsets={**each.offsets, "displacement_m": zero_m})
    ids = {id(log) for log in turned}
    return [
        dataclasses.replace(log, columns={**log.columns, "displacement_m": zero_m - log["displacement_m"]})
        if id(log) in ids
        else log
        for log in logs
    ]
