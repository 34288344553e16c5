"""Bytes to and from an instrument, by a socket of our own or by VISA; every wait ends at a deadline."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, cast

import pyvisa

from .parameters import TERMINATIONS, Connection, SerialLine
from .patterns import Pattern

#: An answer without an end is given up after this many bytes; a block of 5000 samples of five channels has 0.4 MB.
LONGEST_ANSWER = 1 << 20
#: So much is read at once.
_PIECE = 1 << 16
#: How long the last words on a connection may take: a full send buffer must not hold up what follows.
LAST_WORDS_s = 0.05
#: pyvisa-py; a socket with it is one of our own.
OWN_BACKEND = "py"


@dataclass(frozen=True, slots=True)
class Manner:
    """How lines go to and fro: where they end, how quickly they may follow each other, and over which kind of line."""

    write_termination: str = "\n"
    read_termination: str = "\n"
    acknowledgement: Pattern | None = None  #: the whole line that answers a command; None: it has no answer
    acknowledges_answers: bool = False  #: that line follows every answer too
    pause_s: float = 0.0  #: from the end of a command or an answer to the next command
    #: Question → how many bytes its answer has, which has no end, and whether they are a number instead of a text.
    fixed: Mapping[str, tuple[int, bool]] = field(default_factory=dict)
    serial: SerialLine = field(default_factory=SerialLine)  #: where it is one
    backend: str = OWN_BACKEND

    @classmethod
    def of(
        cls,
        connection: Connection,
        terminations: tuple[str, str] = ("\n", "\n"),
        acknowledgement: Pattern | None = None,
        acknowledges_answers: bool = False,
        pause_s: float = 0.0,
        fixed: Mapping[str, tuple[int, bool]] | None = None,
    ) -> Manner:
        """What the parameters say; the terminations, of what is written and read, for where they say none, and the
        pause that is the least."""
        return cls(
            TERMINATIONS.get(connection.write_termination, terminations[0]),
            TERMINATIONS.get(connection.read_termination, terminations[1]),
            acknowledgement,
            acknowledges_answers,
            max(connection.command_pause, pause_s),
            fixed or {},
            connection.serial,
            connection.backend,
        )


class ByteStream(Protocol):
    """Bytes to and from an instrument.  ``send`` and ``receive`` raise TimeoutError, OSError or pyvisa.Error."""

    resumes: bool  #: what comes after a time-out can still be received, whole and in order

    def send(self, data: bytes, deadline_s: float) -> None:
        """Write all of it before the deadline."""

    def receive(self, deadline_s: float) -> bytes:
        """At least one byte, before the deadline."""

    def unread(self) -> bytes:
        """What has come already; nothing where that cannot be known."""

    def cut(self) -> None:
        """Break it under another thread that waits for it."""

    def close(self) -> None:
        """Let go of it."""


class SocketStream:
    """A TCP connection of our own, for ``TCPIP::…::SOCKET``."""

    resumes = True

    def __init__(self, addresses: Sequence[tuple], deadline_s: float):
        self._socket = self._connected(addresses, deadline_s)
        # Else a query after a command waits some 40 ms for the other side's delayed acknowledgement.
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)

    @staticmethod
    def _connected(addresses: Sequence[tuple], deadline_s: float) -> socket.socket:
        errors: list[OSError] = []
        for family, kind, protocol, _, address in addresses:
            one = socket.socket(family, kind, protocol)
            try:
                one.settimeout(_left_ms(deadline_s) / 1e3)
                one.connect(address)
                return one
            except OSError as error:
                one.close()
                errors.append(error)
        raise errors[0] if errors else OSError("it has no address")

    def send(self, data: bytes, deadline_s: float) -> None:
        """Write all of it; waits for room."""
        done = 0
        while done < len(data):
            try:
                done += self._socket.send(data[done:])
            except BlockingIOError:
                self._wait(select.POLLOUT, deadline_s)

    def receive(self, deadline_s: float) -> bytes:
        """What there is; waits for the first byte."""
        self._wait(select.POLLIN, deadline_s)
        data = self._socket.recv(_PIECE)
        if not data:
            raise ConnectionResetError("the other side closed it")
        return data

    def unread(self) -> bytes:
        """What has come already.  An end that has come is for the next ``receive``."""
        try:
            return self._socket.recv(_PIECE)
        except BlockingIOError:
            return b""

    def cut(self) -> None:
        """End both directions, after what was written."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End it so that what was written still arrives: unread bytes would turn the end into a reset."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
            for _ in range(0, LONGEST_ANSWER, _PIECE):
                if not self._socket.recv(_PIECE):
                    break
        self._socket.close()

    def _wait(self, event: int, deadline_s: float) -> None:
        poll = select.poll()
        poll.register(self._socket, event)
        if not poll.poll(_left_ms(deadline_s)):
            raise TimeoutError


class VisaStream:
    """Any other resource of VISA: VXI-11, HiSLIP, USB, GPIB, serial; and all of them with another backend than
    pyvisa-py.

    Each call into VISA is bounded by VISA's own time-out, which some backends take by the wall
    clock; the deadline of the whole answer is ours.  What came unasked is seen on a serial line alone.
    """

    def __init__(self, library: pyvisa.ResourceManager, resource: str, manner: Manner, deadline_s: float):
        visa = library.open_resource(
            resource, read_termination=manner.read_termination, open_timeout=_left_ms(deadline_s)
        )
        self._visa = cast("pyvisa.resources.MessageBasedResource", visa)
        self._serial = isinstance(self._visa, pyvisa.resources.SerialInstrument)
        self.resumes = self._serial  # a transfer of the others that has timed out is ended
        if self._serial:
            try:
                self._prepare(cast("pyvisa.resources.SerialInstrument", visa), manner.serial)
            except BaseException:
                self._visa.close()
                raise

    @staticmethod
    def _prepare(line: pyvisa.resources.SerialInstrument, wanted: SerialLine) -> None:
        """Set a serial line as it is wanted, and forget what came before: it has no beginning, as a stream has."""
        constants = pyvisa.constants
        line.baud_rate, line.data_bits = wanted.baud_rate, wanted.data_bits
        line.parity = constants.Parity[wanted.parity]
        line.stop_bits = {1: constants.StopBits.one, 2: constants.StopBits.two}[wanted.stop_bits]
        line.flow_control = constants.ControlFlow[wanted.flow_control]
        with contextlib.suppress(NotImplementedError):  # pyvisa-sim's
            line.flush(constants.BufferOperation.discard_read_buffer)

    def lock(self) -> None:
        """Take VISA's exclusive lock, where the interface has one: pyvisa-py's have none but for VXI-11."""
        try:
            self._visa.lock_excl(timeout=0)
        except (NotImplementedError, AttributeError):
            pass
        except pyvisa.VisaIOError as error:
            if error.error_code != pyvisa.constants.StatusCode.error_nonsupported_operation:
                raise

    def send(self, data: bytes, deadline_s: float) -> None:
        """Write all of it."""
        with self._until(deadline_s):
            self._visa.write_raw(data)

    def receive(self, deadline_s: float) -> bytes:
        """A piece of an answer, or all of it."""
        # A serial line has no messages, only bytes: pyvisa-py would wait for all that are asked for, by the wall clock.
        with self._until(deadline_s):
            return self._read(max(1, self._waiting) if self._serial else 4096)

    def unread(self) -> bytes:
        """What has come on a serial line; of any other that is not to be known."""
        with self._until(time.monotonic() + LAST_WORDS_s):
            waiting = self._waiting if self._serial else 0
            return self._read(waiting) if waiting else b""

    @property
    def _waiting(self) -> int:
        return cast("pyvisa.resources.SerialInstrument", self._visa).bytes_in_buffer

    def _read(self, most: int) -> bytes:
        code = pyvisa.constants.StatusCode.success_max_count_read
        with self._visa.ignore_warning(code):
            data, _ = self._visa.visalib.read(self._visa.session, most)
        return data

    def cut(self) -> None:
        """Close it: the call that waits for it then fails, at the latest by its time-out."""
        self.close()

    def close(self) -> None:
        """Give it back to VISA."""
        self._visa.close()

    @contextlib.contextmanager
    def _until(self, deadline_s: float) -> Iterator[None]:
        self._visa.timeout = _left_ms(deadline_s)
        try:
            yield
        except pyvisa.VisaIOError as error:
            if error.error_code != pyvisa.constants.StatusCode.error_timeout:
                raise
            raise TimeoutError from error
        except TypeError as error:  # what pyserial makes of a line that is closed under the one who waits for it
            raise ConnectionAbortedError("it was closed") from error


def _left_ms(deadline_s: float) -> int:
    """Time until a deadline, rounded up; raises TimeoutError where there is none left."""
    left_s = deadline_s - time.monotonic()
    if left_s <= 0.0:
        raise TimeoutError
    return math.ceil(1e3 * left_s)
