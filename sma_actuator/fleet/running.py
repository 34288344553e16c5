"""The work on many logs: what is asked for goes to the workers, what they find into the table, as it comes.

A worker gets the place of a log and nothing of its contents; it reads log and model itself.  What a worker did that
died is done again by another, and what is in the table is not: its hashes say whether it would be the same.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.metadata
import json
import os
import socket
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from rich.table import Table

from sma_actuator.base.errors import UserError
from sma_actuator.base.one_thread import one_thread
from sma_actuator.base.parameter_file import files_beside
from sma_actuator.console import notes, progress_bar, refuse_to_overwrite, results, say_next, typed, write_json
from sma_actuator.logs.files import write_atomically

from .places import Fetched, Place, fetch, fetch_beside, find, text_of
from .spreading import cluster, spread
from .table import append, key_of, read_table

FLUSH_s = 2.0  #: rows wait so long at the most before they are in the table
TRIES = 3  #: of work during which the workers die without having finished anything
_SHOWN = 40  #: rows that are printed


@dataclass(frozen=True, slots=True)
class Finding:
    """What there is to say of one log."""

    verdict: str
    sentence: str
    effects: tuple[str, ...] = ()
    error_percent: float = float("nan")  #: of full stroke; with the model as it is
    error_after_percent: float = float("nan")  #: with what was found
    details: Mapping[str, Any] = field(default_factory=dict)
    model: str = ""  #: YAML


#: The work: logs, the model's file and options in, a finding for every log out.
Work = Callable[[Sequence[Path], Path, Mapping[str, Any]], Sequence[Finding]]


@dataclass(frozen=True, slots=True)
class _Job:
    """What one worker is asked for at a time."""

    number: int
    command: str
    work: Work
    places: tuple[Place, ...]
    config: str
    options: Mapping[str, Any]
    together: bool
    known: frozenset[tuple[Any, ...]]  #: rows of these logs that are in the table


@dataclass(frozen=True, slots=True)
class _Outcome:
    number: int
    rows: list[dict[str, Any]]
    unread: str = ""  #: why nothing was found out that would be true another time


def run_fleet(
    args: argparse.Namespace,
    command: str,
    work: Work,
    places: Sequence[Path | str],
    config: Path | str,
    options: Mapping[str, Any],
    together: bool = False,
    models: str = "",
) -> int:
    """Work on every log by itself, or on the logs of every wire ``together``; 0 when there is a row for each.

    ``options``: what else the findings depend on, things that say so by their ``repr``.  ``models``: where the models
    found are written, with {wire} in it.  Raises UserError.
    """
    console = notes(args)
    refuse_to_overwrite(args)
    if models and "{wire}" not in models:
        raise UserError(f"{models}: {{wire}} must stand in it where every wire has a file of its own")
    if args.jobs < 1:
        raise UserError(f"--jobs: {args.jobs} is too few; at least 1 is wanted")
    found = find([str(place) for place in places], args.wire_name, but=args.table)
    jobs = _jobs(found, command, work, str(config), options, together, read_table(args.table))
    if config and not args.dask and "://" not in str(config):
        _check_configs(jobs)
    unread: list[str] = []
    rows: list[dict[str, Any]] = []
    with progress_bar(args) as bar, cluster(args.dask):
        task = bar.add_task(f"{command}, {'wires' if together else 'logs'}", total=float(len(jobs)))
        with contextlib.closing(_outcomes(jobs, args.jobs)) as outcomes, _appending(args.table) as add:
            for outcome in outcomes:
                add(outcome.rows)
                rows += outcome.rows
                unread += [outcome.unread] if outcome.unread else []
                bar.advance(task)
    _report(args, rows, len(found), unread)
    write_json(args, [{**row, "date": row["date"].isoformat()} for row in rows])
    if models:
        _write_models(args, models, rows)
    console.print(
        f"{len(rows)} rows appended to {args.table}; {len(found) - len(rows) - len(unread)} were there already"
    )
    say_next(args, f"which wires drift: sma-actuator fleet {typed(args.table)} --report fleet.html")
    return 1 if unread else 0


def _jobs(
    found: Sequence[Place],
    command: str,
    work: Work,
    config: str,
    options: Mapping[str, Any],
    together: bool,
    table: Sequence[Mapping[str, Any]],
) -> list[_Job]:
    known: dict[str, set[tuple[Any, ...]]] = {}
    for row in table:
        known.setdefault(row["log"], set()).add(key_of(row))
    groups: dict[str, list[Place]] = {}
    for place in found:
        groups.setdefault(place.wire if together else place.url, []).append(place)
    return [
        _Job(
            number,
            command,
            work,
            tuple(group),
            config.replace("{wire}", group[0].wire),
            options,
            together,
            frozenset(key for place in group for key in known.get(place.url, ())),
        )
        for number, group in enumerate(groups.values())
    ]


def _check_configs(jobs: Sequence[_Job]) -> None:
    for config in dict.fromkeys(job.config for job in jobs):
        if not Path(config).exists():
            raise UserError(f"{config}: there is no such file; {{wire}} in it stands for the name of the wire")


def _outcomes(jobs: Sequence[_Job], processes: int) -> Generator[_Outcome, None, None]:
    """What the workers find, each as soon as it is there; where processes die what they had not finished is done
    again."""
    left = {job.number: job for job in jobs}
    tries = 0
    while left:
        try:
            with spread(processes, in_order=False) as do:
                for outcome in do([(_do, (job,)) for job in left.values()]):
                    tries = 0
                    yield outcome
                    left.pop(outcome.number)
        except BrokenProcessPool as error:
            tries += 1
            if tries == TRIES:
                place = next(iter(left.values())).places[0].url
                raise UserError(
                    f"the processes die at {place} or a log after it, {TRIES} times ({error}); is there too little "
                    f"memory?"
                ) from error


@contextlib.contextmanager
def _appending(path: Path) -> Iterator[Callable[[list[dict[str, Any]]], None]]:
    """What adds rows to the table: every FLUSH_s, and at the end, however it comes."""
    waiting: list[dict[str, Any]] = []
    last_s = time.monotonic()

    def add(rows: list[dict[str, Any]]) -> None:
        nonlocal last_s
        waiting.extend(rows)
        if time.monotonic() - last_s > FLUSH_s:
            append(path, waiting)
            waiting.clear()
            last_s = time.monotonic()

    try:
        yield add
    finally:
        append(path, waiting)


def _do(job: _Job) -> _Outcome:
    """On the worker: read, work, and say what was found."""
    begun_s = time.perf_counter()
    # the same bits on any machine
    with (
        tempfile.TemporaryDirectory(prefix="sma_fleet_") as folder,
        one_thread(),
    ):
        names = {}
        try:
            logs = []
            for number, place in enumerate(job.places):
                inside = Path(folder) / str(number)
                inside.mkdir()
                logs.append(fetch(place.url, inside))
                names[str(logs[-1].path)] = place.url
            config = text_of(job.config) if job.config else ""
            rows = _rows_without_findings(job, logs, config)
            if all(key_of(row) in job.known for row in rows):
                return _Outcome(job.number, [])
            model = Path(folder) / "model.yaml"
            model.write_text(config, encoding="utf-8")
            if config:
                fetch_beside(job.config, files_beside(model), Path(folder))
            names[str(model)] = job.config
            findings = _findings(job, logs, model)
        except Exception as error:  # noqa: BLE001 - whatever a file system raises, or a fault in the work: other logs go on
            return _Outcome(job.number, [], f"{job.places[0].url}: {type(error).__name__}: {error}")
    of_the_worker = {
        "seconds": (time.perf_counter() - begun_s) / len(rows),
        "peak_memory_MB": _peak_memory_MB(),
        "worker": f"{socket.gethostname()}:{os.getpid()}",
    }
    for row, finding in zip(rows, findings, strict=True):
        row.update(
            verdict=finding.verdict,
            sentence=_named(finding.sentence, names),
            effects=list(finding.effects),
            error_percent=float(finding.error_percent),
            error_after_percent=float(finding.error_after_percent),
            details=_named(json.dumps(finding.details, ensure_ascii=False, sort_keys=True), names),
            model=_named(finding.model, names),
            **of_the_worker,
        )
    return _Outcome(job.number, [row for row in rows if key_of(row) not in job.known])


def _findings(job: _Job, logs: Sequence[Fetched], model: Path) -> Sequence[Finding]:
    """What the work finds; that it refuses a log is a finding too."""
    try:
        return job.work([log.path for log in logs], model, job.options)
    except UserError as error:
        return [Finding("refused", str(error))] * len(logs)


def _rows_without_findings(job: _Job, logs: Sequence[Fetched], config: str) -> list[dict[str, Any]]:
    options = dict(job.options)
    if job.together:
        options["together"] = hashlib.sha256("".join(sorted(log.sha256 for log in logs)).encode()).hexdigest()
    return [
        {
            "command": job.command,
            "wire": place.wire,
            "log": place.url,
            "date": log.date,
            "log_sha256": log.sha256,
            "model_sha256": hashlib.sha256(config.encode()).hexdigest(),
            "options": json.dumps(options, ensure_ascii=False, sort_keys=True, default=repr),
            "version": importlib.metadata.version("sma_actuator"),
        }
        for place, log in zip(job.places, logs, strict=True)
    ]


def _named(text: str, names: Mapping[str, str]) -> str:
    """A text in which logs have the names that they have for everyone, and not those of the worker's copies."""
    for path, url in names.items():
        text = text.replace(path, url)
    return text


def _peak_memory_MB() -> float:
    """The most that this process ever held."""
    with open("/proc/self/status") as status:  # noqa: PTH123 - no file of ours
        return next((int(line.split()[1]) / 1024.0 for line in status if line.startswith("VmHWM")), float("nan"))


def _write_models(args: argparse.Namespace, pattern: str, rows: Sequence[Mapping[str, Any]]) -> None:
    for wire, text in {row["wire"]: row["model"] for row in rows if row["model"]}.items():
        path = Path(pattern.replace("{wire}", wire))
        if path.exists() and not args.force:
            notes(args).print(f"{path}: exists already, and stays without --force; the model is in the table")
            continue
        write_atomically(path, partial(_put, text))
        notes(args).print(f"wrote {path}")


def _put(text: str, stream: Any) -> None:
    stream.write(text.encode())


def _report(args: argparse.Namespace, rows: Sequence[Mapping[str, Any]], asked: int, unread: Sequence[str]) -> None:
    console = results(args)
    if rows:
        table = Table(title=f"{len(rows)} of {asked} logs" + (f", the first {_SHOWN}" if len(rows) > _SHOWN else ""))
        for header in ("wire", "log", "verdict", "effects", "error %", "after %"):
            table.add_column(header, justify="right" if header.endswith("%") else "left")
        for row in sorted(rows, key=lambda r: (r["wire"], r["log"]))[:_SHOWN]:
            errors = (f"{row[name]:.2f}" for name in ("error_percent", "error_after_percent"))
            table.add_row(
                row["wire"], row["log"].rsplit("/", 1)[-1], row["verdict"], ", ".join(row["effects"]), *errors
            )
        console.print(table)
        verdicts = [row["verdict"] for row in rows]
        console.print(", ".join(f"{verdicts.count(v)} {v}" for v in dict.fromkeys(sorted(verdicts))))
    for sentence in unread:
        console.print(f"not done: {sentence}")
