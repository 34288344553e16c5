"""One connection, by the worst that can be at its other end: everything is bounded, and off is heard."""

import contextlib
import os
import re
import select
import socket
import threading
import time
import tty
from unittest.mock import Mock

import pytest
import pyvisa
from tcp_line import TcpInstrument

from sma_actuator.base.parameters import ConfigError
from sma_actuator.instruments import (
    InstrumentLate,
    InstrumentLost,
    InstrumentRefused,
    InstrumentUnreachable,
    byte_streams,
)
from sma_actuator.instruments import session as session_module
from sma_actuator.instruments.byte_streams import Manner, SocketStream
from sma_actuator.instruments.patterns import Pattern
from sma_actuator.instruments.session import Session

TIMEOUT_s = 0.4  #: where an answer must not come
PATIENT_s = 20.0  #: where it must
#: A machine that is busy elsewhere may be late by this much; what hangs is later by orders.
SLACK_s = 2.0


class Peer:
    """One side of a connection that the test speaks for."""

    def __init__(self):
        self._server = socket.create_server(("127.0.0.1", 0))
        self.resource = f"TCPIP::127.0.0.1::{self._server.getsockname()[1]}::SOCKET"
        self.connection = None
        self._stop = threading.Event()

    def accept(self):
        if self.connection is not None:
            self.connection.close()
        self._server.settimeout(10.0)
        self.connection, _ = self._server.accept()
        self.connection.settimeout(10.0)
        return self.connection

    def read_to_the_end(self):
        """All that comes until the other side has ended."""
        out = b""
        with contextlib.suppress(ConnectionResetError):
            while data := self.connection.recv(65536):
                out += data
        return out

    def answer(self, data):
        """Say this once a question has come."""
        connection = self.connection

        def work():
            heard = b""
            with contextlib.suppress(OSError):
                while b"?" not in heard:
                    heard += connection.recv(4096)
                connection.sendall(data)

        threading.Thread(target=work, daemon=True).start()

    def keep_saying(self, data, every_s):
        """From the first question on, until the test is over, or the connection."""
        connection = self.connection

        def work():
            with contextlib.suppress(OSError):
                connection.recv(4096)
                while not self._stop.wait(every_s):
                    connection.sendall(data)

        threading.Thread(target=work, daemon=True).start()

    def close(self):
        self._stop.set()
        self._server.close()
        if self.connection is not None:
            self.connection.close()


@pytest.fixture
def peer():
    peer = Peer()
    yield peer
    peer.close()


@pytest.fixture
def session(peer):
    session = Session("supply", peer.resource, Manner(), TIMEOUT_s, ["OUTP OFF", "CURR 0"])
    session.open()
    peer.accept()
    yield session
    session.close()


def test_off_is_the_first_and_the_last_that_is_said(peer, session):
    with pytest.raises(InstrumentLost, match="no complete answer to '\\*IDN\\?' within 0.4 s"):
        session.ask("*IDN?")
    assert peer.read_to_the_end() == b"OUTP OFF\nCURR 0\n*IDN?\nOUTP OFF\nCURR 0\n"


def test_a_lock_is_asked_for_only_where_it_is_wanted(peer, session, monkeypatch):
    connect, asked = session._connect, []
    monkeypatch.setattr(session, "_connect", lambda lock: asked.append(lock) or connect(False))
    session.open()
    session.open(lock=True)
    assert asked == [False, True]


def test_what_is_said_at_the_beginning_is_forgotten_only_where_it_is_left_time_for_it(session, monkeypatch):
    forgot = []
    monkeypatch.setattr(session, "_do", lambda what, _: forgot.append(what))
    session.let_begin(0.0)
    session.let_begin(0.001)
    assert forgot == ["its beginning"]


@pytest.mark.parametrize(
    ("role", "resource", "may"),
    [
        ("daq", "ASRL/dev/ttyACM0::INSTR", "(instruments.daq.opening_pause)?"),
        ("supply", "ASRL/dev/ttyACM0::INSTR", "(which a supply must not: docs/dialects.md)?"),
        ("daq", "TCPIP::h::1::SOCKET", ""),
    ],
)
def test_only_one_on_a_serial_line_may_begin_anew_when_that_is_opened(role, resource, may):
    said = Session(role, resource, Manner(), TIMEOUT_s).may_begin_anew
    assert said.endswith(may) and ("begin anew" in said) is bool(may)


@pytest.mark.parametrize(("data", "every_s"), [(b"1", 0.02), (b"1" * 65536, 0.0)], ids=["a byte", "a flood"])
def test_an_answer_without_an_end_is_given_up_in_time(peer, session, data, every_s):
    peer.keep_saying(data, every_s)
    start_s = time.monotonic()
    with pytest.raises(InstrumentLost):
        for _ in range(3):
            session.ask("*IDN?")
    assert time.monotonic() - start_s < TIMEOUT_s + SLACK_s


def test_an_answer_without_an_end_is_given_up_though_the_wall_clock_steps_back(peer, session, monkeypatch):
    start_s = time.time()
    monkeypatch.setattr(time, "time", lambda: start_s - 3600.0)
    peer.keep_saying(b"1", 0.02)
    before_s = time.monotonic()
    with pytest.raises(InstrumentLost, match="no complete answer"):
        session.ask("*IDN?")
    assert time.monotonic() - before_s < TIMEOUT_s + SLACK_s


def test_what_came_of_an_answer_without_an_end_is_shown(peer):
    session = Session("supply", peer.resource, Manner("\r\n", "\r\n"), TIMEOUT_s)
    session.open()
    peer.accept()
    peer.answer(b"1.5\n")
    with pytest.raises(InstrumentLost, match=r"'1.5' came, without the end of a line, '\\r\\n'"):
        session.ask("CURR?")
    session.close()


def test_an_answer_may_come_in_pieces_that_part_the_end_of_the_line(peer):
    session = Session("supply", peer.resource, Manner("\r\n", "\r\n"), PATIENT_s)
    session.open()
    connection = peer.accept()

    def answer():
        heard = b""
        while b"?\r\n" not in heard:
            heard += connection.recv(4096)
        for piece in (b"1.", b"5", b"\r", b"\n"):
            connection.sendall(piece)
            time.sleep(0.01)

    thread = threading.Thread(target=answer)
    thread.start()
    assert session.ask("CURR?") == "1.5"
    thread.join(10.0)
    session.close()


def test_a_port_that_greets_is_said_to_be_for_people(peer, session):
    peer.connection.sendall(b"Welcome to the supply\r\n")
    assert select.select([session._stream._socket], [], [], 10.0)[0]
    with pytest.raises(InstrumentLost, match=r"said 'Welcome to the supply' without being asked: .* a port for people"):
        session.ask("*IDN?")


def test_an_answer_that_a_gateway_has_kept_is_called_out_of_step_and_the_next_connection_is_right(peer, session):
    """It took its question from the connection before, whose time was up, and gives its answer to this one."""
    peer.answer(b"Maker\n")
    assert session.introduce("*IDN?", Pattern("Maker", whole=False)) == "Maker"
    session.open()
    peer.accept()
    peer.answer(b"0.034\nMaker\n")
    with pytest.raises(InstrumentLost, match=r"said '0.034' without being asked: [a-z ]* are out of step$"):
        session.introduce("*IDN?", Pattern("Maker", whole=False))
    assert peer.read_to_the_end().endswith(b"OUTP OFF\nCURR 0\n")
    session.open()
    peer.accept()
    peer.answer(b"Maker\n")
    assert session.introduce("*IDN?", Pattern("Maker", whole=False)) == "Maker"


def test_a_greeting_of_two_lines_is_not_taken_for_the_answers_to_the_off_lines(peer, session):
    """As of a terminal server, "press any key": an acknowledgement is the same to each."""
    session._timeout_s = PATIENT_s
    peer.connection.sendall(b"\nport 3 ready\n")
    peer.answer(b"MAKER,1\n")
    said = r"said '; port 3 ready' without being asked: .* a port for people.* as to 'CURR 0' before, put .*: '' into"
    with pytest.raises(InstrumentLost, match=said):
        session.introduce("*IDN?", Pattern("MAKER", whole=False))


def test_one_that_answers_its_off_lines_is_left_switched_off(peer, session):
    session._timeout_s = PATIENT_s
    peer.answer(b"OK\nOK\nMAKER,1\n")
    with pytest.raises(InstrumentRefused, match=r"it answers commands \('OK' to 'OUTP OFF'\): put"):
        session.introduce("*IDN?", Pattern("MAKER", whole=False))
    assert peer.read_to_the_end().endswith(b"OUTP OFF\nCURR 0\n")


def test_one_whose_only_off_line_is_answered_is_told_by_which_word(peer):
    session = Session("supply", peer.resource, Manner(), PATIENT_s, ["OUTP OFF"])
    session.open()
    peer.accept()
    peer.answer(b"OK\nMAKER,1\n")
    said = r"it answers commands \('OK' to 'OUTP OFF'\): put acknowledgement: 'OK' into its dialect"
    with pytest.raises(InstrumentRefused, match=said):
        session.introduce("*IDN?", Pattern("MAKER", whole=False))


def test_readings_that_an_earlier_connection_asked_for_are_no_answer_to_who_it_is(peer):
    """Nothing was told before, as of a DAQ on a serial line whose scan outlasts the program that asked for it."""
    session = Session("daq", peer.resource, Manner(), PATIENT_s, [])
    session.open()
    peer.accept()
    peer.answer(b"+1.0E-03,+2.0E-03\nMAKER,1\n")
    assert session.introduce("*IDN?", Pattern("MAKER", whole=False)) == "MAKER,1"
    peer.answer(b"0\n")
    assert session.ask("SYST:ERR?") == "0"
    session.close()


def test_one_that_greets_and_repeats_what_it_hears_is_said_to_repeat_it(peer, session):
    session._timeout_s = PATIENT_s
    peer.answer(b"Welcome\n*IDN?\n")
    with pytest.raises(InstrumentLost, match=r"repeats what it is asked, '\*IDN\?'"):
        session.introduce("*IDN?", Pattern("MAKER", whole=False))


def test_who_has_said_its_name_is_not_taken_for_one_that_answers_its_off_lines(peer, session):
    session._timeout_s = PATIENT_s
    peer.answer(b"MAKER,1\n")
    assert session.introduce("*IDN?", Pattern("MAKER", whole=False)) == "MAKER,1"
    peer.connection.sendall(b"2\n")
    assert select.select([session._stream._socket], [], [], 10.0)[0]
    with pytest.raises(InstrumentLost, match="said '2' without being asked: its answers and our .* are out of step$"):
        session.ask("OUTP?")


def test_who_shares_a_line_speaks_in_one_manner(session):
    session.must_fit(Manner())
    with pytest.raises(ConfigError, match=r"has the same resource as instruments\.supply"):
        session.must_fit(Manner(pause_s=1.0))


def test_of_several_lines_of_which_none_is_its_name_the_first_is_its_answer(peer):
    session = Session("supply", peer.resource, Manner(), PATIENT_s)
    session.open()
    peer.accept()
    peer.answer(b"OTHER,1\nready\n")
    assert session.introduce("*IDN?", Pattern("MAKER", whole=False)) == "OTHER,1"
    session.close()


def test_what_comes_unasked_later_is_no_greeting(peer, session):
    session._timeout_s = PATIENT_s
    for _ in range(2):  # also on the next connection
        peer.answer(b"1\n")
        assert session.ask("OUTP?") == "1"
        peer.connection.sendall(b"2\n")
        assert select.select([session._stream._socket], [], [], 10.0)[0]
        with pytest.raises(
            InstrumentLost, match="said '2' without being asked: its answers and our questions are out of step$"
        ):
            session.ask("OUTP?")
        session.open()
        peer.accept()


def test_a_port_that_repeats_what_it_hears_is_said_to_be_for_people(peer, session):
    peer.answer(b"*IDN?\r\n")
    with pytest.raises(InstrumentLost, match=r"repeats what it is asked, '\*IDN\?': its echo is on, or .*"):
        session.ask("*IDN?")


def test_an_echo_whose_lines_end_otherwise_than_answers_do_is_called_an_echo(peer):
    """All that it repeats then comes as one line."""
    session = Session("supply", peer.resource, Manner(read_termination="\r\n"), PATIENT_s)
    session.open()
    peer.accept()
    session.tell("OUTP OFF")
    peer.answer(b"OUTP OFF\n*IDN?\nMaker,1234\r\n")
    with pytest.raises(InstrumentLost, match=r"repeats what it is asked, '\*IDN\?': its echo is on"):
        session.introduce("*IDN?", Pattern("Maker", whole=False))


def test_one_that_never_answered_may_want_other_ends_of_lines_and_one_that_did_does_not(peer, session):
    words = r"want more than instruments\.\w+\.timeout; do its lines end otherwise than with '\\n' .*write_termination"
    words += r"\), or want time between them .*command_pause"
    with pytest.raises(InstrumentLost, match=words):
        session.ask("*IDN?")
    session.open()
    peer.accept()
    peer.answer(b"Maker\n")
    assert session.ask("*IDN?") == "Maker"
    with pytest.raises(InstrumentLost, match=r"no complete answer to 'OUTP\?' within 0.4 s$"):
        session.ask("OUTP?")
    session.open()
    peer.accept()
    with pytest.raises(InstrumentLost, match=r"no complete answer to '\*IDN\?' within 0.4 s$"):
        session.ask("*IDN?")


def test_a_pattern_is_shown_as_it_stands_in_the_dialect(peer, session):
    peer.answer(b"ISET=1\n")
    pattern = re.compile(r"I (\d+)A")

    def read(reply):
        raise ValueError(f"'{reply}' is not like '{pattern.pattern}'")

    with pytest.raises(InstrumentLost, match=re.escape(r"'ISET=1' is not like 'I (\d+)A'")):
        session.ask_for("ISET?", read)


def test_a_connection_that_is_closed_after_each_answer_is_lost_and_not_used_again(peer):
    session = Session("supply", peer.resource, Manner(), PATIENT_s)
    session.open()
    peer.accept()
    peer.answer(b"1\n")
    assert session.ask("OUTP?") == "1"
    peer.connection.shutdown(socket.SHUT_RDWR)
    with pytest.raises(InstrumentLost, match="the connection broke at 'CURR\\?'"):
        session.ask("CURR?")
    with pytest.raises(InstrumentLost, match="not connected"):
        session.tell("OUTP ON")


def test_an_answer_may_not_be_longer_than_there_is_sense_in(peer, session, monkeypatch):
    monkeypatch.setattr(session_module, "LONGEST_ANSWER", 1000)
    peer.answer(b"1" * 5000)
    with pytest.raises(InstrumentLost, match="has no end within 1000 bytes"):
        session.ask("*IDN?")


def test_a_side_that_reads_nothing_holds_nobody_up(peer, session):
    start_s = time.monotonic()
    with pytest.raises(InstrumentLost, match="no complete answer to 'CURR"):
        for _ in range(1000):
            session.tell("CURR " + 100_000 * "0")
    assert time.monotonic() - start_s < TIMEOUT_s + SLACK_s + 3.0


def test_off_does_not_wait_for_long_for_a_side_that_reads_nothing(session):
    session._stream.close()
    session._stream = full = Full()
    session.say_off()
    assert 0.0 < full.waited_s < 0.2


class Full:
    """A connection that takes nothing before a deadline."""

    def __init__(self):
        self.waited_s, self.sent = 0.0, b""

    def send(self, data, deadline_s):
        self.waited_s = deadline_s - time.monotonic()
        self.sent += data
        raise TimeoutError

    def close(self):
        """Nothing to close."""


def test_off_begins_a_line_of_its_own_where_one_was_begun_and_not_ended(session):
    session._stream.close()
    session._stream = full = Full()
    with pytest.raises(InstrumentLost, match="no complete answer to 'CURR 0.1'"):
        session.tell("CURR 0.1")
    assert full.sent == b"CURR 0.1\n" + b"\nOUTP OFF\nCURR 0\n"


def test_off_that_cannot_be_said_is_no_failure(session):
    session._stream.close()
    for error in (TimeoutError, OSError, pyvisa.Error):
        session._stream = full = Full()
        full.send = raising(error)
        session.say_off()
    session._stream = None
    session.say_off()


def raising(error):
    def send(data, deadline_s):
        raise error

    return send


def test_what_was_not_asked_for_ends_the_connection_before_the_next_question(peer, session):
    peer.connection.sendall(b"1\n2\n")
    with pytest.raises(InstrumentLost, match=r"said '1\\n2' without being asked"):
        while True:  # until it has arrived
            session.ask("CURR?")


@pytest.mark.parametrize(
    "reply", [b"\x001", b"\x1b[2J1", b"1\r1"], ids=["NUL", "a terminal's command", "half a line end"]
)
def test_an_answer_that_is_no_text_is_none_and_is_shown_harmless(peer, session, reply):
    peer.answer(reply + b"\n")
    with pytest.raises(InstrumentLost, match="which is not an answer to that") as error:
        session.ask("CURR?")
    assert str(error.value).isprintable()


def test_two_lines_for_one_question_end_the_connection(peer, session):
    peer.answer(b"1\n1\n")
    with pytest.raises(InstrumentLost, match="answered 'CURR\\?' with more than one line: '1', '1'"):
        session.ask("CURR?")


def test_an_empty_answer_is_none(peer, session):
    peer.answer(b"\n")
    with pytest.raises(InstrumentLost, match="answered '' to 'OUTP\\?', which is not an answer to that"):
        session.ask("OUTP?")


def test_a_transaction_has_one_deadline_for_all_its_questions(peer, session):
    connection = peer.connection  # the next one is answered by itself

    def answer():
        with contextlib.suppress(OSError):
            while data := connection.recv(4096):
                if b"?" in data:
                    connection.sendall(b"1\n")

    threading.Thread(target=answer, daemon=True).start()
    session._timeout_s = PATIENT_s
    with pytest.raises(InstrumentLost, match="no complete answer"), session.within(TIMEOUT_s):
        assert session.ask("CURR?") == "1"
        time.sleep(TIMEOUT_s)
        session.ask("VOLT?")
    session.open()
    peer.accept()
    peer.answer(b"1\n")
    assert session.ask("VOLT?") == "1", "it ends with the transaction"


def test_the_answers_of_a_transaction_before_one_that_does_not_come_are_counted(peer, session):
    peer.answer(b"1\n")
    with session.within(), pytest.raises(InstrumentLost, match="; with the 1 answers before it that took"):
        assert session.ask("OUTP?") == "1"
        session.ask("CURR?")


def test_before_the_first_question_of_a_transaction_nothing_was_answered(session):
    with session.within(), pytest.raises(InstrumentLost, match="no complete answer to 'OUTP\\?'") as lost:
        session.ask("OUTP?")
    assert "answers before it" not in str(lost.value)


def test_an_answer_without_an_end_has_its_length(peer):
    """A text, and a byte that is none, at once and in pieces; a byte too many is out of step, one too few late."""
    session = Session("supply", peer.resource, Manner(fixed={"V?": (5, False), "S?": (2, True)}), TIMEOUT_s)
    session.open()
    peer.accept()
    peer.answer(b"12.34")
    assert session.ask("V?") == "12.34"
    peer.answer(b"\n\x90")
    assert session.ask("S?") == "0x0a90"
    peer.answer(b"12.3")
    with pytest.raises(InstrumentLost, match=r"'12.3' came, 4 of 5 bytes \(length or bytes, in its dialect\)"):
        session.ask("V?")
    session.open()
    peer.accept()
    peer.answer(b"12.34K")
    with pytest.raises(InstrumentLost, match="answered 'V\\?' with more than one line: '12.34', 'K'"):
        session.ask("V?")


@pytest.mark.parametrize("end", ["", "\n"])
def test_the_first_line_on_a_new_connection_keeps_its_distance(peer, end):
    """It is off, and right behind the last of the connection before it would be lost, or one line with that."""
    session = Session("supply", peer.resource, Manner(end, pause_s=TIMEOUT_s), PATIENT_s, ["OUT0"])
    began_s = time.monotonic()
    session.open()
    peer.accept()
    assert peer.connection.recv(100) == f"OUT0{end}".encode() and time.monotonic() - began_s >= TIMEOUT_s
    session.close()


def test_an_instrument_that_takes_its_time_for_each_line_is_opened():
    """Each line is done well within the time for an answer; all that are told at once are not."""
    with TcpInstrument(lambda line: "0" if line.endswith("?") else None, slow_s=TIMEOUT_s / 4) as slow:
        session = Session("supply", slow.resource, Manner(), TIMEOUT_s)
        session.open()
        with session.within(PATIENT_s, line_by_line=True):
            session.tell(*["CURR 0"] * 6)
            assert session.ask("SYST:ERR?") == "0"
        session.tell(*["CURR 0"] * 6)
        with pytest.raises(InstrumentLost, match=r"no complete answer to 'SYST:ERR\?' within 0.4 s"):
            session.ask("SYST:ERR?")


def test_a_late_answer_is_waited_for_as_long_as_it_may_take_and_no_longer(peer):
    session = Session("supply", peer.resource, Manner(), PATIENT_s)
    session.open()
    peer.accept()
    session.patience_s = TIMEOUT_s
    with session.within(0.01), pytest.raises(InstrumentLate):
        session.ask("OUTP?")
    began_s = time.monotonic()
    with pytest.raises(InstrumentLost, match=f"no complete answer to 'OUTP\\?', {TIMEOUT_s:g} s after it was asked"):
        session.ask("OUTP?")
    assert time.monotonic() - began_s < TIMEOUT_s + SLACK_s


def test_a_late_answer_is_heard_once_though_there_is_no_time_left_for_the_next_question(peer, session, monkeypatch):
    session.patience_s = PATIENT_s
    with pytest.raises(InstrumentLate):
        session.ask("OUTP?")
    heard = b""
    while b"OUTP?\n" not in heard:
        heard += peer.connection.recv(4096)
    peer.connection.sendall(b"1\n")
    with monkeypatch.context() as patched, pytest.raises(InstrumentLate, match="no time"):
        patched.setattr(session, "_put", Mock(side_effect=InstrumentLate("no time", 0.0)))
        session.ask("OUTP?")
    peer.answer(b"0\n")
    assert session.ask("OUTP?") == "0"


def test_of_lines_whose_acknowledgement_does_not_come_the_first_is_named(peer):
    session = Session("supply", peer.resource, Manner(acknowledgement=Pattern("OK")), TIMEOUT_s, ["OUTP OFF", "CURR 0"])
    session.open()
    peer.accept()
    with pytest.raises(InstrumentLost, match="no complete answer to 'OUTP OFF', where acknowledgement 'OK' was wanted"):
        session.ask("OUTP?")


def test_one_that_refuses_a_command_is_left_switched_off(peer):
    session = Session("supply", peer.resource, Manner(acknowledgement=Pattern("OK")), PATIENT_s, ["OUTP OFF"])
    session.open()
    connection = peer.accept()

    def refuse():
        connection.sendall(b"OK\n")
        heard = b""
        while b"OUTP ON\n" not in heard:
            heard += connection.recv(4096)
        connection.sendall(b"ERR\n")

    thread = threading.Thread(target=refuse)
    thread.start()
    with pytest.raises(InstrumentRefused, match="answered 'ERR' to 'OUTP ON'"):
        session.tell("OUTP ON")
    thread.join(PATIENT_s)
    assert peer.read_to_the_end() == b"OUTP OFF\n"


def test_the_pause_before_the_next_command_is_counted_from_the_answer(peer):
    pause_s = 0.2
    session = Session("supply", peer.resource, Manner(pause_s=pause_s), PATIENT_s)
    session.open()
    connection, times_s = peer.accept(), []

    def answer():
        connection.recv(4096)
        time.sleep(1.5 * pause_s)  # as one that measures for so long
        times_s.append(time.monotonic())
        connection.sendall(b"1.5\n")
        connection.recv(4096)
        times_s.append(time.monotonic())

    thread = threading.Thread(target=answer)
    thread.start()
    assert session.ask("CURR?") == "1.5"
    session.tell("CURR 1")
    thread.join(PATIENT_s)
    session.close()
    assert times_s[1] - times_s[0] >= pause_s


def test_a_host_that_does_not_answer_is_given_up_in_time():
    # A listener whose queue is full drops what comes: nobody answers, as at an address without a host.
    server = socket.create_server(("127.0.0.1", 0), backlog=0)
    address = server.getsockname()
    waiting = []
    for _ in range(8):
        waiting.append(socket.socket())
        waiting[-1].setblocking(False)
        waiting[-1].connect_ex(address)
    session = Session("daq", f"TCPIP::127.0.0.1::{address[1]}::SOCKET", Manner(), TIMEOUT_s)
    start_s = time.monotonic()
    with pytest.raises(InstrumentUnreachable, match="cannot be opened"):
        session.open()
    assert time.monotonic() - start_s < TIMEOUT_s + SLACK_s
    for other in (server, *waiting):
        other.close()


@pytest.mark.parametrize(
    ("port", "words"),
    [
        (0, "there is no port 0"),
        (1, "nothing listens there; is it switched on"),
        (65535, "nothing listens there"),
        (65536, "there is no port 65536"),
    ],
)
def test_a_port_where_nobody_is_says_so(port, words):
    session = Session("daq", f"TCPIP::127.0.0.1::{port}::SOCKET", Manner(), PATIENT_s)
    with pytest.raises(InstrumentUnreachable, match=words):
        session.open()


def test_of_several_addresses_the_first_that_answers_is_taken(peer):
    """As of a name with an IPv6 address beside the one where the instrument is."""
    session = Session("daq", peer.resource, Manner(), PATIENT_s)
    port = int(peer.resource.split("::")[2])
    session._addresses = [
        (socket.AF_INET, socket.SOCK_STREAM, 0, "", (host, number))
        for host, number in (("127.0.0.1", 1), ("127.0.0.1", port), ("127.0.0.1", 1))
    ]
    session.open()
    peer.accept()
    session.close()
    session._addresses = []
    with pytest.raises(OSError, match="it has no address"):
        SocketStream([], time.monotonic() + 1.0)


def test_a_deadline_that_has_passed_is_not_waited_for(session):
    for passed_s in (1e-6, 0.5, 100.0):
        with pytest.raises(TimeoutError):
            session._stream.receive(time.monotonic() - passed_s)


def test_what_an_instrument_said_is_shown_short_enough_for_a_sentence(peer, session):
    session._timeout_s = PATIENT_s
    for said, shown in ((b"?" * 80, "'" + "[?]" * 80 + "'"), (b"?" * 81, "'" + "[?]" * 77 + "…'")):
        session.open()
        peer.accept()
        peer.answer(said + b"\nmore\n")
        with pytest.raises(InstrumentLost, match=f"more than one line: {shown}, 'more'"):
            session.ask("CURR?")


def test_a_connection_is_ended_and_not_broken_though_words_are_unread(peer, session, monkeypatch):
    """A reset could overtake the off that was said last."""
    monkeypatch.setattr(byte_streams, "_PIECE", 1000)
    peer.connection.sendall(b"1" * 10_000)
    assert select.select([session._stream._socket], [], [], 10.0)[0]
    session.give_up("a test")
    heard = b""
    while data := peer.connection.recv(65536):
        heard += data
    assert heard == b"OUTP OFF\nCURR 0\n" * 2


def test_opening_again_ends_the_connection_before(peer, session):
    before = session._stream
    session.open()
    assert before._socket.fileno() == -1
    assert peer.read_to_the_end() == b"OUTP OFF\nCURR 0\n"


def test_what_is_closed_is_closed_at_once(session):
    wire = session._stream
    session.close()
    assert wire._socket.fileno() == -1


def test_a_second_session_asks_no_name_server_again(peer, session, monkeypatch):
    def slow(*_, **__):
        raise AssertionError("asked again")

    monkeypatch.setattr(socket, "getaddrinfo", slow)
    beside = session.beside()
    beside.open()
    peer.accept()
    beside.close()
    assert peer.read_to_the_end() == b"OUTP OFF\nCURR 0\n"
    session.open()


def test_a_query_does_not_wait_for_the_acknowledgement_of_what_was_told_before(session):
    assert session._stream._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_a_connection_that_cannot_be_closed_is_given_up_all_the_same(session, monkeypatch):
    def broken():
        raise ZeroDivisionError

    wire = session._stream
    monkeypatch.setattr(wire, "close", broken)
    session.close()
    with pytest.raises(InstrumentLost, match="not connected"):
        session.tell("OUTP ON")
    wire._socket.close()


@pytest.mark.parametrize("host", ("127.0.0.1", "127.1", "LocalHost"))
def test_one_program_alone_speaks_to_a_claimed_instrument_however_its_host_is_written(peer, host):
    resources = (peer.resource, peer.resource.replace("127.0.0.1", host))
    one, other = (Session("supply", resource, Manner(), TIMEOUT_s) for resource in resources)
    claim = one.claim("why")
    with pytest.raises(InstrumentRefused, match="another program on this computer.*speaks to it") as refused:
        other.claim("why")
    where = refused.value.__cause__.__traceback__
    while where.tb_next is not None:
        where = where.tb_next
    assert where.tb_frame.f_locals["self"]._socket.fileno() == -1, "what could not be had is given back"
    claim.release()
    other.claim("why").release()


def test_a_host_of_two_kinds_of_addresses_is_claimed_by_that_which_most_have(peer, monkeypatch):
    found = socket.getaddrinfo
    kinds = ((socket.AF_INET6, ("::1", 0, 0, 0)), (socket.AF_INET, ("127.0.0.1", 0)))
    both = [(family, socket.SOCK_STREAM, 6, "", address) for family, address in kinds]
    monkeypatch.setattr(
        socket, "getaddrinfo", lambda host, *more, **how: both if host == "psu.lab" else found(host, *more, **how)
    )
    resources = (peer.resource.replace("127.0.0.1", host) for host in ("psu.lab", "127.0.0.1", "127.0.0.2"))
    named, same, another = (Session("supply", resource, Manner(), TIMEOUT_s) for resource in resources)
    claims = [named.claim("why"), another.claim("why")]
    with pytest.raises(InstrumentRefused, match="another program on this computer"):
        same.claim("why")
    for claim in claims:
        claim.release()


@pytest.mark.parametrize(
    "resource", ("TCPIP::no.such.host.invalid::5025::SOCKET", f"TCPIP::{'x' * 70}::INSTR", "ASRL1::INSTR", "anything")
)
def test_what_has_no_address_is_claimed_by_its_name(resource):
    one, other = (Session("supply", resource, Manner(), TIMEOUT_s) for _ in range(2))
    claim = one.claim("why")
    with pytest.raises(InstrumentRefused, match="another program on this computer"):
        other.claim("why")
    claim.release()


def test_a_serial_port_without_a_path_is_claimed_in_capitals_or_not():
    one, other = (Session("supply", f"ASRL{port}::INSTR", Manner(), TIMEOUT_s) for port in ("COM3", "com3"))
    claim = one.claim("why")
    with pytest.raises(InstrumentRefused, match="another program on this computer"):
        other.claim("why")
    claim.release()


def test_a_resource_that_visa_does_not_find_cannot_be_opened(monkeypatch):
    def nothing(*_):
        raise pyvisa.VisaIOError(pyvisa.constants.StatusCode.error_resource_not_found)

    monkeypatch.setattr(session_module, "VisaStream", nothing)
    with pytest.raises(
        InstrumentUnreachable, match="daq at USB0::1::2::3::INSTR: cannot be opened .*is it switched on"
    ):
        Session("daq", "USB0::1::2::3::INSTR", Manner(), PATIENT_s).open()


class TestSerial:
    """Another class of resource: a serial line, by pyvisa itself, over a pseudo-terminal."""

    @pytest.fixture
    def line(self):
        ours, theirs = os.openpty()
        tty.setraw(ours)
        tty.setraw(theirs)
        session = Session("supply", f"ASRL{os.ttyname(theirs)}::INSTR", Manner(), PATIENT_s, ["OUTP OFF"])
        session.open()
        yield ours, session
        session.close()
        os.close(ours)
        os.close(theirs)

    def test_an_answer_is_the_answer(self, line):
        ours, session = line
        heard = []

        def answer():
            while b"?\n" not in b"".join(heard) and select.select([ours], [], [], SLACK_s)[0]:
                heard.append(os.read(ours, 100))
            os.write(ours, b"12.5\n")

        thread = threading.Thread(target=answer)
        thread.start()
        assert session.ask("CURR?") == "12.5"
        thread.join(10.0)
        assert b"".join(heard) == b"OUTP OFF\nCURR?\n"

    def test_a_line_that_is_silent_is_given_up_in_time(self, line):
        _, session = line
        session._timeout_s = TIMEOUT_s
        start_s = time.monotonic()
        with pytest.raises(
            InstrumentLost, match=r"no complete answer to 'CURR\?' within 0.4 s; is .*baud_rate, 9600, right"
        ):
            session.ask("CURR?")
        assert time.monotonic() - start_s < TIMEOUT_s + SLACK_s

    def test_a_line_that_breaks_is_lost(self, line):
        _, session = line
        session._stream._visa.close()
        with pytest.raises(InstrumentLost, match=r"the connection broke at 'CURR\?'"):
            session.ask("CURR?")

    def test_what_is_cut_is_told_off_and_cannot_be_used_any_more(self, line):
        ours, session = line
        wire = session._stream
        session.cut()
        with pytest.raises((pyvisa.Error, OSError)):
            wire.receive(time.monotonic() + 60.0)
        heard = b""
        while heard.count(b"OUTP OFF\n") < 2:  # first and last
            assert select.select([ours], [], [], 10.0)[0], heard
            heard += os.read(ours, 100)

    def test_an_answer_without_an_end_is_given_up_in_time_by_the_monotonic_clock(self, line, monkeypatch):
        ours, session = line
        stop = threading.Event()

        def trickle():
            while not stop.wait(0.02):
                os.write(ours, b"1")

        wall_s = time.time()
        monkeypatch.setattr(time, "time", lambda: wall_s - 3600.0)
        session._timeout_s = TIMEOUT_s
        thread = threading.Thread(target=trickle)
        thread.start()
        start_s = time.monotonic()
        with pytest.raises(InstrumentLost, match="no complete answer"):
            session.ask("CURR?")
        lasted_s = time.monotonic() - start_s
        stop.set()
        thread.join(10.0)
        assert lasted_s < TIMEOUT_s + SLACK_s
        heard = b""
        while not heard.endswith(b"CURR?\nOUTP OFF\n"):  # a terminal passes on in pieces
            assert select.select([ours], [], [], 10.0)[0], heard
            heard += os.read(ours, 100)
