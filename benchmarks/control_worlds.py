"""The judge of the control loop: every wire goes the user's way, in every physics, and is driven by both laws.

    python benchmarks/control_worlds.py [--physics NAME …] [--drawn 24] [--every N] [--wire flexinol furukawa]
                                        [--model whole_range thesis] [--law pid feed_forward_pid] [--json FILE]
                                        [--diameter UM] [--warmer K] [--loses TIMES] [--sensor K]
                                        [--experiment NAME …]                             (make control-worlds)

``init``, ``characterise``, ``identify``, ``init``, and a second round with that model (``users_way.py``; ``--model
first_round``: without it), then the driver of the node (``driven.py``): the thesis's eleven experiments, a light and a
heavy weight and a stiff spring, over 85 % of the stroke that the wire truly has under each load.  Without
``--physics``: the eight that were designed and as many as ``--drawn`` says that nobody chose, by the numbers from
``--from`` on; ``--every 4`` takes every fourth of them.  ``--diameter``: wires of that many µm, with instruments and
loads that suit them; ``--warmer``: driven in a room so many kelvin warmer than the one of the calibration, ``--loses``:
in a draught, or sheltered; ``--sensor``: with a sensor of the room that reads so much too much, or none.  Everything
is kept in ``out`` and used again while nothing has changed that it depends on; what is stopped goes on where it was.

Errors are mean absolute, % of full stroke.  First table, the output error of each run, held against the thesis's for
that experiment, those that it has not against the mean of its tables for the alloy; of steps also beyond what is left
when ``supply.max_current``, or the bias, flows until the wire is truly there.  Second table, the eight runs together:

* there: positions of the steps that were reached and held (the last 5 s of 20 within 2 %; one still cooling at the bias
  current is left out); of the others the time within 5 %
* false: seconds in which the status said that the wire cannot go where it is told; in truth it can
* unrest: the command from sample to sample, rms, % of max_current: positions held, and sine or triangle
* hottest: the wire's hottest place, in truth
* covered: truths within the 95 % interval;  model: estimate and truth in the loop, and in replay of logs of the
  characterised wire that were not fitted; held: the true error, and the model's, where positions are held
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from control_tables import EXPERIMENTS as THESIS
from control_tables import MEANS
from driven import LAWS, RUN_BY, SHARED, Case, Found, fastest_once, once
from grains import ALLOYS
from kept import MODEL, kept
from rich.console import Console
from rich.table import Table
from users_way import MODELS, WIRES, alloy_of, digest, prepared, replayed, wire_named

from sma_actuator.console import write_json
from sma_actuator.plant.worlds import DRAWN, WORLDS, world_of

#: Share of the thesis's output error that is aimed at.
AIM = 0.5


@dataclass(frozen=True)
class Experiment:
    """One row of the judgement."""

    name: str
    load: str
    program: str
    thesis: float  #: output error, % of full stroke


#: Ours, beside those of the thesis: name, load and program.
OURS = (
    ("steps, light", "light", "steps"),
    ("sine, heavy", "heavy", "sine"),
    ("triangle, stiff", "stiff_spring", "triangle"),
)


def _experiments(wire: str) -> tuple[Experiment, ...]:
    """Those of the thesis, as ``control_tables.py`` has them (row 1 of table 8 with its own variant left out), then
    ours."""
    theirs = [
        Experiment(f"{e.table}.{e.row}", next(n for n in SHARED if SHARED[n] is e.load), e.program, e.thesis_pct[2])
        for e in THESIS
        if e.config.startswith(wire) and not e.changes
    ]
    mean = float(np.mean([pct[2] for _, row, _, pct in MEANS if row.lower().startswith(wire)]))
    return (*theirs, *(Experiment(*each, mean) for each in OURS))


#: A driver that does not measure what the room is.
NO_SENSOR = (("instruments.daq.ambient_temperature_channel", 0),)

EXPERIMENTS = {wire: _experiments(wire) for wire in WIRES}


@dataclass(frozen=True)
class Wire:
    """A wire in a physics with a model, driven by a law: a row of the tables."""

    physics: str
    wire: str
    model: str
    law: str
    warmer_K: float = 0.0  #: the room than at its calibration
    loses: float = 1.0  #: heat, over what it lost there
    sensor_K: float = 0.0  #: what its sensor of the room reads too much; NaN: it has none

    def case(self, experiment: Experiment) -> Case:
        """One of its runs."""
        load, program = experiment.load, experiment.program
        around: dict[str, Any] = {"warmer_K": self.warmer_K, "heat_loss": self.loses, "sensor_K": self.sensor_K}
        if isnan(self.sensor_K):
            around |= {"sensor_K": 0.0, "changes": NO_SENSOR}
        return Case(self.wire, self.physics, self.model, load, program, self.law, **around)


@dataclass
class Judged:
    """What came of a wire."""

    wire: Wire
    runs: list[tuple[Experiment, Found, float]]  #: with the output error that no law can better, 0 but for steps
    replay: float
    replay_covered: float

    def mean(self, value: Callable[[Found], float], of: Sequence[Found] | None = None) -> float:
        """Over its runs, those without a number left out."""
        values = [value(found) for found in (of or [found for _, found, _ in self.runs])]
        return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan


def judged(wire: Wire, only: Sequence[str] = ()) -> Judged:
    """Every run of a wire, or ``only`` these, from disk where it was made before."""
    runs = []
    for experiment in EXPERIMENTS[alloy_of(wire.wire)]:
        if only and experiment.name not in only:
            continue
        found = once(wire.case(experiment))
        best = fastest_once(found.case) if experiment.program == "steps" else 0.0
        runs.append((experiment, found, best))
    return Judged(wire, runs, *_replayed(wire))


def _replayed(wire: Wire) -> tuple[float, float]:
    return kept(
        f"replayed {wire.wire} {wire.physics} {wire.model} {digest(RUN_BY)}",
        MODEL,
        lambda: replayed(wire.wire, wire.physics, wire.model),
    )


def errors_of(rows: Sequence[Judged], alloy: str) -> Table:
    """Output errors of one alloy, of the experiments that were run."""
    table = Table(title=f"{alloy}: output error, % of full stroke; steps: (beyond full current or none)")
    table.title_justify = "left"
    for name in ("physics", "model", "law"):
        table.add_column(name)
    for experiment, _, _ in rows[0].runs:
        table.add_column(f"{experiment.name}\n{experiment.thesis:.2f}", justify="right")
    for row in rows:
        cells = []
        for experiment, found, best in row.runs:
            beyond = f" ({found.output - best:.1f})" if experiment.program == "steps" else ""
            cells.append(f"{found.output:.1f}{beyond}{_mark(experiment, found, best)}")
        table.add_row(row.wire.physics, row.wire.model, row.wire.law, *cells)
    return table


def _mark(experiment: Experiment, found: Found, best: float) -> str:
    if found.fault:
        return " !"
    if found.output >= experiment.thesis:
        return " **"
    return " *" if found.output - best >= AIM * experiment.thesis else ""


def rest_of(rows: Sequence[Judged]) -> Table:
    """What else came of each wire."""
    table = Table(title="All runs of a wire together; % of full stroke", title_justify="left")
    for name in ("physics", "wire", "model", "law"):
        table.add_column(name)
    for name in (
        "there %",
        "false s",
        "unrest held",
        "moving",
        "hottest °C",
        "covered %",
        "model, loop",
        "replay",
        "held",
        "model, held",
    ):
        table.add_column(name, justify="right")
    for row in rows:
        found = [each for _, each, _ in row.runs]
        steps = [each for each in found if each.case.program == "steps"]
        moving = [each for each in found if each.case.program != "steps"]
        table.add_row(
            row.wire.physics,
            row.wire.wire,
            row.wire.model,
            row.wire.law,
            f"{100.0 * row.mean(lambda f: f.there):.0f}",
            f"{sum(f.false_s for f in found):.0f}",
            f"{row.mean(lambda f: f.unrest, steps):.1f}",
            f"{row.mean(lambda f: f.unrest, moving):.1f}",
            f"{max(f.hottest_C for f in found):.0f}",
            f"{100.0 * row.mean(lambda f: f.covered):.0f}",
            f"{row.mean(lambda f: f.model):.2f}",
            f"{row.replay:.2f}",
            f"{row.mean(lambda f: f.held, steps):.2f}",
            f"{row.mean(lambda f: f.held_model, steps):.2f}",
        )
    return table


def summary(rows: Sequence[Judged]) -> list[str]:
    """A sentence for each of the aims."""
    runs = [run for row in rows for run in row.runs]
    found = [each for _, each, _ in runs]
    steps = [each for each in found if each.case.program == "steps"]
    moving = [each for each in found if each.case.program != "steps"]

    def share(condition: Callable[[Any], bool], of: Sequence[Any]) -> str:
        return f"{sum(condition(each) for each in of)} of {len(of)}"

    ratios = [row.mean(lambda f: f.model) / row.replay for row in rows]
    return [
        (
            f"output error below the thesis's: {share(lambda r: r[1].output < r[0].thesis, runs)}; below half of it "
            f"(steps: beyond full current or none): {share(lambda r: r[1].output - r[2] < AIM * r[0].thesis, runs)}"
        ),
        (
            f"positions reached and held: {_over(np.nanmean, 'there', steps):.1%}, the worst run "
            f"{_over(np.nanmin, 'there', steps):.0%}; followed for {_over(np.nanmean, 'there', moving):.1%} of "
            f"the time, the worst run {_over(np.nanmin, 'there', moving):.0%}"
        ),
        (
            f"runs with a false limit: {share(lambda f: f.false_s > 0.0, found)}; ended by a fault: "
            f"{share(lambda f: bool(f.fault), found)}"
        ),
        (
            f"unrest at most 2 % of max_current: held {share(lambda f: f.unrest <= 2.0, steps)}, moving "
            f"{share(lambda f: f.unrest <= 2.0, moving)}; median {_over(np.nanmedian, 'unrest', steps):.2f} and "
            f"{_over(np.nanmedian, 'unrest', moving):.2f}, worst {_over(np.nanmax, 'unrest', steps):.1f} and "
            f"{_over(np.nanmax, 'unrest', moving):.1f}"
        ),
        (
            f"hottest place of a wire {max(f.hottest_C for f in found):.0f} °C; covered by the 95 % intervals "
            f"{np.nanmean([f.covered for f in found]):.1%}, the worst run {np.nanmin([f.covered for f in found]):.0%}"
        ),
        (
            f"model in the loop {np.mean([f.model for f in found]):.2f} %, {np.median(ratios):.2f} times replay's in "
            f"the median, at most {max(ratios):.1f} times; held positions off by "
            f"{_over(np.nanmean, 'held', steps):.2f} %, {share(lambda f: f.held <= 0.7, steps)} within 0.7 %"
        ),
    ]


def _over(function: Callable[[Any], Any], name: str, of: Sequence[Found]) -> float:
    """Of some runs; NaN where there are none."""
    return float(function([getattr(found, name) for found in of])) if of else np.nan


def _physics(name: str) -> str:
    if name not in ALLOYS:
        world_of(name)
    return name


def asked(args: argparse.Namespace) -> list[Wire]:
    """The wires that were asked for."""
    drawn = [f"{DRAWN}{number}" for number in range(args.first, args.first + args.drawn)]
    physics = args.physics or [*WORLDS, *drawn][:: args.every]
    return [
        Wire(name, wire_named(alloy, args.diameter), model, law, args.warmer, args.loses, args.sensor)
        for name in physics
        for alloy in args.wire
        for model in args.model
        for law in args.law
    ]


def main() -> int:
    """Print the tables; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--physics", nargs="*", type=_physics, metavar="NAME", help="these, designed, drawn-N or grains-N"
    )
    parser.add_argument(
        "--drawn", type=int, default=24, metavar="N", help="so many drawn physics (default %(default)s)"
    )
    parser.add_argument(
        "--from", type=int, default=100, dest="first", metavar="N", help="the first of them (default %(default)s)"
    )
    parser.add_argument("--every", type=int, default=1, metavar="N", help="a sample: every Nth physics")
    parser.add_argument("--wire", nargs="*", choices=WIRES, default=WIRES)
    parser.add_argument("--model", nargs="*", choices=MODELS, default=("whole_range",))
    parser.add_argument("--law", nargs="*", choices=LAWS, default=("pid", "feed_forward_pid"))
    parser.add_argument("--diameter", type=float, default=0.0, metavar="UM", help="µm; without it the wire's own")
    parser.add_argument(
        "--warmer", type=float, default=0.0, metavar="K", help="drive in a room so much warmer than the calibration's"
    )
    parser.add_argument(
        "--loses", type=float, default=1.0, metavar="TIMES", help="drive in air that takes so many times the heat"
    )
    parser.add_argument(
        "--sensor",
        type=float,
        default=0.0,
        metavar="K",
        help="what that of the room reads too much; nan: no such one",
    )
    named = sorted({experiment.name for each in EXPERIMENTS.values() for experiment in each})
    parser.add_argument("--experiment", nargs="*", choices=named, default=(), metavar="NAME", help="these alone")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    wires = asked(args)
    jobs = list(dict.fromkeys((each.wire, each.physics, tuple(args.model)) for each in wires))
    rows = prepared(jobs, partial(judged, only=args.experiment), wires, args.jobs)
    console = Console(width=170)
    for alloy in args.wire:
        console.print(errors_of([row for row in rows if alloy_of(row.wire.wire) == alloy], alloy))
    console.print("* not below half of the thesis's (steps: what is beyond), ** not below it, ! ended by a fault")
    console.print(rest_of(rows))
    for line in summary(rows):
        console.print(line)
    for row in rows:
        for experiment, found, _ in row.runs:
            if found.fault:
                console.print(f"{row.wire.physics}, {row.wire.wire}, {row.wire.law}, {experiment.name}: {found.fault}")
    data = [
        {**asdict(row.wire), "experiment": experiment.name, **asdict(replace(found, series={})), "best": best}
        for row in rows
        for experiment, found, best in row.runs
    ]
    write_json(args, data)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
