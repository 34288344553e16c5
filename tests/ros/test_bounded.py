"""What a goal holds is counted where rcl has put it, before a Python object is made of it."""

import ctypes
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
from rcl_interfaces.srv import SetParameters
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

from sma_actuator.ros import bounded
from sma_actuator.ros.action import FollowJointTrajectoryServer

FITS = 5_000


def in_c(message):
    """The C structure that rosidl makes of a message; nobody frees it."""
    whole = type(type(message))
    whole.__import_type_support__()
    create, convert = (
        bounded._capsule_pointer(each, None) for each in (whole._CREATE_ROS_MESSAGE, whole._CONVERT_FROM_PY)
    )
    address = ctypes.PYFUNCTYPE(ctypes.c_void_p)(create)()
    assert ctypes.PYFUNCTYPE(ctypes.c_bool, ctypes.py_object, ctypes.c_void_p)(convert)(message, address)
    return bounded._Trajectory.from_address(address)


def goal(points=(), joints=("sma_joint",), others=0, tolerances=(0, 0, 0, 0)):
    """A goal as rcl holds it, of trajectories that rosidl has laid out."""
    made = bounded._Motion()
    made.identity[:] = range(16)
    made.trajectory = in_c(JointTrajectory(joint_names=list(joints), points=list(points)))
    made.multi_dof_trajectory = in_c(MultiDOFJointTrajectory(points=[MultiDOFJointTrajectoryPoint()] * others))
    for place, size in zip(made.tolerances, tolerances, strict=True):
        place.size = size
    return made


def test_a_goal_of_a_size_that_a_topic_may_have_is_looked_at():
    points = [JointTrajectoryPoint(positions=[1e-3], velocities=[0.0])] * FITS
    held = goal(points, tolerances=(1, 0, 1, 0))
    assert bounded.too_long(held) == ""
    assert bounded._look_at_motion(ctypes.addressof(held)) is None
    assert bounded.too_long(goal()) == ""


@pytest.mark.parametrize("field", ["positions", "velocities", "accelerations", "effort"])
def test_a_point_with_a_long_list_is_too_much_whichever_it_is(field):
    held = goal([JointTrajectoryPoint(**{field: [0.0] * 70_000})])
    assert bounded.too_long(held) == "its trajectory takes 560024 bytes, more than 500000; send it in parts"


def test_a_million_points_are_refused_at_once():
    """They need not be there to be counted: nothing of them is read."""
    held = goal([JointTrajectoryPoint()] * 2)
    held.trajectory.points.size = 1_000_000
    began_s = time.process_time()
    assert bounded.too_long(held) == "its trajectory takes 24000000 bytes, more than 500000; send it in parts"
    assert time.process_time() - began_s < 0.1


def test_so_are_lists_of_other_things():
    for more in (
        {"others": 501},
        {"joints": ["a"] * 501},
        *({"tolerances": (501,) * k + (0,) * (4 - k)} for k in (1, 4)),
    ):
        held = goal(**more)
        assert bounded.too_long(held).startswith("it has a list of 501 names, tolerances or points")
    assert bounded.too_long(goal(others=500)) == ""


def test_what_is_refused_knows_whose_goal_it_is_and_is_rejected_with_the_reason():
    held = goal([JointTrajectoryPoint(positions=[0.0] * 70_000)])
    refused = bounded._look_at_motion(ctypes.addressof(held))
    assert list(refused.goal_id.uuid) == list(range(16)) and refused.goal is refused
    said = []
    follower = SimpleNamespace(refuses_goals=lambda: "", report=said.append)
    server = FollowJointTrajectoryServer.__new__(FollowJointTrajectoryServer)
    server._follower = follower
    assert server._on_request(refused.goal).name == "REJECT"
    assert said == [f"~/follow_joint_trajectory: the goal was rejected: {refused}"]


def action(fields):
    """An action whose goals have these fields; its requests are those of another service, which is here."""
    impl = SimpleNamespace(SendGoalService=SetParameters, CancelGoalService="cancel", FeedbackMessage="feedback")
    kinds = {"Result": "result", "Feedback": "feedback"}
    made = SimpleNamespace(Impl=impl, Goal=SimpleNamespace(get_fields_and_field_types=lambda: dict(fields)), **kinds)
    return SimpleNamespace(action_type=made, _action_type=made)


def test_a_server_of_goals_that_are_laid_out_otherwise_is_left_as_it_is():
    server = action(reversed(bounded._MOTION_FIELDS.items()))
    bounded.bound_goals(server)
    assert server._action_type is server.action_type


def test_one_of_those_that_are_known_has_its_requests_looked_at_and_all_else_as_ever():
    server = action(bounded._MOTION_FIELDS.items())
    bounded.bound_goals(server)
    bound, was = server._action_type, server.action_type
    assert bound.Impl.SendGoalService.Request is not SetParameters.Request
    assert bound.Impl.SendGoalService.Response is SetParameters.Response
    assert (bound.Impl.CancelGoalService, bound.Impl.FeedbackMessage) == ("cancel", "feedback")
    assert (bound.Goal, bound.Result, bound.Feedback) == (was.Goal, was.Result, was.Feedback)
