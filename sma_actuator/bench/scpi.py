"""The SCPI of the two virtual instruments: what they understand and how they answer.

A line ends with ``\\n``; commands are chained with ``;`` and their answers come joined by ``;`` on
one line.  Long and short forms, upper and lower case are accepted; a header after ``;`` that does
not begin with ``:`` or ``*`` is first taken below the path of the one before it, as SCPI has it,
and then from the root.  Numbers may carry a unit (``0.4A``, ``400mA``); ``MIN``, ``MAX`` and ``DEF`` stand for
numbers wherever a range is given.  What cannot be obeyed goes to the error queue (20 deep) and
gives no answer.  Optional parts are in brackets.

Both instruments
    ======================================== ================================================================
    ``*IDN?``                                ``SMA Actuator,Virtual Supply,<serial>,<version>``
                                             or ``SMA Actuator,Virtual DAQ,<serial>,<version>``
    ``*RST``                                 settings as at power-on (supply: output off, 0 A)
    ``*CLS``                                 empties the error queue and the event register
    ``*OPC`` ``*OPC?`` ``*WAI``              operations are complete at once: ``1``
    ``*ESR?`` ``*STB?`` ``*ESE n`` ``*ESE?`` IEEE 488.2 status
    ``*TST?``                                ``0``
    ``SYSTem:ERRor[:NEXT]?``                 oldest error, ``-113,"Undefined header"``; else ``0,"No error"``
    ``SYSTem:VERSion?``                      ``1999.0``
    ======================================== ================================================================

Supply (one output, 0–1 A, 0–20 V)
    ======================================================== ==============================================================
    ``[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude] <A>`` current setting; ``?`` reads it back
    ``[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude] <V>`` compliance voltage; ``?``
    ``[SOURce:]CURRent:PROTection[:LEVel] <A>``              over-current trip, 0.01–1.2 A; ``?``
    ``[SOURce:]CURRent:PROTection:STATe <bool>``             ``?`` ``1``/``0`` (power-on: on)
    ``[SOURce:]CURRent:PROTection:TRIPped?``                 ``1`` when it has tripped
    ``[SOURce:]VOLTage:PROTection[:LEVel] <V>``              over-voltage trip, 0.1–22 V; ``?``
    ``[SOURce:]VOLTage:PROTection:STATe <bool>``             ``?`` (power-on: on)
    ``[SOURce:]VOLTage:PROTection:TRIPped?``
    ``OUTPut[:STATe] <bool>``                                output; ``?`` ``1``/``0``.  Refused with
                                                             ``-221,"Settings conflict"`` while a trip is latched
    ``OUTPut:PROTection:TRIPped?``                           ``NONE``, or of ``OVP,OCP,OTP,WDOG``, comma-joined
    ``OUTPut:PROTection:CLEar``                              clears latched trips; the output stays off
    ``OUTPut:PROTection:WDOG[:STATe] <bool>``                communication watchdog; ``?``.  It counts from the last
                                                             command received on any connection; then it latches
                                                             WDOG and cuts the output
    ``OUTPut:PROTection:WDOG:DELay <s>``                     0.05–3600 s; ``?``
    ``OUTPut:PROTection:WDOG:SESSion <bool>``                on: it counts from the last command of the connection
                                                             that switched this, or the watchdog, on; ``?`` (power-on: off)
    ``MEASure[:SCALar]:VOLTage[:DC]?``                       at the output terminals [V]
    ``MEASure[:SCALar]:CURRent[:DC]?``                       [A]
    ``MEASure[:SCALar]:POWer[:DC]?``                         [W]
    ``STATus:OPERation:CONDition?``                          bit 8 (256) constant voltage, bit 10 (1024) constant current
    ``STATus:QUEStionable:CONDition?``                       bit 0 OVP, 1 OCP, 4 OTP, 11 WDOG
    ``SYSTem:REMote`` ``SYSTem:LOCal``                       remote, or front panel as well
    ``SYSTem:RWLock``                                        exclusive: settings from any other connection are refused with
                                                             ``-203,"Command protected"`` until ``SYST:LOC`` or the owner's
                                                             connection closes
    ``SYSTem:LOCK:OWNer?``                                   ``NONE``, ``SELF`` or ``OTHER``
    ======================================================== ==============================================================

DAQ (1 kHz simultaneous sampling, 16 bit, ±10 V)
    ================================= ======================================================================
    ``ROUTe:SCAN (@101,102,103:105)`` channel list; ``?``.  101 net voltage, 102 sense resistor,
                                      103 load cell, 104 LVDT shunt, 105 ambient [°C]
    ``SAMPle:COUNt <1..5000>``        samples per block; ``?``
    ``SAMPle:RATE?``                  ``1000``
    ``FORMat:READing:TIME <bool>``    first field of every row is the time stamp [s] on the
                                      DAQ's clock, at the end of the block (or sample); ``?`` (power-on: on)
    ``FETCh:AVERage?``                mean of the newest block: ``time,v1,v2,…`` in scan order.
                                      ``-230,"Data corrupt or stale"`` while fewer samples exist than asked
    ``FETCh[:RAW]?``                  the newest block, sample after sample: ``t1,v11,v12,…,t2,v21,…``
    ``READ:AVERage?`` ``READ[:RAW]?`` the same of a block that begins now (answers when it is full)
    ``SYSTem:TIME:ELAPsed?``          the DAQ's clock [s]
    ================================= ======================================================================

    A saturated channel reads ``9.90000000E+37``, a failed one ``NAN``.

The test stand itself (either port; no real instrument has these)
    ========================================= ===================================================================
    ``BENCh:FAULt <name>[,<value>]``          misbehave (``sma_actuator.bench.faults.FAULTS``); ``?`` lists them
    ``BENCh:FAULt:CLEar [<name>]``            one of them, or all
    ``BENCh:FAULt:CATalog?``                  the names
    ``BENCh:LOAD:WEIGht <N>``                 hang a weight
    ``BENCh:LOAD:SPRing <N/m>,<N>[,<m>]``     a spring: stiffness, tension, and the displacement where it has it
    ``BENCh:LOAD:SCHedule <s>,<N>{,<s>,<N>}`` weights from bench times on
    ``BENCh:LOAD?``                           the load in words
    ``BENCh:JOINt:ANGLe?``                    of a joint that two wires turn [rad]; a wire without one has a settings conflict
    ``BENCh:JOINt:TORQue <Nm>``               from outside, on that joint; ``?``
    ``BENCh:AMBient <°C>``                    ``?``
    ``BENCh:TRUTh?``                          time_s, displacement_m, strain, temperature_C, martensite, r_phase,
                                              resistance_Ohm, load_N, stress_Pa, current_A, power_W
    ========================================= ===================================================================
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import astuple
from itertools import product
from math import isfinite, isnan

from sma_actuator.plant.loads import Spring, Weight, parse_load

from .bench import RING, SharedJoint, STEP_s, VirtualBench
from .chain import CHANNELS, SATURATED
from .faults import FAULTS
from .supply import OVP_RANGE_V, VOLTAGE_RANGE_V, SettingRefused, WATCHDOG_RANGE_s

VERSION = "1.0"
QUEUE_DEPTH = 20
MAX_SAMPLES = 5000
_ERRORS = {
    -102: "Syntax error",
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -141: "Invalid character data",
    -203: "Command protected",
    -221: "Settings conflict",
    -222: "Data out of range",
    -230: "Data corrupt or stale",
    -350: "Queue overflow",
    -363: "Input buffer overrun",
}
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([a-zA-Z]*)")
_PREFIXES = {"": 1.0, "M": 1e-3, "U": 1e-6, "K": 1e3}
_UNITS = ("A", "V", "S", "N", "W")


class ScpiError(Exception):
    """A command that cannot be obeyed, with its SCPI code."""

    def __init__(self, code: int, detail: str = ""):
        self.code = code
        super().__init__(_ERRORS[code] + (f"; {detail}" if detail else ""))


class _Later(Exception):
    """``answer()`` can be given from bench time ``until_s`` on."""

    def __init__(self, until_s: float, answer: Callable[[], str]):
        self.until_s = until_s
        self.answer = answer


class Client:
    """One connection, as the instrument tells it from others."""


def number(text: str, limits: tuple[float, float] | None = None, default: float | None = None) -> float:
    """A decimal number with an optional unit, or MIN, MAX, DEF where there are such.  Raises ScpiError."""
    word = text.strip().upper()
    if limits is not None:
        if word in ("MIN", "MINIMUM"):
            return limits[0]
        if word in ("MAX", "MAXIMUM"):
            return limits[1]
        if word in ("DEF", "DEFAULT") and default is not None:
            return default
    match = _NUMBER.fullmatch(word)
    if not match:
        raise ScpiError(-104, f"'{text}' is not a number")
    suffix = match[2]
    unit = next((u for u in _UNITS if suffix.endswith(u)), "")
    prefix = suffix.removesuffix(unit) if unit else suffix
    if prefix not in _PREFIXES or (prefix and not unit):
        raise ScpiError(-104, f"unit '{suffix}' is not known")
    value = float(match[1]) * _PREFIXES[prefix]
    if not isfinite(value):
        raise ScpiError(-222)
    return value


def boolean(text: str) -> bool:
    """ON, OFF, 1 or 0.  Raises ScpiError."""
    word = text.strip().upper()
    if word in ("1", "ON"):
        return True
    if word in ("0", "OFF"):
        return False
    raise ScpiError(-141, f"'{text}' is not ON or OFF")


def accepted_headers(pattern: str) -> list[str]:
    """Every upper-case spelling of ``[SOURce:]CURRent[:LEVel]``: with and without options, long and short."""
    choices = []
    for optional, name in re.findall(r"(\[?):?([*A-Za-z]+):?\]?", pattern):
        short = "".join(ch for ch in name if not ch.islower())
        spellings = {name.upper(), short}
        choices.append([*spellings, ""] if optional else [*spellings])
    return [":".join(part for part in parts if part) for parts in product(*choices)]


Handler = Callable[[list[str], Client], str | None]


class Instrument:
    """What two instruments have in common: headers, error queue, status, identity, the bench's own commands."""

    def __init__(self, bench: VirtualBench, model: str, name: str, serial: str):
        self.bench = bench
        self.name = name
        self.identity = f"SMA Actuator,{model},{serial},{VERSION}"
        self._errors: deque[ScpiError] = deque()
        self._event_status = 0
        self._event_enable = 0
        self._handlers: dict[str, tuple[Handler, int, float]] = {}
        self._add("*IDN?", lambda a, c: self.identity)
        self._add("*RST", lambda a, c: self._guarded(c, self.reset))
        self._add("*CLS", lambda a, c: self._clear_status())
        self._add("*OPC", lambda a, c: self._set_event(1))
        self._add("*OPC?", lambda a, c: "1")
        self._add("*WAI", lambda a, c: None)
        self._add("*TST?", lambda a, c: "0")
        self._add("*ESR?", lambda a, c: self._take_event_status())
        self._add("*ESE", self._set_event_enable, 1)
        self._add("*ESE?", lambda a, c: str(self._event_enable))
        self._add(
            "*STB?",
            lambda a, c: str((4 if self._errors else 0) | (32 if self._event_status & self._event_enable else 0)),
        )
        self._add("SYSTem:ERRor[:NEXT]?", lambda a, c: self._next_error())
        self._add("SYSTem:VERSion?", lambda a, c: "1999.0")
        self._add("BENCh:FAULt", self._inject, 1, 2)
        self._add("BENCh:FAULt?", lambda a, c: ",".join(f"{n}={v:g}" for n, v in bench.faults.items()) or "NONE")
        self._add("BENCh:FAULt:CLEar", self._clear_fault, 0, 1)
        self._add("BENCh:FAULt:CATalog?", lambda a, c: ",".join(FAULTS))
        self._add("BENCh:LOAD:WEIGht", lambda a, c: self._set_load(Weight(number(a[0]))), 1)
        self._add("BENCh:LOAD:SPRing", lambda a, c: self._set_load(Spring(*map(number, a))), 2, 3)
        self._add(
            "BENCh:LOAD:SCHedule", lambda a, c: self._set_load(parse_load("schedule:" + ",".join(a))), 2, float("inf")
        )
        self._add("BENCh:LOAD?", lambda a, c: str(bench.load))
        self._add("BENCh:JOINt:ANGLe?", lambda a, c: f"{self._joint.angle_rad:.9E}")
        self._add("BENCh:JOINt:TORQue", self._set_torque, 1)
        self._add("BENCh:JOINt:TORQue?", lambda a, c: f"{self._joint.torque_Nm:g}")
        self._add("BENCh:AMBient", self._set_ambient, 1)
        self._add("BENCh:AMBient?", lambda a, c: f"{bench.ambient_C:g}")
        self._add("BENCh:TRUTh?", lambda a, c: ",".join(f"{v:.9E}" for v in astuple(bench.truth)))

    def _add(self, pattern: str, handler: Handler, least: int = 0, most: float | None = None) -> None:
        """Let ``handler`` answer a header that takes ``least`` to ``most`` parameters."""
        query = pattern.endswith("?")
        for header in accepted_headers(pattern.removesuffix("?")):
            self._handlers[header + ("?" if query else "")] = (handler, least, least if most is None else most)

    def execute(self, line: str, client: Client) -> str | None:
        """Obey one line; return its answers joined by ``;``, or None when there are none.

        Where an answer must wait for samples, the bench is advanced.
        """
        steps = self.steps(line, client)
        try:
            while True:
                self.bench.advance(next(steps))
        except StopIteration as end:
            return end.value

    def steps(self, line: str, client: Client) -> Generator[float, None, str | None]:
        """As :meth:`execute`, but yields each bench time [s] that must come before it can go on."""
        if not line.lstrip(": ").upper().startswith("BENC"):
            self._heard(client)
        answers = []
        path: list[str] = []
        for command in line.split(";"):
            header, _, rest = command.strip().partition(" ")
            if not header:
                continue
            try:
                handler, least, most, path = self._find(header.upper(), path)
                parameters = _split_parameters(rest)
                if len(parameters) < least:
                    raise ScpiError(-109)
                if len(parameters) > most:
                    raise ScpiError(-108)
                try:
                    answer = handler(parameters, client)
                except _Later as later:
                    yield later.until_s
                    answer = later.answer()
            except ScpiError as error:
                self.report(error)
                continue
            except SettingRefused as error:
                self.report(ScpiError(error.code, str(error)))
                continue
            except ValueError as error:  # an unknown fault, an impossible load
                self.report(ScpiError(-222, str(error)))
                continue
            if answer is not None:
                answers.append(answer)
        return ";".join(answers) if answers else None

    def report(self, error: ScpiError) -> None:
        """Queue an error; the last place says that more were lost."""
        self._event_status |= 32 if error.code > -200 else 16
        if len(self._errors) == QUEUE_DEPTH:
            self._errors[-1] = ScpiError(-350)
        else:
            self._errors.append(error)

    def disconnected(self, client: Client) -> None:
        """A connection is gone."""

    def reset(self) -> None:
        """Settings as at power-on."""

    def _heard(self, client: Client) -> None:
        """A line arrived, whatever it says."""

    def _guarded(self, client: Client, action: Callable[[], None]) -> None:
        """Change settings on behalf of ``client``."""
        action()

    def _find(self, header: str, path: list[str]) -> tuple[Handler, int, float, list[str]]:
        if header.startswith("*"):
            tried = [header]
        elif header.startswith(":"):
            tried = [header[1:]]
        else:
            tried = [":".join([*path, header]), header]
        for full in tried:
            if full in self._handlers:
                return *self._handlers[full], path if header.startswith("*") else full.split(":")[:-1]
        raise ScpiError(-113, header)

    def _next_error(self) -> str:
        if not self._errors:
            return '0,"No error"'
        error = self._errors.popleft()
        text = str(error).replace('"', "'")
        return f'{error.code},"{text}"'

    def _clear_status(self) -> None:
        self._errors.clear()
        self._event_status = 0

    def _set_event(self, bit: int) -> None:
        self._event_status |= bit

    def _take_event_status(self) -> str:
        status, self._event_status = self._event_status, 0
        return str(status)

    def _set_event_enable(self, args: list[str], client: Client) -> None:
        self._event_enable = int(number(args[0])) & 255

    def _inject(self, args: list[str], client: Client) -> None:
        self.bench.inject(args[0].lower(), *(number(a) for a in args[1:]))

    def _clear_fault(self, args: list[str], client: Client) -> None:
        self.bench.clear(args[0].lower() if args else None)

    def _set_load(self, load) -> None:
        if self.bench.joint is not None:
            raise ScpiError(-221)
        self.bench.load = load

    @property
    def _joint(self) -> SharedJoint:
        """The joint that the wire turns with another."""
        if self.bench.joint is None:
            raise ScpiError(-221)
        return self.bench.joint

    def _set_torque(self, args: list[str], client: Client) -> None:
        self._joint.torque_Nm = number(args[0])

    def _set_ambient(self, args: list[str], client: Client) -> None:
        self.bench.ambient_C = number(args[0])


class ScpiSupply(Instrument):
    """The current-controlled supply as its TCP port shows it."""

    def __init__(self, bench: VirtualBench, serial: str = "0"):
        super().__init__(bench, "Virtual Supply", "supply", serial)
        supply = bench.supply
        self._owner: Client | None = None
        self._feeder: Client | None = None
        level = "[:LEVel][:IMMediate][:AMPLitude]"
        self._setting(f"[SOURce:]CURRent{level}", "current_A", supply.set_current, supply.current_range_A)
        self._setting(f"[SOURce:]VOLTage{level}", "voltage_V", supply.set_voltage, VOLTAGE_RANGE_V)
        self._setting("[SOURce:]CURRent:PROTection[:LEVel]", "ocp_A", supply.set_ocp, supply.ocp_range_A)
        self._setting("[SOURce:]VOLTage:PROTection[:LEVel]", "ovp_V", supply.set_ovp, OVP_RANGE_V)
        self._setting("OUTPut:PROTection:WDOG:DELay", "watchdog_delay_s", supply.set_watchdog_delay, WATCHDOG_RANGE_s)
        self._switch("[SOURce:]CURRent:PROTection:STATe", "ocp_on")
        self._switch("[SOURce:]VOLTage:PROTection:STATe", "ovp_on")
        self._switch("OUTPut[:STATe]", "output_on", lambda on, _: supply.set_output(on))
        self._switch("OUTPut:PROTection:WDOG[:STATe]", "watchdog_on", self._set_watchdog)
        self._switch("OUTPut:PROTection:WDOG:SESSion", "watchdog_tied", self._tie_watchdog)
        self._add("[SOURce:]CURRent:PROTection:TRIPped?", lambda a, c: str(int("OCP" in supply.trips)))
        self._add("[SOURce:]VOLTage:PROTection:TRIPped?", lambda a, c: str(int("OVP" in supply.trips)))
        self._add("OUTPut:PROTection:TRIPped?", lambda a, c: ",".join(supply.trips) or "NONE")
        self._add("OUTPut:PROTection:CLEar", lambda a, c: self._guarded(c, supply.clear_trips))
        self._add("MEASure[:SCALar]:VOLTage[:DC]?", lambda a, c: f"{bench.voltage_V:.6E}")
        self._add("MEASure[:SCALar]:CURRent[:DC]?", lambda a, c: f"{bench.current_A:.6E}")
        self._add("MEASure[:SCALar]:POWer[:DC]?", lambda a, c: f"{bench.voltage_V * bench.current_A:.6E}")
        self._add("STATus:OPERation:CONDition?", lambda a, c: str(self._operation()))
        self._add("STATus:QUEStionable:CONDition?", lambda a, c: str(self._questionable()))
        self._add("SYSTem:REMote", lambda a, c: self._guarded(c, lambda: None))
        self._add("SYSTem:LOCal", lambda a, c: self._guarded(c, self._unlock))
        self._add("SYSTem:RWLock", lambda a, c: self._lock(c))
        self._add(
            "SYSTem:LOCK:OWNer?",
            lambda a, c: "NONE" if self._owner is None else "SELF" if self._owner is c else "OTHER",
        )

    def reset(self) -> None:
        """Output off, nothing set, watchdog disarmed; latched trips and the lock stay."""
        self.bench.supply.reset()

    def disconnected(self, client: Client) -> None:
        """A lock goes with its owner; the watchdog stays."""
        if self._owner is client:
            self._owner = None

    def _heard(self, client: Client) -> None:
        if not self.bench.supply.watchdog_tied or self._feeder is client:
            self.bench.supply.heard(self.bench.time_s)

    def _guarded(self, client: Client, action: Callable[[], None]) -> None:
        if self._owner not in (None, client):
            raise ScpiError(-203, "another connection holds the lock")
        action()

    def _setting(self, pattern: str, name: str, setter: Callable[[float], None], limits: tuple[float, float]) -> None:
        self._add(pattern, lambda a, c: self._guarded(c, lambda: setter(number(a[0], limits, limits[0]))), 1)
        self._add(
            pattern + "?", lambda a, c: f"{number(a[0], limits) if a else getattr(self.bench.supply, name):.6E}", 0, 1
        )

    def _switch(self, pattern: str, name: str, setter: Callable[[bool, Client], None] | None = None) -> None:
        supply = self.bench.supply
        set_ = setter or (lambda on, _: setattr(supply, name, on))
        self._add(pattern, lambda a, c: self._guarded(c, lambda: set_(boolean(a[0]), c)), 1)
        self._add(pattern + "?", lambda a, c: str(int(getattr(supply, name))))

    def _tie_watchdog(self, on: bool, client: Client) -> None:
        self.bench.supply.watchdog_tied, self._feeder = on, client
        self._heard(client)

    def _set_watchdog(self, on: bool, client: Client) -> None:
        self._feeder = client
        self._heard(client)
        self.bench.supply.watchdog_on = on and self.bench.faults.get("watchdog_dead") != 0.0

    def _lock(self, client: Client) -> None:
        def take() -> None:
            self._owner = client

        self._guarded(client, take)

    def _unlock(self) -> None:
        self._owner = None

    def _operation(self) -> int:
        supply = self.bench.supply
        if not supply.output_on:
            return 0
        return 256 if self.bench.voltage_V >= 0.999 * supply.voltage_V else 1024

    def _questionable(self) -> int:
        bits = {"OVP": 1, "OCP": 2, "OTP": 16, "WDOG": 2048}
        return sum(bits[trip] for trip in self.bench.supply.trips)


class ScpiDaq(Instrument):
    """The scanning DAQ as its TCP port shows it."""

    def __init__(self, bench: VirtualBench, serial: str = "0"):
        super().__init__(bench, "Virtual DAQ", "daq", serial)
        self.reset()
        self._add("ROUTe:SCAN", self._set_scan, 1, float("inf"))
        self._add("ROUTe:SCAN?", lambda a, c: f"(@{','.join(map(str, self._scan))})")
        self._add("SAMPle:COUNt", self._set_count, 1)
        self._add("SAMPle:COUNt?", lambda a, c: str(int(number(a[0], (1, MAX_SAMPLES)) if a else self._count)), 0, 1)
        self._add("SAMPle:RATE?", lambda a, c: "1000")
        self._add("FORMat:READing:TIME", self._set_with_time, 1)
        self._add("FORMat:READing:TIME?", lambda a, c: str(int(self._with_time)))
        self._add("FETCh:AVERage?", lambda a, c: self._average())
        self._add("FETCh[:RAW]?", lambda a, c: self._raw())
        self._add("READ:AVERage?", lambda a, c: self._after_new_block(self._average))
        self._add("READ[:RAW]?", lambda a, c: self._after_new_block(self._raw))
        self._add("SYSTem:TIME:ELAPsed?", lambda a, c: f"{bench.time_s:.6f}")

    def reset(self) -> None:
        """All channels, blocks of one sample, with time stamps."""
        self._scan = list(CHANNELS)
        self._count = 1
        self._with_time = True

    def _set_scan(self, args: list[str], client: Client) -> None:
        text = ",".join(args).replace(" ", "")
        if not re.fullmatch(r"\(@\d+(:\d+)?(,\d+(:\d+)?)*\)", text):
            raise ScpiError(-102, "a channel list is wanted, as (@101,102)")
        channels: list[int] = []
        for part in text[2:-1].split(","):
            first, _, last = part.partition(":")
            channels += range(int(first), int(last or first) + 1) if int(last or first) - int(first) < 1000 else [0]
        if not channels or not set(channels) <= set(CHANNELS):
            raise ScpiError(-222, f"channels {CHANNELS[0]} to {CHANNELS[-1]} exist")
        self._scan = channels

    def _set_count(self, args: list[str], client: Client) -> None:
        count = number(args[0], (1, MAX_SAMPLES), 1)
        if not (1 <= count <= min(MAX_SAMPLES, RING) and count == int(count)):
            raise ScpiError(-222, f"1 to {MAX_SAMPLES} samples")
        self._count = int(count)

    def _set_with_time(self, args: list[str], client: Client) -> None:
        self._with_time = boolean(args[0])

    def _block(self):
        if self.bench.samples < self._count:
            raise ScpiError(-230, f"{self.bench.samples} of {self._count} samples exist")
        samples, times_s = self.bench.daq.block(self._count)
        return samples[:, [CHANNELS.index(c) for c in self._scan]], times_s

    def _average(self) -> str:
        samples, times_s = self._block()
        return self._row(times_s[-1], samples.mean(axis=0))

    def _raw(self) -> str:
        return ",".join(self._row(t, row) for t, row in zip(*reversed(self._block()), strict=True))

    def _row(self, time_s: float, values: Iterable[float]) -> str:
        fields = [f"{time_s:.6f}"] if self._with_time else []
        return ",".join(fields + [_reading(v) for v in values])

    def _after_new_block(self, answer: Callable[[], str]) -> str:
        raise _Later(self.bench.time_s + self._count * STEP_s, answer)


def _reading(value: float) -> str:
    if isnan(value):
        return "NAN"
    return f"{value if abs(value) < 1e30 else SATURATED:.8E}"


def _split_parameters(text: str) -> list[str]:
    text = text.strip()
    return [part.strip() for part in text.split(",")] if text else []
