"""What the thesis's Flexinol model lacks over the whole range, found by tracing, and what adding it buys.

    python benchmarks/own_baseline.py [--rounds N] [--json FILE]     (make own-baseline)

The model is identified on calibration logs under constant loads.  Then sessions with nothing hidden
in them (weight, spring and sudden load steps; pulses that settle in the indeterminate ends, partial
cycles, slow triangles) are traced beyond the model's own floor, and the extended model is judged on
sessions with other seeds, which no fit has seen.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from blind_cases import LOADS, identified, make_logs, without_effects
from rich.console import Console
from rich.table import Table

from sma_actuator.config import Config
from sma_actuator.console import write_json
from sma_actuator.diagnosis.trace import Evidence, trace
from sma_actuator.diagnosis.trace.report import extended, summary
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.replay import replay


def sessions(wire: str, seed: int):
    """(load, logs) of one session under each load."""
    out = []
    for i, load in enumerate(LOADS):
        with tempfile.TemporaryDirectory(prefix="sma_baseline_") as folder:
            case = without_effects(wire, load, seed + i)
            out.append((load, [read_bench_log(path) for path in make_logs(case, Path(folder))]))
    return out


def errors(config: Config, judged) -> dict[str, tuple[float, float]]:
    """(full range, working range) error of each load, % of full stroke."""
    out = {}
    for load, logs in judged:
        found = [r.errors["model"] for r in replay(logs, {"model": config})]
        weight = [len(log) for log in logs]
        out[load] = (
            float(np.average([e.full_percent for e in found], weights=weight)),
            float(np.average([e.working_percent for e in found], weights=weight)),
        )
    return out


def main() -> int:
    """Experiment, judge and print; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    console = Console(width=140)
    numbers = {}
    for wire in ("flexinol", "furukawa"):
        config = identified(wire)
        evidence = Evidence([log for _, logs in sessions(wire, 7000) for log in logs], config, beyond_floor=True)
        tracing = trace(evidence)
        report = summary(tracing)
        console.print(f"[bold]{wire}[/bold]: {report['sentence']}")
        for e in report["effects"]:
            values = ", ".join(f"{n} {p['value']:.3g} {p['unit']}" for n, p in e["parameters"].items())
            console.print(f"  {e['name']} ({e['share']:.0%} of the loss): {values}")
        mapping = extended(config.to_mapping(), tracing, report, "")
        after = Config.from_mapping(mapping) if mapping else config
        judged = sessions(wire, 8000)
        rows = [errors(c, judged) for c in (config, after)]
        table = Table(title=f"{wire}: mean absolute error on sessions no fit has seen, % of full stroke")
        for header in ("load", "full range: before", "after", "working range: before", "after"):
            table.add_column(header, justify="left" if header == "load" else "right")
        for load in LOADS:
            table.add_row(load, *(f"{rows[k][load][r]:.2f}" for r in (0, 1) for k in (0, 1)))
        table.add_row("mean", *(f"{np.mean([rows[k][load][r] for load in LOADS]):.2f}" for r in (0, 1) for k in (0, 1)))
        console.print(table)
        numbers[wire] = {
            "sentence": report["sentence"],
            "effects": report["effects"],
            "before": rows[0],
            "after": rows[1],
        }
    write_json(args, numbers)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
