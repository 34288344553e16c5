"""Parameters as a node of ROS 2 has them."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from sma_actuator.config import Config
from sma_actuator.ros.parameters import NodeParameters


class Node:
    """What the parameters ask of a node."""

    def __init__(self):
        self.declared = {}

    def declare_parameter(self, name, value, descriptor):
        self.declared[name] = value, descriptor

    def add_pre_set_parameters_callback(self, callback):
        self.before = callback

    def add_on_set_parameters_callback(self, callback):
        self.check = callback

    def add_post_set_parameters_callback(self, callback):
        self.after = callback

    def set(self, **values):
        """As rclpy does; the result."""
        asked = self.before([Parameter(name.replace("__", "."), value=value) for name, value in values.items()])
        result = self.check(asked)
        if result.successful:
            self.after(asked)
        return result


@pytest.fixture
def stand(make_config):
    node, changes, alive = Node(), [], []
    config = Config.from_mapping(make_config())
    parameters = NodeParameters(node, config, lambda _, names: changes.append(names), lambda: alive.append(True))
    return SimpleNamespace(node=node, parameters=parameters, changes=changes, alive=alive)


def test_each_of_many_that_are_set_is_a_sign_of_life(stand):
    for number in range(3):
        assert stand.node.set(controller__setpoint_timeout=0.1 * number) == SetParametersResult(successful=True)
    assert len(stand.alive) == 3 and stand.parameters.config.controller.setpoint_timeout == 0.2
