"""A calibrated wire and sessions on a bench in which something is hidden, for the tests of this folder."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import yaml

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, Schedule, VirtualBench, VirtualClock, Weight
from sma_actuator.bench.hidden.hiding import HiddenBench
from sma_actuator.characterise import PlanOptions, Rig, characterise, make_plan
from sma_actuator.characterise.operators import BenchOperator
from sma_actuator.characterise.plan import default_heat_current_A
from sma_actuator.characterise.programs import Drive
from sma_actuator.config import NODE_NAME, bench_from_mapping, read_parameter_file
from sma_actuator.identify import identify
from sma_actuator.logs.bench_log import BenchLog, read_bench_log, write_bench_log

WIRE = "furukawa"
LOG_s, PAUSE_s = 150.0, 30.0
STEPS = Schedule(
    [(0.0, Weight(0.98)), (35.0, Weight(1.96)), (80.0, Weight(0.6)), (210.0, Weight(1.5)), (260.0, Weight(0.98))]
)


def calibrated():
    """(bench's parameters, model's parameters) of a short characterisation."""
    mapping = read_parameter_file(shared_file(f"config/{WIRE}_bench.yaml"))
    config = bench_from_mapping(mapping)
    bench = VirtualBench.from_name(WIRE, seed=1)
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    operator = BenchOperator(bench, config.wire.max_stress * config.wire.area_m2, config.wire.full_stroke_m)
    options = PlanOptions(
        loads_N=(0.5, 0.98, 2.0),
        pulses=2,
        set_points=3,
        average_s=1.0,
        masses_kg=(0.02, 0.1, 0.2),
        skip=("training", "fatigue"),
    )
    with tempfile.TemporaryDirectory(prefix="sma_trace_") as folder:
        characterise(mapping, make_plan(config, options), rig, operator, Path(folder))
        logs = [read_bench_log(path) for path in sorted(Path(folder).glob("p*.csv"))]
        bench_mapping = read_parameter_file(Path(folder) / "bench.yaml")
    return bench_mapping, identify(logs, bench_mapping, WIRE).mapping


#: Sessions that were driven in this process: most tests look at one of a few.
_DRIVEN: dict[str, list[BenchLog]] = {}


def session(bench_mapping, hidden=None, load=STEPS, seed=5, logs=2, heat=1.0, smooth=False):
    """Bench logs of one session: pulses that settle at both ends, then partial ones; heated with ``heat`` of the usual
    current.  ``smooth``: a sine that never comes down to the bias.  They are everybody's: change a copy."""
    what = repr((bench_mapping, hidden, load, seed, logs, heat, smooth))
    if what not in _DRIVEN:
        _DRIVEN[what] = _driven(bench_mapping, hidden, load, seed, logs, heat, smooth)
    return [*_DRIVEN[what]]


def _driven(bench_mapping, hidden, load, seed, logs, heat, smooth):
    config = bench_from_mapping(bench_mapping)
    whole_s = logs * LOG_s + (logs - 1) * PAUSE_s
    bench = HiddenBench.from_name(WIRE, seed=seed, load=load, hidden=hidden or {}, session_s=whole_s)
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    out = []
    with rig.opened():
        for number in range(logs):
            bench.advance(number * (LOG_s + PAUSE_s))
            currents_A = _sine_A(config) if smooth else _currents_A(config, seed + number, heat)
            # Loads change on purpose, and a sense resistor that warms drifts: a session goes on as on others' benches.
            drives = (Drive(float(current_A)) for current_A in currents_A)
            log = rig.record(drives, but=("load_spike", "current_drifts"))
            columns = dict(log.columns)
            columns["time_s"] = columns["time_s"] + (bench.time_s - columns["time_s"][-1])
            out.append(BenchLog(columns, {}, f"session_{number + 1}.csv"))
    return out


def write(logs, folder):
    """Write the logs; returns their paths as text."""
    paths = [folder / log.name for log in logs]
    for path, log in zip(paths, logs, strict=True):
        write_bench_log(path, log)
    return [str(path) for path in paths]


def write_model(mapping, path):
    """Write a parameter file; returns its path as text."""
    path.write_text(yaml.safe_dump({NODE_NAME: {"ros__parameters": mapping}}, sort_keys=False, allow_unicode=True))
    return str(path)


def _sine_A(config):
    low, high, rate = config.supply.bias_current, default_heat_current_A(config), config.loop.rate
    time_s = np.arange(round(LOG_s * rate)) / rate
    slow_s = config.thermal.heat_capacity / config.thermal.heat_loss
    current_A = high * (0.75 - 0.2 * np.cos(2.0 * np.pi * time_s / (8.0 * slow_s)))
    return np.where(time_s < 2.0, low, current_A)


def _currents_A(config, seed, heat):
    rng = np.random.default_rng(seed)
    low, high, rate = config.supply.bias_current, heat * default_heat_current_A(config), config.loop.rate
    slow_s = config.thermal.heat_capacity / config.thermal.heat_loss
    parts = [(low, 2.0)]
    for _ in range(2):
        parts += [(high, 5.0 * slow_s), (low, 8.0 * slow_s)]
    for _ in range(8):
        parts += [
            (high * rng.uniform(0.92, 1.0), rng.uniform(0.6, 1.8) * slow_s),
            (low, rng.uniform(0.8, 2.5) * slow_s),
        ]
    current_A = np.concatenate([np.full(round(s * rate), level) for level, s in parts])
    n = round(LOG_s * rate)
    return np.concatenate((current_A, np.full(max(n - len(current_A), 0), low)))[:n]
