"""The first-order lag that effects, calibrations and the anatomy of a residual share."""

import math

import numpy as np
import pytest

from sma_actuator.estimation.lag import lag, lagged


def test_a_step_is_followed_to_its_exponential_whatever_the_times_between_samples():
    time_s = np.array([0.0, 0.1, 0.5, 0.51, 2.0, 6.0])
    values = np.array([1.0, 3.0, 3.0, 3.0, 3.0, 3.0])
    assert lagged(time_s, values, 2.0) == pytest.approx(3.0 - 2.0 * np.exp(-time_s / 2.0), rel=1e-12)


def test_a_steady_value_is_there_from_the_beginning():
    assert lagged(np.arange(3.0), np.full(3, 0.7), 10.0).tolist() == [0.7] * 3


def test_it_begins_at_zero_where_that_was_said():
    out = np.empty(2)
    lag(np.array([0.0, 1.0]), np.ones(2), np.full(2, math.nan), 1.0, True, out)
    assert out == pytest.approx([0.0, 1.0 - math.exp(-1.0)])


def test_a_sample_that_is_no_number_and_a_clock_that_goes_back_leave_it_standing():
    out = lagged(np.array([0.0, 1.0, 2.0, 1.5]), np.array([0.0, math.nan, 1.0, 9.0]), 1.0)
    assert out == pytest.approx([0.0, 0.0, 1.0 - math.exp(-2.0), 1.0 - math.exp(-2.0)])


def test_one_sample_after_the_other_gives_what_all_at_once_do():
    time_s, values = np.linspace(0.0, 3.0, 31), np.sin(np.linspace(0.0, 9.0, 31))
    state, one_by_one = np.full(2, math.nan), np.empty(31)
    for i in range(31):
        lag(time_s[i : i + 1], values[i : i + 1], state, 0.5, False, one_by_one[i : i + 1])
    assert one_by_one.tolist() == lagged(time_s, values, 0.5).tolist()
