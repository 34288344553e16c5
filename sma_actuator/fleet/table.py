"""The table of a fleet: a Parquet file with a row for every log, to which rows are appended and never half of one."""

from __future__ import annotations

import fcntl
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sma_actuator.base.errors import UserError
from sma_actuator.base.parameters import ConfigError
from sma_actuator.logs.files import write_atomically

#: What a row is known by: where all of these are the same the work would be the same.
KEY = ("command", "log", "log_sha256", "model_sha256", "options", "version")
#: What tells of the worker and not of the log: it differs from run to run.
OF_THE_WORKER = ("seconds", "peak_memory_MB", "worker")
_TYPES = {
    "command": "string",
    "wire": "string",
    "log": "string",
    "date": "date",
    "log_sha256": "string",
    "model_sha256": "string",
    "options": "string",  #: JSON
    "version": "string",  #: of this package
    "verdict": "string",
    "sentence": "string",
    "effects": "strings",
    "error_percent": "number",  #: of full stroke; with the model as it is
    "error_after_percent": "number",  #: with what was found
    "details": "string",  #: JSON, as the command's own report
    "model": "string",  #: YAML, where there is one
    "seconds": "number",
    "peak_memory_MB": "number",  #: of the worker so far
    "worker": "string",
}


def _arrow() -> Any:
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise ConfigError(f"--table: needs the Python package '{error.name}' (extra 'fleet')") from error
    return pyarrow


def _schema() -> Any:
    arrow = _arrow()
    types = {
        "string": arrow.string(),
        "strings": arrow.list_(arrow.string()),
        "number": arrow.float64(),
        "date": arrow.timestamp("us", tz="UTC"),
    }
    return arrow.schema([(name, types[kind]) for name, kind in _TYPES.items()])


def read_table(path: Path) -> list[dict[str, Any]]:
    """All rows, the oldest first; none where there is no table yet.  Raises UserError."""
    arrow = _arrow()
    if not path.exists():
        return []
    try:
        table = arrow.parquet.read_table(path)
    except (OSError, arrow.ArrowException) as error:
        raise UserError(f"{path}: is no Parquet table ({error})") from error
    lacking = [name for name in _TYPES if name not in table.column_names]
    if lacking:
        raise UserError(f"{path}: is no table of a fleet: column {lacking[0]} is missing")
    return table.to_pylist()


def append(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Add rows.  Two processes may append to one table: each waits for the other."""
    if not rows:
        return
    arrow = _arrow()
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.with_name(f".{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        table = arrow.Table.from_pylist([*read_table(path), *map(dict, rows)], schema=_schema())
        write_atomically(path, lambda stream: arrow.parquet.write_table(table, stream))


def key_of(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """What a row is known by."""
    return tuple(row[name] for name in KEY)
