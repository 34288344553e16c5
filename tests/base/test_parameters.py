"""A parameter is checked as it was declared, and every refusal names it and says what would be right."""

import math
import re
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.base.parameters import (
    LONGEST_NAME,
    Declaration,
    check,
    from_mapping,
    parameter,
    to_mapping,
    typed_section,
    walk,
)
from sma_actuator.base.registry import Registry

LENGTH = Declaration("length of the wire", "m", 0.0, 1.0)
ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(),
    st.lists(st.floats()),
    st.just(10**400),
    st.just(-(10**400)),
)


@pytest.mark.parametrize(
    ("value", "kind", "words"),
    [
        (2.0, "float", "a: 2 is outside its range; 0 to 1 m is wanted"),
        (10**400, "float", "a: inf is outside its range"),
        (math.nan, "float", "a: nan is outside its range"),
        (math.inf, "int", "a: inf is outside its range"),
        (0.5, "int", "a: 0.5 is not a whole number"),
        (True, "float", "a: True is not a number"),
        ("1e-6", "float", "write it with a decimal point"),
        ([], "tuple[float, ...]", "a: the list is empty"),
        ([0.5, "x"], "tuple[float, ...]", "a[1]: 'x' is not a number"),
        ("abc", "tuple[str, ...]", "a: 'abc' is not a list, as [a, b] is"),
        (1, "bool", "a: 1 is not true or false"),
        (1, "str", "a: 1 is not text"),
        ("a\nb", "str", "a: 'a\\nb' holds what cannot be printed, as the end of a line; one line of at most"),
        ("a\0", "str", "a: 'a\\x00' holds what cannot be printed, as the end of a line; one line of at most"),
    ],
)
def test_a_wrong_value_is_refused_with_its_name_and_what_is_wanted(value, kind, words):
    assert words in check("a", value, LENGTH, kind)[1]


@pytest.mark.parametrize("text", ["NaN", "inf"])
def test_a_text_that_no_decimal_point_makes_a_number_gets_no_such_advice(text):
    assert check("a", text, LENGTH, "float")[1].endswith(
        f"'{text}' is not a number; 0 to 1 m is wanted (length of the wire)"
    )


NAME = Declaration("name of the joint", hi=LONGEST_NAME)


@pytest.mark.parametrize(
    "value", ["", " ", "\n", "joint\r", "joint\0", "\ud800", "j" * 256, "j" * 5000, None, ["joint"]]
)
def test_a_name_is_one_line_that_says_something_and_has_a_length(value):
    problem = check("joint_name", value, NAME, "str")[1]
    assert re.match("joint_name: (is empty|.* is too long|.* cannot be printed.*|.* is not text)", problem)
    assert (
        value is None
        or type(value) is list
        or problem.endswith("one line of at most 255 characters is wanted (name of the joint)")
    )
    assert len(problem) < 250
    assert check("joint_name", "j" * 255, NAME, "str") == ("j" * 255, "")


def test_a_name_that_is_not_given_is_asked_for_as_text():
    @dataclass(frozen=True)
    class Named:
        name: "str" = parameter(description="name of the joint")
        goes: "bool" = parameter(description="it goes")

    assert from_mapping(Named, {})[1] == [
        "name: missing; one line of at most 4096 characters is wanted (name of the joint)",
        "goes: missing; true or false is wanted (it goes)",
    ]


@given(ANYTHING, st.sampled_from(["float", "int", "bool", "str", "tuple[float, ...]", "tuple[str, ...]"]))
def test_whatever_comes_the_answer_is_a_sentence_or_a_value_in_range(value, kind):
    for declaration in (LENGTH, Declaration("free")):
        converted, problem = check("a", value, declaration, kind)
        if problem:
            assert problem.startswith("a")
        elif kind in ("float", "int"):
            assert math.isfinite(converted)
            assert declaration.lo <= converted <= declaration.hi


SHAPES: Registry[type] = Registry("shape", "no_such.shapes")


@SHAPES.register("round")
@dataclass(frozen=True)
class Round:
    """Parameters of a round wire."""

    diameter: float = parameter(description="diameter", unit="m", lo=0.0, hi=1.0)


@SHAPES.register("flat")
@dataclass(frozen=True)
class Flat:
    """Parameters of a ribbon."""

    width: float = parameter(0.5, "width", "m", 0.0, 1.0)


@dataclass(frozen=True)
class Shop:
    """What is sold."""

    shape: object = typed_section(lambda: SHAPES, "shape")
    other: object = typed_section(lambda: SHAPES, "other shape", default="flat")


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({}, "shape.type: missing; one of round, flat is wanted"),
        ({"shape": {"type": "oval"}}, "shape.type: 'oval' is not one of round, flat"),
        ({"shape": {"type": ["round"]}}, "shape.type: ['round'] is not one of round, flat"),
        ({"shape": {"type": "round"}}, "shape.diameter: missing"),
        ({"shape": {"type": "flat", "diameter": 0.5}}, "shape.diameter: no such parameter"),
        ({"shape": {"type": "flat"}, "other": 3}, "other.type: missing"),
    ],
)
def test_the_type_of_a_section_decides_what_it_holds(mapping, words):
    shop, problems = from_mapping(Shop, mapping)
    assert shop is None
    assert any(words in problem for problem in problems)


def test_a_typed_section_is_written_as_it_was_read():
    mapping = {"shape": {"type": "round", "diameter": 0.25}, "other": {"type": "flat", "width": 0.5}}
    shop, problems = from_mapping(Shop, mapping)
    assert not problems
    assert to_mapping(shop) == mapping
    assert [name for name, *_ in walk(shop)] == ["shape.type", "shape.diameter", "other.type", "other.width"]
