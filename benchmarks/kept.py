"""Keep on disk what is costly to make and always comes out the same, as long as the sources that make it stand.

What is kept lies in ``out/kept`` and may be deleted at any time.
"""

from __future__ import annotations

import functools
import hashlib
import os
import pickle
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar, overload

from sma_actuator.logs.files import write_atomically

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "out" / "kept"
#: What decides what a bench shows, and what identifies a model from it.
BENCH = ("plant", "bench", "characterise", "instruments", "base")
MODEL = (*BENCH, "identify", "estimation", "calibration")

T = TypeVar("T")


@overload
def kept(what: str, rooms: Sequence[str], make: Callable[[], T]) -> T: ...


@overload
def kept(what: str, rooms: Sequence[str], make: Callable[[], T] | None) -> T | None: ...


def kept(what: str, rooms: Sequence[str], make: Callable[[], T] | None) -> T | None:
    """What ``make`` makes, from disk where it was made before by the same sources of these rooms.

    ``what`` says everything that else decides it.  Without ``make``, None where it was not made before.
    """
    name = hashlib.sha256(f"{what} {_sources(tuple(rooms))}".encode()).hexdigest()[:24]
    path = FOLDER / f"{name}.pickle"
    if path.is_file():
        return pickle.loads(path.read_bytes())
    if make is None:
        return None
    made = make()
    FOLDER.mkdir(parents=True, exist_ok=True)
    write_atomically(path, lambda stream: stream.write(pickle.dumps(made)))
    return made


@functools.cache
def _sources(rooms: tuple[str, ...]) -> str:
    """A digest of the rooms' sources, and of the file here that drives the bench."""
    paths = [p for room in rooms for p in (ROOT / "sma_actuator" / room).rglob("*.py")]
    paths.append(ROOT / "benchmarks" / "blind_cases.py")
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(os.fsencode(path.relative_to(ROOT)) + path.read_bytes())
    return digest.hexdigest()
