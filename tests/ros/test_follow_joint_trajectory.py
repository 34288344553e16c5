"""``~/follow_joint_trajectory``: feedback, tolerances, preemption and cancelling; where control_msgs is installed."""

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("control_msgs")
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from rclpy.action import ActionClient
from test_node import NAME, _enable, _enabled, _status

from sma_actuator.base.signals import Mode
from sma_msgs_py import setpoint_message, trajectory_message

Result = FollowJointTrajectory.Result


class Actions:
    """A client of the action."""

    def __init__(self, client):
        self.client, self.feedback = client, []
        self.action = ActionClient(client.node, FollowJointTrajectory, f"{NAME}/follow_joint_trajectory")
        client.spin_until(self.action.server_is_ready, what="the action")

    def send(self, positions_m, times_s, path_m=0.0, goal_m=0.0, joint="sma_joint"):
        goal = FollowJointTrajectory.Goal(trajectory=trajectory_message(joint, times_s, positions_m))
        goal.path_tolerance = [JointTolerance(name="sma_joint", position=path_m)]
        goal.goal_tolerance = [JointTolerance(name="sma_joint", position=goal_m)]
        sent = self.action.send_goal_async(goal, feedback_callback=self.feedback.append)
        self.client.spin_until(sent.done, what="an answer to the goal")
        return sent.result()

    def result(self, handle):
        future = handle.get_result_async()
        self.client.spin_until(future.done, what="the result")
        return future.result()


def test_goals_are_followed_preempted_canceled_and_rejected(start_bench, make_config, start_node, client):
    bench = start_bench("--load", "weight:0.98")
    node = start_node(make_config(instruments=bench.instruments()))
    actions = Actions(client)
    assert not actions.send([0.0025], [3.0]).accepted
    node.says("the goal was rejected: the output is off; call ~/enable first")
    _enabled(client)
    assert not actions.send([0.0025], [3.0], joint="elbow").accepted
    node.says("it moves elbow, this joint is sma_joint")

    reached = actions.result(actions.send([0.0025], [3.0]))
    assert (reached.status, reached.result.error_code) == (GoalStatus.STATUS_SUCCEEDED, Result.SUCCESSFUL)
    assert bench.truth()[0] == pytest.approx(0.0025, abs=5e-4)
    last = actions.feedback[-1].feedback
    assert list(last.joint_names) == ["sma_joint"]
    assert last.error.positions[0] == pytest.approx(last.desired.positions[0] - last.actual.positions[0])

    violated = actions.result(actions.send([0.0008], [0.2], path_m=1e-5))
    assert violated.status == GoalStatus.STATUS_ABORTED
    assert violated.result.error_code == Result.PATH_TOLERANCE_VIOLATED
    _status(client, lambda s: s.mode is Mode.HOLD)

    first = actions.send([0.0030], [60.0])
    second = actions.send([0.0028], [60.0])
    assert "a new goal has come" in actions.result(first).result.error_string
    client.publish(f"{NAME}/setpoint", setpoint_message(0.0028))
    assert "a setpoint has come" in actions.result(second).result.error_string

    third = actions.send([0.0030], [60.0])
    canceled = third.cancel_goal_async()
    client.spin_until(canceled.done, what="an answer to the cancelling")
    assert actions.result(third).status == GoalStatus.STATUS_CANCELED
    _status(client, lambda s: s.mode is Mode.HOLD)

    fourth = actions.send([0.0030], [60.0])
    assert _enable(client, on=False).success
    assert "the wire does not follow" in actions.result(fourth).result.error_string
