"""``sma-actuator replay``."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.base.signals import Health
from sma_actuator.config import Config
from sma_actuator.console import (
    add_output_arguments,
    notes,
    progress_bar,
    refuse_to_overwrite,
    results,
    say_next,
    typed,
    write_csv,
    write_json,
)
from sma_actuator.fleet import Finding, add_fleet_arguments, run_fleet
from sma_actuator.logs.bench_log import write_bench_log
from sma_actuator.logs.errors import BenchLogError
from sma_actuator.logs.reading import add_log_arguments, place, read_logs, reading_of

from .replaying import Replay, health, replay, verdict, winners


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator replay``."""
    parser.add_argument(
        "logs",
        nargs="+",
        type=place,
        metavar="LOG",
        help="logs, folders or patterns of them; the node's recordings, rosbag2 and other makers' files among them",
    )
    parser.add_argument(
        "--config",
        type=place,
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
        "--save-log", type=Path, metavar="FILE.csv", help="also write the one log that is read as a bench log"
    )
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="page with curves and loops")
    parser.add_argument(
        "--health", action="store_true", help="also what the node says of the first model's health on each log"
    )
    add_log_arguments(parser)
    add_fleet_arguments(parser, "log")
    add_output_arguments(parser, "the errors", "the errors")


def run(args: argparse.Namespace) -> int:
    """Replay and judge; 0 when every log was replayed."""
    if args.table:
        return run_fleet(args, "replay", judge_logs, args.logs, args.config[0], {"reading": reading_of(args)})
    if args.report:
        from .page import write_page
    refuse_to_overwrite(args, args.report, args.save_log)
    reading, console = reading_of(args), notes(args)
    models = {}
    for path in args.config:
        config = Config.for_tools(read_parameter_file(path), str(path))
        name = config.model_type if config.model_type not in models else f"{config.model_type} ({path.stem})"
        models[name] = config
    with progress_bar(args) as bar:
        task = bar.add_task("reading", total=1.0)
        logs = read_logs(args.logs, reading, console.print, lambda fraction: bar.update(task, completed=fraction))
        calibration = read_logs(args.baselines, reading, console.print) if args.baselines else []
        if args.save_log:
            if len(logs) != 1:
                raise BenchLogError(f"--save-log: {len(logs)} logs were read, and one can be saved")
            write_bench_log(args.save_log, logs[0])
        working = bar.add_task("replaying", total=1.0)
        replays = replay(logs, models, calibration, lambda fraction: bar.update(working, completed=fraction))
    rows = error_rows(replays)
    results(args).print(error_table(replays))
    for sentence in _beside_live(replays):
        console.print(sentence)
    if args.health:
        for r in replays:
            results(args).print(_health_words(r, next(iter(models.values()))))
    if args.report:
        write_page(args.report, replays, next(iter(models.values())))
        console.print(f"wrote {args.report}")
    write_json(args, rows)
    write_csv(args, rows)
    say_next(args, _next(args, replays, next(iter(models.values()))))
    return 0


def _next(args: argparse.Namespace, replays: Sequence[Replay], config: Config) -> str:
    """What the verdict on the first model asks for."""
    word, said = verdict(replays, config)
    logs, file = typed(*args.logs), typed(args.config[0])
    if word == "changed":
        return f"{said} sma-actuator trace {logs} --config {file} --out out/traced"
    if word == "not judged":
        return said
    complete = "instruments" in read_parameter_file(args.config[0])
    node = f"sma_actuator_node --ros-args --params-file {file}" if complete else f"sma-actuator init --start {file}"
    return f"{said} Drive with it: {node}"


def judge_logs(paths: Sequence[Path], config: Path, options: Mapping[str, Any]) -> list[Finding]:
    """The work on one log of a fleet."""
    model = Config.for_tools(read_parameter_file(config), str(config))
    replays = replay(read_logs(paths, options["reading"]), {model.model_type: model})
    word, said = verdict(replays, model)
    return [
        Finding(
            word,
            said,
            error_percent=_mean([r.errors[model.model_type].full_percent for r in replays]),
            details={"errors": error_rows(replays)},
        )
    ]


def error_rows(replays: list[Replay]) -> list[dict[str, Any]]:
    """One row for every model on every log, and what the first model says beside the node's own estimate."""
    rows = []
    for r in replays:
        for i, (name, error) in enumerate(r.errors.items()):
            live = (r.from_live_m, r.live_readings) if i == 0 else (float("nan"), 0)
            rows.append({"model": name, **dataclasses.asdict(error), "from_live_m": live[0], "live_readings": live[1]})
    return rows


def _beside_live(replays: list[Replay]) -> list[str]:
    return [
        f"{r.experiment.name}: {next(iter(r.errors))} differs by at most {r.from_live_m * 1e3:.3g} mm from what the "
        f"node had estimated, over {r.live_readings} readings with current"
        for r in replays
        if r.live_readings
    ]


def _health_words(replayed: Replay, config: Config) -> str:
    verdict, _ = health(replayed.experiment, config)
    since = f" (since {verdict.since_s:.0f} s)" if verdict.state is Health.DUE else ""
    return f"{replayed.experiment.name}: model health{since}: {verdict.words}"


def error_table(replays: list[Replay]) -> Table:
    """Every model on every log, those as good as the best in bold, and the mean over the logs."""
    table = Table(title="Mean absolute error, % of full stroke")
    for header in ("log", "model", "working range", "samples in it", "full range"):
        table.add_column(header, justify="left" if header in ("log", "model") else "right")
    best = {name: working for name, working, _ in winners(replays)}
    for r in replays:
        for i, (name, e) in enumerate(r.errors.items()):
            bold = len(r.errors) > 1 and name in best[r.experiment.name]
            cells = (name, f"{e.working_percent:.2f}", f"{e.working_share:.0%}", f"{e.full_percent:.2f}")
            table.add_row("" if i else r.experiment.name, *cells, style="bold" if bold else None)
        table.add_section()
    if len(replays) > 1:
        for i, name in enumerate(replays[0].errors):
            errors = [r.errors[name] for r in replays]
            means = [
                _mean([getattr(e, what) for e in errors])
                for what in ("working_percent", "working_share", "full_percent")
            ]
            table.add_row("" if i else "mean", name, f"{means[0]:.2f}", f"{means[1]:.0%}", f"{means[2]:.2f}")
    return table


def _mean(values: list[float]) -> float:
    known = np.array(values)[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
