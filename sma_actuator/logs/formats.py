"""Tables that are no text: Excel, Parquet, MATLAB, TDMS and HDF5, by the libraries that are kept for each."""

from __future__ import annotations

import datetime
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.base.errors import named
from sma_actuator.base.parameters import ConfigError

from .errors import BenchLogError
from .fields import decimal_mark, find_table, is_number, number, seconds_between, trimmed
from .tables import EVENT_COLUMN, Progress, Table, holds_text
from .text import SEARCHED_LINES, read_text
from .unpacking import look_at_excel, look_at_matlab, refuse_larger, unpacking

#: What a cell of a sheet takes until it is a number of a column, a Python object and a place in a row; a row takes as
#: much as four.
_CELL_B, _ROW_CELLS = 40, 4
_NUMBER_B = 8
_SHORTEST = 10  #: rows of a sheet that may be a log, beside others with some results


def read_table(path: Path, progress: Progress | None = None, sheet: str = "") -> Table:
    """The table in a file, by the ending of its name; text where that says nothing else.  ``sheet``: that of a
    workbook, "" for the only one with a log.

    Raises BenchLogError naming the file, ConfigError naming a package that is missing.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        return read_text(path, progress)
    if not path.is_file():
        raise BenchLogError(f"{path}: cannot be read (no such file)")
    try:
        with unpacking(path):
            return _excel(path, sheet) if reader is _excel else reader(path)
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{path}: reading {path.suffix} needs the Python package '{error.name}' (extra 'formats')"
        ) from error
    except BenchLogError:
        raise
    except Exception as error:
        # Whatever a library makes of a file that is broken, the person wants to hear of the file.
        raise BenchLogError(f"{path}: is no readable {path.suffix} file ({type(error).__name__}: {error})") from error


def _excel(path: Path, wanted: str = "") -> Table:
    import openpyxl

    look_at_excel(path)
    book = openpyxl.load_workbook(path, read_only=True, data_only=True, keep_links=False)
    try:
        cells = 0
        sheets: dict[str, list[tuple[Any, ...]]] = {}
        for name in book.sheetnames:
            sheets[name] = []
            for row in book[name].iter_rows(values_only=True):
                cells += _ROW_CELLS + len(row)  # far-off cells stand for all that lie before them
                refuse_larger(path, _CELL_B * cells)
                if any(cell is not None for cell in row):
                    sheets[name].append(row)
    finally:
        book.close()
    tables = {name: found for name, rows in sheets.items() if (found := find_table(_as_text(rows)))}
    sheet = _sheet_of(path, sheets, tables, wanted)
    rows, (header, first, _) = sheets[sheet], tables[sheet]
    names = trimmed(_as_text(rows[header : header + 1])[0])
    names = [name.strip() or f"column {i + 1}" for i, name in enumerate(names)]
    units = dict(zip(names, _as_text(rows[header + 1 : first])[0], strict=False)) if first > header + 1 else {}
    columns = {name: [row[i] if i < len(row) else None for row in rows[first:]] for i, name in enumerate(names)}
    return _table(path, columns, {n: u.strip("[]() ") for n, u in units.items() if u}, f"sheet '{sheet}'", first + 1)


def _sheet_of(path: Path, sheets: Mapping[str, Sequence[Any]], tables: Mapping[str, Any], wanted: str) -> str:
    """The sheet that is read.  Raises BenchLogError where there is none, or more than one."""
    there = f"its sheets are {named(sheets)}"
    if wanted and wanted not in sheets:
        raise BenchLogError(f"{path}: there is no sheet '{wanted}'; {there}")
    long = [name for name, (_, first, _) in tables.items() if len(sheets[name]) - first >= _SHORTEST]
    logs = [wanted] if wanted in tables else [] if wanted else long or list(tables)
    if not logs:
        which = f"the sheet '{wanted}' has" if wanted else "no sheet has"
        none = " no" if wanted else " a"
        raise BenchLogError(f"{path}: {which}{none} header row with numbers below it; {there}")
    if len(logs) > 1:
        raise BenchLogError(
            f"{path}: several sheets have a log: {named(logs)}; --sheet {shlex.quote(logs[0])} reads that one"
        )
    return logs[0]


def _as_text(rows: Sequence[Sequence[Any]]) -> list[list[str]]:
    """As the first rows of a sheet would stand in a file of text."""
    return [
        ["" if cell is None else cell.isoformat() if hasattr(cell, "isoformat") else str(cell) for cell in row]
        for row in rows[:SEARCHED_LINES]
    ]


def _parquet(path: Path) -> Table:
    import pyarrow
    import pyarrow.parquet

    said = pyarrow.parquet.read_metadata(path)
    # Not asked of the columns one by one: of what is broken there pyarrow aborts the process.
    unpacked_B = sum(said.row_group(i).total_byte_size for i in range(said.num_row_groups))
    refuse_larger(path, max(_NUMBER_B * said.num_rows * said.num_columns, unpacked_B))
    # A text that stands in a million rows is stored once; it is neither multiplied nor, but for the events, read at
    # all.
    texts = {field.name for field in said.schema.to_arrow_schema() if not _of_numbers(field.type)}
    names = [name for name in said.schema.to_arrow_schema().names if name not in texts or name == EVENT_COLUMN]
    table = pyarrow.parquet.read_table(path, columns=names, read_dictionary=[EVENT_COLUMN])
    columns: dict[str, Any] = dict.fromkeys(said.schema.to_arrow_schema().names, (b"",))
    columns |= {name: table.column(name).to_numpy() for name in names if name not in texts}
    if EVENT_COLUMN in texts:
        column = table.column(EVENT_COLUMN).cast(pyarrow.dictionary(pyarrow.int32(), pyarrow.string()))
        columns[EVENT_COLUMN] = [
            None if place is None else words[place]
            for chunk in column.chunks
            for words in [chunk.dictionary.to_pylist()]
            for place in chunk.indices.to_pylist()
        ]
    return _table(path, columns)


def _of_numbers(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_primitive(kind) or types.is_decimal(kind) or types.is_null(kind))


def _matlab(path: Path) -> Table:
    import scipy.io

    look_at_matlab(path)
    try:
        found = scipy.io.loadmat(path, squeeze_me=True, simplify_cells=True)
    except NotImplementedError:
        return _hdf5(path)  # version 7.3 is HDF5
    return _table(path, _vectors(path, {n: v for n, v in found.items() if not n.startswith("__")}))


def _tdms(path: Path) -> Table:
    import nptdms

    with nptdms.TdmsFile.open(path) as file:
        groups = {group.name: group.channels() for group in file.groups() if group.channels()}
        channels = [(g, c) for g, found in groups.items() for c in found]
        refuse_larger(path, _NUMBER_B * sum(len(channel) for _, channel in channels))
        units: dict[str, str] = {}
        columns: dict[str, Any] = {}
        for group, channel in channels:
            name = channel.name if len(groups) == 1 else f"{group}/{channel.name}"
            columns[name] = channel[:]
            if channel.properties.get("unit_string"):
                units[name] = str(channel.properties["unit_string"])
        first = channels[0][1] if channels else None
        if first is not None and first.properties.get("wf_increment") and "time_s" not in columns:
            columns["time_s"] = np.arange(len(first)) * float(first.properties["wf_increment"])
    return _table(path, _vectors(path, columns), units)


def _hdf5(path: Path) -> Table:
    import h5py

    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    taken_B = 0

    def visit(name: str, item: Any) -> None:
        nonlocal taken_B
        if isinstance(item, h5py.Dataset) and (item.external or item.is_virtual):
            elsewhere(name, "are kept outside of it")
        if isinstance(item, h5py.Dataset) and (item.dtype.names or item.dtype.kind in "fiub"):
            # A few bytes describe a dataset of any size, and one of its chunks at a time is unpacked whole.
            each_B = max(item.dtype.itemsize, _NUMBER_B)
            taken_B += each_B * (item.size or 0)
            refuse_larger(path, taken_B + each_B * math.prod(item.chunks or ()))
        if isinstance(item, h5py.Dataset) and item.dtype.names:
            columns.update({str(field): item[field] for field in item.dtype.names})
        elif isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" and item.size:
            columns[name] = np.squeeze(item[()])
            unit = item.attrs.get("unit", item.attrs.get("units"))
            unit = unit.decode(errors="replace") if isinstance(unit, bytes) else unit  # of fixed length, as from C
            if isinstance(unit, str) and unit:
                units[name] = unit

    def elsewhere(name: str, how: str) -> None:
        raise BenchLogError(
            f"{path}: the numbers of '{name}' {how}; only what stands in the file itself is read: copy them there"
        )

    links: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        file.visititems_links(links.__setitem__)
        for name, link in links.items():
            if isinstance(link, h5py.ExternalLink):
                elsewhere(name, f"are linked from {link.filename!r}")
        file.visititems(visit)
    return _table(path, _vectors(path, columns), units)


READERS: dict[str, Callable[[Path], Table]] = {
    ".xlsx": _excel,
    ".xlsm": _excel,
    ".parquet": _parquet,
    ".mat": _matlab,
    ".tdms": _tdms,
    ".h5": _hdf5,
    ".hdf5": _hdf5,
}


def _vectors(path: Path, found: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The vectors among what was found, structures opened; all of the most frequent length."""
    vectors: dict[str, np.ndarray] = {}
    for name, value in found.items():
        if isinstance(value, dict):
            vectors |= {
                (inner if inner not in found else f"{name}.{inner}"): v for inner, v in _vectors(path, value).items()
            }
        elif np.ndim(value) == 1 and np.size(value) > 1:
            vectors[name] = np.asarray(value)
    if not any(v.dtype.kind in "fiub" for v in vectors.values()):
        matrices = {name: np.shape(value) for name, value in found.items() if np.ndim(value) == 2 and np.size(value)}
        if matrices:  # whose columns have no names
            shown = named(f"'{name}' ({rows} × {columns})" for name, (rows, columns) in matrices.items())
            raise BenchLogError(f"{path}: holds a matrix, {shown}; save each of its columns under a name of its own")
    if not vectors:
        return {}
    lengths = sorted({len(v) for v in vectors.values()}, key=lambda n: -sum(len(v) == n for v in vectors.values()))
    most = [sum(len(v) == n for v in vectors.values()) for n in lengths]
    if len(lengths) > 1 and most[0] == most[1]:
        shown = named(f"{name} ({len(v)})" for name, v in vectors.items())
        raise BenchLogError(f"{path}: the vectors have different lengths: {shown}; those of one log have the same")
    return {name: v for name, v in vectors.items() if len(v) == lengths[0]}


def _table(
    path: Path,
    columns: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
    place: str = "",
    first_line: int = 1,
) -> Table:
    """Columns of anything as numbers; text is left out, dates become seconds."""
    numbers: dict[str, np.ndarray] = {}
    units = dict(units or {})
    notes = [place] if place else []
    texts: dict[int, str] = {}
    left_out: dict[str, str] = {}
    moments: dict[str, datetime.datetime] = {}
    for name, values in columns.items():
        if name == EVENT_COLUMN:
            texts = {i: str(text) for i, text in enumerate(values) if text not in (None, "")}
            continue
        column, note = _numbers(name, values)
        if note:
            notes.append(note)
        if note and column is not None:
            units[name] = "s"  # dates, whatever the header says of how they are written
            first = np.asarray(values)[0]
            first = first.astype("datetime64[us]").item() if isinstance(first, np.datetime64) else first
            if isinstance(first, datetime.datetime):
                moments[name] = first
        if column is not None:
            numbers[name] = column
        else:
            left_out[name] = next((v for v in values if isinstance(v, str) and not is_number(v)), "")
    if not numbers:
        raise BenchLogError(f"{path}: holds no column of numbers{': ' if left_out else ''}{holds_text(left_out)}")
    return Table(numbers, str(path), units, texts, tuple(notes), first_line, left_out, moments)


def _numbers(name: str, values: Any) -> tuple[np.ndarray | None, str]:
    array = np.asarray(values)
    if array.dtype.kind == "M":
        return (array - array[0]) / np.timedelta64(1, "s"), f"column '{name}' holds dates: seconds since the first"
    if array.dtype.kind == "O" and len(array) and hasattr(array[0], "isoformat"):
        return _seconds(array), f"column '{name}' holds dates: seconds since the first"
    try:
        return np.ascontiguousarray(array.astype(float)), ""
    except (TypeError, ValueError):
        pass
    texts = [value for value in values if isinstance(value, str)]
    try:
        mark = decimal_mark(text for text in texts if is_number(text)) or "."
        return np.array(
            [number(v, mark) if isinstance(v, str) else np.nan if v is None else float(v) for v in values]
        ), ""
    except (TypeError, ValueError):
        return None, f"column '{name}' holds text and is left out"


def _seconds(moments: np.ndarray) -> np.ndarray:
    seconds = np.full(len(moments), np.nan)
    last_s = 0.0
    for i, now in enumerate(moments):
        if hasattr(now, "isoformat"):
            seconds[i] = last_s = seconds_between(moments[0], last_s, now)
    return seconds
