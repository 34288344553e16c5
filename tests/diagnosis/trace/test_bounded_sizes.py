"""How much of a normal distribution lies within bounds, where that is known otherwise."""

import math

import numpy as np
import pytest
import scipy

from sma_actuator.diagnosis.trace.bounded import log_share_between, log_share_within


@pytest.mark.parametrize(("low", "high"), [(-1.0, 2.0), (-math.inf, -3.0), (30.0, math.inf), (5.0, 6.0), (-9.0, -8.5)])
def test_of_one_it_is_exact_in_either_tail(low, high):
    norm = scipy.stats.norm  # imported where it is asked for: whoever collects the tests has no need of it
    expected = norm.logcdf(-low) if high == math.inf else norm.logcdf(high) + np.log1p(-norm.cdf(low) / norm.cdf(high))
    assert log_share_between(np.array(low), np.array(high)) == pytest.approx(expected, abs=1e-6)


def test_a_bound_counts_as_it_does_without_those_that_do_not():
    covariance = np.array([[1.0, 0.9], [0.9, 4.0]])
    share = log_share_within(np.array([-30.0, 5.0]), covariance, np.array([0.0, -900.0]), np.array([50.0, 900.0]))
    assert share == pytest.approx(scipy.stats.norm.logcdf(-30.0), abs=1e-9)


@pytest.mark.parametrize("of", [2, 3, 4])
def test_of_several_that_go_together_it_is_the_integral(of):
    rng = np.random.default_rng(of)
    for _ in range(20):
        root = rng.standard_normal((of, of))
        covariance, mean = root @ root.T + 0.1 * np.eye(of), rng.standard_normal(of)
        expected = scipy.stats.multivariate_normal(mean, covariance, seed=1).cdf(
            np.full(of, 40.0), lower_limit=np.zeros(of)
        )
        share = log_share_within(mean, covariance, np.zeros(of), np.full(of, 40.0))
        assert share == pytest.approx(math.log(expected), abs=0.05)


def test_of_independent_ones_it_is_the_product_however_far_beyond():
    mean, low, high = np.array([-20.0, -3.0, 0.5]), np.zeros(3), np.full(3, 9.0)
    share = log_share_within(mean, np.eye(3), low, high)
    assert share == pytest.approx(np.sum(log_share_between(low - mean, high - mean)), abs=1e-9)


@pytest.mark.parametrize("of", [8, 9, 40])
def test_there_may_be_as_many_as_there_are_slips_in_ten_logs(of):
    share = log_share_within(np.zeros(of), np.eye(of), np.zeros(of), np.full(of, np.inf))
    assert share == pytest.approx(of * math.log(0.5), abs=1e-9)
