"""The thesis's eleven experiments in every physics of the virtual bench, with models identified from each wire's own logs.

    python benchmarks/control_experiments.py [--physics NAME …] [--model whole_range thesis] [--over own thesis] [--law pid]
                                             [--jobs 2] [--json FILE]                            (make control-experiments)

Wires and models are those of ``control_worlds.py`` and are kept with them; loads, programs and errors are those of
``control_tables.py``: 20 s a step, 60 s a sine or triangle, all transients counted.  Setpoints lie within the reach of the
wire under every load of the experiment, and within the range of the model (``--over own``), or of the thesis's model of
the same wire (``--over thesis``), whichever model drives: so the two drive the same way.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from control_tables import EXPERIMENTS, MEANS, Experiment, follow, program
from control_worlds import LAWS, MODELS, RUN_BY, cycles_done, digest, identified, prepare, stroke_of
from kept import MODEL, kept
from rich.console import Console
from rich.table import Table

from sma_actuator.bench import Schedule, VirtualBench
from sma_actuator.config import Config
from sma_actuator.plant.worlds import WORLDS

#: Nothing is known of the wire at first: until then it counts as hot.
REST_s = 8.0
#: Of the reach of the wire, at either end.
MARGIN = 0.05
#: Share of the thesis's output error that is aimed at.
AIM = 0.5


@dataclass(frozen=True)
class Case:
    """One experiment on one wire."""

    experiment: Experiment
    physics: str
    model: str
    over: str
    law: str

    @property
    def wire(self) -> str:
        """The alloy's wire of the bench."""
        return self.experiment.config.split("_")[0]


@dataclass(frozen=True)
class Found:
    """What came of it; errors in % of full stroke."""

    control: float
    output: float
    judged: float  #: share of the samples
    driven: float  #: share of the reach that is common to all loads
    fault: str


def config_of(case: Case, model: str) -> Config:
    """The parameters of that wire with one of its models."""
    mapping = identified(case.wire, case.physics, model)
    return Config.from_mapping({**mapping, "controller": {**mapping["controller"], "type": case.law}})


def once(case: Case) -> Found:
    """An experiment, or what it came to the last time: the table may be made a physics at a time."""
    return kept(
        f"control_experiments {case} {digest((*RUN_BY, 'control_tables', 'control_experiments'))}",
        MODEL,
        lambda: run(case),
    )


def run(case: Case) -> Found:
    """One experiment."""
    config = config_of(case, case.model)
    load = case.experiment.load
    loads = [each for _, each in load.steps] if isinstance(load, Schedule) else [load]
    cycles = cycles_done(case.wire, case.physics)
    how = {"physics": case.physics, "cycles": cycles}
    reaches_m = [stroke_of(VirtualBench.from_name(case.wire, seed=1, load=each, **how), config) for each in loads]
    hot_m, cold_m = max(hot_m for hot_m, _ in reaches_m), min(cold_m for _, cold_m in reaches_m)
    ranges_m = [config.model.build(config.wire).displacement_range_m]
    if case.over == "thesis":
        its = config_of(case, "thesis")
        ranges_m.append(its.model.build(its.wire).displacement_range_m)
    margin_m = MARGIN * (cold_m - hot_m)
    low_m = max(hot_m + margin_m, *(low_m for low_m, _ in ranges_m))
    high_m = min(cold_m - margin_m, *(high_m for _, high_m in ranges_m))
    bench = VirtualBench.from_name(case.wire, seed=7, load=load, **how)
    errors, fault = follow(config, bench, program(case.experiment.program, low_m, high_m), REST_s)
    found = errors.as_dict()
    return Found(
        control=found["control_error_pct_stroke"],
        output=found["output_error_pct_stroke"],
        judged=found["judged_share"],
        driven=(high_m - low_m) / (cold_m - hot_m),
        fault=fault,
    )


def table_of(results: list[tuple[Case, Found]], model: str, over: str) -> Table:
    """Output errors: a row for each experiment, a column for each physics."""
    title = f"Output error, mean absolute, % of full stroke: model {model}, over the range of {over}"
    its = [(case, found) for case, found in results if (case.model, case.over) == (model, over)]
    physics = list(dict.fromkeys(case.physics for case, _ in its))
    table = Table(title=title, title_justify="left")
    for name in ("table", "experiment", "thesis", *physics):
        table.add_column(name, justify="left" if name == "experiment" else "right")

    def add(of_table: str, words: str, thesis_pct: float, values: list[float], faults: list[str]) -> None:
        cells = [
            f"{value:.2f}"
            + (" !" if fault else " **" if value >= thesis_pct else " *" if value >= AIM * thesis_pct else "")
            for value, fault in zip(values, faults, strict=True)
        ]
        table.add_row(of_table, words, f"{thesis_pct:.2f}", *cells)

    by_table: dict[str, list[list[float]]] = {}
    for experiment in EXPERIMENTS:
        row = [found for case, found in its if case.experiment == experiment]
        output = [found.output for found in row]
        by_table.setdefault(experiment.table, []).append(output)
        add(experiment.table, experiment.row, experiment.thesis_pct[2], output, [found.fault for found in row])
    for number, words, of_table, thesis_pct in MEANS:
        means = np.mean(by_table[of_table], axis=0).tolist()
        add(number, f"mean, {words}", thesis_pct[2], means, [""] * len(means))
    driven = [np.mean([found.driven for case, found in its if case.physics == name]) for name in physics]
    table.add_row("", "driven, of the reach", "", *(f"{share:.0%}" for share in driven))
    return table


def main() -> int:
    """Print a table for each model and range; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--physics", nargs="*", choices=tuple(WORLDS), default=tuple(WORLDS))
    parser.add_argument("--model", nargs="*", choices=MODELS, default=("whole_range",))
    parser.add_argument("--over", nargs="*", choices=("own", "thesis"), default=("own", "thesis"))
    parser.add_argument("--law", choices=LAWS, default="pid")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    cases = [
        Case(experiment, physics, model, over, args.law)
        for physics in args.physics
        for model in args.model
        for over in args.over
        for experiment in EXPERIMENTS
    ]
    wires = sorted({case.wire for case in cases})
    with ProcessPoolExecutor(args.jobs) as pool:
        list(pool.map(prepare, [(physics, wire, " ".join(MODELS)) for physics in args.physics for wire in wires]))
        results = list(zip(cases, pool.map(once, cases), strict=True))
    console = Console(width=170)
    for model in args.model:
        for over in args.over:
            console.print(table_of(results, model, over))
    console.print("* not below half of the thesis's, ** not below it, ! ended by a fault: the mean up to it")
    for case, found in results:
        if found.fault:
            console.print(f"{case.physics}, {case.experiment.row}, {case.model} over {case.over}: {found.fault}")
    if args.json:
        rows = [{**asdict(found), "case": asdict(case)} for case, found in results]
        args.json.write_text(json.dumps(rows, indent=1, default=str) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
