"""Tables 2 and 3 of the thesis, rebuilt on the virtual bench.

    python benchmarks/replay_tables.py [--physics NAME] [--json FILE]     (make tables)

The models are identified on calibration logs and judged on other logs: another seed, other loads,
another current and other set points.  As in the thesis a judged log is full and partial actuation
under one load.  The last column takes the load for a constant 0.49 N, as the thesis's does for a
constant that it does not state.  Beside them: appendix C and the joint fit on the same logs, the
exact step and the thesis's forward step at 20 Hz and at 5 Hz, and the literature's models.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from pathlib import Path

import numpy as np
from forward_step import forward_step
from rich.console import Console
from rich.table import Table

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.characterise import PlanOptions, Rig, characterise, make_plan
from sma_actuator.characterise.operators import BenchOperator
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.console import write_json
from sma_actuator.identify import identify
from sma_actuator.identify.verdict.errors import log_error
from sma_actuator.logs.bench_log import BenchLog, read_bench_log
from sma_actuator.logs.experiments import make_experiment
from sma_actuator.plant.worlds import HOME, WORLDS
from sma_actuator.replay import estimate_m, replay

ASSUMED_LOAD_N = 0.49
ROWS = ("0.49 N", "0.98 N", "1.96 N", "spring")
THESIS = {
    "flexinol": ((1.99, 1.36, 1.26, 3.52), (2.26, 6.48, 13.15, 9.15)),
    "average": ((1.01, 1.08, 0.61, 2.15), (4.33, 6.47, 10.95, 7.55)),
    "direct_switching": ((1.11, 1.16, 0.85, 2.27), None),
    "transition": ((1.28, 1.08, 0.73, 2.13), None),
}
PRELOAD_AT_m = 0.004  #: displacement where a spring has its preload, of every wire: what the figures are of
TRAINED = 40.0  #: cycles that a wire has done before it is measured: fewer than one in training wants
CALIBRATION = PlanOptions(skip=("training", "fatigue"), average_s=2.0)
JUDGED = PlanOptions(
    loads_N=(0.49, 0.98, 1.96),
    springs_N_m=((300.0, 0.5),),
    pulses=2,
    set_points=4,
    skip=("lead_resistance", "load_cell", "lvdt", "training", "fatigue"),
)


def logs_of(wire: str, options: PlanOptions, seed: int, physics: str = HOME) -> tuple[list[BenchLog], dict]:
    """Characterise the virtual bench; returns pulses and partial logs, and the calibrated parameters."""
    mapping = read_parameter_file(shared_file(f"config/{wire}_bench.yaml"))
    config = bench_from_mapping(mapping)
    bench = VirtualBench.from_name(wire, seed=seed, physics=physics, cycles=TRAINED)
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    operator = BenchOperator(bench, config.wire.max_stress * config.wire.area_m2, PRELOAD_AT_m)
    with tempfile.TemporaryDirectory(prefix="sma_tables_") as folder:
        characterise(mapping, make_plan(config, options), rig, operator, Path(folder))
        logs = [read_bench_log(path) for path in sorted(Path(folder).glob("p*.csv"))]
        return logs, read_parameter_file(Path(folder) / "bench.yaml")


def judge(logs: list[BenchLog], config: Config, estimate=estimate_m) -> list[tuple[float, float, float]]:
    """(working %, share, full %) of each load of ROWS, its logs together."""
    range_m = config.model.build(config.wire).displacement_range_m
    rows = []
    for load in ROWS:
        word = "spring" if load == "spring" else f"{float(load.split()[0]):.3f}N"
        experiments = [make_experiment(log, config) for log in logs if word in log.name]
        measured = np.concatenate([t.displacement_m for t in experiments])
        load_N = np.concatenate([t.signals.load_N for t in experiments])
        together = dataclasses.replace(experiments[0].signals, reference_displacement_m=measured, load_N=load_N)
        error = log_error(
            load,
            together,
            np.concatenate([estimate(t, config) for t in experiments]),
            range_m,
            config.wire.full_stroke_m,
        )
        rows.append((error.working_percent, error.working_share, error.full_percent))
    return rows


def wrongly_constant(experiment, config):
    """The estimate of a node that takes the load for ASSUMED_LOAD_N."""
    return estimate_m(experiment, config, ASSUMED_LOAD_N)


def forward(experiment, config):
    """The estimate by the thesis's forward step."""
    with np.errstate(over="ignore"):
        return np.array(forward_step(experiment.resistance_Ohm, experiment.stress_Pa, experiment.heating, config.model))


def slower(logs: list[BenchLog], factor: int) -> list[BenchLog]:
    """Every ``factor``-th reading."""
    return [dataclasses.replace(log, columns={k: v[::factor] for k, v in log.columns.items()}) for log in logs]


def beside_the_thesis(title: str, configs: dict[str, Config], judged, numbers: dict[str, object]) -> Table:
    """The errors of each variant under each load; ``numbers``: where they go too."""
    table = Table(title=f"{title}: mean absolute error, % of full stroke")
    headers = ("model", "load", "working range", "thesis", "samples in it", "full range", "load taken for constant")
    for header in (*headers, "thesis"):
        table.add_column(header, justify="left" if header in ("model", "load") else "right")
    for variant, config in configs.items():
        rows, constant = judge(judged, config), judge(judged, config, wrongly_constant)
        thesis, thesis_constant = THESIS[variant]
        for i, load in enumerate(ROWS):
            table.add_row(
                variant,
                load,
                f"{rows[i][0]:.2f}",
                f"{thesis[i]:.2f}",
                f"{rows[i][1]:.0%}",
                f"{rows[i][2]:.2f}",
                f"{constant[i][0]:.2f}",
                f"{thesis_constant[i]:.2f}" if thesis_constant else "",
            )
            numbers[f"{variant} {load}"] = {
                "working": rows[i][0],
                "share": rows[i][1],
                "full": rows[i][2],
                "constant": constant[i][0],
                "thesis": thesis[i],
            }
        table.add_section()
    return table


def main() -> int:
    """Print every table; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--physics", choices=WORLDS, default=HOME, metavar="NAME", help="of the bench (default %(default)s)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    console = Console(width=130)
    numbers: dict[str, object] = {}
    for wire, title in (("flexinol", "Table 2, Flexinol"), ("furukawa", "Table 3, Furukawa")):
        calibration, mapping = logs_of(wire, CALIBRATION, seed=1, physics=args.physics)
        judged, _ = logs_of(wire, JUDGED, seed=2, physics=args.physics)
        variants = ("flexinol",) if wire == "flexinol" else ("average", "direct_switching", "transition")
        configs = {}
        for variant in variants:
            configs[variant] = identify(
                calibration, mapping, wire, variant=variant if wire == "furukawa" else "average"
            ).config
        console.print(beside_the_thesis(f"{title}, {args.physics}", configs, judged, numbers))
        if wire == "flexinol":
            fits_and_steps(console, numbers, calibration, judged, mapping, configs["flexinol"])
        literature(console, numbers, wire, calibration, judged, configs)
    write_json(args, numbers)
    return 0


def fits_and_steps(console: Console, numbers: dict, calibration, judged, mapping, joint: Config) -> None:
    """Appendix C beside the joint fit, exact beside forward step."""
    appendix = identify(calibration, mapping, "flexinol", method="appendix-c").config
    table = Table(title="Flexinol: fit and step, working range (full range), % of full stroke")
    for header in ("fit", "step", "rate", *ROWS):
        table.add_column(header, justify="right")
    for fit_name, config in (("joint", joint), ("appendix C", appendix)):
        for step_name, estimate in (("exact", estimate_m), ("forward", forward)):
            for factor, rate in ((1, "20 Hz"), (4, "5 Hz")):
                rows = judge(slower(judged, factor), config, estimate)
                table.add_row(fit_name, step_name, rate, *(f"{w:.2f} ({f:.2f})" for w, _, f in rows))
                numbers[f"{fit_name} {step_name} {rate}"] = [{"working": w, "full": f} for w, _, f in rows]
        table.add_section()
    console.print(table)


def literature(console: Console, numbers: dict, wire: str, calibration, judged, configs: dict[str, Config]) -> None:
    """Everything in one table, the winner of each row in bold."""
    replays = replay(judged, configs, calibration)
    names = list(replays[0].errors)
    table = Table(title=f"{wire}: who wins where, working range, % of full stroke")
    table.add_column("model")
    for r in replays:
        table.add_column(r.experiment.name.removesuffix(".csv").replace("_", " "), justify="right")
    best = [min(names, key=lambda n, r=r: r.errors[n].working_percent) for r in replays]
    for name in names:
        cells = [f"{r.errors[name].working_percent:.2f}" for r in replays]
        table.add_row(name, *(f"[bold]{c}[/]" if name == b else c for c, b in zip(cells, best)))
        numbers[f"{wire} literature {name}"] = {r.experiment.name: r.errors[name].working_percent for r in replays}
    console.print(table)


if __name__ == "__main__":
    raise SystemExit(main())
