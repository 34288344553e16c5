"""The temperatures of the transformation, as far as the logs tell them."""

from sma_actuator.base.share import shared_file
from sma_actuator.config import Config
from sma_actuator.identify.balance import balance_of


def test_without_full_pulses_nothing_is_said_of_the_transformation():
    config = Config.load(shared_file("config/flexinol.yaml"))
    assert balance_of([], config, config.calibration) == {}
