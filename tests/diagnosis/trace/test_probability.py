"""Probabilities of hypotheses, and what is said of them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.diagnosis.trace.limits import LIMITS
from sma_actuator.diagnosis.trace.probability import Probabilities, weighed
from sma_actuator.diagnosis.trace.rows import NOTHING, SOMETHING_ELSE, Hypothesis


def hypothesis(name, evidence, objection=""):
    names = (name,) if isinstance(name, str) else name
    return Hypothesis(names, evidence, evidence, np.zeros(0), objection=objection)


def of(**shares):
    """Probabilities by names that are joined by an underscore."""
    words = {"nothing": (NOTHING,), "else": (SOMETHING_ELSE,)}
    return Probabilities({words.get(name, tuple(name.split("_"))): share for name, share in shares.items()})


def test_a_probability_is_what_was_known_before_times_the_evidence():
    found = weighed([(0.3, hypothesis(NOTHING, -10.0)), (0.1, hypothesis("slip", -10.0 + math.log(9.0)))])
    assert found.of == {("slip",): pytest.approx(0.75), (NOTHING,): pytest.approx(0.25)}
    assert found.best == ("slip",)


@given(st.lists(st.tuples(st.floats(1e-3, 1.0), st.floats(-1e6, 1e6)), min_size=1, max_size=20))
def test_they_sum_to_one_and_come_best_first(said):
    found = weighed([(before, hypothesis(f"name{i}", evidence)) for i, (before, evidence) in enumerate(said)])
    shares = list(found.of.values())
    assert sum(shares) == pytest.approx(1.0) and shares == sorted(shares, reverse=True)


def test_what_is_at_the_end_of_the_possible_has_no_probability_whatever_its_evidence():
    found = weighed([(0.3, hypothesis(NOTHING, -100.0)), (0.3, hypothesis("creep", 0.0, "creep's time is at its end"))])
    assert found.of == {(NOTHING,): 1.0, ("creep",): 0.0}
    assert found.verdict == ("none", [])


def test_a_name_is_as_probable_as_all_hypotheses_that_have_it():
    assert of(slip=0.5, slip_creep=0.3, nothing=0.2).by_name == pytest.approx({"slip": 0.8, "creep": 0.3, NOTHING: 0.2})


@pytest.mark.parametrize(
    ("said", "verdict"),
    [
        (of(slip=0.95, creep=0.05), ("traced", ["slip"])),
        (of(creep=0.6, slip=0.35, nothing=0.05), ("traced", ["creep", "slip"])),
        (of(creep_slip=0.95, creep=0.05), ("traced", ["creep", "slip"])),
        (of(nothing=0.6, slip=0.2, creep=0.2), ("none", [])),
        (of(nothing=0.32, slip=0.3, creep=0.2, rate=0.18), ("none", [])),
        (of(nothing=0.28, slip=0.26, creep=0.24, rate=0.22), ("unexplained", [])),
        (of(**{"else": 0.4}, slip=0.3, creep=0.3), ("unexplained", [])),
        (of(creep=0.25, slip=0.25, rate=0.25, fatigue=0.25), ("unexplained", [])),
        (of(creep=0.8, creep_slip=0.05, creep_rate=0.05, creep_fatigue=0.1), ("traced", ["creep"])),
        (of(slip_creep=0.5, creep_rate=0.3, creep=0.05, nothing=0.15), ("unexplained", [])),
        (of(slip_creep=0.45, creep_rate=0.3, creep_fatigue=0.2, nothing=0.05), ("traced", ["creep"])),
        (of(slip_creep=0.5, creep_rate=0.45, nothing=0.05), ("traced", ["creep", "rate", "slip"])),
    ],
    ids=[
        "one",
        "a set",
        "a pair",
        "nothing",
        "no less than before the logs",
        "something, and nobody knows what",
        "something else",
        "too many",
        "one with whatever else",
        "none for certain",
        "one for certain, and something beside it",
        "one for certain, and one of two beside it",
    ],
)
def test_the_smallest_set_is_given_or_what_is_certain_by_itself(said, verdict):
    names = said.verdict
    assert (names[0], sorted(names[1])) == (verdict[0], sorted(verdict[1]))
    assert len(names[1]) <= LIMITS.names


def test_of_one_it_is_within_a_set_that_one_of_its_names_is_there():
    said = of(slip=0.5, slip_creep=0.2, rate=0.2, nothing=0.1)
    assert said.within(["slip"]) == pytest.approx(0.7)  # with creep or without
    assert said.within(["slip", "rate"]) == pytest.approx(0.9)
    assert said.within(["creep"]) == pytest.approx(0.2)
    assert said.within([]) == 0.0


def test_of_two_it_is_within_a_set_that_both_are_or_all_there_is():
    said = of(slip_creep=0.5, slip_rate=0.2, slip=0.2, nothing=0.1)
    assert said.within(["slip", "creep"]) == pytest.approx(0.7)  # slip alone is all there is; with rate it is not
    assert said.within(["slip"]) == pytest.approx(0.2)
    assert said.within(["slip", "creep", "rate"]) == pytest.approx(0.9)


@given(st.permutations(["slip", "creep", "rate", "play"]), st.integers(0, 3))
def test_a_larger_set_is_never_less_probable(order, number):
    said = of(slip_creep=0.4, slip=0.2, rate=0.2, play_rate=0.1, nothing=0.1)
    assert said.within(order[:number]) <= said.within(order[: number + 1]) + 1e-12
