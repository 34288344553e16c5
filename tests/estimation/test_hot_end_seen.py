"""Whether a wire is contracted as far as it goes, sample by sample: by its resistance and its temperature."""

from dataclasses import replace

import numpy as np
import pytest

from sma_actuator.base.share import shared_file
from sma_actuator.config import Config
from sma_actuator.estimation.hot_end import ENTER, LEAVE, HotEnd, is_contracted

STRESS_Pa, POWER_W = 60e6, 0.3


@pytest.fixture(scope="module")
def config():
    return Config.load(shared_file("config/flexinol.yaml"))


def sloping(config, slope_Ohm_K):
    """The wire, with another rise of the contracted one's resistance with its temperature."""
    hot_end = replace(config.calibration.hot_end, contracted_slope=slope_Ohm_K)
    return replace(config, calibration=replace(config.calibration, hot_end=hot_end))


def austenite_Ohm(config, ambient_C, power_W=POWER_W):
    """The resistance of a wire that has become austenite all through, in thermal balance."""
    calibration, thermal = config.calibration, config.thermal
    at_hot_end_Ohm = np.interp(
        STRESS_Pa, calibration.hot_end.contracted_stress, calibration.hot_end.contracted_resistance
    )
    hotter_K = ambient_C + power_W / thermal.heat_loss - calibration.hot_end.contracted_temperature
    return at_hot_end_Ohm + max(calibration.hot_end.contracted_slope, 0.0) * hotter_K


def seen(config, resistance_Ohm, ambient_C, hot_end=None, time_s=0.0, power_W=POWER_W):
    """One sample, as a chain's kernel asks it."""
    known = hot_end or HotEnd(config)
    return is_contracted(known.row, STRESS_Pa, time_s, resistance_Ohm, power_W, ambient_C, known.state, known.line)


def test_it_is_seen_below_one_bound_and_left_above_a_second(config):
    range_Ohm, usual_C = config.calibration.resistance_range, config.thermal.ambient_temperature
    hot_Ohm = austenite_Ohm(config, usual_C)
    hot_end = HotEnd(config)
    assert (ENTER, LEAVE) == (0.015, 0.03)
    shares = (1.01 * ENTER, 0.99 * ENTER, 0.99 * LEAVE, 1.01 * LEAVE, 0.99 * LEAVE, 0.99 * ENTER)
    said = [seen(config, hot_Ohm + s * range_Ohm, usual_C, hot_end, float(i)) for i, s in enumerate(shares)]
    assert said == [False, True, True, False, False, True]


@pytest.mark.parametrize("off_K", [-0.99, -1.01, 0.99, 1.01, np.nan])
def test_an_ambient_temperature_that_is_too_far_from_the_usual_either_way_is_not_believed(config, off_K):
    """A sensor that fell off says anything; the steep slope shows which temperature was taken."""
    steep = sloping(config, 1.0)
    usual_C, tolerance_K = steep.thermal.ambient_temperature, steep.thermal.ambient_tolerance
    said_C = usual_C + off_K * tolerance_K
    believed_C = said_C if abs(off_K) < 1.0 else usual_C
    hot_Ohm, range_Ohm = austenite_Ohm(steep, believed_C), steep.calibration.resistance_range
    assert seen(steep, hot_Ohm + 0.9 * ENTER * range_Ohm, said_C)
    assert not seen(steep, hot_Ohm + 1.1 * ENTER * range_Ohm, said_C)
    for share, contracted in ((0.9, True), (1.1, False)):
        many = HotEnd(steep).run(
            *(np.array([x]) for x in (0.0, hot_Ohm + share * ENTER * range_Ohm, STRESS_Pa, POWER_W, said_C))
        )
        assert many.tolist() == [contracted]


def test_the_temperature_follows_the_power_with_the_wires_time_constant(config):
    steep = sloping(config, 1.0)
    thermal, usual_C = steep.thermal, steep.thermal.ambient_temperature
    hot_end = HotEnd(steep)
    seen(steep, 100.0, usual_C, hot_end, 100.0, power_W=0.0)
    tau_s = thermal.heat_capacity / thermal.heat_loss
    share = 1.0 - np.exp(-1.0)
    hot_Ohm, range_Ohm = austenite_Ohm(steep, usual_C, share * POWER_W), steep.calibration.resistance_range
    assert not seen(steep, hot_Ohm + 1.1 * ENTER * range_Ohm, usual_C, hot_end, 100.0 + tau_s)
    assert seen(steep, hot_Ohm + 0.9 * ENTER * range_Ohm, usual_C, hot_end, 100.0 + tau_s)
    hot_end.reset()
    assert seen(steep, austenite_Ohm(steep, usual_C), usual_C, hot_end, 1e6)


def test_a_clock_that_is_set_back_cools_nothing(config):
    steep = sloping(config, 1.0)
    usual_C = steep.thermal.ambient_temperature
    hot_Ohm, hot_end = austenite_Ohm(steep, usual_C), HotEnd(steep)
    assert seen(steep, hot_Ohm, usual_C, hot_end, 100.0)
    assert seen(steep, hot_Ohm, usual_C, hot_end, 0.0, power_W=0.0)  # the power of this sample has had no time
    left_Ohm = hot_Ohm + 1.01 * LEAVE * steep.calibration.resistance_range
    assert not seen(steep, left_Ohm, usual_C, hot_end, 0.0, power_W=0.0), "nor was any heat made"


def test_resistance_that_seems_to_fall_with_temperature_is_not_believed(config):
    """A calibration of a few logs may say so; a metal does not."""
    falling = sloping(config, -1.0)
    usual_C, range_Ohm = falling.thermal.ambient_temperature, falling.calibration.resistance_range
    assert seen(falling, austenite_Ohm(falling, usual_C) + 0.9 * ENTER * range_Ohm, usual_C)
    assert not seen(falling, austenite_Ohm(falling, usual_C) + 1.1 * ENTER * range_Ohm, usual_C)


def test_without_a_calibration_of_the_hot_end_it_is_not_known(make_config):
    assert not HotEnd(Config.from_mapping(make_config())).known


def test_live_parameters_arrive(config):
    hot_end, usual_C = HotEnd(config), config.thermal.ambient_temperature
    steep = sloping(config, 1.0)
    hot_end.update(steep)
    assert not seen(
        steep, austenite_Ohm(steep, usual_C) + 1.1 * ENTER * config.calibration.resistance_range, usual_C, hot_end
    )
    assert seen(
        steep, austenite_Ohm(steep, usual_C) + 0.9 * ENTER * config.calibration.resistance_range, usual_C, hot_end, 1.0
    )


def test_the_displacement_there_is_that_of_the_calibration_at_the_stress(config):
    """Of one sample, and of as many as a log has."""
    c = config.calibration
    at_m = np.interp(STRESS_Pa, c.hot_end.contracted_stress, c.hot_end.contracted_displacement)
    assert HotEnd(config).displacement_m(STRESS_Pa) == at_m
    assert HotEnd(config).displacement_m(np.full(3, STRESS_Pa)).tolist() == 3 * [at_m]
