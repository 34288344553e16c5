"""How much less is lost on units (cycles, runs) that no fit has seen: in the mean, and on the next one."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from scipy.special import stdtr, stdtrit


def paired(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Mean fall from ``before`` to ``after``, unit by unit, shape (units,), and its standard error."""
    fall = before - after
    return float(fall.mean()), float(fall.std(ddof=1) / np.sqrt(len(fall))) if len(fall) > 1 else inf


@dataclass(frozen=True, slots=True)
class NextFall:
    """What a unit that nobody has seen will lose less, by Student's predictive distribution of the units seen."""

    chance: float  #: that it loses less at all
    low: float  #: with a probability of INSIDE it loses less by between this …
    high: float  #: … and this


INSIDE = 0.8  #: probability with which what is said of a new unit holds


def next_fall(before: np.ndarray, after: np.ndarray) -> NextFall:
    """The fall of a new unit's loss; each of the units seen, shape (units,), was judged by a fit that had not seen
    it."""
    fall, n = before - after, len(before)
    if n < 2:
        return NextFall(0.0, -inf, inf)
    mean, spread_ = float(fall.mean()), float(fall.std(ddof=1) * np.sqrt(1.0 + 1.0 / n))
    reach = float(stdtrit(n - 1, 0.5 + 0.5 * INSIDE)) * spread_
    chance = float(stdtr(n - 1, mean / spread_)) if spread_ > 0.0 else float(mean > 0.0)
    return NextFall(chance, mean - reach, mean + reach)
