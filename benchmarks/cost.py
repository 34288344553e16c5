"""What one sample costs: chain, controller, drift guards and whole actuator beside simple-pid's call, in one run.

    python benchmarks/cost.py [--pieces | --against CHECKOUT] [--json FILE]     (make benchmarks)

They take turns, so that a machine that slows down slows down all of them; the ratios are to be trusted, the
microseconds only on this machine.  A loop rests between its steps, and others have the processor and its caches
meanwhile: so each is timed after such a rest as well.  ``--against``: another checkout of this repository takes turns
with this one, each in a process of its own, and what is told is the ratio of this one's times to that one's.
``--pieces``: of what the whole step consists, each guard by itself.
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
from collections.abc import Callable
from pathlib import Path

import numpy as np
from simple_pid import PID

from sma_actuator.actuator import Actuator
from sma_actuator.base.jit import COMPILED
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Reading, SupplyState
from sma_actuator.config import Config
from sma_actuator.console import write_json
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
    parser.add_argument("--pieces", action="store_true", help="of what the whole step consists")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    rows = pieces() if args.pieces else beside(args.against.resolve()) if args.against else alone()
    write_json(args, rows)
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


class Driven:
    """An actuator that is driven on readings that follow its command, else the supervisor would rightly switch off."""

    def __init__(self, config: Config, count: int):
        rng = np.random.default_rng(0)
        self.current_A = 0.15 + 0.05 * np.sin(np.arange(count) / 50.0)
        self.resistance_Ohm = 5.0 + 0.2 * np.cos(np.arange(count) / 50.0) + 1e-3 * rng.standard_normal(count)
        self.readings = [
            Reading(0.05 * i, float(a * (r + 1.25)), float(a), 0.081 + 1e-5 * float(n), 0.015, 22.0)
            for i, (a, r, n) in enumerate(zip(self.current_A, self.resistance_Ohm, rng.standard_normal(count)))
        ]
        self.actuator = Actuator(config)
        self.sensor = config.reference_sensor
        self.told = SupplyState(0.0, 0.0, False, 0.0, 0.0)
        self.said = self.actuator.step(0.0, self.readings[0], self.told)
        self.actuator.enable(0.0, True)

    def step(self, i: int) -> None:
        """The whole step of that number."""
        a, noise_V = self.told.current_setting_A, self.readings[i].load_cell_voltage_V - 0.081
        voltage_V = a * float(self.resistance_Ohm[i] + 1.25)
        # where the wire is estimated to be, else the displacement sensor would contradict that
        lvdt_A = (self.said.estimate.displacement_m - self.sensor.offset) / self.sensor.slope
        reading = Reading(0.05 * i, voltage_V + noise_V, a + noise_V, 0.081 + noise_V, lvdt_A, 22.0 + noise_V)
        shown_V = DIGIT_V * round(voltage_V / DIGIT_V)
        state = SupplyState(0.05 * i, a, self.told.output_on, shown_V, a)
        self.said = self.actuator.step(0.05 * i, reading, state)
        command = self.said.command
        self.told = SupplyState(0.05 * i, command.current_A, command.output_on, shown_V, command.current_A)

    def check(self) -> None:
        """Raise AssertionError where it was not driven to the end, or something is wrong: the words of a fault take
        time."""
        assert self.told.output_on, self.said.status.message
        assert not self.said.status.fault, self.said.status.message


def pieces() -> dict[str, dict[str, float]]:
    """Times of the pieces of a step, then of what the largest consist of, less what it takes to time one."""
    print(f"median of {CALLS} steps in a row; of {RESTS} after a rest of {1e3 * REST_s:g} ms; {_circumstances()}")
    rows = {}
    for inside in (False, True):  # one inside the other would be timed with it
        rows |= _pieces(inside)
    return rows


def _pieces(inside: bool) -> dict[str, dict[str, float]]:
    driven, seconds = Driven(Config.load(shared_file("config/flexinol.yaml")), 2 * CALLS + RESTS), {}

    def timed(name: str, call: Callable) -> Callable:
        times = seconds.setdefault(name, [])

        def run(*args: object) -> object:
            start_s = time.perf_counter()
            said = call(*args)
            times.append(time.perf_counter() - start_s)
            return said

        return run

    actuator = driven.actuator
    supervisor, following = actuator._supervisor, actuator._following
    if inside:
        parts = [
            (actuator._chain, "step", "chain"),
            (actuator._uncertainty, "step", "interval of the estimate"),
            (following, "sense", "heat of the law, stress"),
            (actuator._health, "step", "health of the model"),
        ]
        supervisor._looks = [timed(one.name, one.look) for one in supervisor._guards]
    else:
        parts = [
            (actuator, "_sense", "signals and estimate"),
            (supervisor, "keep_heat", "heat of the wire"),
            (supervisor, "inspect", "guards"),
            (following, "find_the_ends", "ends of the way"),
            (following, "wanted", "setpoint and law"),
            (supervisor, "limit_A", "limit of the current"),
            (supervisor, "gate", "gate"),
            (actuator, "_output", "status and output"),
        ]
    for of, method, name in parts:
        setattr(of, method, timed(name, getattr(of, method)))
    nothing = timed("nothing", lambda: None)

    def steps(numbers: range, rest_s: float) -> dict[str, float]:
        for times in seconds.values():
            times.clear()
        for i in numbers:
            if rest_s:
                time.sleep(rest_s)
            driven.step(i)
            nothing()
        driven.check()
        none_s = statistics.median(seconds["nothing"])
        return {name: 1e6 * (statistics.median(times) - none_s) for name, times in seconds.items()}

    steps(range(1, CALLS), 0.0)  # warm
    in_a_row, rested = steps(range(CALLS, 2 * CALLS), 0.0), steps(range(2 * CALLS, 2 * CALLS + RESTS), REST_s)
    del in_a_row["nothing"]
    for name, us in in_a_row.items():
        print(f"{name:26s} {us:8.2f} µs   after a rest {rested[name]:8.2f} µs")
    return {name: {"us": us, "us_after_a_rest": rested[name]} for name, us in in_a_row.items()}


def _circumstances() -> str:
    return (
        f"kernels {'compiled by numba' if COMPILED else 'in plain Python'}; load {os.getloadavg()[0]:.1f} on "
        f"{os.cpu_count()} processors"
    )


def alone() -> dict[str, dict[str, float]]:
    """Times of each call, and over simple-pid's."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    count = CALLS * ROUNDS + RESTS
    driven = Driven(config, count)
    readings = driven.readings
    signals = [signals_from_reading(reading, config) for reading in readings]
    lo_m, hi_m = config.model.build(config.wire).displacement_range_m
    positions_m = np.random.default_rng(1).uniform(lo_m, hi_m, count).tolist()
    setpoint_m = (lo_m + hi_m) / 2.0

    peer = PID(800.0, 400.0, 100.0, setpoint=setpoint_m, sample_time=None, output_limits=(0.05, 0.4))
    controller = PidController(config.controller, config.supply.bias_current)
    chain = Chain(config)

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
        "actuator, all of it": driven.step,
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
    driven.check()
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
    _print(rows)
    return rows


def _print(rows: dict[str, dict[str, float]]) -> None:
    print(
        f"median of {ROUNDS} turns of {CALLS} calls; of {RESTS} after a rest of {1e3 * REST_s:g} ms; {_circumstances()}"
    )
    for name, row in rows.items():
        print(
            f"{name:22s} {row['us_per_call']:8.2f} µs   {row['ratio_to_simple_pid']:6.2f} × simple-pid   after a rest "
            f"{row['us_after_a_rest']:8.2f} µs   {row['ratio_after_a_rest']:6.2f} ×"
        )


if __name__ == "__main__":
    raise SystemExit(main())
