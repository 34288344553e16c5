"""Errors that a user can mend, and what of foreign text is shown to one."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable

#: Kinds of characters that are not shown as they come: what commands a terminal, is half a character, or ends a line.
_UNSHOWN = frozenset(("Cc", "Cs", "Zl", "Zp"))
#: Names that a sentence lists, and characters of each: what somebody reads.
MOST_NAMED, LONGEST_NAMED = 20, 80
#: Characters of all that is said of one error: some pages of a terminal, as of a parameter file with nothing right.
LONGEST_MESSAGE = 20_000


class UserError(Exception):
    """Its message is the whole story, in sentences: which parameter, file or instrument, and what would be right.

    Commands print it and end with code 1; a traceback would only hide it.  Files and instruments that others made have
    their words in it: so it is printable, and no longer than somebody reads.
    """

    def __str__(self) -> str:
        return brief(printable(super().__str__()), LONGEST_MESSAGE)


def without_ros(error: ModuleNotFoundError) -> UserError:
    """What to say where a package of ROS 2 is not there."""
    return UserError(
        f"needs ROS 2, and Python finds no '{error.name}': source a ROS 2 installation, or "
        "pip install 'sma_actuator[ros]'"
    )


def printable(text: str) -> str:
    """The text, where what commands a terminal stands as Python writes it; its lines stay."""
    if text.isprintable():
        return text
    return "".join(
        c.encode("unicode_escape").decode() if unicodedata.category(c) in _UNSHOWN and c != "\n" else c for c in text
    )


def one_line(text: str) -> str:
    """The same in one line: a name may stand in several, as in the cell of a sheet."""
    return text if text.isprintable() else printable(" ".join(text.splitlines()).replace("\t", " "))


def brief(text: str, longest: int = LONGEST_NAMED) -> str:
    """The text, or its beginning and how long it is."""
    return text if len(text) <= longest else f"{text[: longest - 20]}… ({len(text)} characters)"


def named(names: Iterable[str]) -> str:
    """The names in a sentence, as many as somebody reads."""
    every = [brief(name) for name in names]
    more = f" and {len(every) - MOST_NAMED} more" if len(every) > MOST_NAMED else ""
    return ", ".join(every[:MOST_NAMED]) + more
