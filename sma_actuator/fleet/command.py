"""``sma-actuator fleet``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from sma_actuator.base.errors import UserError
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

from .drift import WireState, refused, states, verdict
from .table import read_table

_SHOWN = 40  #: wires that are printed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator fleet``."""
    parser.add_argument(
        "table", type=Path, metavar="TABLE.parquet", help="what --table of replay, trace and forward was given"
    )
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="write a page with pictures here")
    add_output_arguments(parser, "the state of every wire", "the state of every wire")


def run(args: argparse.Namespace) -> int:
    """Say which wires drift; 0 when the table could be read."""
    refuse_to_overwrite(args, args.report)
    rows = read_table(args.table)
    if not rows:
        raise UserError(f"{args.table}: there is no table, or nothing in it; --table of replay and trace writes one")
    found = states(rows)
    console = results(args)
    console.print(verdict(found))
    if any(s.drifts for s in found):
        console.print(_table(found))
    if args.report:
        from .page import write_page

        write_page(args.report, found, refused(rows))
        notes(args).print(f"wrote {args.report}")
    summary = [_summary(state) for state in found]
    write_json(args, summary)
    write_csv(args, summary)
    first = next((s.rows[-1]["log"] for s in found if s.drifts), "")
    say_next(
        args,
        f"do what the table says, or see it for one wire: sma-actuator trace {typed(first)} --config "
        f"ITS_MODEL.yaml --out out/traced"
        if first
        else "nothing; the same table with the next logs (--table of replay or trace)",
    )
    return 0


def _summary(state: WireState) -> dict[str, Any]:
    return {
        "wire": state.wire,
        "drifts": state.drifts,
        "since": state.since.isoformat() if state.since else "",
        "effects": " + ".join(state.effects),
        "logs": len(state.rows),
        "first_error_percent": state.first_percent,
        "last_error_percent": state.last_percent,
    }


def _table(found: Sequence[WireState]) -> Table:
    drifting = [s for s in found if s.drifts]
    table = Table(title="Wires that drift" + (f", the first {_SHOWN}" if len(drifting) > _SHOWN else ""))
    for header in ("wire", "by", "since", "error % at first", "now", "what to do"):
        table.add_column(header, justify="right" if header in ("error % at first", "now") else "left")
    for s in drifting[:_SHOWN]:
        by = " + ".join(n.replace("_", " ") for n in s.effects) or "not named"
        table.add_row(s.wire, by, f"{s.since:%Y-%m-%d}", f"{s.first_percent:.2f}", f"{s.last_percent:.2f}", s.remedy)
    return table
