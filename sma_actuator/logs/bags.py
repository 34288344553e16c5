"""Bench logs from rosbag2 recordings (SQLite or MCAP): every column is named a topic and a field."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.base.errors import named
from sma_actuator.base.parameters import ConfigError

from .bench_log import COLUMNS, BenchLog, log_of
from .errors import BenchLogError
from .recorder import RECORDED_COLUMNS
from .tables import Table
from .unpacking import look_at_recording, unpacking

#: Bytes at a message's end that are tried as meaningless, in turn; up to 3 more are none of the reader's concern.
_SPARE_B = (0, 4, 8)


def is_bag(path: Path) -> bool:
    """Whether a path is a recording rather than a bench log."""
    return path.suffix in (".mcap", ".db3") or (path.is_dir() and (path / "metadata.yaml").exists())


def log_from_bag(path: str | Path, topics: Mapping[str, str]) -> BenchLog:
    """A bench log from a recording.

    Without ``topics`` it is taken from the topic ``~/signals`` of a node, which carries every column of the node's own
    bench log.  Else ``topics`` maps a column to ``/topic:field.path``, as ``load_N → /wire/load:wrench.force.x`` or
    ``displacement_m → /joint_states:position.0``.  Rows stand at the times of the first column's
    messages (their header stamps where they have any); the other columns are interpolated, and NaN more
    than a period before their first and after their last message.  Raises BenchLogError naming the topic or field.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError as error:
        raise ConfigError(f"{path}: recordings need the Python package 'rosbags' (extra 'bags')") from error

    path = Path(path)
    folder = path.parent if path.suffix == ".db3" else path
    try:
        for each in sorted(folder.iterdir()) if folder.is_dir() else [folder]:
            look_at_recording(each)
        with unpacking(path), AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            if not topics:
                return _log_of_signals(reader, path)
            wanted = {column: _split(column, spec) for column, spec in topics.items()}
            series = _series(reader, path, wanted)
    except BenchLogError:
        raise
    except AnyReaderError as error:
        raise BenchLogError(f"{path}: is no readable rosbag2 recording ({error})") from error
    except Exception as error:
        raise BenchLogError(f"{path}: is no readable rosbag2 recording ({type(error).__name__}: {error})") from error
    for column, rows in series.items():
        if not rows:
            raise BenchLogError(f"{path}: topic {wanted[column][0]} (for {column}) holds no message")
    arrays = {
        column: np.array(rows)[np.argsort([t for t, _ in rows], kind="stable")] for column, rows in series.items()
    }
    time_s = np.unique(next(iter(arrays.values()))[:, 0])
    columns = {"time_s": time_s - time_s[0]}
    for column, stamped in arrays.items():
        columns[column] = np.interp(time_s, stamped[:, 0], stamped[:, 1])
        period_s = np.median(np.diff(stamped[:, 0])) if len(stamped) > 1 else 0.0
        columns[column][(time_s < stamped[0, 0] - period_s) | (time_s > stamped[-1, 0] + period_s)] = np.nan
    return BenchLog(columns, {"recording": path.name}, str(path))


def _series(
    reader: Any, path: Path, wanted: Mapping[str, tuple[str, list[str]]]
) -> dict[str, list[tuple[float, float]]]:
    """Time and value of every message, by column."""
    series: dict[str, list[tuple[float, float]]] = {column: [] for column in wanted}
    present = {c.topic for c in reader.connections}
    for column, (topic, _) in wanted.items():
        if topic not in present:
            raise BenchLogError(
                f"{path}: topic {topic} (for {column}) is not recorded; recorded are {named(sorted(present)) or 'none'}"
            )
    connections = [c for c in reader.connections if c.topic in {topic for topic, _ in wanted.values()}]
    for connection, stamp_ns, raw in reader.messages(connections=connections):
        message = _message(reader, raw, connection.msgtype)
        time_s = _stamp_s(message, stamp_ns)
        for column, (topic, field) in wanted.items():
            if topic == connection.topic:
                series[column].append((time_s, _field(message, field, f"{path}: topic {topic}")))
    return series


def _message(reader: Any, raw: bytes, kind: str) -> Any:
    """The message in ``raw``, behind which rclpy's ``serialize_message`` leaves up to 8 bytes that mean nothing."""
    from rosbags.highlevel import AnyReaderError

    for spare in _SPARE_B:
        with contextlib.suppress(AnyReaderError):
            return reader.deserialize(raw[: len(raw) - spare], kind)
    return reader.deserialize(raw, kind)  # and raise what is wrong with the whole


def _log_of_signals(reader: Any, path: Path) -> BenchLog:
    """The node's own bench log, as it stands in the messages of ``~/signals``."""
    connections = [
        c for c in reader.connections if c.topic.endswith("/signals") and c.msgtype == "sensor_msgs/msg/JointState"
    ]
    topics = sorted({c.topic for c in connections})
    if len(topics) != 1:
        recorded = named(sorted({c.topic for c in reader.connections})) or "none"
        what = f"{len(topics)} nodes' signals are" if topics else "no node's ~/signals is"
        raise BenchLogError(
            f"{path}: {what} recorded (recorded are {recorded}); name a topic for every column, as "
            "--topic supply_voltage_V=/topic:data"
        )
    rows: dict[float, tuple[dict[str, float], str]] = {}
    for connection, _, raw in reader.messages(connections=connections):
        message = _message(reader, raw, connection.msgtype)
        values = dict(zip(message.name, message.position.tolist(), strict=False))
        if "time_s" in values:
            rows[values["time_s"]] = values, message.header.frame_id
    if not rows:
        raise BenchLogError(f"{path}: topic {topics[0]} holds no message with a time_s")
    return log_of_signals(rows, str(path), {"recording": path.name})


def log_of_signals(
    rows: Mapping[float, tuple[Mapping[str, float], str]], source: str, metadata: Mapping[str, Any]
) -> BenchLog:
    """A bench log of messages of ``~/signals``: by their ``time_s``, the named values and what happened before."""
    times_s = sorted(rows)
    columns = {
        name: np.array([rows[time_s][0].get(name, np.nan) for time_s in times_s], dtype=float)
        for name in RECORDED_COLUMNS
    }
    table = Table(columns, source, texts={i: rows[t][1] for i, t in enumerate(times_s) if rows[t][1]})
    return log_of(table, metadata)


def parse_topics(words: list[str]) -> dict[str, str]:
    """``column=/topic:field`` words as a mapping.  Raises BenchLogError."""
    out = {}
    for word in words:
        column, separator, spec = word.partition("=")
        if not separator or column not in COLUMNS or column == "time_s":
            known = ", ".join(c for c in COLUMNS if c != "time_s")
            raise BenchLogError(f"--topic {word}: COLUMN=/topic:field is wanted, with a column of {known}")
        out[column] = spec
    return out


def _split(column: str, spec: str) -> tuple[str, list[str]]:
    match = re.fullmatch(r"(/[^:]+):([A-Za-z_][\w.]*)", spec)
    if not match:
        raise BenchLogError(f"{column}: '{spec}' does not name a topic and a field, as /wire/load:wrench.force.x")
    return match[1], match[2].split(".")


def _field(message: Any, field: list[str], place: str) -> float:
    value = message
    for name in field:
        try:
            value = value[int(name)] if name.isdigit() else getattr(value, name)
        except (AttributeError, IndexError, TypeError):
            raise BenchLogError(f"{place}: a message has no field {'.'.join(field)} (no '{name}')") from None
    try:
        return float(value)
    except (TypeError, ValueError):
        raise BenchLogError(f"{place}: field {'.'.join(field)} is not a number") from None


def _stamp_s(message: Any, recorded_ns: int) -> float:
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None and (stamp.sec or stamp.nanosec):
        return stamp.sec + stamp.nanosec * 1e-9
    return recorded_ns * 1e-9
