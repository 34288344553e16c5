"""The temperatures of the transformation, as far as the logs tell them."""

import numpy as np

from sma_actuator.base.share import shared_file
from sma_actuator.config import Config
from sma_actuator.identify.balance import balance_of, passages


def test_without_full_pulses_nothing_is_said_of_the_transformation():
    config = Config.load(shared_file("config/flexinol.yaml"))
    assert balance_of([], config, config.calibration) == {}


def test_a_passage_goes_from_end_to_end_without_turning_back():
    there = np.linspace(1.0, 0.0, 21)
    turned = np.concatenate((np.linspace(1.0, 0.5, 11), np.linspace(0.5, 1.0, 11)))
    wavering = np.concatenate((np.linspace(1.0, 0.4, 13), np.linspace(0.4, 0.7, 7), np.linspace(0.7, 0.0, 15)))
    share = np.concatenate((there, there[::-1], turned, wavering))
    (heating, down), (cooling, up) = [(h, share[rows]) for h, rows in passages(share)]
    assert heating and not cooling
    np.testing.assert_allclose(down, np.arange(0.7, 0.29, -0.05))
    np.testing.assert_allclose(up, down[::-1])
