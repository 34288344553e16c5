"""Instruments at the other end of a serial line: a pseudo-terminal, and a thread that answers lines."""

import contextlib
import os
import select
import termios
import threading
import time
import tty
from collections.abc import Callable


class SerialInstrument:
    """Answers every line by ``answer(line)``: a text, or None for nothing.

    ``hears`` nothing: a line ends where nothing more comes.
    ``pause_s``: a line that begins sooner after the last one is lost, as with instruments that are busy then.
    ``baud_rate``: at any other it hears and says rubbish.
    """

    def __init__(
        self,
        answer: Callable[[str], str | None],
        hears: str = "\n",
        says: str = "\n",
        pause_s: float = 0.0,
        baud_rate: int = 9600,
    ):
        self.lines: list[str] = []
        self._answer, self._hears, self._says, self._pause_s = answer, hears.encode(), says.encode(), pause_s
        self._speed = getattr(termios, f"B{baud_rate}")
        self._ours, self._theirs = os.openpty()
        for end in (self._ours, self._theirs):
            tty.setraw(end)
        self.path = os.ttyname(self._theirs)
        self.resource = f"ASRL{self.path}::INSTR"
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def settings(self) -> list:
        """The line's, as termios has them."""
        return termios.tcgetattr(self._theirs)

    def say(self, text: str) -> None:
        """Unasked."""
        os.write(self._ours, text.encode() + self._says)

    def _serve(self) -> None:
        got, last_s = b"", -1.0
        with contextlib.suppress(OSError):
            while not self._ended.is_set():
                if select.select([self._ours], [], [], 0.05 if self._hears else 0.01)[0]:
                    got += os.read(self._ours, 4096)
                    if not self._hears:
                        continue
                at_speed = self.settings()[4] == self._speed
                while self._hears in got if self._hears else got:
                    line, _, got = got.partition(self._hears) if self._hears else (got, b"", b"")
                    early = time.monotonic() - last_s < self._pause_s
                    last_s = time.monotonic()
                    if early:
                        continue
                    self.lines.append(line.decode())
                    reply = self._answer(line.decode())
                    if reply is not None:
                        os.write(self._ours, reply.encode("latin-1") + self._says if at_speed else b"\xf8\x80\xff")
                        last_s = time.monotonic()

    def close(self) -> None:
        self._ended.set()
        self._thread.join(10.0)
        os.close(self._ours)
        os.close(self._theirs)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
