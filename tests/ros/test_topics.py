"""One row for each topic: from it the publisher is made, it is listened for, and fed; and the page says what there
is."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message

from sma_actuator.actuator import Actuator
from sma_actuator.base.signals import Branch, Estimate, JointEstimate, Mode, Quality, Reading, Status
from sma_actuator.pair import JointOutput
from sma_actuator.ros.commands import Commands
from sma_actuator.ros.publishers import Publishers
from sma_actuator.ros.self_testing import SelfTesting
from sma_actuator.ros.services import services_of
from sma_actuator.ros.topics import JOINT, WIRE, Of, Step
from sma_msgs_py import diagnostic_status_from

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "ros.md").read_text(encoding="utf-8")


class Publisher:
    """What a node makes in place of a publisher; somebody listens to it where it is the one that is ``heard``."""

    def __init__(self, name, heard):
        self.is_heard, self.messages = name == heard, []

    def get_subscription_count(self):
        return int(self.is_heard)

    def publish(self, message):
        self.messages.append(message)


class Node:
    """A node without ROS, of which somebody hears one topic."""

    def __init__(self, heard):
        self.heard, self.made = heard, {}

    def create_publisher(self, kind, name, qos, event_callbacks):
        self.made[name] = Publisher(name, self.heard)
        return self.made[name]

    def create_guard_condition(self, callback):
        return SimpleNamespace(trigger=lambda: None)


def reporter(config, time_s):
    """Says nothing but what every node must."""
    return SimpleNamespace(
        config=config,
        is_active=True,
        has_to_act=False,
        get_name=lambda: "node",
        time_of=lambda output: time_s,
        events_of=lambda output: (),
        in_short=lambda output: (),
        say=lambda output: None,
        statuses=lambda output: [diagnostic_status_from("node", "", Status(Mode.OFF, message="off"))],
        callback_failed=lambda error: pytest.fail(repr(error)),
    )


@pytest.fixture
def wire(config):
    """Parameters and a step of a wire that is somewhere."""
    sensor = {"instruments.daq.lvdt_channel": 104, "reference_sensor.slope": 0.3, "reference_sensor.offset": -0.001}
    config = config.replace(sensor)
    output = Actuator(config).step(1.0, Reading(1.0, 0.324, 0.006, 0.3, 0.012, 22.0), None)
    somewhere = Estimate(1.0, 0.002, 0.02, 0.0, Branch.COOLING, Quality.DETERMINATE)
    return config, dataclasses.replace(output, estimate=somewhere)


def joint(_):
    config = SimpleNamespace(joint_name="joint", wires=("left", "right"))
    return config, JointOutput(1.0, JointEstimate(0.1, 0.01, 0.5, 0.0), Status(Mode.HOLD), 0.1, (0.001, 0.002))


def whole(row, said):
    """What was published, which may have been its bytes."""
    return deserialize_message(said, row.kind) if isinstance(said, bytes) else said


@pytest.mark.parametrize("row", [*WIRE, *JOINT], ids=lambda row: f"{row.message.__name__}: {row.name}")
def test_a_row_is_all_that_a_topic_needs(row, wire):
    rows = WIRE if row in WIRE else JOINT
    config, output = wire if rows is WIRE else joint(wire)
    node = Node(heard=row.name)
    publishers = Publishers(node, reporter(config, 1.0), rows)
    publishers.turn()
    publishers._publish(output, [output])
    said = node.made[row.name].messages
    assert isinstance(whole(row, said[0]), row.kind)
    publishers.close()
    assert not any(node.made[each.name].messages for each in rows if each.of is not Of.STATUS and each is not row)


def test_all_that_is_said_of_a_step_has_the_same_time_to_the_nanosecond(wire):
    config, output = wire
    step = Step(output, config, output.signals.time_s)
    messages = [whole(row, row.message(step)) for row in WIRE if row.of is not Of.STATUS]
    stamps = {str(message.header.stamp) for message in messages if hasattr(message, "header")}
    assert len(messages) == 5 and len(stamps) == 1


def test_what_is_published_taken_and_answered_stands_on_the_page():
    commands = Commands.__new__(Commands)
    commands._moved = SimpleNamespace(take_joint_command=None)
    wire = SimpleNamespace()
    for row in (*WIRE, *commands.rows(), *services_of(wire), SelfTesting(wire).service):
        assert f"`{row.name}`" in PAGE, row.name
    assert [row.name for row in WIRE if row.is_kept] == ["~/status"]
    assert all(row.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for row in WIRE if row.is_kept)
