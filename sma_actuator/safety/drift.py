"""Two measurements of one current, or of one voltage: what they differ by is noted when it first flows, and must stay.

The supply holds a current, the DAQ measures it over the sense resistor.  Both have errors of scale and zero, which
stand still; what changes between them is a drift.  So a difference is held against the one that was noted, over a
second that averages the noise, and over all the lags that the DAQ may have behind the supply, so that motion is none.

Both measure a voltage too, the supply with its own leads in it: what these drop is on a straight line over current.
"""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isfinite, nan

WINDOW_s = 1.0  #: over which both are averaged
LAG_s = 0.2  #: that the DAQ may be behind the supply, and so much later than usual may a reading come
METER_LAG_s = 0.5  #: that either may be behind the other where the supply measures: slow ones do so twice a second
_BEHIND = 3  #: readings that it may be behind where that takes longer, this one counted
FLOOR_A = 1e-3  #: the step of the coarsest supplies that may be driven
FLOOR_V = 10e-3  #: by how much a supply's voltmeter may wander, beside its scale and the step of its digits
ZERO_V = 50e-3  #: its zero may be off by so much; that stands still
SCALE = 0.015  #: what the scales of both may differ by, beside a drift
STANDS_A = 0.25 * FLOOR_A  #: by how much a current that stands differs in the DAQ's eyes
_STEADY = 3  #: readings that show it
_ROUNDING_s = 1e-6
WIDER = 1.1  #: a current that is so much beyond those that were noted is noted as well


@dataclass(slots=True)
class Means:
    """Means of a few quantities over a second, and between what they have lately moved."""

    lag_s: float
    samples: deque[tuple[float, ...]] = field(default_factory=deque)  #: time, and a value of each
    now: tuple[float, ...] = ()  #: the means
    _sums: list[float] = field(default_factory=list)
    _lately: deque[tuple[float, ...]] = field(default_factory=deque)  #: time, and a mean of each
    _since_s: float = inf
    _usual_s: float = WINDOW_s  #: between the last two readings

    def pause(self) -> None:
        """What comes next has nothing to do with what was."""
        self.samples.clear()
        self._lately.clear()

    def take(self, now_s: float, *values: float) -> None:
        """A reading."""
        samples, lately = self.samples, self._lately
        apart_s = now_s - samples[-1][0] if samples else 0.0
        if not 0.0 <= apart_s <= min(self._usual_s + LAG_s, WINDOW_s):  # who stood still meanwhile is not known
            self.pause()
        elif samples:
            self._usual_s = apart_s
        if not samples:
            self._since_s, self._sums = now_s, [0.0] * len(values)
        samples.append((now_s, *values))
        sums = [total + value for total, value in zip(self._sums, values, strict=True)]
        while now_s - samples[0][0] >= WINDOW_s:
            sums = [total - gone for total, gone in zip(sums, samples.popleft()[1:], strict=True)]
        self._sums, self.now = sums, tuple(total / len(samples) for total in sums)
        lately.append((now_s, *self.now))
        while now_s - lately[0][0] > self.lag_s + _ROUNDING_s and len(lately) > _BEHIND:
            lately.popleft()

    def seen_s(self, now_s: float) -> float:
        """For how long without a break."""
        return now_s - self._since_s

    def least(self, which: int) -> float:
        """The lowest that this mean was within the lag."""
        return min(each[which + 1] for each in self._lately)

    def most(self, which: int) -> float:
        """The highest."""
        return max(each[which + 1] for each in self._lately)


@dataclass(slots=True)
class Noted:
    """By how much one measurement was above the other, by current, when it first flowed."""

    #: What the difference may be by more for each ampere beyond a noted current, of that and its difference.
    steep: Callable[[float, float], float]
    #: Current, by how much it was above, and how exactly that is known, by current.
    _all: list[tuple[float, float, float]] = field(default_factory=list)

    def forget(self) -> None:
        """Begin anew."""
        self._all.clear()

    def change(self, current_A: float, above: float) -> tuple[float, float]:
        """What the difference has changed by, and how exactly that is known: between currents that were noted on a
        straight line, beyond them the change that is worst."""
        noted = self._all
        after = bisect.bisect(noted, (current_A,))
        if 0 < after < len(noted):
            (low_A, low, low_vague), (high_A, high, high_vague) = noted[after - 1], noted[after]
            way = (current_A - low_A) / (high_A - low_A)
            return above - (low + way * (high - low)), low_vague + way * (high_vague - low_vague)
        found = [(above - was, vague + self.steep(at_A, was) * abs(current_A - at_A)) for at_A, was, vague in noted]
        return max(found, key=lambda each: abs(each[0]) - each[1], default=(nan, nan))

    def note(self, current_A: float, above: float, vague: float, change: float, known: float) -> None:
        """Note a current that is new, or a difference that is known more exactly than from those that were noted."""
        noted = self._all
        near = [each for each in noted if each[0] / WIDER <= current_A <= each[0] * WIDER]
        is_new = not near and not (noted and noted[0][0] < current_A < noted[-1][0])
        exact = vague < 0.5 * min((known, *(each[2] for each in near))) and abs(change) <= vague + known
        if is_new or exact:
            self._all = sorted([*(each for each in noted if each not in near), (current_A, above, vague)])


def _by_scale(_: float, __: float) -> float:
    return SCALE


def _by_leads(current_A: float, above_V: float) -> float:
    """Resistance [Ω] of leads that drop so much at this current, but for the zero error of a meter."""
    return (abs(above_V) + ZERO_V) / current_A


@dataclass(slots=True)
class CurrentsApart:
    """How far the DAQ's current has come from the supply's since both were first seen."""

    _means: Means = field(default_factory=lambda: Means(LAG_s))  #: the DAQ's, the supply's from, to
    _noted: Noted = field(default_factory=lambda: Noted(_by_scale))

    def pause(self) -> None:
        """Nothing can be compared now; what was noted stays."""
        self._means.pause()

    def forget(self) -> None:
        """Begin anew."""
        self.pause()
        self._noted.forget()

    def step(self, now_s: float, daq_A: float, from_A: float, to_A: float, share: float) -> tuple[float, float]:
        """What the DAQ's current has changed by against the supply's, which lies from ``from_A`` to ``to_A``, and what
        it may [A].

        NaN until that is known.  ``share`` of the current may be a drift.
        """
        self._means.take(now_s, daq_A, from_A, to_A)
        seen_s = self._means.seen_s(now_s)
        seen = self._means_now() if seen_s >= WINDOW_s + LAG_s else self._steady(seen_s)
        if seen is None:
            return nan, nan
        supply_A, above_A, vague_A = seen
        drift_A = share * supply_A + FLOOR_A
        change_A, known_A = self._noted.change(supply_A, above_A)
        allowed_A = known_A + drift_A + vague_A
        if vague_A <= drift_A and not abs(change_A) > allowed_A:
            self._noted.note(supply_A, above_A, vague_A, change_A, known_A)
        return change_A, allowed_A

    def _means_now(self) -> tuple[float, float, float]:
        """The supply's current, by how much the DAQ's is above it, and how exactly that is known."""
        low_A, high_A = self._means.least(1), self._means.most(2)
        supply_A = 0.5 * (low_A + high_A)
        return supply_A, self._means.now[0] - supply_A, 0.5 * (high_A - low_A)

    def _steady(self, seen_s: float) -> tuple[float, float, float] | None:
        """The same of the current that is the first to flow, once the DAQ shows that it stands: it may flow for a
        moment only."""
        samples = self._means.samples
        latest = [sample[1] for sample in samples][-_STEADY:]
        low_A, high_A = min(sample[2] for sample in samples), max(sample[3] for sample in samples)
        stands = max(latest) - min(latest) <= STANDS_A and high_A - low_A <= STANDS_A
        if not (stands and len(latest) == _STEADY and seen_s >= LAG_s - _ROUNDING_s):
            return None
        supply_A = 0.5 * (low_A + high_A)
        return supply_A, sum(latest) / _STEADY - supply_A, STANDS_A


@dataclass(slots=True)
class VoltagesApart:
    """How far the DAQ's voltage has come from the supply's since both were first seen."""

    _means: Means = field(default_factory=lambda: Means(METER_LAG_s))  #: the current, the DAQ's and the supply's
    _noted: Noted = field(default_factory=lambda: Noted(_by_leads))
    _latest_V: float = nan  #: the supply's
    _digit_V: float = inf  #: the least by which it has changed

    def pause(self) -> None:
        """Nothing can be compared now; what was noted stays."""
        self._means.pause()

    def forget(self) -> None:
        """Begin anew."""
        self.pause()
        self._noted.forget()

    def step(self, now_s: float, current_A: float, daq_V: float, supply_V: float, share: float) -> tuple[float, float]:
        """What the DAQ's voltage has changed by against the supply's at such a current, and what it may [V].

        NaN until that is known.  ``share`` of the voltage may be a drift.
        """
        if supply_V != self._latest_V and isfinite(self._latest_V):
            self._digit_V = min(self._digit_V, abs(supply_V - self._latest_V))
        self._latest_V = supply_V
        means = self._means
        means.take(now_s, current_A, daq_V, supply_V)
        if not (means.seen_s(now_s) >= WINDOW_s + METER_LAG_s and isfinite(self._digit_V)):
            return nan, nan
        low_V, high_V = means.least(2), means.most(2)
        daq_low_V, daq_high_V = means.least(1), means.most(1)
        above_V = 0.5 * (daq_low_V + daq_high_V - low_V - high_V)
        vague_V = 0.5 * (high_V - low_V + daq_high_V - daq_low_V + self._digit_V)
        drift_V = share * 0.5 * (low_V + high_V) + FLOOR_V
        change_V, known_V = self._noted.change(means.now[0], above_V)
        allowed_V = known_V + drift_V + vague_V
        if vague_V <= drift_V and not abs(change_V) > allowed_V:
            self._noted.note(means.now[0], above_V, vague_V, change_V, known_V)
        return change_V, allowed_V
