"""How much a kelvin of another room counts: the mean of what has been seen, weighed with what was known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.estimation.models.other_rooms import (
    ALIKE,
    PLAY,
    SURPRISE,
    WITHIN,
    WORTH,
    ALIKE_s,
    forget,
    nothing_seen,
    off_K,
    tell,
    unsure_K,
)

KNOWN = np.array([0.9, WITHIN])


def told(beyond_K, other_K, within_K=2.0, step_s=0.05, shares=None):
    """A memory of samples that were so far beyond what was expected, of a wire that goes to and fro over its stroke."""
    memory = nothing_seen(KNOWN)
    to_and_fro = 0.5 - 0.5 * np.cos(np.arange(len(beyond_K)) * step_s / ALIKE_s * 2.0 * np.pi)
    for each_K, share in zip(beyond_K, to_and_fro if shares is None else shares, strict=True):
        tell(each_K, within_K, other_K, step_s, share, memory)
    return memory


def worth(readings):
    """Of a run, whose readings have an error in common: no more than WORTH."""
    return readings / (1.0 + readings / WORTH)


@pytest.mark.parametrize("other_K", [-12.0, 8.0])
def test_it_is_the_mean_of_all_stretches_and_of_what_was_known(other_K):
    """As least squares have it: samples of ALIKE_s are one independent reading, of a wire that moves."""
    beyond_K = 0.25 * other_K + np.random.default_rng(1).normal(0.0, 1.0, 4000)
    memory = told(beyond_K, other_K)
    readings = worth(len(beyond_K) * 0.05 / ALIKE_s) * (other_K / 2.0) ** 2
    known = 1.0 / WITHIN**2
    mean = (0.1 * known + readings * np.mean(beyond_K) / other_K) / (known + readings)
    assert off_K(1.0, memory) == pytest.approx(mean, rel=1e-6)
    assert unsure_K(-1.0, memory) == pytest.approx((known + readings) ** -0.5)


def test_nothing_is_off_in_the_room_of_the_calibration():
    memory = told(np.full(1000, 5.0), 0.0)
    assert off_K(0.0, memory) == 0.0 and unsure_K(0.0, memory) == 0.0
    assert unsure_K(1.0, memory) == pytest.approx(WITHIN)


@pytest.mark.parametrize("moves, readings", [(0.0, 1.0), (0.9 * PLAY, 1.0), (PLAY + 0.5 * ALIKE, 1.5)])
def test_a_wire_that_is_held_for_an_hour_says_once_what_it_says_there(moves, readings):
    hour = int(3600.0 / 0.05)
    shares = 0.5 + moves * (np.arange(hour) > hour // 2)
    memory = told(np.full(hour, 20.0), 10.0, shares=shares)
    assert unsure_K(1.0, memory) == pytest.approx((1.0 / WITHIN**2 + worth(readings) * (10.0 / 2.0) ** 2) ** -0.5)


def test_a_reset_forgets_what_was_seen():
    memory = told(np.full(1000, 5.0), 10.0)
    assert off_K(10.0, memory) > 2.0
    forget(KNOWN, memory)
    assert off_K(10.0, memory) == pytest.approx(1.0)


def test_a_model_that_was_taught_nothing_of_it_takes_kelvins_as_they_are():
    memory = nothing_seen(np.array([1.0, 0.0]))
    assert off_K(10.0, memory) == 0.0 and unsure_K(10.0, memory) == pytest.approx(0.0, abs=1e-4)


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50),
    st.floats(-60.0, 60.0),
    st.floats(0.05, 50.0),
    st.floats(0.0, 1e4),
    st.floats(0.0, 1.0),
)
def test_whatever_is_seen_it_stays_finite_and_grows_no_less_sure(beyond_K, other_K, within_K, step_s, share):
    """And no single sample moves it by more than a reading does that is SURPRISE standard deviations off."""
    memory = nothing_seen(KNOWN)
    for number, each_K in enumerate(beyond_K):
        before, unsure = off_K(1.0, memory), unsure_K(1.0, memory)
        tell(each_K, within_K, other_K, step_s, share * (number % 2), memory)
        assert unsure_K(1.0, memory) <= unsure
        assert abs(off_K(1.0, memory) - before) <= SURPRISE * unsure
