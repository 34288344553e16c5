"""Which stresses of a calibration are one, and how many digits of a number are kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

#: Two stresses are one that differ by less than this share of the larger, or of the largest of all: the cold end bends
#: most where the load is light.
SAME_STRESS, SAME_SHARE_OF_ALL = 0.06, 0.01


def clusters(values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Stresses that are not one, those that are averaged; ascending."""
    ordered = np.sort(np.asarray(values, dtype=float))
    larger = np.maximum(np.abs(ordered[1:]), np.abs(ordered[:-1]))
    apart = np.maximum(SAME_STRESS * larger, SAME_SHARE_OF_ALL * np.max(np.abs(ordered)))
    groups = np.split(ordered, np.flatnonzero(np.diff(ordered) > apart) + 1)
    return np.array([g.mean() for g in groups])


def nearest(values: np.ndarray, stresses: np.ndarray) -> np.ndarray:
    """Which of some stresses each value is nearest to, shape (n,)."""
    return np.argmin(np.abs(values[:, None] - stresses), axis=1)


def rounded(values: np.ndarray, digits: int) -> tuple[float, ...]:
    """Values with so many digits after the point, as they stand in a file."""
    return tuple(round(float(v), digits) for v in values)
