"""What a supply is told, word for word, where leaving one word out would leave the current on."""

import pytest
from stand_in_server import ScpiStandIn

from sma_actuator.config import Config
from sma_actuator.instruments import (
    InstrumentError,
    InstrumentLost,
    InstrumentRefused,
    LimitsNotHeld,
    WatchdogNotHeld,
    open_supply,
)


@pytest.fixture
def server():
    server = ScpiStandIn(
        {
            "*IDN?": "SMA Actuator,Virtual Supply,7,stand-in",
            ":SYST:ERR?": '0,"No error"',
            ":OUTP:PROT:WDOG?": "1",
            ":OUTP:PROT:WDOG:SESS?": "1",
            ":OUTP:PROT:WDOG:DEL?": "1.0",
            ":OUTP?": "0",
            ":VOLT?": "6.0",
            ":VOLT:PROT?": "6.6",
            ":CURR:PROT?": "0.45",
        }
    )
    yield server
    server.close()


@pytest.fixture
def supply(server, make_config):
    def make(**changes):
        mapping = make_config(instruments={"supply": {"resource": server.resource}}, **changes)
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


def test_what_was_given_up_can_be_opened_by_another(supply, server):
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
    assert supply().shut_down()
    assert server.lines == []
