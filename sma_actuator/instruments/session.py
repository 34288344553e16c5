"""One connection to an instrument: lines out, answers in, every wait and every answer bounded.

Three rules hold on every connection, whatever the other side does:

* *Off is said first and last.*  ``off_lines`` are written, without a question, as the first thing on
  every new connection and as the last on every one that is given up: an instrument whose answers
  cannot be used still hears.
* *Every answer has an end.*  It must be complete by a deadline of the monotonic clock and may not
  be longer than :data:`LONGEST_ANSWER`; bytes that trickle in do not extend it.
* *An answer belongs to its question.*  What came without a question, and what follows the end of an
  answer, means that the two sides are out of step.  Where commands are acknowledged, each waits for its own; those
  of the blind ``off_lines`` are read before the next line is sent.

A connection on which one of them fails is given up and never used again: a late reply would be
taken for the answer to the next question.  ``open`` makes a new one.  What comes late, but within ``patience_s``, is
heard first; of what is measured again and again it answers the same question asked anew, as of when it was asked first
(``late_since_s``): where every answer is late, those would else all be thrown away.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import math
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import pyvisa

from sma_actuator.base.parameters import ConfigError

from . import InstrumentLate, InstrumentLost, InstrumentRefused, InstrumentUnreachable
from .byte_streams import LONGEST_ANSWER, OWN_BACKEND, ByteStream, LAST_WORDS_s, Manner, SocketStream, VisaStream
from .claim import Claim
from .patterns import Pattern

_log = logging.getLogger(__name__)
T = TypeVar("T")

#: Where Linux shows serial lines of USB, below /dev.
_SERIAL_PORTS = ("serial/by-id/*", "ttyUSB*", "ttyACM*")
#: How a resource is written, in a sentence; and what somebody means who writes a host alone, or one with a port.
_RESOURCES = "TCPIP::192.168.0.5::5025::SOCKET or ASRL/dev/ttyUSB0::INSTR (docs/dialects.md)"
_HOST = re.compile(r"([A-Za-z0-9][\w.-]*)(?::(\d{1,5}))?", re.ASCII)
_USUAL_PORT = 5025  #: for programs; Rigol's is 5555
#: How long is waited for an identity behind lines that are none: of an instrument that answers commands.
_LATE_s = 0.3
#: How long opening may take with all its lines together, in multiples of the time for one answer: a slow instrument
#: takes its time for each, and there are up to thirty.
OPENING_ANSWERS = 30


class Session:
    """One connection at a time: texts out, texts in, every failure an InstrumentError that says who and what."""

    def __init__(self, role: str, resource: str, manner: Manner, timeout_s: float, off_lines: Sequence[str] = ()):
        self.role = role
        self.resource = resource
        self.lock = threading.RLock()
        self._manner = manner
        self._timeout_s = timeout_s
        self.off_lines = tuple(off_lines)
        self._addresses: list[tuple] = []  #: asked for once: a name server may be slower than any instrument
        self._deadline_s = math.inf
        self._line_by_line = False  #: each line told before an answer gives that its time
        self._answers = 0  #: that have come since a block with a deadline of its own began
        self._began_s = math.nan
        self._is_understood = False  #: it has answered a question, on whatever connection
        self.patience_s = 0.0  #: so long after its question an answer may still come (InstrumentLate)
        self.late_since_s = math.inf  #: when the first was asked of the late answers in the last block :meth:`within`
        self._begin(None)

    @property
    def name(self) -> str:
        """Role and resource, as messages have it."""
        return f"{self.role} at {self.resource}"

    def must_fit(self, manner: Manner) -> None:
        """Raise ConfigError where somebody else of this connection was told another manner."""
        if manner != self._manner:
            raise ConfigError(
                "instruments.daq: has the same resource as instruments.supply, so both speak over one line; the same "
                "serial, backend, write_termination, read_termination and command_pause are wanted"
            )

    def claim(self, why: str) -> Claim:
        """Take the instrument for this process, without a word to it.  Raises InstrumentRefused, which says ``why``."""
        try:
            return Claim(_canonical(self.resource))
        except OSError as error:
            raise InstrumentRefused(
                f"{self.name}: another program on this computer, or another part of this one, speaks to it; only one "
                f"may ({why})"
            ) from error

    @property
    def claimed_by(self) -> int | None:
        """The process that has claimed the instrument, where there is one that we may look into."""
        return Claim.holder(_canonical(self.resource))

    def beside(self) -> Session:
        """A second session to the same instrument, not open yet."""
        other = Session(self.role, self.resource, self._manner, self._timeout_s, self.off_lines)
        other._addresses, other._is_understood = self._addresses, self._is_understood
        return other

    @contextlib.contextmanager
    def within(self, timeout_s: float | None = None, line_by_line: bool = False) -> Iterator[None]:
        """Whatever is said and asked in this block is complete in this time, that of one answer if not given.

        ``line_by_line``: an answer may take its time for each line told before it as well, as a slow instrument does.
        """
        with self.lock:
            before_s, answers, began_s = self._deadline_s, self._answers, self._began_s
            before, self._line_by_line = self._line_by_line, line_by_line
            self._answers, self._began_s, self.late_since_s = 0, time.monotonic(), math.inf
            self._deadline_s = min(before_s, self._began_s + (self._timeout_s if timeout_s is None else timeout_s))
            try:
                yield
            finally:
                self._deadline_s, self._answers, self._began_s = before_s, answers, began_s
                self._line_by_line = before

    def open(self, lock: bool = False) -> None:
        """Connect and say off; with ``lock``, under VISA's exclusive lock where the resource class has one.

        Raises InstrumentUnreachable, or InstrumentRefused where somebody else holds that lock.
        """
        self.close()
        if not self.resource:
            raise InstrumentRefused(
                f"instruments.{self.role}.resource: is empty; a VISA resource is wanted, as "
                f"TCPIP::192.168.0.5::5025::SOCKET"
            )
        try:
            stream = self._connect(lock)
        except InstrumentRefused:
            raise
        except pyvisa.VisaIOError as error:
            if error.error_code == pyvisa.constants.StatusCode.error_resource_locked:
                raise InstrumentRefused(
                    f"{self.name}: somebody else holds its VISA lock; only one program may command it "
                    f"(instruments.{self.role}.exclusive_lock: false does without the lock)"
                ) from error
            raise self._cannot_be_opened(error) from error
        except ConnectionRefusedError as error:
            raise InstrumentUnreachable(
                f"{self.name}: nothing listens there; is it switched on, and is instruments.{self.role}.resource right?"
            ) from error
        except Exception as error:  # pyvisa-py raises a bare Exception for a host that has no address
            raise self._cannot_be_opened(error) from error
        self._begin(stream)
        self.say_off()

    def let_begin(self, pause_s: float) -> None:
        """Leave it time after its line was opened, and forget what it says meanwhile."""
        if pause_s > 0.0:
            time.sleep(pause_s)
            self._do("its beginning", lambda stream: stream.unread())

    def _begin(self, stream: ByteStream | None) -> None:
        self._stream = stream
        self._midline = False  #: a line was begun and not ended
        self._got = b""  #: received, and not a whole line yet
        self._answered = False  #: a question, on this connection
        self._told: list[str] = []  #: lines that have no answer, since the last question
        self._owed: list[str] = []  #: lines told blind, and questions, whose acknowledgement is still to come
        self._asked: tuple[str, float] | None = None  #: the line that an answer is wanted to, and when it was sent
        self._heard_late: dict[str, tuple[str, float]] = {}  #: its answer, and when it was asked
        #: When the next line may go: the first, off, not right behind the last of another connection either.
        self._free_s = time.monotonic() + self._manner.pause_s

    def say_off(self) -> None:
        """Write the off lines, blind and in bounded time, from any thread.  Never raises."""
        stream = self._stream
        if stream is None or not self.off_lines:
            return
        end = self._manner.write_termination
        pieces = [line + end for line in self.off_lines]
        if self._midline:
            pieces[0] = end + pieces[0]
        if not self._manner.pause_s:
            pieces = ["".join(pieces)]
        try:
            for piece in pieces:
                self._pause(math.inf)
                stream.send(piece.encode(), time.monotonic() + LAST_WORDS_s)
                self._has_spoken()
            self._owe(*self.off_lines)
        except (OSError, pyvisa.Error) as error:
            _log.debug("%s: off could not be written: %s", self.name, error)

    def tell(self, *lines: str) -> None:
        """Send lines; raises InstrumentRefused for one that is not acknowledged where that is wanted."""
        with self.lock:
            for line in lines:
                by_s = self._by_s()
                if self._manner.acknowledgement is None:
                    self._send(line, by_s)
                else:
                    self._settle(by_s)
                    self._must_be_silent(line, by_s)
                    self._put(line, by_s)
                    self._hear_acknowledgement(line, by_s)
                self._told.append(line)

    @property
    def told(self) -> tuple[str, ...]:
        """Lines that have no answer, told since the last question."""
        return tuple(self._told)

    def tell_blind(self, *lines: str) -> None:
        """Send lines, whatever is answered to them."""
        with self.lock:
            for line in lines:
                self._send(line, self._by_s())
                self._owe(line)

    def ask(self, line: str) -> str:
        """Send a query; its answer, which must be one line of text and must not be empty."""
        return self.ask_for(line, lambda reply: reply)

    def ask_for(self, line: str, read: Callable[[str], T], late_counts: bool = False) -> T:
        """Send a query; what ``read`` makes of its answer.

        ``read`` raises ValueError for a line that is no answer to that.  ``late_counts``: so may what was said to the
        same line before, and came too late then.
        """
        with self.lock:
            by_s = self._by_s()
            self._settle(by_s)
            text, asked_s = self._heard_late.pop(line, ("", -math.inf))
            if late_counts and time.monotonic() < asked_s + self.patience_s:
                self.late_since_s = min(self.late_since_s, asked_s)
            else:
                text = self._answer(line, by_s)
            try:
                if not text or not text.replace("\t", " ").isprintable():
                    raise ValueError
                value = read(text)
            except ValueError as error:
                raise self.garbled(line, text, str(error)) from None
            self._answered = self._is_understood = True
            self._answers += 1
            self._told.clear()
        return value

    def _answer(self, line: str, by_s: float) -> str:
        """Send a query; the line that is said to it."""
        self._must_be_silent(line, by_s)
        self._put(line, by_s)
        text = self._line(f"'{line}'", by_s)
        while self._acknowledges(text):  # a late one, of a connection before this
            text = self._line(f"'{line}'", by_s)
        self._asked = None
        if self._manner.acknowledges_answers:
            self._owed.append(line)
        if text == line:
            raise self._repeats(line)
        if self._got and not self._owed:
            both = f"'{_shown(text)}', '{_shown(self._got)}'"
            advice = self._advice(text)
            if self._manner.acknowledgement is not None:
                advice = (
                    f"; where '{self._wanted}' follows each answer, put acknowledges_answers: true into its dialect"
                )
            raise self.give_up(f"answered '{line}' with more than one line: {both}{advice}")
        return text

    def introduce(self, line: str, identity: Pattern) -> str:
        """Ask who it is, as the first question on a connection: the answer, whether it is like ``identity`` or not.

        Raises InstrumentRefused where commands told before were answered, and nothing says that they are. Where nothing
        was told, lines before its name are answers to an earlier connection, as a serial line brings them.
        """
        with self.lock:
            by_s = self._by_s()
            self._settle(by_s)
            self._send(line, by_s)
            lines = [self._line(f"'{line}'", by_s)]
            until_s = min(by_s, time.monotonic() + _LATE_s)
            with contextlib.suppress(InstrumentLost):
                while lines[-1] != line and not identity.search(lines[-1]):
                    lines.append(self._line(f"'{line}'", until_s))
            said = lines[-1] if lines[-1] == line or identity.search(lines[-1]) else lines[0]
            if said == line:
                raise self._repeats(line)
            if not said or not said.replace("\t", " ").isprintable():
                raise self.garbled(line, said, "", self.may_begin_anew)
            if said != lines[0] and self._manner.acknowledgement is None and (self._told or self._is_understood):
                answers = lines[:-1]  # to each line the same, and on a serial line to those of an earlier connection
                if self._is_understood or len(answers) < len(self._told) or len(set(answers)) > 1:
                    raise self._unasked("; ".join(answers), lines[0])
                self.give_up("")
                raise InstrumentRefused(
                    f"{self.name}: it answers commands ('{_shown(lines[0])}' to '{self._told[0]}'): put "
                    f"acknowledgement: '{_shown(lines[0])}' into its dialect (docs/dialects.md)"
                )
            if self._manner.acknowledges_answers:
                self._owed.append(line)
            self._answered = self._is_understood = True
            self._told.clear()
        return said

    def give_up(self, why: str) -> InstrumentLost:
        """Say off, close, and the error that tells why."""
        self.say_off()
        self.close()
        return InstrumentLost(f"{self.name}: {why}")

    def garbled(self, line: str, reply: str, why: str = "", advice: str = "") -> InstrumentLost:
        """The error for an answer that is none; the connection is given up, since its order is lost."""
        if line in reply.splitlines():  # an echo whose lines end otherwise than answers do
            return self._repeats(line)
        reading = f" ({_shown(why)}; its dialect says how to read it: answer, field, yes and no)" if why else ""
        return self.give_up(
            f"answered '{_shown(reply)}' to '{line}', which is not an answer to that{reading}"
            f"{advice or self._advice(reply)}"
        )

    def _repeats(self, line: str) -> InstrumentLost:
        return self.give_up(f"repeats what it is asked, '{line}': its echo is on, or {self._for_people}")

    def _advice(self, said: str) -> str:
        """What may be wrong where something came that was not asked for."""
        if not self._told or self._manner.acknowledgement is not None:
            return ""
        return (
            f"; if that is what it says to commands, as to '{self._told[-1]}' before, put acknowledgement: "
            f"'{_shown(said)}' into its dialect"
        )

    def cut(self) -> None:
        """Say off on a connection that hangs in another thread, and break it; what hangs then fails.

        The instrument's exclusive lock goes with the connection, so that another one can be heard.
        """
        stream = self._stream
        if stream is not None:
            self.say_off()
            stream.cut()

    def close(self) -> None:
        """Give up the connection.  Never raises."""
        stream, self._stream = self._stream, None
        if stream is not None:
            try:
                stream.close()
            except Exception as error:  # noqa: BLE001 - nothing depends on a connection that is given up
                _log.debug("%s: closing: %s", self.name, error)

    def _by_s(self) -> float:
        lines = 1 + (len(self._told) if self._line_by_line else 0)
        return min(self._deadline_s, time.monotonic() + lines * self._timeout_s)

    def _connect(self, lock: bool) -> ByteStream:
        name = pyvisa.rname.ResourceName.from_string(self.resource)
        by_s = self._by_s()
        if isinstance(name, pyvisa.rname.TCPIPSocket) and self._manner.backend == OWN_BACKEND:
            if not self._addresses:
                port = int(name.port)
                if not 0 < port < 65536:
                    raise OSError(f"there is no port {port}")
                self._addresses = socket.getaddrinfo(name.host_address, port, type=socket.SOCK_STREAM)
            return SocketStream(self._addresses, by_s)
        library = self._library()  # the first one takes its time, which is not the instrument's
        stream = VisaStream(library, self.resource, self._manner, self._by_s())
        if lock:
            try:
                stream.lock()
            except pyvisa.Error:
                stream.close()
                raise
        return stream

    def _library(self) -> pyvisa.ResourceManager:
        backend = self._manner.backend
        try:
            return pyvisa.ResourceManager(backend if "@" in backend else f"@{backend}")
        except Exception as error:  # each backend raises its own
            raise InstrumentRefused(
                f"instruments.{self.role}.backend: '{backend}' cannot be loaded ({_shown(str(error))}); py needs "
                "nothing more, ivi wants the VISA library of NI, Keysight or R&S, and file.yaml@sim pyvisa-sim and "
                "that file"
            ) from error

    def _send(self, line: str, by_s: float) -> None:
        data = (line + self._manner.write_termination).encode()
        self._do(f"'{line}'", lambda _: self._pause(by_s))
        self._midline = True
        self._do(f"'{line}'", lambda stream: stream.send(data, by_s))
        self._midline = False
        self._has_spoken()

    def _put(self, line: str, by_s: float) -> None:
        """Send a line that an answer is wanted to.  Raises InstrumentLate where there is no time left for one."""
        now_s = time.monotonic()
        if now_s >= by_s and self._is_patient:
            raise self._late(f"there was no time left for '{line}' within {self._timeout_s:g} s", now_s)
        self._send(line, by_s)
        self._asked = line, now_s

    @property
    def _is_patient(self) -> bool:
        return self.patience_s > 0.0 and self._stream is not None and self._stream.resumes

    def _late(self, why: str, asked_s: float) -> InstrumentLate:
        return InstrumentLate(f"{self.name}: {why}", asked_s)

    def _has_spoken(self) -> None:
        self._free_s = time.monotonic() + self._manner.pause_s

    def _pause(self, by_s: float) -> None:
        """Leave the instrument its time after the last line.  Raises TimeoutError where that lasts too long."""
        if self._free_s > by_s:
            raise TimeoutError(f"instruments.{self.role}.command_pause, {self._manner.pause_s:g} s, is a part of it")
        left_s = self._free_s - time.monotonic()
        if left_s > 0.0:
            time.sleep(left_s)

    def _settle(self, by_s: float) -> None:
        """Hear what is still said to the last question, which comes too late for that, and to lines told blind."""
        if self._asked is not None:
            line, asked_s = self._asked
            said = self._line(f"'{line}'", min(by_s, asked_s + self.patience_s) if self.patience_s else by_s)
            self._asked = None
            if not self._acknowledges(said):
                self._heard_late[line] = said, asked_s
        while self._owed:
            line = self._owed.pop(0)
            self._line(f"'{line}', where acknowledgement '{self._wanted}' was wanted", by_s)

    def _must_be_silent(self, line: str, by_s: float) -> None:
        """Nothing may have come before ``line`` is sent but what acknowledges a line of an earlier connection."""
        self._got += self._do(f"'{line}'", lambda stream: stream.unread())
        while came := self._got:
            whole = self._line_is_whole or self._manner.acknowledgement is not None  # of the latter the rest is to come
            first = self._line(f"'{line}'", by_s) if whole else _shown(came)
            if not self._acknowledges(first):
                raise self._unasked(came, first)

    def _unasked(self, came: bytes | str, first: str) -> InstrumentLost:
        """What came is no answer: a greeting, what acknowledges a command, or a late answer to an earlier connection,
        as a serial line and a gateway keep it."""
        whose = self._out_of_step if self._is_understood else self._for_people
        advice = self._advice(first) if self._answered or not self._is_understood else ""
        return self.give_up(f"said '{_shown(came)}' without being asked: {whose}{advice}{self.may_begin_anew}")

    def _owe(self, *lines: str) -> None:
        self._told += lines
        if self._manner.acknowledgement is not None:
            self._owed += lines

    def _acknowledges(self, text: str) -> bool:
        pattern = self._manner.acknowledgement
        return pattern is not None and pattern.fullmatch(text) is not None

    def _hear_acknowledgement(self, line: str, by_s: float) -> None:
        said = self._line(f"'{line}'", by_s)
        self._asked = None
        if not self._acknowledges(said):
            self.give_up("")
            raise InstrumentRefused(
                f"{self.name}: answered '{_shown(said)}' to '{line}', where acknowledgement '{self._wanted}' of its "
                "dialect was wanted: it refuses that, or the dialect is not its own (docs/dialects.md)"
            )

    @property
    def _wanted(self) -> str:
        return self._manner.acknowledgement.pattern if self._manner.acknowledgement is not None else ""

    @property
    def _end(self) -> bytes:
        return self._manner.read_termination.encode()

    @property
    def _fixed(self) -> tuple[int, bool]:
        """How many bytes are wanted where the answer has no end, 0 where it is a line; whether they are a number."""
        return self._manner.fixed.get(self._asked[0], (0, False)) if self._asked is not None else (0, False)

    @property
    def _line_is_whole(self) -> bool:
        length, _ = self._fixed
        return len(self._got) >= length if length else self._end in self._got

    def _line(self, what: str, by_s: float) -> str:
        """One line of what it says to ``what``."""
        while not self._line_is_whole:
            self._got += self._do(what, lambda stream: self._piece(stream, by_s))
        length, is_number = self._fixed
        if length:
            text, self._got = self._got[:length], self._got[length:]
        else:
            text, _, self._got = self._got.partition(self._end)
        self._has_spoken()
        return f"0x{text.hex()}" if is_number else text.decode("ascii", errors="replace").strip()

    def _piece(self, stream: ByteStream, by_s: float) -> bytes:
        if len(self._got) > LONGEST_ANSWER:
            raise OSError(f"its answer has no end within {LONGEST_ANSWER} bytes")
        try:
            return stream.receive(by_s)
        except TimeoutError as error:
            length, _ = self._fixed
            lacks = f"'{_shown(self._got)}' came, "
            if length:
                lacks += f"{len(self._got)} of {length} bytes (length or bytes, in its dialect)"
            else:
                lacks += (
                    f"without the end of a line, {self._manner.read_termination!r} "
                    f"(instruments.{self.role}.read_termination)"
                )
            raise TimeoutError(lacks if self._got else "") from error

    def _do(self, what: str, action: Callable[[ByteStream], T]) -> T:
        stream = self._stream
        if stream is None:
            raise InstrumentLost(f"{self.name}: not connected")
        try:
            return action(stream)
        except TimeoutError as error:
            begun = f": {error}" if str(error) else ""
            if self._answers and math.isfinite(self._deadline_s):
                took_s = time.monotonic() - self._began_s
                begun += (
                    f"; with the {self._answers} answers before it that took {took_s:.2g} s, and "
                    f"instruments.{self.role}.timeout is the time for all of them together"
                )
            if not self._is_understood:
                begun += self._not_understood
            why = f"no complete answer to {what} within {self._timeout_s:g} s{begun}"
            if self._asked is not None and self._is_patient:
                asked_s = self._asked[1]
                if time.monotonic() < asked_s + self.patience_s:
                    raise self._late(why, asked_s) from error
                why = f"no complete answer to {what}, {self.patience_s:g} s after it was asked{begun}"
            raise self.give_up(why) from error
        except (pyvisa.Error, OSError, ValueError) as error:
            raise self.give_up(f"the connection broke at {what} ({error})") from error

    @property
    def _not_understood(self) -> str:
        """What may be so where it has never answered; to end a sentence with."""
        why = (
            f"; is instruments.{self.role}.serial.baud_rate, {self._manner.serial.baud_rate}, right; does it obey in "
            "remote alone, as after SYST:REM (remote, in its dialect)"
        )
        ends = (
            f"; does it want more than instruments.{self.role}.timeout; do its lines end otherwise than with "
            f"{self._manner.write_termination!r} (instruments.{self.role}.write_termination), or want time between "
            f"them (instruments.{self.role}.command_pause)?"
        )
        return f"{why if self._is_serial else ''}{ends}{self.may_begin_anew}"

    @property
    def may_begin_anew(self) -> str:
        """What may be so where one on a serial line does not say what it was asked; to end a sentence with."""
        if not self._is_serial:
            return ""
        so = "instruments.daq.opening_pause" if self.role == "daq" else "which a supply must not: docs/dialects.md"
        return f"; does it begin anew when its line is opened, as many an Arduino ({so})?"

    @property
    def _is_serial(self) -> bool:
        return is_serial(self.resource)

    @property
    def _out_of_step(self) -> str:
        return "its answers and our questions are out of step"

    @property
    def _for_people(self) -> str:
        if self._is_serial:
            return "it speaks by itself, and one that speaks when it is asked is wanted"
        return (
            f"instruments.{self.role}.resource may name a port for people; the one for programs is wanted, often 5025"
        )

    def _cannot_be_opened(self, error: Exception) -> InstrumentUnreachable:
        return InstrumentUnreachable(f"{self.name}: {_why_not_opened(error, self._is_serial)}")


def is_serial(resource: str) -> bool:
    """Whether a VISA resource is a serial line."""
    return resource.upper().startswith("ASRL")


def _why_not_opened(error: Exception, is_serial: bool) -> str:
    """What may be so where an instrument cannot be connected to; pyserial's errors are the system's own."""
    if isinstance(error, pyvisa.rname.InvalidResourceName):
        return f"cannot be opened: that is no VISA resource, as {_RESOURCES}"
    if is_serial and isinstance(error, OSError) and error.errno == errno.EACCES:
        return (
            "this user may not open it; put yourself into the group of the device, as with "
            "'sudo usermod -aG dialout $USER', and log in anew"
        )
    if is_serial and isinstance(error, OSError) and error.errno == errno.ENOENT:
        there = ", ".join(str(path) for places in _SERIAL_PORTS for path in sorted(Path("/dev").glob(places)))
        return (
            f"there is no such port; of USB there is {there or 'none'}; what is plugged in anew may have another name, "
            "but for that in /dev/serial/by-id"
        )
    return f"cannot be opened ({error}); is it switched on, and is the address right?"


def no_resource(name: str, text: str) -> str:
    """Why the parameter of this name is no VISA resource, and what is meant perhaps; empty where it is one."""
    try:
        pyvisa.rname.ResourceName.from_string(text)
    except pyvisa.rname.InvalidResourceName:
        wanted = _RESOURCES
        if text.startswith("/dev/"):
            wanted = f"ASRL{text}::INSTR"
        elif host := _HOST.fullmatch(text):
            wanted = f"TCPIP::{host[1]}::{host[2] or _USUAL_PORT}::SOCKET"
            wanted += "" if host[2] else ", with the port that its manual has,"
        return f"{name}: '{text}' is no VISA resource; {wanted} is wanted"
    return ""


def _canonical(resource: str) -> str:
    """The same for every way to write an instrument's host."""
    try:
        name = pyvisa.rname.ResourceName.from_string(resource)
    except pyvisa.rname.InvalidResourceName:
        return resource
    if isinstance(name, pyvisa.rname.ASRLInstr) and name.board.startswith("/"):
        name.board = str(Path(name.board).resolve())  # /dev/serial/by-id/… is one of several names
        return str(name)
    if isinstance(name, pyvisa.rname.TCPIPSocket | pyvisa.rname.TCPIPInstr):
        with contextlib.suppress(OSError, UnicodeError):  # a host without an address has no other name either
            found = socket.getaddrinfo(name.host_address, None, type=socket.SOCK_STREAM)
            _, name.host_address = min(
                (family != socket.AF_INET, str(address[0])) for family, _, _, _, address in found
            )
    return str(name).upper()


def _shown(text: bytes | str) -> str:
    """What an instrument said, short enough for a sentence, and with nothing in it that a terminal would obey."""
    raw = text.decode("latin-1") if isinstance(text, bytes) else text
    words = raw.strip().encode("unicode_escape").decode("ascii").replace(r"\\", "\\")  # as it stands in a dialect
    return words if len(words) <= 80 else f"{words[:77]}…"
