"""Two measurements of one current, or of one voltage: what they differ by is noted when it first flows, and must stay.

The supply holds a current, the DAQ measures it over the sense resistor.  Both have errors of scale and zero, which
stand still; what changes between them is a drift.  So a difference is held against the one that was noted, over a
second that averages the noise.  One may be behind the other: what it shows then is what was so long ago, by the clock
or by readings.  So each reading is held against what was at each such time, and the difference is known but for how
much its mean depends on that: where nothing moves, exactly, however seldom or irregularly the readings come.

Both measure a voltage too, the supply with its own leads in it: what these drop is on a straight line over current.
"""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isfinite, nan, sqrt

WINDOW_s = 1.0  #: over which both are averaged
#: And over this, for a wire that is moved: some of its cycles; in half of it a drift of 0.4 % a second comes to 1.6 %.
LONG_s = 8.0
LAG_s = 0.2  #: that the DAQ may be behind the supply, and so much later than usual may a reading come
METER_LAG_s = 0.5  #: that either may be behind the other where the supply measures: slow ones do so twice a second
_LAGS = 4  #: parts of the lag that are looked at: of 0.2 s each is a period of the usual loop
_BEHIND = 2  #: readings that it may be behind where that takes longer
FLOOR_A = 1e-3  #: the step of the coarsest supplies that may be driven
FLOOR_V = 10e-3  #: by how much a supply's voltmeter may wander, beside its scale and the step of its digits
ZERO_V = 50e-3  #: its zero may be off by so much; that stands still
SCALE = 0.015  #: what the scales of both may differ by, beside a drift
STANDS_A = 0.25 * FLOOR_A  #: by how much a current that stands differs in the DAQ's eyes
_STEADY = 3  #: readings that show it
_ROUNDING_s = 1e-6
WIDER = 1.1  #: a current that is so much beyond those that were noted is noted as well


@dataclass(slots=True)
class Past:
    """What a quantity was, by the time until which it was so."""

    lag_s: float
    _all: deque[tuple[float, float]] = field(default_factory=deque)

    def clear(self) -> None:
        """Forget it."""
        self._all.clear()

    def take(self, now_s: float, value: float) -> list[float]:
        """What it is now and what it was at each lag, by the clock and by readings; the most of these is the last."""
        past = self._all
        past.append((now_s, value))
        while len(past) > _BEHIND + 1 and past[1][0] < now_s - self.lag_s:
            past.popleft()
        out, at = [], len(past) - 1
        for part in range(_LAGS + 1):
            then_s = now_s - self.lag_s * part / _LAGS - _ROUNDING_s
            while at > 0 and past[at - 1][0] >= then_s:
                at -= 1
            out.append(past[at][1])
        return out + [past[max(-1 - behind, -len(past))][1] for behind in range(1, _BEHIND + 1)]


@dataclass(slots=True)
class Means:
    """Means of two quantities, and of what a third may have been, by how late it is told."""

    window_s: float
    samples: deque[tuple[float, ...]] = field(
        default_factory=deque
    )  #: time, both, (range)², whether new, and the third
    now: list[float] = field(default_factory=list)
    _sums: list[float] = field(default_factory=list)
    _since_s: float = inf

    def begin(self) -> None:
        """What comes next has nothing to do with what was."""
        self.samples.clear()

    def take(self, now_s: float, both: list[float], third: list[float], late: float, is_new: bool = True) -> None:
        """A reading, and what the third may have been.  ``late``: by so much may it be off since one reading is later
        than others.  ``is_new``: not the one before, shown again."""
        values = [*both, late * late, float(is_new), *third]
        samples = self.samples
        if not samples:
            self._since_s, self._sums = now_s, [0.0] * len(values)
        samples.append((now_s, *values))
        sums = [total + value for total, value in zip(self._sums, values, strict=True)]
        while now_s - samples[0][0] >= self.window_s:
            sums = [total - gone for total, gone in zip(sums, samples.popleft()[1:], strict=True)]
        self._sums, self.now = sums, [total / len(samples) for total in sums]

    def among(self) -> tuple[float, float]:
        """The third, and how exactly its mean is known: all readings may be late, each by something else at random."""
        low, high = min(self.now[4:]), max(self.now[4:])
        at_random = sqrt(max(0.0, self.now[2]) / max(1.0, self.now[3] * len(self.samples)))
        return 0.5 * (low + high), 0.5 * (high - low + at_random)

    def seen_s(self, now_s: float) -> float:
        """For how long without a break."""
        return now_s - self._since_s


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
class Apart:
    """How far one measurement has come from another since both were first seen."""

    lag_s: float  #: that the one may be behind the other
    floor: float  #: of what is a drift, beside its share
    steep: Callable[[float, float], float]
    #: Over a second, and over longer.
    means: tuple[Means, Means] = field(init=False, default_factory=lambda: (Means(WINDOW_s), Means(LONG_s)))
    _noted: Noted = field(init=False)
    _usual_s: float = field(init=False, default=WINDOW_s)  #: between the last two readings
    _last_s: float = field(init=False, default=nan)
    _odd: float = field(init=False, default=1.0)  #: share of the time between two by which the last came early or late

    def __post_init__(self) -> None:
        self._noted = Noted(self.steep)

    def pause(self) -> None:
        """Nothing can be compared now; what was noted stays."""
        for means in self.means:
            means.begin()

    def forget(self) -> None:
        """Begin anew."""
        self.pause()
        self._noted.forget()

    def begins(self, now_s: float) -> bool:
        """Whether what comes with a reading now has nothing to do with what was: who stood still meanwhile is not
        known."""
        apart_s = now_s - self._last_s
        self._last_s = now_s
        if self.means[0].samples and 0.0 <= apart_s <= min(self._usual_s + LAG_s, WINDOW_s):
            self._odd = min(abs(apart_s - self._usual_s) / max(self._usual_s, _ROUNDING_s), 1.0)
            self._usual_s = apart_s
            return False
        self.pause()
        return True

    def judged(self, current_A: float, above: float, vague: float, may_drift: float) -> tuple[float, float]:
        """What the difference at a current has changed by, and what it may."""
        drift = may_drift + self.floor
        change, known = self._noted.change(current_A, above)
        allowed = known + drift + vague
        if vague <= drift and not abs(change) > allowed:
            self._noted.note(current_A, above, vague, change, known)
        return change, allowed

    def worst(self, now_s: float, of: Callable[[Means], tuple[float, float, float, float]]) -> tuple[float, float]:
        """What is most beyond what it may, of the means that are full; NaN while none is.

        ``of`` them: current, difference, how exactly that is known, and what may be a drift.
        """
        full = [self.judged(*of(each)) for each in self.means if each.seen_s(now_s) >= each.window_s + self.lag_s]
        return max(full, key=lambda said: abs(said[0]) - said[1], default=(nan, nan))


class CurrentsApart(Apart):
    """How far the DAQ's current has come from the supply's since both were first seen."""

    def __init__(self) -> None:
        super().__init__(LAG_s, FLOOR_A, _by_scale)
        self._from, self._to = Past(LAG_s), Past(LAG_s)

    def step(self, now_s: float, daq_A: float, from_A: float, to_A: float, share: float) -> tuple[float, float]:
        """What the DAQ's current has changed by against the supply's, which lies from ``from_A`` to ``to_A``, and what
        it may [A].

        NaN until that is known.  ``share`` of the current may be a drift.
        """
        if self.begins(now_s):
            self._from.clear()
            self._to.clear()
        low, high = self._from.take(now_s, from_A), self._to.take(now_s, to_A)
        late_A = max(abs(each[0] - each[-_BEHIND]) for each in (low, high))  # by a reading
        late_A *= sqrt(self._odd)  # as likely as it did not come when it usually does
        for means in self.means:
            means.take(now_s, [daq_A, daq_A], low + high, late_A)
        if self.means[0].seen_s(now_s) < WINDOW_s + LAG_s:
            seen = self._steady(now_s)
            return self.judged(*seen, share * seen[0]) if seen else (nan, nan)

        def of(means: Means) -> tuple[float, float, float, float]:
            supply_A, vague_A = means.among()
            return supply_A, means.now[0] - supply_A, vague_A, share * supply_A

        return self.worst(now_s, of)

    def _steady(self, now_s: float) -> tuple[float, float, float] | None:
        """The current that is the first to flow, by how much the DAQ's is above it, and how exactly that is known, once
        the DAQ shows that it stands: it may flow for a moment only."""
        samples = self.means[0].samples
        latest = [sample[1] for sample in samples][-_STEADY:]
        low_A, high_A = min(min(sample[5:]) for sample in samples), max(max(sample[5:]) for sample in samples)
        stands = max(latest) - min(latest) <= STANDS_A and high_A - low_A <= STANDS_A
        if not (stands and len(latest) == _STEADY and self.means[0].seen_s(now_s) >= LAG_s - _ROUNDING_s):
            return None
        supply_A = 0.5 * (low_A + high_A)
        return supply_A, sum(latest) / _STEADY - supply_A, STANDS_A


class VoltagesApart(Apart):
    """How far the DAQ's voltage has come from the supply's since both were first seen."""

    def __init__(self) -> None:
        super().__init__(METER_LAG_s, FLOOR_V, _by_leads)
        self._daq, self._supply = Past(METER_LAG_s), Past(METER_LAG_s)
        self._latest_V, self._digit_V = nan, inf  # the supply's, and the least by which it has changed

    def step(self, now_s: float, current_A: float, daq_V: float, supply_V: float, share: float) -> tuple[float, float]:
        """What the DAQ's voltage has changed by against the supply's at such a current, and what it may [V].

        NaN until that is known.  ``share`` of the voltage may be a drift.
        """
        is_new = supply_V != self._latest_V
        if is_new and isfinite(self._latest_V):
            self._digit_V = min(self._digit_V, abs(supply_V - self._latest_V))
        self._latest_V = supply_V
        if self.begins(now_s):
            self._daq.clear()
            self._supply.clear()
        supply_late = [was_V - supply_V for was_V in self._daq.take(now_s, daq_V)]
        daq_late = [daq_V - was_V for was_V in self._supply.take(now_s, supply_V)]
        both = supply_late, daq_late
        if is_new:
            late_V = max(abs(each[0] - each[-_BEHIND]) for each in both)  # by a reading
        else:  # a meter shows what it held
            late_V = max(max(each[:-1]) - min(each[:-1]) for each in both)
        for means in self.means:
            means.take(now_s, [current_A, supply_V], supply_late + daq_late, late_V, is_new)
        if not isfinite(self._digit_V):
            return nan, nan

        def of(means: Means) -> tuple[float, float, float, float]:
            above_V, vague_V = means.among()
            return means.now[0], above_V, vague_V + 0.5 * self._digit_V, share * means.now[1]

        return self.worst(now_s, of)
