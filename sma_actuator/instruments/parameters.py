"""Where the instruments are and how they are spoken to: the section ``instruments``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from sma_actuator.base.parameters import parameter, section
from sma_actuator.base.sections import Loop, SupplyParameters

#: Ends of a line by name: a parameter file that says \n in single quotes means something else.
TERMINATIONS = {"lf": "\n", "cr": "\r", "crlf": "\r\n"}


@dataclass(frozen=True, slots=True)
class SerialLine:
    """How the characters go over a serial line (``ASRL…``); on any other connection it means nothing."""

    baud_rate: int = parameter(9600, "bits per second, as set on the instrument", "1/s", 50, 4_000_000)
    data_bits: int = parameter(8, "bits of a character", "1", 5, 8)
    parity: str = parameter("none", "parity of a character", choices=("none", "even", "odd", "mark", "space"))
    stop_bits: int = parameter(1, "bits that end a character", "1", 1, 2)
    flow_control: str = parameter(
        "none",
        "how one side tells the other to wait; rts_cts and dtr_dsr only where the cable has those wires",
        choices=("none", "xon_xoff", "rts_cts", "dtr_dsr"),
    )


@dataclass(frozen=True, slots=True)
class Connection:
    """What every instrument's connection has."""

    serial: SerialLine = section(SerialLine, "serial line")
    backend: str = parameter(
        "py",
        "VISA library, as pyvisa names it: py (pyvisa-py), ivi (one of NI, Keysight or R&S), simulated devices as "
        "file.yaml@sim",
    )
    write_termination: str = parameter(
        "", "end of a line sent; empty: the dialect's", choices=tuple(TERMINATIONS), optional=True
    )
    read_termination: str = parameter(
        "", "end of a line of its answers; empty: the dialect's", choices=tuple(TERMINATIONS), optional=True
    )
    command_pause: float = parameter(
        0.0, "least time from the end of one command or answer to the next command", "s", 0.0, 1.0
    )


@dataclass(frozen=True, slots=True)
class SupplyInstrument(Connection):
    """The power supply."""

    resource: str = parameter(
        "", "VISA resource, as TCPIP::192.168.0.5::5025::SOCKET or ASRL/dev/ttyUSB0::INSTR", optional=True
    )
    dialect: str = parameter(
        "virtual_bench_supply", "name of a dialect in sma_actuator/instruments/dialects, or path of a YAML file"
    )
    channel: int = parameter(1, "output channel", "1", 1, 100)
    timeout: float = parameter(
        0.2, "time in which an answer, a read-back or a connection must be complete", "s", 0.01, 60.0
    )
    exclusive_lock: bool = parameter(
        True,
        "keep others away: programs of this computer always, others by the instrument's lock or VISA's where there is "
        "one",
    )
    pymeasure_class: str = parameter("", "dotted name of a pymeasure instrument, instead of a dialect", optional=True)


@dataclass(frozen=True, slots=True)
class DaqInstrument(Connection):
    """The data acquisition unit."""

    resource: str = parameter(
        "", "VISA resource, as TCPIP::192.168.0.6::5025::SOCKET or ASRL/dev/ttyUSB0::INSTR", optional=True
    )
    dialect: str = parameter(
        "virtual_bench_daq", "name of a dialect in sma_actuator/instruments/dialects, or path of a YAML file"
    )
    package: str = parameter(
        "",
        "Python package of the DAQ's maker, instead of a dialect; resource is then the device's name there, and "
        "channel n its input n (0 stays free)",
        choices=("nidaqmx", "labjack"),
        optional=True,
    )
    timeout: float = parameter(0.2, "time in which a reading or a connection must be complete", "s", 0.01, 60.0)
    opening_pause: float = parameter(
        0.0,
        "time from opening its line until a board hears that begins anew then, as many an Arduino for 2 s",
        "s",
        0.0,
        5.0,
    )
    supply_voltage_channel: int = parameter(101, "channel of the supply voltage", "1", 0, 10**6)
    reference_voltage_channel: int = parameter(102, "channel of the sense resistor's voltage", "1", 0, 10**6)
    load_cell_channel: int = parameter(103, "channel of the load cell's amplifier", "1", 0, 10**6)
    lvdt_channel: int = parameter(0, "channel of the LVDT's shunt voltage; 0: none", "1", 0, 10**6)
    lvdt_shunt_resistance: float = parameter(10.0, "resistor the LVDT's current is read across", "Ω", 0.1, 1e4)
    ambient_temperature_channel: int = parameter(
        0, "channel of an ambient temperature sensor, 1 °C per unit; 0: none", "1", 0, 10**6
    )

    @property
    def read_twice(self) -> str:
        """Which two parameters name one channel, in a sentence; empty where none do."""
        seen: dict[int, str] = {}
        for name in (name for name in self.__slots__ if name.endswith("_channel")):
            channel = getattr(self, name)
            if channel and channel in seen:
                return (
                    f"instruments.daq.{seen[channel]} and instruments.daq.{name}: are both channel {channel}; two "
                    "quantities are read from two channels"
                )
            seen[channel] = name
        return ""


def least_reading_timeout_s(supply_timeout_s: float, daq_timeout_s: float, rate_Hz: float) -> float:
    """How old a reading must be allowed to be: until both instruments are silent for certain, and two periods."""
    return max(2.0 / rate_Hz, supply_timeout_s + daq_timeout_s + 1.0 / rate_Hz)


@dataclass(frozen=True, slots=True)
class Instruments:
    """Both instruments."""

    supply: SupplyInstrument = section(SupplyInstrument, "power supply")
    daq: DaqInstrument = section(DaqInstrument, "data acquisition")
    reconnect_backoff_max: float = parameter(
        5.0,
        "longest wait between attempts to reconnect; 0.5 s to a supply that may be on and hears nothing",
        "s",
        0.1,
        600.0,
    )


class InstrumentSections(Protocol):
    """What instruments read of the parameters; a ``BenchConfig`` has it."""

    @property
    def instruments(self) -> Instruments:
        """Where they are."""

    @property
    def supply(self) -> SupplyParameters:
        """What the supply may do."""

    @property
    def loop(self) -> Loop:
        """How many samples a reading is made of."""
