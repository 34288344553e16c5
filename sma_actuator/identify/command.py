"""``sma-actuator identify``."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.table import Table

from sma_actuator.config import NODE_NAME, read_parameter_file
from sma_actuator.console import (
    add_output_arguments,
    notes,
    progress_bar,
    refuse_to_overwrite,
    results,
    write_csv,
    write_json,
)
from sma_actuator.fleet import Finding, add_fleet_arguments, run_fleet
from sma_actuator.logs.files import write_atomically
from sma_actuator.logs.reading import add_log_arguments, place, read_logs, reading_of

from .fitters import METHODS
from .identification import Identification, identify


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator identify``."""
    parser.add_argument(
        "logs",
        nargs="+",
        type=place,
        metavar="LOG",
        help="logs, folders or patterns of them; those of calibration and training are left out",
    )
    parser.add_argument(
        "--config",
        type=place,
        required=True,
        metavar="BENCH.yaml",
        help="parameters of the bench (a model in it is replaced)",
    )
    parser.add_argument("--model", required=True, metavar="TYPE", help="model.type to fit: flexinol, furukawa …")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="MODEL.yaml",
        help="parameter file to write: the bench's with the model in it",
    )
    parser.add_argument(
        "--method",
        choices=METHODS,
        default="joint",
        help="flexinol: all together, or the thesis's appendix C (default %(default)s)",
    )
    parser.add_argument(
        "--variant",
        choices=("average", "direct_switching", "transition"),
        default="average",
        help="furukawa: how the curves are used (default %(default)s)",
    )
    parser.add_argument(
        "--order", type=int, help="order of the stress polynomials (default: chosen on held-out cycles)"
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE.html", help="page with the pictures (default: beside MODEL.yaml)"
    )
    add_log_arguments(parser)
    add_fleet_arguments(parser, "wire")
    add_output_arguments(parser, "coefficients, intervals and errors", "the errors")


def run(args: argparse.Namespace) -> int:
    """Fit, write and report; 0 when MODEL.yaml was written."""
    if args.table:
        asked = {name: getattr(args, name) for name in ("model", "method", "variant", "order")}
        asked["reading"] = reading_of(args)
        return run_fleet(args, "identify", fit_logs, args.logs, args.config, asked, True, str(args.out))
    from .page import write_page

    page = args.report or args.out.with_suffix(".html")
    refuse_to_overwrite(args, args.out, page)
    reading, console = reading_of(args), notes(args)
    mapping = read_parameter_file(args.config)
    with progress_bar(args) as bar:
        task = bar.add_task("reading", total=1.0)
        logs = read_logs(args.logs, reading, console.print, lambda fraction: bar.update(task, completed=fraction))
        fitting = bar.add_task("fitting", total=1.0)
        result = identify(
            logs,
            mapping,
            args.model,
            args.method,
            args.variant,
            args.order,
            lambda fraction: bar.update(fitting, completed=fraction),
        )
        bar.update(fitting, completed=1.0)
    write_model(args.out, result)
    write_page(page, result)
    write_json(args, summary(result))
    write_csv(args, [dataclasses.asdict(e) for e in result.errors])
    results(args).print(_table(result))
    for note in result.notes:
        console.print(f"note: {note}")
    console.print(f"wrote {args.out} and {page}")
    return 0


def fit_logs(paths: Sequence[Path], config: Path, options: Mapping[str, Any]) -> list[Finding]:
    """The work on the logs of one wire of a fleet."""
    mapping = read_parameter_file(config)
    asked = (options[name] for name in ("model", "method", "variant", "order"))
    result = identify(read_logs(paths, options["reading"]), mapping, *asked)
    findings = []
    for path in paths:
        errors = [e.full_percent for e in result.errors if e.name.startswith(path.name)]
        findings.append(
            Finding(
                "fitted" if errors else "left out",
                ". ".join(result.notes),
                error_percent=float(np.mean(errors)) if errors else float("nan"),
                details={"errors": [dataclasses.asdict(e) for e in result.errors if e.name.startswith(path.name)]},
                model=model_text(result),
            )
        )
    return findings


def write_model(path: Path, result: Identification) -> None:
    """Write the parameter file for the node, whole or not at all."""
    text = model_text(result)
    write_atomically(path, lambda stream: stream.write(text.encode()))


def model_text(result: Identification) -> str:
    """The parameter file for the node."""
    text = "# Written by `sma-actuator identify`; 95 % intervals and pictures are in the page beside it.\n"
    return text + yaml.safe_dump({NODE_NAME: {"ros__parameters": result.mapping}}, sort_keys=False, allow_unicode=True)


def summary(result: Identification) -> dict:
    """The result for machines."""
    out = {
        "model": result.mapping["model"],
        "intervals_95_percent": result.intervals,
        "errors": [dataclasses.asdict(e) for e in result.errors],
        "notes": result.notes,
    }
    if result.fatigue:
        out["fatigue"] = {name: dataclasses.asdict(d) for name, d in result.fatigue.drift.items()}
    return out


def _table(result: Identification) -> Table:
    table = Table(title="Mean absolute error, % of full stroke (on the logs it was fitted on)")
    for header in ("log", "load [N]", "working range", "samples in it", "full range"):
        table.add_column(header, justify="left" if header == "log" else "right")
    for e in result.errors:
        table.add_row(
            e.name, f"{e.load_N:.2f}", f"{e.working_percent:.2f}", f"{e.working_share:.0%}", f"{e.full_percent:.2f}"
        )
    return table
