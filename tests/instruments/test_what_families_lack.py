"""Supplies that lack something, or do more than was asked: each by one entry of a dialect, nothing else changed."""

import pytest
from answering import LEFT_OUT, Answering, dialect
from tcp_line import TcpInstrument

from sma_actuator.base.parameters import ConfigError
from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentLost, InstrumentRefused, LimitsNotHeld
from sma_actuator.instruments.scpi import ScpiSupply


@pytest.fixture
def quiet():
    """(the instrument, its line)."""
    instrument = Answering(None)
    with TcpInstrument(instrument) as line:
        yield instrument, line


def test_another_question_for_its_identity(tmp_path, supply_of, quiet):
    instrument, line = quiet
    instrument.settings["ID"] = "ANSWERING, TOO"
    supply = supply_of(line, dialect(tmp_path, **{"queries.identity": "ID?"}))
    supply.open()
    assert supply.identity == "ANSWERING, TOO"
    assert "*IDN?" not in line.lines


def test_no_question_for_its_identity(tmp_path, supply_of, quiet):
    _, line = quiet
    supply = supply_of(line, dialect(tmp_path, identity=LEFT_OUT, family="a family", **{"queries.identity": None}))
    supply.open()
    assert supply.identity == "a family (not asked)"
    assert "*IDN?" not in line.lines


def test_another_command_or_none_clears_the_status(tmp_path, supply_of, quiet):
    _, line = quiet
    supply = supply_of(line, dialect(tmp_path, **{"commands.clear_status": None}))
    supply.open()
    supply.clear_trip()  # neither is there a command for that: the output goes off
    assert "*CLS" not in line.lines
    supply.close()
    supply_of(line, dialect(tmp_path, **{"commands.clear_status": "CLS"})).open()
    assert "CLS" in line.lines


def test_it_is_addressed_before_anything_else_on_every_connection(tmp_path, supply_of, quiet):
    _, line = quiet
    supply = supply_of(
        line, dialect(tmp_path, **{"commands.select": "ADR {channel:02d}"}), **{"instruments.supply.channel": 6}
    )
    supply.open()
    assert line.lines[:3] == ["ADR 06", "OUTP 0", "CURR 0.000"]
    said = len(line.lines)
    supply._session.cut()
    assert supply.shut_down()
    assert line.lines[said : said + 3] == ["ADR 06", "OUTP 0", "CURR 0.000"]


def test_its_lines_may_end_with_a_semicolon_alone(tmp_path, supply_of):
    with TcpInstrument(Answering(None), hears=";", says="\r\n") as line:
        supply = supply_of(line, dialect(tmp_path, termination=";", answer_termination="\r\n"))
        supply.open()
        supply.set_current(0.1)
        assert supply.read_back().current_setting_A == 0.1
        assert supply.shut_down()


def test_the_least_that_it_takes_stands_for_0_A(tmp_path, supply_of, quiet):
    _, line = quiet
    supply = supply_of(line, dialect(tmp_path, zero_current=0.002))
    supply.open()
    supply.set_current(0.1)
    supply.set_current(0.0)
    assert supply.read_back().current_setting_A == 0.002
    assert not any(told == "CURR 0.000" for told in line.lines)
    assert line.lines[1] == "CURR 0.002"
    supply.close()
    supply = supply_of(line, dialect(tmp_path, zero_current=0.002), **{"supply.bias_current": 0.002})
    supply.open()
    supply.close()
    too_little = {"supply.bias_current": 0.001}
    with pytest.raises(InstrumentRefused, match=r"supply.bias_current: 0.001 A; mine takes no less than 0.002 A"):
        supply_of(line, dialect(tmp_path, zero_current=0.002), **too_little).open()


def test_voltage_and_current_are_asked_for_while_they_exist(tmp_path, supply_of, quiet):
    _, line = quiet
    supply = supply_of(line, dialect(tmp_path, measures_while_off=False))
    supply.open()
    state = supply.read_back()
    assert (state.output_on, state.voltage_V, state.current_A) == (False, 0.0, 0.0)
    assert not any(told.startswith("MEAS") for told in line.lines)
    supply.set_output(True)
    state = supply.read_back()
    assert (state.output_on, state.voltage_V, state.current_A) == (True, 0.5, 0.5)


def test_one_line_that_answers_several_questions_is_asked_once(tmp_path, supply_of, quiet):
    instrument, line = quiet
    instrument.settings["ALL"] = "VOLT 1.5 V,CURR 0.25 A"
    both = {
        "queries.voltage": {"ask": "ALL?", "answer": "VOLT (.*) V,.*"},
        "queries.current": {"ask": "ALL?", "answer": ".*,CURR (.*) A"},
    }
    supply = supply_of(line, dialect(tmp_path, **both))
    supply.open()
    line.lines.clear()
    state = supply.read_back()
    assert (state.voltage_V, state.current_A) == (1.5, 0.25)
    assert line.lines == ["CURR?", "OUTP?", "ALL?"]


def test_a_current_setting_that_is_not_told_is_what_it_was_told(tmp_path, supply_of, quiet):
    _, line = quiet
    supply = supply_of(line, dialect(tmp_path, **{"queries.current_setting": LEFT_OUT}))
    supply.open()
    assert supply.read_back().current_setting_A == 0.0
    supply.set_current(0.15)
    assert supply.read_back().current_setting_A == 0.15
    supply.switch_off()
    assert supply.read_back().current_setting_A == 0.0
    assert "CURR?" not in line.lines


def test_a_compliance_voltage_that_is_not_told_must_be_accepted(tmp_path, supply_of, quiet):
    _, line = quiet
    path = dialect(tmp_path, **{"queries.voltage_setting": LEFT_OUT})
    with pytest.raises(
        InstrumentRefused, match=r"no compliance voltage that can be read back.*supply.allow_no_trips: true"
    ):
        supply_of(line, path, **{"supply.allow_no_trips": False}).open()
    supply = supply_of(line, path)
    supply.open()
    assert "voltage_setting" not in supply.reads_back
    assert "VOLT 6.000" in line.lines


class Forgetful(Answering):
    """Off takes its settings back."""

    def __call__(self, line):
        reply = super().__call__(line)
        if line == "OUTP 0":
            self.settings |= {"VOLT": "30", "CURR": "5"}
        return reply


@pytest.mark.parametrize("says_so", [False, True])
def test_off_that_resets_the_settings(tmp_path, supply_of, says_so):
    instrument = Forgetful(None)
    with TcpInstrument(instrument) as line:
        supply = supply_of(line, dialect(tmp_path, off_resets=says_so))
        supply.open()
        supply.set_current(0.1)
        supply.set_output(True)
        supply.switch_off()
        if says_so:
            supply.check_settings()
            assert instrument.settings == {**instrument.settings, "VOLT": "6.000", "CURR": "0.000"}
            supply.clear_trip()
            supply.check_settings()
        else:
            with pytest.raises(LimitsNotHeld, match="reads back 30"):
                supply.check_settings()


def test_a_channel_that_has_no_bit_is_refused(tmp_path, supply_of, quiet):
    instrument, line = quiet
    instrument.settings["STAT"] = "0x0000"
    output = {"queries.output": {"ask": "STAT?", "mask": {1: 0x10, 2: 0x20}}}
    supply = supply_of(line, dialect(tmp_path, **output), **{"instruments.supply.channel": 2})
    supply.open()
    instrument.settings["STAT"] = "0x0020"
    assert supply.read_back().output_on
    instrument.settings["STAT"] = "0x0000"
    with pytest.raises(ConfigError, match=r"instruments.supply.channel: 3 is no channel of mine.*has no mask for it"):
        supply_of(line, dialect(tmp_path, **output), **{"instruments.supply.channel": 3})


def test_an_answer_without_its_unit_is_none_where_one_is_said(tmp_path, supply_of, quiet):
    _, line = quiet
    supply = supply_of(line, dialect(tmp_path, **{"queries.current": {"ask": "MEAS:CURR?", "answer": "(.*)A"}}))
    supply.open()
    with pytest.raises(InstrumentLost, match=r"answered '0' to 'MEAS:CURR\?', which is not an answer to that"):
        supply.read_back()


@pytest.mark.parametrize("asked", [True, False])
@pytest.mark.parametrize("tell", ["CURR {value:.2f}", {"tell": "CURR {value:.0f}", "scale": 100}])
def test_what_its_digits_leave_out_is_nobody_elses_command(tmp_path, supply_of, quiet, tell, asked):
    """A supply that takes currents in steps of 10 mA."""
    _, line = quiet
    query = {"ask": "CURR?", "scale": 0.01 if isinstance(tell, dict) else 1.0}
    entries = {"commands.set_current": tell, "queries.current_setting": query if asked else LEFT_OUT}
    supply = supply_of(line, dialect(tmp_path, **entries))
    supply.open()
    for current_A, written_A in ((0.0955, 0.09), (0.05, 0.05), (0.0999, 0.09)):
        supply.set_current(current_A)
        state = supply.read_back()
        assert (state.current_setting_A, state.cut_off_A) == pytest.approx(
            (written_A, current_A - written_A), abs=1e-12
        )
    supply.switch_off()
    assert (supply.read_back().current_setting_A, supply.read_back().cut_off_A) == (0.0, 0.0)


def test_a_scale_never_lifts_a_current_over_its_limit(make_config, tmp_path):
    path = dialect(tmp_path, **{"commands.set_current": {"tell": "CURR {value:.0f}", "scale": 1000}})
    config = make_config(**{"instruments.supply.dialect": path, "supply.max_current": 0.3996})
    supply = ScpiSupply(Config.from_mapping(config))
    told = []
    supply._session.tell = lambda *lines: told.extend(lines)
    supply.set_current(0.3996)
    assert told == ["CURR 399"]


def test_a_read_back_that_takes_too_long_blames_all_its_answers(tmp_path, supply_of, quiet):
    _, line = quiet
    supply = supply_of(line, dialect(tmp_path), **{"instruments.supply.timeout": 0.5})
    supply.open()
    line.slow_s = 0.2
    with pytest.raises(
        InstrumentLost, match=r"; with the \d answers? before it that took .* instruments.supply.timeout is the"
    ):
        supply.read_back()


class KeepsApart(Answering):
    """Takes no voltage within 1 V of its over-voltage trip and no trip within 1 V of its voltage, and says nothing."""

    def __init__(self, left_V, left_trip_V):
        super().__init__(None)
        self.settings |= {"VOLT": str(left_V), "OVP": str(left_trip_V)}

    def __call__(self, line):
        before = dict(self.settings)
        answer = super().__call__(line)
        if float(self.settings["OVP"]) < float(self.settings["VOLT"]) + 1.0:
            self.settings = before
        return answer


OVER_VOLTAGE = {"commands.set_over_voltage": "OVP {value:.2f}", "queries.over_voltage_setting": "OVP?"}


@pytest.mark.parametrize(("left_V", "left_trip_V"), [(0.5, 2.0), (1.0, 60.0), (12.0, 60.0)])
def test_limits_are_programmed_whatever_was_left_of_those_that_bound_each_other(
    tmp_path, supply_of, left_V, left_trip_V
):
    instrument = KeepsApart(left_V, left_trip_V)
    with TcpInstrument(instrument) as line:
        supply_of(line, dialect(tmp_path, **OVER_VOLTAGE), **{"supply.over_voltage_trip": 7.5}).open()
        assert (float(instrument.settings["VOLT"]), float(instrument.settings["OVP"])) == (6.0, 7.5)
        assert instrument.settings["OUTP"] == "0"


def test_a_trip_that_is_too_near_to_the_voltage_is_said_to_be(tmp_path, supply_of):
    with TcpInstrument(KeepsApart(1.0, 60.0)) as line:
        wanted = r"supply.max_voltage, 6 V: it reads back 0.000; it may want supply.over_voltage_trip further above"
        with pytest.raises(LimitsNotHeld, match=wanted):
            supply_of(line, dialect(tmp_path, **OVER_VOLTAGE)).open()
