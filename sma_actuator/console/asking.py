"""Questions to a person at a terminal or at the other end of a pipe, or to a file that has the answers.

A question stands on lines of its own: whoever shows progress is paused while it waits.
"""

from __future__ import annotations

import contextlib
import io
import os
import select
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from sma_actuator.base.errors import UserError
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.yaml_text import read_yaml

_LOOK_s = 0.25  #: how often what is shown meanwhile is looked at again
_SAY_s = 5.0  #: how often it is said where nothing can be written over
_LONGEST_ANSWER = 10_000


@dataclass(frozen=True, slots=True)
class Shown:
    """What is shown while a question waits."""

    text: str
    state: str = ""  #: a change of it is worth a line of its own


def read_answers(path: Path | None) -> dict[str, Any]:
    """Answers by the names of their questions, from a YAML file.  Raises ConfigError."""
    if path is None:
        return {}
    answers = read_yaml(path, "a file of answers")
    if not isinstance(answers, Mapping):
        raise ConfigError(f"{path}: holds no answers; lines of 'question: answer' are wanted")
    return dict(answers)


@contextlib.contextmanager
def paused(bar: Progress) -> Iterator[None]:
    """No progress bar meanwhile."""
    running = bar.live.is_started
    bar.stop()
    try:
        yield
    finally:
        if running:
            bar.start()


class Asking:
    """Asks, and waits for a line."""

    def __init__(
        self,
        console: Console,
        answers: Mapping[str, Any],
        pause: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
    ):
        """``answers``: by the name of the question; a list has one for each time that it is asked."""
        self._console, self._pause = console, pause
        self._answers = {name: list(a) if isinstance(a, list) else a for name, a in answers.items()}
        self._read = b""

    def answered(self, name: str) -> bool:
        """Whether a file has the answer."""
        answer = self._answers.get(name)
        return answer is not None and answer != []

    def say(self, sentence: str) -> None:
        """A sentence between two questions."""
        with self._pause():
            self._console.print(sentence)

    def ask(
        self, name: str, question: str, meanwhile: Callable[[], Shown] | None = None, may_be_empty: bool = False
    ) -> str:
        """The answer, without blanks around it; ``meanwhile``: looked at and shown until it comes.

        Where nobody can answer it is empty if it ``may_be_empty``; else raises UserError.
        """
        with self._pause():
            self._console.print(f"► {question}", style="bold yellow")
            if self.answered(name):
                answer = self._answers[name]
                text = str(answer.pop(0) if isinstance(answer, list) else answer).strip()
                self._console.print(f"  {text} (given)")
                return text
            line = self._line(meanwhile)
            if line is None and not may_be_empty:
                raise UserError(
                    f"'{name}' was asked, and standard input is closed, so nobody can answer; run it in a terminal, or "
                    f"give the answers in a file (--answers FILE with a line '{name}: …')"
                )
            if line is None:
                self._console.print("  nobody can answer: as Enter")
            return line or ""

    def _line(self, meanwhile: Callable[[], Shown] | None) -> str | None:
        """The next line of standard input; None at its end."""
        try:
            handle = sys.stdin.fileno()
        except (AttributeError, ValueError, io.UnsupportedOperation):
            return None
        showing = _Showing(self._console)
        ended = False
        while b"\n" not in self._read and not ended:
            if meanwhile is not None:
                showing.show(meanwhile())
            if not select.select([handle], [], [], _LOOK_s if meanwhile is not None else None)[0]:
                continue
            try:
                more = os.read(handle, 4096)
            except OSError:
                more = b""
            self._read += more
            ended = not more or len(self._read) > _LONGEST_ANSWER
        showing.end()
        if ended and not self._read:
            return None
        line, _, self._read = self._read.partition(b"\n")
        return line.decode(errors="replace").strip()


class _Showing:
    """One line that changes, or lines from time to time where nothing can be written over."""

    def __init__(self, console: Console):
        self._console = console
        self._state: str | None = None
        self._said_s = -_SAY_s
        self._over = console.is_terminal and not console.is_dumb_terminal

    def show(self, shown: Shown) -> None:
        """Say it, if it is new."""
        if self._over:
            self._console.file.write(f"\r\x1b[2K  {shown.text}")
            self._console.file.flush()
        elif shown.state != self._state or time.monotonic() > self._said_s + _SAY_s:
            self._console.print(f"  {shown.text}")
            self._said_s = time.monotonic()
        self._state = shown.state

    def end(self) -> None:
        """Go on below it."""
        if self._over and self._state is not None:
            self._console.file.write("\n")
            self._console.file.flush()
