"""Gains tuned on every physics of the virtual bench, from gains ten times off, beside the shipped gains.

    python benchmarks/tuning.py [--physics NAME …] [--wire flexinol furukawa] [--load weight spring] [--json FILE]     (make tuning)

Models are identified from each wire's own logs, as `control_worlds.py` does it, and its steps and sine are what the
gains are judged by: control error, mean absolute, over that with the shipped gains (kp 800, ki 400, kd 100).  Each wire is
tuned twice as `sma-actuator tune` does it, from the shipped gains ten times too high and ten times too low; errors and
unrest are the worse of the two.

* time: of the bench, from the first reading to the gains, with the wait for the wire to count as cool, the longer of the two
* current: the most that flowed, as share of the bound, the larger of the two
* unrest: the command, RMS about its own line over the second half of each step, shipped and tuned [mA]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from control_worlds import LOADS, Case, identified, prepared
from control_worlds import run as run_case
from rich.console import Console
from rich.table import Table
from whole_range import WIRES

from sma_actuator.base.errors import UserError
from sma_actuator.base.signals import Output, Tuned
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.cli.tune import bounded, tune
from sma_actuator.config import Config
from sma_actuator.control.tuning import GAINS
from sma_actuator.driver import Driver
from sma_actuator.plant.worlds import WORLDS

OFF = (10.0, 0.1)
MODEL = "thesis"
LONGEST_s = 600.0


@dataclass
class Found:
    """What came of one wire."""

    physics: str
    wire: str
    load: str
    gains: list[dict[str, float]]  #: from too high, from too low
    time_s: float
    current: float  #: the most, over the bound
    steps: float  #: control error over that of the shipped gains
    sine: float
    unrest_mA: tuple[float, float]
    trouble: str = ""


def tuned(wire: str, physics: str, load: str, times: float) -> tuple[Tuned, float, float]:
    """The gains from shipped ones that are so many times too high, the time it took [s] and the most current over the bound."""
    shipped = Config.from_mapping(identified(wire, physics, MODEL))
    config = shipped.replace({f"controller.{name}": times * getattr(shipped.controller, name) for name in GAINS})
    bound_A = config.controller.tuning_current * config.supply.max_current
    config = bounded(config)
    bench = VirtualBench.from_name(wire, seed=5, load=LOADS[load], physics=physics)
    currents_A = [0.0]
    driver = Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))

    def outputs():
        while bench.time_s < LONGEST_s:
            output: Output | None = driver.run_for(1.0 / config.loop.rate)
            if output is not None:
                currents_A.append(output.command.current_A)
                yield output

    with driver:
        found = tune(driver, outputs(), lambda words: None)
        if found is None:
            raise UserError(f"no gains within {LONGEST_s:g} s")
        return found, bench.time_s, max(currents_A) / bound_A


def run(job: tuple[str, str, str]) -> Found:
    """One wire in one physics under one load."""
    physics, wire, load = job
    try:
        both = [tuned(wire, physics, load, times) for times in OFF]
    except UserError as error:
        return Found(physics, wire, load, [], 0.0, 0.0, float("inf"), float("inf"), (0.0, 0.0), str(error))
    shipped = [run_case(Case(wire, physics, MODEL, load, program, "pid")) for program in ("steps", "sine")]
    ours = []
    for found, *_ in both:
        changes = tuple((f"controller.{name}", value) for name, value in found.gains.items())
        ours.append([run_case(replace(case.case, changes=changes)) for case in shipped])
    faults = ", ".join(sorted({case.fault for pair in ours for case in pair if case.fault}))
    return Found(
        physics,
        wire,
        load,
        [found.gains for found, *_ in both],
        time_s=max(time_s for _, time_s, _ in both),
        current=max(current for *_, current in both),
        steps=max(pair[0].control for pair in ours) / shipped[0].control,
        sine=max(pair[1].control for pair in ours) / shipped[1].control,
        unrest_mA=(shipped[0].unrest_mA, max(pair[0].unrest_mA for pair in ours)),
        trouble=faults,
    )


def table_of(found: list[Found]) -> Table:
    """A row for each wire."""
    table = Table(title="Tuned from ten times off; control error over that of the shipped gains", title_justify="left")
    for header in (
        "physics",
        "wire",
        "load",
        "kp A/m",
        "ki A/(m·s)",
        "time s",
        "current",
        "steps",
        "sine",
        "unrest mA",
    ):
        table.add_column(header, justify="left" if header in ("physics", "wire", "load") else "right")
    for f in found:
        table.add_row(
            f.physics,
            f.wire,
            f.load,
            " ".join(f"{gains['kp']:.4g}" for gains in f.gains),
            " ".join(f"{gains['ki']:.4g}" for gains in f.gains),
            f"{f.time_s:.0f}",
            f"{f.current:.2f}",
            f"{f.steps:.2f}",
            f"{f.sine:.2f}",
            f"{f.unrest_mA[0]:.1f} {f.unrest_mA[1]:.1f}" + (f" ({f.trouble})" if f.trouble else ""),
        )
    return table


def main() -> int:
    """Print the table and the worst of it; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--physics", nargs="*", choices=tuple(WORLDS), default=tuple(WORLDS))
    parser.add_argument("--wire", nargs="*", choices=WIRES, default=WIRES)
    parser.add_argument("--load", nargs="*", choices=tuple(LOADS), default=tuple(LOADS))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    pairs = [(physics, wire, MODEL) for physics in args.physics for wire in args.wire]
    jobs = [(physics, wire, load) for physics, wire, _ in pairs for load in args.load]
    found = prepared(pairs, run, jobs, args.jobs)
    Console().print(table_of(found))
    worst = max(found, key=lambda f: max(f.steps, f.sine))
    print(
        f"worst: {max(worst.steps, worst.sine):.2f} ({worst.physics}, {worst.wire}, {worst.load}); at most "
        f"{max(f.time_s for f in found):.0f} s and {max(f.current for f in found):.0%} of the bound; "
        f"{sum(bool(f.trouble) for f in found)} of {len(found)} given up or with a fault"
    )
    if args.json:
        args.json.write_text(json.dumps([asdict(f) for f in found], indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
