"""Sensors that lie slowly or plausibly, while the wire is driven: nothing jumps, nothing stands still to the last
digit.

At home with the parameters that ship, elsewhere the user's way, as in `ends`: a model from the wire's own logs, limits
by `init`; with another wire's parameters guards accuse these, rightly, before anything lies.  The judge knows the
bench's truth: by how much more the position is wrong than before the lie, until a fault says that something is wrong;
and that an honest stand is never accused, in any physics, whatever it is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Output
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.driver import Driver
from sma_actuator.plant.loads import Load, Spring, Weight
from sma_actuator.plant.worlds import HOME

from .ends import TRAINED, identified
from .heat import UNITS
from .result import Result, Violation

LOADS: tuple[Load, ...] = (Weight(0.49), Weight(0.98), Spring(400.0, 0.6), Weight(1.96))
BEGINS_s, LASTS_s = 25.0, 60.0
PERIOD_s = 9.0
SHARES = (0.15, 0.85)  #: of what can be reached, between which it is moved


@dataclass(frozen=True, slots=True)
class Lie:
    """A fault of the bench, and what may come of it before the driver names a fault."""

    fault: str
    value: float
    wrong_at_most: float = math.inf  #: the position, in full strokes, beyond what it was wrong by before
    within_s: float = math.inf
    #: Only where the wire is moved can it be told from what is honest: beside a displacement sensor; or, of a load cell
    #: on a spring that is driven from the start, by a load that does not follow.
    moved: bool = False


LIES = {
    "a sense resistor that rises by 0.4 % a second": Lie("sense_drift", 1.04, 0.25),
    "a sense resistor that falls by 0.4 % a second": Lie("sense_drift", 0.96, 0.25),
    "a sense resistor that rises by 0.04 % a second": Lie("sense_drift", 1.004, 0.25),
    "a voltage channel that rises by 0.4 % a second": Lie("voltage_drift", 1.04, 0.5),
    "a voltage channel that falls by 0.4 % a second": Lie("voltage_drift", 0.96, 0.5),
    "a load cell that stands but for its converter's dither": Lie(
        "channel_dithers", 103.0, within_s=2.0 * PERIOD_s, moved=True
    ),
    "load and displacement channel swapped": Lie("channel_swapped", 103.0, within_s=1.5 * PERIOD_s, moved=True),
    "a load that sinks by a tenth a second": Lie("channel_sinks", 103.0, within_s=3.0 * PERIOD_s, moved=True),
    "a displacement sensor that freezes": Lie("channel_stuck", 104.0, within_s=PERIOD_s, moved=True),
    "a block that comes again and again": Lie("block_repeats", math.nan, within_s=1.0),
}


def _held(_: float) -> float:
    return 0.5


def _sine(time_s: float) -> float:
    return 0.5 - 0.5 * math.cos(2.0 * math.pi * time_s / PERIOD_s)


def _steps(time_s: float) -> float:
    return math.floor(2.0 * time_s / PERIOD_s) % 2


MOTIONS: dict[str, Callable[[float], float]] = {"held": _held, "sine": _sine, "steps": _steps}


def shipped(wire: str) -> Config:
    """The parameters of a wire that ship."""
    return Config.from_mapping(read_parameter_file(shared_file(f"config/{wire}.yaml")))


class Lying:
    """One wire in one physics."""

    def __init__(self, unit: int):
        self.unit = unit
        self.wire, self.physics = UNITS[unit]
        self.cycles = 0.0 if self.physics == HOME else TRAINED
        self.config = shipped(self.wire) if self.physics == HOME else identified(self.wire, self.physics)
        self.result = Result()

    def run(self) -> Result:
        """Every lie in every motion, under loads in turn, and honest stands between them."""
        for number, (words, lie) in enumerate(LIES.items()):
            for turn, motion in enumerate(MOTIONS):
                self.judge(words, lie, motion, LOADS[(self.unit + number + turn) % len(LOADS)])
        for number, motion in enumerate(MOTIONS):
            self.judge("none", None, motion, LOADS[(self.unit + number) % len(LOADS)])
        return self.result

    def judge(self, words: str, lie: Lie | None, motion: str, load: Load) -> None:
        """Drive, and see what becomes of it."""
        before, after, output, after_s = self.drive(lie, motion, load)
        scene = f"{self.wire} in {self.physics}, {load}, {motion}"
        replay = f"python -m attack lies --only {self.unit}"
        fault = output.status.fault
        self.result.counts["wires driven"] += 1
        if lie is None:
            if fault:
                self.result.violations.append(
                    Violation("an honest stand is accused", f"{scene}: {output.status.message}", replay)
                )
            return
        self.result.see(f"{words}: position wrong by so much more [% of the stroke]", 100.0 * (after - before))
        self.result.counts["lies"] += 1
        if after_s < 0.0:
            self.result.violations.append(
                Violation("a fault before the lie", f"{scene}: {output.status.message}", replay)
            )
        elif fault:
            self.result.counts["lies found"] += 1
            self.result.see(f"{words}: until a fault [s]", after_s)
        within_s = math.inf if lie.moved and motion == "held" else lie.within_s
        if after - before > lie.wrong_at_most or after_s > within_s:
            detail = (
                f"{scene}: wrong by {after:.0%} of the stroke, before {before:.0%}, and {fault or 'no fault'} "
                f"after {after_s:.1f} s"
            )
            self.result.violations.append(Violation(f"believed: {words}", detail, replay))

    def drive(self, lie: Lie | None, motion: str, load: Load) -> tuple[float, float, Output, float]:
        """The largest error of the position before the lie and after it, in full strokes; the last output, and how long
        after the lie began it came [s]."""
        config = self.config
        bench = VirtualBench.from_name(self.wire, seed=self.unit, load=load, physics=self.physics, cycles=self.cycles)
        worst, outputs = [0.0, 0.0], []

        def look(output: Output) -> None:
            outputs[:] = [output]
            error_m = abs(output.estimate.displacement_m - bench.truth.displacement_m)
            if output.command.output_on and bench.time_s > 3.0 and math.isfinite(error_m):
                late = bench.time_s > BEGINS_s
                worst[late] = max(worst[late], error_m / config.wire.full_stroke_m)

        supply, daq = InProcessSupply(bench, config), InProcessDaq(bench, config)
        driver = Driver(config, supply, daq, VirtualClock(bench), on_output=look)
        driver.run_for(0.5)
        driver.enable(True)
        if lie is not None:
            bench.inject(lie.fault, lie.value, at_s=BEGINS_s)
        driver.run_for(0.5)
        while bench.time_s < BEGINS_s + LASTS_s and not outputs[0].status.fault:
            short_m, long_m = (float(outputs[0].status.values[name]) for name in ("shortest_m", "longest_m"))
            share = SHARES[0] + MOTIONS[motion](bench.time_s) * (SHARES[1] - SHARES[0])
            driver.offer_setpoint(long_m + share * (short_m - long_m))
            driver.run_for(0.2)
        driver.stop()
        return worst[0], worst[1], outputs[0], bench.time_s - BEGINS_s


def attack(unit: int) -> Result:
    """One of ``UNITS``."""
    return Lying(unit).run()
