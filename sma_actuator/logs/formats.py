"""Tables that are no text: Excel, Parquet, MATLAB, TDMS and HDF5, by the libraries that are kept for each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.base.parameters import ConfigError

from .errors import BenchLogError
from .tables import EVENT_COLUMN, Progress, Table, read_text
from .units import is_unit


def read_table(path: Path, progress: Progress | None = None) -> Table:
    """The table in a file, by the ending of its name; text where that says nothing else.

    Raises BenchLogError naming the file, ConfigError naming a package that is missing.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        return read_text(path, progress)
    if not path.is_file():
        raise BenchLogError(f"{path}: cannot be read (no such file)")
    try:
        return reader(path)
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{path}: reading {path.suffix} needs the Python package '{error.name}' (extra 'formats')"
        ) from error
    except BenchLogError:
        raise
    except Exception as error:
        # Whatever a library makes of a file that is broken, the person wants to hear of the file.
        raise BenchLogError(f"{path}: is no readable {path.suffix} file ({type(error).__name__}: {error})") from error


def _excel(path: Path) -> Table:
    import openpyxl

    book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    try:
        sheets = {name: list(book[name].iter_rows(values_only=True)) for name in book.sheetnames}
    finally:
        book.close()
    sheets = {name: rows for name, rows in sheets.items() if len(rows) > 1}
    if len(sheets) != 1:
        what = f"several: {', '.join(sheets)}; keep the one with the log" if sheets else "none"
        raise BenchLogError(f"{path}: one sheet with a header row and numbers is wanted, and there is {what}")
    ((sheet, rows),) = sheets.items()
    rows = [row for row in rows if any(cell is not None for cell in row)]
    width = max((i + 1 for i, cell in enumerate(rows[0]) if cell is not None), default=0)
    names = ["" if cell is None else str(cell).strip() for cell in rows[0][:width]]
    units: dict[str, str] = {}
    first = 1
    below = ["" if cell is None else str(cell) for cell in rows[1][:width]]
    if any(below) and all(is_unit(text) for text in below) and not any(isinstance(c, int | float) for c in rows[1]):
        units = {name: text.strip("[]() ") for name, text in zip(names, below, strict=True) if text}
        first = 2
    columns = {name: [row[i] if i < len(row) else None for row in rows[first:]] for i, name in enumerate(names)}
    return _table(path, columns, units, f"sheet '{sheet}'", first + 1)


def _parquet(path: Path) -> Table:
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(path)
    return _table(path, {name: table.column(name).to_numpy() for name in table.column_names})


def _matlab(path: Path) -> Table:
    import scipy.io

    try:
        found = scipy.io.loadmat(path, squeeze_me=True, simplify_cells=True)
    except NotImplementedError:
        return _hdf5(path)  # version 7.3 is HDF5
    return _table(path, _vectors(path, {n: v for n, v in found.items() if not n.startswith("__")}))


def _tdms(path: Path) -> Table:
    import nptdms

    with nptdms.TdmsFile.read(path) as file:
        groups = {group.name: group.channels() for group in file.groups() if group.channels()}
        channels = [(g, c) for g, found in groups.items() for c in found]
        units = {c.name: str(c.properties["unit_string"]) for _, c in channels if c.properties.get("unit_string")}
        columns: dict[str, Any] = {}
        for group, channel in channels:
            name = channel.name if len(groups) == 1 else f"{group}/{channel.name}"
            columns[name] = channel[:]
        first = channels[0][1] if channels else None
        if first is not None and first.properties.get("wf_increment") and "time_s" not in columns:
            columns["time_s"] = np.arange(len(first)) * float(first.properties["wf_increment"])
    return _table(path, _vectors(path, columns), units)


def _hdf5(path: Path) -> Table:
    import h5py

    columns: dict[str, Any] = {}
    units: dict[str, str] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.names:
            columns.update({str(field): item[field] for field in item.dtype.names})
        elif isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub":
            columns[name] = np.squeeze(item[()])
            unit = item.attrs.get("unit", item.attrs.get("units"))
            if isinstance(unit, str) and unit:
                units[name] = unit

    with h5py.File(path, "r") as file:
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
    if not vectors:
        return {}
    lengths = sorted({len(v) for v in vectors.values()}, key=lambda n: -sum(len(v) == n for v in vectors.values()))
    most = [sum(len(v) == n for v in vectors.values()) for n in lengths]
    if len(lengths) > 1 and most[0] == most[1]:
        shown = ", ".join(f"{name} ({len(v)})" for name, v in vectors.items())
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
    notes = [place] if place else []
    texts: dict[int, str] = {}
    for name, values in columns.items():
        if name == EVENT_COLUMN:
            texts = {i: str(text) for i, text in enumerate(values) if text not in (None, "")}
            continue
        column, note = _numbers(name, values)
        if note:
            notes.append(note)
        if column is not None:
            numbers[name] = column
    if not numbers:
        raise BenchLogError(f"{path}: holds no column of numbers")
    return Table(numbers, str(path), dict(units or {}), texts, tuple(notes), first_line)


def _numbers(name: str, values: Any) -> tuple[np.ndarray | None, str]:
    array = np.asarray(values)
    if array.dtype.kind == "M":
        return (array - array[0]) / np.timedelta64(1, "s"), f"column '{name}' holds dates: seconds since the first"
    if array.dtype.kind == "O" and len(array) and hasattr(array[0], "isoformat"):
        seconds = [(value - array[0]).total_seconds() if hasattr(value, "isoformat") else np.nan for value in array]
        return np.array(seconds), f"column '{name}' holds dates: seconds since the first"
    try:
        return np.ascontiguousarray(array.astype(float)), ""
    except (TypeError, ValueError):
        return None, f"column '{name}' holds text and is left out"
