"""What one part of the self-test found, and how bad it is."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Level(enum.IntEnum):
    """How bad it is."""

    OK = 0
    WARNING = 1  #: could not be told, or should be looked at
    WRONG = 2


@dataclass(frozen=True, slots=True)
class Found:
    """What one part found."""

    part: str
    level: Level
    sentence: str


def passed(found: list[Found]) -> bool:
    """Whether nothing was wrong."""
    return all(each.level is not Level.WRONG for each in found)
