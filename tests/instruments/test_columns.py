"""DAQs that answer with all that they have, and that begin anew when their line is opened."""

import contextlib
import os
import select
import threading
import time
import tty

import pytest
import yaml
from serial_line import SerialInstrument
from tcp_line import TcpInstrument

from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentLost, InstrumentRefused, open_daq
from sma_actuator.instruments.clock import MonotonicClock

CHANNELS = {"supply_voltage_channel": 1, "reference_voltage_channel": 2, "load_cell_channel": 4}


@pytest.fixture
def daq_of(make_config, tmp_path):
    """``daq_of(resource, read, daq, **entries)``: a DAQ of a dialect with that ``read``, not open yet."""
    with contextlib.ExitStack() as stack:
        yield lambda *how, **entries: stack.enter_context(
            contextlib.closing(_daq_of(make_config, tmp_path, *how, **entries))
        )


def _daq_of(make_config, tmp_path, resource, read, daq=CHANNELS, **entries):
    document = {"kind": "daq", "queries": {"identity": None, "read": read}, "commands": {"clear_status": None}}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document | entries))
    section = {"resource": resource, "dialect": str(tmp_path / "mine.yaml"), **daq}
    changes = {f"instruments.daq.{name}": value for name, value in section.items()}
    return open_daq(Config.from_mapping(make_config(**changes)), MonotonicClock())


@pytest.mark.parametrize(
    ("read", "reply"),
    [
        ({"columns": 4}, "1.5,0.25,-,0.75"),
        ({"columns": 4}, "1.25,0.25,9,0.5,1.75,0.25,9,1.0"),  # two samples
        ({"columns": 4, "separator": " ", "answer": "A\\d=(.*)"}, "A0=1.5 A1=0.25  A2=? A3=0.75"),
        ({"columns": 5, "separator": "\t", "scale": 0.001}, "1500\t250\t-1\t7.5e2\t11:02:59"),
        ({"columns": 4, "answer": "[^0-9]*([-+.e0-9]+).*"}, '{"v": [1.5, 2.5e-1, 9.0, 0.75]}'),
        ({"columns": 8, "separator": ""}, ">+01.500+2.5e-1-0.0000+00.750+00000+00000+00000+00000"),  # ADAM-4117
    ],
)
def test_channels_are_taken_out_of_all_columns(daq_of, read, reply):
    with TcpInstrument(lambda line: reply) as line:
        daq = daq_of(line.resource, {"ask": "r", **read})
        daq.open()
        reading = daq.read_block()
    assert line.lines == ["r"]
    assert (reading.supply_voltage_V, reading.reference_voltage_V, reading.load_cell_voltage_V) == (1.5, 0.25, 0.75)


@pytest.mark.parametrize("reply", ["1.5,0.25,0.0", "1.5,0.25,0.0,0.75,", "?01"])
def test_an_answer_with_other_columns_is_none(daq_of, reply):
    with TcpInstrument(lambda line: reply) as line:
        daq = daq_of(line.resource, {"ask": "r", "columns": 4})
        daq.open()
        with pytest.raises(InstrumentLost, match="has . columns, not 4"):
            daq.read_block()


def test_a_channel_beyond_the_columns_is_refused(daq_of):
    with TcpInstrument(lambda line: None) as line:
        daq = daq_of(line.resource, {"ask": "r", "columns": 3}, family="three inputs")
        with pytest.raises(InstrumentRefused, match="channel 4 is wanted; an answer of three inputs has 3 columns"):
            daq.open()
    assert line.lines == []


def test_a_daq_that_takes_one_channel_at_a_time_is_asked_for_each(daq_of):
    """As an oscilloscope, or Red Pitaya's slow inputs."""
    volts = {"AIN1?": "CH1 +1.50 V", "AIN2?": "CH2 +0.25 V", "AIN4?": "CH4 +0.75 V"}
    with TcpInstrument(volts.get) as line:
        daq = daq_of(line.resource, {"ask": "AIN{channel}?", "answer": r"CH\d (.*) V"})
        daq.open()
        reading = daq.read_block()
    assert line.lines == list(volts)
    assert (reading.supply_voltage_V, reading.reference_voltage_V, reading.load_cell_voltage_V) == (1.5, 0.25, 0.75)


@pytest.mark.parametrize("channel", ["{channel}", "{channel:02d}"])
def test_a_scanner_is_set_up_and_asked_channel_by_channel(daq_of, channel):
    """As Siglent's SDM3065X-SC and Fluke's Hydra, however the channel is written."""
    numbers = [channel.format(channel=number) for number in CHANNELS.values()]
    set_up = {"prepare": ["SCAN ON", f"CHAN {channel},ON,20V", "START"], "before_read": "TRIG", "clear_status": None}
    with TcpInstrument(lambda line: "0.25 VDC" if line.endswith("?") else None) as line:
        daq = daq_of(line.resource, {"ask": f"DATA {channel}?", "answer": "(.*) VDC"}, commands=set_up)
        daq.open()
        assert daq.read_block().load_cell_voltage_V == 0.25
    set_up = ["SCAN ON", *(f"CHAN {number},ON,20V" for number in numbers), "START"]
    assert line.lines == [*set_up, "TRIG", *(f"DATA {number}?" for number in numbers)]


def test_of_one_that_takes_one_channel_at_a_time_all_samples_are_averaged(daq_of):
    with TcpInstrument(lambda line: ",".join(["0.2", "0.3"] * 25)) as line:
        daq = daq_of(line.resource, "AIN{channel}?")
        daq.open()
        assert daq.read_block().load_cell_voltage_V == pytest.approx(0.25)


def test_a_decimal_comma_and_lines_that_nobody_asked_for_are_called_so(daq_of):
    read = {"ask": "r", "columns": 4, "separator": ";"}
    with SerialInstrument(lambda line: "1,5;0,25;0;0") as line:
        daq = daq_of(line.resource, read)
        daq.open()
        with pytest.raises(InstrumentLost, match="'1,5' has a decimal comma; a point is wanted"):
            daq.read_block()
        daq.open()
        line.say("1.5;0.25;0;0")
        deadline_s = time.monotonic() + 10.0
        while not daq._session._stream._waiting and time.monotonic() < deadline_s:
            time.sleep(0.001)
        with pytest.raises(InstrumentLost, match="without being asked: it speaks by itself"):
            daq.read_block()


class BeginsAnew:
    """A board at a pseudo-terminal that begins anew when its line is opened: what is said to it before that is lost."""

    BEGINS_s = 0.3

    def __init__(self):
        self._ours, theirs = os.openpty()
        for end in (self._ours, theirs):
            tty.setraw(end)
        self.resource = f"ASRL{os.ttyname(theirs)}::INSTR"
        os.close(theirs)  # so that it shows when somebody opens it
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _is_open(self):
        poll = select.poll()
        poll.register(self._ours, select.POLLIN)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def _serve(self):
        while not self._ended.wait(0.005):
            if self._is_open():
                time.sleep(self.BEGINS_s)
                while select.select([self._ours], [], [], 0.0)[0] and self._is_open():
                    os.read(self._ours, 4096)
                self._answer()

    def _answer(self):
        try:
            os.write(self._ours, b"\x00\xfcbench v3\r\n")
            while not self._ended.is_set():
                if select.select([self._ours], [], [], 0.05)[0]:
                    os.write(self._ours, b"board\r\n" if b"?" in os.read(self._ours, 4096) else b"1 2 3 4\r\n")
        except OSError:  # closed
            return

    def close(self):
        self._ended.set()
        self._thread.join()
        os.close(self._ours)


@pytest.fixture
def board():
    board = BeginsAnew()
    yield board
    board.close()


@pytest.mark.parametrize("pause_s", [0.0, 3 * BeginsAnew.BEGINS_s])
def test_a_board_that_begins_anew_is_left_its_time(daq_of, board, pause_s):
    read = {"ask": "r", "columns": 4, "separator": " "}
    entries = {"identity": "board", "answer_termination": "\r\n", "queries": {"read": read}}
    section = {**CHANNELS, "opening_pause": pause_s, "timeout": 5.0}
    daq = daq_of(board.resource, read, section, **entries)
    if pause_s:
        for _ in range(2):
            daq.open()
            assert daq.identity == "board"
            assert daq.read_block().load_cell_voltage_V == 4.0
            daq.close()
    else:
        with pytest.raises(InstrumentLost, match=r"does it begin anew when .* \(instruments.daq.opening_pause\)"):
            daq.open()
