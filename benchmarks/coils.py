r"""A coil or a bundle driven by the model that `identify` found: what is asked for, what came of it, in virtual time.

    sma-actuator characterise --virtual coil --training-cycles 2 --skip fatigue --skip load_cell --skip lvdt \
        --out out/coil
    sma-actuator identify out/coil/p*.csv out/coil/levels_*.csv --model whole_range --config out/coil/bench.yaml \
        --out out/coil.yaml
    python benchmarks/coils.py out/coil.yaml --wire coil

The same driver, actuator and supervisor as in the node.  Positions over 85 % of the stroke that the wire truly has
under each load: held for four time constants of the wire each, then a sine of sixteen a period.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from sma_actuator.base.signals import Mode
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.plant.loads import Load, Spring, Weight

STRESSES_Pa = (25e6, 60e6, 100e6)  #: of the weights; the spring begins at the first and ends near the last
SHARES = (0.5, 0.9, 0.3, 0.7, 0.1, 0.6)  #: of the span, from contracted to cold
SPAN = 0.85
HELD, PERIOD, PERIODS = 4.0, 16.0, 2  #: time constants that a position is held and a period lasts; periods
LAST = 0.25  #: part of a position's time that counts as held


def loads_of(config: Config) -> dict[str, Load]:
    """By name: weights, and a spring."""
    wire = config.wire
    loads: dict[str, Load] = {}
    for stress_Pa in STRESSES_Pa:
        loads[f"{stress_Pa * wire.area_m2:.3g} N"] = Weight(stress_Pa * wire.area_m2)
    stiffness_N_m = (STRESSES_Pa[-1] - STRESSES_Pa[0]) * wire.area_m2 / wire.full_stroke_m
    preload_N = STRESSES_Pa[0] * wire.area_m2
    loads[f"spring {stiffness_N_m:.3g} N/m, {preload_N:.2g} N"] = Spring(stiffness_N_m, preload_N, wire.full_stroke_m)
    return loads


def stroke_m(name: str, config: Config, load: Load, lag_s: float) -> tuple[float, float]:
    """Where the wire truly is at most contracted and cold under a load."""
    bench = VirtualBench.from_name(name, 1, load, config.wire)
    cold_m = bench.truth.displacement_m
    bench.supply.set_voltage(config.supply.max_voltage)
    bench.supply.set_output(True)
    bench.supply.set_current(config.supply.max_current)
    bench.advance(4.0 * lag_s)
    return bench.truth.displacement_m, cold_m


def drive(name: str, config: Config, load: Load) -> tuple[float, ...]:
    """Stroke [m]; model, control and output error, output error while held [% of full stroke], cover of the interval
    [%], and the hottest temperature [°C].  Raises RuntimeError where a fault ends the run."""
    lag_s = config.estimator.thermal_time_constant
    hot_m, cold_m = stroke_m(name, config, load, lag_s)
    low_m = hot_m + 0.5 * (1.0 - SPAN) * (cold_m - hot_m)
    span_m = SPAN * (cold_m - hot_m)
    bench = VirtualBench.from_name(name, 7, load, config.wire)
    stepping_s, period_s = HELD * lag_s * len(SHARES), PERIOD * lag_s
    rows, held, hottest_C = [], [], -math.inf
    with Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)) as driver:
        driver.run_for(2.0)
        done, words = driver.enable(True)
        if not done:
            raise RuntimeError(words)
        began_s = bench.time_s
        while (elapsed_s := bench.time_s - began_s) < stepping_s + PERIODS * period_s:
            if elapsed_s < stepping_s:
                share = SHARES[int(elapsed_s / (HELD * lag_s))]
            else:
                share = 0.5 - 0.5 * math.cos(2.0 * math.pi * (elapsed_s - stepping_s) / period_s)
            asked_m = low_m + share * span_m
            driver.offer_setpoint(asked_m)
            output = driver.run_for(1.0 / config.loop.rate)
            if output.status.mode is Mode.OFF:
                raise RuntimeError(f"{output.status.fault}: {output.status.message}")
            hottest_C = max(hottest_C, bench.hottest_C)
            estimate = output.estimate
            rows.append((asked_m, estimate.displacement_m, bench.truth.displacement_m, estimate.uncertainty_m))
            held.append(elapsed_s < stepping_s and elapsed_s / (HELD * lag_s) % 1.0 >= 1.0 - LAST)
    asked, estimated, true, sure = np.array(rows).T
    percent = 100.0 / config.wire.full_stroke_m
    errors = (estimated - true, estimated - asked, true - asked, (true - asked)[np.array(held)])
    known = np.isfinite(estimated)  # not before the supply has begun to measure with
    covered = 100.0 * float(np.mean((np.abs(true - estimated) <= sure)[known]))
    return cold_m - hot_m, *(percent * float(np.nanmean(np.abs(e))) for e in errors), covered, hottest_C


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="parameter file that `identify` wrote")
    parser.add_argument("--wire", default="coil", help="of the virtual bench (default %(default)s)")
    parser.add_argument("--law", choices=("pid", "feed_forward_pid"), default="pid", help="default %(default)s")
    options = parser.parse_args()
    config = Config.load(options.model)
    mapping = config.to_mapping()
    config = Config.from_mapping({**mapping, "controller": {**mapping["controller"], "type": options.law}})
    print("| load | stroke [mm] | model | control | output | held | in the interval | hottest |")
    print("|---|---|---|---|---|---|---|---|")
    for name, load in loads_of(config).items():
        stroke, model, control, output, held, covered, hottest_C = drive(options.wire, config, load)
        print(
            f"| {name} | {stroke * 1e3:.1f} | {model:.2f} | {control:.2f} | {output:.2f} | {held:.2f} | {covered:.0f} "
            f"% | {hottest_C:.0f} °C |",
            flush=True,
        )


if __name__ == "__main__":
    main()
