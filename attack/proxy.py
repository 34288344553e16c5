"""A proxy between the driver and one instrument of the bench, that spoils what passes through it.

It knows lines, not SCPI.  What it does is named by a :class:`Mischief`; the same seed spoils the same lines in the same
way.  It stands on loopback, as the bench does.
"""

from __future__ import annotations

import collections
import contextlib
import queue
import random
import re
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

TRICKLE_s = 0.1  #: between two bytes of an answer without an end
EXTRA_LINES = 25
_END = (0.0, b"")  #: after the last line
_NUMBER = re.compile(rb"[+-]?\d+\.?\d*(?:E[+-]?\d+)?")
_FIELD = re.compile(rb"[^;,\r\n]+")


@dataclass(frozen=True, slots=True)
class Mischief:
    """What happens to lines: ``kind``, in the direction of ``questions`` (to the instrument), ``answers``, or both."""

    kind: str
    direction: str = "answers"
    delay_s: float = 0.0  #: of "late", on its way for so long; of "slow", which takes so long for each line
    words: str = ""  #: of "slip in"
    fields: tuple[int, ...] = ()  #: of an answer, where it is some of them

    def touches(self, direction: str) -> bool:
        """Whether lines in ``direction`` are spoilt."""
        return self.direction in (direction, "both")

    def __str__(self) -> str:
        return (
            f"{self.kind}{f' {self.delay_s:g} s' if self.delay_s else ''}{f' {self.words}' if self.words else ''}"
            f"{f' of {self.fields}' if self.fields else ''}, {self.direction}"
        )


HONEST = Mischief("honest", "none")


class Proxy:
    """Listens on ``port`` and passes lines to and from ``target_port``, as ``mischief`` has it."""

    def __init__(self, target_port: int, seed: int):
        self.mischief = HONEST
        self.spoilt = 0  #: lines
        self.heard_s: collections.deque[float] = collections.deque(maxlen=1000)  #: when the instrument heard something
        self._said = b""  #: the last answer of the instrument, on whatever connection
        self._first = self._before = b""  #: line since the mischief began, and the one before
        self._first_s = 0.0
        self._target_port = target_port
        self._chance = random.Random(seed)
        self._ending = threading.Event()
        self._sockets: set[socket.socket] = set()
        self._gate = threading.Lock()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        threading.Thread(target=self._accept, name="proxy", daemon=True).start()

    def spoil(self, mischief: Mischief) -> None:
        """Behave so from now on."""
        self.spoilt = 0
        self.mischief = mischief
        if mischief.kind in ("cut", "refuse", "reboot", "kept"):
            self._hang_up()

    def close(self) -> None:
        """End every connection and listen no more."""
        self._ending.set()
        self._listener.close()
        self._hang_up()

    def _hang_up(self) -> None:
        with self._gate:
            sockets, self._sockets = self._sockets, set()
        for each in sockets:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self) -> None:
        while not self._ending.is_set():
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            if self.mischief.kind in ("refuse", "reboot"):
                near.close()
                continue
            try:
                far = socket.create_connection(("127.0.0.1", self._target_port), timeout=5.0)
            except OSError:
                near.close()
                continue
            far.settimeout(None)
            with self._gate:
                self._sockets |= {near, far}
            for each in (near, far):
                with contextlib.suppress(OSError):  # hung up already
                    each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if self.mischief.kind == "kept":  # as a gateway to a serial line keeps it for the next connection
                with contextlib.suppress(OSError):
                    near.sendall(self._said)
            for source, sink, direction in ((near, far, "questions"), (far, near, "answers")):
                threading.Thread(target=self._pass, args=(source, sink, direction), name="proxy", daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket, direction: str) -> None:
        lines: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
        threading.Thread(target=self._take_in, args=(source, lines), name="proxy", daemon=True).start()
        with contextlib.suppress(OSError, ValueError):
            for came_s, line in iter(lines.get, _END):
                mischief = self.mischief
                if direction == "answers":
                    self._said = line
                if mischief.touches(direction):
                    self.spoilt += 1
                    self._send_spoilt(sink, line, came_s, mischief, direction)
                else:
                    self._put(sink, line, direction)
        for each in (source, sink):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
            with self._gate:
                self._sockets.discard(each)

    @staticmethod
    def _take_in(source: socket.socket, lines: queue.SimpleQueue[tuple[float, bytes]]) -> None:
        """When each line came: one that is held back does not hold back the next."""
        with contextlib.suppress(OSError, ValueError), source.makefile("rb") as came:
            for line in came:
                lines.put((time.monotonic(), line))
        lines.put(_END)

    def _put(self, sink: socket.socket, data: bytes, direction: str) -> None:
        if data and direction == "questions":
            self.heard_s.append(time.monotonic())
        sink.sendall(data)

    def _send_spoilt(self, sink: socket.socket, line: bytes, came_s: float, mischief: Mischief, direction: str) -> None:
        if mischief.kind == "trickle":
            self._trickle(sink, mischief)
            return
        while mischief.kind == "flood" and self.mischief is mischief and not self._ending.is_set():
            sink.sendall(b"9" * 65536)
        from_s = came_s if mischief.kind == "late" else time.monotonic()
        time.sleep(max(from_s + mischief.delay_s - time.monotonic(), 0.0))
        self._put(sink, self._spoilt(line, mischief), direction)

    def _spoilt(self, line: bytes, mischief: Mischief) -> bytes:
        """What is passed on in a line's place."""
        first = self.spoilt == 1
        kinds: dict[str, Callable[[], bytes]] = {
            "late": lambda: line,
            "slow": lambda: line,
            "drop": lambda: b"",
            "flood": lambda: b"",
            "duplicate": lambda: line + line,
            "empty": lambda: b"\n",
            # Once: from then on every answer is that to an older question.
            "extra": lambda: line * (EXTRA_LINES if first else 1),
            # Once: as where a serial line loses a byte, so that two answers are one.
            "glued": lambda: line.rstrip(b"\r\n") if first else line,
            # Once: as where somebody turns a knob, or the instrument forgets by itself.
            "slip in": lambda: (mischief.words.encode() + b"\n" if first else b"") + line,
            # It answers, and does nothing of what it is told.
            "forget": lambda: line if b"?" in line else b"",
            "garble": lambda: self._garbled(line),
            "swap digits": lambda: bytes(self._digit() if 48 <= byte < 58 else byte for byte in line),
            "nan": lambda: b",".join(b"NAN" for _ in line.split(b",")) + b"\n",
            "half": lambda: line[: len(line) // 2].rstrip(b"\n") + b"\n",
            "unended": lambda: line.rstrip(b"\r\n"),
            # From here on the form is right and the meaning wrong.
            "times thousand": lambda: self._scaled(line, 1e3),
            "by thousand": lambda: self._scaled(line, 1e-3),
            "negated": lambda: self._scaled(line, -1.0),
            "constant": lambda: self._first,
            "the one before": lambda: line if first else self._before,
            "another channel": lambda: self._rotated(line),
            "decimal comma": lambda: line.replace(b".", b","),
            "padded": lambda: b"  " + line.rstrip(b"\r\n") + b" \t\r\n",
            "nul": lambda: line.rstrip(b"\r\n") + b"\0\n",
            # And from here on each answer by itself may well be true.
            "swapped": lambda: self._with(line, mischief.fields[::-1], mischief.fields, lambda now, _: now),
            "frozen": lambda: self._with(line, mischief.fields, mischief.fields, lambda _, first: first),
            "sinking": lambda: self._with(line, mischief.fields, mischief.fields, self._sunk),
        }
        if mischief.kind not in kinds:
            raise ValueError(f"'{mischief.kind}' is no mischief of the proxy")
        if first:
            self._first, self._first_s = line, time.monotonic()
        spoilt, self._before = kinds[mischief.kind](), line
        return spoilt

    @staticmethod
    def _scaled(line: bytes, factor: float) -> bytes:
        return _NUMBER.sub(lambda found: b"%.8E" % (factor * float(found[0])), line)

    @staticmethod
    def _rotated(line: bytes) -> bytes:
        fields = _FIELD.findall(line)
        others = iter(fields[1:] + fields[:1])
        return _FIELD.sub(lambda _: next(others), line)

    def _with(
        self, line: bytes, from_: tuple[int, ...], to: tuple[int, ...], make: Callable[[float, float], float]
    ) -> bytes:
        """The fields ``to`` of an answer that has them, each made of what one of ``from_`` is and what it was first."""
        fields, first = _FIELD.findall(line), _FIELD.findall(self._first)
        if not len(fields) == len(first) > max(to):
            return line
        made = {there: make(float(fields[here]), float(first[here])) for here, there in zip(from_, to, strict=True)}
        return b",".join(b"%.8E" % made[n] if n in made else field for n, field in enumerate(fields)) + b"\n"

    def _sunk(self, voltage: float, first: float) -> float:
        """By a tenth a second, with the noise that it has."""
        return voltage - first * (1.0 - 0.9 ** (time.monotonic() - self._first_s))

    def _trickle(self, sink: socket.socket, mischief: Mischief) -> None:
        """Ten bytes a second without an end, until the mischief is over."""
        while self.mischief is mischief and not self._ending.is_set():
            sink.sendall(b"1")
            time.sleep(TRICKLE_s)
        sink.sendall(b"\n")

    def _digit(self) -> int:
        return 48 + self._chance.randrange(10)

    def _garbled(self, line: bytes) -> bytes:
        body = bytearray(line.rstrip(b"\r\n"))
        for place in range(len(body)):
            if self._chance.random() < 0.5:
                body[place] = self._chance.choice(b"\x00\x07\xff;:,-+eE.0123456789ABC?*\"' ")
        return bytes(body) + b"\n"
