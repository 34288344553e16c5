"""Tables of numbers as other people write them in text.

Comma, semicolon, tab or blanks between the fields; decimal points or commas, thousands with the other one; UTF-8,
UTF-16, Windows-1252 or GB 18030; whatever a program writes before the header, comments, and words on lines of their
own; a row of units below it, and the header again where a logger was started again; words for readings that are
missing; columns of text, of which dates and times of day become seconds and all others are left out.
"""

from __future__ import annotations

import csv
import datetime
import io
import os
import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .errors import BenchLogError
from .fields import Columns, are_units, find_table, is_number, trimmed
from .tables import EVENT_COLUMN, Progress, Table, holds_text
from .unpacking import PIECE_B, refuse_larger

_SEPARATORS = (b",", b";", b"\t")
_BLANKS = b" "
SEARCHED_LINES = 200  #: for the header: what loggers write before it is a page at the most
_LONGEST_LINE_B = 1_000_000
_OVERFLOW = 9.9e37  #: SCPI's number for a reading beyond the range, and those above it for none at all
#: Bytes that are not ASCII, words that GB 2312 can write, of two bytes a character, and of these characters its signs
#: (rows 1 to 9) and the 3 755 frequent ones (rows 16 to 55).
_HIGH_BYTES = re.compile(rb"[\x80-\xff]+")
_CHINESE = re.compile(rb"(?:[\xa1-\xf7][\xa1-\xfe])+")
_FREQUENT = frozenset((*range(0xA1, 0xAA), *range(0xB0, 0xD8)))


def read_text(path: Path, progress: Progress | None = None) -> Table:
    """The table of a text file.  Raises BenchLogError naming file, line and column."""
    if path.exists() and not path.is_file():  # a pipe would be awaited, a device never ends
        raise BenchLogError(f"{path}: is no file; a log (CSV) is wanted")
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
    """The stream, behind its byte order mark; UTF-16 and Chinese text are converted in memory."""
    mark = stream.read(3)
    code = {b"\0": "utf-16-be", mark[1:2]: "utf-16"}.get(mark[:1], "utf-16-le") if b"\0" in mark[:2] else ""
    if mark.startswith((b"\xff\xfe", b"\xfe\xff")):
        code = "utf-16"
    elif not code and mark != b"\xef\xbb\xbf":
        stream.seek(0)
        code = "gb18030" if _is_chinese(stream.readline(_LONGEST_LINE_B) for _ in range(SEARCHED_LINES)) else ""
    if code:
        refuse_larger(path, 3 * path.stat().st_size)  # read, as text, and as UTF-8
        stream.seek(0)
        return io.BytesIO(stream.read().decode(code, errors="replace").encode())
    stream.seek(len(mark) if mark == b"\xef\xbb\xbf" else 0)
    return stream


def _is_chinese(lines: Iterable[bytes]) -> bool:
    """Whether words of two and more Chinese characters stand in them, most of them frequent, as GB 2312 and its
    successors write them, and nothing that they do not write so.

    In the codes of Western Europe such bytes would be four capital letters or signs running, which no word has; in
    those of Cyrillic script the small letters stand where the rare characters do.
    """
    has_words, frequent, rare = False, 0, 0
    for line in lines:
        if line.isascii() or _is_utf8(line):
            continue
        for run in _HIGH_BYTES.findall(line):
            if not _CHINESE.fullmatch(run):
                return False
            has_words = has_words or len(run) >= 4
            known = sum(byte in _FREQUENT for byte in run[::2])
            frequent, rare = frequent + known, rare + len(run) // 2 - known
    return has_words and frequent > rare


def _is_utf8(line: bytes) -> bool:
    try:
        line.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def _decoded(line: bytes) -> str:
    return line.decode("utf-8") if _is_utf8(line) else line.decode("cp1252", errors="replace")


@dataclass(frozen=True, slots=True)
class _Header:
    names: list[str]
    separator: bytes
    first_line: int  #: where the numbers begin
    unit_row: list[str] = field(default_factory=list)
    notes: tuple[str, ...] = ()

    @property
    def units(self) -> dict[str, str]:
        """Of the columns for which the row below the names says one."""
        said = zip(self.names, self.unit_row, strict=False)
        return {name: unit.strip("[]() ") for name, unit in said if unit.strip()}


def _read_header(stream: BinaryIO, path: Path) -> _Header:
    """Where the table begins; the stream stands at its numbers afterwards."""
    header = _found_header(stream, path)
    if header is None:
        stream.seek(_begin_of(stream))
        header = _first_line_as_header(stream, path)
    return header


def _begin_of(stream: BinaryIO) -> int:
    """Behind the byte order mark."""
    stream.seek(0)
    return 3 if stream.read(3) == b"\xef\xbb\xbf" else 0


def _found_header(stream: BinaryIO, path: Path) -> _Header | None:
    """The header right above the numbers, whatever stands before it; None where there is none such."""
    lines: list[tuple[int, int, bytes]] = []  #: number, place, content
    for line_number in range(1, SEARCHED_LINES + 1):
        place, line = stream.tell(), stream.readline(_LONGEST_LINE_B)
        if not line or b"\0" in line:
            break
        if line.strip() and not _is_comment(line):
            lines.append((line_number, place, line))
    best: tuple[int, bytes, int, int] | None = None
    for separator in (*_SEPARATORS, _BLANKS):
        found = find_table([_fields(line, separator) for _, _, line in lines])
        if found is not None and (best is None or found[2] > best[0]):
            best = found[2], separator, found[0], found[1]
    if best is None:
        return None
    _, separator, names_row, first_row = best
    rows = [_fields(line, separator) for _, _, line in lines[names_row:first_row]]
    before = (f"the header is line {lines[names_row][0]}; what stands before it is left out",) if names_row else ()
    stream.seek(lines[first_row][1])
    width = len(_fields(lines[first_row][2], separator))
    names = _checked_names(trimmed(rows[0])[:width], path, lines[names_row][0])
    return _Header(names, separator, lines[first_row][0], rows[1] if len(rows) > 1 else [], before)


def _is_comment(line: bytes) -> bool:
    return line.lstrip().startswith((b"#", b"%"))


def _checked_names(names: list[str], path: Path, line_number: int) -> list[str]:
    """Names for all columns, as a column of row numbers has none."""
    names = [name or f"column {i + 1}" for i, name in enumerate(names)]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise BenchLogError(f"{path}: line {line_number}: the column '{name}' stands twice")
    return names


def _first_line_as_header(stream: BinaryIO, path: Path) -> _Header:
    """The header where no numbers say where it is: the first line, or the comment above numbers."""
    line_number, comment, line = 0, b"", b""
    while True:
        start = stream.tell()
        line = stream.readline(_LONGEST_LINE_B)
        line_number += 1
        if _is_comment(line):
            comment = line.lstrip().lstrip(b"#% ")
        elif line.strip() or not line:
            break
    if not line:
        raise BenchLogError(f"{path}: line 1: the file is empty; a header row with the columns is wanted")
    if b"\0" in line:
        raise BenchLogError(f"{path}: line {line_number}: is not text; a CSV file is wanted")
    separator = _separator(line)
    names = trimmed(_fields(line, separator))
    if all(is_number(n) for n in names):
        separator = _separator(comment) if comment else separator
        if len(_fields(comment, separator)) != len(_fields(line, _separator(line))) or not comment:
            raise BenchLogError(
                f"{path}: line {line_number}: numbers where the header row with the columns' names is wanted"
            )
        names, separator = _fields(comment, separator), _separator(line)
        stream.seek(start)
        line_number -= 1
    names = _checked_names(names, path, line_number)
    start = stream.tell()
    below = _fields(stream.readline(_LONGEST_LINE_B), separator)
    if len(trimmed(below)) <= len(names) and are_units(below) and any(below):
        return _Header(names, separator, line_number + 2, below)
    stream.seek(start)
    return _Header(names, separator, line_number + 1)


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
    rows = sum(block.count(b"\n") for block in iter(lambda: stream.read(PIECE_B), b"")) + 1
    stream.seek(start)
    refuse_larger(path, 8 * len(header.names) * rows)
    values = np.empty((len(header.names), rows))
    parser = _ChunkParser(path, header)
    filled, rest = 0, b""
    while True:
        block = stream.read(PIECE_B)
        end = len(block) < PIECE_B
        block = rest + block
        cut = len(block) if end else block.rfind(b"\n") + 1
        if len(block) - cut > _LONGEST_LINE_B:
            raise BenchLogError(
                f"{path}: has a line of more than {_LONGEST_LINE_B // 1_000_000} MB; a log (CSV) is wanted"
            )
        block, rest = block[:cut], block[cut:]
        parsed = parser.parse(block, row=filled)
        parsed[np.abs(parsed) >= _OVERFLOW] = np.nan
        values[:, filled : filled + len(parsed)] = parsed.T
        filled += len(parsed)
        if progress:
            progress((stream.tell() - start) / total_bytes)
        if end:
            break
    found = parser.columns
    notes = [*header.notes, *(f"column '{name}' holds text and is left out" for name in found.left_out)]
    notes += [f"column '{name}' holds dates: seconds since the first" for name in found.moments]
    if parser.remarks:
        more = f" and {len(parser.remarks) - 1} more" if len(parser.remarks) > 1 else ""
        notes.append(f"line {parser.remarks[0]}{more} among the rows hold no numbers and are left out")
    if found.missing:
        notes.append(f"a reading is missing where {', '.join(map(repr, found.missing))} stands")
    columns = {
        name: column
        for name, column in zip(header.names, values[:, :filled], strict=True)
        if name not in found.left_out and name != EVENT_COLUMN
    }
    if found.left_out and not columns:
        raise BenchLogError(
            f"{path}: line {header.first_line}: holds no column of numbers: {holds_text(found.left_out)}"
        )
    units = header.units | dict.fromkeys(found.moments, "s")  # whatever the header says of how they are written
    dates = {name: first for name, first in found.moments.items() if isinstance(first, datetime.datetime)}
    return Table(columns, str(path), units, found.events, tuple(notes), header.first_line, found.left_out, dates)


class _ChunkParser:
    """Turns whole lines into numbers: all at once where they are regular, field by field where not."""

    def __init__(self, path: Path, header: _Header):
        self.path, self.header = path, header
        self.columns = Columns(header.names, "." if header.separator == b"," else ",")
        self.remarks: list[int] = []  #: lines of words among the rows, as of who stopped it
        self._line = header.first_line
        separator = header.separator
        translation = b",;\t\n" if separator == b"," else b".,\t\n" if separator == b";" else b".;,\n"
        self._table = bytes.maketrans(b",;\t\n", translation)

    def parse(self, block: bytes, row: int) -> np.ndarray:
        """Numbers of the lines in ``block``, shape (lines, columns); ``row``: of the first."""
        lines = block.count(b"\n")
        block = block.replace(b"\r\n", b"\n").rstrip(b"\n ")
        if not block:
            return np.empty((0, len(self.header.names)))
        if self.header.separator == _BLANKS:
            block = re.sub(rb"[ \t]+", b"\t", re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", block))
        numbers = None if EVENT_COLUMN in self.header.names else self._all_at_once(block)
        if numbers is None:
            numbers = self._by_field(_decoded(block).split("\n"), row)
        self._line += lines
        return numbers

    def _all_at_once(self, block: bytes) -> np.ndarray | None:
        marks = {mark for mark in b".," if mark in block and self.header.separator != b","}
        if marks - {ord(self.columns.mark)} if self.columns.mark else len(marks) > 1:
            return None  # between thousands, perhaps
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
        if len(numbers) != lines * width:
            return None
        self.columns.mark = chr(marks.pop()) if marks else self.columns.mark
        return numbers.reshape(lines, width)

    def _by_field(self, lines: list[str], row: int) -> np.ndarray:
        rows, places = self._rows(lines)
        return self.columns.of(rows, row, lambda i: self._place(places[i]))

    def _rows(self, lines: list[str]) -> tuple[list[list[str]], list[int]]:
        """The fields of the rows, and the line of each, from 1; neither comments nor headers are among them."""
        delimiter = "\t" if self.header.separator == _BLANKS else self.header.separator.decode()
        headers = self.header.names, trimmed(self.header.unit_row)
        rows: list[list[str]] = []
        places: list[int] = []
        odd, words = 0, ""  # a line that is no row, and what to say if no header follows
        reader = csv.reader(lines, delimiter=delimiter)
        for fields in reader:
            stripped = trimmed([text.strip() for text in fields])
            if stripped in headers:
                while odd and places and places[-1] > odd:  # what a logger that is started again writes before it
                    rows.pop(), places.pop()
                odd = 0
            elif stripped and stripped[0][:1] not in ("#", "%"):
                if len(fields) >= len(headers[0]) >= len(stripped):
                    rows.append(fields[: len(headers[0])])
                    places.append(reader.line_num)
                elif not any(map(is_number, stripped)):
                    self.remarks.append(self._line + reader.line_num - 1)
                elif not odd:
                    odd = reader.line_num
                    words = self._wrong_width(odd, len(fields), odd == len(lines))
            if odd and reader.line_num - odd > SEARCHED_LINES:
                break
        if odd:
            raise BenchLogError(words)
        return rows, places

    def _wrong_width(self, line: int, found: int, last: bool) -> str:
        help_ = ""
        if self.header.separator == b"," and found > len(self.header.names):
            help_ = "; decimal commas need a semicolon between the fields"
        elif last:
            help_ = "; was the file cut off?"
        return f"{self._place(line)}: {found} fields where the header has {len(self.header.names)}{help_}"

    def _place(self, line: int) -> str:
        """Of a line of the chunk at hand, from 1."""
        return f"{self.path}: line {self._line + line - 1}"
