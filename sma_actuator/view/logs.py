"""A log that is dropped on the page: replayed with the node's model, and traced where it holds a displacement.

Each in a process of its own, one log at a time: the page must answer, and stop the wire, meanwhile.
``python -m sma_actuator.view.logs LOG MODEL.yaml OUT.json`` is the first of them.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import json
import math
import re
import secrets
import sys
import tempfile
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sma_actuator.base.commands import NODE_NAME
from sma_actuator.base.errors import UserError
from sma_actuator.config import Config
from sma_actuator.logs.bags import log_of_signals
from sma_actuator.logs.bench_log import write_bench_log
from sma_actuator.logs.reading import ReadingOptions, read_logs
from sma_actuator.replay import replay

LARGEST_B = 500_000_000
LONGEST_NAME_B = 200  #: of a log's file; file systems take 255
#: Address space of a process that works on a log: four times what a log may take, and what the libraries reserve (0.7
#: GB).
LARGEST_PROCESS_B = 5_000_000_000
MOST_ROWS = 4000  #: that a page draws; of longer logs every n-th
REPLAY_TIMEOUT_s = 300.0
TRACE_TIMEOUT_s = 3600.0
#: Columns that are drawn as they stand in the log, where it has them.
_AS_THEY_ARE = ("setpoint_m", "temperature_C")

Tell = Callable[[dict[str, Any]], None]


class LogDesk:
    """Works on one log at a time; ``tell`` is called with what is known of it whenever that changes."""

    def __init__(self, tell: Tell):
        self._tell = tell
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._task: asyncio.Task[None] | None = None
        self.said: dict[str, Any] | None = None  #: for pages that come later
        self.reports: dict[str, Path] = {}  #: address that nobody can guess → file

    async def take(self, name: str, chunks: AsyncIterator[bytes], config: Config | None) -> None:
        """Store a log and begin to work on it; what was worked on before is given up.  Raises UserError."""
        if config is None:
            raise UserError("no node has told its model; start the page with --config MODEL.yaml to replay logs")
        if len(name.encode()) > LONGEST_NAME_B:
            raise UserError(f"{name[:40]}…: a name of more than {LONGEST_NAME_B} bytes; give the file a shorter one")
        await self.give_up()
        mine = self._folder = tempfile.TemporaryDirectory(prefix="sma_view_")
        folder = Path(mine.name)
        log = folder / (re.sub(r"[^\w.+-]", "_", Path(name).name).lstrip(".") or "log")
        with log.open("wb") as stream:
            size = 0
            async for chunk in chunks:
                size += len(chunk)
                if self._folder is not mine:
                    raise UserError(f"{name}: another log was dropped meanwhile, and takes its place")
                if size > LARGEST_B:
                    await self.give_up()
                    raise UserError(f"{name}: more than {LARGEST_B // 1_000_000} MB; use sma-actuator replay and trace")
                stream.write(chunk)
        model = folder / "model.yaml"
        model.write_text(yaml.safe_dump({NODE_NAME: {"ros__parameters": config.to_mapping()}}))
        self._task = asyncio.create_task(self._work(log, model))

    async def give_up(self) -> None:
        """End what is worked on, and forget it."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
            self._task = None
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None
        self.said = None
        self.reports = {}

    async def _work(self, log: Path, model: Path) -> None:
        said: dict[str, Any] = {"name": log.name, "words": "replaying …", "trace": ""}
        self._say(said)
        out = log.with_name("replayed.json")
        module = [sys.executable, "-m"]
        try:
            await _run([*module, "sma_actuator.view.logs", str(log), str(model), str(out)], REPLAY_TIMEOUT_s)
            said |= json.loads(out.read_text())
            if not said.pop("traceable"):
                self._say({**said, "trace": "not traced: the log holds no measured displacement"})
                return
            self._say({**said, "trace": "tracing …"})
            folder = log.with_name("traced")
            trace = ["sma_actuator", "trace", str(log), "--config", str(model), "--out", str(folder), "--jobs", "1"]
            await _run([*module, *trace], TRACE_TIMEOUT_s)
            report = json.loads((folder / "report.json").read_text())
            address = f"/report/{secrets.token_urlsafe(16)}"
            self.reports[address] = folder / "report.html"
            self._say({**said, "trace": f"{report['verdict']}: {report['sentence']}", "report": address})
        except UserError as error:
            key = "trace" if "columns" in said else "words"
            self._say({**said, key: f"not {'traced' if key == 'trace' else 'replayed'}: {error}"})

    def _say(self, said: dict[str, Any]) -> None:
        self.said = said
        self._tell(said)


async def _run(command: list[str], timeout_s: float) -> None:
    """Run a command behind everything else, in bounded memory.  Raises UserError with its last words where it fails."""
    bounded = ["sh", "-c", 'ulimit -v "$0" && exec nice "$@"', str(LARGEST_PROCESS_B // 1024)]
    process = await asyncio.create_subprocess_exec(
        *bounded, *command, stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE, start_new_session=True,
    )  # fmt: skip
    try:
        _, words = await asyncio.wait_for(process.communicate(), timeout_s)
    except TimeoutError:
        raise UserError(f"it took more than {timeout_s / 60.0:g} minutes; use sma-actuator for it") from None
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()
    if process.returncode:
        lines = words.decode(errors="replace").strip().splitlines()
        if lines and "MemoryError" in lines[-1]:
            raise UserError(f"it takes more than {LARGEST_PROCESS_B / 1e9:g} GB of memory; use sma-actuator for it")
        raise UserError(lines[-1] if lines else f"{command[2]} ended with code {process.returncode}")


def bench_log_of(rows: Mapping[float, tuple[Mapping[str, float], str]]) -> bytes:
    """A bench log as CSV of what a node's ``~/signals`` said.  Raises UserError where that is too little."""
    if len(rows) < 2:
        raise UserError("nothing is recorded yet: it is while a page is open and the node is there")
    log = log_of_signals(rows, "the last two minutes", {})
    wired = {name: values for name, values in log.columns.items() if np.isfinite(values).any()}
    with tempfile.TemporaryDirectory(prefix="sma_view_") as folder:
        path = Path(folder) / "log.csv"
        write_bench_log(path, dataclasses.replace(log, columns=wired))
        return path.read_bytes()


def replayed(log_path: Path, config: Config) -> dict[str, Any]:
    """What a page shows of a log: columns over time and, in words, how well the model did.  Raises BenchLogError."""
    notes: list[str] = []
    logs = read_logs([log_path], ReadingOptions(), notes.append)
    (found,) = replay(logs, {"model": config})
    signals, log = found.experiment.signals, found.experiment.log
    time_s = np.asarray(signals.time_s)
    every = -(-len(time_s) // MOST_ROWS)
    series = {
        "at_s": time_s - time_s[0],
        "displacement_estimate_m": found.estimates_m["model"],
        "displacement_m": found.experiment.displacement_m,
        **{name: getattr(signals, name) for name in ("current_A", "resistance_Ohm", "stress_Pa", "load_N", "power_W")},
        **{name: log[name] for name in _AS_THEY_ARE if name in log},
    }
    columns = {
        name: [_finite(x) for x in np.broadcast_to(np.asarray(v, dtype=float), time_s.shape)[::every]]
        for name, v in series.items()
    }
    error = found.errors["model"]
    measured = bool(np.isfinite(found.experiment.displacement_m).any())
    words = f"{len(time_s)} readings over {time_s[-1] - time_s[0]:.1f} s"
    if measured:
        words += (
            f"; mean absolute error of the model in the working range {error.working_percent:.2f} % of full stroke "
            f"({error.working_share:.0%} of the samples), in the full range {error.full_percent:.2f} %"
        )
    return {"columns": columns, "words": "; ".join([words, *notes]), "traceable": measured}


def _finite(value: float) -> float | None:
    return float(f"{value:.7g}") if math.isfinite(value) else None


def main() -> int:
    """Replay one log for the page; 0 when it was written, else a sentence."""
    log, model, out = map(Path, sys.argv[1:])
    try:
        out.write_text(json.dumps(replayed(log, Config.load(model)), allow_nan=False))
    except UserError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
