"""The control loop on every physics of the virtual bench, with models identified from each wire's own logs.

    python benchmarks/control_worlds.py [--physics NAME …] [--wire flexinol furukawa] [--law pid …]
                                        [--gains ki=1600 …] [--json FILE]
                                                                                          (make control-worlds)

Each wire is characterised in its physics and identified from those logs, as `sma-actuator identify` does it: the
thesis's model of the alloy, and the one of the whole range.  Logs and parameter files are kept in
``out/control_worlds`` and used again while nothing has changed that they depend on; so is each run.  Then the same
driver, actuator and supervisor as in the node follow steps (20 s each) and a sine (60 s) under a weight and under a spring.

* control and output error as in the thesis: mean absolute, % of full stroke, every sample from the first setpoint on;
* range: the part of the stroke under that load that was driven;
* latched: share of the time at all the current there is with a wire that is shorter than asked by 5 % of the stroke;
* unrest: the command, RMS about its own line over the second half of each step, and what the wire itself does then.

Laws that were only tried are in ``trial_laws.py``; of them ``fastest`` is none to drive with: after a step full current,
or the bias, until the wire is there, and from then on until the next step its error counts as none.  No law that keeps to
the limits can be much better than that.  ``--gains ki=1600`` drives the others with another gain than the file's.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from control_tables import STEPS, PERIOD_s
from kept import MODEL, kept
from rich.console import Console
from rich.table import Table
from trial_laws import TRIALS
from whole_range import WIRES, WITH_HELD, OneWire, characterised

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode
from sma_actuator.bench import InProcessDaq, InProcessSupply, Spring, VirtualBench, VirtualClock, Weight
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.control.setpoints import Setpoint, sine, steps
from sma_actuator.driver import Driver
from sma_actuator.identify import identify
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.plant.worlds import WORLDS

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "out" / "control_worlds"
MODELS = ("thesis", "whole_range")
LOADS = {"weight": Weight(0.98), "spring": Spring(stiffness_N_m=150.0, preload_N=0.8)}
PROGRAMS = ("steps", "sine")
LAWS = ("pid", "feed_forward_pid", *TRIALS)
DWELL_s = 20.0
DURATION_s = {"steps": 240.0, "sine": 120.0}
#: Shorter than asked by this share of the full stroke counts as too short.
TOO_SHORT = 0.05
#: The rooms that the logs depend on, and those that the parameter files do beside.
LOGS_BY, MODELS_BY = ("plant", "bench", "characterise"), ("identify", "estimation")
#: And what the runs do.
RUN_BY = ("control", "safety", "config", "driver", "actuator", "derived", "instruments", "trial_laws", "control_worlds")


def digest(rooms: Iterable[str]) -> str:
    """What these rooms are now, in a few letters."""
    files = sorted(p for room in rooms for p in (ROOT / "sma_actuator" / room).rglob("*.py"))
    files += [p for room in rooms for at in ("sma_actuator", "benchmarks") if (p := ROOT / at / f"{room}.py").is_file()]
    files += sorted((ROOT / "config").glob("*_bench.yaml"))
    return hashlib.sha256(b"".join(p.read_bytes() for p in files)).hexdigest()[:12]


def identified(wire: str, physics: str, model: str) -> dict[str, Any]:
    """The parameters of a wire in a physics with a model identified from its own logs."""
    folder = KEPT / digest(LOGS_BY) / f"{physics}_{wire}"
    path = folder / f"{model}_{digest(MODELS_BY)}.yaml"
    if not path.is_file():
        logs = [read_bench_log(log) for log in kept_logs(wire, physics, folder)]
        mapping = read_parameter_file(shared_file(f"config/{wire}_bench.yaml"))
        found = identify(logs, mapping, wire if model == "thesis" else model)
        text = yaml.safe_dump({"sma_actuator": {"ros__parameters": found.mapping}}, sort_keys=False)
        path.write_text(text, encoding="utf-8")
    return read_parameter_file(path)


def kept_logs(wire: str, physics: str, folder: Path) -> list[Path]:
    """The logs of that wire, made where they are not there yet; how many cycles it had done then stands beside them."""
    if not (folder / "complete").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        its = OneWire(wire, physics)
        characterised(its, WITH_HELD, 1, folder)
        (folder / "complete").write_text(f"{its.cycles:g}\n", encoding="utf-8")
    return sorted(folder.glob("*.csv"))


def cycles_done(wire: str, physics: str) -> float:
    """When it was characterised."""
    return float((KEPT / digest(LOGS_BY) / f"{physics}_{wire}" / "complete").read_text(encoding="utf-8"))


def until_there(time_s: np.ndarray, asked_m: np.ndarray, place_m: np.ndarray) -> np.ndarray:
    """The places of a wire that stays where it was asked to be once it has come there, step by step."""
    out = place_m.copy()
    number = (time_s // DWELL_s).astype(int)
    for step in range(number[-1] + 1):
        here = np.flatnonzero(number == step)
        error_m = place_m[here] - asked_m[here]
        crossed = np.flatnonzero(error_m * error_m[0] <= 0.0)
        if len(crossed):
            out[here[crossed[0] :]] = asked_m[here[crossed[0] :]]
    return out


@dataclass(frozen=True)
class Case:
    """One run."""

    wire: str
    physics: str
    model: str
    load: str
    program: str
    law: str
    #: What the wire's heat loss is over that of its calibration (a draught, a tube).
    heat_loss: float = 1.0
    changes: tuple[tuple[str, Any], ...] = ()
    #: Parameters of the section ``thermal`` that are wrong, and by what factor.
    wrong: tuple[tuple[str, float], ...] = ()


@dataclass
class Found:
    """What came of it; errors in % of full stroke."""

    case: Case
    control: float
    output: float
    range_share: float  #: of the stroke under that load
    latched: float  #: share of the time
    longest_latch_s: float
    unrest_mA: float
    wander: float  #: of the wire at a held setpoint, RMS, % of full stroke
    fault: str = ""
    going: float = np.nan  #: control error of the sine from its second period on, when the wire has come to it
    series: dict[str, list[float]] = field(default_factory=dict, repr=False)


def bench_for(case: Case, seed: int) -> VirtualBench:
    """A bench with the wire that was characterised, as it is since, and this load."""
    cycles = cycles_done(case.wire, case.physics)
    return VirtualBench.from_name(case.wire, seed=seed, load=LOADS[case.load], physics=case.physics, cycles=cycles)


def stroke_of(bench: VirtualBench, config: Config) -> tuple[float, float]:
    """Where the wire of that bench is contracted as far as it goes, and where it is at rest in the cold [m]."""
    supply = InProcessSupply(bench, config)
    supply.open()
    supply.set_output(True)
    places = []
    for current_A, seconds in ((config.supply.bias_current, 2.0), (0.9 * config.supply.max_current, 8.0)):
        for _ in range(round(4.0 * seconds)):
            supply.set_current(current_A)
            bench.advance(bench.time_s + 0.25)
        places.append(bench.truth.displacement_m)
    return places[1], places[0]


def setpoints_of(case: Case, config: Config) -> tuple[Setpoint, float]:
    """What is asked for, inside the model's working range and the stroke, and the share of the stroke that is driven."""
    hot_m, cold_m = stroke_of(bench_for(case, seed=1), config)
    low_m, high_m = config.model.build(config.wire).displacement_range_m
    reach_m = 0.05 * (cold_m - hot_m)
    low_m, high_m = max(low_m, hot_m + reach_m), min(high_m, cold_m - reach_m)
    if case.program == "steps":
        setpoint = steps([low_m + part * (high_m - low_m) for part in STEPS], DWELL_s)
    else:
        setpoint = sine((low_m + high_m) / 2.0, 0.4 * (high_m - low_m), PERIOD_s)
    return setpoint, (high_m - low_m) / (cold_m - hot_m)


def once(case: Case) -> Found:
    """A run, or what it came to the last time: a table may be made a physics at a time."""
    return kept(f"control_worlds {case} {digest(RUN_BY)}", MODEL, lambda: run(case))


def run(case: Case, keep: bool = False) -> Found:
    """One run of the loop in virtual time."""
    mapping = identified(case.wire, case.physics, case.model)
    gains = {} if case.law == "fastest" else mapping["controller"]
    changes = {} if case.law == "fastest" else dict(case.changes)
    config = Config.from_mapping({**mapping, "controller": {**gains, "type": case.law}}).replace(changes)
    config = config.replace({f"thermal.{name}": times * getattr(config.thermal, name) for name, times in case.wrong})
    setpoint, share = setpoints_of(case, config)
    bench = bench_for(case, seed=7)
    if case.heat_loss != 1.0:
        bench.inject("draught", case.heat_loss)
    full_m = config.wire.full_stroke_m
    rows, fault = [], ""
    with Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)) as driver:
        driver.run_for(8.0)  # nothing is known of the wire at first: until then it counts as hot
        done, words = driver.enable(True)
        if not done:
            raise RuntimeError(f"{case}: {words}")
        start_s = bench.time_s
        while (elapsed_s := bench.time_s - start_s) < DURATION_s[case.program] and not fault:
            asked_m = setpoint(elapsed_s)
            driver.offer_setpoint(asked_m)
            output = driver.run_for(1.0 / config.loop.rate)
            truth_m = bench.truth.displacement_m
            at_max = "current_max" in output.status.limits
            rows.append(
                (
                    elapsed_s,
                    asked_m,
                    output.estimate.displacement_m,
                    truth_m,
                    output.command.current_A,
                    at_max and truth_m < asked_m - TOO_SHORT * full_m,
                )
            )
            if output.status.mode is Mode.OFF:
                fault = output.status.fault
    time_s, asked_m, estimate_m, truth_m, current_A, latched = np.array(rows, dtype=float).T
    unrest_A, wander_m = unrest(case, time_s, current_A, truth_m)
    if case.law == "fastest":
        unrest_A = wander_m = np.nan
        estimate_m, truth_m = (until_there(time_s, asked_m, np.nan_to_num(v)) for v in (estimate_m, truth_m))
    found = Found(
        case,
        control=float(np.nanmean(np.abs(asked_m - estimate_m))) / full_m * 100.0,
        output=float(np.mean(np.abs(asked_m - truth_m))) / full_m * 100.0,
        range_share=share,
        latched=float(latched.mean()),
        longest_latch_s=longest(latched) / config.loop.rate,
        unrest_mA=unrest_A * 1e3,
        wander=wander_m / full_m * 100.0,
        fault=fault,
        going=_going(case, time_s, np.abs(asked_m - estimate_m)) / full_m * 100.0,
    )
    if keep:
        names = ("time_s", "asked_m", "estimate_m", "truth_m", "current_A")
        found.series = dict(zip(names, (time_s, asked_m, estimate_m, truth_m, current_A), strict=True))
    return found


def _going(case: Case, time_s: np.ndarray, error_m: np.ndarray) -> float:
    """Mean of the errors from the second period of a sine on; NaN for steps, and where there is none."""
    later = time_s >= PERIOD_s
    return float(np.nanmean(error_m[later])) if case.program == "sine" and later.any() else np.nan


def longest(flags: np.ndarray) -> int:
    """Length of the longest run of true."""
    most = now = 0
    for flag in flags:
        now = now + 1 if flag else 0
        most = max(most, now)
    return most


def unrest(case: Case, time_s: np.ndarray, current_A: np.ndarray, truth_m: np.ndarray) -> tuple[float, float]:
    """RMS of current and displacement about their own lines over the second half of each step; NaN for a sine."""
    if case.program != "steps":
        return np.nan, np.nan
    squares: list[tuple[float, float]] = []
    for step in range(int(time_s[-1] // DWELL_s)):
        here = (time_s >= (step + 0.5) * DWELL_s) & (time_s < (step + 1.0) * DWELL_s)
        if np.count_nonzero(here) > 3:
            squares.append(tuple(_about_its_line(time_s[here], v[here]) for v in (current_A, truth_m)))
    return tuple(np.sqrt(np.mean(squares, axis=0))) if squares else (np.nan, np.nan)


def _about_its_line(time_s: np.ndarray, value: np.ndarray) -> float:
    line = np.polyval(np.polyfit(time_s - time_s[0], value, 1), time_s - time_s[0])
    return float(np.mean((value - line) ** 2))


def cases(args: argparse.Namespace) -> list[Case]:
    """All runs that were asked for."""
    return [
        Case(wire, physics, model, load, program, law, args.heat_loss, tuple(args.gains))
        for physics in args.physics
        for wire in args.wire
        for model in args.model
        for load in args.load
        for program in PROGRAMS
        for law in args.law
        if not (law == "fastest" and program == "sine")
    ]


def prepare(pair: tuple[str, str, str]) -> None:
    """Have a wire identified; apart, so that no two processes make the same."""
    physics, wire, models = pair
    for model in models.split():
        identified(wire, physics, model)


def table_of(found: Iterable[Found]) -> Table:
    """A row for each wire, physics, model and law; weight and spring together, the worse of them where it is a share."""
    table = Table(title="Under control, mean absolute errors, % of full stroke; weight / spring", title_justify="left")
    for header in ("physics", "wire", "model", "law", "driven", "steps control", "output", "sine control", "output"):
        table.add_column(header, justify="left" if header in ("physics", "wire", "model", "law") else "right")
    for header in ("latched", "for s", "unrest mA", "wander"):
        table.add_column(header, justify="right")
    groups: dict[tuple[str, ...], list[Found]] = {}
    for f in found:
        groups.setdefault((f.case.physics, f.case.wire, f.case.model, f.case.law), []).append(f)
    for key, members in groups.items():
        by = {(f.case.load, f.case.program): f for f in members}

        def both(program: str, value: Callable[[Found], str], by=by) -> str:
            return " / ".join(value(by[load, program]) for load in LOADS if (load, program) in by)

        faults = sorted({f.fault for f in members if f.fault})
        table.add_row(
            *key,
            both("steps", lambda f: f"{f.range_share:.0%}"),
            both("steps", lambda f: f"{f.control:.2f}"),
            both("steps", lambda f: f"{f.output:.2f}"),
            both("sine", lambda f: f"{f.control:.2f}"),
            both("sine", lambda f: f"{f.output:.2f}"),
            f"{max(f.latched for f in members):.1%}",
            f"{max(f.longest_latch_s for f in members):.1f}",
            both("steps", lambda f: f"{f.unrest_mA:.1f}"),
            both("steps", lambda f: f"{f.wander:.2f}") + (f" {', '.join(faults)}" if faults else ""),
        )
    return table


def prepared(pairs: Sequence[Any], run_one: Callable[[Any], Any], cases: Sequence[Any], jobs: int) -> list[Any]:
    """What each case comes to, once the models of all pairs are there; in so many processes."""
    if jobs == 1:
        for pair in pairs:
            prepare(pair)
        return [run_one(case) for case in cases]
    with ProcessPoolExecutor(jobs) as pool:
        list(pool.map(prepare, pairs))
        return list(pool.map(run_one, cases))


def gain(text: str) -> tuple[str, float]:
    """``ki=1600`` as a change of the parameters."""
    name, _, value = text.partition("=")
    return f"controller.{name}", float(value)


def main() -> int:
    """Print the table; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--physics", nargs="*", choices=tuple(WORLDS), default=tuple(WORLDS))
    parser.add_argument("--wire", nargs="*", choices=WIRES, default=WIRES)
    parser.add_argument("--model", nargs="*", choices=MODELS, default=MODELS)
    parser.add_argument("--law", nargs="*", choices=LAWS, default=("pid", "feed_forward_pid", "fastest"))
    parser.add_argument(
        "--heat-loss", type=float, default=1.0, metavar="TIMES", help="of the calibration's, in the runs"
    )
    parser.add_argument(
        "--gains", nargs="*", type=gain, default=[], metavar="NAME=VALUE", help="in place of the file's"
    )
    parser.add_argument("--load", nargs="*", choices=tuple(LOADS), default=tuple(LOADS))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    pairs = [(physics, wire, " ".join(args.model)) for physics in args.physics for wire in args.wire]
    wanted = cases(args)
    results = prepared(pairs, once, wanted, args.jobs)
    Console(width=150).print(table_of(results))
    if args.json:
        rows = [{**asdict(replace(f, series={})), "case": asdict(f.case)} for f in results]
        args.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
