"""Sessions on the virtual bench with effects that nobody declared, for judging whether tracing finds them.

    python benchmarks/blind_cases.py --survey [--jobs 2] [--json FILE]

A case is one session of two logs, driven open loop, on a bench of one physics: full pulses that settle at
both ends, partial cycles, and a slow triangle of current; without effects there are also sessions of one of
these alone.  Nothing in the logs tells what is hidden in the bench.  The
survey shows how far each effect raises the replay error of a model that was identified on the same
kind of wire without it: strength 1 of :data:`UNITS` is chosen so that it is 2 to 3 times, or where
no plausible value does that, the largest plausible one.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import itertools
import json
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np
from kept import BENCH, MODEL, kept
from rich.console import Console
from rich.table import Table
from users_way import characterised

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, Schedule, Spring, VirtualBench, VirtualClock, Weight
from sma_actuator.bench.hidden import FOREIGN, TWINS, hidden_effects
from sma_actuator.bench.hidden.hiding import HiddenBench
from sma_actuator.characterise import PlanOptions, Rig
from sma_actuator.characterise.plan import default_heat_current_A
from sma_actuator.characterise.programs import Drive
from sma_actuator.characterise.session import BENCH_FILE
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.console import write_json
from sma_actuator.identify import identify
from sma_actuator.logs.bench_log import BenchLog, read_bench_log, write_bench_log
from sma_actuator.plant.worlds import HOME
from sma_actuator.replay import replay

ALLOYS = ("flexinol", "furukawa")
LOADS = ("weight", "spring", "steps")
PROGRAMS = ("session", "pulses", "partial")  #: of the current; the first has all
ELSEWHERE = (
    "elsewhere"  #: a program of other currents, under other loads, every second time logged five times as rarely
)
LOAD_EFFECTS = ("load_cell_drift", "load_cell_gain", "elastic_compliance", "creep", "load_cell_nonlinearity")
LOG_s, PAUSE_s = 230.0, 60.0
SESSION_s = 2 * LOG_s + PAUSE_s
ANOTHER = 100_000  #: between the seeds of the sessions of one case
CHARACTERISED = PlanOptions(levels=6)  #: all that `sma-actuator characterise` measures where nobody chooses
FITTED = ("p*.csv", "levels_*.csv")  #: of that, what the README gives to `identify`
USED = 20.0  #: cycles a wire has done since it was characterised when a session begins
LADDER_N = (0.98, 1.47, 0.49, 1.18, 1.96, 0.69, 1.67, 0.49, 1.37, 0.78, 1.96)

#: What strength 1 is, in the effect's unit, for each alloy.
UNITS: dict[str, tuple[float, float]] = {
    "lead_resistance": (0.025, 0.015),
    "contact_drift": (0.04, 0.025),
    "voltage_offset": (0.0018, 0.0015),
    "reference_self_heating": (0.09, 0.14),
    "shunt": (6e-4, 4.5e-3),
    "sense_resistance": (0.02, 0.02),
    "self_heating": (1.5e-4, 2e-4),
    "ambient_temperature": (5.0, 5.0),
    "thermal_expansion": (2.5e-5, 2.5e-5),
    "elastic_compliance": (7e-5, 4.5e-5),
    "fatigue": (6e-5, 2.2e-5),
    "creep": (1.5e-4, 8e-5),
    "minor_loop_memory": (6e-4, 4e-4),
    "rate": (0.18, 0.18),
    "load_cell_drift": (0.25, 0.2),
    "load_cell_gain": (0.2, 0.18),
    "slip": (1.4e-4, 8e-5),
    "backlash": (3e-4, 1.8e-4),
    "reference_lag": (0.2, 0.2),
    "reference_gain": (0.035, 0.035),
    "reference_nonlinearity": (1.5e-4, 9e-5),
    "reference_drift": (1.5e-4, 9e-5),
    "draught": (0.4, 0.4),
    "hum": (1.6e-4, 9e-5),
    "lvdt_nonlinearity": (2e-4, 1.4e-4),
    "contact_bounce": (0.045, 0.022),
    "stick_slip": (2.6e-4, 1.8e-4),
    "thermo_voltage": (7e-5, 5e-5),
    "clock_skew": (0.35, 0.35),
    "load_cell_nonlinearity": (0.06, 0.06),
    "cross_talk": (4.5e-3, 4.5e-3),
    "heat_loss": (0.15, 0.15),
    "first_pulse_set": (1.4e-4, 8e-5),
    "current_feedthrough": (6e-4, 3e-4),
    "channel_delay": (0.3, 0.3),
    "prior_wear": (2.4e-4, 1.5e-4),
}
PAIRS = (
    ("lead_resistance", "slip"),
    ("thermal_expansion", "contact_drift"),
    ("fatigue", "backlash"),
    ("self_heating", "elastic_compliance"),
    ("creep", "voltage_offset"),
    ("load_cell_gain", "rate"),
    ("ambient_temperature", "minor_loop_memory"),
    ("slip", "load_cell_drift"),
)


@dataclass(frozen=True)
class Case:
    """One session to be made, and what is hidden in it."""

    name: str
    alloy: str
    hidden: dict[str, float] = field(hash=False)  #: name and strength, in the effect's own unit
    load: str  #: one of :data:`LOADS`
    seed: int
    ambient_logged: bool
    kind: str  #: "none", "single", "pair" or "foreign"
    physics: str = HOME
    program: str = PROGRAMS[0]
    sessions: int = 1  #: each under another load and with another seed; every clock begins at nothing


class Calibrated(NamedTuple):
    """What ``characterise`` leaves of a new wire."""

    logs: list[BenchLog]
    mapping: dict  #: its calibrated parameters
    cycles: float  #: that it has done by then, in training too


@functools.cache
def calibration(alloy: str, physics: str = HOME) -> Calibrated:
    """A wire without hidden effects, characterised as the README says."""
    return kept(f"calibration {alloy} {physics}", BENCH, lambda: _characterised(alloy, physics))


def _characterised(alloy: str, physics: str) -> Calibrated:
    mapping = read_parameter_file(shared_file(f"config/{alloy}_bench.yaml"))
    bench = VirtualBench.from_name(alloy, seed=1, physics=physics)
    with tempfile.TemporaryDirectory(prefix="sma_blind_") as name:
        folder = Path(name)
        characterised(mapping, CHARACTERISED, bench, folder)
        logs = [read_bench_log(path) for pattern in FITTED for path in sorted(folder.glob(pattern))]
        return Calibrated(logs, read_parameter_file(folder / BENCH_FILE), bench.cycles)


@functools.cache
def identified(alloy: str, physics: str = HOME) -> Config:
    """The model identified on the calibration logs."""
    logs, mapping, _ = calibration(alloy, physics)
    found = kept(f"identified {alloy} {physics}", MODEL, lambda: identify(logs, mapping, alloy).mapping)
    return Config.from_mapping(found)


def load_of(case: Case):
    """What hangs on the wire."""
    if case.program == ELSEWHERE and case.load != "steps":
        rng = np.random.default_rng((case.seed, 99))
        if case.load == "weight":
            return Weight(float(rng.choice((0.6, 1.3, 1.7))))
        return Spring(float(rng.choice((150.0, 450.0))), float(rng.choice((0.4, 0.9))))
    if case.load == "weight":
        return Weight(0.98)
    if case.load == "spring":
        return Spring(300.0, 0.5)
    rng = np.random.default_rng((case.seed, 7))
    steps, start = [(0.0, Weight(LADDER_N[0]))], int(rng.integers(1, len(LADDER_N)))
    for number, share in enumerate((0.12, 0.31, 0.5, 0.68, 0.86)):
        for log, begin_s in enumerate((0.0, LOG_s + PAUSE_s)):
            at_s = begin_s + share * LOG_s + rng.uniform(-8.0, 8.0)
            steps.append((round(at_s, 3), Weight(LADDER_N[(start + number + 5 * log) % len(LADDER_N)])))
    return Schedule(sorted(steps, key=lambda step: step[0]))


def currents_A(config, number: int, seed: int, program: str = PROGRAMS[0]) -> np.ndarray:
    """The current of log ``number`` at every reading: pulses, partial cycles and a triangle, never twice alike."""
    rng = np.random.default_rng((seed, number, 11))
    rate, low = config.loop.rate, config.supply.bias_current
    high = default_heat_current_A(config)
    slow = config.thermal.heat_capacity / config.thermal.heat_loss
    if program == ELSEWHERE:
        return _currents_elsewhere_A(np.random.default_rng((seed, number, 77)), rate, low, high)
    parts = [(low, 3.0)]

    def pulses(count):
        for _ in range(count):
            parts.extend(((high * rng.uniform(0.92, 1.0), 5.0 * slow), (low, 8.0 * slow)))

    def partial(count):
        for _ in range(count):
            parts.extend(
                ((high * rng.uniform(0.9, 1.0), rng.uniform(0.6, 1.8) * slow), (low, rng.uniform(0.6, 2.2) * slow))
            )
        parts.append((low, 6.0 * slow))

    if program == "pulses":
        pulses(int(LOG_s / (13.0 * slow)))
    elif program == "partial":
        partial(int(0.8 * LOG_s / (2.6 * slow)))
    else:
        pulses(3)
        partial(7)
        pulses(1)
    current = np.concatenate([np.full(round(s * rate), level) for level, s in parts])
    left = round(LOG_s * rate) - len(current)
    if program != "session":
        return np.concatenate((current, np.full(max(left, 0), low)))[: round(LOG_s * rate)]
    tail = round(8.0 * rate)
    # The triangle turns at different heights: some of its cycles are complete, some not.
    t = np.arange(max(left - tail, 0)) / rate
    period_s = max(t[-1] / round(t[-1] / (22.0 if number == 0 else 17.0)), 1.0) if len(t) else 1.0
    heights = rng.permutation([1.0, 0.82, 0.92, 0.76, 1.0, 0.88, 0.8, 0.95])
    cycle = (t / period_s).astype(int) % len(heights)
    triangle = 1.0 - np.abs(2.0 * (t / period_s % 1.0) - 1.0)
    triangle_A = low + (heights[cycle] * high - low) * triangle
    return np.concatenate((current, triangle_A, np.full(tail, low)))[: round(LOG_s * rate)]


def _currents_elsewhere_A(rng: np.random.Generator, rate: float, low: float, high: float) -> np.ndarray:
    """Sines, stairs up and down, switching at random and pulses with one pause, in any order, of a fifth of the log
    each."""
    part_s = 52.0
    t = np.arange(round(part_s * rate)) / rate

    def sine():
        return low + (high - low) * (0.5 - 0.5 * np.cos(2.0 * np.pi * t / rng.uniform(14.0, 26.0))) ** 0.6

    def stairs():
        level = np.concatenate((np.linspace(0.0, 1.0, 6), np.linspace(1.0, 0.0, 6)))
        return low + (high - low) * np.sqrt(level[(t / part_s * len(level)).astype(int)])

    def at_random():
        level = rng.uniform(0.0, 1.0, 20)
        return low + (high - low) * np.where(level > 0.45, level, 0.0)[(t / part_s * len(level)).astype(int)]

    def pulses():
        return np.where(t % 17.3 < 6.5, high * rng.uniform(0.9, 1.0), low)

    rest = np.full(round(2.0 * rate), low)
    shapes = (sine, stairs, at_random, pulses)
    parts = [rest, rest] + [x for number in rng.permutation(len(shapes)) for x in (shapes[number](), rest)]
    current_A = np.concatenate(parts)[: round(LOG_s * rate)]
    return np.concatenate((current_A, np.full(round(LOG_s * rate) - len(current_A), low)))


def sessions_of(case: Case) -> list[Case]:
    """Each session of a case alone: under one load after the other."""
    loads = list(dict.fromkeys((case.load, *_loads_for(*case.hidden))))
    seeds = [case.seed + ANOTHER * again for again in range(case.sessions)]
    return [
        dataclasses.replace(case, load=load, seed=seed, sessions=1)
        for load, seed in zip(itertools.cycle(loads), seeds, strict=False)
    ]


def make_logs(case: Case, folder: Path) -> list[Path]:
    """Run the sessions; returns the paths of two logs of each, whose times belong to one clock."""
    paths: list[Path] = []
    for one in sessions_of(case):
        for log in kept(f"session {one}", BENCH, functools.partial(_session, one)):
            paths.append(Path(folder) / f"{case.name}_{len(paths) + 1}.csv")
            write_bench_log(paths[-1], log)
    return paths


def _session(case: Case) -> list[BenchLog]:
    before = calibration(case.alloy, case.physics)
    config = bench_from_mapping(before.mapping)
    bench = HiddenBench.from_name(
        case.alloy,
        seed=case.seed,
        load=load_of(case),
        physics=case.physics,
        hidden=case.hidden,
        session_s=SESSION_s,
        cycles=before.cycles + USED,
    )
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    wire = {"alloy": config.wire.alloy, "length_m": config.wire.length, "diameter_m": config.wire.diameter}
    logs = []
    with rig.opened():
        for number in range(2):
            bench.advance(number * (LOG_s + PAUSE_s))
            # Loads change on purpose, and a sense resistor that warms drifts: a session goes on as on others' benches.
            drives = _open_loop(currents_A(config, number, case.seed, case.program))
            log = rig.record(drives, but=("load_spike", "current_drifts"))
            columns = dict(log.columns)
            columns["time_s"] = columns["time_s"] + (bench.time_s - columns["time_s"][-1])
            if case.program == ELSEWHERE and case.seed % 2:
                columns = {name: values[::5] for name, values in columns.items()}
            if not case.ambient_logged:
                columns.pop("ambient_temperature_C", None)
            logs.append(BenchLog(columns, {"kind": "session", "wire": wire}))
    return logs


def _open_loop(currents):
    for current_A in currents:
        yield Drive(float(current_A))


def without_effects(
    alloy: str, load: str, seed: int, ambient_logged: bool = True, program: str = PROGRAMS[0], physics: str = HOME
) -> Case:
    """A case in which nothing is hidden."""
    return _case("none", alloy, {}, load, seed, ambient_logged, physics, program)


def undisturbed(case: Case) -> Case:
    """The same session without effects."""
    return without_effects(case.alloy, case.load, case.seed, case.ambient_logged, case.program, case.physics)


def _case(
    kind: str,
    alloy: str,
    hidden: dict[str, float],
    load: str,
    seed: int,
    ambient_logged: bool,
    physics: str,
    program: str = PROGRAMS[0],
) -> Case:
    # The name must not tell what is hidden: it becomes the logs' name.
    word = crc32(repr((kind, alloy, sorted(hidden.items()), load, seed, ambient_logged, physics, program)).encode())
    name = f"case_{alloy}_{word:08x}"
    return Case(name, alloy, hidden, load, seed, ambient_logged, kind, physics, program)


def _signs(name: str, number: int) -> float:
    """Some effects may go either way."""
    both = (
        "voltage_offset",
        "load_cell_drift",
        "load_cell_gain",
        "reference_gain",
        "reference_drift",
        "reference_nonlinearity",
        "slip",
        "ambient_temperature",
        "thermo_voltage",
        "sense_resistance",
        "load_cell_nonlinearity",
        "heat_loss",
    )
    return -1.0 if name in both and number % 2 else 1.0


def single(
    name: str,
    alloy: str,
    strength: float,
    load: str,
    seed: int,
    sign: float = 1.0,
    ambient_logged: bool = True,
    physics: str = HOME,
) -> Case:
    """A case with one effect, ``strength`` in multiples of :data:`UNITS`."""
    value = sign * strength * UNITS[name][ALLOYS.index(alloy)]
    kind = "single" if name in TWINS else "foreign"
    return _case(kind, alloy, {name: value}, load, seed, ambient_logged, physics)


def cases(
    turns: Sequence[int] = (0,),
    strengths: tuple[float, ...] = (0.5, 1, 2),
    physics: str = HOME,
    elsewhere: bool = False,
) -> list[Case]:
    """The whole list: every effect alone, none, pairs and what no model has a name for; the same on every call.

    Each of ``turns`` is the whole list with other seeds, loads and signs.  ``elsewhere``: those that have the whole
    program, with :data:`ELSEWHERE` in its place.
    """
    out = []
    for turn in turns:
        number = turn * len(TWINS) * len(strengths) * len(ALLOYS)
        for position, name in enumerate(TWINS):
            for level, strength in enumerate(strengths):
                for which, alloy in enumerate(ALLOYS):
                    load = _load_for(name, position + level + which + turn)
                    sign = _signs(name, position + level + turn)
                    logged = crc32(f"{name} {strength:g} {alloy} {turn}".encode()) % 3 > 0
                    out.append(single(name, alloy, strength, load, 1000 + number, sign, logged, physics))
                    number += 1
        for position, (alloy, load, again) in enumerate(itertools.product(ALLOYS, LOADS, range(3))):
            if position % 9 != 8:
                seed = 3000 + 100 * turn + position
                out.append(without_effects(alloy, load, seed, again != 1, PROGRAMS[0], physics))
        for position, (program, alloy, load) in enumerate(
            itertools.product(PROGRAMS[1:], ALLOYS, ("weight", "spring"))
        ):
            out.append(without_effects(alloy, load, 3050 + 100 * turn + position, True, program, physics))
        for position, (pair, alloy) in enumerate(itertools.product(PAIRS, ALLOYS)):
            hidden = {n: _signs(n, position // 2) * UNITS[n][ALLOYS.index(alloy)] * 1.5 for n in pair}
            load = _load_for(next((n for n in pair if n in LOAD_EFFECTS), pair[0]), position + turn)
            out.append(_case("pair", alloy, hidden, load, 4000 + 100 * turn + position, position % 4 < 3, physics))
        for position, (name, alloy) in enumerate(itertools.product(FOREIGN, ALLOYS)):
            load = _load_for(name, position + position // 2 + turn)
            strength = 2.0 if position % 4 < 2 else 1.0
            seed, sign = 5000 + 100 * turn + position, _signs(name, position // 2)
            out.append(single(name, alloy, strength, load, seed, sign, physics=physics))
    if not elsewhere:
        return out
    there = [c for c in out if c.program == PROGRAMS[0]]
    return [_case(c.kind, c.alloy, c.hidden, c.load, c.seed, c.ambient_logged, physics, ELSEWHERE) for c in there]


def _loads_for(*names: str) -> tuple[str, ...]:
    """Under which effects can be seen: those of the load not under a weight that stays."""
    return ("spring", "steps") if {*names} & {*LOAD_EFFECTS} else LOADS


def _load_for(name: str, number: int) -> str:
    loads = _loads_for(name)
    return loads[number % len(loads)]


def error_percent(case: Case) -> float:
    """Mean |estimate − measurement| of the session, in % of the full stroke, over the full range."""
    config = identified(case.alloy, case.physics)
    with tempfile.TemporaryDirectory(prefix="sma_blind_") as folder:
        logs = [read_bench_log(path) for path in make_logs(case, Path(folder))]
    errors = [r.errors["model"].full_percent for r in replay(logs, {"model": config})]
    return float(np.average(errors, weights=[len(log) for log in logs]))


def survey(
    jobs: int, names: list[str], loads_asked=LOADS, strengths=(0.5, 1.0, 2.0)
) -> dict[str, dict[str, list[float]]]:
    """Error over the error without the effect: per effect, per alloy, at every strength; the mean over the loads."""
    asked: list[Case] = []
    for name, alloy, strength in itertools.product(names, ALLOYS, strengths):
        sign = -1.0 if name == "ambient_temperature" else 1.0  # warmth is no trouble, cold is
        loads = [load for load in loads_asked if load != "weight" or name not in LOAD_EFFECTS]
        asked += [single(name, alloy, strength, load, 9000, sign) for load in loads]
    none = [without_effects(alloy, load, 9000) for alloy in ALLOYS for load in loads_asked]
    todo = none + asked
    with ProcessPoolExecutor(jobs) as pool:
        errors = list(pool.map(error_percent, todo, chunksize=4))
    base = {(c.alloy, c.load): e for c, e in zip(none, errors)}
    out: dict[str, dict[str, list[float]]] = {"none": {a: [base[a, load] for load in loads_asked] for a in ALLOYS}}
    found: dict[tuple[str, str, float], list[float]] = {}
    for case, error in zip(asked, errors[len(none) :]):
        ((name, value),) = case.hidden.items()
        key = (name, case.alloy, round(abs(value) / UNITS[name][ALLOYS.index(case.alloy)], 6))
        found.setdefault(key, []).append(error / base[case.alloy, case.load])
    for name in names:
        out[name] = {a: [float(np.mean(found[name, a, s])) for s in strengths] for a in ALLOYS}
    return out


def main() -> int:
    """Print the survey, or the list of cases; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--survey", action="store_true", help="how far each effect raises the replay error")
    parser.add_argument("--only", nargs="*", choices=[*TWINS, *FOREIGN], help="these effects alone")
    parser.add_argument("--loads", nargs="*", choices=LOADS, default=LOADS, help="under these loads alone")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here")
    args = parser.parse_args()
    console = Console(width=130)
    if not args.survey:
        for case in cases():
            console.print(json.dumps(dataclasses.asdict(case)), soft_wrap=True)
        return 0
    numbers = survey(args.jobs, args.only or [*TWINS, *FOREIGN], args.loads)
    table = Table(title="replay error with the effect over that without it, at strength 0.5, 1 and 2")
    table.add_column("effect", no_wrap=True)
    table.add_column("unit")
    for alloy in ALLOYS:
        for header in (f"{alloy}: 1 is", "× 0.5", "× 1", "× 2"):
            table.add_column(header, justify="right")
    for name, row in numbers.items():
        if name == "none":
            for alloy in ALLOYS:
                console.print(
                    f"{alloy} without: " + ", ".join(f"{m} {e:.2f} %" for m, e in zip(args.loads, row[alloy]))
                )
            continue
        cells = [c for i, a in enumerate(ALLOYS) for c in (f"{UNITS[name][i]:g}", *(f"{r:.2f}" for r in row[a]))]
        table.add_row(name, hidden_effects()[name].unit, *cells)
    console.print(table)
    write_json(args, numbers)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
