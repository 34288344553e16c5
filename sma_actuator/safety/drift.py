"""Two measurements of one current: what they differ by at a current is noted when it first flows, and must stay.

The supply holds a current, the DAQ measures it over the sense resistor.  Both have errors of scale and zero, which
stand still; what changes between them is a drift.  So a difference is held against the one that was noted, over a
second that averages the noise, and over all the lags that the DAQ may have behind the supply, so that motion is none.
"""

from __future__ import annotations

import bisect
from collections import deque
from dataclasses import dataclass, field
from math import inf, nan

WINDOW_s = 1.0  #: over which both are averaged
LAG_s = 0.2  #: that the DAQ may be behind the supply, and so much later than usual may a reading come
_BEHIND = 3  #: readings that it may be behind where that takes longer, this one counted
FLOOR_A = 1e-3  #: the step of the coarsest supplies that may be driven
SCALE = 0.015  #: what the scales of both may differ by, beside a drift
STANDS_A = 0.25 * FLOOR_A  #: by how much a current that stands differs in the DAQ's eyes
_STEADY = 3  #: readings that show it
_ROUNDING_s = 1e-6
WIDER = 1.1  #: a current that is so much beyond those that were noted is noted as well


@dataclass(slots=True)
class CurrentsApart:
    """How far the DAQ's current has come from the supply's since both were first seen."""

    _samples: deque[tuple[float, float, float, float]] = field(default_factory=deque)  #: time, DAQ's, supply's from, to
    _daq_A: float = 0.0  #: the sum of the DAQ's
    _from_A: float = 0.0
    _to_A: float = 0.0
    _means_s: deque[float] = field(default_factory=deque)  #: time of each mean of the supply's from and to
    _means_from_A: deque[float] = field(default_factory=deque)
    _means_to_A: deque[float] = field(default_factory=deque)
    _since_s: float = inf
    _usual_s: float = WINDOW_s  #: between the last two readings
    #: Current, by how much the DAQ's was above it, and how exactly that is known, by current.
    _noted: list[tuple[float, float, float]] = field(default_factory=list)

    def pause(self) -> None:
        """Nothing can be compared now; what was noted stays."""
        if self._samples:
            for each in (self._samples, self._means_s, self._means_from_A, self._means_to_A):
                each.clear()
            self._daq_A = self._from_A = self._to_A = 0.0

    def forget(self) -> None:
        """Begin anew."""
        self.pause()
        self._noted.clear()

    def step(self, now_s: float, daq_A: float, from_A: float, to_A: float, share: float) -> tuple[float, float]:
        """What the DAQ's current has changed by against the supply's, which lies from ``from_A`` to ``to_A``, and what
        it may [A].

        NaN until that is known.  ``share`` of the current may be a drift.
        """
        self._take(now_s, daq_A, from_A, to_A)
        seen = self._means_now() if now_s - self._since_s >= WINDOW_s + LAG_s else self._steady(now_s)
        if seen is None:
            return nan, nan
        supply_A, above_A, vague_A = seen
        drift_A = share * supply_A + FLOOR_A
        change_A, known_A = self._change(supply_A, above_A)
        allowed_A = known_A + drift_A + vague_A
        if vague_A <= drift_A and not abs(change_A) > allowed_A:
            self._note(supply_A, above_A, vague_A, change_A, known_A)
        return change_A, allowed_A

    def _means_now(self) -> tuple[float, float, float]:
        """The supply's current, by how much the DAQ's is above it, and how exactly that is known."""
        low_A, high_A = min(self._means_from_A), max(self._means_to_A)
        supply_A = 0.5 * (low_A + high_A)
        return supply_A, self._daq_A / len(self._samples) - supply_A, 0.5 * (high_A - low_A)

    def _steady(self, now_s: float) -> tuple[float, float, float] | None:
        """The same of the current that is the first to flow, once the DAQ shows that it stands: it may flow for a
        moment only."""
        latest = [sample[1] for sample in self._samples][-_STEADY:]
        low_A, high_A = min(sample[2] for sample in self._samples), max(sample[3] for sample in self._samples)
        stands = max(latest) - min(latest) <= STANDS_A and high_A - low_A <= STANDS_A
        if not (stands and len(latest) == _STEADY and now_s - self._since_s >= LAG_s - _ROUNDING_s):
            return None
        supply_A = 0.5 * (low_A + high_A)
        return supply_A, sum(latest) / _STEADY - supply_A, STANDS_A

    def _change(self, supply_A: float, above_A: float) -> tuple[float, float]:
        """What the difference has changed by, and how exactly that is known: between currents that were noted on a
        straight line, beyond them the change that is worst."""
        noted = self._noted
        after = bisect.bisect(noted, (supply_A,))
        if 0 < after < len(noted):
            (low_A, low, low_vague), (high_A, high, high_vague) = noted[after - 1], noted[after]
            way = (supply_A - low_A) / (high_A - low_A)
            return above_A - (low + way * (high - low)), low_vague + way * (high_vague - low_vague)
        found = [(above_A - noted_A, vague_A + SCALE * abs(supply_A - at_A)) for at_A, noted_A, vague_A in noted]
        return max(found, key=lambda each: abs(each[0]) - each[1], default=(nan, nan))

    def _note(self, supply_A: float, above_A: float, vague_A: float, change_A: float, known_A: float) -> None:
        """Note a current that is new, or a difference that is known more exactly than from those that were noted."""
        noted = self._noted
        near = [each for each in noted if each[0] / WIDER <= supply_A <= each[0] * WIDER]
        is_new = not near and not (noted and noted[0][0] < supply_A < noted[-1][0])
        exact = vague_A < 0.5 * min((known_A, *(each[2] for each in near))) and abs(change_A) <= vague_A + known_A
        if is_new or exact:
            self._noted = sorted([*(each for each in noted if each not in near), (supply_A, above_A, vague_A)])

    def _take(self, now_s: float, daq_A: float, from_A: float, to_A: float) -> None:
        samples, means_s = self._samples, self._means_s
        apart_s = now_s - samples[-1][0] if samples else 0.0
        if not 0.0 <= apart_s <= min(self._usual_s + LAG_s, WINDOW_s):  # who stood still meanwhile is not known
            self.pause()
        elif samples:
            self._usual_s = apart_s
        if not samples:
            self._since_s = now_s
        samples.append((now_s, daq_A, from_A, to_A))
        self._daq_A += daq_A
        self._from_A += from_A
        self._to_A += to_A
        while now_s - samples[0][0] >= WINDOW_s:
            _, gone_A, gone_from_A, gone_to_A = samples.popleft()
            self._daq_A -= gone_A
            self._from_A -= gone_from_A
            self._to_A -= gone_to_A
        means_s.append(now_s)
        self._means_from_A.append(self._from_A / len(samples))
        self._means_to_A.append(self._to_A / len(samples))
        while now_s - means_s[0] > LAG_s + _ROUNDING_s and len(means_s) > _BEHIND:
            for each in (means_s, self._means_from_A, self._means_to_A):
                each.popleft()
