"""A load beyond those that the model was calibrated with, and within what the wire may carry."""

import pytest
from rig import Rig

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode
from sma_actuator.config import read_parameter_file
from sma_actuator.plant.loads import Weight


@pytest.mark.parametrize("load_N", [2.8, 0.05])
def test_it_is_said_before_the_wire_is_heated(load_N):
    rig = Rig(read_parameter_file(shared_file("config/flexinol.yaml")), load=Weight(load_N))
    rig.run(1.0)
    assert rig.status.mode is Mode.OFF and rig.status.fault == "load_uncalibrated"
    done, words = rig.actuator.enable(rig.now_s, True)
    assert done and "the load is none that the model was calibrated with: " in words
    rig.run(rig.config.safety.outside_calibration_time + 1.0)
    assert rig.actuator.latched == "estimator_outside"


def test_of_a_load_that_it_was_nothing_is_said():
    rig = Rig(read_parameter_file(shared_file("config/flexinol.yaml")), load=Weight(0.98))
    rig.run(1.0)
    assert rig.status.fault == ""
    assert rig.actuator.enable(rig.now_s, True)[1] == "the output is on; the wire is held where it is"
