"""A TDK-Lambda Genesys on its serial line, after chapter 7 of its technical manual (83-507-013): it hears nothing
before its address, every command is answered by OK or by an error, lines end with CR."""

from typing import ClassVar

from lewis.adapters.stream import Cmd, StreamInterface
from lewis.devices import Device

RATED_V, RATED_A = 6.0, 100.0
ADDRESS = 6


class Genesys(Device):
    """State and physics of a GEN6-100."""

    def __init__(self):
        super().__init__()
        self.addressed = self.output_on = False
        self.setting_V = self.setting_A = 0.0
        self.over_voltage_V = 1.1 * RATED_V
        self.load_Ohm = 8.0

    @property
    def current_A(self):
        return min(self.setting_A, self.setting_V / self.load_Ohm) if self.output_on else 0.0

    @property
    def voltage_V(self):
        return self.current_A * self.load_Ohm


class GenesysInterface(StreamInterface):
    """Its commands."""

    in_terminator = out_terminator = "\r"
    commands: ClassVar = {
        Cmd("address", r"^ADR (\d+)$", argument_mappings=(int,)),
        Cmd("identity", r"^IDN\?$"),
        Cmd("clear", r"^CLS$"),
        Cmd("remote", r"^RMT (LOC|REM|LLO|[012])$"),
        Cmd("set_voltage", r"^PV ([\d.]+)$", argument_mappings=(float,)),
        Cmd("set_current", r"^PC ([\d.]+)$", argument_mappings=(float,)),
        Cmd("set_over_voltage", r"^OVP ([\d.]+)$", argument_mappings=(float,)),
        Cmd("set_over_voltage_highest", r"^OVM$"),
        Cmd("ignore", r"^(?:FLD|AST) OFF$|^UVL 0$"),
        Cmd("switch", r"^OUT (ON|OFF|1|0)$"),
        Cmd("voltage_setting", r"^PV\?$"),
        Cmd("current_setting", r"^PC\?$"),
        Cmd("over_voltage_setting", r"^OVP\?$"),
        Cmd("is_on", r"^OUT\?$"),
        Cmd("measured_voltage", r"^MV\?$"),
        Cmd("measured_current", r"^MC\?$"),
        Cmd("everything", r"^STT\?$"),
    }

    def address(self, number):
        self.device.addressed = number == ADDRESS
        return self._answer("OK")

    def identity(self):
        return self._answer("LAMBDA,GEN6-100")

    def clear(self):
        return self._answer("OK")

    def ignore(self):
        """Foldback, automatic restart and the lower limit are off already."""
        return self._answer("OK")

    def remote(self, _):
        return self._answer("OK")

    def set_voltage(self, value_V):
        return self._set("setting_V", value_V, value_V <= 1.05 * RATED_V, "E01" if self._above_trip(value_V) else "")

    def set_current(self, value_A):
        return self._set("setting_A", value_A, value_A <= 1.05 * RATED_A)

    def set_over_voltage(self, value_V):
        too_low = value_V < 1.05 * self.device.setting_V
        return self._set("over_voltage_V", value_V, value_V <= 1.25 * RATED_V, "E04" if too_low else "")

    def set_over_voltage_highest(self):
        return self._set("over_voltage_V", 1.25 * RATED_V, True)

    def everything(self):
        device = self.device
        return self._answer(
            f"MV({device.voltage_V:.4f}),PV({device.setting_V:.4f}),MC({device.current_A:.3f}),PC({device.setting_A:.3f}),"
            "SR(00),FR(00)"
        )

    def switch(self, word):
        return self._set("output_on", word in (b"ON", b"1"), True)

    def voltage_setting(self):
        return self._answer(f"{self.device.setting_V:06.4f}")

    def current_setting(self):
        return self._answer(f"{self.device.setting_A:07.3f}")

    def over_voltage_setting(self):
        return self._answer(f"{self.device.over_voltage_V:.2f}")

    def is_on(self):
        return self._answer("ON" if self.device.output_on else "OFF")

    def measured_voltage(self):
        return self._answer(f"{self.device.voltage_V:06.4f}")

    def measured_current(self):
        return self._answer(f"{self.device.current_A:07.3f}")

    def handle_error(self, request, error):
        return self._answer("C01")

    def _above_trip(self, value_V):
        return 1.05 * value_V > self.device.over_voltage_V

    def _answer(self, text):
        return text if self.device.addressed else None

    def _set(self, name, value, in_range, conflict=""):
        if not self.device.addressed:
            return None
        if not in_range:
            return "C05"
        if not conflict:
            setattr(self.device, name, value)
        return conflict or "OK"
