"""Fuzzing of everything that reads what others wrote: files of all kinds, messages, and what a page asks.

    python -m attack.parsers --minutes 60          every parser in turn, as ``make fuzz``
    python -m attack.parsers csv --minutes 5       one of them

Atheris changes inputs where that reaches new lines.  What may leave a parser is a UserError with its sentence, or, of
messages, the ValueError that the node answers with; anything else, more than 2.5 GB, or 20 s for one input, is found.
The corpus in ``attack/corpus`` is kept, and ``tests/attack`` goes through it with every test run; what breaks a parser
is put there.  What atheris has learned besides stays in ``out/fuzz`` and is gone on with.
"""

from __future__ import annotations

import argparse
import asyncio
import collections
import importlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CORPUS = Path(__file__).with_name("corpus")
LEARNED = ROOT / "out" / "fuzz"
LONGEST_INPUT_B = 20_000  #: of any; a parser's states are reached by less
LONGEST_s, LARGEST_MB = 20, 2500
_LOG = b"time_s,resistance_Ohm,current_A,load_N,displacement_m\n" + b"".join(
    b"%g,%g,0.1,1.0,%g\n" % (0.1 * k, 4.0 + 0.01 * k, 1e-3 + 1e-5 * k) for k in range(12)
)


# --- the parsers ---------------------------------------------------------------------------------------


def _in_a_file(
    name: str, read: Callable[[Path], Any], others: dict[str, bytes] | None = None
) -> Callable[[bytes], None]:
    """A parser of files, as one of bytes."""

    def parse(data: bytes) -> None:
        from sma_actuator.base.errors import UserError

        with tempfile.TemporaryDirectory(prefix="sma_fuzz_", dir=_memory()) as folder:
            for each, content in {**(others or {}), name: data}.items():
                (Path(folder) / each).write_bytes(content)
            try:
                read(Path(folder) / name)
            except UserError as error:
                _says_why(error)

    return parse


def _says_why(error: Exception) -> None:
    if not str(error):
        raise AssertionError("a refusal without a sentence") from error


def _memory() -> str | None:
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def _log(path: Path) -> None:
    from sma_actuator.logs.reading import ReadingOptions, read_logs

    read_logs([path], ReadingOptions())


def _metadata(path: Path) -> None:
    _log(path.with_name("log.csv"))


def _parameters(path: Path) -> None:
    from sma_actuator.config import Config

    Config.load(path)


def _supply(path: Path) -> None:
    from sma_actuator.instruments.dialect import Dialect

    dialect = Dialect.load(str(path), "supply")
    dialect.off_lines(1)
    dialect.lines("set_current", channel=1, value=0.1)


def _daq(path: Path) -> None:
    from sma_actuator.instruments.dialect import Dialect

    Dialect.load(str(path), "daq").lines("prepare", channels="101,102", samples=50, readings=100)


def _map(path: Path) -> None:
    from sma_actuator.logs.bench_log import COLUMNS
    from sma_actuator.logs.mapping import column_map

    column_map([], [], [], path, tuple(COLUMNS))


def _wire(path: Path) -> None:
    from sma_actuator.diagnosis.forward.wire import read_wire

    read_wire(path)


def _message(kind: str, take: Callable[[Any], Any]) -> Callable[[bytes], None]:
    """What takes a message; bytes that are none of its kind are ROS's own concern."""

    def parse(data: bytes) -> None:
        from rclpy.serialization import deserialize_message

        package, _, name = kind.partition("/")
        try:
            message = deserialize_message(data, getattr(importlib.import_module(f"{package}.msg"), name))
        except Exception:  # noqa: BLE001 - refused by the node's guard, whatever ROS makes of it
            return
        try:
            take(message)
        except ValueError as error:
            _says_why(error)

    return parse


def _trajectory(message: Any) -> None:
    from sma_actuator.control.setpoints import Trajectory
    from sma_msgs_py import start_from, trajectory_from

    times_s, positions_m, velocities_m_s = trajectory_from(message, "sma_joint")
    start_from(message, 10**18)
    if times_s:
        Trajectory(times_s, positions_m, velocities_m_s=velocities_m_s)


def _joint_command(message: Any) -> None:
    from sma_msgs_py import joint_command_from

    joint_command_from(message, "sma_joint")


def _status(message: Any) -> None:
    from sma_actuator.view.watched import status_of

    json.dumps(status_of(message), allow_nan=False)


class StillWire:
    """A node for the page that says what it is told to say, and does nothing but note what is asked of it."""

    node = "/sma_actuator"

    def __init__(self) -> None:
        self.rows: collections.deque[list[float | None]] = collections.deque()
        self.version = self.parameters_version = 0
        self.present = True
        self.status: dict[str, Any] | None = None
        self.diagnostics: dict[str, Any] = {}
        self.parameters: dict[str, Any] = {}
        self.live: dict[str, Any] = {}
        self.services: list[str] = []
        self.done: list[Any] = []

    async def listen(self, wanted: bool) -> None:
        """A page has come, or the last has gone."""
        self.done.append(("listen", wanted))

    async def watch(self) -> None:
        """For ever."""
        await asyncio.Event().wait()

    async def stop(self) -> str:
        """Off, of every wire."""
        self.done.append("stop")
        return "every wire is off"

    async def enable(self, on: bool) -> str:
        """On or off."""
        self.done.append(("enable", on))
        return "on" if on else "off"

    async def send_setpoint(self, position_m: float) -> str:
        """A setpoint."""
        self.done.append(position_m)
        return "sent"

    async def send_angle(self, angle_rad: float) -> str:
        """An angle of a joint."""
        self.done.append(angle_rad)
        return "sent"

    async def set_parameter(self, name: str, value: Any) -> str:
        """As a node is asked: what ROS has no type for is refused by it."""
        from rclpy.parameter import Parameter

        Parameter(name, value=value).to_parameter_msg()
        self.done.append((name, value))
        return "set"

    async def trigger(self, name: str) -> str:
        """A service without an argument."""
        self.done.append(name)
        return "done"


def _page(data: bytes) -> None:
    from sma_actuator.view.server import Desk, _Page

    async def ask() -> None:
        page = _Page()
        desk = Desk(StillWire())  # type: ignore[arg-type]
        desk.take(page, data.decode(errors="replace"))
        for outcome in await asyncio.gather(*page.asked, return_exceptions=True):
            if isinstance(outcome, BaseException):
                raise outcome
        assert len(page.waiting) == 1, "every question has one answer"
        for answer in page.waiting:
            json.loads(answer, parse_constant=_refuse)

    asyncio.run(ask())


def _refuse(word: str) -> None:
    raise AssertionError(f"{word} is no JSON")


PARSERS: dict[str, Callable[[bytes], None]] = {
    "parameters": _in_a_file("a.yaml", _parameters),
    "supply": _in_a_file("a.yaml", _supply),
    "daq": _in_a_file("a.yaml", _daq),
    "map": _in_a_file("a.yaml", _map),
    "wire": _in_a_file("a.yaml", _wire),
    "metadata": _in_a_file("log.json", _metadata, {"log.csv": _LOG}),
    **{
        ending: _in_a_file(f"log.{ending}", _log)
        for ending in ("csv", "xlsx", "parquet", "mat", "tdms", "h5", "mcap", "db3")
    },
    "trajectory": _message("trajectory_msgs/JointTrajectory", _trajectory),
    "joint_command": _message("sensor_msgs/JointState", _joint_command),
    "status": _message("diagnostic_msgs/DiagnosticStatus", _status),
    "page": _page,
}


# --- the engine ----------------------------------------------------------------------------------------


def corpus(name: str) -> list[bytes]:
    """What is kept for a parser."""
    return [path.read_bytes() for path in sorted((CORPUS / name).iterdir())]


def main(arguments: list[str] | None = None) -> int:
    """Fuzz; 0 where nothing was found."""
    parser = argparse.ArgumentParser(prog="python -m attack.parsers", description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="*", choices=[*PARSERS, []], default=[])
    parser.add_argument("--minutes", type=float, default=10.0, help="for all of them together")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    names = options.what or list(PARSERS)
    seconds = max(1, round(60.0 * options.minutes / len(names)))
    if options.one:
        return _fuzz(names[0], seconds)
    broken = []
    for name in names:
        command = [sys.executable, "-m", "attack.parsers", name, "--one", "--minutes", str(seconds / 60.0)]
        log = LEARNED / f"{name}.txt"
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("w") as said:
            code = subprocess.run(command, cwd=ROOT, stdout=said, stderr=said, check=False).returncode
        text = log.read_text(errors="replace")
        runs = next((line.split()[1] for line in reversed(text.splitlines()) if line.startswith("Done ")), "?")
        print(
            f"{name}: {runs} inputs in {seconds} s, {'nothing found' if not code else f'FOUND, see {log}'}", flush=True
        )
        broken += [name] if code else []
    return 1 if broken else 0


def _fuzz(name: str, seconds: int) -> int:
    """Let atheris try one parser; it ends the process."""
    import atheris

    learned = LEARNED / name
    learned.mkdir(parents=True, exist_ok=True)
    parse = PARSERS[name]
    with atheris.instrument_imports(include=["sma_actuator", "sma_msgs_py"]):
        for data in corpus(name):  # imports what it needs
            parse(data)
    options = {
        "max_total_time": seconds,
        "max_len": LONGEST_INPUT_B,
        "timeout": LONGEST_s,
        "rss_limit_mb": LARGEST_MB,
        "artifact_prefix": f"{CORPUS / name}/found-",
    }
    words = [f"-{key}={value}" for key, value in options.items()]
    atheris.Setup([sys.argv[0], *words, str(learned), str(CORPUS / name)], parse)
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())
