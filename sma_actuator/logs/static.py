"""Tables of steady points, one a row and without times, made logs: gone through slowly, and between two points straight.

Nothing is known between the points, and what a model says there is its own.  A table of one loop holds one cycle; it is gone
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
            f"{table.source}: {np.count_nonzero(told)} points with a resistance are no loop; at least {_FEWEST} are wanted, up and "
            "down in current, one a row in the order in which they were measured"
        )
    at_s = np.arange(ROUNDS * count) * seconds
    time_s = np.arange(0.0, at_s[-1] + 0.5 * PERIOD_s, PERIOD_s)
    again = np.tile(told, ROUNDS)
    columns = {
        "time_s": time_s,
        "resistance_Ohm": np.interp(time_s, at_s[again], np.tile(resistance_Ohm, ROUNDS)[again]),
        "current_A": np.interp(time_s, at_s, np.tile(current_A, ROUNDS)),
    }
    for name in ("load_N", "displacement_m", "ambient_temperature_C"):
        if name in points:
            columns[name] = np.interp(time_s, at_s, np.tile(points[name], ROUNDS))
    say(
        f"{points.name}: {count} steady points, gone through {ROUNDS} times with {seconds:g} s from each to the next and straight "
        f"between them; below {LEAST_CURRENT:.0%} of the largest current ({count - np.count_nonzero(told)} points) the resistance "
        "is that of its neighbours"
    )
    return BenchLog(columns, {**metadata, STATIC: True}, table.source)
