"""What every command does alike at the edge to a person or a machine.

Results go to standard output, progress and notes to standard error.  No file that exists is overwritten without
``--force``.  ``FILE`` of ``--json`` and ``--csv`` may be ``-``, which is standard output: what people read then goes
to standard error.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
import os
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from sma_actuator.base.errors import UserError
from sma_actuator.logs.files import write_atomically

__all__ = [
    "add_output_arguments",
    "headed",
    "notes",
    "progress_bar",
    "questions",
    "refuse_to_overwrite",
    "results",
    "say_next",
    "typed",
    "write_csv",
    "write_json",
]

_STANDARD_OUTPUT = Path("-")
_UNBROKEN = 100_000  #: columns of a pipe or a file: whoever reads it breaks the lines


def add_output_arguments(parser: argparse.ArgumentParser, json_of: str, csv_of: str = "") -> None:
    """Declare ``--json``, ``--csv`` where there is a table, and ``--force``."""
    parser.add_argument("--json", type=Path, metavar="FILE", help=f"write {json_of} here as JSON (-: standard output)")
    if csv_of:
        parser.add_argument("--csv", type=Path, metavar="FILE", help=f"write {csv_of} here as CSV (-: standard output)")
    parser.add_argument("--force", action="store_true", help="overwrite files that exist already")


def results(args: argparse.Namespace) -> Console:
    """Where results go: standard output, unless a machine reads that."""
    to_machine = _STANDARD_OUTPUT in (getattr(args, "json", None), getattr(args, "csv", None))
    return _console(sys.stderr if to_machine else sys.stdout)


def notes(args: argparse.Namespace) -> Console:
    """Where progress and notes go: standard error, or nowhere with ``-q``."""
    return _console(sys.stderr, quiet=getattr(args, "quiet", False))


def headed(word: str, sentence: str) -> Text:
    """A sentence after the word that says of what it is."""
    return Text.assemble((word, "bold"), f": {sentence}")


def say_next(args: argparse.Namespace, words: str) -> None:
    """What to do with what a command has brought: its last note."""
    notes(args).print(f"next: {words}")


def typed(*paths: Path | str) -> str:
    """The paths as they are typed in a shell, whatever their names hold."""
    return shlex.join(map(str, paths))


def questions() -> Console:
    """Where questions go: standard error, also with ``-q``, since somebody has to answer."""
    return _console(sys.stderr)


def progress_bar(args: argparse.Namespace) -> Progress:
    """A progress bar beside the notes."""
    return Progress(TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=notes(args))


def _console(stream: Any, quiet: bool = False) -> Console:
    # Without markup: the brackets of a column 'U [mV]' are to be read.
    return Console(
        file=stream, width=None if stream.isatty() else _UNBROKEN, highlight=False, markup=False, quiet=quiet
    )


def refuse_to_overwrite(args: argparse.Namespace, *paths: Path | None) -> None:
    """Raise UserError where one of the files to be written exists and ``--force`` was not given, or cannot be written:
    it is a folder, a file is in the place of its folder, or the folder is not ours to write to.  What takes minutes
    then has no end."""
    for path in (*paths, getattr(args, "json", None), getattr(args, "csv", None)):
        if path is None or path == _STANDARD_OUTPUT:
            continue
        if path.is_dir():
            option = next((f"--{name.replace('_', '-')} " for name, value in vars(args).items() if value is path), "")
            raise UserError(f"{option}{path}: is a folder; name a file, in it or elsewhere")
        nearest = next((folder for folder in path.parents if folder.exists()), None)
        if nearest is not None and not nearest.is_dir():
            raise UserError(f"{nearest}: is a file; a folder for {path.name} is wanted")
        if nearest is not None and not os.access(nearest, os.W_OK | os.X_OK):
            raise UserError(f"{path}: cannot be written, since nothing may be in {nearest}; name a file elsewhere")
        if args.force:
            continue
        if path.exists() or path.is_symlink():
            raise UserError(f"{path}: exists already; --force overwrites it, or name another file")


def write_json(args: argparse.Namespace, data: Any) -> None:
    """Write ``data`` where ``--json`` says; a number that is not finite becomes null."""
    if args.json is not None:
        _write(args.json, json.dumps(_finite(data), indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def write_csv(args: argparse.Namespace, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a table where ``--csv`` says, the keys of its first row as the header."""
    if args.csv is None:
        return
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]) if rows else [], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    _write(args.csv, text.getvalue())


def _write(path: Path, text: str) -> None:
    if path == _STANDARD_OUTPUT:
        sys.stdout.write(text)
    else:
        write_atomically(path, lambda stream: stream.write(text.encode()))


def _finite(data: Any) -> Any:
    if isinstance(data, float) and not math.isfinite(data):
        return None
    if isinstance(data, Mapping):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, Iterable) and not isinstance(data, str | bytes):
        return [_finite(value) for value in data]
    return data
