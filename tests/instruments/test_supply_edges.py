"""What a supply is told, word for word, where leaving one word out would leave the current on."""

import threading
import time

import pytest
from hanging import hanging
from stand_in_server import OPENED, ScpiStandIn

from sma_actuator.config import Config
from sma_actuator.instruments import (
    InstrumentError,
    InstrumentLost,
    InstrumentRefused,
    LimitsNotHeld,
    OutputStaysOn,
    WatchdogNotHeld,
    open_supply,
)
from sma_actuator.instruments.afterwards import OFF_ANSWERS
from sma_actuator.instruments.supply import Abilities


@pytest.fixture
def server():
    server = ScpiStandIn(OPENED)
    yield server
    server.close()


@pytest.fixture
def supply(server, make_config):
    def make(**changes):
        mapping = make_config(**{"instruments": {"supply": {"resource": server.resource}}, **changes})
        made.append(open_supply(Config.from_mapping(mapping)))
        return made[-1]

    made = []
    yield make
    for each in made:
        each.close()


def test_opening_says_off_before_it_asks_anything_and_programs_every_limit(supply, server):
    supply().open()
    said = [line for line in server.lines if "?" not in line]
    assert server.lines[0] == "OUTP OFF"
    assert server.lines.index("OUTP OFF") < server.lines.index("*IDN?")
    for line in (
        "OUTP OFF",
        "OUTP:PROT:CLE",
        "CURR 0.000000",
        "VOLT 6.0000",
        "VOLT:PROT 6.6000",
        "VOLT:PROT:STAT ON",
        "CURR:PROT 0.45000",
        "CURR:PROT:STAT ON",
        "OUTP:PROT:WDOG:DEL 1.000",
        "OUTP:PROT:WDOG ON",
    ):
        assert line in said
    assert "OUTP ON" not in said


def test_the_parameters_can_disarm_the_watchdog_and_then_it_is(supply, server):
    supply(**{"supply.watchdog_timeout": 0.0, "supply.allow_no_watchdog": True}).open()
    assert "OUTP:PROT:WDOG OFF" in server.lines
    assert "OUTP:PROT:WDOG ON" not in server.lines


@pytest.mark.parametrize(
    ("query", "reply", "refused"),
    [
        (":OUTP:PROT:WDOG:DEL?", "1.0", None),
        (":OUTP:PROT:WDOG:DEL?", "0.5", None),
        (":OUTP:PROT:WDOG:DEL?", "1.5", WatchdogNotHeld),
        (":OUTP:PROT:WDOG:DEL?", "0", WatchdogNotHeld),  # as of one that was switched off
        (":OUTP:PROT:WDOG:DEL?", "-1", WatchdogNotHeld),
        (":OUTP:PROT:WDOG:DEL?", "9.91E37", WatchdogNotHeld),
        (":OUTP:PROT:WDOG?", "0", WatchdogNotHeld),
        (":OUTP:PROT:WDOG:SESS?", "0", WatchdogNotHeld),
        (":VOLT?", "6.1", None),
        (":VOLT?", "6.2", LimitsNotHeld),
        (":VOLT?", "5.8", LimitsNotHeld),
        (":VOLT:PROT?", "20", LimitsNotHeld),
        (":CURR:PROT?", "0.5", LimitsNotHeld),
        (":CURR:PROT?", "9.9E37", LimitsNotHeld),
        (":CURR:PROT?", "9.91E37", LimitsNotHeld),
    ],
)
def test_what_was_programmed_is_asked_for_again_and_has_to_hold(supply, server, query, reply, refused):
    one = supply()
    one.open()
    one.check_settings()
    server.replies[query] = reply
    if refused is None:
        one.check_settings()
        return
    with pytest.raises(refused):
        one.check_settings()


def test_a_supply_that_refuses_its_configuration_is_told_off_last_and_given_up(supply, server):
    server.replies[":SYST:ERR?"] = '-222,"Data out of range"'
    one = supply()
    with pytest.raises(InstrumentRefused, match="refused its configuration"):
        one.open()
    assert server.heard("OUTP OFF", times=3)  # first, in its turn, and last
    assert [line for line in server.lines if line.startswith("OUTP ")][-1] == "OUTP OFF"
    with pytest.raises(InstrumentLost, match="not connected"):
        one.set_output(True)
    assert "OUTP ON" not in server.lines


def test_what_was_given_up_can_be_opened_by_another(supply, server, asked_once):
    first, second = supply(), supply()
    first.open()
    with pytest.raises(InstrumentError):
        second.open()
    first.close()
    assert server.heard("SYST:LOC")
    assert [line for line in server.lines if line.startswith(("OUTP ", "SYST:LOC"))][-2:] == ["OUTP OFF", "SYST:LOC"]
    second.open()


def test_a_trip_is_cleared_with_the_output_off(supply, server):
    one = supply()
    one.open()
    server.lines.clear()
    one.clear_trip()
    assert server.heard("OUTP:PROT:CLE")
    assert server.lines == ["OUTP OFF", "OUTP:PROT:CLE"]


def test_off_is_said_until_it_is_read_back_and_else_refused(supply, server):
    one = supply()
    one.open()
    server.lines.clear()
    server.replies[":OUTP?"] = "1"
    with pytest.raises(InstrumentRefused, match="answers that its output is on"):
        one.switch_off()
    assert server.lines.count("OUTP OFF") > 1
    assert not one.shut_down()
    server.replies[":OUTP?"] = "0"
    server.lines.clear()
    one.switch_off()
    assert server.lines == ["OUTP OFF", "CURR 0.000000", ":OUTP?"]
    assert one.shut_down()


@pytest.mark.parametrize(
    ("current_A", "passes"), [(0.0, True), (0.4, True), (0.40001, False), (-1e-9, False), (float("nan"), False)]
)
def test_nothing_but_zero_to_the_limit_is_sent(supply, server, current_A, passes):
    one = supply()
    one.open()
    server.lines.clear()
    if passes:
        one.set_current(current_A)
        assert server.heard(f"CURR {current_A:.6f}")
    else:
        with pytest.raises(InstrumentRefused, match=r"0 to supply\.max_current, 0\.4 A, is allowed"):
            one.set_current(current_A)
        assert server.lines == []


def test_a_supply_that_was_never_opened_is_told_nothing(supply, server):
    """It may be somebody else's."""
    assert not supply().shut_down(), "nobody has asked"
    assert server.lines == []


@pytest.mark.parametrize(
    ("abilities", "left"),
    [
        ({}, {"allow_no_watchdog", "allow_single_session", "allow_no_trips"}),
        ({"watchdog": True}, {"allow_shared_watchdog", "allow_no_trips"}),
        ({"watchdog": True, "watchdog_of_session": True}, {"allow_no_trips"}),
        ({"second_session": True}, {"allow_no_watchdog", "allow_no_trips"}),
        ({"over_voltage_trip": True}, {"allow_no_watchdog", "allow_single_session", "allow_no_trips"}),
        (
            {"over_voltage_trip": True, "over_current_trip": True, "watchdog": True, "watchdog_of_session": True},
            set(),
        ),
    ],
)
def test_what_a_supply_cannot_do_is_left_to_others(abilities, left):
    states = Abilities("it", **{"voltage_setting": True, **abilities}).unsafe_states()
    assert set(states) == left
    assert all(sentence.startswith("it ") for sentence in states.values())


@pytest.mark.parametrize(
    ("has", "lacks"), [("over_voltage_trip", "no over-current trip"), ("over_current_trip", "no over-voltage trip")]
)
def test_the_trip_that_is_missing_is_named_alone(has, lacks):
    sentence = Abilities("it", voltage_setting=True, **{has: True}).unsafe_states()["allow_no_trips"]
    assert f"it has {lacks} that can be read back, so" in sentence


def test_off_is_said_five_times_in_short_pauses(supply, server):
    one = supply()
    one.open()
    server.lines.clear()
    server.replies[":OUTP?"] = "1"
    began_s = time.monotonic()
    with pytest.raises(OutputStaysOn):
        one.switch_off()
    assert 0.09 < time.monotonic() - began_s < 3.0
    assert server.lines == ["OUTP OFF", "CURR 0.000000", ":OUTP?"] * 5


@pytest.mark.parametrize("timeout_s", [0.1, 0.4])
def test_shutting_down_takes_two_answers_whatever_answers(supply, server, timeout_s):
    one = supply(**{"instruments.supply.timeout": timeout_s})
    took_s = []
    for _ in range(3):
        server.replies[":OUTP?"] = "0"
        one.open()
        server.replies[":OUTP?"] = None  # no answer
        began_s = time.monotonic()
        assert not one.shut_down()
        took_s.append(time.monotonic() - began_s)
    assert timeout_s < min(took_s) < 2.0 * timeout_s + 0.4


def test_shutting_down_is_confirmed_on_the_session_that_is_there(supply, server):
    one = supply()
    assert one.identity == ""
    one.open()
    confirmed = []
    for _ in range(5):  # a machine that stands still loses it
        server.lines.clear()
        assert one.shut_down()
        confirmed.append(server.lines == ["OUTP OFF", "CURR 0.000000", ":OUTP?"])
        one.open()
    assert any(confirmed)


def test_a_supply_that_was_given_up_is_told_nothing_more(supply, server):
    one = supply()
    one.open()
    one.close()
    assert server.heard("SYST:LOC")
    said = len(server.lines)
    assert not one.shut_down()
    one.close()
    assert len(server.lines) == said


def test_one_that_was_opened_and_is_lost_stays_ours(supply, server, asked_once):
    """Nobody else may speak to it before it is off: the claim is kept until it is closed."""
    one, other = supply(), supply()
    one.open()
    server.replies["*IDN?"] = "somebody else"
    with pytest.raises(InstrumentRefused, match="says it is 'somebody else', which is no SMA Actuator virtual supply"):
        one.open()
    with pytest.raises(InstrumentRefused, match="another program on this computer"):
        other.open()
    server.replies["*IDN?"] = "SMA Actuator,Virtual Supply,7,stand-in"
    assert one.shut_down()
    one.close()
    other.open()


def test_one_that_is_opened_again_after_it_was_closed_is_ours_again(supply, server, asked_once):
    one, other = supply(), supply()
    one.open()
    one.close()
    one.open()
    with pytest.raises(InstrumentRefused, match="another program on this computer"):
        other.open()


def test_one_that_is_taken_is_waited_for_as_long_as_a_last_word_may_take(supply):
    supply().open()
    other = supply(**{"instruments.supply.timeout": 0.1})
    began_s = time.monotonic()
    with pytest.raises(InstrumentRefused, match="another program on this computer"):
        other.open()
    assert time.monotonic() - began_s >= OFF_ANSWERS * 0.1


def test_one_that_is_let_go_while_somebody_waits_for_it_is_opened(supply, monkeypatch):
    one, other = supply(), supply()
    one.open()
    sleep, waited = time.sleep, []

    def let_go(seconds):
        if threading.current_thread() is threading.main_thread() and not waited:
            waited.append(seconds)
            one.close()
        sleep(seconds)

    monkeypatch.setattr(time, "sleep", let_go)
    other.open()
    assert waited


def test_one_that_could_not_be_opened_is_free_for_others(supply, server):
    one, other = supply(), supply()
    server.replies["*IDN?"] = "somebody else"
    with pytest.raises(InstrumentRefused):
        one.open()
    server.replies["*IDN?"] = "SMA Actuator,Virtual Supply,7,stand-in"
    other.open()
    assert not one.shut_down(), "it is not ours"


def test_what_does_not_hold_is_told_off_and_given_up(supply, server):
    one = supply()
    one.open()
    server.lines.clear()
    server.replies[":VOLT?"] = "12"
    with pytest.raises(LimitsNotHeld):
        one.check_settings()
    assert server.heard("CURR 0.000000")
    assert [line for line in server.lines if "?" not in line] == ["OUTP OFF", "CURR 0.000000"]
    with pytest.raises(InstrumentLost, match="not connected"):
        one.set_output(True)


def test_nothing_is_checked_before_there_is_anything(supply, server):
    one = supply()
    one.check_settings()
    one.check_next_setting()
    assert server.lines == []


def test_a_session_that_hangs_in_another_thread_is_broken_and_a_second_one_speaks(supply, server):
    one = supply()
    took_s = []
    for _ in range(3):
        one.open()
        server.lines.clear()
        with hanging(one._session):
            wire = one._session._stream
            began_s = time.monotonic()
            assert one.shut_down()
            took_s.append(time.monotonic() - began_s)
            with pytest.raises(OSError):
                wire.receive(time.monotonic() + 60.0)  # both directions are ended
        assert server.heard("OUTP OFF", times=3), "blind, on the one that hangs, and twice on the other"
        assert server.heard("SYST:LOC", times=2), "for a lock that the one has left, and for people"
        assert server.lines.count(":OUTP?") == 1
    assert min(took_s) < 0.5


@pytest.mark.parametrize(
    ("on", "said"),
    [(False, "read back as off before, and does not say so again"), (True, "told to be off, not confirmed")],
)
def test_a_supply_that_goes_after_it_was_off_is_not_said_to_be_unconfirmed(supply, server, caplog, on, said):
    """`stop` had confirmed it, the supply was unplugged, and the node said both that it was not confirmed and was."""
    one = supply()
    one.open()
    one.switch_off()
    if on:
        one.set_output(True)
    server.close()
    assert not one.shut_down()
    (record,) = [record for record in caplog.records if "off" in record.message]
    assert said in record.message
