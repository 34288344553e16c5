"""``sma-actuator forward``."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from sma_actuator.base.errors import UserError
from sma_actuator.base.options import number_within
from sma_actuator.console import (
    add_output_arguments,
    notes,
    progress_bar,
    refuse_to_overwrite,
    results,
    say_next,
    typed,
    write_json,
)
from sma_actuator.fleet import Finding, add_fleet_arguments, cluster, run_fleet
from sma_actuator.logs.files import write_atomically
from sma_actuator.logs.reading import add_map_arguments, columns_of, place

from .race import ForwardTracing, trace_runs
from .report import percent, sentences, summary
from .runs import COLUMNS, Run, read_run
from .wire import read_wire, wire_yaml


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator forward``."""
    parser.add_argument(
        "runs", nargs="+", type=place, metavar="RUN.csv", help="runs to fit: time_s, duty_cycle, slider_position_m"
    )
    parser.add_argument(
        "--wire", type=place, required=True, metavar="WIRE.yaml", help="wire, spring and drive, as the maker says"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder for forward.yaml, report.json and report.html; with --table, FORWARD.yaml with {wire} in it, "
        "where wanted",
    )
    parser.add_argument(
        "--judge",
        nargs="+",
        type=Path,
        default=[],
        metavar="RUN.csv",
        help="runs to judge on, which have no part in choice and fit (default: each in turn, chosen and fitted on the "
        "others)",
    )
    add_map_arguments(parser)
    parser.add_argument(
        "--jobs",
        type=number_within(1, kind=int),
        default=min(2, os.cpu_count() or 1),
        help="processes (default %(default)s)",
    )
    parser.add_argument(
        "--dask", metavar="ADDRESS", help="spread the fits over this Dask cluster, as tcp://127.0.0.1:8786"
    )
    add_fleet_arguments(parser, "wire")
    add_output_arguments(parser, "the report")


def run(args: argparse.Namespace) -> int:
    """Fit, trace, write and report; 0 when all files were written."""
    from .page import write_page

    if args.table:
        if args.judge:
            raise UserError("--judge: not with --table; each run of a wire is judged in its turn")
        asked = {"columns": columns_of(args, COLUMNS)}
        return run_fleet(args, "forward", fit_runs, args.runs, args.wire, asked, True, str(args.out or ""))
    if args.out is None:
        raise UserError("--out: a folder for the report is wanted")
    if urls := [run for run in args.runs if isinstance(run, str)]:
        raise UserError(f"{urls[0]}: a URL is read with --table, where many wires are worked on at once")
    refuse_to_overwrite(args, *(args.out / name for name in ("forward.yaml", "report.json", "report.html")))
    columns, console = columns_of(args, COLUMNS), notes(args)
    wire = read_wire(args.wire)
    runs = [read_run(path, columns, console.print) for path in args.runs]
    judge = [read_run(path, columns, console.print) for path in args.judge]
    _check(runs, judge, args.runs, args.judge, args.jobs)
    with progress_bar(args) as bar:
        task = bar.add_task("fitting", total=1.0)

        def progress(what: str, share: float) -> None:
            bar.update(task, description=what, completed=share)

        with cluster(args.dask):
            found = trace_runs(wire, runs, judge, progress, args.jobs)
        bar.update(task, description="done", completed=1.0)
    write_atomically(args.out / "forward.yaml", lambda stream: stream.write(_yaml(found).encode()))
    text = json.dumps(summary(found), indent=1) + "\n"
    write_atomically(args.out / "report.json", lambda stream: stream.write(text.encode()))
    write_json(args, summary(found))
    write_page(args.out / "report.html", found)
    told = results(args)
    told.print(_table(found))
    for sentence in sentences(found):
        told.print(sentence)
    console.print(f"wrote {args.out / 'forward.yaml'}, report.json and report.html")
    say_next(
        args,
        f"look at {args.out / 'report.html'}; to judge new runs by this wire: sma-actuator forward "
        f"{typed(*args.runs)} --wire {typed(args.out / 'forward.yaml')} --judge NEW.csv --out DIR",
    )
    return 0


def fit_runs(paths: Sequence[Path], wire: Path, options: Mapping[str, Any]) -> list[Finding]:
    """The work on the runs of one wire of a fleet."""
    runs = [read_run(path, options["columns"]) for path in paths]
    _check(runs, [], paths, [], jobs=1)
    found = trace_runs(read_wire(wire), runs, [], jobs=1)
    return [
        Finding(
            verdict=found.verdict,
            sentence=sentences(found)[0],
            effects=tuple(c.name for c in found.named),
            error_percent=percent(run, before_m),
            error_after_percent=percent(run, after_m),
            details=summary(found),
            model=_yaml(found),
        )
        for run, before_m, after_m in zip(found.judged, found.before_m, found.after_m, strict=True)
    ]


def _yaml(found: ForwardTracing) -> str:
    comment = "Written by `sma-actuator forward`; pictures are in report.html beside it.\n"
    return wire_yaml(found.fitted.wire, comment + "\n".join(sentences(found)[:2]))


def _check(
    runs: Sequence[Run], judge: Sequence[Run], run_paths: Sequence[Path], judge_paths: Sequence[Path], jobs: int
) -> None:
    if jobs < 1:
        raise UserError(f"--jobs {jobs}: at least 1 is wanted")
    names = [r.name for r in (*runs, *judge)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UserError(
            f"{twice[0]}.csv: given more than once; a run that was fitted cannot judge, and each counts once"
        )
    if judge and len(runs) < 2:
        raise UserError(
            f"{run_paths[0]}: effects are chosen on one run after a fit to others; give at least 2 runs beside those "
            f"of --judge"
        )
    if not judge and len(runs) < 3:
        raise UserError(
            f"{run_paths[0]}: {len(runs)} run{'s' * (len(runs) > 1)} cannot choose effects and judge them; give at "
            "least 3, or 2 and another for --judge"
        )
    for r, path in zip((*runs, *judge), (*run_paths, *judge_paths), strict=True):
        if not (r.duty > 1e-3).any():
            raise UserError(
                f"{path}: column duty_cycle: never above 0.001; nothing heats the wire, there is nothing to fit"
            )


def _table(found: ForwardTracing) -> Table:
    table = Table(title="Error on unseen runs, RMS in mm and % of the stroke")
    for header in ("judged on", "plain", "chosen effects", "% before", "% after", "chosen without this run"):
        table.add_column(header, justify="left" if header.startswith(("judged", "chosen w")) else "right")
    for r, j, before, after in zip(found.judged, found.by_run, found.before_m, found.after_m, strict=True):
        table.add_row(
            r.name,
            f"{1e3 * before:.3f}",
            f"{1e3 * after:.3f}",
            f"{100 * before / r.stroke_m:.2f}",
            f"{100 * after / r.stroke_m:.2f}",
            " + ".join(j.choice.winner.names) or "none",
        )
    if len(found.judged) > 1:
        plain_m, chosen_m = np.array(found.before_m), np.array(found.after_m)
        strokes_m = np.array([r.stroke_m for r in found.judged])
        table.add_section()
        table.add_row(
            "mean",
            f"{1e3 * plain_m.mean():.3f}",
            f"{1e3 * chosen_m.mean():.3f}",
            f"{100 * (plain_m / strokes_m).mean():.2f}",
            f"{100 * (chosen_m / strokes_m).mean():.2f}",
            "",
        )
    return table
