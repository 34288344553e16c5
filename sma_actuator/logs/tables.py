"""Tables of numbers as other people write them: text with any separator, and what extras can read.

In text: comma, semicolon, tab or blanks between the fields; a decimal comma where the separator is not a comma;
UTF-8, UTF-16 or Windows-1252; comments before the header; a row of units below it; columns of text, of which
dates become seconds and all others are left out.
"""

from __future__ import annotations

import csv
import datetime
import io
import math
import os
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .errors import BenchLogError
from .units import is_unit

CHUNK_BYTES = 8_000_000
#: That a log may take in memory, whatever it takes on disk: an hour of forty columns at 800 Hz.  Looked at before it is
#: read, for a few bytes can stand for any number of numbers in every format that packs.
LARGEST_B = 1_000_000_000
#: What was asked of the actuator or happened to it before its row, in words; text, where all others are numbers.
EVENT_COLUMN = "event"
_SEPARATORS = (b",", b";", b"\t")
_BLANKS = b" "
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Table:
    """Columns by name, arrays of shape (n,), float64, as they stand in the file."""

    columns: Mapping[str, np.ndarray]
    source: str
    units: Mapping[str, str] = field(default_factory=dict)  #: where the file says them apart from the names
    texts: Mapping[int, str] = field(default_factory=dict)  #: row → text of the column ``event``
    notes: tuple[str, ...] = ()  #: what was left out or converted
    first_line: int = 2  #: of the file, where the numbers begin


def refuse_larger(path: Path, size_B: float) -> None:
    """Raise BenchLogError where what a file holds takes more memory than a log may."""
    if size_B > LARGEST_B:
        raise BenchLogError(
            f"{path}: takes more than {LARGEST_B / 1e9:g} GB where it is unpacked; cut the log into parts"
        )


def read_text(path: Path, progress: Progress | None = None) -> Table:
    """The table of a text file.  Raises BenchLogError naming file, line and column."""
    try:
        with path.open("rb") as raw:
            return _parse(_as_utf8(raw, path), path, progress)
    except OSError as error:
        raise BenchLogError(f"{path}: cannot be read ({error.strerror or error}); a log (CSV) is wanted") from error
    except csv.Error as error:
        words = "has carriage returns that end no line; save it with the line ends of Unix or Windows"
        if "field limit" in str(error):
            words = "has a field of more than 131072 characters, as after a quotation mark that is never closed"
        raise BenchLogError(f"{path}: {words}") from error


def _as_utf8(stream: BinaryIO, path: Path) -> BinaryIO:
    """The stream, behind its byte order mark; UTF-16 is converted in memory."""
    mark = stream.read(3)
    if mark.startswith((b"\xff\xfe", b"\xfe\xff")):
        refuse_larger(path, 3 * path.stat().st_size)  # read, as text, and as UTF-8
        text = (mark + stream.read()).decode("utf-16", errors="replace")
        return io.BytesIO(text.encode())
    if mark != b"\xef\xbb\xbf":
        stream.seek(0)
    return stream


def _decoded(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace")


@dataclass(frozen=True, slots=True)
class _Header:
    names: list[str]
    separator: bytes
    units: dict[str, str]
    first_line: int


def _read_header(stream: BinaryIO, path: Path) -> _Header:
    """Header, row of units, and where the numbers begin; the stream stands there afterwards."""
    number, comment, line = 0, b"", b""
    while True:
        start = stream.tell()
        line = stream.readline(1_000_000)
        number += 1
        if line.lstrip().startswith((b"#", b"%")):
            comment = line.lstrip().lstrip(b"#% ")
        elif line.strip() or not line:
            break
    if not line:
        raise BenchLogError(f"{path}: line 1: the file is empty; a header row with the columns is wanted")
    if b"\0" in line:
        raise BenchLogError(f"{path}: line {number}: is not text; a CSV file is wanted")
    separator = _separator(line)
    names = _fields(line, separator)
    if all(_is_number(n) for n in names):
        separator = _separator(comment) if comment else separator
        if len(_fields(comment, separator)) != len(_fields(line, _separator(line))) or not comment:
            raise BenchLogError(
                f"{path}: line {number}: numbers where the header row with the columns' names is wanted"
            )
        names, separator = _fields(comment, separator), _separator(line)
        stream.seek(start)
        number -= 1
    for i, name in enumerate(names):
        if not name or name in names[:i]:
            what = f"the column '{name}' stands twice" if name else f"column {i + 1} has no name"
            raise BenchLogError(f"{path}: line {number}: {what}")
    start = stream.tell()
    below = _fields(stream.readline(1_000_000), separator)
    if len(below) == len(names) and all(is_unit(text) for text in below) and any(below):
        units = {name: unit.strip("[]() ") for name, unit in zip(names, below, strict=True) if unit}
        return _Header(names, separator, units, number + 2)
    stream.seek(start)
    return _Header(names, separator, {}, number + 1)


def _separator(header: bytes) -> bytes:
    best = max(_SEPARATORS, key=header.count)
    return best if header.count(best) else _BLANKS


def _fields(line: bytes, separator: bytes) -> list[str]:
    text = _decoded(line.rstrip(b"\r\n"))
    if separator == _BLANKS:
        return text.split()
    return [field.strip() for field in next(csv.reader([text], delimiter=separator.decode()), [])]


def _parse(stream: BinaryIO, path: Path, progress: Progress | None) -> Table:
    """All columns of the file, as rows of one array of shape (columns, n): n is counted first, so
    that a log of any length needs little more memory than its columns."""
    header = _read_header(stream, path)
    start = stream.tell()
    total_bytes = max(1, stream.seek(0, os.SEEK_END) - start)
    stream.seek(start)
    rows = sum(block.count(b"\n") for block in iter(lambda: stream.read(CHUNK_BYTES), b"")) + 1
    stream.seek(start)
    refuse_larger(path, 8 * len(header.names) * rows)
    values = np.empty((len(header.names), rows))
    parser = _ChunkParser(path, header)
    filled, rest = 0, b""
    while True:
        block = stream.read(CHUNK_BYTES)
        end = len(block) < CHUNK_BYTES
        block = rest + block
        cut = len(block) if end else block.rfind(b"\n") + 1
        block, rest = block[:cut], block[cut:]
        parsed = parser.parse(block, row=filled)
        values[:, filled : filled + len(parsed)] = parsed.T
        filled += len(parsed)
        if progress:
            progress((stream.tell() - start) / total_bytes)
        if end:
            break
    left_out = [name for name in header.names if name in parser.left_out]
    notes = [f"column '{name}' holds text and is left out" for name in left_out]
    notes += [f"column '{name}' holds dates: seconds since the first" for name in parser.dates]
    columns = {
        name: column
        for name, column in zip(header.names, values[:, :filled], strict=True)
        if name not in left_out and name != EVENT_COLUMN
    }
    return Table(columns, str(path), header.units, parser.events, tuple(notes), header.first_line)


class _ChunkParser:
    """Turns whole lines into numbers: all at once where they are regular, field by field where not."""

    def __init__(self, path: Path, header: _Header):
        self.path, self.header = path, header
        self.events: dict[int, str] = {}
        self.left_out: set[str] = set()  #: columns of text
        self.dates: dict[str, datetime.datetime] = {}  #: columns of dates, with the first
        self._known = False  #: whether the kinds of the columns are
        separator = header.separator
        translation = b",;\t\n" if separator == b"," else b".,\t\n" if separator == b";" else b".;,\n"
        self._table = bytes.maketrans(b",;\t\n", translation)

    def parse(self, block: bytes, row: int) -> np.ndarray:
        """Numbers of the lines in ``block``, shape (lines, columns); ``row``: of the first."""
        block = block.replace(b"\r\n", b"\n").rstrip(b"\n ")
        if not block:
            return np.empty((0, len(self.header.names)))
        if self.header.separator == _BLANKS:
            block = re.sub(rb"[ \t]+", b"\t", re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", block))
        if EVENT_COLUMN not in self.header.names:
            numbers = self._all_at_once(block)
            if numbers is not None:
                return numbers
        return self._by_field(_decoded(block).split("\n"), row)

    def _all_at_once(self, block: bytes) -> np.ndarray | None:
        table = block.translate(self._table)
        width = len(self.header.names)
        characters = np.frombuffer(table, np.uint8)
        ends = np.flatnonzero((characters == ord(",")) | (characters == ord("\n")))
        newline = characters[ends] == ord("\n")
        lines = np.count_nonzero(newline) + 1
        if len(ends) != lines * width - 1 or not newline[width - 1 :: width].all():
            return None
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # numpy's way to say: not all of it was numbers
            try:
                numbers = np.fromstring(table.replace(b"\n", b","), sep=",")
            except (DeprecationWarning, ValueError):
                return None
        return numbers.reshape(lines, width) if len(numbers) == lines * width else None

    def _by_field(self, lines: list[str], row: int) -> np.ndarray:
        names = self.header.names
        delimiter = "\t" if self.header.separator == _BLANKS else self.header.separator.decode()
        rows = []
        for i, fields in enumerate(csv.reader(lines, delimiter=delimiter)):
            if len(fields) == len(names):
                rows.append(fields)
            elif any(text.strip() for text in fields):
                raise BenchLogError(self._wrong_width(row + i, len(fields), last=i == len(lines) - 1))
        if not rows:
            return np.empty((0, len(names)))
        if not self._known:
            self._find_kinds(rows[0])
        out = np.empty((len(rows), len(names)))
        for j, name in enumerate(names):
            column = [fields[j] for fields in rows]
            if name == EVENT_COLUMN:
                self.events.update({row + i: text for i, text in enumerate(column) if text})
                out[:, j] = np.nan
            elif name in self.left_out:
                out[:, j] = np.nan
            elif name in self.dates:
                out[:, j] = [self._seconds(text, name, row + i) for i, text in enumerate(column)]
            else:
                out[:, j] = self._numbers(column, name, row)
        return out

    def _wrong_width(self, row: int, found: int, last: bool) -> str:
        help_ = ""
        if self.header.separator == b"," and found > len(self.header.names):
            help_ = "; decimal commas need a semicolon between the fields"
        elif last:
            help_ = "; was the file cut off?"
        return f"{self._place(row)}: {found} fields where the header has {len(self.header.names)}{help_}"

    def _place(self, row: int) -> str:
        return f"{self.path}: line {self.header.first_line + row}"

    def _find_kinds(self, fields: Sequence[str]) -> None:
        """What the columns hold, by the first row."""
        self._known = True
        for name, text in zip(self.header.names, fields, strict=True):
            if name == EVENT_COLUMN or not text.strip() or _is_number(self._plain(text)):
                continue
            try:
                self.dates[name] = datetime.datetime.fromisoformat(text.strip())
            except ValueError:
                self.left_out.add(name)

    def _plain(self, text: str) -> str:
        text = text.strip()
        return text if self.header.separator == b"," else text.replace(",", ".")

    def _numbers(self, column: list[str], name: str, row: int) -> np.ndarray:
        try:
            return np.array(column, dtype=float)
        except ValueError:
            pass
        out = np.empty(len(column))
        for i, text in enumerate(column):
            try:
                out[i] = float(self._plain(text)) if text.strip() else math.nan
            except ValueError:
                raise BenchLogError(
                    f"{self._place(row + i)}, column {name}: '{text.strip()}' is not a number"
                ) from None
        return out

    def _seconds(self, text: str, name: str, row: int) -> float:
        try:
            return (datetime.datetime.fromisoformat(text.strip()) - self.dates[name]).total_seconds()
        except (ValueError, TypeError):
            raise BenchLogError(
                f"{self._place(row)}, column {name}: '{text.strip()}' is not a date like the first"
            ) from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
