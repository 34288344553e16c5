"""Tables 4–9 of the thesis on the virtual bench: model, control and output error under control.

    python benchmarks/control_tables.py [--json FILE]     (make tables)

The same driver, actuator and supervisor as in the node, stepped in the virtual time of the bench:
no sockets, no ROS, no waiting.  Setpoints stay in the model's working range, as the thesis's do;
every sample from the first setpoint on is judged, transients included.  The thesis does not state
how long it held each position: here it is 20 s, and sine and triangle have a period of 60 s.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from sma_actuator.base.share import shared_file
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config
from sma_actuator.console import write_json
from sma_actuator.control.setpoints import Setpoint, sine, steps, triangle
from sma_actuator.control.tracking import TrackingErrors
from sma_actuator.driver import Driver
from sma_actuator.plant.loads import Load, Schedule, Spring, Weight

DWELL_s = 20.0
PERIOD_s = 60.0
DURATION_s = 240.0
#: Positions of the step experiments as parts of the working range, in an order without a pattern.
STEPS = (0.70, 0.30, 0.85, 0.50, 0.15, 0.60, 0.25, 0.90, 0.40, 0.75, 0.10, 0.55)

CONSTANT = Weight(0.98)
SPRING = Spring(stiffness_N_m=150.0, preload_N=0.8)
SWITCHED = Schedule([(0.0, Weight(0.98)), (70.0, Weight(1.47)), (130.0, Weight(0.69)), (190.0, Weight(0.98))])
VARYING = Schedule([(0.0, Weight(0.98)), (90.0, SPRING), (170.0, Weight(1.47))])


@dataclass(frozen=True)
class Experiment:
    """One row: what stood in the thesis and what is run here."""

    table: str
    row: str
    config: str
    load: Load
    program: str
    thesis_pct: tuple[float, float, float]  #: model, control, output
    changes: tuple[tuple[str, str], ...] = ()


EXPERIMENTS = (
    Experiment("5", "1 steps, constant load", "flexinol", CONSTANT, "steps", (3.40, 4.44, 5.33)),
    Experiment("5", "2 steps, spring", "flexinol", SPRING, "steps", (2.20, 2.50, 3.39)),
    Experiment("5", "3 steps, switched load", "flexinol", SWITCHED, "steps", (1.99, 1.91, 2.69)),
    Experiment("6", "1 steps, varying load", "flexinol_normalised", VARYING, "steps", (3.43, 1.79, 4.15)),
    Experiment("6", "2 sine, varying load", "flexinol_normalised", VARYING, "sine", (4.04, 1.88, 4.62)),
    Experiment(
        "8",
        "1 steps, constant load, direct switching",
        "furukawa",
        CONSTANT,
        "steps",
        (1.97, 1.46, 2.65),
        (("model.variant", "direct_switching"),),
    ),
    Experiment("8", "2 steps, constant load", "furukawa", CONSTANT, "steps", (1.11, 1.47, 2.06)),
    Experiment("8", "3 steps, spring", "furukawa", SPRING, "steps", (1.92, 1.90, 2.64)),
    Experiment("8", "4 steps, switched load", "furukawa", SWITCHED, "steps", (2.62, 2.58, 3.00)),
    Experiment("9", "1 steps, varying load", "furukawa_normalised", VARYING, "steps", (1.89, 3.25, 4.32)),
    Experiment("9", "2 triangle, constant load", "furukawa_normalised", CONSTANT, "triangle", (1.69, 2.59, 3.26)),
)
#: Tables 4 and 7 are the means of these rows.
MEANS = (
    ("4", "Flexinol exclusive", "5", (2.53, 2.95, 3.80)),
    ("4", "Flexinol normalised", "6", (3.74, 1.83, 4.39)),
    ("7", "Furukawa exclusive", "8", (1.90, 1.85, 2.59)),
    ("7", "Furukawa normalised", "9", (1.79, 2.92, 3.79)),
)


def program(name: str, lo_m: float, hi_m: float) -> Setpoint:
    """Setpoints [m] over time [s] between two positions."""
    middle_m, amplitude_m = (lo_m + hi_m) / 2.0, 0.4 * (hi_m - lo_m)
    makers: dict[str, Callable[[], Setpoint]] = {
        "steps": lambda: steps([lo_m + part * (hi_m - lo_m) for part in STEPS], DWELL_s),
        "sine": lambda: sine(middle_m, amplitude_m, PERIOD_s),
        "triangle": lambda: triangle(middle_m, amplitude_m, PERIOD_s),
    }
    return makers[name]()


def follow(config: Config, bench: VirtualBench, setpoint: Setpoint, rest_s: float) -> tuple[TrackingErrors, str]:
    """The errors of a wire that rests for so long and is then driven, and the fault that ended it, or ""."""
    errors = TrackingErrors(config.wire.full_stroke_m)
    with Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)) as driver:
        driver.run_for(rest_s)
        done, words = driver.enable(True)
        if not done:
            raise RuntimeError(words)
        start_s = bench.time_s
        while (elapsed_s := bench.time_s - start_s) < DURATION_s:
            setpoint_m = setpoint(elapsed_s)
            driver.offer_setpoint(setpoint_m)
            output = driver.run_for(1.0 / config.loop.rate)
            if output.status.fault:
                return errors, output.status.fault
            errors.add(setpoint_m, output.estimate.displacement_m, output.signals.reference_displacement_m)
    return errors, ""


def run(experiment: Experiment, seed: int = 1) -> dict[str, float]:
    """Errors of one experiment in % of full stroke."""
    config = Config.load(shared_file(f"config/{experiment.config}.yaml")).replace(dict(experiment.changes))
    bench = VirtualBench.from_name(experiment.config.split("_")[0], seed=seed, load=experiment.load)
    setpoint = program(experiment.program, *config.model.build(config.wire).displacement_range_m)
    errors, fault = follow(config, bench, setpoint, rest_s=1.0)
    if fault:
        raise RuntimeError(f"{experiment}: {fault}")
    return errors.as_dict()


def main() -> int:
    """Run every experiment and print it beside the thesis."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        results = list(pool.map(run, EXPERIMENTS))
    table = Table(title="Errors under control, mean absolute, % of full stroke: here (thesis)", title_justify="left")
    for column in ("table", "experiment", "model", "control", "output"):
        table.add_column(column, justify="left" if column == "experiment" else "right")
    rows = []
    for experiment, result in zip(EXPERIMENTS, results):
        ours = tuple(result[f"{name}_error_pct_stroke"] for name in ("model", "control", "output"))
        rows.append(
            {
                "table": experiment.table,
                "row": experiment.row,
                "pct_stroke": ours,
                "thesis_pct_stroke": experiment.thesis_pct,
            }
        )
    for table_name, words, of_table, thesis in MEANS:
        members = [row["pct_stroke"] for row in rows if row["table"] == of_table]
        ours = tuple(sum(values) / len(members) for values in zip(*members))
        rows.append({"table": table_name, "row": f"mean, {words}", "pct_stroke": ours, "thesis_pct_stroke": thesis})
    for row in rows:
        cells = [
            f"{ours:.2f} ({thesis:.2f})" + ("" if ours < thesis else " *")
            for ours, thesis in zip(row["pct_stroke"], row["thesis_pct_stroke"])
        ]
        table.add_row(row["table"], row["row"], *cells)
    console = Console()
    console.print(table)
    console.print("* not below the thesis")
    write_json(args, rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
