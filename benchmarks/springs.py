"""What the load tells beside the resistance where a wire pulls a spring: the loop with it and without.

    python benchmarks/springs.py [--physics NAME …] [--wires NAME …] [--jobs N] [--picture FILE]

Wires that came the user's way (``users_way.py``), driven by steps over 85 % of their true stroke (``driven.py``) on two
springs, with ``estimator.elastic_load`` and without, and under a weight, where there is nothing to tell.  The picture
is of the run that it changes most.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from driven import Case, Found, run
from rich.console import Console
from rich.table import Table
from users_way import WIRES, prepared

from sma_actuator.plant.worlds import WORLDS

LOADS = ("spring", "stiff_spring", "weight")
WITHOUT = (("estimator.elastic_load", False),)
MODEL = "whole_range"


def both(case: Case) -> tuple[Found, Found]:
    """Without, and with."""
    return run(replace(case, changes=WITHOUT), keep=True), run(case, keep=True)


def main() -> None:
    """Drive every wire on every load, and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--physics", nargs="*", default=sorted(WORLDS))
    parser.add_argument("--wires", nargs="*", default=WIRES)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--picture", type=Path, metavar="FILE")
    args = parser.parse_args()
    wires = [(wire, physics, (MODEL,)) for physics in args.physics for wire in args.wires]
    cases = [Case(wire, physics, MODEL, load, "steps", "pid") for wire, physics, _ in wires for load in LOADS]
    found = prepared(wires, both, cases, args.jobs)
    table = Table(title="Without and with estimator.elastic_load: % of full stroke", title_justify="left")
    for column in ("physics", "wire", "load", "model", "held, off by", "output", "in 95 %"):
        table.add_column(column, justify="left" if column in ("physics", "wire", "load") else "right")
    for case, (was, now) in zip(cases, found, strict=True):
        pairs = [(was.model, now.model), (was.held, now.held), (was.output, now.output)]
        numbers = [f"{before:.2f} → {after:.2f}" for before, after in pairs]
        covered = f"{was.covered:.0%} → {now.covered:.0%}"
        table.add_row(case.physics, case.wire, case.load, *numbers, covered)
    Console(width=110).print(table)
    if args.picture:
        draw(max(found, key=lambda pair: pair[0].model - pair[1].model), args.picture)


def draw(pair: tuple[Found, Found], path: Path) -> None:
    """What was asked for, true and estimated, without and with."""
    import matplotlib

    matplotlib.use("svg" if path.suffix == ".svg" else "agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 1, figsize=(9.0, 5.5), sharex=True, layout="constrained")
    for ax, found, words in zip(axes, pair, ("resistance alone", "resistance and the spring's load"), strict=True):
        one = found.series
        low, high = one["estimate_m"] - one["uncertainty_m"], one["estimate_m"] + one["uncertainty_m"]
        ax.plot(one["time_s"], 1e3 * one["asked_m"], color="0.6", lw=1.0, label="setpoint")
        ax.fill_between(one["time_s"], 1e3 * low, 1e3 * high, color="C0", alpha=0.2, lw=0.0)
        ax.plot(one["time_s"], 1e3 * one["estimate_m"], color="C0", lw=1.2, label="estimate and its 95 % interval")
        ax.plot(one["time_s"], 1e3 * one["truth_m"], color="k", lw=1.2, label="true")
        ax.set_title(f"{words}: model error {found.model:.2f} %", loc="left", fontsize=10)
        ax.set_ylabel("displacement [mm]")
    axes[0].legend(loc="upper right", fontsize=8, ncols=3)
    axes[1].set_xlabel("time [s]")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
