"""Instruments that answer commands: each answer is heard where it belongs, and where nothing says so the advice is
right."""

import os
import re
import threading
import time
from unittest.mock import Mock

import pytest
import yaml
from answering import Answering, dialect
from hanging import hanging
from serial_line import SerialInstrument
from tcp_line import TcpInstrument

from sma_actuator.base.parameters import ConfigError
from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentError, InstrumentLost, InstrumentRefused, open_daq
from sma_actuator.instruments.byte_streams import Manner
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.instruments.dialect import FOLDER
from sma_actuator.instruments.session import Session

PATIENT_s = 20.0
OK = re.compile("OK")


@pytest.fixture(params=[TcpInstrument, SerialInstrument], ids=["TCP", "serial"])
def served(request):
    return request.param


@pytest.mark.parametrize("said", ["OK", ""], ids=["a word", "a blank line"])
def test_a_supply_that_answers_commands_is_driven(tmp_path, supply_of, served, said):
    instrument = Answering(said)
    with served(instrument) as line:
        supply = supply_of(line, dialect(tmp_path, acknowledgement=said))
        supply.open()
        assert supply.identity == instrument.identity
        for current_A in (0.1, 0.2):
            supply.set_current(current_A)
            supply.set_output(True)
            state = supply.read_back()
            assert (state.output_on, state.current_setting_A, state.voltage_V) == (True, current_A, 0.5)
        supply.check_settings()
        supply.switch_off()
        assert not supply.read_back().output_on
        assert instrument.settings == {**instrument.settings, "OUTP": "0", "CURR": "0.000", "VOLT": "6.000"}


@pytest.mark.parametrize("says_so", [True, False])
def test_an_answer_may_be_acknowledged_too(tmp_path, supply_of, served, says_so):
    """As by B&K 1685B, PeakTech 1535 and a Fluke Hydra, whose prompt follows whatever it says."""
    instrument = Answering()

    def answer(line):
        reply = instrument(line)
        return reply if reply == "OK" else f"{reply}\nOK"

    with served(answer) as line:
        supply = supply_of(line, dialect(tmp_path, acknowledgement="OK", acknowledges_answers=says_so))
        if says_so:
            supply.open()
            for current_A in (0.1, 0.2):
                supply.set_current(current_A)
                supply.set_output(True)
                state = supply.read_back()
                assert (state.output_on, state.current_setting_A, state.voltage_V) == (True, current_A, 0.5)
            assert supply.shut_down()
            assert instrument.settings["OUTP"] == "0"
        elif served is TcpInstrument:  # a serial line is read byte by byte, and the rest taken for a late one
            with pytest.raises(InstrumentLost, match="where 'OK' follows each answer, put acknowledges_answers: true"):
                supply.open()


def test_where_answers_are_acknowledged_it_is_said_how(tmp_path, supply_of):
    with pytest.raises(ConfigError, match="acknowledges_answers: acknowledgement is missing"):
        supply_of(Mock(resource="TCPIP::127.0.0.1::9::SOCKET"), dialect(tmp_path, acknowledges_answers=True))


def test_off_is_confirmed_while_answers_to_blind_lines_lie_in_the_buffer(tmp_path, supply_of, served):
    instrument = Answering()
    with served(instrument) as line:
        supply = supply_of(line, dialect(tmp_path, acknowledgement="OK"))
        supply.open()
        for _ in range(3):
            supply.set_output(True)
            supply._session.say_off()
            supply._session.say_off()
            assert supply.shut_down()
            assert instrument.settings["OUTP"] == "0"
        assert supply._session._stream is not None, "on its own connection"


def test_off_is_confirmed_beside_a_session_that_hangs(tmp_path, supply_of, served):
    instrument = Answering()
    with served(instrument) as line:
        supply = supply_of(line, dialect(tmp_path, acknowledgement="OK"))
        supply.open()
        supply.set_output(True)
        with hanging(supply._session):
            assert supply.shut_down()
        assert instrument.settings["OUTP"] == "0"


def test_what_an_earlier_connection_has_left_is_taken_for_nothing(tmp_path, supply_of):
    """On a serial line nothing ends with a connection: answers to the last lines of one come to the next."""
    with SerialInstrument(Answering()) as line:
        supply = supply_of(line, dialect(tmp_path, acknowledgement="OK"))
        for _ in range(5):
            supply.open()
            supply._session.say_off()
            supply._session.cut()
        supply.open()
        assert not supply.read_back().output_on


@pytest.mark.parametrize("header", ["VOLT", "CURR"])
def test_a_command_that_is_refused_is_named_with_its_answer(tmp_path, supply_of, header):
    instrument = Answering()
    instrument.refused = (header,)
    with TcpInstrument(instrument) as line:
        supply = supply_of(line, dialect(tmp_path, acknowledgement="OK"))
        with pytest.raises(
            InstrumentRefused, match=rf"answered 'E04' to '{header} .*, where acknowledgement 'OK' .* wanted"
        ):
            supply.open()
        assert instrument.settings["OUTP"] == "0"
        with pytest.raises(InstrumentLost, match="not connected"):
            supply.set_output(True)


def test_off_lines_that_are_refused_do_not_keep_off_from_being_confirmed(tmp_path, supply_of):
    """Some refuse 0 A, or off where it is off."""
    instrument = Answering()
    with TcpInstrument(instrument) as line:
        supply = supply_of(line, dialect(tmp_path, acknowledgement="OK"))
        supply.open()
        supply.set_output(True)
        instrument.refused = ("CURR",)
        supply.switch_off()
        assert supply.shut_down()


@pytest.mark.parametrize("said", ["OK", "VOLTAGE SET", "0"])
def test_one_that_answers_though_its_dialect_does_not_say_so_is_refused_with_the_entry_to_add(
    tmp_path, supply_of, served, said
):
    instrument = Answering(said)
    with served(instrument) as line:
        supply = supply_of(line, dialect(tmp_path))
        with pytest.raises(InstrumentError, match=f"put acknowledgement: '{said}' into its dialect") as error:
            supply.open()
        assert f": it answers commands ('{said}' to 'OUTP 0'): put" in str(error.value)
        assert "resource" not in str(error.value)
        assert instrument.settings["OUTP"] == "0"


def test_nor_is_it_otherwise_where_what_answers_an_earlier_connection_comes_too(tmp_path, supply_of):
    """As on a serial line of a busy computer, which opened it twice."""
    instrument = Answering()

    def answer(line):
        return "OK\nOK" if line == "OUTP 0" else instrument(line)

    with SerialInstrument(answer) as line:
        supply = supply_of(line, dialect(tmp_path))
        with pytest.raises(
            InstrumentError, match=r"it answers commands \('OK' to 'OUTP 0'\): put acknowledgement: 'OK'"
        ):
            supply.open()


def test_an_answer_to_a_later_command_is_told_from_an_answer_to_a_question(tmp_path, supply_of):
    instrument = Answering(None)
    with TcpInstrument(instrument) as line:
        supply = supply_of(line, dialect(tmp_path))
        supply.open()
        instrument.acknowledgement = "READY"
        supply.set_current(0.1)
        with pytest.raises(InstrumentLost, match=r"as to 'CURR 0.100' before, put acknowledgement: 'READY' into"):
            supply.read_back()


def test_a_daq_that_answers_is_told_so_too(make_config, tmp_path):
    def answer(line):
        replies = {"*IDN?": "SMA Actuator,Virtual DAQ,7,x", "SYST:ERR?": '0,"No error"'}
        return replies.get(line, "1,1,1" if "?" in line else "OK")

    document = yaml.safe_load((FOLDER / "virtual_bench_daq.yaml").read_text())
    with TcpInstrument(answer) as line:
        for acknowledgement in (None, "OK"):
            if acknowledgement:
                document["acknowledgement"] = acknowledgement
            (tmp_path / "daq.yaml").write_text(yaml.safe_dump(document))
            changes = {"instruments.daq.resource": line.resource, "instruments.daq.dialect": str(tmp_path / "daq.yaml")}
            daq = open_daq(Config.from_mapping(make_config(**changes)), MonotonicClock())
            if acknowledgement:
                daq.open()
                assert daq.read_block().supply_voltage_V == 1.0
            else:
                with pytest.raises(InstrumentLost, match=r"put acknowledgement: 'OK' into its dialect"):
                    daq.open()
            daq.close()


def test_an_acknowledgement_that_does_not_come_is_named():
    with TcpInstrument(lambda line: None) as line:
        session = Session("supply", line.resource, Manner(acknowledgement=OK), 0.3, ["OUTP OFF"])
        session.open()
        with pytest.raises(InstrumentLost, match="no complete answer to 'OUTP OFF'.* acknowledgement 'OK' was wanted"):
            session.ask("OUTP?")


def test_what_is_no_acknowledgement_and_was_not_asked_for_ends_the_connection():
    with SerialInstrument(lambda line: "OK") as line:
        session = Session("supply", line.resource, Manner(acknowledgement=OK), PATIENT_s)
        session.open()
        session.tell("OUTP 0")
        line.say("0.123")
        deadline_s = time.monotonic() + PATIENT_s
        while not session._stream._waiting and time.monotonic() < deadline_s:
            time.sleep(0.001)
        with pytest.raises(InstrumentLost, match="said '0.123' without being asked"):
            session.tell("OUTP 0")


def test_an_acknowledgement_that_comes_late_and_in_pieces_is_waited_for():
    with SerialInstrument(lambda line: "1" if "?" in line else None) as line:
        session = Session("supply", line.resource, Manner(acknowledgement=OK), PATIENT_s)
        session.open()
        os.write(line._ours, b"OK")
        while not session._stream._waiting:
            time.sleep(0.001)
        rest = threading.Timer(0.2, os.write, (line._ours, b"\n"))
        rest.start()
        assert session.ask("OUTP?") == "1"
        rest.join()


def test_a_greeting_is_no_answer_to_a_command(tmp_path, supply_of):
    """A port for people greets, and knows no identity."""
    with TcpInstrument(lambda line: "what?" if line == "*IDN?" else None) as line:
        supply = supply_of(line, dialect(tmp_path))
        with pytest.raises(InstrumentRefused, match="says it is 'what\\?', which is no mine"):
            supply.open()
