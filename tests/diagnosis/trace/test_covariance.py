"""The covariance of a session in which nothing has happened, against plain linear algebra."""

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.diagnosis.trace.covariance import Covariance

N = 60
RNG = np.random.default_rng(4)
COLUMNS = RNG.standard_normal((N, 9)) * RNG.uniform(0.1, 5.0, 9)
SHARE = 0.1  #: of a reading that each row counts as
ROWS = 3.0 * RNG.standard_normal(N)
usual = partial(Covariance, share=SHARE)


def dense(*columns):
    """The same as a matrix."""
    return np.eye(N) / SHARE + sum((part @ part.T for part in columns), np.zeros((N, N)))


def squares(covariance, rows=ROWS):
    return float(np.sum(covariance.whiten(rows) ** 2))


def test_whitened_rows_are_those_of_the_inverse_matrix():
    for columns in ((), (COLUMNS,), (COLUMNS[:, :4], COLUMNS[:, 4:])):
        expected = float(ROWS @ np.linalg.solve(dense(*columns), ROWS))
        assert squares(usual(*columns)) == pytest.approx(expected)


def test_whitening_rows_twice_applies_the_inverse_and_many_at_once_are_each_alone():
    covariance = usual(COLUMNS)
    np.testing.assert_allclose(covariance.whiten(covariance.whiten(ROWS)), covariance.inverse(ROWS), atol=1e-10)
    np.testing.assert_allclose(covariance.inverse(ROWS), np.linalg.solve(dense(COLUMNS), ROWS), atol=1e-10)
    np.testing.assert_allclose(covariance.whiten(COLUMNS)[:, 3], covariance.whiten(COLUMNS[:, 3]), atol=1e-10)


def test_the_determinant_is_that_of_the_matrix():
    expected = np.linalg.slogdet(dense(COLUMNS) * SHARE)[1]
    assert usual(COLUMNS).log_determinant == pytest.approx(expected)
    assert usual().log_determinant == 0.0


def test_columns_that_say_the_same_count_as_one_that_is_larger():
    """As hat functions and an offset do: what they span is smaller than their number."""
    one = COLUMNS[:, :1]
    twice, larger = usual(one, one), usual(math.sqrt(2.0) * one)
    assert squares(twice) == pytest.approx(squares(larger))
    assert twice.log_determinant == pytest.approx(larger.log_determinant)


def test_readings_that_share_their_error_count_as_one_in_all_rows_and_in_some():
    seen = np.arange(N) % 2 > 0
    matrix = dense(COLUMNS) + 3.0 * np.eye(N) / SHARE
    fewer = Covariance(COLUMNS, share=SHARE / 4.0)
    assert squares(fewer) == pytest.approx(float(ROWS @ np.linalg.solve(matrix, ROWS)))
    some = float(ROWS[seen] @ np.linalg.solve(matrix[np.ix_(seen, seen)], ROWS[seen]))
    assert squares(fewer.of(seen), ROWS[seen]) == pytest.approx(some)


def test_rows_that_are_further_off_by_themselves_are_as_in_the_matrix_and_cost_as_many_readings_as_they_count():
    alone, counts = RNG.uniform(1.0, 4.0, N), RNG.uniform(0.1, 1.0, N)
    matrix = COLUMNS @ COLUMNS.T + np.diag(alone**2) / SHARE
    covariance = usual(COLUMNS, alone=(alone, counts))
    assert squares(covariance) == pytest.approx(float(ROWS @ np.linalg.solve(matrix, ROWS)))
    np.testing.assert_allclose(covariance.inverse(ROWS), np.linalg.solve(matrix, ROWS), atol=1e-10)
    together = np.linalg.slogdet(np.eye(N) + SHARE * (COLUMNS / alone[:, None]) @ (COLUMNS.T / alone))[1]
    apart = SHARE * float(counts @ np.log(alone**2))
    assert covariance.log_determinant == pytest.approx(together + apart)
    seen = np.arange(N) % 2 > 0
    some = float(ROWS[seen] @ np.linalg.solve(matrix[np.ix_(seen, seen)], ROWS[seen]))
    assert squares(covariance.of(seen), ROWS[seen]) == pytest.approx(some)


def test_the_likelihood_is_the_normal_one_up_to_what_is_common_to_all():
    from scipy.stats import multivariate_normal

    def normal(rows, *columns):
        return multivariate_normal(cov=dense(*columns)).logpdf(rows)

    def said(rows, *columns):
        covariance = usual(*columns)
        return covariance.log_likelihood(squares(covariance, rows))

    common = said(ROWS, COLUMNS[:, :1]) - normal(ROWS, COLUMNS[:, :1])
    for rows, columns in ((ROWS, (COLUMNS,)), (0.3 * ROWS, (COLUMNS[:, :3],)), (5.0 * ROWS, (COLUMNS[:, 3:],))):
        assert said(rows, *columns) == pytest.approx(normal(rows, *columns) + common)


def test_of_some_rows_it_is_the_same_matrix_without_the_others():
    seen = np.arange(N) % 3 > 0
    some = usual(COLUMNS).of(seen)
    matrix = dense(COLUMNS)[np.ix_(seen, seen)]
    assert squares(some, ROWS[seen]) == pytest.approx(float(ROWS[seen] @ np.linalg.solve(matrix, ROWS[seen])))
    assert some.log_likelihood(0.0) == pytest.approx(-0.5 * some.log_determinant)


@given(st.randoms(use_true_random=False))
def test_the_order_of_the_rows_changes_nothing(random):
    order = random.sample(range(N), N)
    plain, mixed = usual(COLUMNS), usual(COLUMNS[order])
    assert squares(mixed, ROWS[order]) == pytest.approx(squares(plain))
    assert mixed.log_determinant == pytest.approx(plain.log_determinant)
    np.testing.assert_allclose(mixed.whiten(ROWS[order]), plain.whiten(ROWS)[order], atol=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(0, 8), st.floats(1e-3, 1e3))
def test_what_may_be_off_more_is_never_further_off_and_never_freer_of_cost(seed, fewer, scale):
    """More columns of smooth error never raise the squares, and never lower what they cost."""
    rng = np.random.default_rng(seed)
    columns, rows = scale * rng.standard_normal((N, 9)), rng.standard_normal(N)
    some, all_ = usual(columns[:, :fewer]), usual(columns)
    assert squares(all_, rows) <= squares(some, rows) * (1.0 + 1e-9)
    assert all_.log_determinant >= some.log_determinant - 1e-9
    assert squares(some, rows) <= SHARE * float(rows @ rows) * (1.0 + 1e-9)
