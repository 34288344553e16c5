"""The temperatures of the transformation, as far as the logs tell them."""

from dataclasses import replace

import numpy as np

from sma_actuator.base.calibration import PowerSection
from sma_actuator.base.share import shared_file
from sma_actuator.calibration.power import learn, passages
from sma_actuator.config import Config
from sma_actuator.logs.kinds import make_experiments


def test_without_full_pulses_nothing_is_said_of_the_transformation():
    config = Config.load(shared_file("config/flexinol.yaml"))
    assert learn([], config, config.calibration) == PowerSection()


def test_a_passage_goes_from_end_to_end_without_turning_back():
    there = np.linspace(1.0, 0.0, 21)
    turned = np.concatenate((np.linspace(1.0, 0.5, 11), np.linspace(0.5, 1.0, 11)))
    wavering = np.concatenate((np.linspace(1.0, 0.4, 13), np.linspace(0.4, 0.7, 7), np.linspace(0.7, 0.0, 15)))
    share = np.concatenate((there, there[::-1], turned, wavering))
    (heating, down), (cooling, up) = [(h, share[rows]) for h, rows in passages(share)]
    assert heating and not cooling
    np.testing.assert_allclose(down, np.arange(0.7, 0.29, -0.05))
    np.testing.assert_allclose(up, down[::-1])


def test_a_wire_that_does_not_come_back_under_a_light_load_counts_as_little(flexinol):
    """It began stretched and stays contracted: the pulse that contracted it is ten times as long as what it moves by
    then."""
    config = Config.load(shared_file("config/flexinol.yaml"))
    calibration = config.calibration
    hot_m = np.interp(
        calibration.rest.cold_stress[0],
        calibration.hot_end.contracted_stress,
        calibration.hot_end.contracted_displacement,
    )
    stays = (float(hot_m) + 0.3e-3, *calibration.rest.cold_displacement[1:])
    experiments = make_experiments(flexinol.only("pulses", "partial"), config, False)
    found = learn(experiments, config, replace(calibration, rest=replace(calibration.rest, cold_displacement=stays)))
    assert np.all(np.abs(found.transformation_speed) < 1.0)
    assert found.latent_rise > 10.0
