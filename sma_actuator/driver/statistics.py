"""The loop's deadlines, and how well it keeps them."""

from __future__ import annotations

import collections
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_WINDOW = 2048
_MINUTE_s = 60


@dataclass(frozen=True, slots=True)
class LoopStatistics:
    """How well the loop keeps its period; means and percentiles over the last 2048 steps."""

    steps: int
    overruns: int  #: deadlines that passed while a step was still busy
    late_answers: int  #: of the instruments, that came after their time-out or not at all
    slowest_answer_s: float  #: of the last minute, whatever was asked for
    period_mean_s: float = math.nan
    period_p99_s: float = math.nan
    period_max_s: float = math.nan
    busy_mean_s: float = math.nan  #: time from a step's deadline to the command being with the supply
    busy_max_s: float = math.nan


class Slowest:
    """The longest of what took how long in the last minute."""

    def __init__(self) -> None:
        self._by_second: collections.deque[tuple[int, float]] = collections.deque()

    def note(self, now_s: float, took_s: float) -> None:
        """Something took ``took_s``."""
        second, longest = int(now_s), self._by_second
        if longest and longest[-1][0] == second:
            if took_s > longest[-1][1]:
                longest[-1] = second, took_s
            return
        longest.append((second, took_s))
        while longest[0][0] <= second - _MINUTE_s:
            longest.popleft()

    def longest_s(self, now_s: float) -> float:
        """0 where nothing was noted."""
        return max((took_s for second, took_s in tuple(self._by_second) if second > now_s - _MINUTE_s), default=0.0)


#: Share of a period for which a current that was told late stands before it is measured.  A DAQ that takes one channel
#: at a time and begins at once has them on both sides of the current's step: a sound wire has 19 Ω, and is off.  At
#: 3.4 Hz this is 0.15 s; the current of a quick supply (15 ms a word) stood after 0.1 s.
STANDS = 0.5


class Deadlines:
    """The first is now, the others at whole periods of the clock; those that pass while a step is busy are skipped, not
    caught up with: old readings help nobody.

    So the loops of a process that have one rate step together: what one of them has had the processor load, the next
    finds at hand.
    """

    def __init__(self, period_s: float):
        self.period_s = period_s
        self.last_step_s = math.nan  #: when the last step began
        self.steps = 0
        self.overruns = 0
        self._first_s = math.nan  #: time of deadline 0
        self._start_s = math.nan  #: the whole period next to it, from which the others are counted
        self._number = 0  #: of the next deadline
        self._periods_s = np.full(_WINDOW, np.nan)  #: before the steps of the last window, the first of all NaN
        self._busy_s = np.full(_WINDOW, np.nan)

    def next_s(self, now_s: Callable[[], float]) -> float:
        """The next; the first one is now, since nothing can be enabled before a reading."""
        if math.isnan(self._first_s):
            self._first_s = now_s()
            self._start_s = round(self._first_s / self.period_s) * self.period_s
        return self._start_s + self._number * self.period_s if self._number else self._first_s

    def begun(self, now_s: float) -> None:
        """A step begins."""
        self._periods_s[self.steps % _WINDOW] = now_s - self.last_step_s
        self.last_step_s = now_s

    def done(self, deadline_s: float, now_s: float) -> None:
        """That of this deadline has ended."""
        self._busy_s[self.steps % _WINDOW] = now_s - deadline_s
        self.steps += 1
        missed = max(0, math.floor((now_s - self._start_s) / self.period_s + 1e-9) - self._number)
        self._number += 1 + missed
        left_s = self._start_s + self._number * self.period_s - now_s
        self._number += missed > 0 and left_s < STANDS * self.period_s
        self.overruns += missed

    def statistics(self, late_answers: int, slowest_answer_s: float) -> LoopStatistics:
        """Period and overruns, with what the instruments add."""
        count = min(self.steps, _WINDOW)
        # Before the first step there was none.
        periods_s, busy_s = self._periods_s[int(self.steps <= _WINDOW) : count], self._busy_s[:count]
        if not len(periods_s):
            return LoopStatistics(self.steps, self.overruns, late_answers, slowest_answer_s)
        return LoopStatistics(
            self.steps,
            self.overruns,
            late_answers,
            slowest_answer_s,
            float(periods_s.mean()),
            _p99(periods_s),
            float(periods_s.max()),
            float(busy_s.mean()),
            float(busy_s.max()),
        )


def _p99(values: np.ndarray) -> float:
    """Their 99th percentile, on a straight line between its neighbours: that of ``np.quantile``, which takes ten times
    as long."""
    place = 0.99 * (len(values) - 1)
    below, above = math.floor(place), math.ceil(place)
    in_order = np.partition(values, (below, above))
    low, high = float(in_order[below]), float(in_order[above])
    return low + (place - below) * (high - low)
