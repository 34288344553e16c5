"""SCPI instruments; what they understand comes from a dialect, how they are reached from ``session.py``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from math import isfinite, nan
from typing import Any

import numpy as np

from sma_actuator.base.signals import Reading, SupplyState

from . import Clock, InstrumentError, InstrumentRefused, LimitsNotHeld, OutputStaysOn, WatchdogNotHeld
from .byte_streams import Manner
from .channels import Channels
from .claim import Claim
from .dialect import Dialect
from .parameters import InstrumentSections
from .phrases import Query, asks_one, fixed
from .session import OPENING_ANSWERS, Session, is_serial
from .supply import Abilities, SessionSupply

#: Where nothing clears a queue of errors, at most so many are read away.
_ERRORS_QUEUED = 20
#: Readback of a setting may differ by the instrument's resolution.
SETTING_TOLERANCE = 0.02
_TOO_NEAR = "; it may want supply.over_voltage_trip further above supply.max_voltage: see its manual"
#: Why a supply may not have taken a limit that was just programmed, to end a sentence with.
_NOT_TAKEN = {
    "voltage_setting": _TOO_NEAR,
    "over_voltage_setting": _TOO_NEAR,
    "over_current_setting": "; that may be beneath the least trip that it has: see its manual",
}


def _identify(session: Session, dialect: Dialect, queries: Mapping[str, Query]) -> str:
    """What it says of itself; its family where that cannot be asked."""
    if "identity" not in queries:
        return f"{dialect.family} (not asked)"
    identity = session.introduce(queries["identity"].text, dialect.identity)
    if not dialect.identity.search(identity):  # so that it was waited for in vain, and the connection is given up
        wrong = f"instruments.{session.role}.resource or instruments.{dialect.kind}.dialect is wrong"
        raise InstrumentRefused(
            f"{session.name}: says it is '{identity}', which is no {dialect.family}; {wrong}, or that dialect's "
            f"identity, '{dialect.identity.pattern}'{session.may_begin_anew}"
        )
    return identity


def _forget_errors(session: Session, queries: Mapping[str, Query], lines: list[str]) -> None:
    """Empty its error queue: what somebody else did wrong before is no fault of ours."""
    session.tell(*lines)
    if not lines and (query := queries.get("error")) is not None:
        for _ in range(_ERRORS_QUEUED):
            if session.ask_for(query.text, query.code) == 0:
                break


def _no_errors(session: Session, dialect: Dialect, queries: Mapping[str, Query]) -> None:
    """Raise InstrumentRefused where the instrument's error queue holds anything."""
    if (query := queries.get("error")) is None:
        return
    told, (code, reply) = session.told, _error(session, query)
    if code != 0:
        raise InstrumentRefused(
            f"{session.name}: refused its configuration: {_to_which(session, query, told) or reply}; is the dialect "
            f"'{dialect.path.stem}' the right one?"
        )


def _error(session: Session, query: Query) -> tuple[float, str]:
    """The next of its error queue, and in its own words."""
    return session.ask_for(query.text, lambda reply: (query.code(reply), reply))


def _to_which(session: Session, query: Query, told: Sequence[str]) -> str:
    """What it says, and to which of the lines ``told``; empty where that is not to be found out.

    The output is off, so they can be told once more, one by one.
    """
    with suppress(InstrumentError):
        if any(_error(session, query)[0] == 0 for _ in range(_ERRORS_QUEUED)):
            for line in told:
                session.tell(line)
                code, reply = _error(session, query)
                if code != 0:
                    return f"{reply} to '{line}'"
    return ""


def _read_back(dialect: Dialect) -> frozenset[str]:
    told = {
        "voltage_setting": "voltage_setting" in dialect.queries,
        "over_current_trip": "set_over_current" in dialect.commands and "over_current_setting" in dialect.queries,
        "watchdog_trip": not {"*", "WDOG"}.isdisjoint(dialect.trips),
    }
    return frozenset(what for what, is_told in told.items() if is_told)


def abilities_of(dialect: Dialect, watched: bool) -> Abilities:
    """What a supply of this dialect can do for a wire that nobody looks after; ``watched``: its watchdog is to be
    used."""
    told = _read_back(dialect)
    return Abilities(
        dialect.family,
        watchdog=watched and "arm_watchdog" in dialect.commands,
        watchdog_of_session=dialect.watchdog_fed_by == "session",
        second_session=dialect.second_session,
        voltage_setting="voltage_setting" in told,
        over_voltage_trip="set_over_voltage" in dialect.commands and "over_voltage_setting" in dialect.queries,
        over_current_trip="over_current_trip" in told,
    )


class ScpiSupply(SessionSupply):
    """A current-controlled supply; see :class:`sma_actuator.instruments.PowerSupply`."""

    def __init__(self, config: InstrumentSections):
        self._dialect = dialect = Dialect.load(config.instruments.supply.dialect, "supply")
        instrument = config.instruments.supply
        channel = instrument.channel
        self._queries, self._trips = dialect.asked(channel=channel)
        self._told_A = 0.0  #: the current that it was told last
        self._cut_off_A = 0.0  #: of that, what the digits of its dialect left out
        manner = Manner.of(instrument, *dialect.manner, fixed=fixed([*self._queries.values(), *self._trips.values()]))
        serial = is_serial(instrument.resource)
        super().__init__(config, manner, dialect.off_lines(channel, serial), dialect.unlock_lines(channel, serial))

    @property
    def session(self) -> Session:
        """For a DAQ that is the same instrument."""
        return self._session

    @property
    def reads_back(self) -> frozenset[str]:
        """What not every supply tells."""
        return _read_back(self._dialect)

    def _tell_current(self, current_A: float) -> None:
        value = max(current_A, self._dialect.zero_current_A)
        written_A = self._dialect.commands["set_current"].at_most(value)
        self._tell("set_current", written_A)
        self._told_A, self._cut_off_A = current_A, value - written_A

    def _tell_output(self, on: bool) -> None:
        self._tell("output_on" if on else "output_off")

    def read_back(self) -> SupplyState:
        """Settings and measurements, as the instrument gives them; ``time_s`` is left NaN where they came in time.

        What it cannot be asked is what follows: the current that it was told; nothing, behind an output that is off.
        """
        queries = self._queries
        measured = {name: (queries[name].text, queries[name].number) for name in ("voltage", "current")}
        asked: dict[str, tuple[str, Callable[[str], Any]]] = {}
        if setting := queries.get("current_setting"):
            asked["setting"] = (setting.text, setting.number)
        asked["output"] = (queries["output"].text, queries["output"].truth)
        if self._dialect.measures_while_off:
            asked |= measured
        asked |= {word: (query.text, partial(self._trip, word, query)) for word, query in self._trips.items()}
        with self._session.within():
            nothing = {"setting": self._told_A - self._cut_off_A, "voltage": 0.0, "current": 0.0}
            values = nothing | self._ask_all(asked)
            if values["output"] and not self._dialect.measures_while_off:
                values |= self._ask_all(measured)
            late_s = self._session.late_since_s
        tripped = ",".join(filter(None, (values[word] for word in self._trips)))
        flows = values["voltage"], values["current"]
        return SupplyState(
            late_s if isfinite(late_s) else nan, values["setting"], values["output"], *flows, tripped, self._cut_off_A
        )

    def _watchdog_holds(self) -> None:
        """Raise WatchdogNotHeld where the watchdog does not stand as it was armed."""
        dialect, session, wanted_s = self._dialect, self._session, self._limits.watchdog_timeout
        truths = [self._queries[name] for name in ("watchdog_armed", "watchdog_tied") if name in self._queries]
        delay = self._queries["watchdog_delay"]
        armed = [session.ask_for(query.text, query.truth) for query in truths]
        delay_s = session.ask_for(delay.text, delay.number)
        # A delay of zero is no watchdog at all in many families.
        holds = all(armed) and 0.0 < delay_s <= wanted_s + dialect.watchdog_step_s + 1e-3
        if not holds:
            raise WatchdogNotHeld(
                f"{self._session.name}: its watchdog was armed with {wanted_s:g} s and does not read back so: a killed "
                "computer would leave the current on (supply.watchdog_timeout: 0 with supply.allow_no_watchdog: true "
                "does without it)"
            )

    def clear_trip(self) -> None:
        """Clear a tripped protection; the output stays off."""
        self._tell("output_off")
        self._tell("clear_trips")
        self._program_anew()

    def switch_off(self) -> None:
        """Output off and 0 A, read back.  Raises InstrumentLost, or OutputStaysOn."""
        super().switch_off()
        self._program_anew()

    def _output_is_on(self, session: Session) -> bool:
        query = self._queries["output"]
        return session.ask_for(query.text, query.truth)

    def _off(self, session: Session) -> None:
        super()._off(session)
        self._told_A = self._cut_off_A = 0.0

    def _configure(self) -> None:
        session, limits, dialect = self._session, self._limits, self._dialect
        if limits.bias_current < dialect.zero_current_A:
            raise InstrumentRefused(
                f"supply.bias_current: {limits.bias_current:g} A; {dialect.family} takes no less than "
                f"{dialect.zero_current_A:g} A"
            )
        self.identity = _identify(session, dialect, self._queries)
        _forget_errors(session, self._queries, dialect.lines("clear_status", channel=self._channel))
        self._tell("prepare")
        if self._instrument.exclusive_lock:
            self._tell("lock")
        self._tell("output_off")
        self._tell("clear_trips")
        self._tell("set_current", dialect.zero_current_A)
        self._program_limits()
        self._arm_watchdog()
        _no_errors(session, dialect, self._queries)
        if self._output_is_on(session):
            raise OutputStaysOn(session.name)
        trip_V, trip_A = limits.over_voltage_V, limits.over_current_trip
        wanted = (
            ("voltage_setting", "", limits.max_voltage, f"supply.max_voltage, {limits.max_voltage:g} V"),
            ("over_voltage_setting", "over_voltage_on", trip_V, f"supply.over_voltage_trip, {trip_V:g} V"),
            ("over_current_setting", "over_current_on", trip_A, f"supply.over_current_trip, {trip_A:g} A"),
        )
        self._checks = [partial(self._holds, *limit) for limit in wanted if limit[0] in self._queries]
        if self._has_watchdog:
            self._checks.append(self._watchdog_holds)
        self.check_settings()

    def _program_limits(self) -> None:
        if "set_over_voltage" in self._dialect.commands:
            # Many refuse a voltage above the trip that was left, or a trip below the voltage; from 0 V on neither is.
            self._tell("set_voltage", 0.0)
            self._tell("set_over_voltage", self._limits.over_voltage_V)
        self._tell("set_over_current", self._limits.over_current_trip)
        self._tell("set_voltage", self._limits.max_voltage)

    def _program_anew(self) -> None:
        """What switching off has changed."""
        if self._dialect.off_resets:
            with self._session.within():
                self._program_limits()

    def _tell(self, name: str, value: float = nan) -> None:
        self._session.tell(*self._dialect.lines(name, channel=self._channel, value=value))

    def _ask_all(self, asked: Mapping[str, tuple[str, Callable[[str], Any]]]) -> dict[str, Any]:
        """Name → value, from name → (text of the query, what reads its answer).  A text is asked once."""
        texts = list(dict.fromkeys(text for text, _ in asked.values()))

        def values(replies: Mapping[str, str]) -> dict[str, Any]:
            return {name: read(replies[text]) for name, (text, read) in asked.items() if text in replies}

        def of_one(text: str, reply: str) -> dict[str, Any]:
            return values({text: reply})

        if self._dialect.chained_queries:
            return self._session.ask_for(
                ";".join(texts), lambda reply: values(dict(zip(texts, reply.split(";"), strict=True))), late_counts=True
            )
        found: dict[str, Any] = {}
        for text in texts:
            found |= self._session.ask_for(text, partial(of_one, text), late_counts=True)
        return found

    @staticmethod
    def _trip(word: str, query: Query, reply: str) -> str:
        if word != "*":
            return word if query.truth(reply) else ""
        words = query.value(reply)
        if not words:  # an answer that is missing says of no protection that it has not tripped
            raise ValueError("nothing is no answer to which protection has tripped")
        words = words.strip('"')
        return "" if words.upper() in ("NONE", "0", "") else words

    @property
    def _has_watchdog(self) -> bool:
        return self._limits.watchdog_timeout > 0.0 and "arm_watchdog" in self._dialect.commands

    def _arm_watchdog(self) -> None:
        wanted_s, dialect = self._limits.watchdog_timeout, self._dialect
        self._acknowledged(abilities_of(dialect, self._has_watchdog))
        if not self._has_watchdog:
            self._tell("disarm_watchdog")
            return
        span_s = dialect.watchdog_range_s
        if span_s is not None and not span_s[0] <= wanted_s <= span_s[1]:
            raise InstrumentRefused(
                f"supply.watchdog_timeout: {wanted_s:g} s; {dialect.family} can do {span_s[0]:g} to {span_s[1]:g} s"
            )
        self._tell("arm_watchdog", wanted_s)

    def _holds(self, query: str, switch: str, wanted: float, what: str) -> None:
        """Ask for a setting, and whether it is switched on where that can be asked; raise LimitsNotHeld where it does
        not hold."""
        asked = self._queries[query]
        found, reply = self._session.ask_for(asked.text, lambda reply: (asked.number(reply), reply))
        if not abs(found - wanted) <= SETTING_TOLERANCE * wanted:
            advice = "" if self._ours else _NOT_TAKEN[query]  # later somebody else may have changed it
            raise LimitsNotHeld(f"{self._session.name}: does not hold {what}: it reads back {reply}{advice}")
        if (state := self._queries.get(switch)) is not None and not self._session.ask_for(state.text, state.truth):
            raise LimitsNotHeld(f"{self._session.name}: does not hold {what}: that protection is switched off")


class ScpiDaq:
    """A scanning data acquisition unit; see :class:`sma_actuator.instruments.Daq`.

    One that is the supply as well is asked over the supply's ``session``, which the supply opens and closes.
    """

    def __init__(self, config: InstrumentSections, clock: Clock, session: Session | None = None):
        self._instrument = daq = config.instruments.daq
        self._clock = clock
        self._dialect = dialect = Dialect.load(daq.dialect, "daq")
        manner = Manner.of(daq, *dialect.manner)
        self._is_supply = session is not None
        if session is not None:
            session.must_fit(manner)
        self._session = session or Session("daq", daq.resource, manner, daq.timeout)
        self._channels = Channels(daq)
        numbers, samples = self._channels.numbers, config.loop.samples_per_block
        self._values: dict[str, Any] = {
            "channels": ",".join(map(str, numbers)),
            "channel": numbers[0],
            "samples": samples,
            "readings": samples * len(numbers),
        }
        self._queries, _ = dialect.asked(**self._values)
        read = dialect.queries["read"]
        self._reads = [(self._queries["read"], numbers)]  #: what is asked for a block, and which channels answer
        if asks_one(read.text):
            self._reads = [(read.filled({**self._values, "channel": number}), [number]) for number in numbers]
        self._claim: Claim | None = None
        self.identity = ""

    @property
    def patience_s(self) -> float:
        """So long after its question an answer may still come."""
        return self._session.patience_s

    @patience_s.setter
    def patience_s(self, patience_s: float) -> None:
        self._session.patience_s = patience_s

    def open(self) -> None:
        """Connect, check who answers, program channel list and block.  Raises InstrumentLost or InstrumentRefused."""
        self._channels.check(f"dialect '{self._dialect.path.stem}'", self._dialect.measures_celsius)
        columns, last = self._queries["read"].columns, self._channels.numbers[-1]
        if columns and last > columns:
            raise InstrumentRefused(
                f"instruments.daq: channel {last} is wanted; an answer of {self._dialect.family} has {columns} columns"
            )
        if self._claim is None and not self._is_supply:
            self._claim = self._session.claim(
                "its list of channels is one for all who ask: each would read the other's"
            )
        pause_s = 0.0 if self._is_supply else self._instrument.opening_pause
        with self._session.within(pause_s + OPENING_ANSWERS * self._instrument.timeout, line_by_line=True):
            if not self._is_supply:
                self._session.open()
                self._session.let_begin(pause_s)
                self._tell_on_a_serial_line("remote")
            self.identity = _identify(self._session, self._dialect, self._queries)
            _forget_errors(self._session, self._queries, self._dialect.lines("clear_status"))
            self._session.tell(*self._lines("prepare"))
            _no_errors(self._session, self._dialect, self._queries)
            if "ready" in self._queries:
                self._session.ask(self._queries["ready"].text)

    def read_block(self) -> Reading:
        """The mean of the newest block; NaN for channels that are not configured.  One that came late is of when it was
        asked for."""
        values: list[float] = []
        with self._session.within():
            self._session.tell(*self._lines("before_read"))
            for query, channels in self._reads:
                values += self._session.ask_for(query.text, partial(self._means, query, channels), late_counts=True)
            time_s = min(self._clock.now_s(), self._session.late_since_s)
        return self._channels.reading(time_s, values)

    def _tell_on_a_serial_line(self, name: str) -> None:
        if is_serial(self._session.resource):
            self._session.tell_blind(*self._dialect.lines(name))

    def _lines(self, name: str) -> list[str]:
        return self._dialect.lines_of_each(name, self._channels.numbers, **self._values)

    def _means(self, query: Query, channels: Sequence[int], reply: str) -> list[float]:
        """The mean of each channel; raises ValueError for what is neither one mean nor all readings of every
        channel."""
        numbers, wanted = query.numbers(reply, channels), len(channels)
        if len(numbers) == wanted:
            return numbers
        if not query.columns and len(numbers) != self._values["samples"] * wanted:
            raise ValueError
        return np.array(numbers).reshape(-1, wanted).mean(axis=0).tolist()

    def close(self) -> None:
        """Give up the connection, and let others speak to it.  Never raises."""
        if not self._is_supply:
            with suppress(InstrumentError):
                self._tell_on_a_serial_line("local")
            self._session.close()
        if self._claim is not None:
            self._claim.release()
            self._claim = None
