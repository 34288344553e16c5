"""Tables of a calibration for kernels: what a step looks up lies in one row of numbers, and takes one call."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

from .jit import Floats, floats, jit


def row_of(*tables: tuple[Sequence[float], Sequence[float]]) -> Floats:
    """Tables, each of ascending places and the values there, one after the other: of each where it begins and how many
    places it has, then of each the places and the values."""
    numbers: list[float] = []
    first = 2 * len(tables)
    for places, _ in tables:
        numbers += first, len(places)
        first += 2 * len(places)
    for places, values in tables:
        numbers += *places, *values
    row = floats(len(numbers))
    row[:] = numbers
    return row


@jit
def places_below(row: Floats, table: int, at: float) -> int:
    """How many places of the table of that number are not beyond this one."""
    first, below, beyond = int(row[2 * table]), 0, int(row[2 * table + 1])
    while below < beyond:
        middle = (below + beyond) // 2
        if at < row[first + middle]:
            beyond = middle
        else:
            below = middle + 1
    return below


@jit
def looked_up(row: Floats, table: int, at: float) -> float:
    """What the table of that number says of a place, to the same digit as
    :func:`~sma_actuator.base.calibration.interpolated`: straight between its places, the last value beyond them."""
    if at != at:
        return nan
    first, count = int(row[2 * table]), int(row[2 * table + 1])
    values, right = first + count, places_below(row, table, at)
    if right == 0 or right == count:
        return row[values + max(right - 1, 0)]
    slope = (row[values + right] - row[values + right - 1]) / (row[first + right] - row[first + right - 1])
    return slope * (at - row[first + right - 1]) + row[values + right - 1]


@jit
def values_of(row: Floats, table: int) -> tuple[int, int]:
    """Where the values of the table of that number begin, and how many they are."""
    return int(row[2 * table]) + int(row[2 * table + 1]), int(row[2 * table + 1])
