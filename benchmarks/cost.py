"""What one sample costs: chain, controller, drift guards and whole actuator beside simple-pid's call, in one run.

    python benchmarks/cost.py [--against CHECKOUT] [--json FILE]     (make benchmarks)

They take turns, so that a machine that slows down slows down all of them; the ratios are to be trusted, the
microseconds only on this machine.  A loop rests between its steps, and others have the processor and its caches
meanwhile: so each is timed after such a rest as well.  ``--against``: another checkout of this repository takes turns
with this one, each in a process of its own, and what is told is the ratio of this one's times to that one's.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from simple_pid import PID

from sma_actuator.actuator import Actuator
from sma_actuator.base.jit import COMPILED
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Reading, SupplyState
from sma_actuator.config import Config
from sma_actuator.control.pid import PidController
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.circuit import signals_from_reading
from sma_actuator.safety.drift import CurrentsApart, VoltagesApart

ROOT = Path(__file__).resolve().parents[1]
CALLS = 2000
ROUNDS = 15
RESTS, REST_s = 200, 0.01  #: so often each is called after so long, as in a loop of 100 Hz
PAIRS = 5  #: of processes, with another checkout
DIGIT_V = 1e-3  #: of the supply's voltmeter


def main() -> int:
    """Time each call and print it beside simple-pid's, or beside another checkout's."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, metavar="CHECKOUT")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    rows = beside(args.against.resolve()) if args.against else alone()
    if args.json:
        args.json.write_text(json.dumps(rows, indent=2) + "\n")
    return 0


def beside(other: Path) -> dict[str, dict[str, float]]:
    """Times of each call here over those in another checkout, pair by pair of processes."""
    pairs = [(_in_checkout(ROOT), _in_checkout(other)) for _ in range(PAIRS)]
    print(f"median, least and most of {PAIRS} pairs: this checkout over {other.name}")
    rows = {}
    for name in pairs[0][0]:
        ratios = [here[name]["us_per_call"] / there[name]["us_per_call"] for here, there in pairs]
        rows[name] = {"ratio": statistics.median(ratios), "least": min(ratios), "most": max(ratios)}
        print(f"{name:22s} {rows[name]['ratio']:6.2f}   {min(ratios):.2f} to {max(ratios):.2f}")
    return rows


def _in_checkout(checkout: Path) -> dict[str, dict[str, float]]:
    """What this file says of a checkout."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cost.json"
        words = [sys.executable, __file__, "--json", str(file)]
        environment = {**os.environ, "PYTHONPATH": str(checkout)}
        subprocess.run(words, cwd=checkout, env=environment, stdout=subprocess.DEVNULL, check=True)
        return json.loads(file.read_text())


def alone() -> dict[str, dict[str, float]]:
    """Times of each call, and over simple-pid's."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    rng = np.random.default_rng(0)
    count = CALLS * ROUNDS + RESTS
    current_A = 0.15 + 0.05 * np.sin(np.arange(count) / 50.0)
    resistance_Ohm = 5.0 + 0.2 * np.cos(np.arange(count) / 50.0) + 1e-3 * rng.standard_normal(count)
    readings = [
        Reading(0.05 * i, float(a * (r + 1.25)), float(a), 0.081 + 1e-5 * float(n), 0.015, 22.0)
        for i, (a, r, n) in enumerate(zip(current_A, resistance_Ohm, rng.standard_normal(count)))
    ]
    signals = [signals_from_reading(reading, config) for reading in readings]
    lo_m, hi_m = config.model.build(config.wire).displacement_range_m
    positions_m = rng.uniform(lo_m, hi_m, count).tolist()
    setpoint_m = (lo_m + hi_m) / 2.0

    peer = PID(800.0, 400.0, 100.0, setpoint=setpoint_m, sample_time=None, output_limits=(0.05, 0.4))
    controller = PidController(config.controller, config.supply.bias_current)
    chain, actuator = Chain(config), Actuator(config)
    actuator.step(0.0, readings[0], SupplyState(0.0, 0.0, False, 0.0, 0.0))
    actuator.enable(0.0, True)

    told = SupplyState(0.0, 0.0, False, 0.0, 0.0)

    def whole(i: int) -> None:
        # Readings that follow the command, else the supervisor would rightly switch off.
        nonlocal told
        a, noise_V = told.current_setting_A, readings[i].load_cell_voltage_V - 0.081
        voltage_V = a * float(resistance_Ohm[i] + 1.25)
        reading = Reading(0.05 * i, voltage_V + noise_V, a + noise_V, 0.081 + noise_V, 0.015, 22.0)
        shown_V = DIGIT_V * round(voltage_V / DIGIT_V)
        command = actuator.step(0.05 * i, reading, SupplyState(0.05 * i, a, told.output_on, shown_V, a)).command
        told = SupplyState(0.05 * i, command.current_A, command.output_on, shown_V, command.current_A)

    currents, voltages = CurrentsApart(), VoltagesApart()

    def apart(i: int) -> None:
        a = readings[i].reference_voltage_V
        currents.step(0.05 * i, a, a, a, 0.015)
        voltages.step(0.05 * i, a, readings[i].supply_voltage_V, DIGIT_V * round(6.3 * a / DIGIT_V), 0.015)

    calls = {
        "simple-pid call": lambda i: peer(positions_m[i], dt=0.05),
        "controller": lambda i: controller.step(positions_m[i], setpoint_m, 0.05, 0.4),
        "chain": lambda i: chain.step(signals[i]),
        "drift guards": apart,
        "actuator, all of it": whole,
    }
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(ROUNDS):
        for name, call in calls.items():
            first = turn * CALLS
            start_s = time.thread_time()
            for i in range(first, first + CALLS):
                call(i)
            seconds[name].append((time.thread_time() - start_s) / CALLS)
    rested: dict[str, list[float]] = {name: [] for name in calls}
    for i in range(CALLS * ROUNDS, count):
        for name, call in calls.items():
            time.sleep(REST_s)
            start_s = time.thread_time()
            call(i)
            rested[name].append(time.thread_time() - start_s)
    assert told.output_on, "the wire was not driven to the end"
    base = seconds["simple-pid call"]
    rows = {
        name: {
            "us_per_call": 1e6 * statistics.median(times),
            "ratio_to_simple_pid": statistics.median(t / b for t, b in zip(times, base)),
            "us_after_a_rest": 1e6 * statistics.median(rested[name]),
            "ratio_after_a_rest": statistics.median(t / b for t, b in zip(rested[name], rested["simple-pid call"])),
        }
        for name, times in seconds.items()
    }
    print(
        f"median of {ROUNDS} turns of {CALLS} calls; of {RESTS} after a rest of {1e3 * REST_s:g} ms; kernels "
        f"{'compiled by numba' if COMPILED else 'in plain Python'}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} "
        f"processors"
    )
    for name, row in rows.items():
        print(
            f"{name:22s} {row['us_per_call']:8.2f} µs   {row['ratio_to_simple_pid']:6.2f} × simple-pid   after a rest "
            f"{row['us_after_a_rest']:8.2f} µs   {row['ratio_after_a_rest']:6.2f} ×"
        )
    return rows


if __name__ == "__main__":
    raise SystemExit(main())
