"""Supply and DAQ of the bench at the end of serial lines: they open as they are given, and are told how to talk."""

import errno
import termios
import threading
import time
from unittest.mock import Mock

import pytest
import pyvisa
import serial
from hanging import hanging
from serial_line import SerialInstrument

from sma_actuator.base.parameters import ConfigError
from sma_actuator.bench import VirtualBench
from sma_actuator.bench.scpi import Client, ScpiDaq, ScpiSupply
from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentError, InstrumentLost, InstrumentRefused, open_daq, open_supply
from sma_actuator.instruments import session as session_module
from sma_actuator.instruments.byte_streams import Manner, VisaStream
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.instruments.parameters import SerialLine
from sma_actuator.instruments.session import Session

CONSTANTS = pyvisa.constants


def answers_of(bench, instrument):
    """``answer(line)`` of one of the bench's instruments, whose time is the machine's."""
    client, began_s, turn = Client(), time.monotonic(), threading.Lock()

    def answer(line):
        with turn:
            bench.advance(max(bench.time_s, time.monotonic() - began_s))
            steps = instrument.steps(line, client)
            while True:
                try:
                    bench.advance(max(bench.time_s, next(steps)))
                except StopIteration as end:
                    return end.value

    return answer


@pytest.fixture
def bench():
    bench = VirtualBench.from_name("flexinol")
    bench.advance(0.01)
    return bench


def config_of(make_config, role, line, **parameters):
    changes = {f"instruments.{role}.resource": line.resource, "supply.watchdog_timeout": 60.0}
    return Config.from_mapping(make_config(**changes, **parameters))


def test_a_wire_is_driven_over_two_serial_lines_with_nothing_said_of_them(make_config, bench):
    with (
        SerialInstrument(answers_of(bench, ScpiSupply(bench, serial="1"))) as supply_line,
        SerialInstrument(answers_of(bench, ScpiDaq(bench, serial="1"))) as daq_line,
    ):
        config = config_of(make_config, "supply", supply_line, **{"instruments.daq.resource": daq_line.resource})
        supply, daq = open_supply(config), open_daq(config, MonotonicClock())
        supply.open()
        daq.open()
        assert "Virtual Supply" in supply.identity
        supply.set_current(0.1)
        supply.set_output(True)
        deadline_s = time.monotonic() + 60.0
        while abs(daq.read_block().reference_voltage_V - 0.1) > 2e-3:
            assert time.monotonic() < deadline_s
        assert supply.read_back().current_A == pytest.approx(0.1, abs=1e-3)
        assert supply.shut_down()
        assert not bench.supply.output_on
        supply.close()
        daq.close()
        assert supply_line.lines[0] == "OUTP OFF"


def test_a_line_whose_loop_hangs_is_cut_and_off_is_said_and_confirmed_anew(make_config, bench):
    with SerialInstrument(answers_of(bench, ScpiSupply(bench, serial="1"))) as line:
        supply = open_supply(config_of(make_config, "supply", line))
        supply.open()
        supply.set_current(0.1)
        supply.set_output(True)
        assert supply.read_back().output_on
        with hanging(supply._session):
            assert supply.shut_down()
        assert not bench.supply.output_on
        supply.close()


@pytest.mark.parametrize("role", ["supply", "daq"])
def test_the_line_is_set_as_the_parameters_say(make_config, role):
    kind = "Virtual Supply" if role == "supply" else "Virtual DAQ"
    with SerialInstrument(lambda line: f"SMA Actuator,{kind},1,2" if line == "*IDN?" else None) as line:
        section = f"instruments.{role}.serial"
        wanted = {"baud_rate": 19200, "stop_bits": 2, "flow_control": "xon_xoff"}
        changes = {f"{section}.{name}": value for name, value in wanted.items()}
        config = config_of(make_config, role, line, **changes)
        session = (open_supply(config) if role == "supply" else open_daq(config, MonotonicClock()))._session
        session.open()
        inputs, _, control, _, speed, _, _ = line.settings()
        assert speed == termios.B19200
        assert control & termios.CSTOPB
        assert inputs & termios.IXON
        session.close()


def test_all_settings_reach_the_line():
    """A pseudo-terminal has eight bits and no parity, whatever it is told."""
    line = Mock()
    VisaStream._prepare(
        line, SerialLine(baud_rate=115200, data_bits=7, parity="even", stop_bits=2, flow_control="rts_cts")
    )
    told = (line.baud_rate, line.data_bits, line.parity, line.stop_bits, line.flow_control)
    assert told == (115200, 7, CONSTANTS.Parity.even, CONSTANTS.StopBits.two, CONSTANTS.ControlFlow.rts_cts)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("baud_rate", 0, "50 to 4e"),
        ("data_bits", 9, "5 to 8"),
        ("parity", "nope", "none, even, odd, mark, space"),
        ("stop_bits", 1.5, "is not a whole number"),
        ("flow_control", True, "is not text"),
    ],
)
def test_what_no_line_can_be_set_to_is_refused(make_config, name, value, words):
    with pytest.raises(ConfigError, match=f"instruments.supply.serial.{name}: .*{words}"):
        Config.from_mapping(make_config(**{f"instruments.supply.serial.{name}": value}))


@pytest.mark.parametrize(("name", "value"), [("write_termination", "\n"), ("read_termination", "CR")])
def test_the_end_of_a_line_has_a_name(make_config, name, value):
    with pytest.raises(ConfigError, match=f"instruments.supply.{name}: .* is not one of lf, cr, crlf"):
        Config.from_mapping(make_config(**{f"instruments.supply.{name}": value}))


def test_lines_end_as_the_parameters_say(make_config, bench):
    with SerialInstrument(answers_of(bench, ScpiSupply(bench, serial="1")), hears="\r", says="\r\n") as line:
        ends = {"instruments.supply.write_termination": "cr", "instruments.supply.read_termination": "crlf"}
        supply = open_supply(config_of(make_config, "supply", line, **ends))
        supply.open()
        assert not supply.read_back().output_on
        supply.close()


@pytest.mark.parametrize("end", ["\r", ""])
def test_an_end_that_does_not_come_names_the_parameter(end):
    with SerialInstrument(lambda line: "1", says=end) as line:
        session = Session("supply", line.resource, Manner(), 0.3)
        session.open()
        with pytest.raises(InstrumentLost, match=r"'1' came, without the end of a line.*instruments.supply.read_term"):
            session.ask("OUTP?")


def test_a_slow_instrument_is_left_its_pause_and_hears_every_line_also_the_blind_ones(make_config, bench):
    with SerialInstrument(answers_of(bench, ScpiSupply(bench, serial="1")), pause_s=0.02) as line:
        # Ten times what it wants: a machine that holds it up brings two lines together.
        patient = {"instruments.supply.command_pause": 0.2}
        supply = open_supply(config_of(make_config, "supply", line, **patient))
        supply.open()
        assert line.lines[:3] == ["OUTP OFF", "CURR 0.000000", "*IDN?"]
        supply.set_current(0.1)
        supply.set_output(True)
        assert supply.read_back().output_on
        said = len(line.lines)
        supply._session.cut()
        deadline_s = time.monotonic() + 10.0
        while line.lines[said:] != ["OUTP OFF", "CURR 0.000000"]:
            assert time.monotonic() < deadline_s, line.lines[said:]
            time.sleep(0.01)
        assert not bench.supply.output_on
        supply.close()


def test_a_pause_for_which_there_is_no_time_is_named():
    with SerialInstrument(lambda line: "1") as line:
        session = Session("daq", line.resource, Manner(pause_s=0.5), 0.3)
        session.open()
        time.sleep(0.5)  # as long as the first one keeps its distance
        assert session.ask("ONE?") == "1"
        with pytest.raises(InstrumentLost, match=r"'TWO\?' within 0.3 s: instruments.daq.command_pause, 0.5 s, is a"):
            session.ask("TWO?")


def test_what_the_last_program_left_unread_is_nobodys_answer():
    with SerialInstrument(lambda line: "1") as line:
        line.say("the last program's")
        session = Session("supply", line.resource, Manner(), 10.0)
        session.open()
        assert session.ask("OUTP?") == "1"
        line.say("2")
        deadline_s = time.monotonic() + 10.0
        while not session._stream._waiting and time.monotonic() < deadline_s:
            time.sleep(0.001)
        with pytest.raises(InstrumentLost, match="said '2' without being asked"):
            session.ask("OUTP?")


@pytest.mark.parametrize("baud_rate", [19200, 9600])
def test_another_baud_rate_is_asked_about(make_config, bench, baud_rate):
    with SerialInstrument(answers_of(bench, ScpiSupply(bench, serial="1")), baud_rate=19200) as line:
        changes = {"instruments.supply.serial.baud_rate": baud_rate, "instruments.supply.timeout": 1.0}
        supply = open_supply(config_of(make_config, "supply", line, **changes))
        if baud_rate == 19200:
            supply.open()
        else:
            with pytest.raises(InstrumentLost, match=r"is instruments.supply.serial.baud_rate, 9600, right;"):
                supply.open()
        supply.close()


def test_one_line_is_claimed_by_all_its_names(tmp_path):
    with SerialInstrument(lambda line: None) as line:
        (tmp_path / "by-id").symlink_to(line.path)
        one = Session("supply", line.resource, Manner(), 1.0)
        other = Session("supply", f"ASRL{tmp_path / 'by-id'}::INSTR", Manner(), 1.0)
        claim = one.claim("why")
        with pytest.raises(InstrumentRefused, match="another program on this computer"):
            other.claim("why")
        claim.release()


@pytest.mark.parametrize("resource", ["USB0::1::2::3::INSTR", "GPIB0::6::INSTR", "TCPIP::host::hislip0::INSTR"])
def test_an_interface_without_locks_opens_all_the_same(monkeypatch, resource):
    """As pyvisa-py's are, but for VXI-11; an error that is none of that kind is one."""

    class Resource:
        error = CONSTANTS.StatusCode.error_nonsupported_operation
        closed = False

        def lock_excl(self, timeout):
            raise pyvisa.VisaIOError(self.error)

        def close(self):
            self.closed = True

    class Manager:
        def __init__(self, *_):
            pass

        def open_resource(self, *_, **__):
            return opened

    opened = Resource()
    monkeypatch.setattr(session_module.pyvisa, "ResourceManager", Manager)
    session = Session("supply", resource, Manner(), 1.0)
    session.open(lock=True)
    assert isinstance(session._stream, VisaStream)
    session.close()
    opened.error = CONSTANTS.StatusCode.error_system_error
    with pytest.raises(InstrumentError, match="cannot be opened"):
        session.open(lock=True)
    assert opened.closed


def test_a_line_that_cannot_be_set_so_is_given_back():
    with SerialInstrument(lambda line: None) as line:
        session = Session("supply", line.resource, Manner(serial=SerialLine(data_bits=7)), 1.0)
        with pytest.raises(InstrumentError, match="cannot be opened"):
            session.open()
        assert not pyvisa.ResourceManager("@py").list_opened_resources()


def test_a_port_that_is_gone_says_which_there_are(monkeypatch):
    """Pulled and plugged in again it may be /dev/ttyUSB1."""
    session = Session("daq", "ASRL/dev/ttyUSB_gone::INSTR", Manner(), 1.0)
    with pytest.raises(InstrumentError, match=r"there is no such port; of USB there is .*; .* in /dev/serial/by-id$"):
        session.open()
    monkeypatch.setattr(session_module, "_SERIAL_PORTS", ("nul*",))
    with pytest.raises(InstrumentError, match="of USB there is /dev/null; "):
        session.open()


def test_a_line_that_belongs_to_another_group_says_how_it_is_joined(monkeypatch):
    """The first hour on many a computer: /dev/ttyUSB0 is for the group dialout alone."""

    def denied(*_, **__):
        raise serial.SerialException(errno.EACCES, "could not open port /dev/ttyUSB0")

    monkeypatch.setattr(serial, "serial_for_url", denied)
    session = Session("daq", "ASRL/dev/ttyUSB0::INSTR", Manner(), 1.0)
    with pytest.raises(InstrumentError, match=r"may not open it; .*usermod -aG dialout \$USER', and log in anew"):
        session.open()


def test_what_has_come_is_asked_of_a_serial_line_alone():
    """Any other has no bytes before they are asked for, and would wait for one until its time-out."""
    library = Mock()
    assert VisaStream(library, "GPIB::1::INSTR", Manner(), time.monotonic() + 10.0).unread() == b""
    library.open_resource.return_value.visalib.read.assert_not_called()


@pytest.mark.parametrize("call", ["send", "receive", "unread"])
def test_a_line_that_is_closed_under_the_one_who_waits_is_a_broken_connection(call, monkeypatch):
    """pyserial calls that have lost their file end in a TypeError."""
    with SerialInstrument(lambda line: None) as line:
        wire = VisaStream(pyvisa.ResourceManager("@py"), line.resource, Manner(), time.monotonic() + 10.0)
        library = wire._visa.visalib
        port = library.sessions[wire._visa.session].interface
        fd = port.fd

        def closed_meanwhile(then):
            def ask(*args):
                port.fd = None
                return then(*args)

            return ask

        for name in ("write", "get_attribute"):
            monkeypatch.setattr(library, name, closed_meanwhile(getattr(library, name)))
        deadline = () if call == "unread" else (time.monotonic() + 10.0,)
        data = (b"*IDN?\n",) if call == "send" else ()
        with pytest.raises(ConnectionAbortedError):
            getattr(wire, call)(*data, *deadline)
        port.fd = fd
        monkeypatch.undo()
        wire.close()
