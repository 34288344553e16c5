"""A dialect's regular expressions are bounded, whatever is answered: ``re`` would keep the whole process waiting."""

import pytest

from sma_actuator.instruments.dialect import FOLDER, Dialect
from sma_actuator.instruments.patterns import LONGEST_LINE, Pattern


@pytest.mark.parametrize(
    "text", [r"(a+)+", "(ab|a)*", "(?:x*){3}", "(a?)*", "(?=(a+)+)b", "(?>a+)+", "((a*))*", "(x)?(?(1)a*|b)*"]
)
def test_a_repetition_of_what_varies_is_refused(text):
    with pytest.raises(ValueError, match="what is repeated in it varies itself, which takes for ever on some answers"):
        Pattern(text)


@pytest.mark.parametrize("text", [r"(\d\d)*x", "(?:VP\\d )?(.*)", "(a|b)*c", "a++b", "x{4}y", ".*a.*b.*"])
def test_what_is_quick_on_every_line_is_taken(text):
    assert Pattern(text).pattern == text


def test_repetitions_beside_each_other_are_counted_and_so_is_where_a_search_begins():
    with pytest.raises(ValueError, match=r"it has 4 repetitions \(\*, \+ …\); 3 at the most"):
        Pattern("a*b*c+d{2,5}")
    assert Pattern("a*b*c+d?e{3}").groups == 0
    with pytest.raises(ValueError, match="it has 3 repetitions .*; 2 at the most"):
        Pattern("a*b*c+", whole=False)
    assert Pattern("a*b*", whole=False).search("xb")


@pytest.mark.parametrize("text", ["(", None, 5, "a{99999999999}", "(" * 5000])
def test_what_is_no_regular_expression_is_refused(text):
    with pytest.raises(ValueError, match="it is no regular expression"):
        Pattern(text)


def test_a_line_longer_than_any_answer_is_like_none():
    """90 kB of 'keithley,' in the place of an identity kept the whole process waiting for 2.3 s, 1 MB for minutes."""
    value, found = Pattern("(.*)V"), Pattern("keithley", whole=False)
    fits = (LONGEST_LINE - 1) * "1" + "V"
    assert value.fullmatch(fits) and not value.fullmatch("1" + fits)
    assert found.search("keithley".ljust(LONGEST_LINE)) and not found.search("keithley".ljust(LONGEST_LINE + 1))


def test_a_question_with_a_pattern_refuses_such_an_answer():
    queries = Dialect.load(str(FOLDER / "tdk_genesys.yaml"), "supply").queries
    assert queries["current"].number("MV(1.0),PV(2.0),MC(0.25),PC(0.3)") == 0.25
    with pytest.raises(ValueError, match="is not like"):
        queries["current"].number("MC(0.25)" + "MC(" * 100)
