"""Virtual hours: a driver on the bench in this process, at full speed, with a random fault at least once a minute.

The judge looks at the bench itself every five milliseconds while something is wrong, and at every step otherwise.
"""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sma_actuator.base.signals import Mode, Quality, Reading
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.faults import FAULTS
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.driver import Driver
from sma_actuator.plant.loads import parse_load
from sma_actuator.plant.worlds import WORLDS

from .promises import Promises
from .result import Result, Violation

CONFIG = Path(__file__).resolve().parents[1] / "config"
SESSION_s = 600.0
LONGEST_QUIET_s = 55.0  #: between two faults
LOOK_s = 5e-3  #: how often the judge looks while something is wrong
OFF_AT_MOST_s = 1.0  #: where the instrument can be written to, or has a watchdog
NO_CURRENT_A = 1e-6
CURRENT_MARGIN_A = 1e-4  #: resolution of the bench's supply and of its settling
LOADS = {
    "flexinol": ("weight:0.49", "weight:0.98", "weight:1.96", "spring:400,0.6", "schedule:0,0.5,120,1.6,300,0.9"),
    "furukawa": ("weight:0.49", "weight:0.98", "weight:1.96", "spring:500,0.6", "schedule:0,0.5,120,1.6,300,0.9"),
}
WIRES = tuple(LOADS)
PHYSICS = tuple(WORLDS)
#: Rates of the loop [Hz], that of the shipped parameters and the slowest that their time-outs allow.  Three of them, so
#: that seeds that follow each other have every wire in every physics at each.
RATES_Hz = (10.0, 20.0, 10.0)
#: What the bench can be told to do wrong while the wire is driven.
DRIVEN_FAULTS = tuple(FAULTS)
#: Wrong ambient readings [°C]; None: what the bench says.
AMBIENT_LIES = (None, None, None, -59.0, 0.0, 60.0, math.nan, math.inf)


class WatchedBench(VirtualBench):
    """A bench that shows itself every few milliseconds while ``watch`` is set."""

    watch: Callable[[], None] | None = None

    def advance(self, until_s: float) -> None:
        """As the bench's own, in small pieces where somebody looks."""
        while self.watch is not None and self.time_s + LOOK_s < until_s:
            super().advance(self.time_s + LOOK_s)
            self.watch()
        super().advance(until_s)
        if self.watch is not None:
            self.watch()


class LyingDaq(InProcessDaq):
    """The bench's DAQ with a broken thermometer for the room."""

    ambient_C: float | None = None

    def read_block(self) -> Reading:
        """The newest block, with ``ambient_C`` in place of the room's temperature where it is not None."""
        reading = super().read_block()
        if self.ambient_C is None:
            return reading
        return dataclasses.replace(reading, ambient_temperature_C=self.ambient_C)


def config_of(wire: str, lead_error_Ohm: float, rate_Hz: float) -> Config:
    """The shipped parameters of a wire at some rate of the loop, with leads that somebody has measured wrongly."""
    parameters = read_parameter_file(CONFIG / f"{wire}.yaml")
    parameters["circuit"]["lead_resistance"] += lead_error_Ohm
    parameters.setdefault("loop", {})["rate"] = rate_Hz
    return Config.from_mapping(parameters)


class Session:
    """One wire, one load, one wrong idea of the surroundings, for ten virtual minutes."""

    def __init__(self, seed: int, bench_arguments: Mapping[str, Any] | None = None, seconds: float = SESSION_s):
        self.seed = seed
        self.seconds = seconds
        self.result = Result()
        self.chance = chance = random.Random(seed)
        wire = WIRES[seed % len(WIRES)]
        self.physics = PHYSICS[seed // len(WIRES) % len(PHYSICS)]
        load = chance.choice(LOADS[wire])
        self.heat_loss = chance.choice((0.5, 0.5, 1.0, 1.0, 2.0))
        self.lead_error_Ohm = chance.choice((0.0, 0.0, 0.0, -0.2, 0.2))
        self.rate_Hz = RATES_Hz[seed % len(RATES_Hz)]
        self.config = config_of(wire, self.lead_error_Ohm, self.rate_Hz)
        self.promises = Promises(self.config.to_mapping())
        ambient_C = chance.uniform(5.0, 40.0)
        arguments = {"seed": seed, "load": parse_load(load), "ambient_C": ambient_C, "physics": self.physics}
        arguments |= bench_arguments or {}
        self.bench = WatchedBench.from_name(wire, **arguments)
        self.bench.inject("draught", self.heat_loss)
        self.ambient_lie_C = chance.choice(AMBIENT_LIES)
        self.scene = (
            f"{wire} in {self.physics} at {self.rate_Hz:g} Hz, {load}, heat loss × {self.heat_loss:g}, leads "
            f"{self.lead_error_Ohm:+g} Ω, {ambient_C:.0f} °C"
            f"{'' if self.ambient_lie_C is None else f' read as {self.ambient_lie_C:g} °C'}"
        )
        self.outputs = 0
        self.told_A = 0.0
        self.meant_on = False  #: somebody has enabled it, and nothing since has switched it off
        self._off_by_s = math.inf
        self._off_since_s = math.nan
        self._cause = ""
        self._too_much_since_s = math.nan
        self._last = None
        self._overheated = False
        self._new_driver()

    # --- the judge --------------------------------------------------------------------------------

    def broken(self, rule: str, detail: str) -> None:
        """Write down a broken promise."""
        replay = f"python -m attack hours --seed {self.seed} --sessions 1"
        self.result.violations.append(
            Violation(
                rule, f"{detail} at {self.bench.time_s:.2f} s ({self.scene}; {self._cause or 'no fault'})", replay
            )
        )

    def look(self) -> None:
        """Judge the bench as it is now."""
        now_s, current_A, result = self.bench.time_s, self.bench.current_A, self.result
        hottest_C, limit_C = self.bench.hottest_C, self.config.thermal.max_temperature
        result.see(f"wire in {self.physics} [°C]", hottest_C)
        if hottest_C > limit_C and not self._overheated:
            self._overheated = True  # once in a session; it stays hot for many steps
            self.broken("the wire is above its limit of temperature", f"{hottest_C:.0f} °C, limit {limit_C:g}")
        if current_A <= NO_CURRENT_A and not self.bench.supply.output_on:
            if math.isnan(self._off_since_s):
                self._off_since_s = now_s
        else:
            self._off_since_s = math.nan
        self._look_at_current(current_A, now_s)
        if now_s > self._off_by_s:
            if math.isnan(self._off_since_s):
                self.broken(f"the current is not off in time: {self._cause.split('=')[0]}", f"{current_A:.3f} A")
            self._off_by_s = math.inf

    def _look_at_current(self, current_A: float, now_s: float) -> None:
        faults = self.bench.faults
        if current_A <= self.config.supply.max_current + CURRENT_MARGIN_A:
            self._too_much_since_s = math.nan
            return
        if math.isnan(self._too_much_since_s):
            self._too_much_since_s = now_s
        lies = "current_disagrees" in faults or self._cause.startswith("second_commander")
        allowed_s = self.promises.within_s("supply_disagrees") if lies else 0.0
        if now_s - self._too_much_since_s > allowed_s:
            self.broken("more than supply.max_current flows", f"{current_A:.4f} A")
            self._too_much_since_s = math.inf

    def on_output(self, output: Any) -> None:
        """Judge one step of the driver; called by it."""
        self.outputs += 1
        command, estimate = output.command, output.estimate
        self.told_A = command.current_A if command.output_on else 0.0
        self._last = output
        if not 0.0 <= command.current_A <= self.config.supply.max_current:
            self.broken("a command outside 0 to supply.max_current", f"{command.current_A} A")
        if command.output_on and not self.meant_on:
            self.broken("the output is on and nobody enabled it", f"{command.current_A:.3f} A")
        if output.status.mode is Mode.OFF:
            self.meant_on = False
        if estimate.quality is not Quality.INVALID and not math.isfinite(estimate.displacement_m):
            self.broken("an estimate that is no number counts as valid", estimate.quality.name)
        if self.bench.watch is None:
            self.look()

    # --- the attacker -------------------------------------------------------------------------------

    def run(self) -> Result:
        """Attack until the time is over."""
        while self.bench.time_s < self.seconds:
            if not self._drive():
                self._run_for(2.0)
                continue
            self._command_for(self.chance.uniform(1.0, LONGEST_QUIET_s))
            self.chance.choices((self._misbehave, self._switch_off, self._restart), (0.88, 0.06, 0.06))[0]()
        self._stop()
        self.result.counts["virtual seconds"] += round(self.bench.time_s)
        self.result.counts[f"virtual minutes in {self.physics}"] += round(self.bench.time_s / 60.0)
        self.result.counts["steps"] += self.outputs
        self.result.counts[f"virtual minutes at {self.rate_Hz:g} Hz"] += round(self.bench.time_s / 60.0)
        return self.result

    def _new_driver(self) -> None:
        self.supply = InProcessSupply(self.bench, self.config)
        self.daq = LyingDaq(self.bench, self.config)
        self.daq.ambient_C = self.ambient_lie_C
        self.driver = Driver(
            self.config, self.supply, self.daq, VirtualClock(self.bench), on_output=self.on_output, name="attacked"
        )

    def _run_for(self, seconds: float) -> None:
        try:
            self.driver.run_for(seconds)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is the finding
            self.broken("the loop ended with an exception", f"{type(error).__name__}: {error}")
            self._new_driver()

    def _drive(self) -> bool:
        """Enable the wire where it is off; whether it is driven."""
        if self.meant_on:
            return True
        for name in [name for name in self.bench.faults if name != "draught"]:
            self.bench.clear(name)
        self._run_for(self.chance.uniform(0.1, 2.0))
        self.driver.clear_fault()
        self._run_for(0.2)
        self.meant_on, _ = self.driver.enable(True)
        self.result.counts["enabled" if self.meant_on else "enabling refused"] += 1
        return self.meant_on

    def _command_for(self, seconds: float) -> None:
        """Ask for positions, sensible ones and others."""
        end_s = self.bench.time_s + seconds
        lo_m, hi_m = 0.0, 0.05 * self.config.wire.length
        while self.bench.time_s < end_s and self.meant_on:
            kind = self.chance.random()
            if kind < 0.15:
                self.driver.offer_setpoint(
                    self.chance.choice((math.nan, math.inf, -math.inf, -1.0, 1.0, 1e300, 0.0, 0.0))
                )
            elif kind < 0.3:
                times_s = sorted(self.chance.uniform(0.0, 10.0) for _ in range(self.chance.randint(1, 5)))
                self.driver.offer_trajectory(times_s, [self.chance.uniform(lo_m, hi_m) for _ in times_s])
            else:
                self.driver.offer_setpoint(self.chance.uniform(lo_m, hi_m))
            self.result.counts["setpoints"] += 1
            self._run_for(max(min(self.chance.choice((0.1, 1.0, 5.0, 20.0)), end_s - self.bench.time_s), 0.1))

    def _misbehave(self) -> None:
        """One fault of the bench; where the table promises that the current goes off, it has to."""
        name = self.chance.choice(DRIVEN_FAULTS)
        value = self._value(name)
        row = self._promised(name, value)
        self._cause = name if math.isnan(value) else f"{name}={value:.3g}"
        self.result.counts["faults"] += 1
        self.result.counts[f"fault {name}"] += 1
        began_s = self.bench.time_s
        self.bench.watch = self.look
        self.bench.inject(name, value)
        if row and self.meant_on:
            self._expect_off(row, name)
        else:
            self._run_for(self.chance.uniform(1.0, 10.0))
        if name == "draught":
            self.bench.inject("draught", self.heat_loss)
        elif name != "second_commander":
            self.bench.clear(name)
        self.bench.watch = None
        if row and not math.isnan(self._off_since_s):
            self.result.see(f"off after {name} [s]", max(self._off_since_s - began_s, 0.0))
        self._run_for(self.chance.uniform(0.5, 3.0))  # a latched fault stays off by itself
        self._cause = ""

    def _expect_off(self, row: str, name: str) -> None:
        within_s = self.promises.within_s(row)
        if name.startswith("supply_") or name == "slow_answers":
            # It hears nothing: its own watchdog is all there is, and counts from the last word before the fault.
            within_s = max(within_s, self.config.supply.watchdog_timeout)
        if row == "daq_lost":
            # In virtual time nobody steps in while the loop waits for an answer; `lines` judges the driver's watchman.
            within_s = max(within_s, self.config.instruments.daq.timeout + 1.0 / self.config.loop.rate)
        if self.config.supply.watchdog_timeout <= OFF_AT_MOST_s and name.endswith(("_silent", "_hangup")):
            within_s = min(within_s, OFF_AT_MOST_s)
        self.expect_off_within(within_s)
        self._run_for(within_s + 1.0)

    def expect_off_within(self, seconds: float) -> None:
        """From now on no current may flow after ``seconds``."""
        self._off_by_s = self.bench.time_s + seconds + LOOK_s
        self.result.counts["offs demanded"] += 1

    def _value(self, name: str) -> float:
        safety, chance = self.config.safety, self.chance
        return {
            "short_wire": lambda: chance.uniform(0.0, 0.5 * safety.resistance_min),
            "channel_stuck": lambda: float(chance.choice((101, 102, 103, 104, 105))),
            "channel_dithers": lambda: float(chance.choice((101, 102, 103, 104, 105))),
            "channel_saturated": lambda: float(chance.choice((101, 102, 103, 104, 105))),
            "channel_nan": lambda: float(chance.choice((101, 102, 103, 104, 105))),
            "load_spike": lambda: chance.uniform(0.1, 4.0 * safety.load_spike),
            "current_disagrees": lambda: chance.choice((0.0, 0.5, 0.9, 1.1, 1.5, 2.0)),
            "second_commander": lambda: chance.uniform(0.0, 1.0),
            "watchdog_dead": lambda: chance.choice((0.0, 1.0)),
            "draught": lambda: self.heat_loss * chance.choice((1.0, 2.0, 3.0)),
            "sense_drift": lambda: chance.choice((0.9, 0.96, 0.99, 1.01, 1.04, 1.1)),
            "hot_ambient": lambda: chance.uniform(0.0, 45.0),
            "slow_answers": lambda: chance.choice((0.001, 0.02, 0.1, 0.2, 0.6)),
        }.get(name, lambda: math.nan)()

    def _promised(self, name: str, value: float) -> str:
        """Row of the table that promises the current off for a fault of the bench, or ""."""
        config = self.config
        read = (
            config.instruments.daq.supply_voltage_channel,
            config.instruments.daq.reference_voltage_channel,
            config.instruments.daq.load_cell_channel,
        )
        rows = {
            "open_wire": "open_wire",
            "short_wire": "short",
            "channel_stuck": "sensor_stuck" if value in read else "",
            "channel_saturated": "reading_saturated" if value in read else "",
            "channel_nan": "reading_stale" if value in read else "",
            # The mean of a block may hold one half of the jump, and the next the other.
            "load_spike": "load_spike" if value > 2.1 * config.safety.load_spike else "",
            "supply_silent": "supply_lost",
            "supply_hangup": "supply_lost",
            "daq_silent": "daq_lost",
            "daq_hangup": "daq_lost",
            # A millampere is the coarsest setting of the supplies in use; below five nobody could tell.
            "second_commander": "second_commander" if abs(value - self.told_A) > 5e-3 else "",
            "slow_answers": "daq_lost" if value > config.instruments.daq.timeout else "",
        }
        if (
            name == "current_disagrees"
            and abs(value - 1.0) * config.supply.bias_current > 1.1 * config.safety.current_disagreement
        ):
            return "supply_disagrees"
        return rows.get(name, "")

    def _switch_off(self) -> None:
        """The commander says off."""
        self.result.counts["switched off"] += 1
        self._cause = "enable false"
        self.bench.watch = self.look
        self.driver.enable(False)
        self.meant_on = False
        self.expect_off_within(2.0 / self.config.loop.rate)
        self._run_for(0.5)
        self.bench.watch = None
        self._cause = ""

    def _restart(self) -> None:
        """The driver ends and another begins, with the wire as hot as it is, some times running."""
        self._cause = "restarts"
        for _ in range(self.chance.choice((1, 1, 5, 20))):
            self._stop()
            self._new_driver()
            self.result.counts["restarts"] += 1
            self._run_for(0.3)
            self.meant_on, _ = self.driver.enable(True)
            self._run_for(0.3)
            self.driver.offer_setpoint(0.0)
            self._run_for(self.chance.uniform(0.1, 8.0))
        self._cause = ""

    def _stop(self) -> None:
        self.driver.stop()
        self.meant_on = False
        if self.bench.supply.output_on:
            self.broken("the output is on after the driver was stopped", f"{self.bench.supply.current_A:.3f} A")


def attack(first: int, sessions: int, seconds: float = SESSION_s) -> Result:
    """Sessions with the seeds from ``first`` on."""
    result = Result()
    for seed in range(first, first + sessions):
        result.add(Session(seed, seconds=seconds).run())
        result.counts["sessions"] += 1
    return result
