"""Instruments that half-answer: in other numbers, with errors, late by one, with a queue of errors that never ends."""

import contextlib
import math

import pytest
import yaml
from stand_in_server import READ_BACK, SUPPLY, ScpiStandIn

from sma_actuator.config import Config
from sma_actuator.instruments import (
    InstrumentError,
    InstrumentLost,
    InstrumentRefused,
    LimitsNotHeld,
    OutputStaysOn,
    WatchdogNotHeld,
    open_daq,
    open_supply,
)
from sma_actuator.instruments.dialect import FOLDER
from sma_actuator.instruments.phrases import number
from sma_actuator.instruments.session import Session

NAN, INF = math.nan, math.inf
DAQ = {"*IDN?": "SMA Actuator,Virtual DAQ,7,stand-in", "SYST:ERR?": '0,"No error"', "READ:AVER?": "1,1,1"}


class Clock:
    def now_s(self):
        return 12.5


@pytest.fixture
def serve():
    with contextlib.ExitStack() as stack:

        def serve(replies):
            server = ScpiStandIn(replies)
            stack.callback(server.close)
            return server

        yield serve


@pytest.fixture
def supply(serve, make_config, tmp_path):
    """``supply(dialect_changes, **parameters)``: (supply, its stand-in), not open yet."""
    made = []

    def make(change=lambda document: None, **parameters):
        server = serve(SUPPLY)
        document = yaml.safe_load((FOLDER / "virtual_bench_supply.yaml").read_text())
        change(document)
        (tmp_path / "mine.yaml").write_text(yaml.safe_dump(document, sort_keys=False))
        section = {"supply": {"resource": server.resource, "dialect": str(tmp_path / "mine.yaml")}}
        made.append(open_supply(Config.from_mapping(make_config(**{"instruments": section, **parameters}))))
        return made[-1], server

    yield make
    for each in made:
        each.close()


@pytest.fixture
def daq(serve, make_config):
    made = []

    def make(section=None, **parameters):
        server = serve(DAQ)
        changes = {"instruments": {"daq": {"resource": server.resource, **(section or {})}}, **parameters}
        made.append(open_daq(Config.from_mapping(make_config(**changes)), Clock()))
        return made[-1], server

    yield make
    for each in made:
        each.close()


def test_opening_has_the_time_of_thirty_answers_and_a_reading_that_of_one(supply, daq, monkeypatch):
    times_s = []

    @contextlib.contextmanager
    def within(self, timeout_s=None, line_by_line=False):
        times_s.append((timeout_s, line_by_line))
        yield

    monkeypatch.setattr(Session, "within", within)
    (one, _), (other, other_server) = supply(), daq()
    one.open()
    other.open()
    assert [each for each in times_s if each[0] is not None] == [(300.0, True), (300.0, True)]
    other_server.replies["FETC:AVER?"] = "1,2,3"
    for ask in (one.read_back, one.switch_off, other.read_block):
        times_s.clear()
        ask()
        assert times_s == [(None, False)]


@pytest.mark.parametrize(
    ("reply", "value"),
    [
        ("1", 1.0),
        (" +1.234E+00 ", 1.234),
        ("-1e-3", -1e-3),
        ("9.89E37", 9.89e37),
        ("9.9E37", INF),
        ("+9.90000000E+37", INF),
        ("-9.9E37", -INF),
        ("9.91E37", NAN),
        ("-9.91E37", NAN),
        ("9.91E38", NAN),
        ("NAN", NAN),
        ("INF", INF),
    ],
)
def test_a_number_may_be_written_in_any_of_scpis_ways(reply, value):
    assert number(reply) == pytest.approx(value, nan_ok=True)


NO_NUMBERS = ["", "1.234E+00A", "1,234", "1.2 V", "OVLD", "ERROR", "--", "1_0", "0x1", "1.0\x00"]


@pytest.mark.parametrize("reply", NO_NUMBERS)
def test_what_is_no_number_is_none(reply):
    with pytest.raises(ValueError):
        number(reply)


class TestSupply:
    @pytest.mark.parametrize("reply", [reply for reply in NO_NUMBERS if "\x00" not in reply])
    @pytest.mark.parametrize("place", [0, 2, 3])
    def test_a_read_back_that_is_no_number_is_a_loss_that_quotes_it(self, supply, place, reply):
        one, server = supply()
        one.open()
        parts = server.replies[READ_BACK].split(";")
        parts[place] = reply
        server.replies[READ_BACK] = ";".join(parts)
        with pytest.raises(InstrumentLost, match="which is not an answer to that"):
            one.read_back()

    def test_what_is_not_measured_is_nan(self, supply):
        one, server = supply()
        one.open()
        server.replies[READ_BACK] = "+1.000000E-01;ON;9.91E37;-9.9E37;NONE"
        state = one.read_back()
        assert (state.current_setting_A, state.output_on, state.current_A) == (0.1, True, -INF)
        assert math.isnan(state.voltage_V) and math.isnan(state.time_s)

    @pytest.mark.parametrize("reply", ["NONE", "0", '"none"', "OVP", '"OVP,OCP"'])
    def test_a_trip_is_named_as_the_supply_names_it(self, supply, reply):
        one, server = supply()
        one.open()
        server.replies[READ_BACK] = f"0;0;0;0;{reply}"
        assert one.read_back().tripped == reply.strip('"').replace("NONE", "").replace("none", "").replace("0", "")

    def test_an_answer_without_its_trip_says_of_none_that_it_has_not_tripped(self, supply):
        one, server = supply()
        one.open()
        server.replies[READ_BACK] = "0.1;1;0.65;0.1;"
        with pytest.raises(InstrumentLost, match="which is not an answer to that"):
            one.read_back()

    def test_trips_that_are_asked_for_one_by_one_are_named_together(self, supply):
        trips = {"OVP": ":VOLT:PROT:TRIP?", "OCP": ":CURR:PROT:TRIP?"}
        one, server = supply(lambda document: document.update(trips=trips, chained_queries=False))
        one.open()
        server.replies |= {":CURR?": "0.1", ":MEAS:VOLT?": "0.65", ":MEAS:CURR?": "0.1"}
        for ovp, ocp, words in (("0", "0", ""), ("1", "0", "OVP"), ("0", "1", "OCP"), ("1", "1", "OVP,OCP")):
            server.replies |= {":VOLT:PROT:TRIP?": ovp, ":CURR:PROT:TRIP?": ocp}
            assert one.read_back().tripped == words

    @pytest.mark.parametrize("reply", ["0", "+0", '0,"No error"', '+0, "No error"'])
    def test_no_error_may_be_said_in_several_ways(self, supply, reply):
        one, server = supply()
        server.replies[":SYST:ERR?"] = reply
        one.open()

    @pytest.mark.parametrize("reply", ['-350,"Queue overflow"', '+100,"Command error"', "1"])
    def test_a_queue_of_errors_that_never_ends_refuses_the_supply(self, supply, reply):
        one, server = supply()
        server.replies[":SYST:ERR?"] = reply
        for _ in range(2):
            with pytest.raises(
                InstrumentRefused, match="refused its configuration: .*; is the dialect 'mine' the right"
            ):
                one.open()
        assert "OUTP ON" not in server.lines

    def test_of_such_a_queue_that_nothing_clears_twenty_errors_are_taken_for_others(self, supply):
        one, server = supply(lambda document: document["commands"].update(clear_status=None))
        server.replies[":SYST:ERR?"] = '-350,"Queue overflow"'
        with pytest.raises(InstrumentRefused, match="refused its configuration: -350"):
            one.open()
        assert server.lines.count(":SYST:ERR?") == 20 + 1 + 20  # and as many before it is asked which line it was

    def test_the_line_that_a_supply_refuses_is_named(self, supply):
        one, server = supply(lambda document: document["commands"].update(set_current=":CURR {value:.4f}"))
        refused = []
        server.replies[":CURR 0.0000"] = lambda: refused.append('-222,"Data out of range"')
        server.replies[":SYST:ERR?"] = lambda: refused.pop(0) if refused else '0,"No error"'
        with pytest.raises(InstrumentRefused, match="-222,\"Data out of range\" to ':CURR 0.0000'; is the dialect"):
            one.open()
        assert ":OUTP ON" not in server.lines

    def test_a_refusal_that_does_not_come_again_is_told_as_it_was_said(self, supply):
        one, server = supply()
        said = ['-222,"Data out of range"']
        server.replies[":SYST:ERR?"] = lambda: said.pop(0) if said else '0,"No error"'
        with pytest.raises(InstrumentRefused, match='refused its configuration: -222,"Data out of range"; is the'):
            one.open()

    def test_errors_of_others_are_read_away_until_there_is_none(self, supply):
        one, server = supply(lambda document: document["commands"].update(clear_status=None))
        queue = ['-113,"Undefined header"', '-1,"Of others"', '1,"Of others"']
        server.replies[":SYST:ERR?"] = lambda: queue.pop(0) if queue else '0,"No error"'
        one.open()
        assert server.lines.count(":SYST:ERR?") == 4 + 1

    @pytest.mark.parametrize("reply", ["No error", '"0"', "0.5"])
    def test_an_error_without_a_number_is_no_answer(self, supply, reply):
        one, server = supply()
        server.replies[":SYST:ERR?"] = reply
        with pytest.raises(InstrumentLost, match="to ':SYST:ERR\\?', which is not an answer to that"):
            one.open()

    @pytest.mark.parametrize("said", ["No Error.", "Undefined Header."])
    def test_one_that_says_errors_in_words_is_believed_by_its_word_for_none(self, supply, said):
        words = {"ask": ":SYST:ERR?", "none": r"No Error\."}
        one, server = supply(lambda document: document["queries"].update(error=words))
        server.replies[":SYST:ERR?"] = said
        with pytest.raises(InstrumentRefused, match=said) if "Undefined" in said else contextlib.nullcontext():
            one.open()

    def test_an_answer_in_another_shape_says_what_is_wrong_with_it_and_where_that_is_mended(self, supply):
        one, server = supply()
        server.replies[":VOLT?"] = "8.000V"
        with pytest.raises(InstrumentLost, match="'8.000V' is not a number; its dialect says how to read it: answer"):
            one.open()

    def test_one_that_says_who_it_is_and_errors_on_all_else_is_lost_and_off_was_said(self, supply):
        one, server = supply(lambda document: document["queries"].pop("error"))
        server.replies |= {query: '-113,"Undefined header"' for query in SUPPLY if query != "*IDN?"}
        with pytest.raises(InstrumentLost, match="answered '-113,\"Undefined header\"' to ':OUTP\\?'"):
            one.open()
        assert server.heard("OUTP OFF", times=3)
        assert "OUTP ON" not in server.lines

    def test_answers_that_are_late_by_one_are_refused(self, supply, serve):
        """As of a queue that outlives its connection: each answer belongs to the question before."""
        one, server = supply()
        answer, before = server._answer, ["0.1"]

        def late(line):
            reply = answer(line)
            if reply is None:
                return None
            before.append(reply)
            return before.pop(0)

        server._answer = late
        for _ in range(4):
            with pytest.raises(InstrumentError):
                one.open()
        assert "OUTP ON" not in server.lines

    def test_one_that_is_still_on_after_opening_is_refused(self, supply):
        one, server = supply()
        server.replies[":OUTP?"] = "1"
        with pytest.raises(OutputStaysOn):
            one.open()

    @pytest.mark.parametrize(
        ("found", "holds"), [("6.119", True), ("5.881", True), ("6.121", False), ("5.879", False), ("nan", False)]
    )
    def test_a_limit_may_be_off_by_the_supplies_resolution(self, supply, found, holds):
        one, server = supply()
        server.replies[":VOLT?"] = found
        if holds:
            one.open()
            return
        with pytest.raises(LimitsNotHeld, match=f"does not hold supply.max_voltage, 6 V: it reads back {found}"):
            one.open()

    @pytest.mark.parametrize(("watchdog_s", "fits"), [(0.5, True), (2.0, True), (0.499, False), (2.001, False)])
    def test_a_watchdog_has_a_range(self, supply, watchdog_s, fits):
        one, server = supply(
            lambda document: document.update(watchdog_range_s=[0.5, 2]), **{"supply.watchdog_timeout": watchdog_s}
        )
        server.replies[":OUTP:PROT:WDOG:DEL?"] = str(watchdog_s)
        if fits:
            one.open()
            return
        with pytest.raises(InstrumentRefused, match=f"watchdog_timeout: {watchdog_s:g} s; .* can do 0.5 to 2 s"):
            one.open()

    @pytest.mark.parametrize(
        ("found_s", "holds"), [("2", True), ("2.0009", True), ("2.002", False), ("0.001", True), ("0", False)]
    )
    def test_a_watchdog_may_be_slower_by_its_step(self, supply, found_s, holds):
        one, server = supply(lambda document: document.update(watchdog_step_s=1))
        server.replies[":OUTP:PROT:WDOG:DEL?"] = found_s
        if holds:
            one.open()
            return
        with pytest.raises(WatchdogNotHeld, match="was armed with 1 s and does not read back so"):
            one.open()

    @pytest.mark.parametrize("query", [":OUTP:PROT:WDOG?", ":OUTP:PROT:WDOG:SESS?", ":OUTP:PROT:WDOG:DEL?"])
    def test_a_watchdog_that_answers_nonsense_is_a_loss(self, supply, query):
        one, server = supply()
        server.replies[query] = "maybe"
        with pytest.raises(InstrumentLost, match="maybe.* which is not an answer to that"):
            one.open()

    @pytest.mark.parametrize("query", [":VOLT?", ":VOLT:PROT?", ":CURR:PROT?"])
    def test_a_limit_that_answers_nonsense_is_a_loss(self, supply, query):
        one, server = supply()
        server.replies[query] = "maybe"
        with pytest.raises(InstrumentLost, match="'maybe' to .* which is not an answer to that"):
            one.open()

    @pytest.mark.parametrize("query", [":VOLT:PROT:STAT?", ":CURR:PROT:STAT?"])
    def test_a_protection_that_is_switched_off_does_not_hold(self, supply, query):
        one, server = supply()
        one.open()
        server.replies[query] = "0"
        with pytest.raises(LimitsNotHeld, match="does not hold .*trip.*: that protection is switched off"):
            one.check_settings()
        with pytest.raises(LimitsNotHeld, match="that protection is switched off"):
            one.open()

    @pytest.mark.parametrize(
        ("group", "name", "lacks"),
        [
            ("commands", "set_over_voltage", "no over-voltage trip"),
            ("queries", "over_voltage_setting", "no over-voltage trip"),
            ("commands", "set_over_current", "no over-current trip"),
            ("queries", "over_current_setting", "no over-current trip"),
        ],
    )
    def test_a_trip_that_is_not_programmed_or_not_read_back_is_none(self, supply, group, name, lacks):
        one, server = supply(lambda document: document[group].pop(name))
        with pytest.raises(InstrumentRefused, match=f"{lacks} that can be read back.*supply.allow_no_trips: true"):
            one.open()
        assert "OUTP ON" not in server.lines

    def test_a_watchdog_in_the_dialect_is_one_alone_where_it_is_wanted(self, supply):
        def without(document):
            for name in [name for group in ("commands", "queries") for name in document[group] if "watchdog" in name]:
                document["commands"].pop(name, None)
                document["queries"].pop(name, None)

        one, server = supply(without, **{"supply.allow_no_watchdog": True, "supply.watchdog_timeout": 0.0})
        one.open()
        assert not any("WDOG" in line for line in server.lines)

    def test_heat_is_not_limited_as_by_a_watchdog_that_there_is_not(self, supply):
        def without(document):
            for group in ("commands", "queries"):
                for name in [name for name in document[group] if "watchdog" in name]:
                    del document[group][name]

        one, server = supply(without, **{"supply.allow_no_watchdog": True, "supply.watchdog_timeout": 1.0})
        with pytest.raises(InstrumentRefused, match="watchdog_timeout is 1 s; write supply.watchdog_timeout: 0"):
            one.open()
        assert "OUTP ON" not in server.lines

    def test_settings_are_looked_at_in_turn(self, supply):
        one, server = supply()
        one.open()
        server.lines.clear()
        for _ in range(8):
            one.check_next_setting()
        asked = [line for line in server.lines if line.endswith("DEL?") or not ("WDOG" in line or "STAT" in line)]
        assert sorted(asked[:4]) == sorted([":VOLT?", ":VOLT:PROT?", ":CURR:PROT?", ":OUTP:PROT:WDOG:DEL?"])
        assert asked[4:] == asked[:4]

    def test_the_exclusive_lock_is_taken_unless_it_is_not_wanted(self, supply):
        one, server = supply()
        one.open()
        assert "SYST:RWL" in server.lines
        one, server = supply(**{"instruments.supply.exclusive_lock": False})
        one.open()
        assert "SYST:REM" in server.lines and "SYST:RWL" not in server.lines


class TestDaq:
    def test_channels_are_told_in_ascending_order_and_told_apart_by_it(self, daq):
        section = {"supply_voltage_channel": 103, "reference_voltage_channel": 101, "load_cell_channel": 102}
        section |= {"lvdt_channel": 105, "ambient_temperature_channel": 104, "lvdt_shunt_resistance": 4.0}
        one, server = daq(section, **{"loop.samples_per_block": 2})
        one.open()
        assert server.lines[2:5] == ["ROUT:SCAN (@101,102,103,104,105)", "SAMP:COUN 2", "FORM:READ:TIME OFF"]
        assert server.lines[5:] == ["SYST:ERR?", "READ:AVER?"]
        for reply in ("1,2,3,4,8", "0,1,2,3,4,2,3,4,5,12"):  # a mean, and two samples of every channel
            server.replies["FETC:AVER?"] = reply
            reading = one.read_block()
            assert reading.time_s == 12.5
            assert (reading.reference_voltage_V, reading.load_cell_voltage_V, reading.supply_voltage_V) == (
                1.0,
                2.0,
                3.0,
            )
            assert (reading.ambient_temperature_C, reading.lvdt_current_A) == (4.0, 2.0)

    def test_channels_that_are_not_there_are_nan(self, daq):
        one, server = daq()
        one.open()
        server.replies["FETC:AVER?"] = "1,2,3"
        reading = one.read_block()
        assert math.isnan(reading.lvdt_current_A) and math.isnan(reading.ambient_temperature_C)

    def test_an_overload_is_no_small_number(self, daq):
        one, server = daq()
        one.open()
        server.replies["FETC:AVER?"] = "9.9E37,-9.9E37,9.91E37"
        reading = one.read_block()
        assert (reading.supply_voltage_V, reading.reference_voltage_V) == (INF, -INF)
        assert math.isnan(reading.load_cell_voltage_V)

    @pytest.mark.parametrize(
        "reply", [reply for reply in NO_NUMBERS if reply.isprintable()] + ["1;2;3", "1,2", "1,2,3,4"]
    )
    def test_a_block_that_is_no_numbers_is_a_loss(self, daq, reply):
        one, server = daq()
        one.open()
        server.replies["FETC:AVER?"] = f"1,2,{reply}" if reply in NO_NUMBERS and "," not in reply else reply
        with pytest.raises(InstrumentLost, match="which is not an answer to that"):
            one.read_block()

    def test_a_daq_that_refuses_its_configuration_is_refused(self, daq):
        one, server = daq()
        server.replies["SYST:ERR?"] = '-222,"Data out of range"'
        with pytest.raises(InstrumentRefused, match="refused its configuration: -222"):
            one.open()

    def test_the_line_that_a_daq_refuses_is_named(self, daq):
        one, server = daq()
        refused = []
        server.replies["SAMP:COUN 50"] = lambda: refused.append('-113,"Undefined header"')
        server.replies["SYST:ERR?"] = lambda: refused.pop(0) if refused else '0,"No error"'
        with pytest.raises(InstrumentRefused, match="-113,\"Undefined header\" to 'SAMP:COUN 50'; is the dialect"):
            one.open()

    def test_another_instrument_is_refused_and_given_up(self, daq):
        one, server = daq()
        assert one.identity == ""
        server.replies["*IDN?"] = "somebody else"
        with pytest.raises(InstrumentRefused, match="says it is 'somebody else', which is no SMA Actuator virtual DAQ"):
            one.open()
        with pytest.raises(InstrumentLost, match="not connected"):
            one.read_block()

    def test_it_is_asked_once_for_readings_before_it_is_read(self, daq):
        one, server = daq()
        one.open()
        assert server.lines.count("READ:AVER?") == 1
        assert "Virtual DAQ" in one.identity
        one.close()
        with pytest.raises(InstrumentLost, match="not connected"):
            one.read_block()


def test_a_second_wire_does_not_say_a_word_to_a_daq_that_reads_the_first(daq):
    one, server = daq()
    one.open()
    one.open()  # again, as after a loss
    said = list(server.lines)
    other, _ = daq({"resource": server.resource.replace("127.0.0.1", "localhost"), "supply_voltage_channel": 111})
    with pytest.raises(InstrumentRefused, match="another part of this one.*each would read the other's"):
        other.open()
    assert server.lines == said
    one.close()
    other.open()
    other.close()
    one.open()
    with pytest.raises(InstrumentRefused, match="another part of this one"):
        other.open()
