"""Another room and a draught: least squares of what has been seen, weighed with what was known."""

from math import nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.estimation.models.surroundings import (
    ALIKE,
    ASTRAY,
    DRAUGHT,
    DRAUGHTY,
    LASTS,
    PLAY,
    SAME,
    SAME_K,
    SENSOR_K,
    UNMEASURED_K,
    WITHIN,
    WORTH,
    ALIKE_s,
    follow,
    forget,
    nothing_seen,
    off_K,
    tell,
)

KNOWN = (0.9, WITHIN)
STEP_s, WITHIN_K = 0.05, 2.0


def told(beyond_K, other_K=0.0, rise_K=40.0, shares=None, draughts=False):
    """A memory of samples that were so far beyond what was expected, of a wire that goes to and fro over its stroke."""
    memory = nothing_seen(KNOWN)
    follow(draughts, memory)
    turns = np.arange(len(beyond_K)) * STEP_s / ALIKE_s
    to_and_fro = 0.5 - 0.5 * np.cos(2.0 * np.pi * turns)
    for each_K, share in zip(beyond_K, to_and_fro if shares is None else shares, strict=True):
        off, _ = off_K(other_K, rise_K, memory)
        tell(each_K, WITHIN_K, off, other_K, rise_K, STEP_s, share, memory)
    return memory


def minutes(number):
    """So many samples."""
    return np.ones(round(60.0 * number / STEP_s))


def remembered(readings):
    """Of so many readings, which fade, and have an error in common."""
    kept = LASTS * (1.0 - np.exp(-readings / LASTS))
    return kept / (1.0 + kept / WORTH)


@pytest.mark.parametrize("other_K", [-12.0, 8.0])
def test_a_kelvin_counts_as_least_squares_have_it(other_K):
    beyond_K = 0.25 * other_K * minutes(3.0)
    off, unsure = off_K(1.0, 0.0, told(beyond_K, other_K))
    seen, known = remembered(180.0 / ALIKE_s) * (other_K / WITHIN_K) ** 2, 1.0 / WITHIN**2
    assert off == pytest.approx((0.1 * known + 0.25 * seen) / (known + seen), rel=1e-2)
    assert unsure == pytest.approx((known + seen) ** -0.5, rel=1e-2)


def test_nothing_is_off_in_the_room_of_the_calibration():
    off, unsure = off_K(0.0, 40.0, told(5.0 * minutes(3.0)))
    assert abs(off) < 1e-6 and unsure < 1e-4


@pytest.mark.parametrize("loses", [0.7, 0.85, 1.15, 1.4])
def test_a_draught_is_found(loses):
    """After a minute of motion most of it counts; what is left is within twice what it is said to be unsure."""
    truly_K = (1.0 - 1.0 / loses) * 40.0
    off, unsure = off_K(0.0, 40.0, told(truly_K * minutes(1.0), draughts=True))
    assert abs(truly_K - off) < 0.35 * abs(truly_K) and abs(truly_K - off) < 2.0 * unsure


@pytest.mark.parametrize("colder_K", [-10.0, 8.0])
def test_a_room_that_nobody_measures_is_found(colder_K):
    off, unsure = off_K(nan, 40.0, told(colder_K * minutes(1.0), nan, draughts=True))
    assert abs(colder_K - off) < 0.25 * abs(colder_K) and abs(colder_K - off) < 2.0 * unsure


def test_a_sensor_that_reads_the_room_of_another_day_is_found_out():
    """It takes longer than where there is none."""
    off, unsure = off_K(0.0, 40.0, told(-10.0 * minutes(3.0), 0.0, draughts=True))
    assert abs(-10.0 - off) < 4.0 and abs(-10.0 - off) < 2.0 * unsure


def test_before_the_wire_has_moved_the_air_is_as_unsure_as_it_is_measured():
    memory = nothing_seen((1.0, WITHIN))
    follow(True, memory)
    square_K2 = SAME * SAME_K**2 + (1.0 - SAME - ASTRAY) * SENSOR_K**2 + ASTRAY * UNMEASURED_K**2
    assert off_K(0.0, 0.0, memory) == (0.0, pytest.approx(square_K2**0.5))
    assert off_K(nan, 0.0, memory) == (0.0, pytest.approx(UNMEASURED_K))


def test_what_is_expected_is_off_by_is_no_draught():
    """A third of a standard deviation throughout, as it is in the surroundings of the calibration, is the sensor's."""
    memory = told(WITHIN_K / 3.0 * minutes(10.0), draughts=True)
    off, by_sensor = off_K(0.0, 40.0, memory)[0], off_K(0.0, 0.0, memory)[0]
    assert abs(off - by_sensor) < 0.1 * WITHIN_K and by_sensor < WITHIN_K / 3.0


def test_what_one_place_tells_counts_by_half_where_all_may_be_as_it_was():
    """Of what it would tell of air that is surely off by a sensor's two kelvins."""
    held = minutes(ALIKE_s / 60.0)
    seen = remembered(1.0) / WITHIN_K**2
    surely_K = 1.5 * seen / (seen + 1.0 / SENSOR_K**2)
    off, _ = off_K(0.0, 0.0, told(1.5 * held, shares=0.5 * held, draughts=True))
    assert 0.3 * surely_K < off < 0.6 * surely_K


def test_at_first_a_draught_is_as_unlikely_as_it_is_seldom():
    memory = nothing_seen(KNOWN)
    follow(True, memory)
    off, unsure = off_K(nan, 40.0, memory)
    assert off == 0.0 and unsure == pytest.approx((UNMEASURED_K**2 + DRAUGHTY * (DRAUGHT * 40.0) ** 2) ** 0.5)


def test_a_fan_that_is_switched_on_is_noticed_within_minutes():
    memory = told(np.concatenate([0.0 * minutes(60.0), 6.0 * minutes(5.0)]), draughts=True)
    assert off_K(0.0, 40.0, memory)[0] > 3.0


@pytest.mark.parametrize("moves, readings", [(0.0, 1.0), (0.9 * PLAY, 1.0), (PLAY + 0.5 * ALIKE, 1.5)])
def test_a_wire_that_is_held_for_an_hour_says_once_what_it_says_there(moves, readings):
    hour = minutes(60.0)
    shares = 0.5 + moves * (np.arange(len(hour)) > len(hour) // 2)
    _, unsure = off_K(1.0, 0.0, told(20.0 * hour, 10.0, shares=shares))
    assert unsure == pytest.approx((1.0 / WITHIN**2 + remembered(readings) * (10.0 / WITHIN_K) ** 2) ** -0.5, rel=1e-2)


def test_a_reset_forgets_what_was_seen():
    memory = told(9.0 * minutes(3.0), 10.0, draughts=True)
    assert off_K(10.0, 40.0, memory)[0] > 4.0
    forget(memory)
    assert off_K(10.0, 40.0, memory)[0] == pytest.approx(1.0)


def test_a_model_that_was_taught_nothing_of_it_takes_kelvins_as_they_are():
    assert off_K(10.0, 40.0, nothing_seen((1.0, 0.0))) == (0.0, pytest.approx(0.0, abs=1e-3))


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50),
    st.one_of(st.floats(-60.0, 60.0), st.just(nan)),
    st.floats(0.05, 50.0),
    st.floats(0.0, 1e4),
    st.floats(-20.0, 300.0),
    st.floats(0.0, 1.0),
)
def test_whatever_is_seen_it_stays_finite(beyond_K, other_K, within_K, step_s, rise_K, share):
    memory = nothing_seen(KNOWN)
    follow(True, memory)
    for number, each_K in enumerate(beyond_K):
        off, _ = off_K(other_K, rise_K, memory)
        tell(each_K, within_K, off, other_K, rise_K, step_s, share * (number % 2), memory)
        assert np.isfinite(off_K(other_K, rise_K, memory)).all()
