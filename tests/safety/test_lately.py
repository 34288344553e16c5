"""What a number was lately, for instruments that show it late."""

import math

import pytest

from sma_actuator.safety.lately import Lately


def kept(period_s, values):
    lately = Lately()
    for number, value in enumerate(values):
        lately.note(number * period_s, value)
    return lately


@pytest.mark.parametrize(("shown", "off"), [(4.0, 0.0), (5.5, 0.0), (8.0, 0.0), (3.5, 0.5), (9.0, 1.0)])
def test_it_is_all_that_it_was_in_two_tenths_of_a_second_and_what_lies_between(shown, off):
    assert kept(0.05, range(9)).off_by(shown) == off


@pytest.mark.parametrize("shown", [6.0, 8.0])
def test_and_what_it_was_two_readings_ago(shown):
    assert kept(1.0, range(9)).off_by(shown) == 0.0
    assert kept(1.0, range(9)).off_by(5.5) == 0.5


def test_a_clock_that_goes_back_begins_anew():
    lately = kept(0.05, range(9))
    lately.note(0.35, 20.0)
    assert lately.off_by(8.0) == 12.0
    lately.note(0.35, 10.0)
    assert lately.off_by(15.0) == 0.0, "which stood still, did not go back"


def test_what_is_no_number_is_near_none():
    assert math.isnan(kept(0.05, range(9)).off_by(math.nan))
    assert kept(0.05, [1.0, math.nan, 2.0]).off_by(1.5) == 0.0
    assert kept(0.05, [math.nan]).off_by(1.5) == math.inf
    assert Lately().off_by(1.5) == math.inf
