"""Straight lines through calibration points (thesis, appendices A and B)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import ConfigError


@dataclass(frozen=True, slots=True)
class Line:
    """y = slope·x + offset, with what is left over."""

    slope: float
    offset: float
    correlation: float
    residuals: tuple[float, ...]  #: y − fit at every point, in the unit of y


def fit_line(x, y, what: str) -> Line:
    """Least squares through points (n,), n ≥ 3.  Raises ConfigError where they lie on one spot."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    if len(x) < 3 or not np.ptp(x) > 0.0 or not np.ptp(y) > 0.0:
        raise ConfigError(
            f"{what}: the channel does not move with the {len(x)} points; three different ones are needed (is the "
            "sensor connected?)"
        )
    slope, offset = np.polyfit(x, y, 1)
    correlation = np.corrcoef(x, y)[0, 1]
    if abs(correlation) < 0.99:
        raise ConfigError(
            f"{what}: correlation {correlation:.4f} is no straight line; is the sensor at that channel, and within its "
            "range at all points? Check the points and repeat"
        )
    return Line(float(slope), float(offset), float(correlation), tuple(float(r) for r in y - (slope * x + offset)))
