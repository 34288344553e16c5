"""``sma-actuator replay``."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from sma_actuator.config import Config
from sma_actuator.logs.bags import is_bag, log_from_bag, parse_topics
from sma_actuator.logs.bench_log import check_bench_log, read_bench_log, write_bench_log
from sma_actuator.logs.files import write_atomically

from .replaying import Replay, replay, winners


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator replay``."""
    parser.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG",
        help="bench logs, or rosbag2 recordings (.mcap, .db3 or their folder)",
    )
    parser.add_argument(
        "--config",
        type=Path,
        action="append",
        required=True,
        metavar="MODEL.yaml",
        help="parameter file with a model; may be repeated to compare",
    )
    parser.add_argument(
        "--baselines",
        type=Path,
        nargs="+",
        default=[],
        metavar="LOG",
        help="calibration logs to fit the literature's models on, for comparison",
    )
    parser.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="COLUMN=/TOPIC:FIELD",
        help="recordings: where a column of the bench log is found; may be repeated",
    )
    parser.add_argument(
        "--save-log", type=Path, metavar="FILE.csv", help="recordings: also write the one recording as a bench log"
    )
    parser.add_argument("--allow-gaps", action="store_true", help="accept readings that are missing and pauses in time")
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="page with traces and loops")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the errors here")


def run(args: argparse.Namespace) -> int:
    """Replay and judge; 0 when every log was replayed."""
    if args.report:
        from .page import write_page
    console = Console(stderr=True)
    models = {}
    for path in args.config:
        config = Config.load(path)
        name = config.model_type if config.model_type not in models else f"{config.model_type} ({path.stem})"
        models[name] = config
    with Progress(TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=console) as bar:
        reading = bar.add_task("reading", total=len(args.logs) + len(args.baselines))

        def read(path: Path):
            if is_bag(path):
                log = log_from_bag(path, parse_topics(args.topic))
                check_bench_log(log, allow_gaps=True)
                if args.save_log:
                    write_bench_log(args.save_log, log)
            else:
                log = read_bench_log(path, args.allow_gaps)
            bar.advance(reading)
            return log

        logs, calibration = [read(p) for p in args.logs], [read(p) for p in args.baselines]
        working = bar.add_task("replaying", total=1.0)
        replays = replay(logs, models, calibration, lambda fraction: bar.update(working, completed=fraction))
    console.print(error_table(replays))
    for log, in_working, in_full in winners(replays):
        console.print(f"{log}: best in the working range {in_working}; in the full range {in_full}")
    if args.report:
        write_page(args.report, replays, next(iter(models.values())))
        console.print(f"wrote {args.report}")
    if args.json:
        rows = [{"model": name, **dataclasses.asdict(e)} for r in replays for name, e in r.errors.items()]
        text = json.dumps(rows, indent=1) + "\n"
        write_atomically(args.json, lambda stream: stream.write(text.encode()))
    return 0


def error_table(replays: list[Replay]) -> Table:
    """Every model on every log, the best in bold."""
    table = Table(title="Mean absolute error, % of full stroke")
    for header in ("log", "model", "working range", "samples in it", "full range"):
        table.add_column(header, justify="left" if header in ("log", "model") else "right")
    best = {name: chosen for name, *chosen in winners(replays)}
    for r in replays:
        in_working = best[r.trace.name][0]
        for name, e in r.errors.items():
            table.add_row(
                r.trace.name if name == next(iter(r.errors)) else "",
                name,
                f"{e.working_percent:.2f}",
                f"{e.working_share:.0%}",
                f"{e.full_percent:.2f}",
                style="bold" if name == in_working else None,
            )
        table.add_section()
    return table
