"""What a load that rises as the wire contracts tells of its displacement, and when it tells nothing."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sma_actuator.estimation.elastic_load import ElasticLoad

STROKE_m, DT_s = 4e-3, 0.05
SPRING_Pa_m, PRELOAD_Pa = 15e9, 40e6
SURE_m, UNSURE_m = 0.01 * STROKE_m, 0.1 * STROKE_m


def moved(n, strokes=6.0):
    """Up and down through most of the stroke."""
    return STROKE_m * (0.5 + 0.4 * np.cos(2.0 * np.pi * strokes * np.arange(n) / n))


def spring_Pa(place_m):
    return PRELOAD_Pa + SPRING_Pa_m * (STROKE_m - place_m)


def estimated(place_m, off=0.08, seed=1):
    """A model that is sure while the wire contracts, and far off, and unsure, in the middle where it cools."""
    cools = np.append(False, np.diff(place_m) > 0.0)
    lost = cools & (np.abs(place_m / STROKE_m - 0.5) < 0.25)
    noise_m = 2e-3 * STROKE_m * np.random.default_rng(seed).standard_normal(len(place_m))
    return place_m + noise_m + np.where(lost, off * STROKE_m, 0.0), np.where(lost, UNSURE_m, SURE_m)


def told(stress_Pa, model_m, half_m, line=None):
    """Displacements and intervals of a record, and what remembers them."""
    line = line or ElasticLoad(STROKE_m)
    each = zip(stress_Pa, model_m, half_m, strict=True)
    found = [line.step(k * DT_s, float(s), float(d), float(u)) for k, (s, d, u) in enumerate(each)]
    place_m, found_half_m = np.array(found).T
    return place_m, found_half_m


def test_a_spring_tells_where_resistance_does_not():
    place_m = moved(2400)
    model_m, half_m = estimated(place_m)
    found_m, found_half_m = told(spring_Pa(place_m), model_m, half_m)
    later = np.arange(2400) > 800
    lost = later & (half_m == UNSURE_m)
    assert np.abs(model_m - place_m)[lost].mean() > 0.075 * STROKE_m
    assert np.abs(found_m - place_m)[lost].mean() < 0.01 * STROKE_m
    assert np.mean(np.abs(found_m - place_m)[later] <= found_half_m[later]) > 0.93
    assert found_half_m[lost].mean() < 0.25 * UNSURE_m


@pytest.mark.parametrize(
    "stress_Pa",
    [
        np.full(2400, 60e6),
        60e6 + 0.3e6 * np.random.default_rng(2).standard_normal(2400),
        60e6 + 20e6 * np.sin(np.arange(2400) / 37.0),
        np.where(np.arange(2400) // 300 % 2, 60e6, 90e6),
    ],
    ids=["a weight", "its noise", "a hand", "two weights"],
)
def test_a_load_that_does_not_go_with_the_wire_tells_nothing(stress_Pa):
    model_m, half_m = estimated(moved(2400))
    found_m, found_half_m = told(stress_Pa, model_m, half_m)
    assert np.array_equal(found_m, model_m) and np.array_equal(found_half_m, half_m)


@pytest.mark.parametrize("added_Pa", [20e6, -20e6])
def test_a_payload_on_the_spring_is_not_taken_for_motion(added_Pa):
    """It is another line from then on, and that is learned anew."""
    place_m = moved(4800, 12.0)
    model_m, half_m = estimated(place_m)
    stress_Pa = spring_Pa(place_m) + np.where(np.arange(4800) > 2000, added_Pa, 0.0)
    found_m, _ = told(stress_Pa, model_m, half_m)
    away_m = np.abs(found_m - place_m)
    assert away_m[1200:2000].mean() < 0.01 * STROKE_m
    soon = slice(2000 + round(1.5 / DT_s), 2400)
    assert np.all(away_m[soon] <= np.abs(model_m - place_m)[soon] + 0.01 * STROKE_m)
    assert away_m[3600:].mean() < 0.01 * STROKE_m


def test_a_load_cell_that_stands_still_holds_no_estimate():
    """Nor hides from the guard `load_dead` that the wire moves and the load does not."""
    place_m = moved(3600, 9.0)
    stress_Pa = spring_Pa(place_m)
    stress_Pa[2400:] = stress_Pa[2400]
    model_m, half_m = estimated(place_m)
    found_m, _ = told(stress_Pa, model_m, np.where(np.arange(3600) < 2400, half_m, UNSURE_m))
    assert np.abs(found_m - place_m)[2400:].max() < 0.35 * STROKE_m
    assert np.array_equal(found_m[2600:], model_m[2600:])


def test_a_wire_that_pulls_at_a_stop_has_not_moved():
    place_m = np.concatenate([moved(2400), np.full(200, 0.1 * STROKE_m)])
    stress_Pa = spring_Pa(place_m)
    stress_Pa[2400:] += np.linspace(0.0, 60e6, 200)
    model_m, half_m = estimated(place_m)
    found_m, _ = told(stress_Pa, model_m, half_m)
    assert np.abs(found_m - place_m)[2400 + 60 :].max() < 0.02 * STROKE_m


def test_many_samples_are_as_many_single_ones_in_whatever_pieces():
    place_m = moved(1200)
    stress_Pa, (model_m, half_m) = spring_Pa(place_m), estimated(place_m)
    found_m, found_half_m = told(stress_Pa, model_m, half_m)
    line, time_s, all_m, all_half_m = ElasticLoad(STROKE_m), DT_s * np.arange(1200), model_m.copy(), half_m.copy()
    for part in (slice(0, 1), slice(1, 700), slice(700, None)):
        line.run(time_s[part], stress_Pa[part], all_m[part], all_half_m[part])
    assert np.array_equal(all_m, found_m) and np.array_equal(all_half_m, found_half_m)


def test_after_a_tare_the_load_is_another():
    place_m = moved(1200)
    stress_Pa, (model_m, half_m) = spring_Pa(place_m), estimated(place_m)
    line = ElasticLoad(STROKE_m)
    told(stress_Pa, model_m, half_m, line)
    line.reset()
    assert line.step(60.0, float(stress_Pa[-1]), float(model_m[-1]), UNSURE_m) == (model_m[-1], UNSURE_m)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(-1.0, 5.0),
            st.floats(0.0, 400e6),
            st.floats(-1e-3, 8e-3),
            st.one_of(st.floats(0.0, 4e-3), st.just(math.nan)),
        ),
        max_size=80,
    )
)
def test_whatever_comes_it_tells_a_place_and_no_more_doubt(rows):
    line, time_s = ElasticLoad(STROKE_m), 0.0
    told(spring_Pa(moved(600)), moved(600), np.full(600, SURE_m), line)
    for step_s, stress_Pa, model_m, half_m in rows:
        time_s += step_s
        found_m, found_half_m = line.step(time_s, stress_Pa, model_m, half_m)
        assert math.isfinite(found_m)
        assert math.isnan(half_m) or 0.0 <= found_half_m <= max(half_m, 0.01 * STROKE_m) + 1e-12
