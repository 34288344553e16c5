"""The cycles of a log and which of them are full: one judgement, for ``identify`` as for ``check-log``.

A cycle begins when the current is switched on, which is when it leaves the low end of its range and then passes the
middle.  It is full where the wire rests at both ends of it and no cycle of that load goes further.  How far it goes is
what the wire goes both there and back: where it begins as long as a heavier load has left it, it does not come back to,
and where it is switched off for a moment it has hardly set out.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_LOW_END = 0.05  #: share of the current's range in which it is at the low end of it
SAME_LOAD = 0.05  #: relative difference below which two loads count as one
_AT_REST = 0.08  #: share of a cycle's stroke within which of an end it is at rest there
HOT_PART, _COLD_PART = 0.25, 0.15  #: shares of the time driven and not, in which it rests at the hot and the cold end
#: Share of the widest stroke of a load that a full cycle has at least: the first one begins at a rest of any length,
#: the others at what a pause between pulses leaves of the long tail that the cooling of a real wire ends with.
_WIDEST = 0.88
IN_MOTION = 5  #: samples in mid-stroke that the heating of some full cycles in a row has at least


@dataclass(frozen=True, slots=True)
class Cycle:
    """From one switching-on of the current to the next: samples ``start`` … ``stop`` − 1."""

    start: int
    stop: int
    stroke: float
    rests_hot: bool
    rests_cold: bool
    heated: int  #: samples in mid-stroke on the way there

    @property
    def rests(self) -> bool:
        """At both ends."""
        return self.rests_hot and self.rests_cold


def is_driven(current: np.ndarray) -> np.ndarray:
    """Bool, shape (n,): the current is above the middle of its range, or on its way there from the low end.

    A wire that transforms in the lower half of a ramp was heated by that ramp.
    """
    if not np.isfinite(current).any():
        return np.zeros(len(current), dtype=bool)
    least, most = np.nanmin(current), np.nanmax(current)
    driven = current > 0.5 * (least + most)
    low = current <= least + _LOW_END * (most - least)
    samples = np.arange(len(current))
    last_low, last_driven = (np.maximum.accumulate(np.where(one, samples, -1)) for one in (low, driven))
    before = np.flatnonzero(driven[1:] & ~driven[:-1])
    for last in before[last_low[before] > last_driven[before]]:
        driven[last_low[last] + 1 : last + 1] = True
    return driven


def cycle_numbers(driven: np.ndarray) -> np.ndarray:
    """Number of the cycle of every sample; one begins when the current is switched on."""
    return np.concatenate(([0], np.cumsum(driven[1:] & ~driven[:-1])))


def cycles_of(displacement: np.ndarray, driven: np.ndarray, number: np.ndarray) -> list[Cycle]:
    """The cycles 1 … n of arrays of shape (n,), extension positive, in any unit."""
    bounds = np.searchsorted(number, np.arange(1, number[-1] + 2))
    return [_cycle(displacement, driven, int(a), int(b)) for a, b in itertools.pairwise(bounds)]


def _cycle(displacement: np.ndarray, driven: np.ndarray, start: int, stop: int) -> Cycle:
    moved, on = displacement[start:stop], driven[start:stop]
    off = int(np.argmin(on)) or len(on)  # a cycle begins driven
    hot, cold = moved[:off], moved[off:]
    if len(cold) == 0:
        return Cycle(start, stop, float(np.ptp(moved)), rests_hot=False, rests_cold=False, heated=0)
    stroke = float(min(hot.max(), cold.max()) - moved.min())
    near = _AT_REST * stroke
    return Cycle(
        start,
        stop,
        stroke,
        rests_hot=bool(np.percentile(hot, 100.0 * HOT_PART) - hot.min() <= near),
        rests_cold=bool(cold.max() - np.percentile(cold, 100.0 * (1.0 - _COLD_PART)) <= near),
        heated=int(np.count_nonzero(np.abs(hot - moved.min() - 0.5 * stroke) < 0.25 * stroke)),
    )


def which_are_full(cycles: Sequence[Sequence[Cycle]], loads: Sequence[float]) -> list[np.ndarray]:
    """Of every stretch of a log, at one load each, which of its cycles are full: bool, of the shape of its cycles."""
    out = []
    for own, load in zip(cycles, loads, strict=True):
        widest = max(
            (c.stroke for other, at in zip(cycles, loads, strict=True) if _alike(at, load) for c in other if c.rests),
            default=np.inf,
        )
        full = np.array([c.rests and c.stroke >= _WIDEST * widest for c in own], dtype=bool)
        for run in np.split(np.arange(len(full)), np.flatnonzero(full[1:] != full[:-1]) + 1):
            full[run] &= sum(own[i].heated for i in run) >= IN_MOTION
        out.append(full)
    return out


def _alike(a: float, b: float) -> bool:
    return abs(a - b) <= SAME_LOAD * abs(b)
