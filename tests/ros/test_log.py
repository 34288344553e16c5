"""What the node says in its log: each event once, at its level, with what it read and what to do."""

import numpy as np
import pytest

from sma_actuator.actuator import AFTER_A_FAULT
from sma_actuator.base.signals import Mode, Status
from sma_actuator.driver import NOT_ASKED
from sma_actuator.ros.log import (
    ERROR,
    INFO,
    MOST_REFUSALS,
    NOTHING_KNOWN,
    WARNING,
    Events,
    PAUSE_s,
    RARELY_s,
    Refusals,
    REPEAT_s,
)
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.limits import LIMITS

_HELD = Status(Mode.HOLD, message="holding")


def _said(events, status, now_s=0.0):
    return list(events.of_status(status, now_s))


def test_on_and_off_are_each_said_once():
    events = Events()
    assert _said(events, Status(Mode.OFF)) == []
    assert _said(events, _HELD) == [(INFO, "the output is on; holding the wire where it is")]
    assert _said(events, _HELD) == []
    assert _said(events, Status(Mode.TRACKING)) == [(INFO, "following setpoints")]
    assert _said(events, Status(Mode.OFF)) == [(INFO, "the output is off")]


def test_a_latched_fault_is_an_error_with_what_it_read_and_what_to_do_and_its_clearing_is_said():
    events = Events()
    _said(events, _HELD)
    fault = Status(Mode.OFF, "open_wire", message=f"off: the wire is open (6 V and 0.001 A){AFTER_A_FAULT}")
    ((level, sentence),) = _said(events, fault)
    assert (level, sentence) == (ERROR, f"off: the wire is open (6 V and 0.001 A). {FAULTS['open_wire'].advice}")
    assert _said(events, fault) == []
    assert _said(events, Status(Mode.OFF)) == [
        (INFO, "the fault open_wire is cleared; the output stays off until ~/enable")
    ]


def test_a_lost_setpoint_is_a_warning_where_the_wire_is_held_and_an_error_where_it_goes_off():
    stale = {"fault": "setpoint_stale", "message": "the setpoint is lost (none for 1 s)"}
    events = Events()
    _said(events, _HELD)
    assert [level for level, _ in _said(events, Status(Mode.HOLD, **stale))] == [WARNING]
    assert [level for level, _ in _said(events, Status(Mode.OFF, **stale))] == [ERROR]


def test_a_limit_that_flickers_is_said_once_until_it_has_been_away_for_a_while():
    events = Events()
    _said(events, _HELD)
    unknown = Status(
        Mode.HOLD, limits=("temperature_derating",), values={"temperature_C": 194.0, "temperature_guessed_K": 60.0}
    )
    assert list(Events().of_status(unknown, 0.0))[-1] == (INFO, NOTHING_KNOWN)
    read = {"temperature_C": 61.0, "temperature_at_most_C": 163.21}
    hot = Status(Mode.HOLD, limits=("temperature_derating",), values=read)
    ((level, sentence),) = _said(events, hot, 1.0)
    assert level == WARNING
    assert (
        sentence == "limit: current limit lowered by temperature (163.2 °C is the hottest that it can be). "
        f"{LIMITS['temperature_derating'].advice}"
    )
    for tenth in range(11, 30):
        assert _said(events, _HELD if tenth % 2 else hot, tenth / 10.0) == []
    assert len(_said(events, hot, 3.0 + PAUSE_s)) == 1


def test_every_limit_and_passing_fault_is_said():
    for name in LIMITS:
        ((_, sentence),) = _said(Events(), Status(Mode.OFF, limits=(name,)))
        assert LIMITS[name].words in sentence
    for name in ("reading_not_finite", "estimate_invalid"):
        assert _said(Events(), Status(Mode.OFF, fault=name, message="words")) == [
            (WARNING, f"words. {FAULTS[name].advice}")
        ]


def test_there_is_something_to_do_about_every_fault_and_limit():
    for entry in (*FAULTS.values(), *LIMITS.values()):
        assert entry.advice[0].isupper() and entry.advice.endswith("."), entry.name
        until_back = getattr(entry, "until_back", False)
        assert ("~/clear_fault" in entry.advice) == (getattr(entry, "latches", False) and not until_back), entry.name
        assert ("answers again: ~/enable" in entry.advice) == until_back, entry.name


def test_instruments_lost_and_found_are_each_said_once_and_not_beside_the_fault_that_says_so():
    events = Events()
    assert list(events.of_instruments({}, "")) == []
    assert list(events.of_instruments({"daq": NOT_ASKED}, "")) == []  # before the first step
    lost = {"daq": "timed out", "supply": "refused"}
    assert list(events.of_instruments(lost, "daq_lost")) == [(ERROR, "the supply does not answer: refused")]
    assert list(events.of_instruments(lost, "daq_lost")) == []
    assert list(events.of_instruments({}, "daq_lost")) == [
        (INFO, "the daq answers again"),
        (INFO, "the supply answers again"),
    ]


class TestRefusals:
    @pytest.fixture
    def refusals(self):
        return Refusals()

    def test_one_does_not_hide_another(self, refusals):
        assert refusals.worth_saying("the setpoint is nan", 0.0) == "the setpoint is nan"
        assert refusals.worth_saying("it moves elbow", 0.0) == "it moves elbow"

    def test_the_same_with_other_numbers_is_said_once_a_second_and_counted(self, refusals):
        assert refusals.worth_saying("point 3 has -1.5e-3", 0.0) == "point 3 has -1.5e-3"
        assert refusals.worth_saying("point 4 has 17", 0.5) == ""
        assert refusals.worth_saying("point 5 has inf", 0.9) == ""
        assert refusals.worth_saying("point 6 has nan", REPEAT_s) == "point 6 has nan (2 more were not shown)"

    def test_what_goes_on_is_said_ever_more_rarely_and_at_once_after_a_pause(self, refusals):
        refused_s = [0.05 * number for number in range(20 * 3600)]
        said_s = [now_s for now_s in refused_s if refusals.worth_saying("the output is off", now_s)]
        assert said_s[:5] == pytest.approx([0.0, 1.0, 3.0, 7.0, 15.0], abs=0.1)
        assert np.diff(said_s).max() == pytest.approx(RARELY_s, abs=0.1) and len(said_s) < 3600 / RARELY_s + 8
        assert refusals.worth_saying("another", refused_s[-1] + 0.05) != ""
        assert refusals.worth_saying("the output is off", refused_s[-1] + PAUSE_s).startswith("the output is off")

    def test_a_flood_of_different_ones_is_bounded(self, refusals):
        words = ["".join(chr(97 + int(digit)) for digit in str(number)) for number in range(1000)]
        said = [word for word in words if refusals.worth_saying(word, 0.0)]
        assert said == words[:MOST_REFUSALS]


def test_a_setpoint_beyond_the_ends_is_told_both_of_them():
    ends = {"limited_setpoint_m": 0.6889e-3, "shortest_m": 0.1151e-3, "longest_m": 4.262e-3}
    beyond = Status(Mode.TRACKING, limits=("setpoint_range",), values=ends)
    _, (level, sentence) = _said(Events(), beyond)
    assert level == WARNING
    assert "what can be reached now (0.1151 to 4.262 mm). Ask for positions between" in sentence
