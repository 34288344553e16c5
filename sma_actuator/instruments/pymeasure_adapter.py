"""A supply driven by a class of pymeasure, for instruments that have a driver there and no dialect here.

pymeasure's drivers name the same thing differently; the names looked for are below.  A class that lacks one of them is
refused in a sentence.  ``python -m sma_actuator.instruments.pymeasure_adapter > docs/pymeasure.md`` tries every class
of the pymeasure that is installed.
"""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
from collections.abc import Callable, Iterator
from math import nan
from typing import Any

try:
    from pymeasure.adapters import Adapter
except ImportError:  # the extra is not installed: said when the class is looked for
    Adapter = object

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import SupplyState

from . import InstrumentLost, InstrumentRefused, LimitsNotHeld, OutputStaysOn
from .byte_streams import Manner
from .parameters import InstrumentSections
from .session import Session
from .supply import Abilities, SessionSupply

#: What is needed → names it has in pymeasure, in order of preference.
NAMES = {
    "current setting": ("current_limit", "current_setpoint"),
    "voltage setting": ("voltage_setpoint", "voltage_limit"),
    "output": ("output_enabled", "output"),
    "measured current": ("measured_current", "measure_current", "current"),
    "measured voltage": ("measured_voltage", "measure_voltage", "voltage"),
}

_LIKE_A_SUPPLY = 3  #: of the five above
_PAGE = """# Classes of pymeasure that can drive a wire

<!-- made by `python -m sma_actuator.instruments.pymeasure_adapter > docs/pymeasure.md` -->

`instruments.supply.pymeasure_class` takes a class that can set and read back a current limit, a compliance voltage
and an output, measures both, asks with question marks and gets no answers to what it sets: of pymeasure {version} the
{fit} in the first table. Its lines end as `instruments.supply.write_termination` and `read_termination` say, with a
line feed where they say nothing. Tests open, drive and switch off one of each family over TCP; none was tried on the
instrument. No DAQ of pymeasure is used: [dialects.md](dialects.md) has those.
"""


class _OverSession(Adapter):
    """Lets an instrument of pymeasure speak over our own session, with its deadlines."""

    def __init__(self, session: Session):
        super().__init__()
        self._session = session
        self._reply = ""

    def _write(self, command: str, **_: Any) -> None:
        if "?" in command:
            self._reply = self._session.ask(command)
        else:
            self._session.tell(command)

    def _read(self, **_: Any) -> str:
        reply, self._reply = self._reply, ""
        return reply

    def flush_read_buffer(self) -> None:
        """Nothing: an answer is read whole, with its question."""


class _OnPaper(Adapter):
    """Notes what a class of pymeasure would say, and whether it reads what it has not asked for with a question
    mark."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self.reads_unasked = ""  #: the line after which it did

    def _write(self, command: str, **_: Any) -> None:
        self.lines.append(command)

    def _read(self, **_: Any) -> str:
        if "?" not in self.lines[-1]:
            self.reads_unasked = self.reads_unasked or self.lines[-1]
        return "0"


class PymeasureSupply(SessionSupply):
    """A pymeasure instrument behind the interface :class:`~sma_actuator.instruments.PowerSupply`."""

    reads_back: frozenset[str] = frozenset({"voltage_setting"})

    def __init__(self, config: InstrumentSections):
        self._class = _find_class(config.instruments.supply.pymeasure_class)
        self._names: dict[str, str] = {}
        self._output: Any = None
        super().__init__(config, Manner.of(config.instruments.supply), ())

    def open(self) -> None:
        """Connect, output off, compliance voltage programmed and read back.

        Raises InstrumentLost or InstrumentRefused.
        """
        self._acknowledged(Abilities(self._class.__name__, voltage_setting=True))
        self._prepare_off()
        super().open()

    def _prepare_off(self) -> None:
        if not self._session.off_lines:
            self._session.off_lines = self._off_on_paper()

    def _configure(self) -> None:
        self._output = self._output_over(_OverSession(self._session))
        self.identity = str(self._do("*IDN?", lambda: self._output_device.id))
        self._set("output", False)
        self._set("current setting", 0.0)
        self._set("voltage setting", self._limits.max_voltage)
        self._checks = [self._voltage_holds]
        self.check_settings()
        if self._output_is_on(self._session):
            raise OutputStaysOn(self.identity)

    def _off_on_paper(self) -> tuple[str, ...]:
        """The lines that switch the output off and set 0 A, to be said blind, as this class of pymeasure says them.

        Raises InstrumentRefused for a class that does not fit.
        """
        paper = _OnPaper()
        output = self._output_over(paper)
        self._names = {what: self._name_of(output, what, names) for what, names in NAMES.items()}
        paper.lines.clear()
        try:
            setattr(output, self._names["output"], False)
            setattr(output, self._names["current setting"], 0.0)
        except Exception as error:
            raise self._refused(f"cannot switch off without asking first ({error})") from error
        off_lines = tuple(line for line in paper.lines if "?" not in line)
        for name in self._names.values():
            with contextlib.suppress(Exception):  # a zero is no answer to some questions: what counts is how it asks
                getattr(output, name)
        if paper.reads_unasked:
            raise self._refused(f"reads an answer to '{paper.reads_unasked}', which does not ask")
        return off_lines

    def _refused(self, why: str) -> InstrumentRefused:
        return InstrumentRefused(
            f"instruments.supply.pymeasure_class: {self._class.__name__} {why}; write a dialect for it instead "
            "(docs/dialects.md)"
        )

    def _output_over(self, adapter: Adapter) -> Any:
        """The channel of the instrument that is wanted, or the instrument where it has only one."""
        try:
            device = self._class(adapter)
        except InstrumentLost:
            raise
        except Exception as error:  # pymeasure raises of all kinds
            raise self._refused(f"cannot be made ({error})") from error
        self._output_device = device
        return getattr(device, f"ch_{self._channel}", device)

    def _tell_current(self, current_A: float) -> None:
        self._set("current setting", current_A)

    def _tell_output(self, on: bool) -> None:
        self._set("output", on)

    def read_back(self) -> SupplyState:
        """Settings and measurements; ``time_s`` is left NaN.  Trips are not known to pymeasure."""
        with self._session.within():
            return SupplyState(
                nan,
                self._get("current setting"),
                self._output_is_on(self._session),
                self._get("measured voltage"),
                self._get("measured current"),
            )

    def _voltage_holds(self) -> None:
        found_V, wanted_V = self._get("voltage setting"), self._limits.max_voltage
        if not abs(found_V - wanted_V) <= 0.02 * wanted_V:
            raise LimitsNotHeld(
                f"{self.identity}: does not hold supply.max_voltage, {wanted_V:g} V: it reads back {found_V:g} V"
            )

    def clear_trip(self) -> None:
        """Nothing to clear: pymeasure's classes do not report trips."""

    def _output_is_on(self, session: Session) -> bool:
        output = self._output if session is self._session else self._output_over(_OverSession(session))
        return self._do("output", lambda: bool(float(getattr(output, self._names["output"]))), session)

    def _name_of(self, output: Any, what: str, names: tuple[str, ...]) -> str:
        for name in names:
            if hasattr(type(output), name):
                return name
        raise self._refused(f"has no {what} (looked for {', '.join(names)})")

    def _get(self, what: str) -> float:
        return self._do(what, lambda: float(getattr(self._output, self._names[what])))

    def _set(self, what: str, value: float | bool) -> None:
        self._do(what, lambda: setattr(self._output, self._names[what], value))

    def _do(self, what: str, action: Callable[[], Any], session: Session | None = None) -> Any:
        try:
            return action()
        except InstrumentLost:
            raise
        except Exception as error:  # pymeasure raises of all kinds at what it does not understand
            raise (session or self._session).give_up(f"{what} failed ({error})") from error


def _find_class(dotted: str) -> type:
    module_name, _, class_name = dotted.rpartition(".")
    try:
        return getattr(importlib.import_module(module_name), class_name)
    except (ImportError, ValueError, AttributeError) as error:
        raise ConfigError(
            f"instruments.supply.pymeasure_class: '{dotted}' cannot be imported ({error}); the dotted name of a class "
            "is wanted, as pymeasure.instruments.keysight.KeysightE36312A, and the extra 'pymeasure' installed"
        ) from error


def survey() -> tuple[dict[str, tuple[str, ...]], dict[str, str]]:
    """Of all instruments of the pymeasure that is installed: classes that can drive a wire, with the lines that they
    are switched off by, and those that know most of what a supply does, with what does not fit."""
    drive, lack = {}, {}
    for name, found in sorted(_instruments()):
        supply = PymeasureSupply.__new__(PymeasureSupply)
        supply._class, supply._channel, output = found, 1, found
        try:
            output = type(supply._output_over(_OnPaper()))
            drive[name] = supply._off_on_paper()
        except InstrumentRefused as error:
            if sum(any(hasattr(output, one) for one in names) for names in NAMES.values()) >= _LIKE_A_SUPPLY:
                lack[name] = str(error).partition(f"{found.__name__} ")[2].partition("; write")[0]
    return drive, lack


def _instruments() -> Iterator[tuple[str, type]]:
    instruments = importlib.import_module("pymeasure.instruments")
    for module in pkgutil.walk_packages(instruments.__path__, "pymeasure.instruments."):
        try:
            members = vars(importlib.import_module(module.name))
        except ImportError:  # it wants another maker's package
            continue
        for name, found in members.items():
            if (
                isinstance(found, type)
                and issubclass(found, instruments.Instrument)
                and found.__module__ == module.name
            ):
                yield f"{module.name}.{name}", found


def main() -> None:
    """Print which classes of pymeasure can drive a wire, for ``docs/pymeasure.md``."""
    drive, lack = survey()
    print(_PAGE.format(version=importlib.import_module("pymeasure").__version__, fit=len(drive)))
    print("| class | is switched off by |\n|---|---|")
    for name, lines in drive.items():
        print(f"| `{name}` | {', '.join(f'`{line}`' for line in lines)} |")
    print("\nWhat looks like a supply and does not fit:\n\n| class | why |\n|---|---|")
    for name, why in lack.items():
        print(f"| `{name}` | {why} |")


if __name__ == "__main__":
    main()
