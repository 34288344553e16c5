"""Parameters as a node of ROS 2 has them."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")
from rclpy.parameter import Parameter

from sma_actuator.base.parameters import walk
from sma_actuator.base.share import shared_file
from sma_actuator.config import Config
from sma_actuator.ros.parameters import NodeParameters

FLEXINOL = shared_file("config/flexinol.yaml")


class Node:
    """What the parameters ask of a node."""

    def __init__(self):
        self.declared = {}
        self.said = []

    def get_logger(self):
        return SimpleNamespace(warning=self.said.append)

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
def make_stand(make_config):
    def make(**parameters):
        node, changes, alive, flows = Node(), [], [], []
        config = Config.from_mapping(make_config(**parameters))
        parameters = NodeParameters(
            node, config, lambda _, names: changes.append(names), lambda: alive.append(True), lambda: bool(flows)
        )
        return SimpleNamespace(node=node, parameters=parameters, changes=changes, alive=alive, flows=flows)

    return make


@pytest.fixture
def stand(make_stand):
    return make_stand()


def test_each_of_many_that_are_set_is_a_sign_of_life(stand):
    for number in range(3):
        assert stand.node.set(controller__setpoint_timeout=0.1 * number).successful
    assert len(stand.alive) == 3 and stand.parameters.config.controller.setpoint_timeout == 0.2


def test_what_is_set_to_what_it_is_asks_nothing_of_the_loop(stand):
    """Five hundred of one request took 25 s, a step of the loop each."""
    for _ in range(2):
        assert stand.node.set(controller__setpoint_timeout=3.0).successful
    assert stand.changes == [["controller.setpoint_timeout"]]


GUARDING = sorted(name for name, _, declared, _ in walk(Config.load(FLEXINOL)) if declared.stricter)


def neighbours(value, declared, kind):
    """A stricter value and a looser one."""
    if declared.choices:
        at = declared.choices.index(value)
        return declared.choices[at + 1], declared.choices[at - 1]
    step = 1 if kind == "int" else 0.01 * abs(value) or 0.001
    return (value - step, value + step) if declared.live == "lower" else (value + step, value - step)


@pytest.mark.parametrize("name", GUARDING)
def test_while_current_flows_what_guards_can_only_be_made_stricter(make_stand, name):
    stand = make_stand(**{"controller.on_setpoint_loss": "bias", "controller.setpoint_timeout": 1.0})
    value, declared, kind = next((v, d, k) for n, v, d, k in walk(stand.parameters.config) if n == name)
    more, less = neighbours(value, declared, kind)
    setting = name.replace(".", "__")
    assert declared.stricter in stand.node.declared[name][1].additional_constraints
    stand.flows.append(True)
    refused = stand.node.set(**{setting: less})
    assert not refused.successful
    assert f"guards less; while the output is on it can only be made {declared.stricter}: " in refused.reason
    assert stand.node.set(**{setting: more}).successful and stand.changes == [[name]]
    assert not stand.node.said and not stand.parameters.key_values()
    stand.flows.clear()
    assert stand.node.set(**{setting: less}).successful and len(stand.changes) == 2
    said, shown = stand.node.said[0], stand.parameters.key_values()["loosened"]
    value, more, less = (v if declared.choices else f"{v:g}" for v in (value, more, less))
    assert (said, shown) == (f"{name}: {more} → {less} guards less", f"{name}: {value} → {less}")


def test_while_current_flows_no_silence_is_allowed_for_ever(make_stand):
    """0 stands for no bound at all."""
    stand = make_stand(**{"controller.setpoint_timeout": 1.0})
    stand.flows.append(True)
    refused = stand.node.set(controller__setpoint_timeout=0.0)
    assert "setpoint_timeout: 1 → 0 guards less" in refused.reason
    assert stand.node.set(controller__setpoint_timeout=0.5).successful


def test_gains_go_either_way_while_current_flows(stand):
    stand.flows.append(True)
    assert all(stand.node.set(controller__kp=value).successful for value in (100.0, 900.0, 300.0))


def test_all_that_is_live_of_what_guards_the_wire_says_which_way_is_stricter():
    sections = ("safety", "thermal", "wire", "loop", "supply", "instruments")
    live = {name for name, _, declared, _ in walk(Config.load(FLEXINOL)) if declared.live}
    assert {name for name in live if name.split(".")[0] in sections} <= set(GUARDING)
