"""What a real wire's resistance says of its displacement: a static loop, both models, points between the points.

    python benchmarks/static_loop.py [--models flexinol whole_range] [--seconds 60] [--picture out/static_loop.png]

The record (M. Zuk, MK-Zuk/SMA-dataset, "static characteristics", every second point) has no licence, so it is read from
../shared/data/static_loop and not shipped; without it the benchmark says so and ends.  Its wire's size and load are not
stated:
0.42 m × 0.381 mm follow from the resistance and from a stroke of 4 %, 5 N is assumed.

Fitted to all points, and to every second point of each branch in turn; judged at the points of the other half, ends
excepted.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table as Shown

from sma_actuator.estimation.chain import Chain
from sma_actuator.identify import identify
from sma_actuator.logs.experiments import make_experiment
from sma_actuator.logs.mapping import column_map
from sma_actuator.logs.static import ROUNDS, PERIOD_s, log_of_points
from sma_actuator.logs.tables import Table
from sma_actuator.logs.text import read_text

RECORD = Path(__file__).resolve().parents[2] / "shared" / "data" / "static_loop" / "static_loop.csv"
WIRE = {"alloy": "ni-ti", "length": 0.42, "diameter": 0.381e-3}
LOAD_N = 5.0
COLUMNS = column_map(
    ["wire_voltage_V=voltage_V", "displacement_m=contraction_mm", f"load_N={LOAD_N}"], ["displacement_m=-mm"], [], None
)


def read(seconds: float) -> tuple[Table, np.ndarray]:
    """The record with our columns, and which of its points are of heating."""
    table = read_text(RECORD)
    count = len(table.columns["current_A"])
    table = dataclasses.replace(table, columns={**table.columns, "time_s": seconds * np.arange(count)})
    heating = np.arange(count) <= int(np.argmax(table.columns["current_A"]))
    return COLUMNS.apply(table), heating


def only(table: Table, kept: np.ndarray) -> Table:
    """Some of its points."""
    return dataclasses.replace(table, columns={name: values[kept] for name, values in table.columns.items()})


def halves(heating: np.ndarray) -> list[np.ndarray]:
    """Twice the points of which every second one of each branch is left out; the ends of both branches stay."""
    number = np.where(heating, np.arange(len(heating)), np.arange(len(heating)) - np.count_nonzero(heating))
    ends = np.zeros(len(heating), dtype=bool)
    turn = np.count_nonzero(heating)
    ends[[0, turn - 1, turn, len(heating) - 1]] = True
    return [ends | (number % 2 == parity) for parity in (0, 1)]


def estimates_m(config, table: Table, seconds: float) -> np.ndarray:
    """What a model makes of every point, in the last round."""
    experiment = make_experiment(log_of_points(table, seconds, {}), config)
    found_m = Chain(config).run(experiment.signals).displacement_m
    count = len(table.columns["current_A"])
    return found_m[np.round((np.arange(count) + (ROUNDS - 1) * count) * seconds / PERIOD_s).astype(int)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", nargs="+", default=["flexinol", "whole_range"])
    parser.add_argument("--seconds", type=float, default=60.0, help="from one point to the next (default %(default)s)")
    parser.add_argument("--picture", type=Path, default=Path("out/static_loop.png"))
    args = parser.parse_args()
    console = Console()
    if not RECORD.exists():
        console.print(f"{RECORD} is not here: the record has no licence and is not shipped")
        return 0
    table, heating = read(args.seconds)
    measured_m = table.columns["displacement_m"]
    stroke_m = float(np.ptp(measured_m))
    shown = Shown(
        title=f"Static loop of a real wire: mean absolute error, % of the stroke of {stroke_m * 1e3:.1f} mm (largest)"
    )
    for header in ("model", "range", "points", "heating", "cooling", "heating, in range", "cooling, in range"):
        shown.add_column(header)
    drawn = []
    for model in args.models:
        everything = np.ones(len(heating), dtype=bool)
        for name, kept in (
            ("fitted", everything),
            *zip(("between, 1st half", "between, 2nd half"), halves(heating), strict=True),
        ):
            result = identify([log_of_points(only(table, kept), args.seconds, {})], {"wire": WIRE}, model)
            found_m = estimates_m(result.config, table, args.seconds)
            judged = everything if kept.all() else ~kept
            error = 100.0 * np.abs(found_m - measured_m) / stroke_m
            low_m, high_m = result.config.model.displacement_range
            inside = (measured_m >= low_m) & (measured_m <= high_m)
            cells = [error[judged & branch & where] for where in (everything, inside) for branch in (heating, ~heating)]
            words = [f"{np.nanmean(c):.2f} ({np.nanmax(c):.1f}, {len(c)} points)" if len(c) else "–" for c in cells]
            shown.add_row(model, f"{low_m * 1e3:.1f} to {high_m * 1e3:.1f} mm", name, *words)
            drawn.append((f"{model}, {name}", found_m))
    console.print(shown)
    draw(args.picture, table, heating, drawn)
    console.print(f"wrote {args.picture}")
    return 0


def draw(path: Path, table: Table, heating: np.ndarray, drawn: list[tuple[str, np.ndarray]]) -> None:
    """Contraction over resistance, measured and modelled."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with np.errstate(divide="ignore", invalid="ignore"):
        resistance_Ohm = table.columns["wire_voltage_V"] / table.columns["current_A"]
    figure, axes = pyplot.subplots(1, len(drawn), figsize=(4 * len(drawn), 4), sharey=True, squeeze=False)
    for ax, (title, found_m) in zip(axes[0], drawn, strict=True):
        for branch, colour in ((heating, "C3"), (~heating, "C0")):
            ax.plot(resistance_Ohm[branch], 1e3 * table.columns["displacement_m"][branch], "o", color=colour, ms=4)
            ax.plot(resistance_Ohm[branch], 1e3 * found_m[branch], "-", color=colour)
        ax.set(xlabel="resistance [Ω]", ylabel="displacement [mm]", title=title)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, bbox_inches="tight", dpi=90)
    pyplot.close(figure)


if __name__ == "__main__":
    sys.exit(main())
