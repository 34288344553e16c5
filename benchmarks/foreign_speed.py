"""Time to identify and to trace logs of a foreign physics, and how it grows with the samples.

    python benchmarks/foreign_speed.py [--samples N …] [--model TYPE …] [--json FILE]     (make foreign-speed)

Ten logs (pulses and partial cycles at five weights) of a Ni-Ti wire in the physics that no model was made on, as
``sma-actuator characterise --virtual`` would write them, all of so many samples: N, 2 N and 4 N by reading N, 2 N
and 4 N times as often.  ``identify`` runs on them; ``trace`` on ten more, of another seed, whose voltage channel has a
zero error.  Everything on two cores, from logs in memory to the result; the kernels are compiled before.
"""

from __future__ import annotations

import argparse
import copy
import json
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock, Weight
from sma_actuator.bench.hidden import HiddenBench
from sma_actuator.characterise import Rig
from sma_actuator.characterise.plan import default_heat_current_A
from sma_actuator.characterise.programs import Drive
from sma_actuator.config import bench_from_mapping, read_parameter_file
from sma_actuator.diagnosis.trace import Evidence, trace
from sma_actuator.identify import identify
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.files import write_atomically

LOADS_N = (0.35, 0.6, 0.98, 1.5, 2.1)
HIDDEN = {"voltage_offset": 0.006}
SAMPLES, RATE_Hz = 10_000, 20.0
JOBS = 2


def current_A(config, partial: bool, seconds: float, rate_Hz: float, seed: int) -> np.ndarray:
    """Full pulses, or pulses that turn back early, at every reading."""
    rng = np.random.default_rng(seed)
    low_A, high_A = config.supply.bias_current, default_heat_current_A(config)
    slow_s = config.thermal.heat_capacity / config.thermal.heat_loss
    parts, length_s = [np.full(round(3.0 * rate_Hz), low_A)], 3.0
    while length_s < seconds:
        hot_s, cold_s = (rng.uniform(0.6, 1.8), rng.uniform(0.6, 2.2)) if partial else (5.0, 8.0)
        level_A = high_A * rng.uniform(0.85, 1.0) if partial else high_A
        parts += [np.full(round(hot_s * slow_s * rate_Hz), level_A), np.full(round(cold_s * slow_s * rate_Hz), low_A)]
        length_s += (hot_s + cold_s) * slow_s
    return np.concatenate(parts)[: round(seconds * rate_Hz)]


def ten_logs(samples: int, seed: int, hidden: dict[str, float]) -> tuple[list[BenchLog], dict]:
    """The logs, and the bench's parameters."""
    mapping = copy.deepcopy(read_parameter_file(shared_file("config/flexinol_bench.yaml")))
    rate_Hz = RATE_Hz * max(1.0, samples / SAMPLES)
    seconds = samples / rate_Hz
    mapping.setdefault("loop", {})["rate"] = rate_Hz
    config = bench_from_mapping(mapping)
    logs = []
    for number, load_N in enumerate(LOADS_N):
        for partial in (False, True):
            bench = HiddenBench.from_name(
                "flexinol", seed + number, Weight(load_N), physics="foreign", hidden=hidden, session_s=seconds
            )
            rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
            with rig.opened():
                drive = current_A(config, partial, seconds, rate_Hz, seed + number)
                log = rig.record(Drive(float(c)) for c in drive)
            name = f"{'partial' if partial else 'pulses'}_{load_N:.2f}N.csv"
            logs.append(BenchLog(log.columns, {}, name))
    return logs, mapping


def timed(work, *arguments, **options):
    """Seconds, and the answer."""
    begun = time.perf_counter()
    answer = work(*arguments, **options)
    return time.perf_counter() - begun, answer


def main() -> int:
    """Measure and print; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, nargs="+", default=[SAMPLES, 2 * SAMPLES, 4 * SAMPLES])
    parser.add_argument("--model", nargs="+", default=["flexinol", "whole_range"])
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    console = Console(width=150)
    table = Table(title=f"ten logs of a foreign physics, {JOBS} cores [s]")
    for header in ("model", "samples of a log", "identify", "trace", "verdict"):
        table.add_column(header, justify="right")
    small, mapping = ten_logs(2500, 1, {})
    rows = []
    for model in args.model:
        compiled = identify(small, mapping, model)  # before the clock runs
        trace(Evidence(small, compiled.config), jobs=1, only=["voltage_offset"])
    for samples in args.samples:
        calibration, mapping = ten_logs(samples, 1, {})
        later, _ = ten_logs(samples, 100, HIDDEN)
        for model in args.model:
            identify_s, found = timed(identify, calibration, mapping, model)
            evidence_s, evidence = timed(Evidence, later, found.config)
            trace_s, tracing = timed(trace, evidence, jobs=JOBS)
            trace_s += evidence_s
            names = " + ".join(tracing.fit.names) if tracing.fit else ""
            row = {"model": model, "samples": samples, "identify_s": identify_s, "trace_s": trace_s}
            rows.append({**row, "verdict": tracing.verdict, "effects": names})
            table.add_row(
                model, f"{samples}", f"{identify_s:.1f}", f"{trace_s:.1f}", f"{tracing.verdict} {names}".strip()
            )
    console.print(table)
    if args.json:
        write_atomically(args.json, lambda stream: stream.write((json.dumps(rows, indent=1) + "\n").encode()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
