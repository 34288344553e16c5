"""Ends: wires that are driven to and fro inside their stroke, and ends that are none.

The user's way for each physics: what `init` derives, `characterise`, `identify`, and the driver on what that wrote.
Places at random inside 85 % of the stroke that the wire has at that load, by the bench's truth, under a light, a middle
and the largest calibrated load, switched on at once (the guard counts the wire as hot) and with the wire hot from
before.  An end that is shown (limit ``setpoint_reach``) for longer than a second by a wire that has more than a tenth
of its stroke to go is false, and a place that is not reached within a tenth of the stroke in the last third of its time
is not gone to.
"""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path

import numpy as np
import yaml

from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.characterise import PlanOptions, Rig, characterise, make_plan
from sma_actuator.characterise.operators import BenchOperator
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.driver import Driver
from sma_actuator.identify import identify
from sma_actuator.logs.bench_log import read_bench_log
from sma_actuator.plant.loads import Weight

from .heat import HARD_C, UNITS, written_by_init
from .result import Result, Violation

KEPT = Path(__file__).resolve().parents[1] / "out" / "attack" / "models"  #: may be deleted at any time
TRAINED = 40.0  #: cycles that a wire has done before
PLAN = PlanOptions(levels=6, skip=("training", "fatigue", "lead_resistance", "load_cell", "lvdt"))
MIDDLE, DWELL_s = 0.85, 20.0  #: share of the stroke that is asked for, and how long a place stands
FALSE_s, TO_GO, NEAR = 1.0, 0.1, 0.1
HEATED_s = 3.0
#: Shares of the largest stress; the last is what `characterise` calibrates up to, by itself.
STRESSES = {"a light load": 0.1, "a middle load": 0.4, "the largest calibrated": 0.72}


def identified(wire: str, physics: str) -> Config:
    """The parameters of a wire in a physics, with a model from its own logs; kept on disk."""
    path = KEPT / f"{physics}_{wire}.yaml"
    if not path.is_file():
        mapping = written_by_init(wire)
        bench = VirtualBench.from_name(wire, seed=1, physics=physics, cycles=TRAINED)
        config = bench_from_mapping(mapping)
        rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
        operator = BenchOperator(bench, config.wire.max_stress * config.wire.area_m2, config.wire.full_stroke_m)
        with tempfile.TemporaryDirectory() as folder:
            characterise(mapping, make_plan(config, PLAN), rig, operator, Path(folder))
            found = identify(
                [read_bench_log(log) for log in sorted(Path(folder).glob("*.csv"))], mapping, "whole_range"
            )
        KEPT.mkdir(parents=True, exist_ok=True)
        path.write_text(yaml.safe_dump({"sma_actuator": {"ros__parameters": found.mapping}}), encoding="utf-8")
    return Config.from_mapping(read_parameter_file(path))


def stroke(bench: VirtualBench) -> tuple[float, float]:
    """Where that wire rests in the cold, and where it is shortest of all [m]."""
    bench.supply.set_voltage(20.0)
    bench.supply.set_output(True)
    current_A, places_m = 0.1, [bench.truth.displacement_m]
    while bench.hottest_C < HARD_C and current_A < 0.98:
        current_A *= 1.02
        bench.supply.set_current(current_A)
        bench.advance(bench.time_s + 1.5)
        places_m.append(bench.truth.displacement_m)
    return places_m[0], min(places_m)


class Ends:
    """One wire in one physics."""

    def __init__(self, unit: int, seconds: float):
        self.wire, self.physics = UNITS[unit]
        self.unit, self.seconds = unit, seconds
        self.config = identified(self.wire, self.physics)
        self.result = Result()

    def bench(self, load_N: float) -> VirtualBench:
        """The wire under a load."""
        return VirtualBench.from_name(self.wire, seed=7, load=Weight(load_N), physics=self.physics, cycles=TRAINED)

    def run(self) -> Result:
        """Every load, from cold and from hot."""
        wire = self.config.wire
        most_N = self.config.safety.stress_limit_fraction * wire.max_stress * wire.area_m2
        for (words, share), hot in itertools.product(STRESSES.items(), (False, True)):
            self.drive(words, share * most_N, hot)
        return self.result

    def drive(self, words: str, load_N: float, hot: bool) -> None:
        """From place to place."""
        cold_m, short_m = stroke(self.bench(load_N))
        bench, config, whole_m = self.bench(load_N), self.config, cold_m - short_m
        if hot:
            bench.supply.set_voltage(20.0)
            bench.supply.set_current(config.supply.max_current)
            bench.supply.set_output(True)
            bench.advance(bench.time_s + HEATED_s)
        rng = np.random.default_rng(self.unit)
        driver = Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
        driver.run_for(0.2)
        driver.enable(True)
        shown_s, begin_s, place_m, next_s, near = 0.0, bench.time_s, 0.0, -1.0, True
        period_s, told = 0.2, False
        while (now_s := bench.time_s - begin_s) < self.seconds:
            if now_s >= next_s:
                self.result.counts["places asked for"] += next_s > 0.0
                if not near:
                    self.broken("a place inside the stroke was not gone to", f"{words}, {'hot' if hot else 'cold'}")
                share = 0.5 + MIDDLE * (rng.random() - 0.5)
                place_m, next_s, near = cold_m - share * whole_m, now_s + DWELL_s, False
            driver.offer_setpoint(place_m)
            output = driver.run_for(period_s)
            is_m = bench.truth.displacement_m
            near |= next_s - now_s < DWELL_s / 3.0 and abs(is_m - place_m) < NEAR * whole_m
            shown_s = shown_s + period_s if "setpoint_reach" in output.status.limits else 0.0
            told = told and shown_s > 0.0
            if shown_s > FALSE_s and is_m - short_m > TO_GO * whole_m and not told:
                told = True  # once
                self.broken("an end is shown that is none", f"{words}, {(cold_m - is_m) / whole_m:.0%} contracted")
            if not driver.enable(True)[0]:
                self.broken("a fault", f"{words}, {output.status.message}")
                driver.clear_fault()
                driver.enable(True)
        driver.stop()
        self.result.counts["virtual seconds"] += round(self.seconds)

    def broken(self, rule: str, detail: str) -> None:
        """Note it."""
        detail = f"{self.wire} in {self.physics}, {detail}"
        self.result.violations.append(Violation(rule, detail, f"python -m attack ends --only {self.unit}"))


def attack(unit: int, seconds: float) -> Result:
    """Drive one wire, of :data:`UNITS`, for so long under each load and from each start."""
    return Ends(unit, seconds).run()
