"""What the answer of an instrument means: every way that a dialect can say it."""

import math

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.instruments.phrases import Command, Query


def query(reading, **entry):
    problems = []
    read = Query.read("queries.it", {"ask": "IT?", **entry}, {"channel"}, reading, problems)
    assert not problems
    return read


@pytest.mark.parametrize(
    ("entry", "reply", "value"),
    [
        ({}, " +1.5E-01 ", 0.15),
        ({"answer": "V1 (.*)"}, "V1 4.000", 4.0),
        ({"answer": "(.*)A"}, "0.05A", 0.05),
        ({"answer": r"(?:I\d )?(.*?)A?"}, "I1 0.4", 0.4),
        ({"answer": r".*MV\(([^)]*)\).*"}, "MV(1.25),PV(6.0),MC(0.1)", 1.25),
        ({"field": 2}, "1.0, 0.25, 9.91E37", 0.25),
        ({"field": 3}, "1.0,0.25,9.91E37", math.nan),
        ({"scale": 0.001}, "250", 0.25),
        ({"base": 16, "scale": 0.5}, "0A", 5.0),
        ({"answer": "R(...).*", "base": 16}, "R0FF123", 255.0),
        ({"answer": "I=(.*)", "field": 1, "scale": 1e-3}, "I=120,3", 0.12),
        ({"base": 10}, "10", 10.0),
        ({"base": 16}, "0x1F", 31.0),
        ({}, "9.9E37", math.inf),
        ({}, "-9.9E37", -math.inf),
    ],
)
def test_a_number_is_found_in_what_is_around_it(entry, reply, value):
    assert query("number", **entry).number(reply) == pytest.approx(value, nan_ok=True)


@pytest.mark.parametrize(
    ("entry", "reply"),
    [
        ({}, "0.05A"),
        ({"answer": "V1 (.*)"}, "V2 4.000"),
        ({"answer": "V1 (.*)"}, "V1 4.000 V"),
        ({"answer": "V1(?: (.*))?"}, "V1"),
        ({"field": 2}, "1.0"),
        ({}, "1.0,2.0"),
        ({"base": 16}, "-1"),
        ({"base": 16}, "1.5"),
        ({"base": 16}, "0xZZ"),
    ],
)
def test_an_answer_of_another_shape_is_none(entry, reply):
    with pytest.raises(ValueError):
        query("number", **entry).number(reply)


@pytest.mark.parametrize(
    ("entry", "reply", "truth"),
    [
        ({}, "ON", True),
        ({"answer": "OUT (.*)"}, "OUT OFF", False),
        ({"yes": "CV|CC", "no": "OFF"}, "CC", True),
        ({"yes": "CV|CC", "no": "OFF"}, "OFF", False),
        ({"yes": ".*", "no": "OFF"}, "OFF", False),
        ({"mask": 0x10}, "0x0010", True),
        ({"mask": 0x10}, "0x0224", False),
        ({"mask": 0x10, "base": 16}, "30", True),
        ({"mask": 0x10, "base": 16}, "20", False),
        ({"mask": 0x10}, "#H30", True),
        ({"mask": 3}, "+2", True),
        ({"mask": 3}, "4", False),
        ({"answer": r".*FR\((..)\)", "base": 16, "mask": 0x10}, "SR(04),FR(10)", True),
    ],
)
def test_yes_and_no_are_words_numbers_or_bits(entry, reply, truth):
    assert query("truth", **entry).truth(reply) is truth


@pytest.mark.parametrize(
    ("entry", "reply"),
    [
        ({}, ""),
        ({}, "CV"),
        ({"yes": "CV|CC", "no": "OFF"}, ""),
        ({"yes": "CV|CC", "no": "OFF"}, "ON"),  # no word of this instrument's
        ({"mask": 1}, "ON"),
        ({"mask": 1}, "1.0"),
    ],
)
def test_what_is_neither_yes_nor_no_proves_nothing(entry, reply):
    with pytest.raises(ValueError):
        query("truth", **entry).truth(reply)


def test_yes_and_no_need_no_quotes_though_yaml_takes_them_for_true_and_false():
    entry = yaml.safe_load("{yes: CV|CC, no: 'OFF'}")
    assert set(entry) == {True, False}
    problems = []
    read = Query.read("queries.it", {"ask": "IT?", **entry}, (), "truth", problems)
    assert not problems
    assert [read.truth(reply) for reply in ("CC", "OFF")] == [True, False]


def test_it_is_said_why_a_pattern_for_a_whole_line_will_not_do():
    problems = []
    Query.read("queries.it", {"ask": "IT?", "answer": "a*b*c*d*(.)"}, (), "number", problems)
    assert len(problems) == 1
    assert problems[0].endswith("whole line is wanted: it has 4 repetitions (*, + …); 3 at the most are wanted")


def test_bits_may_depend_on_the_channel():
    both = query("truth", mask={1: 0x10, 2: 0x20})
    assert [both.filled({"channel": channel}).truth("0x0020") for channel in (1, 2)] == [False, True]
    with pytest.raises(KeyError):
        both.filled({"channel": 3})


@pytest.mark.parametrize(
    ("entry", "reply", "code"),
    [
        ({}, '0,"No error"', 0),
        ({}, '+0, "No error"', 0),
        ({}, '-113,"Undefined header"', -113),
        ({"answer": r"(\d+) .*"}, "0  No Error", 0),
        ({"answer": "ERR (.*)"}, "ERR 7", 7),
        ({}, '10,"Sixteen were another"', 10),
        ({"base": 16}, '10,"Of another base"', 16),
    ],
)
def test_an_error_has_a_number(entry, reply, code):
    assert query("code", **entry).code(reply) == code


def test_what_a_pattern_says_is_the_number_is_all_of_it():
    with pytest.raises(ValueError, match="'7,1' is not a whole number"):
        query("code", answer="ERR (.*)").code("ERR 7,1")


def test_a_text_may_have_commas():
    assert query("text").value(" MAKER,MODEL,1.0 ") == "MAKER,MODEL,1.0"


def test_a_list_is_read_number_by_number():
    assert query("numbers", answer="(.*)VDC", scale=2).numbers("1.0VDC,2.5VDC") == [2.0, 5.0]


@pytest.mark.parametrize(("scale", "lines"), [(1000, ["A 250", "B 250.000"]), (2, ["A 0", "B 0.500"])])
def test_a_value_is_written_in_the_unit_of_the_instrument(scale, lines):
    problems = []
    entry = {"tell": ["A {value:.0f}", "B {value:.3f}"], "scale": scale}
    command = Command.read("commands.it", entry, {"value"}, "value", problems)
    assert not problems
    assert command.lines({"value": 0.25}) == lines


@pytest.mark.parametrize(
    ("texts", "scale", "value", "written"),
    [
        (["A {value:.3f}"], 1.0, 0.2507, 0.25),
        (["A {value:.3f}"], 1.0, 0.251, 0.251),
        (["A {value:.0f}"], 1000, 0.2507, 0.25),
        (["A {value:.0f}", "B {value:.3f}"], 1000, 0.2507, 0.25),
        (["A {value:.3f}", "B {value:.1f}"], 1.0, 0.2899, 0.2),
        (["A {value:.3e}"], 1.0, 0.0012349, 0.001234),
        (["A {value}"], 1.0, 0.123456789, 0.123456789),
        (["CHAN {channel}", "A {value:.2f}"], 1.0, 0.119, 0.11),
        (["A {value:.2f}"], 1.0, 0.0, 0.0),
    ],
)
def test_what_its_digits_say_is_no_more_than_a_value(texts, scale, value, written):
    problems = []
    command = Command.read("commands.it", {"tell": texts, "scale": scale}, {"value", "channel"}, "value", problems)
    assert not problems
    assert command.at_most(value) == pytest.approx(written, rel=1e-12)


@given(st.floats(0.0, 100.0), st.integers(0, 6), st.sampled_from([1.0, 1e3, 1e6, 3.0]))
def test_no_value_is_lifted_by_its_digits(value, digits, scale):
    problems = []
    command = Command.read(
        "commands.it", {"tell": f"A {{value:.{digits}f}}", "scale": scale}, {"value"}, None, problems
    )
    written = command.at_most(value)
    said = float(command.lines({"value": written})[0].removeprefix("A ")) / scale
    assert said == pytest.approx(written, rel=1e-12)
    assert value - 1.01 * 10.0**-digits / scale < written <= value * (1.0 + 1e-15)


def test_a_scale_is_of_values_alone():
    problems = []
    command = Command.read("commands.it", {"tell": "ON {channel}", "scale": 1000}, {"channel"}, None, problems)
    assert not problems
    assert command.lines({"channel": 2}) == ["ON 2"]


@pytest.mark.parametrize("allowed", [{"value"}, {"value", "channel"}])
def test_what_no_value_can_be_written_as_is_refused(allowed):
    """A current is no whole number."""
    problems = []
    Command.read("commands.it", "CURR {value:d}", allowed, "value", problems)
    assert len(problems) == 1
    assert problems[0].startswith("commands.it: 'CURR {value:d}' cannot be filled in (Unknown format code 'd'")
