"""What a log may take in memory, whatever it takes on disk, and what a library would break on: looked at before a file
is read, by its format, and held while it is."""

from __future__ import annotations

import contextlib
import errno
import mmap
import os
import re
import resource
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from .errors import BenchLogError

PIECE_B = 8_000_000  #: of a file, at a time
#: That a log may take in memory: an hour of forty columns at 800 Hz.  A few bytes can stand for any number of numbers
#: in every format that packs.
LARGEST_B = 1_000_000_000
#: What any file may stand for, and how many times its own size one that stands for more: measured numbers pack to a
#: third of what they take, those of few digits and columns that stand still to a tenth.
SMALL_B, MOST_TIMES = 50_000_000, 100
#: What a library may take and write where a file lies about that: as much as the log, its bytes, and objects of them
#: twice.
UNPACKING_B = 4 * LARGEST_B
#: What a byte of a book takes that is not read row by row, but becomes objects, all of it: of its texts, whose shortest
#: take 20 bytes, and of all else: styles of five bytes were measured to take 130 times as much.
_TEXTS_B, _WHOLE_B = 20, 150
#: How a row of a sheet begins, by whatever name its space goes, and no more bytes than that takes.
_ROW, _ROW_B = re.compile(rb"<(?:[^\s<>/:]{1,40}:)?row[\s/>]"), 50
#: Of MATLAB's level 5: its header, the tag of an element, the type of one that is packed, and what a byte of text
#: becomes.
_MATLAB_HEADER_B, _MATLAB_TAG_B, _MATLAB_PACKED, _CHARACTER_B = 128, 8, 15, 4
#: Kinds of its elements: numbers, matrices and what they are packed in, text; how deep structures stand in each other.
_MATLAB_KINDS, _MATLAB_MATRIX, _MATLAB_DEEPEST = {*range(1, 8), 9, *range(12, 19)}, 14, 20
#: How a matrix begins (kind and length of its flags); which of them are of characters and numbers, and which of these
#: has rows and columns beside; what in the flags says that there is an imaginary part.
_MATLAB_FLAGS, _MATLAB_NUMBERS, _MATLAB_SPARSE, _MATLAB_COMPLEX = (6, 8), range(4, 16), 5, 0x800
_SQLITE = b"SQLite format 3\0"  #: how a database begins
#: Of MCAP: how a file begins, kind and length of a record, the kind of a chunk, and where that says how large it is.
_MCAP, _RECORD, _CHUNK, _CHUNK_SIZE = b"\x89MCAP0\r\n", struct.Struct("<BQ"), 6, struct.Struct("<QQQ")


def refuse_larger(path: Path, size_B: float) -> None:
    """Raise BenchLogError where what a file holds takes more memory than a log may."""
    if size_B > LARGEST_B:
        raise BenchLogError(
            f"{path}: takes more than {LARGEST_B / 1e9:g} GB where it is unpacked; cut the log into parts"
        )
    if size_B > max(SMALL_B, MOST_TIMES * path.stat().st_size):
        raise BenchLogError(
            f"{path}: {path.stat().st_size} bytes that stand for {size_B / 1e6:.0f} MB; no log packs so well"
        )


@contextlib.contextmanager
def unpacking(path: Path) -> Iterator[None]:
    """While libraries unpack a file: what it says of its own size they may believe, or not look at.

    Raises BenchLogError where it takes more than ``UNPACKING_B`` of memory, or as much in a file.
    """
    pages = Path("/proc/self/statm").read_text().split()[0]
    most_B = {resource.RLIMIT_AS: int(pages) * resource.getpagesize() + UNPACKING_B, resource.RLIMIT_FSIZE: UNPACKING_B}
    before = {each: resource.getrlimit(each) for each in most_B}
    try:
        for each, (soft_B, hard_B) in before.items():
            stands_B = [b for b in (soft_B, hard_B) if b != resource.RLIM_INFINITY]
            resource.setrlimit(each, (min([most_B[each], *stands_B]), hard_B))
        yield
    except (MemoryError, OSError) as error:
        if isinstance(error, OSError) and error.errno != errno.EFBIG:
            raise
        raise BenchLogError(
            f"{path}: takes more than {UNPACKING_B / 1e9:g} GB where it is unpacked; cut the log into parts"
        ) from error
    finally:
        for each, limits in before.items():
            resource.setrlimit(each, limits)


def look_at_recording(path: Path) -> None:
    """Refuse a file of a recording that is none, or takes too much as it says itself."""
    if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would be awaited
        raise BenchLogError(f"{path}: is no file; a recording is wanted")
    if path.suffix == ".mcap":
        refuse_larger(path, _largest_chunk_B(path))
    elif path.is_file():
        with path.open("rb") as file:
            is_database = file.read(len(_SQLITE)) == _SQLITE
        if is_database:
            _look_at_database(path)


def _look_at_database(path: Path) -> None:
    """Refuse one whose messages are computed when they are read: a few words stand for any number of bytes."""
    with contextlib.closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        computed = database.execute(
            "SELECT s.name, c.name FROM sqlite_schema s, pragma_table_xinfo(s.name) c WHERE c.hidden > 1"
        ).fetchone()
    if computed:
        raise BenchLogError(
            f"{path}: column '{computed[1]}' of its table '{computed[0]}' is computed; what was recorded is wanted"
        )


def _largest_chunk_B(path: Path) -> int:
    """What the largest chunk of an MCAP file takes where it is unpacked, which is one at a time."""
    largest_B = 0
    with path.open("rb") as file:
        end = file.seek(0, os.SEEK_END)
        file.seek(len(_MCAP))
        while len(record := file.read(_RECORD.size)) == _RECORD.size:
            kind, length_B = _RECORD.unpack(record)
            begin = file.tell()
            if kind == _CHUNK and length_B >= _CHUNK_SIZE.size:
                largest_B = max(largest_B, _CHUNK_SIZE.unpack(file.read(_CHUNK_SIZE.size))[2])
            file.seek(min(begin + length_B, end))
    return largest_B


def look_at_excel(path: Path) -> None:
    """Refuse a book whose parts take too much, each as what the book says that it is: its name is anybody's choice."""
    from openpyxl.packaging.manifest import Manifest
    from openpyxl.xml.constants import ARC_CONTENT_TYPES
    from openpyxl.xml.functions import fromstring

    with zipfile.ZipFile(path) as packed:
        refuse_larger(path, _WHOLE_B * packed.getinfo(ARC_CONTENT_TYPES).file_size)
        kinds: dict[str, set[str]] = {}
        for said in Manifest.from_tree(fromstring(packed.read(ARC_CONTENT_TYPES))).Override:
            if said.ContentType.endswith("xml"):
                kinds.setdefault(said.PartName[1:], set()).add(said.ContentType)
        parts = [(each, _times(each.filename, kinds.get(each.filename, set()))) for each in packed.infolist()]
        refuse_larger(path, sum(times * part.file_size for part, times in parts))
        for part, times in parts:
            if times == 1 and (part.filename in kinds or part.filename.endswith(".xml")):  # a sheet, and no picture
                with packed.open(part) as sheet:
                    refuse_larger(path, _WHOLE_B * _longest_row_B(sheet))


def _longest_row_B(sheet: IO[bytes]) -> int:
    """The most of a sheet that is from one row to the next, or after the last: that becomes objects at once."""
    longest_B, row_at, read_B, rest = 0, 0, 0, b""
    while piece := sheet.read(PIECE_B):
        text, text_at = rest + piece, read_B - len(rest)
        for row in _ROW.finditer(text):
            begins_at = text_at + row.start()
            if begins_at > row_at:  # not one that the piece before has had
                longest_B, row_at = max(longest_B, begins_at - row_at), begins_at
        read_B, rest = read_B + len(piece), text[-_ROW_B:]
    return max(longest_B, read_B - row_at)


def _times(part: str, kinds: set[str]) -> int:
    """How many times its size a part of a book takes, of which the book says that it is XML of these kinds."""
    from openpyxl.xml.constants import SHARED_STRINGS, WORKSHEET_TYPE

    others = kinds - {WORKSHEET_TYPE}
    if part.endswith(".rels") or others:
        return _TEXTS_B if others == {SHARED_STRINGS} else _WHOLE_B
    return _WHOLE_B if part.endswith(".xml") and not (kinds or part.startswith("xl/worksheets/")) else 1


def look_at_matlab(path: Path) -> None:
    """Refuse a file of level 5 whose packed elements take too much, or whose elements SciPy would break on.

    What they take stands nowhere, so it is counted.  SciPy believes kind and length of an element: of others than there
    are the process ends with a bus error.
    """
    size_B = path.stat().st_size
    if size_B < _MATLAB_HEADER_B:
        return  # no file of level 5: the reader will say so
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        order = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}.get(content[_MATLAB_HEADER_B - 4 : _MATLAB_HEADER_B])
        if order is None:
            return  # of another level
        unpacked_B, at = 0, _MATLAB_HEADER_B
        while at + _MATLAB_TAG_B <= size_B:
            kind, length_B = struct.unpack_from(f"{order}II", content, at)
            begin, at = at, at + _MATLAB_TAG_B + length_B
            if kind == _MATLAB_PACKED:
                unpacker, parts = zlib.decompressobj(), []
                left = content[begin + _MATLAB_TAG_B : at]
                while left:
                    parts.append(unpacker.decompress(left, PIECE_B))
                    unpacked_B += len(parts[-1])
                    refuse_larger(path, _CHARACTER_B * unpacked_B)
                    left = unpacker.unconsumed_tail
                _look_at_elements(path, b"".join(parts), order, 0)
            else:
                _look_at_elements(path, content[begin:at], order, 0)


def _look_at_elements(path: Path, content: bytes, order: str, level: int) -> list[int]:
    """Refuse elements that are of no kind there is, longer than what they stand in, or nested beyond reason; the kind
    of each."""
    kinds: list[int] = []
    at = 0
    while at + _MATLAB_TAG_B <= len(content):
        kind, length_B = struct.unpack_from(f"{order}II", content, at)
        begin, room_B = at + _MATLAB_TAG_B, len(content) - at - _MATLAB_TAG_B
        if kind >> 16:  # a short one, in its own tag
            kind, length_B, begin, room_B = kind & 0xFFFF, kind >> 16, at + 4, 4
            at += _MATLAB_TAG_B
        else:
            at = begin + length_B + -length_B % _MATLAB_TAG_B
        if kind not in _MATLAB_KINDS or length_B > room_B or level > _MATLAB_DEEPEST:
            raise BenchLogError(f"{path}: is no readable .mat file (an element of kind {kind} with {length_B} bytes)")
        if kind == _MATLAB_MATRIX and length_B:
            inside = content[begin : begin + length_B]
            _look_at_matrix(path, inside, _look_at_elements(path, inside, order, level + 1), order)
        kinds.append(kind)
    return kinds


def _look_at_matrix(path: Path, content: bytes, kinds: list[int], order: str) -> None:
    """Refuse a matrix that lacks some of its numbers: SciPy reads on in what follows, and breaks on another matrix."""
    tag = struct.unpack_from(f"{order}II", content) if len(content) >= 2 * _MATLAB_TAG_B else ()
    flags = struct.unpack_from(f"{order}I", content, _MATLAB_TAG_B)[0] if tag == _MATLAB_FLAGS else 0
    which, is_complex = flags & 0xFF, bool(flags & _MATLAB_COMPLEX)
    if which in _MATLAB_NUMBERS:
        parts = (3 if which == _MATLAB_SPARSE else 1) + is_complex
        if _MATLAB_MATRIX in kinds or len(kinds) < 3 + parts:  # flags, size and name come first
            raise BenchLogError(f"{path}: is no readable .mat file (a matrix without all of its numbers)")
    elif not which:
        raise BenchLogError(f"{path}: is no readable .mat file (a matrix that does not say of what)")
