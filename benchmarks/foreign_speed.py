"""Time to identify and to trace logs of a foreign physics, and how it grows with the samples.

    python benchmarks/foreign_speed.py [--samples N …] [--model TYPE …] [--json FILE]     (make foreign-speed)

Ten logs (pulses and partial cycles at five weights) of a Ni-Ti wire in a physics that no model was made on.  They are
read at the highest of the rates asked for, and every second or fourth reading is taken for the others.  ``identify``
runs on them, ``trace`` on the same logs with a zero error added to the voltage channel.  Stated are seconds of one
core, from logs in memory to the result, so that what else the machine does has no part in it; the kernels are compiled
before.
"""

from __future__ import annotations

import argparse
import copy
import dataclasses
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock, Weight
from sma_actuator.characterise import Rig
from sma_actuator.characterise.plan import default_heat_current_A
from sma_actuator.characterise.programs import Drive
from sma_actuator.config import bench_from_mapping, read_parameter_file
from sma_actuator.console import write_json
from sma_actuator.diagnosis.extension import extend
from sma_actuator.diagnosis.trace import Evidence, trace
from sma_actuator.identify import identify
from sma_actuator.identify.fitters import FITTERS
from sma_actuator.logs.bench_log import BenchLog

LOADS_N = (0.35, 0.6, 0.98, 1.5, 2.1)
OFFSET_V = 0.006
SAMPLES, RATE_Hz = 10_000, 20.0


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


def ten_logs(samples: int) -> tuple[list[BenchLog], dict]:
    """The logs, and the bench's parameters."""
    mapping = copy.deepcopy(read_parameter_file(shared_file("config/flexinol_bench.yaml")))
    rate_Hz = RATE_Hz * max(1.0, samples / SAMPLES)
    mapping["loop"] = {**mapping.get("loop", {}), "rate": rate_Hz, "samples_per_block": round(500.0 / rate_Hz)}
    config = bench_from_mapping(mapping)
    logs = []
    for number, load_N in enumerate(LOADS_N):
        for partial in (False, True):
            bench = VirtualBench.from_name("flexinol", number, Weight(load_N), physics="foreign")
            rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
            with rig.opened():
                drive = current_A(config, partial, samples / rate_Hz, rate_Hz, number)
                log = rig.record(Drive(float(c)) for c in drive)
            name = f"{'partial' if partial else 'pulses'}_{load_N:.2f}N.csv"
            logs.append(BenchLog(log.columns, {}, name))
    return logs, mapping


def seldom(logs: list[BenchLog], every: int) -> list[BenchLog]:
    """Every so many readings."""
    return [dataclasses.replace(log, columns={n: v[::every] for n, v in log.columns.items()}) for log in logs]


def off(logs: list[BenchLog]) -> list[BenchLog]:
    """The same, measured by a voltage channel with a zero error."""
    return [
        dataclasses.replace(log, columns={**log.columns, "supply_voltage_V": log["supply_voltage_V"] + OFFSET_V})
        for log in logs
    ]


def identified(logs: list[BenchLog], mapping: dict, model: str):
    """What the command ``identify`` makes of logs, with the search for what the model lacks."""
    result = identify(logs, mapping, model)
    return extend(result, jobs=1).result if FITTERS[model].extended else result


def timed(work, *arguments, **options):
    """Seconds of one core, and the answer."""
    begun = time.process_time()
    answer = work(*arguments, **options)
    return time.process_time() - begun, answer


def main() -> int:
    """Measure and print; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, nargs="+", default=[SAMPLES, 2 * SAMPLES, 4 * SAMPLES])
    parser.add_argument("--model", nargs="+", default=["flexinol", "whole_range"])
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    console = Console(width=150)
    table = Table(title="ten logs of a foreign physics, seconds of one core")
    for header in ("model", "samples of a log", "identify", "trace", "verdict"):
        table.add_column(header, justify="right")
    rows = []
    most = max(args.samples)
    all_logs, mapping = ten_logs(most)
    few = seldom(all_logs, most // 2500)
    for model in args.model:
        compiled = identified(few, mapping, model)  # before the clock runs
        trace(Evidence(off(few), compiled.config), jobs=1, only=["voltage_offset"])
    for samples in args.samples:
        logs = seldom(all_logs, most // samples)
        for model in args.model:
            identify_s, found = timed(identified, logs, mapping, model)
            evidence_s, evidence = timed(Evidence, off(logs), found.config)
            trace_s, tracing = timed(trace, evidence, jobs=1)
            trace_s += evidence_s
            names = " + ".join(tracing.fit.names) if tracing.fit else ""
            row = {"model": model, "samples": samples, "identify_s": identify_s, "trace_s": trace_s}
            rows.append({**row, "verdict": tracing.verdict, "effects": names})
            table.add_row(
                model, f"{samples}", f"{identify_s:.1f}", f"{trace_s:.1f}", f"{tracing.verdict} {names}".strip()
            )
    console.print(table)
    write_json(args, rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
