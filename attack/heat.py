"""Heat: wires that lose half the heat that their parameter file says, in every physics of the bench.

Driven with all the current that the limits leave, through moves, and by ``characterise``.  The guard that tells a wrong
heat loss from how the wire cools is blind here: what holds has to hold before anybody can know.  The judge looks at the
hottest place of the wire, by the bench's truth.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

from sma_actuator.base.share import shared_file
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.characterise import PlanOptions, Rig, make_plan
from sma_actuator.characterise.programs import square_pulses
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.control.law import LawSections
from sma_actuator.control.pid import PidController, PidParameters
from sma_actuator.driver import Driver
from sma_actuator.instruments import InstrumentRefused
from sma_actuator.plant.loads import Load, Spring, Weight
from sma_actuator.plant.worlds import WORLDS

from .result import Result, Violation

WIRES = ("flexinol", "furukawa")
PHYSICS = tuple(WORLDS)
UNITS = tuple(itertools.product(WIRES, PHYSICS))
HEAT_LOSS = 0.5  #: of what the physics has, which hung vertically is less than the parameters say
LOADS: tuple[Load, ...] = (Weight(0.98), Spring(400.0, 0.6))
HELD_s = MOVED_s = 60.0
PERIOD_s = 12.0  #: of the sine and of the steps
PULSES, PULSE_s = 2, 15.0


class AllThereIs(PidController):
    """A control law that wants all it can get."""

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """The limit itself."""
        return limit_A


class AllThereIsParameters(PidParameters):
    """Those of a PID, which are not used."""

    def build(self, sections: LawSections) -> AllThereIs:
        """The law that wants all."""
        return AllThereIs(self, sections.supply.bias_current)


class Heating:
    """One wire in one physics, heated in every way there is."""

    def __init__(self, unit: int, heat_loss: float = HEAT_LOSS):
        self.wire, self.physics = UNITS[unit]
        self.unit, self.heat_loss = unit, heat_loss
        self.result = Result()

    def driven(self, load: Load, seconds: float, way: str) -> float:
        """Hottest place [°C] of a wire that the driver drives: "held" at all the current there is, "sine" or "steps"."""
        parameters = read_parameter_file(shared_file(f"config/{self.wire}.yaml"))
        parameters["calibration"].pop("cooling_rise", None)  # what the guard would know
        config = Config.from_mapping(parameters)
        if way == "held":
            law = AllThereIsParameters(**dataclasses.asdict(config.controller))
            config = dataclasses.replace(config, controller=law)
        bench = self._bench(load, self.heat_loss)
        hottest_C = -math.inf

        def look(_: object) -> None:
            nonlocal hottest_C
            hottest_C = max(hottest_C, bench.hottest_C)

        driver = Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench), look)
        driver.run_for(10.0)  # of a wire of which nothing is known more than the bias is not to be had
        end_s, (lo_m, hi_m) = bench.time_s + seconds, config.model.displacement_range
        while bench.time_s < end_s:
            driver.clear_fault()
            driver.enable(True)
            phase = bench.time_s / PERIOD_s
            share = 0.5 + 0.5 * math.sin(2.0 * math.pi * phase) if way == "sine" else float(phase % 1.0 < 0.5)
            driver.offer_setpoint(lo_m + (hi_m - lo_m) * share)
            driver.run_for(0.2)
        driver.stop()
        return hottest_C

    def characterised(self) -> float:
        """Hottest place [°C] in pulses of ``characterise`` at supply.max_current, under its lightest, a middle and its heaviest load."""
        config = bench_from_mapping(read_parameter_file(shared_file(f"config/{self.wire}_bench.yaml")))
        # Half in all, however it hangs: the margin of an attended bench is no more.
        bench = self._bench(LOADS[0], self.heat_loss / WORLDS[self.physics].heat_transfer)
        hottest_C = -math.inf

        def look(_: float) -> None:
            nonlocal hottest_C
            hottest_C = max(hottest_C, bench.hottest_C)

        rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
        parts = [
            part.parameters
            for part in make_plan(config, PlanOptions(heat_current_A=config.supply.max_current))
            if part.kind == "pulses"
        ]
        with rig.opened():
            for p in (parts[0], parts[len(parts) // 2], parts[-1]):
                bench.load = Weight(p["load_N"])
                program = square_pulses(
                    PULSES, p["heat_current_A"], config.supply.bias_current, p["heat_s"], p["cool_s"]
                )
                try:
                    rig.record(program, look)
                except InstrumentRefused:
                    self.result.counts["parts refused"] += 1
        return hottest_C

    def run(self) -> Result:
        """Every way, judged."""
        for load, (way, seconds) in itertools.product(LOADS, (("held", HELD_s), ("sine", MOVED_s), ("steps", MOVED_s))):
            self.judge(way, self.driven(load, seconds, way))
        self.judge("characterise", self.characterised())
        return self.result

    def judge(self, way: str, hottest_C: float) -> None:
        """Keep how hot it was; above the limit is a broken promise."""
        parameters = read_parameter_file(shared_file(f"config/{self.wire}_bench.yaml"))
        limit_C = bench_from_mapping(parameters).thermal.max_temperature
        words = "at all the current there is" if way == "held" else way
        self.result.counts["wires heated"] += 1
        self.result.see(f"{self.wire} in {self.physics}, {words} [°C]", hottest_C)
        if hottest_C > limit_C:
            self.result.violations.append(
                Violation(
                    f"the wire is above its limit of temperature, {words}",
                    f"{self.wire} in {self.physics}: {hottest_C:.0f} °C, limit {limit_C:g}",
                    f"python -m attack heat --only {self.unit}",
                )
            )

    def _bench(self, load: Load, heat_loss: float) -> VirtualBench:
        bench = VirtualBench.from_name(self.wire, seed=1, load=load, physics=self.physics, ambient_C=24.0)
        bench.inject("draught", heat_loss)
        return bench


def attack(units: tuple[int, ...]) -> Result:
    """Heat the wires of these numbers, of :data:`UNITS`."""
    result = Result()
    for unit in units:
        result.add(Heating(unit).run())
    return result
