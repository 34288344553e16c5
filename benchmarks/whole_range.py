"""The model of the whole range beside the thesis's, on every physics of the bench, on logs that were not fitted.

    python benchmarks/whole_range.py [--physics NAME …] [--wire flexinol furukawa] [--on-off] [--json FILE]
                                                                                          (make whole-range)

Both are identified from the same fifteen calibration logs (pulses, partial cycles and held currents at five weights).
They are judged on other seeds, other weights, a spring and load steps: pulses, partial cycles, triangles of current,
and a position held and moved by a PID.  The wire has done 40 cycles before it is characterised, as `characterise`
drives them, and goes on from log to log as it is.  Errors are mean absolute, in % of the full stroke, over the whole
range with both ends.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from blind_cases import LADDER_N, currents_A
from replay_tables import TRAINED, PRELOAD_AT_m
from rich.console import Console
from rich.table import Table

from sma_actuator.base.calibration import unknown_since_then_m
from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, Schedule, Spring, VirtualBench, VirtualClock, Weight
from sma_actuator.characterise import PlanOptions, Rig, characterise, make_plan
from sma_actuator.characterise.operators import BenchOperator
from sma_actuator.characterise.programs import Drive, Program, hold
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.console import write_json
from sma_actuator.estimation.chain import Chain
from sma_actuator.identify import identify
from sma_actuator.identify.fitters.whole_range import regions
from sma_actuator.logs.bench_log import BenchLog, read_bench_log
from sma_actuator.logs.experiments import make_experiment
from sma_actuator.plant.worlds import WORLDS

WIRES = ("flexinol", "furukawa")
_SKIP = ("training", "fatigue", "lead_resistance", "load_cell", "lvdt")
CALIBRATION = PlanOptions(loads_N=(0.35, 0.6, 0.98, 1.5, 2.1), skip=_SKIP)  #: on/off moves alone, ten logs
WITH_HELD = replace(CALIBRATION, levels=6)  #: and currents held at each load, five logs more
JUDGED = PlanOptions(loads_N=(0.49, 1.96), springs_N_m=((300.0, 0.5),), pulses=2, set_points=4, skip=_SKIP)
PID_s = 120.0
HELD = (Weight(0.8), Spring(250.0, 0.6))
KINDS = ("pulses", "partial", "spring session", "load steps", "pid")


@dataclass
class OneWire:
    """A wire that goes from bench to bench, and is as old on each as those before have left it."""

    name: str
    physics: str
    cycles: float = TRAINED

    def on_bench(self, seed: int, load=None) -> tuple[VirtualBench, Rig]:
        """A bench and a rig on it; :meth:`came_off` when it is done."""
        return bench_of(self.name, self.physics, seed, load, self.cycles)

    def came_off(self, bench: VirtualBench) -> None:
        """Older by what it has done there."""
        self.cycles += bench.cycles


def bench_of(wire: str, physics: str, seed: int, load=None, cycles: float = TRAINED) -> tuple[VirtualBench, Rig]:
    """A bench with a wire that has done so many cycles, and a rig on it."""
    config = bench_from_mapping(read_parameter_file(shared_file(f"config/{wire}_bench.yaml")))
    bench = VirtualBench.from_name(wire, seed=seed, load=load, physics=physics, cycles=cycles)
    return bench, Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))


def characterised(wire: OneWire, options: PlanOptions, seed: int, folder: Path) -> list[Path]:
    """The logs that `sma-actuator characterise --virtual` would write."""
    bench, rig = wire.on_bench(seed)
    operator = BenchOperator(bench, rig.config.wire.max_stress * rig.config.wire.area_m2, PRELOAD_AT_m)
    mapping = read_parameter_file(shared_file(f"config/{wire.name}_bench.yaml"))
    characterise(mapping, make_plan(rig.config, options), rig, operator, folder)
    wire.came_off(bench)
    return sorted(folder.glob("*.csv"))


def logs_of(wire: OneWire, options: PlanOptions, seed: int) -> list[BenchLog]:
    """The same, read."""
    with tempfile.TemporaryDirectory(prefix="sma_whole_range_") as folder:
        return [read_bench_log(path) for path in characterised(wire, options, seed, Path(folder))]


def driven(wire: OneWire, seed: int, load, program_of) -> BenchLog:
    """A session of its own."""
    bench, rig = wire.on_bench(seed, load)
    with rig.opened():
        log = rig.record(program_of(rig.config), but=("load_spike",))
    wire.came_off(bench)
    return log


def session(config) -> Program:
    """Pulses, partial cycles and triangles of current."""
    for current_A in currents_A(config, 0, 77):
        yield Drive(float(current_A))


def position_held(config, low_m: float, high_m: float) -> Program:
    """A PID on the measured displacement, to positions over the whole stroke."""
    rng = np.random.default_rng(6)
    bias_A, most_A = config.supply.bias_current, 0.9 * config.supply.max_current
    yield from hold(bias_A, 1.0)
    signals = yield Drive(bias_A)
    begin_s, next_s, before_m, integral_A = signals.time_s, signals.time_s, signals.reference_displacement_m, 0.1
    while signals.time_s < begin_s + PID_s:
        if signals.time_s >= next_s:
            target_m = low_m + (high_m - low_m) * rng.uniform(0.02, 0.98)
            next_s = signals.time_s + rng.uniform(4.0, 14.0)
        place_m = signals.reference_displacement_m
        error_m, speed_m_s = place_m - target_m, (place_m - before_m) * config.loop.rate
        current_A = 800.0 * error_m + integral_A + 50.0 * speed_m_s
        if bias_A < current_A < most_A:
            integral_A += 400.0 * error_m / config.loop.rate
        before_m = place_m
        signals = yield Drive(float(np.clip(current_A, bias_A, most_A)), target_m)


def judged_logs(wire: OneWire, low_m: float, high_m: float) -> list[tuple[str, BenchLog]]:
    """What no fit has seen, with what it is."""
    logs = [("partial" if "partial" in log.name else "pulses", log) for log in logs_of(wire, JUDGED, 2)]
    steps = [(t, Weight(f)) for t, f in zip(np.arange(0.0, 230.0, 25.0), LADDER_N, strict=False)]
    logs.append(("spring session", driven(wire, 5, Spring(300.0, 0.5), session)))
    logs.append(("load steps", driven(wire, 5, Schedule(steps), session)))
    held = [driven(wire, 6, load, lambda config: position_held(config, low_m, high_m)) for load in HELD]
    logs += [("pid", log) for log in held]
    return [(kind, replace(log, source=f"{kind}.csv")) for kind, log in logs]


def judge(wire: str, physics: str, options: PlanOptions = WITH_HELD, untrained: bool = False) -> dict:
    """Every number of one wire in one physics; ``untrained``: when it is characterised, and a fresh one when it is
    judged."""
    mapping = read_parameter_file(shared_file(f"config/{wire}_bench.yaml"))
    its = OneWire(wire, physics, 0.0 if untrained else TRAINED)
    calibration = logs_of(its, options, 1)
    if untrained:
        its.cycles = 0.0
    thesis = identify(calibration, mapping, wire)
    begin_s, begin_cpu_s = time.perf_counter(), time.process_time()
    whole = identify(calibration, mapping, "whole_range")
    out: dict = {"fit_s": time.perf_counter() - begin_s, "fit_cpu_s": time.process_time() - begin_cpu_s}
    places = np.concatenate([t.displacement_m for t in thesis.experiments])
    logs = judged_logs(its, *(float(v) for v in np.percentile(places, (1, 99))))
    full_m = whole.config.wire.full_stroke_m
    rows: dict[str, list[np.ndarray]] = {"thesis": [], "whole": [], "inside": [], "place": [], "kind": []}
    for kind, log in logs:
        for name, config in (("thesis", thesis.config), ("whole", whole.config)):
            experiment = make_experiment(log, config)
            found = Chain(config).run(experiment.signals)
            rows[name].append(np.abs(found.displacement_m - experiment.displacement_m) / full_m * 100.0)
        half_m = found.uncertainty_m + unknown_since_then_m(whole.config.calibration.training)
        rows["inside"].append(np.abs(found.displacement_m - experiment.displacement_m) <= half_m)
        rows["place"].append(experiment.displacement_m)
        rows["kind"].append(np.full(len(experiment.displacement_m), kind))
    flat = {name: np.concatenate(values) for name, values in rows.items()}
    for name in ("thesis", "whole"):
        out[name] = regions(flat["place"], flat["kind"] == "partial", flat[name])
        out[name].update({kind: float(flat[name][flat["kind"] == kind].mean()) for kind in KINDS})
        out[name]["all"] = float(flat[name].mean())
    out["coverage"] = float(flat["inside"].mean())
    out["coverages"] = {kind: float(flat["inside"][flat["kind"] == kind].mean()) for kind in KINDS}
    out["step_us"], out["numbers"] = microseconds(whole.config, logs[0][1]), _numbers(whole.mapping["model"])
    out["notes"] = whole.notes
    return out


def microseconds(config: Config, log: BenchLog) -> float:
    """Time of one sample through the model alone, the best of three runs over a log [µs]."""
    experiment = make_experiment(log, config)
    s, model = experiment.signals, config.model.build(config.wire)
    samples = list(
        zip(
            s.time_s, s.resistance_Ohm, s.stress_Pa, experiment.heating, s.power_W, s.ambient_temperature_C, strict=True
        )
    )
    samples = [(*map(float, x[:3]), bool(x[3]), *map(float, x[4:])) for x in samples]
    best = np.inf
    for _ in range(3):
        model.reset()
        begin = time.perf_counter()
        for sample in samples:
            model.observe(*sample)
        best = min(best, (time.perf_counter() - begin) / len(samples) * 1e6)
    return best


def _numbers(section: dict) -> int:
    return sum(len(v) if isinstance(v, (list, tuple)) else 1 for v in section.values())


def main() -> int:
    """Print the table; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--physics", nargs="*", choices=tuple(WORLDS), default=tuple(WORLDS))
    parser.add_argument("--wire", nargs="*", choices=WIRES, default=WIRES)
    parser.add_argument("--on-off", action="store_true", help="without the logs of held currents")
    parser.add_argument(
        "--untrained", action="store_true", help="a wire that is characterised untrained, and judged by a fresh one"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    console = Console(width=150)
    columns = ("all", "hot end", "between", "cold end", *KINDS)
    table = Table(
        title="mean absolute error, % of full stroke, on logs that were not fitted: thesis's model → whole_range"
    )
    for header in ("physics", "wire", *columns, "in 95 %"):
        table.add_column(header, justify="left" if header in ("physics", "wire") else "right")
    numbers = {}
    for physics in args.physics:
        for wire in args.wire:
            options = CALIBRATION if args.on_off else WITH_HELD
            found = numbers[f"{physics} {wire}"] = judge(wire, physics, options, args.untrained)
            cells = [f"{found['thesis'][c]:.2f} → {found['whole'][c]:.2f}" for c in columns]
            table.add_row(physics, wire, *cells, f"{found['coverage']:.1%}")
            console.print(f"{physics} {wire}: {found['thesis']['all']:.2f} → {found['whole']['all']:.2f} %")
    console.print(table)
    worst = max(n["whole"]["all"] for n in numbers.values())
    console.print(
        f"worst physics {worst:.2f} %; one sample {max(n['step_us'] for n in numbers.values()):.1f} µs at most; "
        f"identified in {max(n['fit_s'] for n in numbers.values()):.0f} s at most "
        f"({max(n['fit_cpu_s'] for n in numbers.values()):.0f} s of one core), "
        f"{max(n['numbers'] for n in numbers.values())} coefficients"
    )
    write_json(args, numbers)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
