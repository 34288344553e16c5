"""Tables of steady points, one a row and without times, made logs: gone through slowly, along a smooth curve.

Nothing is known between the points, but that a wire's loop has no corners where its current does not turn: a straight
line between two of them says that resistance and displacement go in proportion, which they do nowhere that one phase
follows another.  So the curve is a spline in their plane (Catmull and Rom's, with centripetal parameters, which makes
no loops: C. Yuksel and others, Computer-Aided Design 43 (2011) 747).  A table of one loop holds one cycle; it is gone
through ROUNDS times, so that it has cycles to count, and its metadata say so: no cycle of it is unseen.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .bench_log import BenchLog, log_of, uncalibrated_resistance_and_current
from .errors import BenchLogError
from .tables import Table

STATIC = "static"  #: in the metadata of such a log
ROUNDS = 4
PERIOD_s = 0.25
LEAST_CURRENT = (
    0.15  #: share of the largest, below which a voltmeter's last digit is more than a hundredth of what R moves by
)
_FEWEST = 8  #: points


def log_of_points(
    table: Table, seconds: float, metadata: dict[str, Any], say: Callable[[str], None] = lambda sentence: None
) -> BenchLog:
    """A log of a table with our columns that takes ``seconds`` from each point to the next; ``say`` is told how.

    Raises BenchLogError where it holds too few points, or none of resistance and current.
    """
    points = log_of(table, metadata)
    resistance_Ohm, current_A = uncalibrated_resistance_and_current(points)
    count = len(current_A)
    told = np.isfinite(resistance_Ohm) & (current_A >= LEAST_CURRENT * np.nanmax(current_A, initial=0.0))
    if np.count_nonzero(told) < _FEWEST:
        raise BenchLogError(
            f"{table.source}: {np.count_nonzero(told)} points with a resistance are no loop; at least {_FEWEST} are "
            "wanted, up and down in current, one a row in the order in which they were measured"
        )
    at_s = np.arange(ROUNDS * count) * seconds
    time_s = np.arange(0.0, at_s[-1] + 0.5 * PERIOD_s, PERIOD_s)
    again = np.tile(told, ROUNDS)
    at_points_Ohm = np.interp(at_s, at_s[again], np.tile(resistance_Ohm, ROUNDS)[again])
    loop = [at_points_Ohm] + ([np.tile(points["displacement_m"], ROUNDS)] if "displacement_m" in points else [])
    drawn = _along(np.column_stack(loop), time_s / seconds)
    columns = {
        "time_s": time_s,
        "current_A": np.interp(time_s, at_s, np.tile(current_A, ROUNDS)),
        **dict(zip(("resistance_Ohm", "displacement_m"), drawn.T, strict=False)),
    }
    for name in ("load_N", "ambient_temperature_C"):
        if name in points:
            columns[name] = np.interp(time_s, at_s, np.tile(points[name], ROUNDS))
    say(
        f"{points.name}: {count} steady points, gone through {ROUNDS} times with {seconds:g} s from each to the next "
        f"along a smooth curve; below {LEAST_CURRENT:.0%} of the largest current ({count - np.count_nonzero(told)} "
        "points) the resistance is that of its neighbours"
    )
    return BenchLog(columns, {**metadata, STATIC: True}, table.source)


def _along(points: np.ndarray, place: np.ndarray) -> np.ndarray:
    """A smooth curve through points (n, dimensions) at ``place`` (m,), which is k at the k-th: shape (m,
    dimensions)."""
    size = np.maximum(np.nanmax(points, axis=0) - np.nanmin(points, axis=0), 1e-300)
    # the parameter of each stretch
    apart = np.sqrt(np.linalg.norm(np.diff(points, axis=0) / size, axis=1))[:, np.newaxis]
    apart = np.maximum(apart, 1e-9)
    slope = np.diff(points, axis=0) / apart
    bent = (points[2:] - points[:-2]) / (apart[:-1] + apart[1:])
    tangent = np.concatenate((slope[:1], slope[:-1] - bent + slope[1:], slope[-1:]))
    first = np.minimum(place.astype(int), len(points) - 2)
    u = (place - first)[:, np.newaxis]
    return np.asarray(
        (1.0 + 2.0 * u) * (1.0 - u) ** 2 * points[first]
        + u**2 * (3.0 - 2.0 * u) * points[first + 1]
        + u * (1.0 - u) * apart[first] * ((1.0 - u) * tangent[first] - u * tangent[first + 1])
    )
