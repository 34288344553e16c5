"""Regular expressions of a dialect, held against what an instrument says: whatever that is, within a step of the loop.

Python's ``re`` tries, one after the other, all ways in which repetitions can share a text, and keeps every thread of
the process waiting meanwhile.  With a repetition inside another these are more than there are seconds; of ``k`` beside
each other they grow with the power ``k`` of the length, which an instrument chooses.  So both are bounded.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from re import _constants as kind  # type: ignore[attr-defined]
from re import _parser as parser  # type: ignore[attr-defined]
from typing import Any

#: Of one value, of what an instrument says of itself (72 by IEEE 488.2) or of an error (255 by SCPI-99, 21.8): no
#: longer line is like any pattern.
LONGEST_LINE = 300
#: Repetitions beside each other, of which the place where a search begins is one: the slowest takes 20 ms for so long a
#: line, with one more it would be 0.7 s.
MOST_REPETITIONS = 3
_REPEATS = (kind.MAX_REPEAT, kind.MIN_REPEAT, kind.POSSESSIVE_REPEAT)


class Pattern:
    """A regular expression for a ``whole`` line, or a part.  Raises ValueError where it is none, or not bounded."""

    def __init__(self, text: str, whole: bool = True):
        try:
            self._compiled = re.compile(text)
            repetitions = sum(_repetitions(parser.parse(text), inside=False))
        except (TypeError, re.error, OverflowError, RecursionError) as error:
            raise ValueError("it is no regular expression") from error
        most = MOST_REPETITIONS - (not whole)
        if repetitions > most:
            raise ValueError(f"it has {repetitions} repetitions (*, + …); {most} at the most are wanted")
        self.pattern, self.groups = text, self._compiled.groups

    def search(self, line: str) -> re.Match[str] | None:
        """Where it is in a line, if there."""
        return self._compiled.search(line) if len(line) <= LONGEST_LINE else None

    def fullmatch(self, line: str) -> re.Match[str] | None:
        """The line, if the whole of it is like that."""
        return self._compiled.fullmatch(line) if len(line) <= LONGEST_LINE else None


def _repetitions(items: Iterable[tuple[Any, Any]], inside: bool) -> Iterable[int]:
    """One for each repetition.  Raises ValueError where something ``inside`` one has more than one length or form."""
    for operation, argument in items:
        repeats = operation in _REPEATS
        least, most = argument[:2] if repeats else (1, 1)
        if inside and (least != most or operation is kind.BRANCH):
            raise ValueError("what is repeated in it varies itself, which takes for ever on some answers")
        if repeats and most > 1 and least != most:
            yield 1
        for part in _parts(argument):
            yield from _repetitions(part, inside or (repeats and most > 1))


def _parts(argument: Any) -> Iterable[Any]:
    """The patterns that stand in the argument of an operation."""
    if isinstance(argument, parser.SubPattern):
        yield argument
    elif isinstance(argument, tuple | list):
        for each in argument:
            yield from _parts(each)
