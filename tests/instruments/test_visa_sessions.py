"""Real pyvisa over TCP: to the virtual bench, and to a stand-in that can be made to misbehave."""

import contextlib
import os
import re
import select
import socket
import threading
import time

import pytest
import pyvisa
import yaml
from hanging import hanging
from hypothesis import given
from hypothesis import strategies as st
from stand_in_server import READ_BACK, SUPPLY, ScpiStandIn

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.server import background
from sma_actuator.config import Config
from sma_actuator.instruments import (
    InstrumentError,
    InstrumentLost,
    InstrumentRefused,
    LimitsNotHeld,
    WatchdogNotHeld,
    open_daq,
    open_supply,
)
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.instruments.dialect import FOLDER
from sma_actuator.instruments.scpi import ScpiSupply

SLOW_WATCHDOG_s = 60.0  #: no machine stands still for so long
SHORT_s = 0.2  #: where no answer is to come


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """On a fresh machine the bench's physics is compiled first: that takes longer than an instrument may."""
    VirtualBench.from_name("flexinol").advance(0.01)


@pytest.fixture
def bench(make_config):
    """(supply, daq, config) of a virtual bench over TCP."""
    with background(VirtualBench.from_name("flexinol")) as server:
        config = Config.from_mapping(
            make_config(
                instruments={
                    "supply": {"resource": f"TCPIP::127.0.0.1::{server.ports[0]['supply']}::SOCKET"},
                    "daq": {
                        "resource": f"TCPIP::127.0.0.1::{server.ports[0]['daq']}::SOCKET",
                        "lvdt_channel": 104,
                        "ambient_temperature_channel": 105,
                    },
                },
                **{"supply.watchdog_timeout": SLOW_WATCHDOG_s},
            )
        )
        supply, daq = open_supply(config), open_daq(config, MonotonicClock())
        yield supply, daq, config
        supply.close()
        daq.close()


def command(instrument, *lines):
    """Tell the bench something no real instrument understands."""
    instrument._session.tell(*lines)


def test_opening_leaves_the_output_off_and_every_limit_programmed(bench):
    supply, _, config = bench
    supply.open()
    state = supply.read_back()
    assert "Virtual Supply" in supply.identity
    assert (state.output_on, state.current_setting_A, state.tripped) == (False, 0.0, "")
    assert float(supply._session.ask("VOLT?")) == pytest.approx(config.supply.max_voltage)
    assert float(supply._session.ask("VOLT:PROT?")) == pytest.approx(1.1 * config.supply.max_voltage)
    assert float(supply._session.ask("CURR:PROT?")) == pytest.approx(config.supply.over_current_trip)
    assert supply._session.ask("OUTP:PROT:WDOG?") == "1"


def test_a_current_flows_and_is_measured_by_both_instruments(bench):
    supply, daq, _ = bench
    supply.open()
    daq.open()
    supply.set_current(0.1)
    supply.set_output(True)
    deadline_s = time.monotonic() + 60.0
    state, reading = supply.read_back(), daq.read_block()
    while abs(reading.reference_voltage_V - 0.1) > 2e-3 and time.monotonic() < deadline_s:
        # until a whole block of samples is younger than the current
        state, reading = supply.read_back(), daq.read_block()
    assert state.current_A == pytest.approx(0.1, abs=1e-3)
    assert reading.reference_voltage_V == pytest.approx(0.1, abs=2e-3)
    assert 4.0 < reading.supply_voltage_V / reading.reference_voltage_V - 1.25 < 6.0
    assert 0.004 < reading.lvdt_current_A < 0.020
    assert 15.0 < reading.ambient_temperature_C < 35.0


def test_shut_down_works_through_a_new_connection_when_the_old_one_is_dead(bench):
    supply, _, _ = bench
    supply.open()
    supply._session.tell("SYST:LOC")  # the lock would keep every other connection out
    supply.set_current(0.1)
    supply.set_output(True)
    supply._session.close()
    supply.shut_down()
    supply._session.open(lock=False)
    assert supply._session.ask("OUTP?") == "0"


@pytest.fixture
def locked(make_config):
    """(virtual bench, supply) with a current flowing and the instrument's exclusive lock taken."""
    virtual = VirtualBench.from_name("flexinol")
    with background(virtual) as server:
        resource = f"TCPIP::127.0.0.1::{server.ports[0]['supply']}::SOCKET"
        changes = {"instruments": {"supply": {"resource": resource}}, "supply.watchdog_timeout": SLOW_WATCHDOG_s}
        supply = open_supply(Config.from_mapping(make_config(**changes)))
        supply.open()
        supply.set_current(0.1)
        supply.set_output(True)
        assert supply._session.ask("SYST:LOCK:OWN?") == "SELF"
        assert supply.read_back().output_on
        yield virtual, supply
        supply.close()


def test_shut_down_switches_a_locked_supply_off_though_its_session_hangs_in_another_thread(locked):
    virtual, supply = locked
    with hanging(supply._session):
        supply.shut_down()
        assert (virtual.supply.output_on, virtual.supply.current_A) == (False, 0.0)


def test_shut_down_says_so_where_the_output_stays_on(stand_in, make_config, caplog):
    supply = opened(stand_in, make_config)
    stand_in.replies[":OUTP?"] = "1"  # whatever it is told
    supply.shut_down()
    assert "was told to switch off and answers that its output is on" in caplog.text


def test_a_tripped_protection_is_named_and_can_be_cleared(bench):
    supply, _, _ = bench
    supply.open()
    supply.set_current(0.1)
    supply.set_output(True)
    command(supply, "CURR:PROT 0.05")
    for _ in range(1000):
        state = supply.read_back()
        if state.tripped:
            break
    assert state.tripped == "OCP"
    assert not state.output_on
    command(supply, "CURR:PROT 0.45")
    supply.clear_trip()
    assert supply.read_back().tripped == ""


def test_a_watchdog_that_does_not_hold_is_refused(bench):
    supply, _, _ = bench
    supply.open()
    command(supply, "BENC:FAUL watchdog_dead,0")
    with pytest.raises(InstrumentRefused, match="its watchdog was armed with 60 s and does not read back so"):
        supply.open()
    with pytest.raises(InstrumentLost, match="not connected"):  # nobody can switch on what was refused
        supply.set_output(True)


@pytest.mark.parametrize(
    ("query", "words"),
    (
        (":VOLT?", "supply.max_voltage, 6 V: it reads back 20.0; it may want supply.over_voltage_trip further above"),
        (":VOLT:PROT?", "supply.over_voltage_trip, 6.6 V: it reads back 20.0; it may want supply.over_voltage_trip"),
        (":CURR:PROT?", "supply.over_current_trip, 0.45 A: it reads back 20.0; that may be beneath the least trip"),
    ),
)
def test_a_limit_that_the_supply_does_not_take_is_refused(stand_in, make_config, query, words):
    stand_in.replies[query] = "20.0"
    with pytest.raises(InstrumentRefused, match=f"does not hold {words}"):
        opened(stand_in, make_config)


@pytest.mark.parametrize("instrument", ("supply", "daq"))
def test_a_silent_instrument_is_lost_within_its_timeout_and_comes_back_by_opening(bench, instrument):
    supply, daq, _ = bench
    supply.open()
    daq.open()
    lost, ask, other = (supply, supply.read_back, daq) if instrument == "supply" else (daq, daq.read_block, supply)
    command(lost, f"BENC:FAUL {instrument}_silent")
    patient_s, lost._session._timeout_s = lost._session._timeout_s, SHORT_s
    with pytest.raises(InstrumentLost, match=f"{instrument} at .*no complete answer.* within 0.2 s"):
        ask()
    with pytest.raises(InstrumentLost, match="not connected"):
        ask()
    command(other, "BENC:FAUL:CLE")
    lost._session._timeout_s = patient_s
    lost.open()
    ask()


def test_a_hang_up_is_a_loss_not_a_crash(bench):
    supply, daq, _ = bench
    supply.open()
    daq.open()
    command(supply, "BENC:FAUL supply_hangup")
    with pytest.raises(InstrumentLost), contextlib.ExitStack():
        for _ in range(3):
            supply.read_back()


@pytest.mark.parametrize(
    ("change", "words"),
    (
        ({"instruments.supply.resource": "TCPIP::127.0.0.1::9::SOCKET"}, "supply at TCPIP::127.0.0.1::9::SOCKET"),
        ({"instruments.supply.resource": ""}, "instruments.supply.resource: is empty"),
        ({"instruments.supply.resource": "127.0.0.1:5025"}, "that is no VISA resource, as TCPIP::192.168.0.5::5025::"),
        ({"instruments.supply.resource": "/dev/ttyUSB0"}, "that is no VISA resource, as .* ASRL/dev/ttyUSB0::INSTR"),
        ({"instruments.supply.resource": "TCPIP::127.0.0.1::99999::SOCKET"}, "cannot be opened"),
        ({"supply.watchdog_timeout": 3700.0}, "supply.watchdog_timeout"),
    ),
)
def test_what_cannot_be_opened_is_refused_in_a_sentence(make_config, change, words):
    with pytest.raises((InstrumentError, ValueError), match=words):
        open_supply(Config.from_mapping(make_config(**change))).open()


def test_the_wrong_instrument_is_refused_by_what_it_says_it_is(bench, make_config):
    _, _daq, config = bench
    swapped = make_config(instruments={"supply": {"resource": config.instruments.daq.resource}})
    with pytest.raises(
        InstrumentRefused, match="says it is 'SMA Actuator,Virtual DAQ.*which is no SMA Actuator virtual supply"
    ):
        open_supply(Config.from_mapping(swapped)).open()


def test_a_supply_that_another_client_has_locked_is_refused_without_a_word_to_it(make_config, monkeypatch):
    def locked_elsewhere(self, timeout="default"):
        assert timeout == 0, "it is not waited for"
        raise pyvisa.VisaIOError(pyvisa.constants.StatusCode.error_resource_locked)

    monkeypatch.setattr(pyvisa.resources.SerialInstrument, "lock_excl", locked_elsewhere)
    ours, theirs = os.openpty()
    config = Config.from_mapping(
        make_config(instruments={"supply": {"resource": f"ASRL{os.ttyname(theirs)}::INSTR", "timeout": 0.2}})
    )
    with pytest.raises(InstrumentRefused, match="somebody else holds its VISA lock.*instruments.supply.exclusive_lock"):
        open_supply(config).open()
    assert not select.select([ours], [], [], 0.2)[0]
    assert not pyvisa.ResourceManager("@py").list_opened_resources(), "it was given back"
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize("quantity", ("supply_voltage", "reference_voltage", "load_cell"))
def test_a_daq_without_a_channel_that_is_needed_is_refused(bench, make_config, quantity):
    _, _, config = bench
    changes = {"instruments": {"daq": {"resource": config.instruments.daq.resource, f"{quantity}_channel": 0}}}
    with pytest.raises(InstrumentRefused, match=f"instruments.daq.{quantity}_channel: is 0"):
        open_daq(Config.from_mapping(make_config(**changes)), MonotonicClock()).open()


@pytest.mark.parametrize("reply", ("1.0,0.1", "1.0,0.1,0.5,1.0,0.1,0.5", "1.0,0.1,what", ""))
def test_a_block_with_a_wrong_number_of_readings_is_a_loss(make_config, reply):
    server = ScpiStandIn(
        {
            "*IDN?": "SMA Actuator,Virtual DAQ,7,stand-in",
            "SYST:ERR?": '0,"No error"',
            "READ:AVER?": "1,1,1",
            "FETC:AVER?": reply,
        }
    )
    daq = open_daq(
        Config.from_mapping(make_config(instruments={"daq": {"resource": server.resource}})), MonotonicClock()
    )
    try:
        daq.open()
        with pytest.raises(InstrumentLost, match="is not an answer to that"):
            daq.read_block()
    finally:
        daq.close()
        server.close()


@pytest.fixture
def stand_in():
    server = ScpiStandIn(SUPPLY)
    server.users = []
    yield server
    for user in server.users:
        user.close()
    server.close()


def opened(server, make_config):
    supply = open_supply(Config.from_mapping(make_config(instruments={"supply": {"resource": server.resource}})))
    server.users.append(supply)
    supply.open()
    return supply


def test_a_late_reply_is_never_taken_for_the_answer_to_the_next_question(stand_in, make_config):
    supply = opened(stand_in, make_config)
    chain = READ_BACK
    stand_in.silent_on, stand_in.replies[chain] = chain, "0.9;1;9.9;0.9;OCP"
    patient_s, supply._session._timeout_s = supply._session._timeout_s, SHORT_s
    with pytest.raises(InstrumentLost, match="no complete answer"):
        supply.read_back()
    stand_in.silent_on, stand_in.replies[chain] = None, "0.1;1;0.65;0.1;NONE"
    stand_in.release.set()  # now the late reply goes out
    supply._session._timeout_s = patient_s
    supply.open()
    assert supply.read_back().current_setting_A == 0.1


@pytest.mark.parametrize("reply", ("0.1;1;0.65;0.1", "what;1;0.65;0.1;NONE", "0.1;maybe;0.65;0.1;NONE", ""))
def test_a_garbled_reply_is_a_loss_that_quotes_it(stand_in, make_config, reply):
    supply = opened(stand_in, make_config)
    stand_in.replies[READ_BACK] = reply
    with pytest.raises(InstrumentLost, match="is not an answer to that"):
        supply.read_back()


def test_shut_down_does_not_wait_for_a_query_that_hangs_in_another_thread(stand_in, make_config):
    supply = opened(stand_in, make_config)
    stand_in.silent_on = READ_BACK

    def hang():
        with contextlib.suppress(InstrumentLost):
            supply.read_back()

    thread = threading.Thread(target=hang)
    thread.start()
    before = len(stand_in.lines)
    while stand_in.silent_on not in stand_in.lines[before - 1 :]:
        pass
    supply.shut_down()
    assert {"OUTP OFF", "CURR 0.000000"} <= set(stand_in.lines[stand_in.lines.index(stand_in.silent_on) :])
    stand_in.release.set()
    thread.join(10.0)
    assert not thread.is_alive()


def test_shut_down_never_raises_even_where_nothing_answers(make_config):
    supply = open_supply(
        Config.from_mapping(make_config(instruments={"supply": {"resource": "TCPIP::127.0.0.1::9::SOCKET"}}))
    )
    supply.shut_down()
    supply.shut_down()
    supply.close()


class Recorded:
    """A session that only notes what it is told."""

    name = "supply"

    def __init__(self):
        self.lines = []

    def tell(self, *lines):
        self.lines += lines


@given(
    current_A=st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-0.1, 1.0)),
    max_current_A=st.floats(0.01, 0.45),
    at_the_limit=st.booleans(),
    dialect=st.sampled_from(("virtual_bench_supply", "rigol_dp800", "keithley_2260b", "keysight_n6700")),
)
def test_no_number_beyond_the_limit_is_ever_sent(make_config, current_A, max_current_A, at_the_limit, dialect):
    changes = {
        "supply.max_current": max_current_A,
        "supply.bias_current": 0.005,
        "instruments": {"supply": {"dialect": dialect}},
    }
    supply = ScpiSupply(Config.from_mapping(make_config(**changes)))
    supply._session = Recorded()
    current_A = max_current_A if at_the_limit else current_A
    with contextlib.suppress(InstrumentRefused):
        supply.set_current(current_A)
    for line in supply._session.lines:
        sent_A = float(line.split()[1].split(",")[0])
        assert current_A - 1.01e-4 <= sent_A <= max_current_A
    assert bool(supply._session.lines) == (0.0 <= current_A <= max_current_A)


class TestBystander:
    """Somebody who asks, and commands nothing."""

    @pytest.fixture
    def asked(self, make_config):
        """``asked(dialect)``: the virtual supply, left with a current by a driver that died, while another client
        asks."""
        ended = threading.Event()
        with contextlib.ExitStack() as stack:

            def make(dialect):
                virtual = VirtualBench.from_name("flexinol")
                server = stack.enter_context(background(virtual))
                resource = f"TCPIP::127.0.0.1::{server.ports[0]['supply']}::SOCKET"
                changes = {"instruments": {"supply": {"resource": resource, "dialect": dialect}}}
                changes["supply.watchdog_timeout"] = 0.5
                changes["supply.allow_shared_watchdog"] = True
                supply = open_supply(Config.from_mapping(make_config(**changes)))
                stack.callback(supply.close)
                supply.open()
                supply.set_current(0.1)
                supply.set_output(True)
                bystander = stack.enter_context(
                    socket.create_connection(("127.0.0.1", server.ports[0]["supply"]), 10.0)
                )
                stream = stack.enter_context(bystander.makefile("rw", newline="\n"))

                def ask():
                    while not ended.wait(0.05):
                        stream.write("*IDN?\n")
                        stream.flush()
                        stream.readline()

                thread = threading.Thread(target=ask)
                thread.start()
                stack.callback(thread.join, 10.0)
                stack.callback(ended.set)
                return virtual, supply

            yield make

    def test_does_not_feed_a_watchdog_that_is_tied_to_a_session(self, asked):
        virtual, _ = asked("virtual_bench_supply")
        deadline_s = time.monotonic() + 60.0
        while virtual.supply.trips != ["WDOG"]:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
        assert not virtual.supply.output_on

    def test_feeds_one_that_is_not(self, asked):
        virtual, _ = asked("virtual_bench_supply_shared")
        deadline_s, first_s = time.monotonic() + 60.0, virtual.supply.last_command_s
        while virtual.supply.last_command_s < first_s + 1.0:  # twice its delay
            assert time.monotonic() < deadline_s
            time.sleep(0.01)


@pytest.mark.parametrize("dialect", ["virtual_bench_supply", "virtual_bench_supply_shared"])
def test_a_second_program_that_wants_the_supply_does_not_say_a_word_to_it(stand_in, make_config, dialect, asked_once):
    changes = {"instruments": {"supply": {"resource": stand_in.resource, "dialect": dialect}}}
    changes["supply.allow_shared_watchdog"] = True
    stand_in.replies[":OUTP:PROT:WDOG:SESS?"] = "1"
    one, other = (open_supply(Config.from_mapping(make_config(**changes))) for _ in range(2))
    one.open()
    said = len(stand_in.lines)
    with pytest.raises(InstrumentRefused, match="another program on this computer"):
        other.open()
    assert not other.shut_down(), "nobody has asked"
    other.close()
    assert stand_in.lines[said:] == []
    one.close()
    other.open()
    other.close()


def test_after_a_reset_behind_the_connection_everything_is_found_and_programmed_again(bench):
    supply, _, _ = bench
    supply.open()
    supply.check_settings()
    supply._session.tell("*RST")
    with pytest.raises(LimitsNotHeld, match="does not hold supply.max_voltage"):
        supply.check_settings()
    with pytest.raises(InstrumentLost, match="not connected"):
        supply.set_output(True)
    supply.open()
    supply.check_settings()
    supply._session.tell("OUTP:PROT:WDOG OFF")
    with pytest.raises(WatchdogNotHeld, match="does not read back so"):
        for _ in range(4):
            supply.check_next_setting()


#: What a family cannot do, the parameter that acknowledges it, and what to wire up.
UNSAFE = {
    "rigol_dp800": (
        ("allow_no_watchdog", "has no communication watchdog.*wire a relay"),
        ("allow_single_session", "is not known to take a second session.*wire a switch"),
    ),
    "keysight_n6700": (
        ("allow_shared_watchdog", "watchdog that anybody's words feed.*a network of its own, or wire a relay"),
        ("allow_no_trips", "has no over-current trip that can be read back.*wire a fuse"),
    ),
    "without_trips": (("allow_no_trips", "no over-voltage trip .* and no over-current trip .*wire a fuse"),),
}


@pytest.mark.parametrize("dialect", UNSAFE)
def test_what_cannot_be_made_safe_is_said_with_what_to_wire_up_and_must_be_acknowledged(
    make_config, dialect, caplog, tmp_path
):
    replies = {"SYST:ERR?": '0,"No error"', ":SYST:ERR?": '0,"No error"', "OUTP:PROT:WDOG?": "1"}
    replies |= {":OUTP:PROT:WDOG?": "1", ":OUTP:PROT:WDOG:SESS?": "1", "OUTP:PROT:WDOG:DEL?": "1"}
    replies |= {":OUTP:PROT:WDOG:DEL?": "1", ":VOLT?": "6.0"}
    replies["*IDN?"] = "RIGOL TECHNOLOGIES,DP832 and Keysight Technologies,N6700C and SMA Actuator,Virtual Supply"
    server = ScpiStandIn(replies)
    name = dialect
    if dialect == "without_trips":
        document = yaml.safe_load((FOLDER / "virtual_bench_supply.yaml").read_text())
        del document["commands"]["set_over_voltage"], document["queries"]["over_voltage_setting"]
        del document["queries"]["over_current_setting"]
        (path := tmp_path / "mine.yaml").write_text(yaml.safe_dump(document))
        name = str(path)
    changes = {"instruments": {"supply": {"resource": server.resource, "dialect": name}}}
    try:
        for parameter, words in UNSAFE[dialect]:
            supply = open_supply(Config.from_mapping(make_config(**changes)))
            with pytest.raises(InstrumentRefused, match=f"{words}.*supply.{parameter}: true acknowledges that"):
                supply.open()
            changes[f"supply.{parameter}"] = True
            if parameter == "allow_no_watchdog":
                changes["supply.watchdog_timeout"] = 0.0
        supply = open_supply(Config.from_mapping(make_config(**changes)))
        supply.open()
        for _, words in UNSAFE[dialect]:
            assert re.search(words, caplog.text)
        caplog.clear()
        supply.open()
        supply.close()  # as a node does that waits for its DAQ
        supply.open()
        assert caplog.text == "", "once is enough"
    finally:
        supply.close()
        server.close()
