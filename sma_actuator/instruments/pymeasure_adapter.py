"""A supply driven by a class of pymeasure, for instruments that have a driver there and no dialect here.

pymeasure's drivers name the same thing differently; the names looked for are below.  A class that
lacks one of them is refused in a sentence.
"""

from __future__ import annotations

import importlib
import logging
from math import nan
from typing import TYPE_CHECKING

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import SupplyState

from . import InstrumentLost, InstrumentRefused

if TYPE_CHECKING:
    from sma_actuator.config import Config

_log = logging.getLogger(__name__)

#: What is needed → names it has in pymeasure, in order of preference.
NAMES = {
    "current setting": ("current_limit", "current_setpoint"),
    "voltage setting": ("voltage_setpoint", "voltage_limit"),
    "output": ("output_enabled", "output"),
    "measured current": ("measured_current", "measure_current", "current"),
    "measured voltage": ("measured_voltage", "measure_voltage", "voltage"),
}


class PymeasureSupply:
    """A pymeasure instrument behind the interface :class:`~sma_actuator.instruments.PowerSupply`."""

    def __init__(self, config: Config):
        self._limits = config.supply
        self._instrument = config.instruments.supply
        self._class = _find_class(self._instrument.pymeasure_class)
        self._device = None
        self._output = None
        self._names: dict[str, str] = {}
        self.identity = ""

    def open(self) -> None:
        """Connect, output off, compliance voltage programmed and read back.

        Raises InstrumentLost or InstrumentRefused.
        """
        if not self._limits.allow_no_watchdog:
            raise InstrumentRefused(
                f"instruments.supply.pymeasure_class: {self._class.__name__} has no communication watchdog, so a killed computer "
                "leaves the current on; set supply.allow_no_watchdog: true to drive it all the same"
            )
        self._connect()
        try:
            self._configure()
        except InstrumentRefused:
            self.close()  # nobody shall switch on what was refused
            raise

    def _connect(self) -> None:
        self.close()
        try:
            self._device = self._class(
                self._instrument.resource,
                visa_library="@py",
                timeout=int(1e3 * self._instrument.timeout),
                read_termination="\n",
                write_termination="\n",
            )
        except Exception as error:  # pymeasure and pyvisa raise of all kinds
            raise InstrumentLost(f"supply at {self._instrument.resource}: cannot be opened ({error})") from error
        self._output = getattr(self._device, f"ch_{self._instrument.channel}", self._device)
        self._names = {what: self._name_of(what, names) for what, names in NAMES.items()}

    def _configure(self) -> None:
        self.identity = str(self._do("*IDN?", lambda: self._device.id))
        self.set_output(False)
        self._set("current setting", 0.0)
        self._set("voltage setting", self._limits.max_voltage)
        found_V = self._get("voltage setting")
        if not abs(found_V - self._limits.max_voltage) <= 0.02 * self._limits.max_voltage:
            raise InstrumentRefused(
                f"{self.identity}: does not take supply.max_voltage, {self._limits.max_voltage:g} V: it reads back {found_V:g} V"
            )

    def set_current(self, current_A: float) -> None:
        """Program the current limit [A]; nothing but 0 to supply.max_current passes."""
        if not 0.0 <= current_A <= self._limits.max_current:
            raise InstrumentRefused(
                f"{self.identity}: was to be set to {current_A} A; 0 to supply.max_current, {self._limits.max_current:g} A, is allowed"
            )
        self._set("current setting", current_A)

    def set_output(self, on: bool) -> None:
        """Switch the output."""
        self._set("output", on)

    def read_back(self) -> SupplyState:
        """Settings and measurements; ``time_s`` is left NaN.  Trips are not known to pymeasure."""
        return SupplyState(
            nan,
            self._get("current setting"),
            bool(self._get("output")),
            self._get("measured voltage"),
            self._get("measured current"),
        )

    def watchdog_holds(self) -> bool:
        """True: ``open`` has made sure that doing without a watchdog was accepted."""
        return True

    def clear_trip(self) -> None:
        """Nothing to clear: pymeasure's classes do not report trips."""

    def shut_down(self) -> None:
        """Output off and current to zero, through a new connection where the old one is gone.  Never raises."""
        try:
            try:
                self._off()
            except InstrumentLost:
                self._connect()
                self._off()
        except Exception as error:  # noqa: BLE001 - the last thing a program does must not fail
            _log.error("supply at %s: could not be told to switch off (%s)", self._instrument.resource, error)

    def _off(self) -> None:
        self.set_output(False)
        self._set("current setting", 0.0)
        if self._get("output"):
            raise InstrumentRefused(f"{self.identity}: was told to switch off and answers that its output is on")

    def close(self) -> None:
        """Give up the connection.  Never raises."""
        device, self._device, self._output = self._device, None, None
        try:
            if device is not None:
                device.adapter.close()
        except Exception as error:  # noqa: BLE001 - nothing depends on a connection that is given up
            _log.debug("closing: %s", error)

    def _name_of(self, what: str, names: tuple[str, ...]) -> str:
        for name in names:
            if hasattr(type(self._output), name):
                return name
        self.close()
        raise InstrumentRefused(
            f"instruments.supply.pymeasure_class: {self._class.__name__} has no {what} (looked for {', '.join(names)}); "
            "write a dialect for it instead (docs/dialects.md)"
        )

    def _get(self, what: str):
        return self._do(what, lambda: getattr(self._output, self._names[what]))

    def _set(self, what: str, value) -> None:
        self._do(what, lambda: setattr(self._output, self._names[what], value))

    def _do(self, what: str, action):
        if self._device is None:
            raise InstrumentLost(f"supply at {self._instrument.resource}: not connected")
        try:
            return action()
        except Exception as error:  # pymeasure and pyvisa raise of all kinds
            self.close()
            raise InstrumentLost(f"supply at {self._instrument.resource}: {what} failed ({error})") from error


def _find_class(dotted: str) -> type:
    module_name, _, class_name = dotted.rpartition(".")
    try:
        return getattr(importlib.import_module(module_name), class_name)
    except (ImportError, ValueError, AttributeError) as error:
        raise ConfigError(
            f"instruments.supply.pymeasure_class: '{dotted}' cannot be imported ({error}); the dotted name of a class is wanted, as "
            "pymeasure.instruments.keysight.KeysightE36312A, and the extra 'pymeasure' installed"
        ) from error
