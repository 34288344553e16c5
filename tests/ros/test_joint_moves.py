"""What moves a joint of two wires, over real processes and topics: setpoints, trajectories, ros2_control."""

import math
from itertools import pairwise
from pathlib import Path

import pytest
from test_joint_node import CALM, FILE, NAMES, enabled, joint_parameters, reached, status_of

pytest.importorskip("rclpy")
pytest.importorskip("xacro")
import xacro
from plugin_double import PluginDouble
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from sma_actuator.config import read_parameter_file
from sma_msgs_py import setpoint_message, signals_from, trajectory_message

URDF = Path(__file__).resolve().parents[2] / "urdf" / "two_wires.urdf.xacro"
RATE_rad_s = 0.1  #: at which an angle is followed
NEAR_rad = 0.03


@pytest.fixture
def joint(start_bench, make_config, start_node, client):
    """``(bench, signals)`` of a joint that is on: values of every step."""
    bench = start_bench("--load", "joint:0.004,0.0017")
    calibration = read_parameter_file(FILE, "left")["calibration"]
    wires = {
        name: make_config(instruments=bench.instruments(number), joint_name=name, calibration=calibration, **CALM)
        for number, name in enumerate(NAMES)
    }
    own = joint_parameters(cocontraction=0.6, angle_rate_limit=RATE_rad_s)
    start_node({**wires, "joint": own}, "--", "--joints", "joint", names=NAMES)
    for name in NAMES:
        status_of(client, name, lambda s: s.values["lifecycle"] == "active")
    messages = client.listen("/joint/signals", JointState)
    client.spin_until(lambda: enabled(client), what="enabling")
    reached(client, lambda: messages and signals_from(messages[-1])["cocontraction_N"] > 0.4, "the slack taken up")
    return bench, messages


def test_setpoints_and_trajectories_move_it_and_their_end_is_no_step(joint, client):
    bench, messages = joint
    now = lambda name: signals_from(messages[-1])[name]  # noqa: E731

    client.publish("/joint/setpoint", setpoint_message(0.15))
    reached(client, lambda: abs(now("angle_rad") - 0.15) < NEAR_rad, "the setpoint")
    assert float(bench.tell("BENC:JOIN:ANGL?")) == pytest.approx(0.15, abs=0.1)

    # A motion to the other side, which is ended on its way.
    client.publish("/joint/joint_trajectory", trajectory_message("joint", [8.0], [-0.15]))
    reached(client, lambda: now("reference_rad") < 0.1, "the way")
    begin = len(messages)
    client.publish("/joint/joint_trajectory", JointTrajectory(joint_names=["joint"]))
    held = status_of(client, "joint", lambda s: s.mode.value == "hold")
    client.spin_until(lambda: len(messages) > begin + 40, what="what came after")
    assert held.fault == ""
    values = list(map(signals_from, messages[begin - 20 :]))
    references = [each["reference_rad"] for each in values]
    ended = references[-1]
    assert ended == now("asked_angle_rad") and -0.15 < ended < 0.1, "it ends where its reference has come"
    times_s = [message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec for message in messages[begin - 20 :]]
    for (before, after), (then_s, now_s) in zip(pairwise(references), pairwise(times_s), strict=False):
        assert abs(after - before) <= RATE_rad_s * (now_s - then_s) + 1e-3
    # And the wires are not asked to step either: so far a step of the reference would have moved them.
    for name in NAMES:
        setpoints_m = [each[f"{name}_setpoint_m"] for each in values]
        assert max(abs(b - a) for a, b in pairwise(setpoints_m)) < 1.5e-4


@pytest.mark.long  # of one wire: test_joint_command.py
def test_ros2_control_moves_it_and_its_death_is_seen(joint, client):
    bench, messages = joint
    plugin = PluginDouble(xacro.process_file(URDF).toxml())
    try:
        assert plugin.joints == ["joint"]
        client.spin_until(lambda: math.isfinite(plugin.position_m), what="a state")
        plugin.go(0.12, 3.0)
        reached(
            client, lambda: plugin.sent_m and abs(plugin.position_m - 0.12) < NEAR_rad, "the goal of the controller"
        )
        assert float(bench.tell("BENC:JOIN:ANGL?")) == pytest.approx(0.12, abs=0.1)
        assert status_of(client, "joint", lambda s: s.mode.value == "tracking").fault == ""
        plugin.go(-0.05, 3.0)
        reached(client, lambda: abs(plugin.position_m + 0.05) < NEAR_rad, "the way back")
    finally:
        plugin.close()
    lost = status_of(client, "joint", lambda s: s.fault == "setpoint_stale")
    assert lost.mode.value == "hold" and "joint_command_timeout is 0.5 s" in lost.message
    angle_rad = signals_from(messages[-1])["angle_rad"]
    assert abs(signals_from(messages[-1])["asked_angle_rad"] - angle_rad) < 0.1, "held where it was"
