"""How hot a wire can be as it cools, by how slowly its resistance falls."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sma_actuator.base.jit import floats
from sma_actuator.safety.cooling import COOLING, begin_cooling, cooling_C

COLD_C, TRANSFORMS_C, SLOPE_1_K, LONGEST_s, STEP_s = 24.0, 150.0, 2e-4, 12.0, 0.05
SCATTER = 1e-3  #: of readings at the bias, as a share


@pytest.fixture
def look():
    return looking()


def looking():
    """What is found from one reading to the next."""
    state = floats(COOLING)
    begin_cooling(state, 0)

    def once(resistance_Ohm, same_load=True, dt_s=STEP_s, settles_C=COLD_C, shows_cold=False):
        return cooling_C(
            state, 0, resistance_Ohm, same_load, dt_s, settles_C, LONGEST_s, SLOPE_1_K, TRANSFORMS_C, shows_cold
        )

    return once


def test_a_wire_whose_resistance_stands_is_no_hotter_than_it_transforms_at_after_a_second(look):
    """By its heat balance alone that takes a third of the longest time constant, four seconds."""
    found_C = [look(5.0) for _ in range(30)]
    assert found_C[0] == math.inf
    assert found_C[-1] == TRANSFORMS_C


def test_one_that_stands_at_what_it_shows_cold_is_colder_the_longer_it_is_looked_at(look):
    found_C = [look(5.0, shows_cold=True) for _ in range(60)]
    assert found_C[12] > found_C[30] > found_C[55] > COLD_C
    assert found_C[55] < 80.0


def test_one_that_transforms_does_not_stand_there_though_it_passes_it(look):
    assert [look(5.0 * (1.0 + 4e-2 * STEP_s * i), shows_cold=True) for i in range(30)][-1] == TRANSFORMS_C


def test_one_whose_resistance_rises_transforms(look):
    assert [look(5.0 * (1.0 + 1e-3 * i)) for i in range(20)][-1] == TRANSFORMS_C


@settings(max_examples=60, deadline=None)
@given(
    begins_C=st.floats(160.0, 260.0),
    slope_1_K=st.floats(SLOPE_1_K, 1e-3),
    time_constant_s=st.floats(0.1 * LONGEST_s, LONGEST_s),
    scatter=st.floats(0.0, 2.0 * SCATTER),
    seed=st.integers(0, 1000),
)
@example(begins_C=160.0, slope_1_K=0.00020919621382688725, time_constant_s=11.0, scatter=0.001953125, seed=302)
@example(begins_C=260.0, slope_1_K=2.1e-4, time_constant_s=11.0, scatter=SCATTER, seed=664)
@example(begins_C=260.0, slope_1_K=2.1e-4, time_constant_s=11.0, scatter=2.0 * SCATTER, seed=292)
def test_a_wire_that_is_hotter_than_it_transforms_at_is_never_called_colder_than_it_is(
    begins_C, slope_1_K, time_constant_s, scatter, seed
):
    once, rng = looking(), np.random.default_rng(seed)
    for i in range(200):
        is_C = COLD_C + (begins_C - COLD_C) * math.exp(-i * STEP_s / time_constant_s)
        if is_C < TRANSFORMS_C:
            break
        shown_Ohm = 5.0 * (1.0 + slope_1_K * (is_C - COLD_C)) * (1.0 + scatter * rng.standard_normal())
        assert once(shown_Ohm) >= is_C - 1.0


def test_while_current_heats_it_nothing_is_known(look):
    """It stays as hot as its power makes it, and so does its resistance."""
    assert [look(5.0, settles_C=400.0) for _ in range(60)][-1] >= 400.0


def test_a_wire_that_was_heated_is_looked_at_anew_as_it_begins_to_cool(look):
    for _ in range(20):
        look(5.0, settles_C=400.0)
    assert [look(5.0) for _ in range(30)][-1] == TRANSFORMS_C


@pytest.mark.parametrize("otherwise", [{"same_load": False}, {"dt_s": LONGEST_s}, {"settles_C": math.nan}])
def test_another_load_a_gap_and_a_power_that_was_not_measured_begin_anew(look, otherwise):
    for _ in range(30):
        look(5.0)
    assert look(5.0, **otherwise) == math.inf


def test_a_reading_that_is_none_is_left_out(look):
    found_C = [look(5.0 if i % 2 else math.nan) for i in range(60)]
    assert found_C[-2] == math.inf and found_C[-1] == TRANSFORMS_C


@settings(max_examples=60, deadline=None)
@given(
    begins_C=st.floats(160.0, 190.0),
    slope_1_K=st.floats(SLOPE_1_K, 1e-3),
    time_constant_s=st.floats(0.1 * LONGEST_s, LONGEST_s),
)
def test_nor_is_one_that_is_heated_further(begins_C, slope_1_K, time_constant_s):
    once, settles_C = looking(), 420.0
    for i in range(100):
        is_C = settles_C + (begins_C - settles_C) * math.exp(-i * STEP_s / time_constant_s)
        assert once(5.0 * (1.0 + slope_1_K * (is_C - COLD_C)), settles_C=settles_C) >= is_C - 1.0
