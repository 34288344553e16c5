"""What every supply behind a session has in common: one owner, off first and last, off confirmed."""

from __future__ import annotations

import contextlib
import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from . import InstrumentError, InstrumentLost, InstrumentRefused, InstrumentUnreachable, OutputStaysOn
from .afterwards import OFF_ANSWERS, Afterwards, STANDS_STILL_s
from .byte_streams import Manner
from .claim import Claim
from .parameters import InstrumentSections
from .session import OPENING_ANSWERS, Session

_log = logging.getLogger(__name__)

#: ``shut_down`` does not wait longer for a query in another thread to end.
_LOCK_TIMEOUT_s = 0.1
#: Switching off repeats itself: the lock of a lost connection may take a moment to go.
_OFF_ATTEMPTS, _OFF_PAUSE_s = 5, 0.02


@dataclass(frozen=True, slots=True)
class Abilities:
    """What a supply can do for a wire that nobody looks after."""

    what: str  #: the supply, in words
    watchdog: bool = False  #: its own silence cuts its output
    watchdog_of_session: bool = False  #: and only the connection that armed it counts
    second_session: bool = False  #: it is known to listen to a second connection while the first one hangs
    voltage_setting: bool = False  #: it can be read back
    over_voltage_trip: bool = False  #: one that is programmed and can be read back
    over_current_trip: bool = False

    def unsafe_states(self) -> dict[str, str]:
        """What is left to others, and what to wire up for it: parameter that acknowledges it → sentence."""
        states = {}
        if not self.watchdog:
            states["allow_no_watchdog"] = (
                f"{self.what} has no communication watchdog, so a killed computer or a pulled network cable leaves the "
                "current on; wire a relay into its output that drops out when the computer is silent, and a fuse that "
                "the wire survives"
            )
        elif not self.watchdog_of_session:
            states["allow_shared_watchdog"] = (
                f"{self.what} has a communication watchdog that anybody's words feed, so whoever else speaks to it "
                "keeps the current of a dead computer on; give it a network of its own, or wire a relay into its "
                "output that drops out when the computer is silent"
            )
        if not self.watchdog and not self.second_session:  # else its silence cuts the output, whatever hangs
            states["allow_single_session"] = (
                f"{self.what} is not known to take a second session and has no communication watchdog, so where its "
                "session hangs the current stays on until that is closed; wire a switch into its output that a hand "
                "can reach"
            )
        lacking = [
            f"no {name} trip that can be read back"
            for name, has in (("over-voltage", self.over_voltage_trip), ("over-current", self.over_current_trip))
            if not has
        ]
        if not self.voltage_setting:
            lacking.append("no compliance voltage that can be read back")
        if lacking:
            states["allow_no_trips"] = (
                f"{self.what} has {' and '.join(lacking)}, so nothing in it stands against a setting that is wrong or "
                "that somebody else has made; wire a fuse in series with the wire that it survives for ever"
            )
        return states


class SessionSupply(ABC):
    """How a supply is opened, switched off and given up; what it is told is for the subclasses to say."""

    def __init__(
        self,
        config: InstrumentSections,
        manner: Manner,
        off_lines: Sequence[str],
        unlock_lines: Sequence[str] = (),
    ):
        self._config = config
        self._limits = config.supply
        self._instrument = config.instruments.supply
        self._channel = self._instrument.channel
        self._session = Session("supply", self._instrument.resource, manner, self._instrument.timeout, off_lines)
        self._unlock_lines = tuple(unlock_lines)
        self._claim: Claim | None = None
        self._ours = False  #: it was opened, so that whatever flows is ours
        self._checks: list[
            Callable[[], None]
        ] = []  #: one for each setting that must stand; they raise where it does not
        self._check_number = 0
        self._watchdog = False  #: its own silence cuts its output
        self._afterwards: Afterwards | None = None  #: who says off when this program is gone
        self._confirmed = False  #: off was read back, and on not said since
        self._unsafe: list[str] = []  #: states that cannot be made safe, in a sentence each
        self._warned: set[str] = set()  #: of which of them was said, once, however often it is opened
        self.identity = ""

    @property
    def patience_s(self) -> float:
        """So long after its question an answer may still come."""
        return self._session.patience_s

    @patience_s.setter
    def patience_s(self, patience_s: float) -> None:
        self._session.patience_s = patience_s

    @abstractmethod
    def _configure(self) -> None:
        """Identify, program and read back a supply that was just connected; raise InstrumentError where it will not
        do."""

    @abstractmethod
    def _tell_current(self, current_A: float) -> None:
        """Program a current that was checked."""

    @abstractmethod
    def _tell_output(self, on: bool) -> None:
        """Switch the output."""

    @abstractmethod
    def _output_is_on(self, session: Session) -> bool:
        """Ask for the state of the output over a session that may be another than the usual one."""

    def open(self) -> None:
        """Connect, output off, limits, protections and watchdog programmed and read back.

        May be called again, for a new connection.  Raises InstrumentLost or InstrumentRefused; then it was told
        to switch off, first and last, unless another program of this computer drives it.
        """
        session = self._session
        self._promise(0.0)  # who opens it says off first, again and again, and may wait for long
        with session.within(OPENING_ANSWERS * self._instrument.timeout, line_by_line=True):
            if self._instrument.exclusive_lock and self._claim is None:
                self._claim = self._claimed_soon()
            try:
                session.open(self._instrument.exclusive_lock)
                self._configure()
            except InstrumentError:
                session.say_off()
                session.close()  # nobody shall switch on what was refused
                if not self._ours:
                    self._release()
                raise
        for sentence in self._unsafe:
            if sentence not in self._warned:
                _log.warning("%s: %s", session.name, sentence)
                self._warned.add(sentence)
        self._ours = True

    def _claimed_soon(self) -> Claim:
        """The right to speak to it, waited for as long as somebody may take who says off for a program that is gone."""
        until_s = time.monotonic() + OFF_ANSWERS * self._instrument.timeout
        while True:
            try:
                return self._session.claim(
                    "instruments.supply.exclusive_lock: false shares it, and with it the watchdog"
                )
            except InstrumentRefused:
                if time.monotonic() >= until_s:
                    raise
                time.sleep(_OFF_PAUSE_s)

    def _acknowledged(self, abilities: Abilities) -> None:
        """Keep the sentences of states that cannot be made safe; raise InstrumentRefused where one is not acknowledged,
        or where heat would be limited as by a watchdog that there is not."""
        self._watchdog = abilities.watchdog
        unsafe, waited_s = abilities.unsafe_states(), self._limits.watchdog_timeout
        for parameter, sentence in unsafe.items():
            if not getattr(self._limits, parameter):
                raise InstrumentRefused(f"{self._session.name}: {sentence}; supply.{parameter}: true acknowledges that")
        if waited_s > 0.0 and not abilities.watchdog:
            raise InstrumentRefused(
                f"{self._session.name}: {abilities.what} has no communication watchdog, and supply.watchdog_timeout is "
                f"{waited_s:g} s; write supply.watchdog_timeout: 0, and no more flows than the wire survives for ever"
            )
        self._unsafe = list(unsafe.values())

    def set_output(self, on: bool) -> None:
        """Switch the output.  Before one without a watchdog goes on, somebody waits who says off when this program is
        gone."""
        if on:
            self._confirmed = False
            if not self._watchdog and not (self._afterwards is not None and self._afterwards.waits):
                self._begin_afterwards()
        self._tell_output(on)

    def _keep_afterwards(self) -> None:
        """Begin it anew where it was ended by somebody, as all of a program's processes may be, one after the other, or
        stopped."""
        if self._afterwards is not None and not self._afterwards.waits:
            self._afterwards.dismiss()
            self._afterwards = None
            _log.warning(
                "%s: who says off when this program is killed was ended or stopped; begun anew", self._session.name
            )
            self._begin_afterwards()

    def _promise(self, silent_s: float) -> None:
        afterwards = self._afterwards  # any thread may switch off, or close
        if afterwards is not None:
            afterwards.promise(silent_s)

    def _begin_afterwards(self) -> None:
        try:
            self._afterwards = Afterwards(self._config)
        except (OSError, ValueError) as error:
            _log.warning("%s: nobody says off when this program is killed: %s", self._session.name, error)

    def set_current(self, current_A: float) -> None:
        """Program the current limit [A].  The last gate: nothing but 0 to supply.max_current passes."""
        if not 0.0 <= current_A <= self._limits.max_current:
            raise InstrumentRefused(
                f"{self._session.name}: was to be set to {current_A} A; 0 to supply.max_current, "
                f"{self._limits.max_current:g} A, is allowed"
            )
        self._tell_current(current_A)

    def switch_off(self) -> None:
        """Output off and 0 A, read back.  Raises InstrumentLost, or OutputStaysOn."""
        with self._session.within():
            self._off(self._session)

    def check_settings(self) -> None:
        """Read back every limit and the watchdog; raises LimitsNotHeld or WatchdogNotHeld, having said off."""
        for check in self._checks:
            self._do_check(check)

    def check_next_setting(self) -> None:
        """The same of one of them, in turn; and that somebody waits who says off when this program is gone, or, where
        it has patience, as a loop that goes on for ever has, asks no more."""
        self._keep_afterwards()
        if self.patience_s > 0.0:  # a self-test asks ten times, for how long that takes, and then no more
            self._promise(self.patience_s + self._instrument.timeout + STANDS_STILL_s)
        if self._checks:
            self._check_number = (self._check_number + 1) % len(self._checks)
            self._do_check(self._checks[self._check_number])

    def _do_check(self, check: Callable[[], None]) -> None:
        try:
            check()
        except InstrumentRefused:
            self._session.say_off()
            self._session.close()  # opening programs everything anew
            raise

    def shut_down(self) -> bool:
        """Output off and current to zero, through a new connection where the old one is gone or hangs; whether
        the output was read back as off, which it is not where nothing was opened: that may be somebody else's.
        Takes twice the time of an answer and a tenth of a second at the most.  Never raises."""
        if not self._ours:
            return False
        try:
            if not self._off_on_own_session():
                self._off_beside(self._instrument.timeout)
        except Exception as error:  # noqa: BLE001 - the last thing a program does must not fail
            if self._confirmed:
                _log.warning("%s: read back as off before, and does not say so again (%s)", self._session.name, error)
            else:
                _log.error("%s: told to be off, not confirmed (%s)", self._session.name, error)
            return False
        return True

    def close(self) -> None:
        """Say off, give up the connection and the lock on the instrument.  Never raises."""
        self._session.say_off()
        try:
            self._session.tell(*self._unlock_lines)
        except InstrumentError as error:
            _log.debug("%s", error)
        self._session.close()
        self._ours = False
        self._release()
        if self._afterwards is not None:
            afterwards, self._afterwards = self._afterwards, None
            if self._confirmed:
                afterwards.dismiss()
            else:
                afterwards.leave()

    def _release(self) -> None:
        if self._claim is not None:
            self._claim.release()
            self._claim = None

    def _off_on_own_session(self) -> bool:
        """Whether it could be confirmed there; one that hangs in another thread is broken."""
        if not self._session.lock.acquire(timeout=_LOCK_TIMEOUT_s):
            self._session.cut()
            return False
        # where it takes one session only, this one is in the way
        patience_s, self._session.patience_s = self._session.patience_s, 0.0
        try:
            with self._session.within():
                self._off(self._session)
        except InstrumentError as error:
            _log.debug("%s", error)
            return False
        finally:
            self._session.patience_s = patience_s
            self._session.lock.release()
        return True

    def switch_off_beside(self, timeout_s: float) -> None:
        """Output off over a session of its own, whoever drives the supply; read back.  Raises InstrumentError."""
        self._prepare_off()
        self._off_beside(timeout_s)

    def _prepare_off(self) -> None:  # noqa: B027 - a dialect knows them from the beginning
        """Know the off lines, without a word to the supply."""

    @contextlib.contextmanager
    def claimed(self) -> Iterator[None]:
        """No other program of this computer speaks to it meanwhile.  Raises InstrumentRefused where one does."""
        claim = self._session.claim("it is switched off for one that is gone")
        try:
            yield
        finally:
            claim.release()

    @property
    def driven_by(self) -> int | None:
        """The process of this computer that drives it, where there is one that we may look into."""
        return self._session.claimed_by

    def _off_beside(self, timeout_s: float) -> None:
        """A second session speaks for one that is lost, or hangs in another thread.

        Where connections do not begin empty, as serial lines, a late answer to the lost one may come to it: then
        another one.
        """
        until_s = time.monotonic() + timeout_s
        while True:
            beside = self._session.beside()
            try:
                with beside.within(max(until_s - time.monotonic(), 0.0)):
                    beside.open()
                    beside.tell(*self._unlock_lines)  # an instrument may think the lost one alive
                    self._off(beside)
                    with contextlib.suppress(InstrumentError):
                        beside.tell(*self._unlock_lines)  # nobody drives it now but a hand
                    return
            except InstrumentUnreachable:
                raise
            except InstrumentLost:
                if time.monotonic() + _OFF_PAUSE_s >= until_s:
                    raise
                time.sleep(_OFF_PAUSE_s)
            finally:
                beside.close()

    def _off(self, session: Session) -> None:
        """Output off and 0 A.  The answer proves that both were heard, and obeyed; else OutputStaysOn."""
        for _ in range(_OFF_ATTEMPTS):
            session.tell_blind(*session.off_lines)
            if not self._output_is_on(session):
                self._confirmed = True
                self._promise(0.0)
                return
            time.sleep(_OFF_PAUSE_s)
        raise OutputStaysOn(session.name)
