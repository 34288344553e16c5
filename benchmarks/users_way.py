"""A wire of the virtual bench as a user gets to drive it: ``init``, ``characterise``, ``identify``, ``init``, then the
second round.

In the second round ``characterise --follow`` lets the model drive the wire, ``identify`` takes both rounds, and
``init`` makes of it what the node drives with.  Nothing comes from the limits and gains in ``config/``: of
``config/*_bench.yaml`` only what the wire and its instruments are (:data:`FACTS`) is taken; ``identify`` gets the bench
file that ``characterise`` leaves.  A wire of another diameter (``flexinol_25um``) has a load cell and a sense resistor
that suit it, and its heat loss is to the alloy's own as still air takes it from both.  Logs and models lie in
``out/control_worlds`` and are used again while nothing has changed that they depend on; what ``init`` derives is
derived each time.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import io
import math
import tempfile
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from grains import ALLOYS, GrainsBench
from replay_tables import PRELOAD_AT_m

from sma_actuator.base.calibration import unknown_since_then_m
from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.bench.bench import Setup
from sma_actuator.bench.chain import Chain as MeasuringChain
from sma_actuator.bench.real import wire_of
from sma_actuator.characterise import PlanOptions, Rig, characterise, make_plan
from sma_actuator.characterise.operators import BenchOperator
from sma_actuator.characterise.session import BENCH_FILE
from sma_actuator.cli.main import main as sma_actuator
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file, write_parameter_file
from sma_actuator.derived import still_air_W_m2K
from sma_actuator.estimation.chain import Chain
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.logs.experiments import make_experiment
from sma_actuator.plant.loads import Load, Schedule, Spring, Weight
from sma_actuator.plant.materials import WIRES as SPECIMENS
from sma_actuator.plant.worlds import HOME

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "out" / "control_worlds"
WIRES = ("flexinol", "furukawa")
#: ``whole_range`` is of both rounds, the others of the first alone.
MODELS = ("thesis", "first_round", "whole_range")
#: What a user knows of wire and bench without having measured.
FACTS = ("wire", "circuit", "load_cell", "reference_sensor", "instruments")
#: Load cell and LVDT are calibrated already; the wire is new, and trained as long as `characterise` finds it wanted.
CALIBRATED = ("lead_resistance", "load_cell", "lvdt", "fatigue")
SKIPPED = (*CALIBRATED, "training")
CHARACTERISED = PlanOptions(levels=6, skip=CALIBRATED)
#: A load between those that are characterised, for logs that no fit has seen.
UNSEEN_Pa = 54e6
#: The rooms that the logs depend on, those that the models do beside, and beside these the logs of the second round.
LOGS_BY, MODELS_BY = ("plant", "bench", "characterise", "grains"), ("identify", "estimation", "calibration")
SECOND_BY = (*MODELS_BY, "control", "derived")
#: The stroke that a wire truly has is that between this temperature at its hottest place and the bias current.
HOT_C = 160.0
COOL_s, LONGEST_s = 40.0, 60.0
_FROM_BIAS = 5.0  #: times that current it is heated with at first
#: Between alloy and diameter in a wire's name, and after it.
_OF, _um = "_", "um"


def digest(rooms: Iterable[str]) -> str:
    """What these rooms are now, in a few letters."""
    files = sorted(p for room in rooms for p in (ROOT / "sma_actuator" / room).rglob("*.py"))
    files += [p for room in rooms for at in ("sma_actuator", "benchmarks") if (p := ROOT / at / f"{room}.py").is_file()]
    files += sorted((ROOT / "config").glob("*_bench.yaml"))
    return hashlib.sha256(b"".join(p.read_bytes() for p in files)).hexdigest()[:12]


def command(*words: object) -> None:
    """One command of the user's, without its words; raises where it fails.  A model that is not good is written all the
    same."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = sma_actuator([str(word) for word in words])
    if code not in (0, 3):
        raise RuntimeError(f"sma-actuator {words[0]}: {said.getvalue()[-2000:]}")


def wire_named(alloy: str, diameter_um: float) -> str:
    """The name of a wire of this diameter; 0: of its own."""
    return f"{alloy}{_OF}{diameter_um:g}{_um}" if diameter_um else alloy


def alloy_of(wire: str) -> str:
    """A wire's alloy, one of :data:`WIRES`, by its name."""
    return wire.partition(_OF)[0]


def _diameter_m(wire: str) -> float:
    diameter_um = wire.partition(_OF)[2].removesuffix(_um)
    return float(f"{diameter_um}e-6") if diameter_um else SPECIMENS[wire].diameter_m


def _finer(wire: str) -> float:
    """How many times thicker the alloy's own is."""
    return SPECIMENS[alloy_of(wire)].diameter_m / _diameter_m(wire)


def scaled(wire: str, load: Load) -> Load:
    """The load that stresses it as this one does the alloy's own."""
    area = _finer(wire) ** -2
    if isinstance(load, Weight):
        return Weight(area * load.force_N)
    if isinstance(load, Spring):
        return Spring(area * load.stiffness_N_m, area * load.preload_N, load.preload_displacement_m)
    return Schedule([(time_s, scaled(wire, each)) for time_s, each in load.steps])


def bench_of(
    wire: str,
    physics: str,
    cycles: float,
    seed: int,
    load: Load | None = None,
    noise: float = 1.0,
    warmer_K: float = 0.0,
) -> VirtualBench:
    """A bench with the wire as it is after so many cycles; ``noise``: its DAQ's over the usual one's; in a room that is
    so much warmer than usual."""
    diameter_m, finer = _diameter_m(wire), _finer(wire)
    specimen = wire_of(alloy_of(wire), HOME if physics in ALLOYS else physics).after(cycles)
    loses = still_air_W_m2K(diameter_m) / still_air_W_m2K(specimen.diameter_m)
    specimen = replace(specimen, diameter_m=diameter_m, heat_transfer_W_m2K=loses * specimen.heat_transfer_W_m2K)
    usual = MeasuringChain()
    chain = replace(
        usual,
        reference_resistance_Ohm=_sense_Ohm(finer),
        load_cell_slope_N_V=usual.load_cell_slope_N_V / finer**2,
        load_cell_offset_N=usual.load_cell_offset_N / finer**2,
        noise_V=tuple(noise * noise_V for noise_V in usual.noise_V),
    )
    setup = Setup(specimen, chain, load or scaled(wire, Weight(0.98)))
    setup = replace(setup, ambient_C=setup.ambient_C + warmer_K)
    return GrainsBench(physics, setup, seed, cycles) if physics in ALLOYS else VirtualBench(setup, seed)


def _sense_Ohm(finer: float) -> float:
    """Of the next decade: a finer wire is driven with less current."""
    return MeasuringChain().reference_resistance_Ohm * 10.0 ** max(math.ceil(math.log10(finer)), 0)


def folder_of(wire: str, physics: str) -> Path:
    """Where the logs and models of a wire lie."""
    return KEPT / digest(LOGS_BY) / f"{physics}_{wire}"


def facts_of(wire: str, folder: Path) -> Path:
    """What is known of the wire and its bench, as a parameter file."""
    path = folder / "facts.yaml"
    if not path.is_file():
        finer = _finer(wire)
        mapping = read_parameter_file(shared_file(f"config/{alloy_of(wire)}_bench.yaml"))
        mapping["wire"]["diameter"] = _diameter_m(wire)
        mapping["circuit"]["reference_resistance"] = _sense_Ohm(finer)
        for name in ("slope", "offset"):
            mapping["load_cell"][name] /= finer**2
        folder.mkdir(parents=True, exist_ok=True)
        write_parameter_file(path, {name: mapping[name] for name in FACTS}, "What is known of wire and bench.", {})
    return path


def logs_of(wire: str, physics: str) -> list[Path]:
    """The logs that ``characterise`` makes of it, on a bench file that ``init`` has written."""
    folder = folder_of(wire, physics)
    if not (folder / "complete").is_file():
        bench_path = _init(facts_of(wire, folder), folder / "bench.yaml")
        cycles = _characterised(wire, physics, bench_path, CHARACTERISED, 1, folder / "logs", 0.0)
        area_m2 = bench_from_mapping(read_parameter_file(bench_path)).wire.area_m2
        unseen = PlanOptions(loads_N=(float(f"{UNSEEN_Pa * area_m2:.3g}"),), pulses=2, set_points=4, skip=SKIPPED)
        cycles = _characterised(wire, physics, bench_path, unseen, 2, folder / "unseen", cycles)
        (folder / "complete").write_text(f"{cycles:g}\n", encoding="utf-8")
    return sorted(path for path in (folder / "logs").glob("*.csv") if not path.name.startswith("training"))


def characterised(mapping: dict[str, Any], options: PlanOptions, bench: VirtualBench, folder: Path) -> None:
    """Make the logs of a plan on a bench with these parameters."""
    config = bench_from_mapping(mapping)
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    operator = BenchOperator(bench, config.wire.max_stress * config.wire.area_m2, PRELOAD_AT_m)
    characterise(mapping, make_plan(config, options), rig, operator, folder)


def _characterised(
    wire: str, physics: str, bench_path: Path, options: PlanOptions, seed: int, folder: Path, cycles: float
) -> float:
    """Make the logs of a plan; returns how many cycles the wire has done after it."""
    bench = bench_of(wire, physics, cycles, seed)
    characterised(read_parameter_file(bench_path), options, bench, folder)
    return cycles + bench.cycles


def _init(start: Path, path: Path, *words: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    command("init", "--start", start, "--set", "thermal.ambient_temperature=24.0", *words, "--out", path, "--force")
    return path


def second_round(wire: str, physics: str) -> list[Path]:
    """The logs of the wire as the model of the first round drives it."""
    first, folder = folder_of(wire, physics), _second(wire, physics)
    if not (folder / "complete").is_file():
        node = _init(_model(wire, physics, "first_round"), folder / "node.yaml")
        followed = PlanOptions(follow=str(node), skip=SKIPPED)
        done = float((first / "complete").read_text(encoding="utf-8"))
        cycles = _characterised(wire, physics, first / "logs" / BENCH_FILE, followed, 3, folder / "logs", done)
        (folder / "complete").write_text(f"{cycles:g}\n", encoding="utf-8")
    return sorted((folder / "logs").glob("*.csv"))


def _second(wire: str, physics: str) -> Path:
    return folder_of(wire, physics) / f"second_{digest(SECOND_BY)}"


def cycles_done(wire: str, physics: str) -> float:
    """How many cycles it has done when it is driven."""
    return float((_second(wire, physics) / "complete").read_text(encoding="utf-8"))


def _model(wire: str, physics: str, model: str) -> Path:
    """What ``identify`` writes."""
    logs, first = logs_of(wire, physics), folder_of(wire, physics)
    folder = first
    if model == "whole_range":
        logs, folder = [*logs, *second_round(wire, physics)], _second(wire, physics)
    path = folder / f"{model}_{digest(MODELS_BY)}.yaml"
    if not path.is_file():
        name = alloy_of(wire) if model == "thesis" else "whole_range"
        bench_path = first / "logs" / BENCH_FILE
        command("identify", *logs, "--config", bench_path, "--model", name, "--jobs", 1, "--out", path)
    return path


def identified(wire: str, physics: str, model: str = "whole_range") -> dict[str, Any]:
    """The parameters that a node drives the wire with: its model, and what ``init`` adds to it."""
    path = _model(wire, physics, model)
    with tempfile.TemporaryDirectory(prefix="sma_users_way_") as scratch:
        return read_parameter_file(_init(path, Path(scratch) / "node.yaml"))


def prepare(job: tuple[str, str, Sequence[str]]) -> None:
    """Have a wire (alloy, physics, models) identified; apart, so that no two processes make the same."""
    wire, physics, models = job
    second_round(wire, physics)
    for model in models:
        identified(wire, physics, model)


def prepared(
    wires: Sequence[tuple[str, str, Sequence[str]]], run_one: Callable[[Any], Any], cases: Sequence[Any], jobs: int
) -> list[Any]:
    """What each case comes to, once the models of all wires (alloy, physics, models) are there; in so many
    processes."""
    if jobs == 1:
        for wire in wires:
            prepare(wire)
        return [run_one(case) for case in cases]
    with ProcessPoolExecutor(jobs) as pool:
        list(pool.map(prepare, wires))
        return list(pool.map(run_one, cases))


def replayed(wire: str, physics: str, model: str = "whole_range") -> tuple[float, float]:
    """Of logs that were not fitted: mean absolute error [% of full stroke], and the share within the 95 % intervals."""
    config = Config.from_mapping(identified(wire, physics, model))
    errors_m, inside = [], []
    for path in sorted((folder_of(wire, physics) / "unseen").glob("*.csv")):
        experiment = make_experiment(read_bench_log(path), config)
        found = Chain(config).run(experiment.signals)
        errors_m.append(np.abs(found.displacement_m - experiment.displacement_m))
        inside.append(errors_m[-1] <= found.uncertainty_m + unknown_since_then_m(config.calibration.training))
    return (
        float(np.nanmean(np.concatenate(errors_m))) / config.wire.full_stroke_m * 100.0,
        float(np.mean(np.concatenate(inside))),
    )


def stroke_of(wire: str, physics: str, load: Load) -> tuple[float, float]:
    """Where the wire truly ends under a load, contracted and cold [m]; under one that changes, what all of it share."""
    loads = [each for _, each in load.steps] if isinstance(load, Schedule) else [load]
    ends_m = [_ends_m(wire, physics, each) for each in loads]
    return max(hot_m for hot_m, _ in ends_m), min(cold_m for _, cold_m in ends_m)


@functools.cache
def _ends_m(wire: str, physics: str, load: Load) -> tuple[float, float]:
    bench = bench_of(wire, physics, cycles_done(wire, physics), 1, load)
    bench.supply.set_voltage(20.0)
    bench.supply.set_output(True)
    bias_A = read_parameter_file(folder_of(wire, physics) / "bench.yaml")["supply"]["bias_current"]
    current_A = _FROM_BIAS * bias_A
    while bench.hottest_C < HOT_C and bench.time_s < LONGEST_s:
        bench.supply.set_current(current_A)
        bench.advance(bench.time_s + 0.25)
        current_A *= 1.02
    hot_m = bench.truth.displacement_m
    bench.supply.set_current(bias_A)
    bench.advance(bench.time_s + COOL_s)
    return hot_m, bench.truth.displacement_m
