"""Heat: the two promises of the limits that `sma-actuator init` writes, side by side, in every physics of the bench.

How hot a wire becomes that loses half the heat that it should: from the start, driven with all the current that the
limits leave, through moves, through restarts, also with another wire in the place of the calibrated one, a thinner one
or one that shows as much cold, with a sensor of the surroundings that reads too cold, and by ``characterise``; and
suddenly, while it is held hot (a cover is put over it).  The guard that tells a wrong heat loss from how the wire cools
is blind here: what holds has to hold before anybody can know.  The judge looks at the hottest place of the wire, by the
bench's truth.

And how far a wire contracts that loses what it should, under a light, a middle and the largest load, and what of that
is held for ten minutes, half a minute after it was asked for: in % of its stroke, from the cold to where it is
shortest of all below ``max_temperature``.  The law that asks for it sees the bench's truth, so that nothing but the
limits can be in the way.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Reading
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.characterise import PlanOptions, Rig, make_plan
from sma_actuator.characterise.programs import square_pulses
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.control.law import ControlLaw, LawSections
from sma_actuator.control.pid import PidController, PidParameters
from sma_actuator.derived import derived
from sma_actuator.driver import Driver
from sma_actuator.instruments import InstrumentRefused
from sma_actuator.plant.loads import Load, Spring, Weight
from sma_actuator.plant.worlds import DRAWN, WORLDS, world_of

from .result import Result, Violation

WIRES = ("flexinol", "furukawa")
PHYSICS = (*WORLDS, *(f"{DRAWN}{number}" for number in range(1, 25)))
UNITS = tuple(itertools.product(WIRES, PHYSICS))
HEAT_LOSS = 0.5  #: of what the physics has, which hung vertically is less than the parameters say
LOADS: tuple[Load, ...] = (Weight(0.98), Spring(400.0, 0.6))
HELD_s = MOVED_s = 60.0
PERIOD_s = 12.0  #: of the sine and of the steps
RESTART_s = 6.0  #: after so long it is begun anew
THINNER = 0.95  #: diameter of another wire in the place of the calibrated one: it shows a tenth more
AMBIENT_C, WARM_C = 24.0, 38.0
HARD_C = 195.0  #: as hot as a wire is made to see how far it goes
PULSES, PULSE_s = 2, 15.0
#: Shares of the largest stress at which nothing else stops a contraction (safety.stress_limit_fraction).
STRESSES = {"a light load": 0.1, "a middle load": 0.4, "the largest load": 0.99}
ASKED, WANTED, BACK = 0.985, 0.98, 0.001  #: shares of the stroke
#: Heated for half a minute: a wire that must be hot shows by then what heat it loses (safety.thermal.shown_loss_W_K).
HOLD_s, SOON_s = 630.0, 30.0
#: So long the driver has run before it heats: one that has just begun does not know that a wire is cold.
BEGUN_s = 30.0
#: Sections that `init` derives, and what is asked for.
_DERIVED = ("supply", "thermal", "controller", "estimator", "safety")


def written_by_init(wire: str) -> dict[str, Any]:
    """A bench's parameters with the limits that follow from its wire, as `sma-actuator init` writes them."""
    mapping = read_parameter_file(shared_file(f"config/{wire}_bench.yaml"))
    for section in _DERIVED:
        mapping[section] = {}
    mapping["thermal"]["ambient_temperature"] = AMBIENT_C
    for name, found in derived(mapping).items():
        section, _, key = name.partition(".")
        mapping[section].setdefault(key, found.value)
    return mapping


class AllThereIs(PidController):
    """A control law that wants all it can get."""

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """The limit itself."""
        return limit_A


class ByTruth(PidController):
    """A PID that sees where the wire is, and knows where it should be."""

    def __init__(self, parameters: PidParameters, bias_A: float, place_m: Callable[[], float], wanted_m: float):
        super().__init__(parameters, bias_A)
        self._place_m, self._wanted_m = place_m, wanted_m

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """The current for that place."""
        return super().step(self._place_m(), self._wanted_m, dt_s, limit_A)


def with_law(config: Config, law: ControlLaw) -> Config:
    """``config`` with a law of ours."""

    class Ours(PidParameters):
        def build(self, sections: LawSections) -> ControlLaw:
            return law

    return dataclasses.replace(config, controller=Ours(**dataclasses.asdict(config.controller)))


class TooCold(InProcessDaq):
    """A DAQ whose sensor of the surroundings reads the room of another day, and its digits change."""

    def read_block(self) -> Reading:
        """A reading of it."""
        reading = super().read_block()
        return dataclasses.replace(reading, ambient_temperature_C=AMBIENT_C + 0.01 * (reading.time_s % 1.0))


class Heating:
    """One wire in one physics, heated in every way there is."""

    def __init__(self, unit: int, heat_loss: float = HEAT_LOSS):
        self.wire, self.physics = UNITS[unit]
        self.unit, self.heat_loss = unit, heat_loss
        self.result = Result()
        self.parameters = written_by_init(self.wire)
        identified = read_parameter_file(shared_file(f"config/{self.wire}.yaml"))  # at home
        of_home = {name: identified[name] for name in ("model", "calibration")}
        of_home["calibration"]["hot_end"].pop("cooling_rise", None)  # what the guard would know
        safety = {**self.parameters["safety"], "outside_calibration_time": 3600.0}
        self.config = Config.from_mapping({**self.parameters, **of_home, "safety": safety})

    # --- how hot ------------------------------------------------------------------------------------

    def driven(self, load: Load, seconds: float, way: str) -> float:
        """Hottest place [°C] of a wire that the driver drives in a way: "held" at all the current there is, also
        "covered", "begun anew" again and again, so with a "thinner" wire, rested and, though of another physics, "as
        resistant cold" as the calibrated one, or in a "warm room" whose sensor reads too cold; or moved along a "sine"
        or "steps"."""
        config = self.config
        if way == "warm room":
            config = config.replace({"thermal.ambient_temperature": WARM_C})
        if way not in ("sine", "steps"):
            config = with_law(config, AllThereIs(config.controller, config.supply.bias_current))
        ambient_C = WARM_C if way == "warm room" else AMBIENT_C
        thinner = THINNER if way == "thinner" else 1.0
        if way == "as resistant cold":
            thinner = self._as_resistant(load)
        bench = self._bench(load, 1.0 if way == "covered" else self.heat_loss, ambient_C, thinner)
        if way == "covered":
            bench.inject("draught", self.heat_loss, at_s=bench.time_s + 0.5 * seconds)
        hottest_C, low_high_m = -math.inf, config.model.displacement_range

        def look(_: object) -> None:
            nonlocal hottest_C
            hottest_C = max(hottest_C, bench.hottest_C)

        end_s, last_s = bench.time_s + seconds, RESTART_s if way in ("begun anew", "thinner") else seconds
        while bench.time_s < end_s:
            daq = (TooCold if way == "warm room" else InProcessDaq)(bench, config)
            driver = Driver(config, InProcessSupply(bench, config), daq, VirtualClock(bench), look)
            driver.run_for(BEGUN_s if way == "as resistant cold" else 0.2)
            until_s = min(bench.time_s + last_s, end_s)
            while bench.time_s < until_s:
                driver.clear_fault()
                driver.enable(True)
                phase = bench.time_s / PERIOD_s
                share = 0.5 + 0.5 * math.sin(2.0 * math.pi * phase) if way == "sine" else float(phase % 1.0 < 0.5)
                driver.offer_setpoint(low_high_m[0] + (low_high_m[1] - low_high_m[0]) * share)
                driver.run_for(0.2)
            driver.stop()
        return hottest_C

    def characterised(self) -> float:
        """Hottest place [°C] in pulses of ``characterise`` at supply.max_current, under its lightest, a middle and its
        heaviest load."""
        config = bench_from_mapping(self.parameters)
        # Half in all, however it hangs: the margin of an attended bench is no more.
        bench = self._bench(LOADS[0], self.heat_loss / world_of(self.physics).heat_transfer)
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

    # --- how far ------------------------------------------------------------------------------------

    def stroke(self, load: Load) -> tuple[float, float, float]:
        """Where the wire rests in the cold, and where it is shortest of all below the limit of its temperature [m]; how
        hot it is where it has come as far as is asked [°C].

        A wire that has come as far as is wanted, and then expands with its heat until its clamped ends transform as
        well, is asked to be where it turned.
        """
        bench = self._bench(load, 1.0)
        bench.supply.set_voltage(20.0)
        bench.supply.set_output(True)
        current_A, cold_m = 0.1, bench.truth.displacement_m
        rows = [(cold_m, AMBIENT_C)]
        while bench.hottest_C < HARD_C and current_A < 0.98:
            current_A *= 1.02
            bench.supply.set_current(current_A)
            bench.advance(bench.time_s + 1.5)
            rows.append((bench.truth.displacement_m, bench.hottest_C))
        short_m = min(place_m for place_m, _ in rows)
        best, there_C = 0.0, AMBIENT_C
        for place_m, warm_C in rows:
            share = (cold_m - place_m) / (cold_m - short_m)
            if share > best:
                best, there_C = share, warm_C
            if best >= ASKED or (best >= WANTED and share < best - BACK):
                break
        return cold_m, short_m, there_C

    def contracted(self, load: Load, seconds: float = HOLD_s) -> float:
        """The least that a wire holds of its stroke, from soon after it was asked to contract, as a share."""
        cold_m, short_m, there_C = self.stroke(load)
        bench = self._bench(load, 1.0)
        gains, bias_A = self.config.controller, self.config.supply.bias_current
        per_K = (cold_m - short_m) / (there_C - AMBIENT_C)
        # By its heat: a wire that is hotter than where it is shortest expands again.
        law = ByTruth(gains, bias_A, lambda: cold_m - per_K * (bench.hottest_C - AMBIENT_C), short_m)
        config = with_law(self.config, law)
        driver = Driver(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
        driver.run_for(BEGUN_s)
        least, begin_s = math.inf, bench.time_s
        while bench.time_s < begin_s + seconds:
            driver.clear_fault()
            driver.enable(True)
            driver.offer_setpoint(1.0)  # the law knows better; what the estimate makes of it is not judged here
            driver.run_for(0.5)
            if bench.time_s > begin_s + SOON_s:
                least = min(least, (cold_m - bench.truth.displacement_m) / (cold_m - short_m))
        driver.stop()
        return least

    # --- judged -------------------------------------------------------------------------------------

    def run(self) -> Result:
        """Every way, judged."""
        ways = (("held", HELD_s), ("sine", MOVED_s), ("steps", MOVED_s), ("covered", 2.0 * HELD_s))
        ways = (*ways, ("begun anew", HELD_s), ("thinner", HELD_s), ("warm room", HELD_s))
        ways = (*ways, ("as resistant cold", BEGUN_s + HELD_s))
        for load, (way, seconds) in itertools.product(LOADS, ways):
            self.judge(way, self.driven(load, seconds, way))
        self.judge("characterise", self.characterised())
        wire = self.config.wire
        most_N = self.config.safety.stress_limit_fraction * wire.max_stress * wire.area_m2
        for words, share in STRESSES.items():
            self.judge_contraction(words, self.contracted(Weight(share * most_N)))
        return self.result

    def judge(self, way: str, hottest_C: float) -> None:
        """Keep how hot it was; above the limit is a broken promise."""
        limit_C = self.config.thermal.max_temperature
        self.result.counts["wires heated"] += 1
        self.result.see(f"{self.wire} in {self.physics}, {way} [°C]", hottest_C)
        if hottest_C > limit_C:
            self._broken(f"the wire is above its limit of temperature, {way}", f"{hottest_C:.0f} °C, limit {limit_C:g}")

    def judge_contraction(self, words: str, share: float) -> None:
        """Keep what it held of its stroke; less than 98 % is a broken promise."""
        self.result.counts["wires contracted"] += 1
        # Kept is what lacks: the largest is the worst.
        self.result.see(f"{self.wire} in {self.physics}, {words}: lacks [% of the stroke]", 100.0 * (1.0 - share))
        if share < WANTED:
            self._broken(f"the limits do not let it contract, {words}", f"{share:.1%} of its stroke")

    def _broken(self, rule: str, detail: str) -> None:
        detail = f"{self.wire} in {self.physics}: {detail}"
        self.result.violations.append(Violation(rule, detail, f"python -m attack heat --only {self.unit}"))

    def _as_resistant(self, load: Load) -> float:
        """How much thinner a wire of this physics is that shows cold under a load what the calibrated one does."""
        rest, thinner = self.config.calibration.rest, 1.0
        for _ in range(3):  # its stress goes with it
            cold = self._bench(load, 1.0, thinner=thinner).truth
            shown_Ohm = np.interp(cold.load_N / self.config.wire.area_m2, rest.cold_stress, rest.cold_resistance)
            thinner *= math.sqrt(cold.resistance_Ohm / shown_Ohm)
        return thinner

    def _bench(self, load: Load, heat_loss: float, ambient_C: float = AMBIENT_C, thinner: float = 1.0) -> VirtualBench:
        named = VirtualBench.from_name(self.wire, seed=1, load=load, physics=self.physics, ambient_C=ambient_C)
        wire = dataclasses.replace(named.setup.wire, diameter_m=thinner * named.setup.wire.diameter_m)
        bench = VirtualBench(dataclasses.replace(named.setup, wire=wire), seed=1)
        bench.inject("draught", heat_loss)
        return bench


def attack(units: tuple[int, ...]) -> Result:
    """Heat the wires of these numbers, of :data:`UNITS`."""
    result = Result()
    for unit in units:
        result.add(Heating(unit).run())
    return result


def table(worst: dict[str, float], most: int) -> list[str]:
    """The two promises beside each other, of what was kept as worst: a row for each wire that is among the ``most``
    hottest or the ``most`` that held the least."""
    found = []
    for physics, wire in itertools.product(PHYSICS, WIRES):
        of_it = {name: value for name, value in worst.items() if name.startswith(f"{wire} in {physics}, ")}
        hot = {name: value for name, value in of_it.items() if name.endswith("[°C]")}
        far = {name: value for name, value in of_it.items() if name.endswith("[% of the stroke]")}
        if not (hot and far):
            continue
        (by, hottest_C), (under, lacks) = (max(kept.items(), key=lambda item: item[1]) for kept in (hot, far))
        way, load = (name.split(", ", 1)[1] for name in (by.removesuffix(" [°C]"), under.split(": lacks")[0]))
        row = f"| {physics} | {wire} | {hottest_C:.0f} | {way} | {100.0 - lacks:.1f} | {load} |"
        found.append((hottest_C, lacks, row))
    hottest = sorted(found, reverse=True)
    least = sorted(found, key=lambda wire: wire[1], reverse=True)
    return [
        "| physics | wire | hottest with half the heat loss [°C] | by | held of the stroke [%] | under |",
        "|" + "---|" * 6,
        *dict.fromkeys(row for _, _, row in hottest[:most] + least[:most]),
    ]
