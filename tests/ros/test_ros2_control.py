"""ros2_control itself moves a wire: its plugin, controller manager and joint_trajectory_controller; where they are
installed."""

import os
import signal

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("launch_ros")
pytest.importorskip("control_msgs")
pytest.importorskip("controller_manager")
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from control_msgs.action import FollowJointTrajectory
from processes import parameter_file, wait_until
from rclpy.action import ActionClient
from test_node import NAME, _enabled

from sma_msgs_py import trajectory_message

try:
    get_package_prefix("joint_state_topic_hardware_interface")
except PackageNotFoundError:
    pytest.skip("the hardware plugin is not installed", allow_module_level=True)


@pytest.fixture
def send(client):
    """``send(position_m)``: the result of a goal of the controller."""
    action = ActionClient(client.node, FollowJointTrajectory, "/joint_trajectory_controller/follow_joint_trajectory")

    def send(position_m):
        client.spin_until(action.server_is_ready, what="the controller")
        goal = FollowJointTrajectory.Goal(trajectory=trajectory_message("sma_joint", [5.0], [position_m]))
        sent = action.send_goal_async(goal)
        client.spin_until(sent.done, what="an answer to the goal")
        assert sent.result().accepted
        result = sent.result().get_result_async()
        client.spin_until(result.done, what="the result")
        return result.result().result

    yield send
    action.destroy()


def test_a_goal_succeeds_and_after_the_death_of_the_node_it_is_violated(
    start_bench, make_config, folder, launch, client, send, tmp_path
):
    bench = start_bench("--load", "weight:0.98")
    path = parameter_file(folder, {"sma_actuator": make_config(instruments=bench.instruments())})
    launch("ros2_control", f"params_file:={path}")
    _enabled(client)
    result = send(0.0025)
    assert result.error_code == FollowJointTrajectory.Result.SUCCESSFUL, result.error_string
    assert bench.truth()[0] == pytest.approx(0.0025, abs=4e-4)

    os.kill(int((tmp_path / "node.pid").read_text()), signal.SIGKILL)
    wait_until(lambda: bench.current_A() == 0.0, what="the watchdog of the supply")
    violated = (
        FollowJointTrajectory.Result.PATH_TOLERANCE_VIOLATED,
        FollowJointTrajectory.Result.GOAL_TOLERANCE_VIOLATED,
    )
    assert send(0.0008).error_code in violated
    assert client.node.count_publishers(f"{NAME}/joint_states") == 0
