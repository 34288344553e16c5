"""``sma-actuator identify``."""

from __future__ import annotations

import argparse
import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from sma_actuator.base.options import number_within
from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.base.parameters import ConfigError, not_a_section
from sma_actuator.base.yaml_text import parse_yaml
from sma_actuator.config import (
    Config,
    bench_from_mapping,
    parameter_text,
    require_calibrated,
    write_parameter_file,
)
from sma_actuator.console import (
    add_output_arguments,
    headed,
    notes,
    progress_bar,
    refuse_to_overwrite,
    results,
    say_next,
    typed,
    write_csv,
    write_json,
)
from sma_actuator.derived import with_derived
from sma_actuator.diagnosis.extension import Extended, extend
from sma_actuator.fleet import Finding, add_fleet_arguments, run_fleet
from sma_actuator.identify.fitters import FITTERS, METHODS, Progress
from sma_actuator.identify.identification import THESIS_MODEL, Identification, identify, identify_best
from sma_actuator.identify.verdict import REGIONS
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.reading import add_log_arguments, place, read_logs, reading_of
from sma_actuator.logs.units import metres

NOT_GOOD = 3  #: exit code where a model was written that should not drive a wire


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
        metavar="BENCH.yaml",
        help="parameters of the bench (a model in it is replaced); where there is none, the wire's will do:",
    )
    _of_the_wire(parser)
    _of_the_fit(parser)
    parser.add_argument(
        "--report", type=Path, metavar="FILE.html", help="page with the pictures (default: beside MODEL.yaml)"
    )
    add_log_arguments(parser)
    add_fleet_arguments(parser, "wire")
    add_output_arguments(parser, "coefficients, intervals and errors", "the errors")


def _of_the_wire(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--alloy", choices=tuple(THESIS_MODEL), help="alloy of the wire")
    parser.add_argument(
        "--length", type=metres, metavar="M", help="length of the wire between the crimps, as 0.1 (metres) or 100mm"
    )
    parser.add_argument(
        "--diameter", type=metres, metavar="M", help="diameter of the wire, as 0.15e-3 (metres) or 0.006in"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="one more parameter, as circuit.reference_resistance=0.5 where the log holds the voltage over it; may be "
        "repeated",
    )


def _of_the_fit(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--model",
        metavar="TYPE",
        help="model.type to fit: whole_range, flexinol, furukawa … (default: the best one for these logs; the thesis's "
        "where --method, --variant or --order is given)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("model.yaml"),
        metavar="MODEL.yaml",
        help="parameter file to write: the bench's, or what the logs told of it, with the model in it (default "
        "%(default)s)",
    )
    parser.add_argument(
        "--method",
        choices=METHODS,
        help="flexinol: joint, all together (the default), or the thesis's appendix C",
    )
    parser.add_argument(
        "--variant",
        choices=("average", "direct_switching", "transition"),
        help="furukawa: how the curves are used (default average)",
    )
    parser.add_argument(
        "--order",
        type=number_within(0, kind=int),
        help="order of the stress polynomials (default: chosen on held-out cycles)",
    )
    parser.add_argument(
        "--no-extension",
        action="store_true",
        help="do not look for effects that the model lacks on its own logs (default: what also helps logs held out is "
        "added)",
    )
    parser.add_argument(
        "--jobs", type=number_within(1, kind=int), default=2, help="processes of that search (default %(default)s)"
    )


def run(args: argparse.Namespace) -> int:
    """Fit, write and report; 0 when MODEL.yaml was written and is good for control, NOT_GOOD when it is not."""
    from sma_actuator.identify.page import write_page

    if args.table:
        given = {name: getattr(args, name) for name in ("alloy", "length", "diameter", "set")}
        asked = {name: getattr(args, name) for name in ("model", "method", "variant", "order", "no_extension")}
        asked |= {"given": given, "reading": reading_of(args)}
        return run_fleet(args, "identify", fit_logs, args.logs, args.config or "", asked, True, str(args.out))
    page = args.report or args.out.parent / f"{args.out.stem}.html"
    refuse_to_overwrite(args, args.out, page)
    reading, console = reading_of(args), notes(args)
    mapping = _what_is_given(args)
    with progress_bar(args) as bar:
        task = bar.add_task("reading", total=1.0)
        logs = read_logs(args.logs, reading, console.print, lambda fraction: bar.update(task, completed=fraction))
        fitting = bar.add_task("fitting", total=1.0)
        result = _fitted(logs, mapping, vars(args), lambda fraction: bar.update(fitting, completed=fraction))
        bar.update(fitting, completed=1.0)
        extended = None
        if FITTERS[result.config.model_type].extended and not args.no_extension:
            searching = bar.add_task("what it lacks", total=1.0)
            extended = extend(result, args.jobs, lambda fraction: bar.update(searching, completed=fraction))
            result = dataclasses.replace(extended.result, notes=[*extended.result.notes, *extended.sentences])
    write_page(page, result)
    write_model(args.out, result, page)
    write_json(args, summary(result, extended))
    write_csv(args, [dataclasses.asdict(e) for e in result.errors])
    out = results(args)
    out.print(_table(result))
    out.print(_regions(result))
    if result.chosen:
        out.print(headed("model", result.chosen))
    first, *others = result.verdict.sentences
    out.print(headed("verdict", first))
    for sentence in others:
        out.print(f"  {sentence}")
    said = extended.sentences if extended else []
    for sentence in said:
        out.print(headed("extension", sentence))
    beside = () if result.chosen or not result.beside else (result.beside,)
    for note in (*beside, *result.notes):
        if note not in said:
            console.print(f"note: {note}")
    console.print(f"wrote {args.out} and {page}")
    complete = "instruments" in result.mapping
    next_ = f"check --config {typed(args.out)}" if complete else f"init --start {typed(args.out)} --out node.yaml"
    say_next(args, f"{'' if complete else 'for a node: '}sma-actuator {next_}")
    return 0 if result.verdict.good_for_control else NOT_GOOD


def fit_logs(paths: Sequence[Path], config: Path, options: Mapping[str, Any]) -> list[Finding]:
    """The work on the logs of one wire of a fleet."""
    given = argparse.Namespace(config=config if config.stat().st_size else None, **options["given"])
    mapping = _what_is_given(given)
    result = _fitted(read_logs(paths, options["reading"]), mapping, options)
    if FITTERS[result.config.model_type].extended and not options["no_extension"]:
        result = extend(result, 1).result
    findings = []
    for path in paths:
        errors = [e for e in result.errors if e.name.startswith(path.name)]
        findings.append(
            Finding(
                "good for control" if result.verdict.good_for_control else "not good for control",
                result.verdict.sentences[0],
                error_percent=float(np.mean([e.full_percent for e in errors])) if errors else math.nan,
                details={"errors": [dataclasses.asdict(e) for e in errors], "verdict": result.verdict.as_mapping()},
                model=parameter_text(result.mapping, _header(result, None, Path("this file")), result.reasons),
            )
        )
    return findings


def _fitted(
    logs: Sequence[BenchLog],
    mapping: Mapping[str, Any],
    options: Mapping[str, Any],
    progress: Progress = lambda fraction: None,
) -> Identification:
    """The model that the options ask for; the best one, where they leave it to the logs."""
    model, method, variant, order = (options[name] for name in ("model", "method", "variant", "order"))
    if model is None and method is None and variant is None and order is None:
        return identify_best(logs, mapping, progress)
    if model is None:
        model = THESIS_MODEL[bench_from_mapping(with_derived(mapping)).wire.alloy]
    return identify(logs, mapping, model, method or "joint", variant or "average", order, progress)


def _what_is_given(args: argparse.Namespace) -> dict[str, Any]:
    """The parameters of file and options.  Raises ConfigError where they do not say which wire it is."""
    mapping = read_parameter_file(args.config) if args.config else {}
    wire = {name: getattr(args, name) for name in ("alloy", "length", "diameter") if getattr(args, name) is not None}
    mapping["wire"] = {**_section(mapping, "wire"), **wire}
    for word in args.set:
        name, _, text = word.partition("=")
        section, _, key = name.partition(".")
        value = parse_yaml(text, f"--set {word}")
        if not key or value is None:
            raise ConfigError(f"--set {word}: SECTION.PARAMETER=VALUE is wanted, as circuit.reference_resistance=0.5")
        mapping[section] = {**_section(mapping, section), key: value}
    lacking = [name for name in ("alloy", "length", "diameter") if name not in mapping["wire"]]
    if lacking:
        words = " and ".join(f"--{name}" for name in lacking)
        raise ConfigError(f"which wire it is must be said: {words}, or --config with a file that has a section wire")
    return mapping


def _section(mapping: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    section = mapping.get(name, {})
    if not isinstance(section, Mapping):
        raise ConfigError(not_a_section(name, section))
    return section


def write_model(path: Path, result: Identification, page: Path | None = None) -> None:
    """Write the parameter file, whole or not at all; ``page``: where its pictures are."""
    write_parameter_file(path, result.mapping, _header(result, page, path), result.reasons)


def _header(result: Identification, page: Path | None, path: Path) -> str:
    header = "Written by `sma-actuator identify`"
    if page is not None:
        # Seen from the file, so that it holds wherever the two are taken together.
        seen = os.path.relpath(page, path.parent)
        where = f"{page.name} beside it" if seen == page.name else seen
        header += f"; 95 % intervals and pictures are in {where}"
    try:
        require_calibrated(Config.from_mapping(result.mapping))
    except ConfigError:
        header += (
            ".\nFor the tools: it lacks limits, gains or calibrations that a node wants. "
            f"`sma-actuator init --start {path.name}` asks for them."
        )
    return header


def summary(result: Identification, extended: Extended | None = None) -> dict:
    """The result for machines."""
    out = {
        "model": result.mapping["model"],
        "intervals_95_percent": result.intervals,
        "errors": [dataclasses.asdict(e) for e in result.errors],
        "verdict": result.verdict.as_mapping(),
        "chosen": result.chosen,
        "notes": result.notes,
    }
    if extended:
        out["extension"] = {
            "added": list(extended.added),
            "sentences": extended.sentences,
            "error_before_pct_stroke": extended.before_percent,
            "error_after_pct_stroke": extended.after_percent,
        }
    if result.fatigue:
        out["fatigue"] = {name: dataclasses.asdict(d) for name, d in result.fatigue.drift.items()}
    return out


def _regions(result: Identification) -> Table:
    """The verdict's figures."""
    table = Table(title=f"The same, on {result.verdict.left_out} left out of the fit")
    table.add_column("load [N]", justify="right")
    for name in REGIONS:
        table.add_column(name, justify="right")
    for row in (*result.verdict.loads, {"load_N": math.nan, **result.verdict.regions}):
        load = "all" if math.isnan(row["load_N"]) else f"{row['load_N']:.3g}"
        table.add_row(load, *(f"{row[name]:.2f}" if name in row else "–" for name in REGIONS))
    return table


def _table(result: Identification) -> Table:
    table = Table(title="Mean absolute error, % of full stroke (on the logs it was fitted on)")
    for header in ("log", "load [N]", "working range", "samples in it", "full range"):
        table.add_column(header, justify="left" if header == "log" else "right")
    for e in result.errors:
        table.add_row(
            e.name, f"{e.load_N:.3g}", f"{e.working_percent:.2f}", f"{e.working_share:.0%}", f"{e.full_percent:.2f}"
        )
    return table
