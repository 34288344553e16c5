"""``sma-actuator check-log``: are these logs fit to test resistance and load against strain on a real wire?"""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path

from rich.table import Table

from sma_actuator.console import (
    add_output_arguments,
    notes,
    refuse_to_overwrite,
    results,
    say_next,
    typed,
    write_csv,
    write_json,
)
from sma_actuator.logs.files import write_atomically
from sma_actuator.logs.fitness import Finding, judge
from sma_actuator.logs.mapping import ColumnMap
from sma_actuator.logs.reading import add_log_arguments, one_map, read_logs, reading_of, said_of_logs
from sma_actuator.logs.units import metres


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator check-log``."""
    parser.add_argument(
        "logs", nargs="+", type=Path, metavar="LOG", help="all logs of one wire: files, folders, patterns"
    )
    parser.add_argument(
        "--length",
        type=metres,
        default=math.nan,
        metavar="M",
        help="length of the wire, as 0.1 (metres) or 100mm, if known",
    )
    parser.add_argument(
        "--write-map",
        type=Path,
        metavar="MAP.yaml",
        help="write which column was taken for which and in what unit, for --map-file of the other commands",
    )
    add_log_arguments(parser)
    add_output_arguments(parser, "the findings", "the findings")


def run(args: argparse.Namespace) -> int:
    """Say what the logs have and lack; 0 when they are fit."""
    refuse_to_overwrite(args, args.write_map)
    found: list[ColumnMap] = []
    findings = judge(read_logs(args.logs, reading_of(args), notes(args).print, found=found), args.length)
    table = Table(title="What was asked, and what is there")
    for header in ("", "asked", "found"):
        table.add_column(header)
    for f in findings:
        table.add_row("yes" if f.met else "no" if f.needed else "(no)", f.requirement, f.found)
    out = results(args)
    out.print(table)
    out.print(verdict(findings))
    for f in findings:
        if not f.met:
            out.print(f"- {f.requirement}: {f.remedy}.")
    if args.write_map and found:
        text = one_map(found).as_text()
        write_atomically(args.write_map, lambda stream: stream.write(text.encode()))
        notes(args).print(
            f"wrote {args.write_map}: give it to identify, replay or trace with --map-file {typed(args.write_map)}"
        )
    rows = [dataclasses.asdict(f) for f in findings]
    write_json(args, rows)
    write_csv(args, rows)
    fit = all(f.met for f in findings if f.needed)
    say_next(args, _next(args) if fit else "record that, then look again with the same command")
    return 0 if fit else 1


def _next(args: argparse.Namespace) -> str:
    """A model from logs that are fit."""
    length = "L" if math.isnan(args.length) else f"{args.length:g}"
    mapped = f"--map-file {typed(args.write_map)}" if args.write_map else said_of_logs(args)
    logs = " ".join([typed(*args.logs), *([mapped] if mapped else [])])
    return (
        f"sma-actuator identify {logs} --alloy ni-ti --length {length} --diameter D --out my_wire.yaml (L, D: 0.1 "
        f"or 100mm)"
    )


def verdict(findings: list[Finding]) -> str:
    """One sentence."""
    lacking = sum(not f.met for f in findings if f.needed)
    if not lacking:
        return "These logs are fit: please send them (docs/send-us-a-log.md says where)."
    things = "one thing is" if lacking == 1 else f"{lacking} things are"
    return f"These logs are not fit yet: {things} missing. What would mend it:"
