"""``sma-actuator trace``."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from sma_actuator.base.options import number_within
from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.base.parameters import ConfigError, to_mapping
from sma_actuator.calibration.learning import calibration_of
from sma_actuator.config import Config, parameter_text, write_parameter_file
from sma_actuator.console import (
    add_output_arguments,
    headed,
    notes,
    progress_bar,
    refuse_to_overwrite,
    results,
    say_next,
    typed,
    write_json,
)
from sma_actuator.estimation.effects import EFFECTS
from sma_actuator.fleet import Finding, add_fleet_arguments, cluster, run_fleet
from sma_actuator.identify.fitters import FITTERS
from sma_actuator.logs.files import write_atomically
from sma_actuator.logs.kinds import make_experiments
from sma_actuator.logs.reading import add_log_arguments, find_logs, place, read_logs, reading_of

from .evidence import Evidence
from .experiments import NOTHING_TELLS
from .isolability import as_numbers, isolability, size_in_words, tells_in_words
from .limits import LIMITS
from .report import explained, extended, probable, summary
from .rows import NOTHING
from .tracing import trace

_HEADER = "Written by `sma-actuator trace`"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator trace``."""
    parser.add_argument(
        "logs",
        nargs="+",
        type=place,
        metavar="LOG",
        help="logs with a measured displacement, folders or patterns of them",
    )
    parser.add_argument(
        "--config", type=place, required=True, metavar="MODEL.yaml", help="parameter file with the model"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder for report.json, report.html and model.yaml; with --table, MODEL.yaml with {wire} in it, where "
        "wanted",
    )
    parser.add_argument(
        "--calibration",
        nargs="+",
        type=Path,
        metavar="LOG",
        default=[],
        help="logs the model was fitted on, where MODEL.yaml was not written by identify",
    )
    parser.add_argument(
        "--only", nargs="+", metavar="EFFECT", default=[], help="these effects have happened together, or none has"
    )
    parser.add_argument("--without", nargs="+", metavar="EFFECT", default=[], help="leave these candidates out")
    parser.add_argument(
        "--explain",
        nargs="+",
        metavar="EFFECT",
        default=[],
        help="say of these what speaks for and against them, whether they were named or not",
    )
    parser.add_argument(
        "--isolability",
        action="store_true",
        help="trace nothing: say which effects logs like these would show, and which they could not tell apart",
    )
    parser.add_argument(
        "--beyond-floor",
        action="store_true",
        help="look also for what the model lacked at its calibration already (default: for what has come since)",
    )
    parser.add_argument("--jobs", type=number_within(1, kind=int), default=2, help="processes (default %(default)s)")
    parser.add_argument(
        "--dask", metavar="ADDRESS", help="spread the fits over this Dask cluster, as tcp://127.0.0.1:8786"
    )
    add_log_arguments(parser)
    add_fleet_arguments(parser, "log")
    add_output_arguments(parser, "the report")


def run(args: argparse.Namespace) -> int:
    """Experiment, write and report; 0 when the report was written, whatever the verdict."""
    from .page import write_page

    _check(args)
    if args.isolability:
        return _isolability(args)
    if args.table:
        return _fleet(args)
    if args.out is None:
        raise ConfigError("--out: a folder for the report is wanted")
    written = ("report.json", "report.html", "model.yaml")
    refuse_to_overwrite(args, *(args.out / name for name in written))
    reading, console = reading_of(args), notes(args)
    mapping = read_parameter_file(args.config)
    for stale in written:
        if (args.out / stale).resolve() != args.config.resolve():
            (args.out / stale).unlink(missing_ok=True)  # of an earlier run: it would be taken for this one's
    config = Config.for_tools(mapping, str(args.config))
    with progress_bar(args) as bar:
        task = bar.add_task("reading", total=1.0)
        if args.calibration:
            remembers = FITTERS[config.model_type].remembers
            experiments = make_experiments(read_logs(args.calibration, reading, console.print), config, remembers)
            mapping["calibration"] = to_mapping(calibration_of(experiments, config))
            config = Config.for_tools(mapping, str(args.config))
        logs = read_logs(args.logs, reading, console.print)
        evidence = Evidence(logs, config, args.beyond_floor)
        bar.update(task, completed=1.0)
        tasks = {}

        def progress(what: str, fraction: float) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=1.0)
            bar.update(tasks[what], completed=fraction)

        with cluster(args.dask):
            tracing = trace(evidence, args.only, args.without, args.jobs, progress, args.explain)
        report = summary(tracing)
        model = extended(mapping, tracing, report, _when(find_logs(args.logs)))
    path = args.out / "model.yaml"
    args.out.mkdir(parents=True, exist_ok=True)
    if model is not None:
        Config.for_tools(model, str(path))
        report["model_file"] = str(path)
        write_parameter_file(path, model, f"{_HEADER}; the evidence is in report.html beside it.")
    write_page(args.out / "report.html", tracing, report, args.explain)
    text = json.dumps(report, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_atomically(args.out / "report.json", lambda stream: stream.write(text.encode()))
    write_json(args, report)
    _print(results(args), report)
    _explain(results(args), report, args.explain)
    console.print(f"wrote {args.out / 'report.json'}, report.html{' and model.yaml' if model is not None else ''}")
    say_next(args, _next(args, report, path if model is not None else None))
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raise ConfigError where an option is none, or does not go with another."""
    for option in ("only", "without", "explain"):
        for name in getattr(args, option):
            if name not in EFFECTS:
                raise ConfigError(f"--{option}: '{name}' is no effect; known are {', '.join(EFFECTS)}")
    if args.jobs < 1:
        raise ConfigError(f"--jobs: {args.jobs} is too few; at least 1 is wanted")
    for option in ("only", "explain", "beyond_floor", "calibration", "table"):
        if args.isolability and getattr(args, option):
            raise ConfigError(f"--{option.replace('_', '-')}: not with --isolability, which traces nothing")


def _fleet(args: argparse.Namespace) -> int:
    """Trace each log by itself, for a table."""
    if args.calibration:
        raise ConfigError(
            "--calibration: not with --table; models that identify wrote have their calibration with them"
        )
    if args.explain:
        raise ConfigError("--explain: not with --table; trace the one log by itself")
    asked = {name: getattr(args, name) for name in ("only", "without", "beyond_floor")}
    asked["reading"] = reading_of(args)
    return run_fleet(args, "trace", trace_logs, args.logs, args.config, asked, models=str(args.out or ""))


def _isolability(args: argparse.Namespace) -> int:
    """Say what the logs would show; 0 when it is written."""
    from .page import write_isolability

    if args.out is None:
        raise ConfigError("--out: a folder for the report is wanted")
    written = [args.out / "isolability.json", args.out / "isolability.html"]
    refuse_to_overwrite(args, *written)
    console = notes(args)
    config = Config.for_tools(read_parameter_file(args.config), str(args.config))
    found = isolability(Evidence(read_logs(args.logs, reading_of(args), console.print), config), args.without)
    report = as_numbers(found)
    args.out.mkdir(parents=True, exist_ok=True)
    write_isolability(written[1], report)
    text = json.dumps(report, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_atomically(written[0], lambda stream: stream.write(text.encode()))
    write_json(args, report)
    shown = results(args)
    table = Table(title="what these logs would show, and from which size (for 90 %)")
    for header in ("effect", "shows from", "told from all others from", "last from"):
        table.add_column(header)
    for e in report["effects"]:
        table.add_row(
            e["name"], *(size_in_words(e, e[key]) for key in ("seen_from", "told_from_all")), e["told_last_from"]
        )
    shown.print(table)
    for e in report["effects"]:
        if e["not_told_from"]:
            shown.print(
                f"{e['name']}: these logs cannot tell it from {', '.join(e['not_told_from'])}, whatever its size"
            )
    for u in report["untestable"]:
        shown.print(f"untestable: {u['name']}: {u['reason']}")
    best = report["experiments"][0]
    shown.print(
        f"the experiment that would tell most: {best['what']} ({best['duration_s']:.0f} s), {best['adds_bits']:.2f} "
        f"bits more of {report['most_bits']:.1f} (these logs: {report['known_bits']:.2f}); {tells_in_words(best)}"
    )
    console.print(f"wrote {written[0]}, {written[1].name}", markup=False)
    return 0


def trace_logs(paths: Sequence[Path], config: Path, options: Mapping[str, Any]) -> list[Finding]:
    """The work on one log of a fleet."""
    mapping = read_parameter_file(config)
    logs = read_logs(paths, options["reading"])
    evidence = Evidence(logs, Config.for_tools(mapping, str(config)), options["beyond_floor"])
    tracing = trace(evidence, options["only"], options["without"], jobs=1)
    report = summary(tracing)
    model = extended(mapping, tracing, report, "")
    return [
        Finding(
            verdict=report["verdict"],
            sentence=report["sentence"],
            effects=tuple(e["name"] for e in report["effects"]),
            error_percent=report["error_before_pct_stroke"],
            error_after_percent=report["error_after_pct_stroke"],
            details=report,
            model=parameter_text(model, f"{_HEADER} in a fleet.") if model is not None else "",
        )
    ]


def _when(paths: list[Path]) -> str:
    """Day of the latest log, for the model's history: the same whenever it is traced."""
    return time.strftime("%Y-%m-%d: ", time.gmtime(max(path.stat().st_mtime for path in paths)))


def _next(args: argparse.Namespace, report: dict[str, Any], model: Path | None) -> str:
    """What a verdict asks for; ``model``: the extended one, where one was written."""
    verdict = report["verdict"]
    if model is not None:
        return f"sma_actuator_node --ros-args --params-file {typed(model)}"
    if verdict == "none" and report["probable"][NOTHING] < LIMITS.enough:
        return "record a longer session, and trace that; what speaks for an effect: --explain NAME"
    if verdict == "none":
        return "nothing: the model holds, drive on with it"
    if verdict == "traced":
        return "do what it says at each name; the model stays as it is"
    return f"look at {args.out / 'report.html'}; --explain NAME says why a name was not given"


def _print(console: Console, report: dict) -> None:
    console.print(headed(report["verdict"], report["sentence"]))
    before, after = report["error_before_interval"], report["error_after_interval"]
    console.print(
        f"error {report['error_before_pct_stroke']:.2f} % of full stroke ({before[0]:.2f}–{before[1]:.2f}) before, "
        f"{report['error_after_pct_stroke']:.2f} % ({after[0]:.2f}–{after[1]:.2f}) after; "
        f"beyond what the calibration lets expect {report['unexpected_before_pct_stroke']:.2f} % before, "
        f"{report['unexpected_after_pct_stroke']:.2f} % after; {report['floor_pct_stroke']:.2f} % is usual"
    )
    console.print(f"probable: {probable(report)}")
    if report["effects"]:
        table = Table()
        for header in ("effect", "probability", "what is the matter", "part", "share", "parameters"):
            table.add_column(header)
        for e in report["effects"]:
            values = ", ".join(
                f"{n} {p['value']:.3g} ({p['interval'][0]:.3g}…{p['interval'][1]:.3g}) {p['unit']}"
                for n, p in e["parameters"].items()
            )
            table.add_row(e["name"], f"{e['probability']:.0%}", e["what"], e["part"], f"{e['share']:.0%}", values)
        console.print(table)
    for e in report["effects"]:
        console.print(f"{e['name']}: {e['what']}. {e['remedy']}")
    for a in report["alternatives"]:
        x = a["experiment"]
        told = (
            f"to tell them apart {x['what']} ({x['duration_s']:.0f} s): what the two expect of the reference "
            f"sensor then moves {x['predicted_difference_m'] * 1e3:.2f} mm apart"
            if x
            else NOTHING_TELLS
        )
        console.print(f"instead of {a['instead_of']} it could be {a['name']} ({a['probability']:.0%}); {told}")
    for note in report["notes"]:
        console.print(f"note: {note}")
    for u in report["untestable"]:
        console.print(f"untestable: {u['name']}: {u['reason']}")


def _explain(console: Console, report: dict, names: Sequence[str]) -> None:
    """What speaks for and against some names, beside what was chosen."""
    for row in explained(report, names):
        console.print(headed(f"{' and '.join(row['effects'])}, {row['answer']}", row["reason"]))
    shown = [row for row in explained(report, names) if row["nats"] is not None]
    if not shown:
        return
    table = Table(title="nats beside the most probable hypothesis")
    table.add_column("")
    for row in shown:
        table.add_column(" and ".join(row["effects"]), justify="right")
    for name in shown[0]["nats_by_witness"]:
        table.add_row(name, *(_nats(row["nats_by_witness"][name]) for row in shown))
    for number in range(len(shown[0]["nats_by_stretch"])):
        table.add_row(f"stretch {number + 1} of the logs", *(_nats(row["nats_by_stretch"][number]) for row in shown))
    console.print(table)


def _nats(nats: float) -> str:
    return f"{round(nats, 1) + 0.0:.1f}"  # no -0.0
