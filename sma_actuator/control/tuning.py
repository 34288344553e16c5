"""Gains of a PID from the wire itself: a relay test, what its swings say, and trials about the gains that follow.

The relay test is that of K. J. Åström and T. Hägglund, "Automatic tuning of simple regulators with specifications on
phase and amplitude margins", Automatica 20 (1984) 645.  A wire heats otherwise than it cools, so that each half of a
swing is fitted apart, as with the asymmetric relay of J. Berner, T. Hägglund and K. J. Åström, "Asymmetric relay
autotuning – practical features for industrial use", Control Eng. Practice 54 (2016) 231: how long the wire goes on the
old way after the current has changed, and how fast it goes then.  Gains follow by the rules of S. Skogestad, "Simple
analytic rules for model reduction and PID controller tuning", J. Process Control 13 (2003) 291, for an integrating
process with a dead time.

What the rules make of it is a linear process about one point.  A wire has hysteresis, and an estimate that may change
its mind about the branch; so these gains and others about them are tried on a few steps and a slow ramp, and the best
are taken.  No gains that stood before enter.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf, isfinite, sqrt

import numpy as np

from sma_actuator.base.signals import Tuned

from .law import OWN_PERIODS, ControlLaw
from .pid import PidParameters, SHORTEST_STEP_s

#: What is tuned.  The rules ask for no derivative where nothing but a dead time stands beside the integrating process.
GAINS, INTEGRAL = ("kp", "ki", "kd"), ("ki",)
#: Share of the full stroke either side of the middle within which the relay does not switch.
BAND = 0.02
#: Half-swings of each kind that are left out at the beginning, and those that are wanted.
LEFT_OUT, WANTED = 1, 4
#: The relay test lasts so long at the most; and the wire may take so long to come to the middle.
RELAY_s, COMING_s = 60.0, 30.0
#: The part of the way, before the current changes again, that is fitted; before it lies the hysteresis.
LAST_PART = 0.3
#: No wire asks for such a gain: what is fitted then is noise.
LARGEST_A_m = 1e5
#: Time over which the current that holds the wire is averaged.
HOLDING_s = 5.0
#: Parts of the working range that a trial steps to and stays at; then those it goes to on a ramp.  It begins where it
#: ends.
STEPPED, STAY_s = (0.65, 0.35), 4.0
RAMPED, RAMP_1_s = (0.75, 0.35), 0.05
#: What is tried, from the best so far: which gains, times what.  A step that helps is gone on with, and once one of a
#: pair has helped the other is not tried.
TRIED = (((GAINS, 4.0), (GAINS, 0.25)), ((GAINS, 2.0), (GAINS, 0.5)), ((INTEGRAL, 2.0), (INTEGRAL, 0.5)))
MOST_TRIALS = 9
#: By which share gains must be better to be taken: less is chance.
BETTER = 0.03
#: Unrest of the current at a held setpoint that counts as much as an error twice as large, as share of the bound.
UNREST = 0.1
#: Unrest, as share of the bound, from which a trial counts as one that swings; and how many times less than what swings
#: the gains are at the most.
RESTLESS, MARGIN = 0.06, 4.0


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a tuning has to know of the wire, beside the law that drives it."""

    range_m: tuple[float, float]  #: the working range
    full_stroke_m: float
    bias_A: float
    bound_A: float  #: no more is asked for
    hottest_C: float  #: it is given up above
    period_s: float  #: of the loop
    time_constant_s: float  #: of the wire's heat


@dataclass(frozen=True, slots=True)
class Half:
    """One way of the swings."""

    dead_time_s: float  #: from the change of the current until the wire is on its new way
    slope_m_sA2: float  #: speed then, over the square of the current beyond that which holds the wire


@dataclass(frozen=True, slots=True)
class Swings:
    """What a relay test says: heating and cooling apart, and the current that holds the wire."""

    heating: Half
    cooling: Half
    holding_A: float


class GivenUp(Exception):
    """There will be no gains, and why."""


def swings_of(time_s: np.ndarray, place_m: np.ndarray, current_A: np.ndarray) -> Swings:
    """Fit the halves of the swings.  Raises GivenUp where there are too few."""
    heats = current_A > 0.5 * (current_A.min() + current_A.max())
    changes = np.flatnonzero(heats[1:] != heats[:-1]) + 1
    halves: dict[bool, list[tuple[float, float, float, float]]] = {True: [], False: []}
    for begin, end in pairwise(changes):
        lasts_s = float(time_s[end] - time_s[begin])
        heat_A2s = float(np.sum(current_A[begin:end] ** 2 * np.diff(time_s[begin : end + 1])))
        dead_time_s, speed_m_s = _way(
            time_s[begin : end + 1], place_m[begin : end + 1] * (-1.0 if heats[begin] else 1.0)
        )
        halves[bool(heats[begin])].append((dead_time_s, speed_m_s, heat_A2s, lasts_s))
    fewest = min(len(rows) for rows in halves.values())
    if fewest < LEFT_OUT + WANTED:
        raise GivenUp(
            f"the wire swung {fewest} times about the middle of its working range, {LEFT_OUT + WANTED} are wanted: is "
            "the load one that it lifts with this current?"
        )
    rows = {heated: np.array(values[LEFT_OUT:]) for heated, values in halves.items()}
    everything = np.concatenate(list(rows.values()))
    holding_A2 = float(everything[:, 2].sum() / everything[:, 3].sum())
    found = {}
    for heated, values in rows.items():
        dead_time_s, speed_m_s, heat_A2s, lasts_s = np.median(values, axis=0)
        found[heated] = Half(float(dead_time_s), float(speed_m_s / abs(heat_A2s / lasts_s - holding_A2)))
    return Swings(found[True], found[False], sqrt(holding_A2))


def _way(time_s: np.ndarray, ahead_m: np.ndarray) -> tuple[float, float]:
    """Dead time and speed of one half: the line through the end of its way, and where that leaves the turn."""
    turn = int(np.argmin(ahead_m))
    on_the_way = ahead_m >= ahead_m[turn] + LAST_PART * (ahead_m[-1] - ahead_m[turn])
    on_the_way[:turn], on_the_way[-2:] = False, True
    mean_s, mean_m = float(np.mean(time_s[on_the_way])), float(np.mean(ahead_m[on_the_way]))
    since_s = time_s[on_the_way] - mean_s
    speed_m_s = float(since_s @ ahead_m[on_the_way]) / max(float(since_s @ since_s), SHORTEST_STEP_s**2)
    if not speed_m_s > 0.0:
        return 0.0, 0.0
    return max(mean_s - time_s[0] - (mean_m - float(ahead_m[turn])) / speed_m_s, 0.0), speed_m_s


def gains_of(swings: Swings, period_s: float, time_constant_s: float) -> dict[str, float]:
    """Gains by SIMC, for the faster of the two ways: on the slower one they are the gentler for it.

    The dead time is the shorter one: what the wire takes to cross its hysteresis comes on top, and is the longer the
    less the current changes, so that it says nothing of how soon the wire can answer.  The integral time is the time
    constant of the wire's heat: with a quicker one a wire that stands still inside its hysteresis hunts to and fro over
    it, a slower one follows no ramp.
    """
    slope_m_sA = 2.0 * swings.holding_A * max(way.slope_m_sA2 for way in (swings.heating, swings.cooling))
    dead_time_s = min(way.dead_time_s for way in (swings.heating, swings.cooling)) + OWN_PERIODS * period_s
    kp = 1.0 / max(slope_m_sA * 2.0 * dead_time_s, 1e-9)
    if not kp < LARGEST_A_m:
        raise GivenUp("the wire does not contract with more current, and extend with less")
    return {"kp": kp, "ki": kp / time_constant_s, "kd": 0.0}


@dataclass(frozen=True, slots=True)
class Trial:
    """What came of following a few steps and a ramp with some gains."""

    worth: float  #: to be made little: mean distance from them as share of the full stroke, raised by the unrest
    unrest: float  #: of the current from step to step on the ramp, RMS, as share of the bound


def swings_from_A_m(tried: Mapping[tuple[float, ...], Trial]) -> float:
    """The proportional gain from which the current swings: until then its unrest grows with the gain."""
    calm = max(((gains[0], trial.unrest) for gains, trial in tried.items() if trial.unrest <= RESTLESS), default=None)
    restless_A_m = min((gains[0] for gains, trial in tried.items() if trial.unrest > RESTLESS), default=inf)
    if calm is None or not calm[1] > 0.0:
        return restless_A_m
    return min(restless_A_m, calm[0] * RESTLESS / calm[1])


@dataclass(frozen=True, slots=True)
class Sample:
    """What a tuning sees of a step."""

    time_s: float
    position_m: float
    current_A: float  #: that flowed until now
    temperature_C: float  #: of the wire, by its heat balance


class Tuning:
    """One tuning of the PID ``law``, step by step; in the end there are gains (``found``), or the reason why not."""

    def __init__(self, law: ControlLaw, gains: PidParameters, surroundings: Surroundings, current_A: float):
        self._law, self._gains, self._around = law, gains, surroundings
        low_m, high_m = surroundings.range_m
        self._low_m, self._span_m = low_m, high_m - low_m
        self.setpoint_m = self._place_m(0.5)
        self.words = "the wire comes to the middle of its working range"
        self.found: Tuned | None = None
        self.given_up = ""
        self._resting_A = current_A
        self.output_A = current_A
        self._relay, self._heats = True, False
        self._tried = 0
        self._start_s = float("nan")
        self._program = self._experiments()
        next(self._program)

    def end(self, why: str = "") -> None:
        """The gains of before are the law's again; ``why`` counts where it has not ended by itself."""
        if not self.ended:
            self.given_up = why
        self._law.set_gains(self._gains)

    @property
    def resting_A(self) -> float:
        """The current to go on from: what the law gives, or what holds the wire in the mean of a relay test."""
        return self._resting_A if self._relay else self.output_A

    @property
    def ended(self) -> bool:
        """Whether it is over, with gains or without."""
        return self.found is not None or bool(self.given_up)

    def step(self, sample: Sample, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """The current [A] that is asked for at a setpoint, which is ``setpoint_m`` as far as the limits leave it."""
        limit_A = max(min(limit_A, self._around.bound_A), self._around.bias_A)
        if not (isfinite(sample.time_s + sample.position_m + setpoint_m) and 0.0 <= dt_s < 1e6):
            return self._around.bias_A
        if self._start_s != self._start_s:
            self._start_s = sample.time_s
        squared_A2 = self._resting_A**2
        squared_A2 += min(dt_s / HOLDING_s, 1.0) * (sample.current_A**2 - squared_A2)
        self._resting_A = min(max(sqrt(squared_A2), self._around.bias_A), limit_A)
        if self._relay:
            band_m = BAND * self._around.full_stroke_m
            if sample.position_m > setpoint_m + band_m:
                self._heats = True
            elif sample.position_m < setpoint_m - band_m:
                self._heats = False
            self.output_A = limit_A if self._heats else self._around.bias_A
            self._law.reset(sample.position_m, self.output_A)
        else:
            self.output_A = self._law.step(sample.position_m, setpoint_m, dt_s, limit_A)
        self._go_on(sample, setpoint_m)
        return self.output_A

    def _go_on(self, sample: Sample, setpoint_m: float) -> None:
        if self.ended:
            return
        try:
            if self._relay and setpoint_m != self.setpoint_m:
                raise GivenUp(
                    f"the wire is kept from the middle of its working range, {self.setpoint_m * 1e3:.3g} mm (what "
                    "keeps it is among the limits): take load off, or identify the model anew"
                )
            if not sample.temperature_C <= self._around.hottest_C:
                raise GivenUp(
                    f"the wire is at {sample.temperature_C:.0f} °C by its heat balance, thermal.derate_temperature is "
                    f"{self._around.hottest_C:g} °C: allow less current (controller.tuning_current)"
                )
            self._program.send(sample)
        except GivenUp as reason:
            self.given_up = str(reason)
        except StopIteration as end:
            self.found = end.value

    # --- the experiments ----------------------------------------------------------------------------

    def _experiments(self) -> Generator[None, Sample, Tuned]:
        swings = yield from self._swing()
        gains = gains_of(swings, self._around.period_s, self._around.time_constant_s)
        by_rules = dict(gains)
        self._law.reset(self._last.position_m, swings.holding_A)
        self._relay = False
        self._take(gains)
        yield from self._stay(STEPPED[-1])
        gains = yield from self._improve(gains)
        before = {name: getattr(self._gains, name) for name in GAINS}
        gains = {name: _digits(value) for name, value in gains.items()}
        return Tuned(gains, before, by_rules, self._last.time_s - self._start_s)

    def _improve(self, gains: dict[str, float]) -> Generator[None, Sample, dict[str, float]]:
        """The best of the gains that are tried, with a distance from those at which the current begins to swing."""
        tried = {tuple(gains.values()): (yield from self._try(gains))}
        for pair in TRIED:
            helped = False
            for names, factor in pair:
                if helped:
                    break
                while True:
                    other = self._times(gains, names, factor)
                    key = tuple(other.values())
                    if key not in tried:
                        if len(tried) >= MOST_TRIALS:
                            break
                        tried[key] = yield from self._try(other)
                    if tried[key].worth > (1.0 - BETTER) * tried[tuple(gains.values())].worth:
                        break
                    gains, helped = other, True
        kp = min(gains["kp"], swings_from_A_m(tried) / MARGIN)
        return {**gains, "kp": kp, "ki": min(gains["ki"], kp / self._around.time_constant_s)}

    def _times(self, gains: dict[str, float], names: tuple[str, ...], factor: float) -> dict[str, float]:
        """Gains of which some are multiplied; the integral no quicker than the rules have it."""
        other = {name: value * factor if name in names else value for name, value in gains.items()}
        return {**other, "ki": min(other["ki"], other["kp"] / self._around.time_constant_s)}

    def _swing(self) -> Generator[None, Sample, Swings]:
        """Swing about the middle until there are enough swings to see."""
        rows: list[tuple[float, float, float]] = []
        changes, wanted, heated = 0, 2 * (LEFT_OUT + WANTED) + 2, False
        begun_s = float("nan")
        while changes < wanted:
            sample = yield from self._next()
            if begun_s != begun_s:
                begun_s = sample.time_s
            if sample.time_s - begun_s > (RELAY_s if changes > 1 else COMING_s):
                break
            if self._heats != heated:
                heated = self._heats
                changes += 1
                self.words = f"relay test, {changes} of {wanted} turns"
            rows.append((sample.time_s, sample.position_m, self.output_A))
        return swings_of(*np.array(rows).T)

    def _try(self, gains: dict[str, float]) -> Generator[None, Sample, Trial]:
        """Follow a few steps and a ramp with these gains."""
        self._tried += 1
        self.words = f"trial {self._tried} of at most {MOST_TRIALS}: {words_of(gains)}"
        self._take(gains)
        stepped_m: list[float] = []
        ramped_m: list[float] = []
        currents_A: list[float] = []
        for part in STEPPED:
            stepped_m += yield from self._stay(part)
        for end in RAMPED:
            while part != end:
                before_s = self._last.time_s
                sample = yield from self._next()
                ramped_m.append(abs(sample.position_m - self.setpoint_m))
                currents_A.append(self.output_A)
                most = RAMP_1_s * (sample.time_s - before_s)
                part = min(part + most, end) if end > part else max(part - most, end)
                self.setpoint_m = self._place_m(part)
        error = sqrt(float(np.mean(stepped_m)) * float(np.mean(ramped_m))) / self._around.full_stroke_m
        unrest = float(np.std(np.diff(currents_A))) / (sqrt(2.0) * self._around.bound_A)
        return Trial(error * (1.0 + unrest / UNREST), unrest)

    def _take(self, gains: dict[str, float]) -> None:
        """Let the law go on with other gains, without a jump."""
        self._law.set_gains(replace(self._gains, kp=gains["kp"], ki=gains["ki"], kd=gains["kd"]))

    def _stay(self, part: float) -> Generator[None, Sample, list[float]]:
        """Step to a part of the working range and stay there; how far from it the wire was."""
        self.setpoint_m = self._place_m(part)
        begun_s, apart_m = self._last.time_s, []
        while self._last.time_s - begun_s < STAY_s:
            sample = yield from self._next()
            apart_m.append(abs(sample.position_m - self.setpoint_m))
        return apart_m

    def _next(self) -> Generator[None, Sample, Sample]:
        self._last = yield
        return self._last

    def _place_m(self, part: float) -> float:
        return self._low_m + part * self._span_m


def words_of(gains: Mapping[str, float]) -> str:
    """The gains, to be read."""
    return f"kp {gains['kp']:.4g} A/m, ki {gains['ki']:.4g} A/(m·s), kd {gains['kd']:.4g} A·s/m"


def _digits(value: float) -> float:
    """As a person would write it."""
    return float(f"{value:.3g}")
