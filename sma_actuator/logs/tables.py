"""A table of numbers, as its file has it."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sma_actuator.base.errors import named, one_line

#: What was asked of the actuator or happened to it before its row, in words; text, where all others are numbers.
EVENT_COLUMN = "event"
PART = ".part"  #: what the name of a log ends with while it is still being written
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Table:
    """Columns by name, arrays of shape (n,), float64, as they stand in the file."""

    columns: Mapping[str, np.ndarray]
    source: str
    units: Mapping[str, str] = field(default_factory=dict)  #: where the file says them apart from the names
    texts: Mapping[int, str] = field(default_factory=dict)  #: row → text of the column ``event``
    notes: tuple[str, ...] = ()  #: what was left out or converted
    first_line: int = 2  #: of the file, where the numbers begin
    left_out: Mapping[str, str] = field(
        default_factory=dict
    )  #: columns of text, with one of them, or "" of what was not read
    moments: Mapping[str, datetime.datetime] = field(default_factory=dict)  #: of columns of dates, where they are zero

    def __post_init__(self) -> None:
        # Names and words of others: none of them commands the terminal on which they are shown.
        self._set("columns", {one_line(name): column for name, column in self.columns.items()})
        self._set("units", {one_line(name): one_line(unit) for name, unit in self.units.items()})
        self._set("moments", {one_line(name): first for name, first in self.moments.items()})
        self._set("texts", {row: one_line(text) for row, text in self.texts.items()})
        self._set("notes", tuple(map(one_line, self.notes)))
        self._set("left_out", {one_line(name): one_line(text) for name, text in self.left_out.items()})

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)


def holds_text(left_out: Mapping[str, str]) -> str:
    """What to say of columns that were wanted as numbers: each by its name, and such as what."""
    shown = {name: f" such as '{text.strip()[:40]}'" if text else "" for name, text in left_out.items()}
    return named(f"'{name}' holds text{such}" for name, such in shown.items())
