"""What moves a wire, or a joint: setpoints, trajectories, streams of joint commands, and the action; the same for
both."""

from __future__ import annotations

import contextlib
import time
from typing import Any, Protocol

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from trajectory_msgs.msg import JointTrajectory

from sma_actuator.base.signals import Status
from sma_msgs_py import position_from, start_from, trajectory_from

from .action import Follower, FollowJointTrajectoryServer
from .bounded import LONGEST_TRAJECTORY_B
from .topics import Taken

LONGEST_COMMAND_B = 20_000  #: for some hundred joints


class Moved(Follower, Protocol):
    """What is moved: positions are in m where it is a wire, in rad where it is a joint."""

    def ignores_commands(self) -> str:
        """Why none is looked at now, or ""."""

    def go_to(self, position: float) -> str:
        """Take a setpoint; "" or why it was refused."""

    def take_joint_command(self, message: JointState) -> str:
        """Take one of a stream; "" or why it was refused.  Raises ValueError with a sentence."""


class Commands:
    """Takes them for one node; every method is called in its ROS thread."""

    def __init__(self, node: Any, moved: Moved):
        self._node, self._moved = node, moved
        for row in self.rows():
            row.subscribe(node, moved.report)
        self._follow: FollowJointTrajectoryServer | None = None
        with contextlib.suppress(ModuleNotFoundError):  # control_msgs comes with ros2_control
            self._follow = FollowJointTrajectoryServer(node, moved, time.monotonic)

    def rows(self) -> tuple[Taken, ...]:
        """The topics."""
        return (
            Taken("~/setpoint", Float64, self._on_setpoint),
            Taken("~/joint_trajectory", JointTrajectory, self._on_trajectory, LONGEST_TRAJECTORY_B, "trajectory"),
            Taken("~/joint_command", JointState, self._moved.take_joint_command, LONGEST_COMMAND_B, "joint command"),
        )

    def _on_setpoint(self, message: Float64) -> str:
        ignored = self._moved.ignores_commands()
        if ignored:
            return f"a setpoint was ignored: {ignored}"
        self.preempt("a setpoint has come")
        return self._moved.go_to(position_from(message))

    def _on_trajectory(self, message: JointTrajectory) -> str:
        ignored = self._moved.ignores_commands()
        if ignored:
            return f"a trajectory was ignored: {ignored}"
        trajectory = trajectory_from(message, self._moved.config.joint_name)
        delay_s = start_from(message, self._node.get_clock().now().nanoseconds)
        self.preempt("another trajectory has come")
        return self._moved.follow(*trajectory, delay_s)

    def preempt(self, why: str) -> None:
        """Somebody else commands: the goal that is pursued, if there is one, has ended."""
        if self._follow is not None:
            self._follow.preempt(why)

    @property
    def pursues(self) -> bool:
        """Whether a goal is pursued; may be asked from any thread."""
        return self._follow is not None and self._follow.pursues

    def watch(self, now_s: float, position: float, status: Status) -> None:
        """Look how a goal goes with what a step has said; NaN where nobody knows the position."""
        if self._follow is not None:
            self._follow.watch(now_s, position, status)
