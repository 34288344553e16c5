"""Which channel of a DAQ carries what, and the reading that their means make."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan

from sma_actuator.base.signals import Reading

from . import InstrumentRefused
from .parameters import DaqInstrument

#: The driver cannot do without these.
_NEEDED = ("supply_voltage", "reference_voltage", "load_cell")


class Channels:
    """The channels of one wire, in ascending order: so instruments scan, whatever order they are told."""

    def __init__(self, daq: DaqInstrument):
        self._daq = daq
        named = {
            "supply_voltage_V": daq.supply_voltage_channel,
            "reference_voltage_V": daq.reference_voltage_channel,
            "load_cell_voltage_V": daq.load_cell_channel,
            "lvdt_current_A": daq.lvdt_channel,
            "ambient_temperature_C": daq.ambient_temperature_channel,
        }
        self._numbers = dict(sorted(((n, c) for n, c in named.items() if c), key=lambda item: item[1]))

    @property
    def numbers(self) -> list[int]:
        """As the instrument has them."""
        return list(self._numbers.values())

    def check(self, who: str, measures_celsius: bool) -> None:
        """Raise InstrumentRefused where one is missing, or not what ``who`` measures."""
        for quantity in _NEEDED:
            if getattr(self._daq, f"{quantity}_channel") == 0:
                raise InstrumentRefused(
                    f"instruments.daq.{quantity}_channel: is 0; the driver cannot do without that channel"
                )
        ambient_channel = self._daq.ambient_temperature_channel
        if ambient_channel != 0 and not measures_celsius:
            # 0.02 V would pass for a room of 0.02 °C, and the heat balance would take the wire for colder than it is.
            raise InstrumentRefused(
                f"instruments.daq.ambient_temperature_channel: is {ambient_channel}, but {who} reads every channel in "
                "volts; 0 is wanted, and the room's temperature in thermal.ambient_temperature"
            )

    def reading(self, time_s: float, means: Sequence[float]) -> Reading:
        """The reading of the means of :attr:`numbers`; NaN for channels that are not configured."""
        values = dict(zip(self._numbers, means, strict=True))
        return Reading(
            time_s=time_s,
            supply_voltage_V=values["supply_voltage_V"],
            reference_voltage_V=values["reference_voltage_V"],
            load_cell_voltage_V=values["load_cell_voltage_V"],
            lvdt_current_A=values.get("lvdt_current_A", nan) / self._daq.lvdt_shunt_resistance,
            ambient_temperature_C=values.get("ambient_temperature_C", nan),
        )
