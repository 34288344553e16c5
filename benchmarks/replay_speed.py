"""Speed of replay and identification, memory of a long log; everything in one run.

    python benchmarks/replay_speed.py [--json FILE]

Samples per second of each model on one core, beside the thesis's forward step as a plain Python
loop; the whole estimator (branch, model, velocity, quality) beside both; the time to identify both
wires from ten logs; and the memory and time to read a log of ten million rows.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from forward_step import forward_step
from replay_tables import CALIBRATION, logs_of
from rich.console import Console
from rich.table import Table

from sma_actuator.base.jit import COMPILED
from sma_actuator.base.signals import Signals
from sma_actuator.console import write_json
from sma_actuator.estimation.chain import Chain
from sma_actuator.identify import identify
from sma_actuator.logs.bench_log import BenchLog, write_bench_log
from sma_actuator.logs.experiments import make_experiment

SAMPLES = 4_000_000
LOOP_SAMPLES = 200_000
LONG_ROWS = 10_000_000
LOGS = 10

_READ = """
import sys, time
from sma_actuator.logs.bench_log import read_bench_log

def peak_kB():
    # ru_maxrss would begin at the parent's size
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))

before = peak_kB()
start = time.perf_counter()
log = read_bench_log(sys.argv[1])
seconds = time.perf_counter() - start
print(seconds, (peak_kB() - before) * 1024, sum(v.nbytes for v in log.columns.values()))
"""


def best_of(times: int, function: Callable[..., object], *arguments: object) -> float:
    """Shortest time of several calls [s], after one to warm up."""
    function(*arguments)
    durations = []
    for _ in range(times):
        start = time.perf_counter()
        function(*arguments)
        durations.append(time.perf_counter() - start)
    return min(durations)


def repeated(array: np.ndarray, n: int) -> np.ndarray:
    """``n`` samples of an array, over and over."""
    return np.ascontiguousarray(np.resize(array, n))


def main() -> int:
    """Measure and print; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every number here")
    args = parser.parse_args()
    console = Console(width=100)
    numbers: dict[str, float] = {"compiled": float(COMPILED), "cores": float(os.cpu_count() or 1)}
    table = Table(title=f"Replay on one core ({'numba' if COMPILED else 'plain Python: numba is not installed'})")
    for header in ("what", "million samples/s", "× the plain loop"):
        table.add_column(header, justify="left" if header == "what" else "right")
    loop_rate = 0.0
    for wire in ("flexinol", "furukawa"):
        logs, mapping = logs_of(wire, CALIBRATION, seed=1)
        ten = logs[:LOGS]
        start = time.perf_counter()
        result = identify(ten, mapping, wire)
        numbers[f"identify {wire} from {len(ten)} logs, s"] = time.perf_counter() - start
        experiment = make_experiment(logs[0], result.config)
        columns = [repeated(a, SAMPLES) for a in (experiment.resistance_Ohm, experiment.stress_Pa, experiment.heating)]
        if wire == "flexinol":
            short = [list(c[:LOOP_SAMPLES]) for c in columns]
            loop_rate = LOOP_SAMPLES / best_of(1, forward_step, *short, result.config.model)
            numbers["plain loop of the forward step, samples/s"] = loop_rate
            table.add_row("thesis's forward step, plain Python loop", f"{loop_rate / 1e6:.3f}", "1")
        for model_type in (wire, f"{wire}_normalised"):
            fitted = result if model_type == wire else identify(ten, mapping, model_type, order=2)
            model = fitted.config.model.build(fitted.config.wire)
            model.reset(float(columns[0][0]), float(columns[1][0]))
            rate = SAMPLES / best_of(3, model.run, *columns)
            numbers[f"{model_type}, samples/s"] = rate
            table.add_row(model_type, f"{rate / 1e6:.1f}", f"{rate / loop_rate:.0f}")
        signals = Signals(
            time_s=np.arange(SAMPLES) * 0.05,
            current_A=repeated(experiment.signals.current_A, SAMPLES),
            power_W=repeated(experiment.signals.power_W, SAMPLES),
            load_N=repeated(experiment.signals.load_N, SAMPLES),
            resistance_Ohm=columns[0],
            stress_Pa=columns[1],
        )
        rate = SAMPLES / best_of(3, lambda config, x: Chain(config).run(x), result.config, signals)
        numbers[f"{wire} whole estimator, samples/s"] = rate
        table.add_row(f"{wire}, whole estimator", f"{rate / 1e6:.1f}", f"{rate / loop_rate:.0f}")
    console.print(table)
    for name, value in numbers.items():
        if name.startswith("identify"):
            console.print(f"{name}: {value:.1f}")
    long_log(console, numbers)
    write_json(args, numbers)
    return 0


def long_log(console: Console, numbers: dict[str, float]) -> None:
    """Read ten million rows in a process of its own, and see how large it grows."""
    with tempfile.TemporaryDirectory(prefix="sma_speed_") as folder:
        path = Path(folder) / "long.csv"
        random = np.random.default_rng(0)
        names = {
            "supply_voltage_V": 3.0,
            "reference_voltage_V": 0.3,
            "load_cell_voltage_V": 0.2,
            "lvdt_current_A": 0.01,
            "current_command_A": 0.3,
        }
        columns = {"time_s": np.arange(LONG_ROWS) * 0.001}
        columns.update({n: mean * (1 + 0.01 * random.standard_normal(LONG_ROWS)) for n, mean in names.items()})
        write_bench_log(path, BenchLog(columns))
        size = path.stat().st_size
        answer = subprocess.run([sys.executable, "-c", _READ, str(path)], capture_output=True, text=True, check=True)
    seconds, grown, needed = (float(word) for word in answer.stdout.split())
    numbers.update({"long log, read s": seconds, "long log, memory B": grown, "long log, columns B": needed})
    console.print(
        f"reading {LONG_ROWS / 1e6:.0f} million rows ({size / 1e6:.0f} MB): {seconds:.1f} s, {grown / 1e6:.0f} MB, "
        f"{grown / needed:.2f} times the {needed / 1e6:.0f} MB of its columns"
    )


if __name__ == "__main__":
    raise SystemExit(main())
