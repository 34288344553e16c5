"""The long tables of a parameter file, in a file of numbers beside it: what is left a person can read and compare.

``wire.yaml`` says in its section ``tables`` which file they are in and what its SHA-256 is; so a file and its tables
cannot come apart without a word.  They are numpy's archive of plain numbers (``numpy.load`` opens it); an entry that is
anything else, a pickle above all, is refused.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .content import content_of
from .parameters import ConfigError

SECTION = "tables"  #: of a parameter file
MAY_MOVE = ("calibration", "model")  #: sections of it whose lists do
MOST_READ = (
    16  #: numbers of a list that stays in the file: those of a dozen loads are read, a regression's weights are not
)
MOST_BYTES = 2_000_000  #: of an archive, and of all that it holds; no model comes near it


def path_beside(path: Path) -> Path:
    """Where the tables of a parameter file are written."""
    return path.with_name(f"{path.stem}.tables.npz")


def taken_out(mapping: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, list[float]]]:
    """The parameters without their long tables, and these by dotted name."""
    out, tables = dict(mapping), dict[str, list[float]]()
    for name in MAY_MOVE:
        if isinstance(out.get(name), Mapping):
            out[name] = _without(out[name], name, tables)
    return out, tables


def _without(section: Mapping[str, Any], prefix: str, tables: dict[str, list[float]]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for name, value in section.items():
        if isinstance(value, Mapping):
            out[name] = _without(value, f"{prefix}.{name}", tables)
        elif _long(value):
            tables[f"{prefix}.{name}"] = [float(number) for number in value]
        else:
            out[name] = value
    return out


def _long(value: Any) -> bool:
    if not isinstance(value, (list, tuple)) or len(value) <= MOST_READ:
        return False
    return all(isinstance(number, (int, float)) and not isinstance(number, bool) for number in value)


def archive(tables: Mapping[str, list[float]]) -> bytes:
    """The file of some tables."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as entries:
        for name, numbers in tables.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.array(numbers, dtype="<f8"), version=(1, 0), allow_pickle=False)
            # A date of its own would make another file of the same numbers.
            entries.writestr(zipfile.ZipInfo(f"{name}.npy"), content.getvalue(), zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def reference(name: str, content: bytes) -> dict[str, str]:
    """The section that says where the tables are."""
    return {"file": name, "sha256": hashlib.sha256(content).hexdigest()}


def file_of(section: Any, source: str) -> str:
    """The name of the file that a section ``tables`` speaks of.  Raises ConfigError."""
    name = section.get("file") if isinstance(section, Mapping) else None
    if not isinstance(name, str) or name in ("", ".", "..") or Path(name).name != name:
        raise ConfigError(f"{source}: {SECTION}.file: the name of a file beside it is wanted, as wire.tables.npz")
    return name


def put_back(mapping: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """The parameters of the file ``path`` with the tables that lie beside it; one that stands there by name counts
    first.

    Raises ConfigError, whose sentence names both files: no such file, another one, or none of tables.
    """
    out = {name: value for name, value in mapping.items() if name != SECTION}
    if SECTION not in mapping:
        return out
    beside = path.with_name(file_of(mapping[SECTION], str(path)))
    for dotted, numbers in _read(beside, mapping[SECTION].get("sha256"), str(path)).items():
        *parents, last = dotted.split(".")
        if not parents or parents[0] not in MAY_MOVE:
            raise ConfigError(f"{path}: {beside}: {dotted} is none of the tables of {' and '.join(MAY_MOVE)}")
        _put(out, parents, last, numbers)
    return out


def _put(into: dict[str, Any], parents: list[str], last: str, numbers: list[float]) -> None:
    """Put a table into its section, copied on the way: what was read stays as it is."""
    for parent in parents:
        inside = into.get(parent, {})
        if not isinstance(inside, Mapping):
            return  # the section is refused for what it is
        into[parent] = into = dict(inside)
    into.setdefault(last, numbers)


def _read(path: Path, sha256: Any, source: str) -> dict[str, list[float]]:
    copy = "take both files from the same place, or identify the wire again"
    try:
        content = content_of(path, MOST_BYTES)
    except OSError as error:
        why = "is not there" if isinstance(error, FileNotFoundError) else f"cannot be read ({error.strerror or error})"
        raise ConfigError(f"{source}: its tables, {path}, {why}; {copy}") from error
    if hashlib.sha256(content).hexdigest() != sha256:
        raise ConfigError(f"{source}: {path} is not the file that was written with it ({SECTION}.sha256); {copy}")
    try:
        return dict(_entries(content))
    except (
        ValueError,
        SyntaxError,
        zipfile.BadZipFile,
        zlib.error,
        NotImplementedError,
        RuntimeError,
        EOFError,
    ) as error:
        raise ConfigError(f"{source}: {path}: is no file of tables ({error}); {copy}") from error


def _entries(content: bytes) -> Iterator[tuple[str, list[float]]]:
    with zipfile.ZipFile(io.BytesIO(content)) as entries:
        if sum(info.file_size for info in entries.infolist()) > MOST_BYTES or len(content) > MOST_BYTES:
            raise ValueError(f"more than {MOST_BYTES / 1e6:g} MB")
        for info in entries.infolist():
            yield info.filename.removesuffix(".npy"), _numbers(io.BytesIO(entries.read(info)), info.filename)


def _numbers(stream: io.BytesIO, name: str) -> list[float]:
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError(f"{name}: of a version that is not written here")
    shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
    numbers = stream.read()
    if dtype != np.dtype("<f8") or shape != (len(numbers) // 8,) or len(numbers) % 8:
        raise ValueError(f"{name}: no row of numbers")
    return np.frombuffer(numbers, dtype="<f8").tolist()
