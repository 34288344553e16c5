"""Whether the ends of a wire in training stand: how far they have moved, and how far they have yet to go.

What is measured of a wire whose ends still move is of a wire that is no more; so it is trained until they do not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

#: Share of the full stroke that an end may have left to go: what a model is wanted to be off by at most where positions
#: are held.
ENOUGH = 0.002
#: Training dies away as exp(-N/tau): tau from what is over at once to what no one waits for.  A measured wire's is 25.
QUICKEST, SLOWEST, TAUS = 2.0, 200.0, 150
FEWEST = 10  #: cycles to judge by: three unknowns, and a scatter that is known from the rest of them


@dataclass(frozen=True, slots=True)
class Left:
    """How far an end has yet to go [m], extension positive, and the standard deviation of that."""

    mean_m: float
    within_m: float

    @property
    def most_m(self) -> float:
        """The largest that it may well be, either way."""
        return abs(self.mean_m) + 2.0 * self.within_m


def left_to_go(ends_m: Sequence[float]) -> Left:
    """Where an end goes with many more cycles, by where it was after each of these: the mean over all time constants,
    each by how well it fits.

    The scatter from cycle to cycle, the sensor's noise in it, says how sure that is; so a noisy bench trains longer.
    """
    ends, n = np.asarray(ends_m, float), len(ends_m)
    if n < FEWEST:
        return Left(math.nan, math.nan)
    decay = np.exp(-np.arange(n) / np.geomspace(QUICKEST, SLOWEST, TAUS)[:, None])
    shape, moved = decay - decay.mean(axis=1, keepdims=True), ends - ends.mean()
    size = shape @ moved / np.sum(shape**2, axis=1)
    square = np.sum((moved - size[:, None] * shape) ** 2, axis=1)
    square = np.maximum(square, np.finfo(float).tiny)  # a coarse sensor shows an end that stands as one number
    left, within = -size * decay[:, -1], decay[:, -1] * np.sqrt(square / (n - 3) / np.sum(shape**2, axis=1))
    weight = (square.min() / square) ** (0.5 * (n - 3))
    weight /= weight.sum()
    mean = float(weight @ left)
    return Left(mean, math.sqrt(float(weight @ (within**2 + (left - mean) ** 2))))


@dataclass(slots=True)
class Ends:
    """Where a wire of this stroke ended, cycle by cycle [m]."""

    full_stroke_m: float
    hot_m: list[float] = field(default_factory=list)
    cold_m: list[float] = field(default_factory=list)

    def stand(self, hot_m: float, cold_m: float) -> bool:
        """With one more cycle: whether both have so little to go that it does not matter."""
        self.hot_m.append(hot_m)
        self.cold_m.append(cold_m)
        return self.furthest_m <= ENOUGH * self.full_stroke_m

    @property
    def furthest_m(self) -> float:
        """The most that either end may well have to go; NaN where there were too few cycles to say."""
        return float(np.max([left_to_go(ends_m).most_m for ends_m in (self.hot_m, self.cold_m)]))

    @property
    def words(self) -> str:
        """What to say of the wire."""
        cycles = len(self.hot_m)
        if math.isnan(self.furthest_m):
            return f"training: {cycles} cycles are too few to say whether the ends of the wire stand"
        moved = [
            f"the {name} end moved {abs(ends_m[-1] - ends_m[0]) / self.full_stroke_m:.1%}"
            for name, ends_m in (("hot", self.hot_m), ("cold", self.cold_m))
        ]
        seen = f"training: in {cycles} cycles {' and '.join(moved)} of the full stroke"
        left = self.furthest_m / self.full_stroke_m
        if left <= ENOUGH:
            return f"{seen}; they stand, with at most {left:.2%} left"
        return (
            f"{seen}; they do not stand, up to {left:.1%} is left: what is measured now is of a wire that still "
            "changes (more cycles: --training-cycles)"
        )
