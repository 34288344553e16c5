"""Gains tuned on every physics of the virtual bench, from gains ten times off, beside the shipped gains.

    python benchmarks/tuning.py [--physics NAME …] [--wire flexinol furukawa] [--model whole_range thesis]
                                [--load weight spring] [--json FILE]                                      (make tuning)

Wires come the user's way (`users_way.py`), and steps and a sine (`driven.py`) are what the gains are judged by: control
error, mean absolute, over that with the gains that `init` derives.  Each wire is tuned twice as `sma-actuator tune`
does it, from those gains ten times too high and ten times too low; errors and unrest are the worse of the two.  Once
more with `thermal.derate_temperature` where the wire is sure to come to be hotter.

* time: of the bench, from the first reading to the gains, with the wait for the wire to count as cool, the longer of
  the two
* current: the most that was commanded, as share of the bound, the larger of the two
* unrest: the command at held positions from sample to sample, rms, derived and tuned [% of max_current]
* hot: after so long it was given up since the wire was too hot, with the output off and read back as off [s]
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from driven import LOADS, RUN_BY, Case, bench_for, config_of, once
from kept import MODEL, kept
from rich.console import Console
from rich.table import Table
from users_way import MODELS, WIRES, digest, prepared

from sma_actuator.base.errors import UserError
from sma_actuator.base.signals import Mode, Output, Tuned
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.cli.tune import bounded, tune
from sma_actuator.console import write_json
from sma_actuator.control.tuning import GAINS
from sma_actuator.driver import Driver
from sma_actuator.plant.worlds import WORLDS

OFF = (10.0, 0.1)
LONGEST_s = 600.0
SEED = 5
#: Of the hottest that a tuning makes the wire, above its surroundings: one that may not be so hot is given up.
TOO_HOT = 0.8
#: What decides the outcome, beside what the judging runs depend on.
TUNED_BY = (*RUN_BY, "cli", "tuning")


@dataclass
class Found:
    """What came of one wire."""

    case: Case
    gains: list[dict[str, float]]  #: from too high, from too low
    time_s: float
    current: float  #: the most, over the bound
    steps: float  #: control error over that of the shipped gains
    sine: float
    unrest: tuple[float, float]
    hot_s: float
    trouble: str = ""


@dataclass
class Way:
    """One tuning, from off to off."""

    found: Tuned | None
    words: str  #: why there are no gains
    time_s: float
    current_A: float  #: the most
    hottest_C: float  #: by the heat balance
    off: bool  #: and read back from the supply


def way(case: Case, changes: dict[str, Any]) -> Way:
    """Tune the wire of a case with other parameters than its file has."""
    config = bounded(config_of(case).replace(changes))
    bench = bench_for(case, config, seed=SEED)
    outputs: list[Output] = []
    supply = InProcessSupply(bench, config)
    driver = Driver(config, supply, InProcessDaq(bench, config), VirtualClock(bench))

    def steps():
        while bench.time_s < LONGEST_s:
            output = driver.run_for(1.0 / config.loop.rate)
            if output is not None:
                outputs.append(output)
                yield output

    found, words = None, f"no gains within {LONGEST_s:g} s"
    with driver:
        try:
            found = tune(driver, steps(), lambda words: None)
        except UserError as error:
            words = str(error)
        time_s = bench.time_s
        driver.run_for(1.0)
        off = driver.output_is_off
    return Way(
        found,
        "" if found else words,
        time_s,
        max(o.command.current_A for o in outputs),
        max((o.status.values["temperature_C"] for o in outputs if o.status.mode is Mode.TUNING), default=float("nan")),
        off,
    )


def run(case: Case) -> Found:
    """One wire in one physics under one load."""
    shipped = config_of(case)
    before = {f"controller.{name}": getattr(shipped.controller, name) for name in GAINS}
    ways = [way(case, {name: times * value for name, value in before.items()}) for times in OFF]
    bound_A = shipped.controller.tuning_current * shipped.supply.max_current
    found = Found(
        case,
        [w.found.gains for w in ways if w.found is not None],
        time_s=max(w.time_s for w in ways),
        current=max(w.current_A for w in ways) / bound_A,
        steps=float("inf"),
        sine=float("inf"),
        unrest=(0.0, 0.0),
        hot_s=hot_s(case, max(w.hottest_C for w in ways)),
        trouble="; ".join(sorted({w.words for w in ways if w.words} | {"not off" for w in ways if not w.off})),
    )
    if len(found.gains) < len(OFF):
        return found
    by_shipped = [once(replace(case, program=program)) for program in ("steps", "sine")]
    ours = []
    for gains in found.gains:
        changes = tuple((f"controller.{name}", value) for name, value in gains.items())
        ours.append([once(replace(each.case, changes=changes)) for each in by_shipped])
    found.steps = max(pair[0].control for pair in ours) / by_shipped[0].control
    found.sine = max(pair[1].control for pair in ours) / by_shipped[1].control
    found.unrest = (by_shipped[0].unrest, max(pair[0].unrest for pair in ours))
    faults = {each.fault for pair in ours for each in pair if each.fault}
    found.trouble = "; ".join([*sorted(faults), *filter(None, [found.trouble])])
    return found


def hot_s(case: Case, hottest_C: float) -> float:
    """When a tuning is given up that may not make the wire as hot as it would; NaN where it is not, or not cleanly."""
    ambient_C = config_of(case).thermal.ambient_temperature
    least_C = ambient_C + TOO_HOT * (hottest_C - ambient_C)
    too_hot = way(case, {"thermal.derate_temperature": least_C})
    cleanly = too_hot.found is None and "thermal.derate_temperature" in too_hot.words and too_hot.off
    return too_hot.time_s if cleanly else float("nan")


def run_once(case: Case) -> Found:
    """What came of it the last time, if nothing has changed that it depends on."""
    return kept(f"tuning {case} {digest(TUNED_BY)}", MODEL, lambda: run(case))


def table_of(found: list[Found]) -> Table:
    """A row for each wire."""
    table = Table(title="Tuned from ten times off; control error over that of the shipped gains", title_justify="left")
    for header in ("physics", "wire", "model", "load"):
        table.add_column(header)
    for header in ("kp A/m", "ki A/(m·s)", "time s", "current", "steps", "sine", "unrest %", "hot s"):
        table.add_column(header, justify="right")
    for f in found:
        table.add_row(
            f.case.physics,
            f.case.wire,
            f.case.model,
            f.case.load,
            " ".join(f"{gains['kp']:.4g}" for gains in f.gains),
            " ".join(f"{gains['ki']:.4g}" for gains in f.gains),
            f"{f.time_s:.0f}",
            f"{f.current:.2f}",
            f"{f.steps:.2f}",
            f"{f.sine:.2f}",
            f"{f.unrest[0]:.1f} {f.unrest[1]:.1f}",
            f"{f.hot_s:.0f}",
        )
    return table


def main() -> int:
    """Print the table and the worst of it; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--physics", nargs="*", choices=tuple(WORLDS), default=tuple(WORLDS))
    parser.add_argument("--wire", nargs="*", choices=WIRES, default=WIRES)
    parser.add_argument("--model", nargs="*", choices=MODELS, default=("whole_range",))
    parser.add_argument("--load", nargs="*", choices=LOADS, default=("weight", "spring"))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    pairs = [(wire, physics, args.model) for physics in args.physics for wire in args.wire]
    cases = [
        Case(wire, physics, model, load, "steps", "pid")
        for wire, physics, _ in pairs
        for model in args.model
        for load in args.load
    ]
    found = prepared(pairs, run_once, cases, args.jobs)
    Console(width=150).print(table_of(found))
    for f in found:
        if f.trouble:
            print(f"{f.case.physics}, {f.case.wire}, {f.case.model}, {f.case.load}: {f.trouble}")
    worst = max(found, key=lambda f: max(f.steps, f.sine))
    print(
        f"worst: {max(worst.steps, worst.sine):.2f} ({worst.case.physics}, {worst.case.wire}, {worst.case.load}); at "
        f"most {max(f.time_s for f in found):.0f} s and {max(f.current for f in found):.0%} of the bound; "
        f"{sum(bool(f.trouble) for f in found)} of {len(found)} given up or with a fault; "
        f"{sum(f.hot_s == f.hot_s for f in found)} of {len(found)} given up, and off, when too hot"
    )
    write_json(args, [asdict(f) for f in found])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
