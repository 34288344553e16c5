"""Where the logs of a fleet lie: folders, patterns and URLs, through fsspec; found by the client, read by the
worker."""

from __future__ import annotations

import datetime
import glob
import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sma_actuator.base.parameters import ConfigError
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.reading import ENDINGS

_DATE = re.compile(r"(20\d\d)-?([01]\d)-?([0-3]\d)(?:[T_ -]?([0-2]\d)[-:]?([0-5]\d)[-:]?([0-5]\d))?")


@dataclass(frozen=True, slots=True)
class Place:
    """One log and the wire that it is of."""

    url: str  #: of a log of this machine: its path
    wire: str


@dataclass(frozen=True, slots=True)
class Fetched:
    """A log where its worker can read it."""

    path: Path
    sha256: str  #: of the log and of the JSON file beside it
    date: datetime.datetime


def _file_system(url: str) -> tuple[Any, str]:
    """A file system and the path in it.  Raises ConfigError where the package for it is missing."""
    try:
        import fsspec
    except ModuleNotFoundError as error:
        raise ConfigError(f"--table: needs the Python package '{error.name}' (extra 'fleet')") from error
    try:
        return fsspec.core.url_to_fs(url)
    except (ImportError, ValueError) as error:
        raise ConfigError(f"{url}: {error}") from error


def _is_local(url: str) -> bool:
    return "://" not in url


def find(places: Sequence[str], wire_name: str = "", but: Path | None = None) -> list[Place]:
    """The logs at some places, in order, each once; ``but`` is none of them.  Raises BenchLogError, ConfigError."""
    found: list[str] = []
    for place in places:
        files, path = _file_system(place)
        if files.isdir(path):
            inside = [p for p in sorted(files.find(path)) if p.lower().endswith(ENDINGS)]
        elif glob.has_magic(path):
            inside = sorted(files.glob(path))
        else:
            inside = [path]
        if not inside:
            raise BenchLogError(f"{place}: no log there (files that end with {', '.join(ENDINGS)})")
        found += inside if _is_local(place) else [files.unstrip_protocol(p) for p in inside]
    left_out = str(but.resolve()) if but else ""
    return [Place(url, _wire_of(url, wire_name)) for url in dict.fromkeys(found) if url != left_out]


def _wire_of(url: str, wire_name: str) -> str:
    if not wire_name:
        return url.replace("\\", "/").rsplit("/", 2)[-2]
    match = re.search(wire_name, url)
    if match is None:
        raise ConfigError(f"--wire-name: '{wire_name}' is not found in {url}")
    return match.group(match.lastindex or 0)


def text_of(url: str) -> str:
    """A file of text."""
    files, path = _file_system(url)
    return bytes(files.cat_file(path)).decode("utf-8")


def fetch_beside(url: str, names: Sequence[str], folder: Path) -> None:
    """Copies in ``folder`` of files that lie beside one; whoever wants one that is not there says so."""
    files, path = _file_system(url)
    for name in names:
        there = f"{path.rpartition('/')[0]}/{name}"
        if files.exists(there):
            files.get_file(there, str(folder / name))


def fetch(url: str, folder: Path) -> Fetched:
    """A log with what lies beside it: where it is, if that is this machine, or else a copy in ``folder``."""
    files, remote = _file_system(url)
    beside = remote.rsplit(".", 1)[0] + ".json"
    path = Path(remote)
    if not _is_local(url):
        path = folder / Path(remote).name
        files.get_file(remote, str(path))
        if files.exists(beside):
            files.get_file(beside, str(path.with_suffix(".json")))
    metadata = path.with_suffix(".json").read_bytes() if path.with_suffix(".json").exists() else b""
    sha256 = hashlib.sha256(path.read_bytes() + b"\0" + metadata).hexdigest()
    return Fetched(path, sha256, _date_of(url, metadata) or files.modified(remote).astimezone(datetime.UTC))


def _date_of(url: str, metadata: bytes) -> datetime.datetime | None:
    """When a log was begun: as it says itself, or as its name does."""
    try:
        said = datetime.datetime.fromisoformat(json.loads(metadata)["started"])
        return said.astimezone(datetime.UTC)
    except (ValueError, KeyError, TypeError):
        pass
    named = _DATE.search(url.rsplit("/", 1)[-1])
    if named is None:
        return None
    try:
        year, month, day, hour, minute, second = (int(part or 0) for part in named.groups())
        return datetime.datetime(year, month, day, hour, minute, second, tzinfo=datetime.UTC)
    except ValueError:
        return None
