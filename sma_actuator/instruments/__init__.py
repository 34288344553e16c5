"""The edge to hardware: what a power supply and a data acquisition unit must do for the loop.

Behind these interfaces stand SCPI instruments over pyvisa (``scpi.py``), classes of pymeasure
(``pymeasure_adapter.py``), DAQs by their makers' packages (``makers_daq.py``), and the virtual bench
in the same process (``sma_actuator.bench``).
"""

from __future__ import annotations

from typing import Protocol

from sma_actuator.base.errors import UserError
from sma_actuator.base.signals import Reading, SupplyState

from .parameters import InstrumentSections


class InstrumentError(UserError, OSError):
    """Something is wrong with an instrument.  The message names it, and what to do."""

    fault = ""  #: name of the fault that this is; "": the instrument is lost


class InstrumentLost(InstrumentError):
    """It does not answer any more (time-out, closed connection).  Reopening may help."""


class InstrumentLate(InstrumentLost):
    """Its answer has not come in its time, and may still come: the next question waits for that one first.

    ``asked_s``: when it was asked, by whatever clock: it tells one late answer from the next.
    """

    def __init__(self, message: str, asked_s: float):
        super().__init__(message)
        self.asked_s = asked_s


class InstrumentUnreachable(InstrumentLost):
    """It cannot be connected to, so it has not heard a word either."""


class InstrumentRefused(InstrumentError):
    """It answers, but it is not what was configured, or will not do what is needed."""


class LimitsNotHeld(InstrumentRefused):
    """A limit does not stand as it was programmed.  Opening programs it anew."""

    fault = "limits_not_held"


class WatchdogNotHeld(InstrumentRefused):
    """The communication watchdog does not stand as it was armed.  Opening arms it anew."""

    fault = "watchdog_not_held"


class OutputStaysOn(InstrumentRefused):
    """It hears, and does not switch off.  More words help nothing, and feed its watchdog."""

    def __init__(self, name: str):
        super().__init__(f"{name}: was told to switch off and answers that its output is on")


class PowerSupply(Protocol):
    """A current-controlled supply.  Every method but ``shut_down`` and ``close`` may raise InstrumentError.

    Off is said first and last on every connection, without a question: before ``open`` asks who answers, and before a
    connection is given up.  Every method returns or raises within the time of one answer,
    ``instruments.supply.timeout``, and a pause between commands; but ``check_settings``, one for each question,
    ``open``, thirty, and ``shut_down``, two and a tenth of a second.  Not thread-safe, but for ``shut_down``: one
    owner.
    """

    identity: str  #: answer to ``*IDN?``, "" before ``open``
    patience_s: (
        float  #: so long after its question an answer may still come (InstrumentLate); 0, as at first: not at all
    )

    @property
    def reads_back(self) -> frozenset[str]:
        """What not every supply tells: ``voltage_setting``; ``over_current_trip``, its setting; ``watchdog_trip``, as
        WDOG, once it has cut."""

    def open(self) -> None:
        """Connect, output off, check who answers, program compliance voltage, over-voltage and
        over-current trips, arm the watchdog, read all of it back; refuse where it does not hold.
        May be called again: it then makes a new connection."""

    def set_current(self, current_A: float) -> None:
        """Program the current limit [A]."""

    def set_output(self, on: bool) -> None:
        """Switch the output."""

    def read_back(self) -> SupplyState:
        """Ask the instrument for its settings and measurements."""

    def check_settings(self) -> None:
        """Read back every limit and the watchdog; raises LimitsNotHeld or WatchdogNotHeld, and switches off then."""

    def check_next_setting(self) -> None:
        """The same of one of them, in turn: cheap enough to be done while driving."""

    def clear_trip(self) -> None:
        """Clear a tripped protection; the output stays off."""

    def switch_off(self) -> None:
        """Output off and current to zero, read back; raises OutputStaysOn where it does."""

    def shut_down(self) -> bool:
        """Output off and current to zero, whatever else fails; whether the output was read back as off.
        Never raises; may be called twice, from any thread, after the connection died or while it
        hangs in another thread (it then makes one of its own)."""

    def close(self) -> None:
        """Give up the connection.  Never raises."""


class Daq(Protocol):
    """A scanning data acquisition unit.  Not thread-safe: one owner."""

    identity: str
    patience_s: float  #: as of a :class:`PowerSupply`

    def open(self) -> None:
        """Connect, check who answers, configure the channel list and the block size."""

    def read_block(self) -> Reading:
        """The average of the newest block, stamped with the loop's monotonic clock."""

    def close(self) -> None:
        """Give up the connection.  Never raises."""


class Clock(Protocol):
    """Time for whoever drives instruments: the machine's, or the virtual bench's."""

    def now_s(self) -> float:
        """Monotonic time [s]."""

    def sleep_until_s(self, deadline_s: float) -> None:
        """Return at ``deadline_s`` or, when it has passed, at once."""


#: Of a period, what is left to instruments: the rest is for a step's own work and for what the computer does besides.
INSTRUMENTS_SHARE = 0.9


def highest_rate_Hz(step_s: float) -> float:
    """The loop's rate that instruments allow which take ``step_s`` to be asked once."""
    return INSTRUMENTS_SHARE / step_s


def open_instruments(config: InstrumentSections, clock: Clock) -> tuple[PowerSupply, Daq]:
    """Both instruments that ``config`` names, not connected yet; over one connection where both have one resource.

    Raises ConfigError as :func:`open_supply` and :func:`open_daq` do.
    """
    supply = open_supply(config)
    if config.instruments.daq.resource == config.instruments.supply.resource and not config.instruments.daq.package:
        from .scpi import ScpiDaq, ScpiSupply

        if isinstance(supply, ScpiSupply):
            return supply, ScpiDaq(config, clock, supply.session)
    return supply, open_daq(config, clock)


def open_supply(config: InstrumentSections) -> PowerSupply:
    """The supply that ``config`` names, not connected yet.

    Raises ConfigError for a dialect that will not do, or a pymeasure class that is not there.
    """
    if config.instruments.supply.pymeasure_class:
        from .pymeasure_adapter import PymeasureSupply

        return PymeasureSupply(config)
    from .scpi import ScpiSupply

    return ScpiSupply(config)


def open_daq(config: InstrumentSections, clock: Clock) -> Daq:
    """The data acquisition unit that ``config`` names, not connected yet.

    Raises ConfigError for a dialect that will not do, or a maker's package that is not there.
    """
    if config.instruments.daq.package:
        from .makers_daq import PACKAGES

        return PACKAGES[config.instruments.daq.package](config, clock)
    from .scpi import ScpiDaq

    return ScpiDaq(config, clock)
