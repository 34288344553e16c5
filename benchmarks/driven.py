"""One run of the loop on a wire that came the user's way (``users_way.py``): what is asked for, what came of it.

The same driver, actuator and supervisor as in the node, in virtual time.  Programs are those of ``control_tables.py``:
a position for 20 s each, or 60 s a period, over 85 % of the stroke that the wire truly has under every load of the run.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from control_tables import CONSTANT, SPRING, STEPS, SWITCHED, VARYING, DURATION_s, DWELL_s, PERIOD_s, program
from kept import MODEL, kept
from trial_laws import TRIALS
from users_way import bench_of, cycles_done, digest, identified, scaled, stroke_of

from sma_actuator.base.signals import Mode, Reading
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.config import Config
from sma_actuator.control.setpoints import Setpoint
from sma_actuator.driver import Driver
from sma_actuator.plant.loads import Load, Spring, Weight

LAWS = ("pid", "feed_forward_pid", *TRIALS)
#: Stresses [Pa] of the lightest and the heaviest weight, within what ``characterise`` hangs on a wire.
LIGHT_Pa, HEAVY_Pa = 17e6, 110e6
#: Loads that are the same for both wires, by name, and those that are the wire's.
SHARED: dict[str, Load] = {
    "weight": CONSTANT,
    "spring": SPRING,
    "switched": SWITCHED,
    "varying": VARYING,
    "stiff_spring": Spring(stiffness_N_m=400.0, preload_N=0.6),
}
LOADS = (*SHARED, "light", "heavy")
#: Share of the true stroke that a program spans.
SPAN = 0.85
#: From the first reading to ``enable``.
REST_s = 2.0
#: A position is held over the last part of its time, and reached if the wire was this near then, % of full stroke.
LAST, REACHED = 0.25, 2.0
#: A wire that follows is as near as this for the whole time, % of full stroke; from the second period on.
FOLLOWED = 5.0
#: The limits that say that the wire cannot go where it is told to: here it always can.
FALSE = ("setpoint_range", "setpoint_reach")
#: What decides a run beside the model.
RUN_BY = (
    "control",
    "safety",
    "config",
    "driver",
    "actuator",
    "derived",
    "instruments",
    "trial_laws",
    "users_way",
    "grains",
    "driven",
    "control_tables",
)


@dataclass(frozen=True)
class Case:
    """One run."""

    wire: str
    physics: str
    model: str
    load: str
    program: str
    law: str
    #: What the wire's heat loss is over that of its calibration (a draught, a tube).
    heat_loss: float = 1.0
    changes: tuple[tuple[str, Any], ...] = ()
    #: Parameters of the section ``thermal`` that are wrong, and by what factor.
    wrong: tuple[tuple[str, float], ...] = ()
    #: Noise of the DAQ over that of the bench's, in the run.
    noise: float = 1.0
    #: How much warmer the room is than at the calibration [K], and by how much more its sensor reads.
    warmer_K: float = 0.0
    sensor_K: float = 0.0


@dataclass
class Found:
    """What came of it; errors are mean absolute, in % of full stroke, every sample from the first setpoint on.

    Setpoint, estimate and truth of a sample are of one time, as in the thesis and in :func:`fastest`.
    """

    case: Case
    model: float  #: estimate and truth
    control: float  #: asked and estimate
    output: float  #: asked and truth
    going: float  #: control, from the second period on; NaN for steps
    held: float  #: output where positions are held; NaN but for steps
    held_model: float  #: model there
    there: float  #: share of the positions that were reached and held, or of the time that the wire followed
    covered: float  #: share of the samples with the truth in the 95 % interval
    unrest: float  #: the command from sample to sample, rms, % of max_current: held (steps) or moving (else)
    hottest_C: float  #: the wire's hottest place, in truth
    limits_s: dict[str, float]  #: how long each limit bent the setpoint or the command
    fault: str = ""
    series: dict[str, np.ndarray] = field(default_factory=dict, repr=False)

    @property
    def false_s(self) -> float:
        """How long the driver said that the wire cannot go where it can."""
        return max(self.limits_s.get(name, 0.0) for name in FALSE)


def load_of(case: Case, config: Config) -> Load:
    """The load of a run; the lightest and the heaviest by the wire's section."""
    weights_Pa = {"light": LIGHT_Pa, "heavy": HEAVY_Pa}
    if case.load in SHARED:
        return scaled(case.wire, SHARED[case.load])
    return Weight(float(f"{weights_Pa[case.load] * config.wire.area_m2:.3g}"))


def bench_for(case: Case, config: Config, seed: int) -> VirtualBench:
    """A bench with the wire that was characterised, as it is since, and this load."""
    cycles = cycles_done(case.wire, case.physics)
    return bench_of(case.wire, case.physics, cycles, seed, load_of(case, config), case.noise, case.warmer_K)


def setpoint_of(case: Case, config: Config) -> Setpoint:
    """What is asked for: a program that spans :data:`SPAN` of the true stroke."""
    hot_m, cold_m = stroke_of(case.wire, case.physics, load_of(case, config))
    parts = (min(STEPS), max(STEPS)) if case.program == "steps" else (0.1, 0.9)
    span_m = SPAN * (cold_m - hot_m) / (parts[1] - parts[0])
    low_m = hot_m + 0.5 * (1.0 - SPAN) * (cold_m - hot_m) - parts[0] * span_m
    return program(case.program, low_m, low_m + span_m)


def config_of(case: Case) -> Config:
    """What the node would be given."""
    mapping = identified(case.wire, case.physics, case.model)
    config = Config.from_mapping({**mapping, "controller": {**mapping["controller"], "type": case.law}})
    config = config.replace(dict(case.changes))
    return config.replace({f"thermal.{name}": times * getattr(config.thermal, name) for name, times in case.wrong})


class OtherRoom(InProcessDaq):
    """A DAQ whose sensor of the surroundings reads that of another room."""

    def __init__(self, bench: VirtualBench, config: Config, sensor_K: float):
        super().__init__(bench, config)
        self._sensor_K = sensor_K

    def read_block(self) -> Reading:
        """A reading of it."""
        reading = super().read_block()
        return replace(reading, ambient_temperature_C=reading.ambient_temperature_C + self._sensor_K)


def once(case: Case) -> Found:
    """A run, or what it came to the last time."""
    return kept(f"driven {case} {digest(RUN_BY)}", MODEL, lambda: run(case))


def run(case: Case, keep: bool = False) -> Found:
    """One run; ``keep``: with every sample."""
    config = config_of(case)
    setpoint = setpoint_of(case, config)
    bench = bench_for(case, config, seed=7)
    if case.heat_loss != 1.0:
        bench.inject("draught", case.heat_loss)
    rows: list[tuple[float, ...]] = []
    limits_s: dict[str, float] = {}
    fault, hottest_C, period_s = "", -np.inf, 1.0 / config.loop.rate
    daq = OtherRoom(bench, config, case.sensor_K)
    with Driver(config, InProcessSupply(bench, config), daq, VirtualClock(bench)) as driver:
        driver.run_for(REST_s)
        done, words = driver.enable(True)
        if not done:
            raise RuntimeError(f"{case}: {words}")
        start_s = bench.time_s
        while (elapsed_s := bench.time_s - start_s) < DURATION_s and not fault:
            asked_m = setpoint(elapsed_s)
            driver.offer_setpoint(asked_m)
            here_m = bench.truth.displacement_m  # now: when the reading ends that the estimate is of
            end_s = start_s + (len(rows) + 1) * period_s  # the bench counts milliseconds, and every period has one step
            output = driver.run_for(end_s - bench.time_s)
            hottest_C = max(hottest_C, bench.hottest_C)
            estimate = output.estimate
            values = (asked_m, estimate.displacement_m, here_m, output.command.current_A)
            rows.append((elapsed_s, *values, estimate.uncertainty_m))
            for name in output.status.limits:
                limits_s[name] = limits_s.get(name, 0.0) + period_s
            if output.status.mode is Mode.OFF:
                fault = output.status.fault
    found = _judged(case, config, rows, hottest_C=hottest_C, limits_s=limits_s, fault=fault)
    if keep:
        names = ("time_s", "asked_m", "estimate_m", "truth_m", "current_A", "uncertainty_m")
        found.series = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    return found


def _judged(case: Case, config: Config, rows: list[tuple[float, ...]], *, fault: str, **seen: Any) -> Found:
    """What the samples of a run say, beside what else was ``seen``."""
    time_s, asked_m, estimate_m, truth_m, current_A, uncertainty_m = np.array(rows, dtype=float).T
    period_s, percent = 1.0 / config.loop.rate, 100.0 / config.wire.full_stroke_m
    model, control, output = (
        percent * np.abs(a - b) for a, b in ((truth_m, estimate_m), (asked_m, estimate_m), (asked_m, truth_m))
    )
    jumps = np.append(np.diff(current_A), 0.0) / config.supply.max_current * 100.0
    known = np.isfinite(uncertainty_m)
    found = Found(
        case,
        model=_mean(model),
        control=_mean(control),
        output=_mean(output),
        going=np.nan,
        held=np.nan,
        held_model=np.nan,
        there=np.nan,
        covered=_mean(np.abs(truth_m - estimate_m)[known] <= uncertainty_m[known]),
        unrest=np.nan,
        fault=fault,
        **seen,
    )
    if case.program == "steps":
        part = time_s % DWELL_s / DWELL_s
        last = part >= 1.0 - LAST
        found.held, found.held_model = _mean(output[last]), _mean(model[last])
        quiet = (part >= 0.5) & (part < 1.0 - 2.0 * period_s / DWELL_s)
        found.unrest = float(np.sqrt(_mean(jumps[quiet] ** 2)))
        found.there = _reached(time_s, output, truth_m < asked_m, current_A <= 1.01 * config.supply.bias_current)
    else:
        later = time_s >= PERIOD_s
        found.going = _mean(control[later])
        found.unrest = float(np.sqrt(_mean(jumps[later] ** 2)))
        found.there = _mean(output[later] <= FOLLOWED) if later.any() else 0.0
    if fault:
        found.there = 0.0
    return found


def _mean(values: np.ndarray) -> float:
    return float(np.nanmean(values)) if np.isfinite(np.asarray(values, dtype=float)).any() else np.nan


def _reached(time_s: np.ndarray, output: np.ndarray, too_short: np.ndarray, at_bias: np.ndarray) -> float:
    """Share of the positions that the wire was at in the last part of their time.

    One that it is still cooling towards then, with no more than the bias current, is left out: no law comes there
    sooner.
    """
    number = (time_s // DWELL_s).astype(int)
    last = time_s % DWELL_s >= (1.0 - LAST) * DWELL_s
    reached = []
    for step in range(number[-1] + 1):
        here = last & (number == step)
        if not here.any():
            continue
        there = _mean(output[here]) <= REACHED
        if there or not (too_short & at_bias)[here].all():
            reached.append(there)
    return float(np.mean(reached)) if reached else np.nan


def fastest_once(case: Case) -> float:
    """:func:`fastest`, or what it came to the last time."""
    same = replace(case, law="", changes=(), wrong=(), sensor_K=0.0)
    return kept(
        f"fastest {same} {digest(('users_way', 'grains', 'driven', 'control_tables', 'derived', 'control'))}",
        MODEL,
        lambda: fastest(case),
    )


def fastest(case: Case) -> float:
    """Mean absolute error of a wire that gets full current, or the bias, until it is where it should be, and counts as
    there until the next step [% of full stroke]: what no law that keeps to the current can better."""
    config = config_of(case)
    setpoint, bench = setpoint_of(case, config), bench_for(case, config, seed=7)
    supply = bench.supply
    supply.set_voltage(config.supply.max_voltage)
    supply.set_current(config.supply.bias_current)
    supply.set_output(True)
    bench.advance(REST_s)
    errors_m, asked_m, side = [], np.nan, 0.0
    for k in range(round(DURATION_s * config.loop.rate)):
        if setpoint(k / config.loop.rate) != asked_m:
            asked_m = setpoint(k / config.loop.rate)
            side = np.sign(bench.truth.displacement_m - asked_m)
        too_long_m = bench.truth.displacement_m - asked_m
        if too_long_m * side <= 0.0:
            side = 0.0  # it has come there
        supply.set_current(config.supply.max_current if too_long_m > 0.0 else config.supply.bias_current)
        bench.advance(REST_s + (k + 1) / config.loop.rate)
        errors_m.append(abs(too_long_m) if side else 0.0)
    return float(np.mean(errors_m)) / config.wire.full_stroke_m * 100.0
