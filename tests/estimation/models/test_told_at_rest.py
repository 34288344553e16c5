"""A cold wire is a strain gauge only while it rests: what drives it warms it, and martensite shows that too."""

import numpy as np
import pytest

from sma_actuator.estimation.models.heat_content import THERMAL
from sma_actuator.estimation.models.orientation import RESTS_K
from sma_actuator.estimation.models.whole_range import WholeRangeCoefficients, WholeRangeModel
from sma_actuator.estimation.models.whole_range_kernel import CURVE_TERMS

LOSS_W_K, BIAS_W, COLD_Ohm, PER_m, STROKE_m = 5e-3, 0.02, 5.0, 100.0, 4e-3
FEATURES = 5  #: resistance, stress, temperature, a play of either


@pytest.fixture
def observe():
    """The displacement that a model says of a sample; it says that the wire is as long as cold ones are."""
    none, one = np.zeros(FEATURES), np.ones(FEATURES)
    model = WholeRangeModel(
        WholeRangeCoefficients(
            calibrated_length=0.1,
            calibrated_diameter=150e-6,
            thermal=(2.0, 0.0, LOSS_W_K, *np.zeros(THERMAL - 3)),
            hot_end=(0.0, 0.0, 0.0),
            cold_end=(STROKE_m, 0.0, 0.0),
            cold_wire=(PER_m, 1e-3, 1e-3),
            other_loads=(1.0, 1.0),
            cold_wire_stress=(5e7, 1.5e8),
            cold_wire_resistance=(COLD_Ohm, COLD_Ohm),
            ambient_temperature=22.0,
            play_widths_K=(1.0,),
            play_widths_Ohm=(0.1,),
            feature_centre=tuple(none),
            feature_scale=tuple(one),
            feature_low=tuple(-1e12 * one),
            feature_high=tuple(1e12 * one),
            novelty=tuple(np.eye(FEATURES)[np.tril_indices(FEATURES)]),
            novelty_edge=1e6,
            curve=(STROKE_m, *np.zeros(CURVE_TERMS - 1)),
            learners=1,
            linear=(STROKE_m, *np.zeros(CURVE_TERMS + FEATURES - 4)),
            hidden=tuple(none),
            bias=(0.0,),
            output=(0.0,),
            largest_residual=STROKE_m,
            intervals=(1.0,) * 4,
            spread_floor=1e-5,
            curve_interval=1e-4,
            stress_range=(5e7, 1.5e8),
            displacement_range=(0.0, STROKE_m),
            stroke=(0.0, STROKE_m),
        )
    )

    def sample(time_s, resistance_Ohm, power_W):
        model.observe(time_s, resistance_Ohm, 1e8, True, power_W, 22.0)
        return model.longer_m

    return sample


@pytest.mark.parametrize("power_W", [BIAS_W, LOSS_W_K * 2.0 * RESTS_K + BIAS_W])
def test_resistance_tells_the_length_of_a_wire_that_rests(observe, power_W):
    """It shows as much as usual for a second, then 2 % more; driven it may be warmer."""
    for step in range(20):
        observe(0.05 * step, COLD_Ohm, BIAS_W)
    for step in range(20, 40):
        longer_m = observe(0.05 * step, 1.02 * COLD_Ohm, power_W)
    assert (longer_m == 0.0) is (power_W > BIAS_W)


@pytest.mark.parametrize("warmer_K", [0.5 * RESTS_K, 4.0 * RESTS_K])
def test_one_that_is_held_warm_is_no_longer_for_that(observe, warmer_K):
    """It comes to rest there, and its resistance stays 1 % higher: as in a room where it is 14 K warmer."""
    power_W = LOSS_W_K * warmer_K + BIAS_W
    observe(0.0, COLD_Ohm, BIAS_W)
    for step in range(1, 400):
        longer_m = observe(0.05 * step, 1.01 * COLD_Ohm, power_W)
    assert (longer_m == 0.0) is (warmer_K > RESTS_K)


def test_what_is_read_of_it_once_it_has_cooled_counts_alone(observe):
    """It was held warm as the log began."""
    for step in range(800):
        warm = step < 400
        longer_m = observe(0.05 * step, (1.01 if warm else 1.0) * COLD_Ohm, LOSS_W_K * 12.0 if warm else BIAS_W)
        assert warm or step < 500 or longer_m == 0.0
