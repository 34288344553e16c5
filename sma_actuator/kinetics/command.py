"""``sma-actuator loop``."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from sma_actuator.base.errors import UserError
from sma_actuator.console import (
    add_output_arguments,
    notes,
    progress_bar,
    refuse_to_overwrite,
    results,
    say_next,
    write_json,
)
from sma_actuator.logs.reading import add_map_arguments, columns_of

from .fitting import FAMILIES, Comparison, both, compare
from .reading import COLUMNS, Loop, read_loop
from .temperatures import Temperatures, slopes_Pa_K, temperatures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator loop``."""
    parser.add_argument(
        "loops",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="one loop at one stress in each: CSV with temperature_C, strain (strain_%% for percent), stress_MPa, or "
        "these three without a header",
    )
    parser.add_argument(
        "--kinetics",
        action="store_true",
        help=f"compare {', '.join(FAMILIES)}: fitted to all stresses, and judged on each after a fit to the others",
    )
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="write a page with pictures here")
    add_map_arguments(parser)
    add_output_arguments(parser, "all numbers")


def run(args: argparse.Namespace) -> int:
    """Read, fit, write and report; 0 when all was written."""
    if args.report:
        from .page import write_page
    refuse_to_overwrite(args, args.report)
    columns = columns_of(args, COLUMNS)
    loops = sorted((read_loop(path, columns) for path in args.loops), key=lambda loop: loop.mean_stress_Pa)
    names = [loop.name for loop in loops]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise UserError(f"{twice[0]}: given more than once; each loop counts once")
    found = [temperatures(loop) for loop in loops]
    families = list(FAMILIES) if args.kinetics else ["measured"]
    compared = []
    with progress_bar(args) as bar:
        task = bar.add_task("fitting", total=float(len(families)))
        for name in families:
            bar.update(task, description=f"fitting {name}")
            compared.append(compare(FAMILIES[name], loops, leave_out=args.kinetics))
            bar.advance(task)
    console = results(args)
    console.print(_read_off(loops, found))
    console.print(_fitted(loops, compared))
    if args.report:
        write_page(args.report, loops, found, compared)
        notes(args).print(f"wrote {args.report}")
    write_json(args, summary(loops, found, compared))
    say_next(args, _next(args))
    return 0


def _next(args: argparse.Namespace) -> str:
    """What these loops have not been asked yet."""
    if not args.kinetics and len(args.loops) > 1:
        return "the same with --kinetics: which physics foretells the stress that it has not seen"
    if not args.report:
        return "the same with --report loops.html, to see where a fit leaves the loops"
    return "`sma-actuator forward`, where runs of power and displacement were recorded too"


def summary(loops: list[Loop], found: list[Temperatures], compared: list[Comparison]) -> dict[str, Any]:
    """Everything, for machines."""
    fits = {}
    for c in compared:
        judged = c.left_out or [None] * len(loops)
        fits[c.all.family] = {
            "kinetics": asdict(c.all.kinetics),
            "strain": {
                "base": c.all.base,
                "largest": c.all.largest,
                "stress_0_Pa": c.all.stress_0_Pa,
                "stress_scale_Pa": c.all.stress_scale_Pa,
            },
            "rms_of_stroke": {
                loop.name: {"seen": seen, "left_out": left_out}
                for loop, seen, left_out in zip(loops, c.seen, judged, strict=True)
            },
        }
    return {
        "loops": {
            loop.name: {**asdict(t), "widths_K": t.widths_K, "hysteresis_K": t.hysteresis_K}
            for loop, t in zip(loops, found, strict=True)
        },
        "slopes_Pa_K": slopes_Pa_K(found),
        "fits": fits,
    }


def _read_off(loops: list[Loop], found: list[Temperatures]) -> Table:
    table = Table(title="Read off the loops: °C where 90, 50 and 10 % of the stroke are martensite")
    for header in ("loop", "MPa", "stroke %", "heating", "cooling", "widths K", "hysteresis K", "A_s, A_f", "M_s, M_f"):
        table.add_column(header, justify="left" if header == "loop" else "right")
    for loop, t in zip(loops, found, strict=True):
        table.add_row(
            loop.name,
            f"{t.stress_Pa / 1e6:.0f}",
            f"{100 * t.stroke:.2f}",
            _several(t.heating_C),
            _several(t.cooling_C),
            _several(t.widths_K),
            f"{t.hysteresis_K:.1f}",
            _several((t.austenite_start_C, t.austenite_finish_C)),
            _several((t.martensite_start_C, t.martensite_finish_C)),
        )
    slopes = slopes_Pa_K(found)
    if slopes:
        table.add_section()
        heating, cooling = (tuple(s / 1e6 for s in slopes[name]) for name in ("heating", "cooling"))
        table.add_row("MPa/K", "", "", _several(heating), _several(cooling), "", "", "", "")
    return table


def _fitted(loops: list[Loop], compared: list[Comparison]) -> Table:
    table = Table(title="RMS of the fit, % of the stroke (after a fit to the other stresses)")
    table.add_column("loop")
    for c in compared:
        table.add_column(c.all.family, justify="right")
    for i, loop in enumerate(loops):
        cells = [
            f"{100 * both(c.seen[i]):.2f}" + (f" ({100 * both(c.left_out[i]):.2f})" if c.left_out else "")
            for c in compared
        ]
        table.add_row(loop.name, *cells)
    return table


def _several(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.1f}" for value in values)
