"""SCPI instruments over pyvisa; what they understand comes from a dialect.

A session that has timed out or broken is closed at once and never used again: a late reply would
otherwise be taken for the answer to the next question, and pyvisa-py does not recover a broken
connection.  ``open`` makes a new one.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
import time
from collections.abc import Sequence
from decimal import Decimal
from math import inf, isfinite, nan
from typing import TYPE_CHECKING

import numpy as np
import pyvisa

from sma_actuator.base.signals import Reading, SupplyState

from . import Clock, InstrumentError, InstrumentLost, InstrumentRefused
from .dialect import Dialect, yes

if TYPE_CHECKING:
    from sma_actuator.config import Config

_log = logging.getLogger(__name__)

#: The over-voltage trip sits this much above the compliance voltage, so that noise does not trip it.
OVER_VOLTAGE_MARGIN = 1.1
#: Readback of a setting may differ by the instrument's resolution.
SETTING_TOLERANCE = 0.02
#: How long ``shut_down`` waits for a query in another thread to end.
_LOCK_TIMEOUT_s = 0.4
#: ``shut_down`` repeats itself: the lock of a lost connection may take a moment to go.
_OFF_ATTEMPTS, _OFF_PAUSE_s = 5, 0.02
_OPEN_TIMEOUT_ms = 2000


class Session:
    """One connection: texts out, texts in, every failure an InstrumentError that says who and what."""

    def __init__(self, role: str, resource: str, termination: str, timeout_s: float):
        self.role = role
        self.resource = resource
        self.lock = threading.RLock()
        self._termination = termination
        self._timeout_s = timeout_s
        self._visa: pyvisa.resources.MessageBasedResource | None = None

    @property
    def name(self) -> str:
        """Role and resource, as messages have it."""
        return f"{self.role} at {self.resource}"

    def open(self, lock: bool) -> None:
        """Connect; with ``lock``, under VISA's exclusive lock where the resource class has one.

        Raises InstrumentLost, or InstrumentRefused where somebody else holds that lock.
        """
        self.close()
        if not self.resource:
            raise InstrumentRefused(
                f"instruments.{self.role}.resource: is empty; a VISA resource is wanted, as TCPIP::192.168.0.5::5025::SOCKET"
            )
        try:
            visa = pyvisa.ResourceManager("@py").open_resource(
                self.resource,
                read_termination=self._termination,
                write_termination=self._termination,
                open_timeout=_OPEN_TIMEOUT_ms,
            )
            visa.timeout = self._timeout_s * 1e3
            _send_at_once(visa)
        except Exception as error:  # pyvisa-py raises a bare Exception for a host that has no address
            raise InstrumentLost(
                f"{self.name}: cannot be opened ({error}); is it switched on, and is the address right?"
            ) from error
        self._visa = visa
        if lock:
            try:
                visa.lock_excl(timeout=0)
            except (pyvisa.Error, NotImplementedError, AttributeError) as error:
                if getattr(error, "error_code", None) == pyvisa.constants.StatusCode.error_resource_locked:
                    self.close()
                    raise InstrumentRefused(
                        f"{self.name}: somebody else holds its VISA lock; only one program may command it "
                        f"(instruments.{self.role}.exclusive_lock: false does without the lock)"
                    ) from error
                _log.debug("%s: this VISA resource has no exclusive lock", self.name)

    def tell(self, *lines: str) -> None:
        """Send lines that have no answer."""
        with self.lock:
            for line in lines:
                self._do(line, lambda visa, line=line: visa.write(line))

    def ask(self, line: str) -> str:
        """Send a query; its answer."""
        with self.lock:
            return self._do(line, lambda visa: visa.query(line)).strip()

    def _do(self, line: str, action):
        if self._visa is None:
            raise InstrumentLost(f"{self.name}: not connected")
        try:
            return action(self._visa)
        except pyvisa.VisaIOError as error:
            self.close()
            late = error.error_code == pyvisa.constants.StatusCode.error_timeout
            why = f"no answer to '{line}' within {self._timeout_s:g} s" if late else f"'{line}' failed ({error})"
            raise InstrumentLost(f"{self.name}: {why}") from error
        except ConnectionRefusedError as error:
            self.close()
            raise InstrumentLost(
                f"{self.name}: nothing listens there; is it switched on, and is instruments.{self.role}.resource right?"
            ) from error
        except (pyvisa.Error, OSError, ValueError) as error:
            self.close()
            raise InstrumentLost(f"{self.name}: the connection broke at '{line}' ({error})") from error

    def cut(self) -> None:
        """Break the connection under a query that hangs in another thread; that query then fails.

        The instrument's exclusive lock goes with the connection, so that another one can be heard.
        """
        wire = _socket_of(self._visa)
        if wire is not None:
            with contextlib.suppress(OSError):
                wire.shutdown(socket.SHUT_RDWR)

    def garbled(self, line: str, reply: str) -> InstrumentLost:
        """The error for an answer that is none; the session is given up, since its order is lost."""
        self.close()
        return InstrumentLost(f"{self.name}: answered '{reply}' to '{line}', which is not an answer to that")

    def close(self) -> None:
        """Give up the connection.  Never raises."""
        visa, self._visa = self._visa, None
        if visa is not None:
            try:
                visa.close()
            except Exception as error:  # noqa: BLE001 - nothing depends on a connection that is given up
                _log.debug("%s: closing: %s", self.name, error)


def _socket_of(visa: pyvisa.resources.Resource | None) -> socket.socket | None:
    """The socket beneath a session of pyvisa-py, where there is one."""
    if visa is None:
        return None
    try:
        interface = getattr(getattr(visa.visalib, "sessions", {}).get(visa.session), "interface", None)
    except pyvisa.errors.InvalidSession:  # closed by another thread
        return None
    return interface if isinstance(interface, socket.socket) else None


def _send_at_once(visa: pyvisa.resources.Resource) -> None:
    """Switch Nagle's algorithm off: else a query after a command waits some 40 ms for the other side's
    delayed acknowledgement.  pyvisa-py has the attribute VI_ATTR_TCPIP_NODELAY but cannot set it."""
    wire = _socket_of(visa)
    if wire is not None:
        wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def _identify(session: Session, dialect: Dialect) -> str:
    identity = session.ask("*IDN?")
    if not dialect.identity.search(identity):
        session.close()
        raise InstrumentRefused(
            f"{session.name}: says it is '{identity}', which is no {dialect.family}; "
            f"instruments.{session.role}.resource or instruments.{session.role}.dialect is wrong"
        )
    session.tell("*CLS")
    return identity


def _no_errors(session: Session, dialect: Dialect) -> None:
    """Raise InstrumentRefused where the instrument's error queue holds anything."""
    if "error" not in dialect.queries:
        return
    reply = session.ask(dialect.query("error", channel=""))
    code = reply.split(",")[0].strip()
    try:
        number = int(code)
    except ValueError:
        raise session.garbled(dialect.queries["error"], reply) from None
    if number != 0:
        raise InstrumentRefused(
            f"{session.name}: refused its configuration: {reply}; is the dialect '{dialect.path.stem}' the right one?"
        )


class _RoundedDown(float):
    """A number that is never written as more than it is: the last digit must not lift a current over its limit."""

    def __format__(self, spec: str) -> str:
        text = float.__format__(self, spec)
        if float(text) <= self:
            return text
        number = Decimal(text)
        return float.__format__(float(number - Decimal(1).scaleb(number.as_tuple().exponent)), spec)


class ScpiSupply:
    """A current-controlled supply; see :class:`sma_actuator.instruments.PowerSupply`."""

    def __init__(self, config: Config):
        self._limits = config.supply
        self._instrument = config.instruments.supply
        self._dialect = Dialect.load(self._instrument.dialect, "supply")
        self._channel = self._instrument.channel
        self._session = Session(
            "supply", self._instrument.resource, self._dialect.termination, self._instrument.timeout
        )
        self.identity = ""

    def open(self) -> None:
        """Connect, output off, limits, protections and watchdog programmed and read back.

        Raises InstrumentLost or InstrumentRefused; no current flows afterwards in either case.
        """
        with self._session.lock:
            self._session.open(self._instrument.exclusive_lock)
            try:
                self._configure()
            except InstrumentError:
                self._session.close()  # nobody shall switch on what was refused
                raise

    def set_current(self, current_A: float) -> None:
        """Program the current limit [A].  The last gate: nothing but 0 to supply.max_current passes."""
        if not 0.0 <= current_A <= self._limits.max_current:
            raise InstrumentRefused(
                f"{self._session.name}: was to be set to {current_A} A; 0 to supply.max_current, {self._limits.max_current:g} A, is allowed"
            )
        self._tell("set_current", _RoundedDown(current_A))

    def set_output(self, on: bool) -> None:
        """Switch the output."""
        self._tell("output_on" if on else "output_off")

    def read_back(self) -> SupplyState:
        """Settings and measurements, as the instrument gives them; ``time_s`` is left NaN."""
        names = ["current_setting", "output", "voltage", "current"]
        lines = [self._dialect.query(name, channel=self._channel) for name in names]
        lines += [query.format(channel=self._channel) for query in self._dialect.trips.values()]
        replies = self._ask_all(lines)
        try:
            setting_A, voltage_V, current_A = (float(replies[i]) for i in (0, 2, 3))
            output_on = yes(replies[1])
            tripped = [self._trip(word, reply) for word, reply in zip(self._dialect.trips, replies[4:])]
        except ValueError:
            raise self._session.garbled("; ".join(lines), "; ".join(replies)) from None
        return SupplyState(nan, setting_A, output_on, voltage_V, current_A, ",".join(filter(None, tripped)))

    def watchdog_holds(self) -> bool:
        """Ask the watchdog for its state and delay; see :class:`sma_actuator.instruments.PowerSupply`."""
        dialect, wanted_s = self._dialect, self._limits.watchdog_timeout
        if self._limits.allow_no_watchdog or wanted_s == 0.0:
            return True
        if "arm_watchdog" not in dialect.commands:
            return False
        armed, delay = (
            self._session.ask(dialect.query(name, channel=self._channel))
            for name in ("watchdog_armed", "watchdog_delay")
        )
        try:
            return yes(armed) and float(delay) <= wanted_s + dialect.watchdog_step_s + 1e-3
        except ValueError:
            raise self._session.garbled(dialect.queries["watchdog_delay"], f"{armed}; {delay}") from None

    def clear_trip(self) -> None:
        """Clear a tripped protection; the output stays off."""
        self._tell("output_off")
        self._tell("clear_trips")

    def shut_down(self) -> None:
        """Current to zero and output off, through a new connection where the old one is gone.  Never raises."""
        held = self._session.lock.acquire(timeout=_LOCK_TIMEOUT_s)
        try:
            if held:
                try:
                    self._off(self._session)
                    return
                except InstrumentError:
                    self._session.close()
            else:
                self._session.cut()
            # The session is lost, or hung in another thread: a second one speaks for it.
            beside = Session("supply", self._session.resource, self._dialect.termination, self._instrument.timeout)
            try:
                beside.open(lock=False)
                beside.tell(
                    *self._dialect.lines("unlock", channel=self._channel)
                )  # an instrument may think the lost one alive
                self._off(beside)
            finally:
                beside.close()
        except Exception as error:  # noqa: BLE001 - the last thing a program does must not fail
            _log.error("%s: could not be told to switch off (%s); its watchdog has to", self._session.name, error)
        finally:
            if held:
                self._session.lock.release()

    def close(self) -> None:
        """Give up the connection, and the lock on the instrument.  Never raises."""
        try:
            self._tell("unlock")
        except InstrumentError:
            pass
        self._session.close()

    def _off(self, session: Session) -> None:
        """Output off and 0 A.  The answer proves that both were heard, and obeyed; else InstrumentRefused."""
        query = self._dialect.query("output", channel=self._channel)
        for _ in range(_OFF_ATTEMPTS):
            session.tell(*self._dialect.lines("output_off", channel=self._channel))
            session.tell(*self._dialect.lines("set_current", channel=self._channel, value=0.0))
            reply = session.ask(query)
            try:
                if not yes(reply):
                    return
            except ValueError:
                raise session.garbled(query, reply) from None
            time.sleep(_OFF_PAUSE_s)
        raise InstrumentRefused(f"{session.name}: was told to switch off and answers that its output is on")

    def _configure(self) -> None:
        session, limits = self._session, self._limits
        self.identity = _identify(session, self._dialect)
        self._tell("prepare")
        if self._instrument.exclusive_lock:
            self._tell("lock")
        self._tell("output_off")
        self._tell("clear_trips")
        self._tell("set_current", 0.0)
        self._tell("set_voltage", limits.max_voltage)
        over_voltage_V = OVER_VOLTAGE_MARGIN * limits.max_voltage
        self._tell("set_over_voltage", over_voltage_V)
        self._tell("set_over_current", limits.over_current_trip)
        self._arm_watchdog()
        _no_errors(session, self._dialect)
        self._holds("output", 0.0, "output off")
        self._holds("voltage_setting", limits.max_voltage, f"supply.max_voltage, {limits.max_voltage:g} V")
        self._holds("over_voltage_setting", over_voltage_V, f"an over-voltage trip of {over_voltage_V:g} V")
        self._holds(
            "over_current_setting",
            limits.over_current_trip,
            f"supply.over_current_trip, {limits.over_current_trip:g} A",
        )

    def _tell(self, name: str, value: float = nan) -> None:
        self._session.tell(*self._dialect.lines(name, channel=self._channel, value=value))

    def _ask_all(self, lines: Sequence[str]) -> list[str]:
        if not self._dialect.chained_queries:
            return [self._session.ask(line) for line in lines]
        line = ";".join(lines)
        reply = self._session.ask(line)
        parts = reply.split(";")
        if len(parts) != len(lines):
            raise self._session.garbled(line, reply)
        return parts

    def _trip(self, word: str, reply: str) -> str:
        if word == "*":
            return "" if reply.strip().strip('"').upper() in ("NONE", "0", "") else reply.strip().strip('"')
        return word if yes(reply) else ""

    def _arm_watchdog(self) -> None:
        wanted_s, dialect = self._limits.watchdog_timeout, self._dialect
        if "arm_watchdog" not in dialect.commands:
            if wanted_s > 0.0 and not self._limits.allow_no_watchdog:
                raise InstrumentRefused(
                    f"{self._session.name}: {dialect.family} has no communication watchdog, so a killed computer leaves the current on; "
                    "set supply.allow_no_watchdog: true to drive it all the same"
                )
            return
        if wanted_s == 0.0:
            self._tell("disarm_watchdog")
            return
        lo_s, hi_s = dialect.watchdog_range_s
        if not lo_s <= wanted_s <= hi_s:
            raise InstrumentRefused(
                f"supply.watchdog_timeout: {wanted_s:g} s; {dialect.family} can do {lo_s:g} to {hi_s:g} s"
            )
        self._tell("arm_watchdog", wanted_s)
        if not self.watchdog_holds():
            raise InstrumentRefused(
                f"{self._session.name}: its watchdog was armed with {wanted_s:g} s and does not read back so: "
                "a killed computer would leave the current on (supply.allow_no_watchdog accepts that)"
            )

    def _holds(self, query: str, wanted: float, what: str) -> None:
        """Ask for a setting, where the dialect can; raise InstrumentRefused where it is not as wanted."""
        if query not in self._dialect.queries:
            return
        line = self._dialect.query(query, channel=self._channel)
        reply = self._session.ask(line)
        try:
            found = float(yes(reply)) if query == "output" else float(reply)
        except ValueError:
            raise self._session.garbled(line, reply) from None
        if not abs(found - wanted) <= SETTING_TOLERANCE * abs(wanted) + 1e-6:
            raise InstrumentRefused(f"{self._session.name}: does not take {what}: it reads back {reply}")


class ScpiDaq:
    """A scanning data acquisition unit; see :class:`sma_actuator.instruments.Daq`."""

    def __init__(self, config: Config, clock: Clock):
        self._instrument = daq = config.instruments.daq
        self._clock = clock
        self._dialect = Dialect.load(daq.dialect, "daq")
        self._session = Session("daq", daq.resource, self._dialect.termination, daq.timeout)
        channels = {
            "supply_voltage_V": daq.supply_voltage_channel,
            "reference_voltage_V": daq.reference_voltage_channel,
            "load_cell_voltage_V": daq.load_cell_channel,
            "lvdt_current_A": daq.lvdt_channel,
            "ambient_temperature_C": daq.ambient_temperature_channel,
        }
        # Instruments scan in ascending order, whatever order they are told.
        self._channels = dict(sorted(((n, c) for n, c in channels.items() if c), key=lambda item: item[1]))
        samples = config.loop.samples_per_block
        self._values = {
            "channels": ",".join(str(channel) for channel in self._channels.values()),
            "samples": samples,
            "readings": samples * len(self._channels),
        }
        self.identity = ""

    def open(self) -> None:
        """Connect, check who answers, program channel list and block.  Raises InstrumentLost or InstrumentRefused."""
        for quantity in ("supply_voltage", "reference_voltage", "load_cell"):
            if getattr(self._instrument, f"{quantity}_channel") == 0:
                raise InstrumentRefused(
                    f"instruments.daq.{quantity}_channel: is 0; the driver cannot do without that channel"
                )
        if len(set(self._channels.values())) < len(self._channels):
            raise InstrumentRefused(
                "instruments.daq: two quantities are read from one channel; every channel is wanted once"
            )
        ambient_channel = self._instrument.ambient_temperature_channel
        if ambient_channel != 0 and not self._dialect.measures_celsius:
            # 0.02 V would pass for a room of 0.02 °C, and the heat balance would take the wire for colder than it is.
            raise InstrumentRefused(
                f"instruments.daq.ambient_temperature_channel: is {ambient_channel}, but dialect '{self._dialect.path.stem}' "
                "reads every channel in volts; 0 is wanted, and the room's temperature in thermal.ambient_temperature"
            )
        with self._session.lock:
            self._session.open(lock=False)
            self.identity = _identify(self._session, self._dialect)
            self._session.tell(*self._dialect.lines("prepare", **self._values))
            _no_errors(self._session, self._dialect)
            if "ready" in self._dialect.queries:
                self._session.ask(self._dialect.query("ready", **self._values))

    def read_block(self) -> Reading:
        """The mean of the newest block; NaN for channels that are not configured."""
        self._session.tell(*self._dialect.lines("before_read", **self._values))
        line = self._dialect.query("read", **self._values)
        reply = self._session.ask(line)
        try:
            numbers = np.array([_number(text) for text in reply.split(",")])
            if len(numbers) not in (len(self._channels), self._values["readings"]):
                raise ValueError("neither one mean nor all readings of every channel")
            values = numbers.reshape(-1, len(self._channels)).mean(axis=0)
        except ValueError:
            raise self._session.garbled(line, reply) from None
        reading = dict(zip(self._channels, values.tolist()))
        shunt_Ohm = self._instrument.lvdt_shunt_resistance
        return Reading(
            time_s=self._clock.now_s(),
            supply_voltage_V=reading["supply_voltage_V"],
            reference_voltage_V=reading["reference_voltage_V"],
            load_cell_voltage_V=reading["load_cell_voltage_V"],
            lvdt_current_A=reading.get("lvdt_current_A", nan) / shunt_Ohm,
            ambient_temperature_C=reading.get("ambient_temperature_C", nan),
        )

    def close(self) -> None:
        """Give up the connection.  Never raises."""
        self._session.close()


def _number(text: str) -> float:
    """A SCPI number; 9.91e37 is its NaN, ±9.9e37 its infinity (SCPI-99, 7.2.1.4, 7.2.1.5)."""
    value = float(text)
    if isfinite(value) and abs(value) >= 9.9e37:
        return nan if abs(value) > 9.905e37 else float(np.copysign(inf, value))
    return value
