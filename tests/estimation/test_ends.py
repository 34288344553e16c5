"""Where a wire can be held at its load, of a calibration with known ends."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from sma_actuator.base.calibration import Calibration, HotEndSection, PowerSection, RestSection, interpolated
from sma_actuator.estimation.ends import Ends

MPa = 1e6
#: Contracted at 0.3 to 0.5 mm, cold at 2 to 4 mm; half contracted at 70 °C, wholly at 90 °C, 10 K higher for 100 MPa.
CALIBRATION = Calibration(
    hot_end=HotEndSection(
        contracted_stress=(20e6, 120e6),
        contracted_resistance=(4.4, 4.5),
        contracted_displacement=(0.3e-3, 0.5e-3),
    ),
    rest=RestSection(
        cold_stress=(20e6, 120e6),
        cold_resistance=(5.0, 5.2),
        cold_displacement=(2.0e-3, 4.0e-3),
    ),
    power=PowerSection(
        transformation_heating=(90.0, 70.0, 50.0),
        transformation_cooling=(60.0, 50.0, 40.0),
        transformation_shift=(1e-7, 1e-7),
        latent_rise=20.0,
    ),
)
MODEL_m = (0.6e-3, 3.8e-3)


def ends(stress_Pa=20e6, whole=True, calibration=CALIBRATION):
    found = Ends(SimpleNamespace(calibration=calibration), MODEL_m, whole)
    found.step(stress_Pa, 0.05)
    return found


@pytest.mark.parametrize(("stress_MPa", "range_mm"), [(20, (0.3, 2.0)), (70, (0.4, 3.0)), (120, (0.5, 4.0))])
def test_a_model_of_the_whole_range_goes_from_end_to_end_at_each_load(stress_MPa, range_mm):
    assert ends(stress_MPa * MPa).range_m(500.0, 24.0) == pytest.approx([1e-3 * v for v in range_mm])


def test_a_model_of_the_thesis_keeps_to_its_working_range_inside_them():
    assert ends(20e6, whole=False).range_m(500.0, 24.0) == pytest.approx((0.6e-3, 2.0e-3))
    assert ends(120e6, whole=False).range_m(500.0, 24.0) == pytest.approx((0.6e-3, 3.8e-3))


@pytest.mark.parametrize(("most_rise_K", "share"), [(68.0, 0.0), (48.0, 0.5), (38.0, 0.75), (20.0, 1.0)])
def test_limits_that_leave_less_heat_leave_less_contraction(most_rise_K, share):
    short_m, long_m = ends(20e6).range_m(most_rise_K, 24.0)
    if share == 1.0:
        assert (short_m, long_m) == MODEL_m, "of a wire that cannot be moved nothing is known"
    else:
        assert short_m == pytest.approx(0.3e-3 + share * 1.7e-3, abs=1e-6)


def test_martensite_that_formed_under_a_heavier_load_makes_the_cold_end_longer_by_itself():
    found = ends(20e6)
    assert found.range_m(500.0, 24.0, 0.25e-3) == pytest.approx((0.3e-3, 2.25e-3))
    assert found.range_m(500.0, 24.0, -0.25e-3) == pytest.approx((0.3e-3, 2.0e-3)), "after a contraction it is as long"


def test_without_a_calibration_or_a_load_it_is_the_working_range():
    assert ends(calibration=Calibration()).range_m(500.0, 24.0) == MODEL_m
    assert ends(float("nan")).range_m(500.0, 24.0) == MODEL_m


def test_noise_of_the_load_cell_hardly_moves_an_end():
    found = ends(70e6)
    for k in range(200):
        found.step(70e6 + (2e6 if k % 2 else -2e6), 0.05)
    assert found.range_m(500.0, 24.0)[1] == pytest.approx(3.0e-3, abs=4e-6)


def test_another_load_is_another_range_within_two_seconds():
    found = ends(20e6)
    for _ in range(40):
        found.step(120e6, 0.05)
    assert found.range_m(500.0, 24.0) == pytest.approx((0.5e-3, 4.0e-3), abs=0.05e-3)


def test_a_number_is_interpolated_to_the_digit_that_numpy_gives():
    rng = np.random.default_rng(3)
    for count in (1, 2, 5):
        nodes, values = np.sort(rng.uniform(-1.0, 1.0, count)).tolist(), rng.uniform(-1.0, 1.0, count).tolist()
        for at in (*rng.uniform(-1.5, 1.5, 200).tolist(), *nodes, -math.inf, math.inf):
            assert interpolated(at, nodes, values) == np.interp(at, nodes, values)
        assert math.isnan(interpolated(math.nan, nodes, values))


def test_what_one_sample_and_many_give_is_the_same():
    place_m, stress_Pa = np.linspace(0.0, 4e-3, 9), np.linspace(10e6, 130e6, 9)
    shares = CALIBRATION.share_of_stroke(place_m, stress_Pa)
    assert shares.tolist() == [CALIBRATION.share_of_stroke(*pair) for pair in zip(place_m.tolist(), stress_Pa.tolist())]
