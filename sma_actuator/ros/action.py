"""The action ``~/follow_joint_trajectory``, where ``control_msgs`` is installed; without it the rest of the node works.

A goal is a trajectory whose end somebody waits for.  It goes to the loop as one from ``~/joint_trajectory`` does; here
is only watched, with every output, what becomes of it.  Nothing blocks: a goal is *accepted* while it is pursued, and
is executed, in no time, with its result.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan
from typing import Any, Protocol

from rclpy.action import ActionServer, CancelResponse, GoalResponse

from sma_actuator.base.signals import Mode, Status
from sma_actuator.control.following import Outcome, Pursuit, tolerance
from sma_actuator.control.setpoints import Trajectory
from sma_msgs_py import start_from, time_message, trajectory_from

from .bounded import Refused, bound_goals

#: How late it may come to the end where a goal does not say: a wire cools in seconds.
LATE_s = 10.0
TAKEN_s = 0.5  #: by then the loop has taken a trajectory, and what it says is of that


class Follower(Protocol):
    """What the action asks of what it moves: a wire, with positions in m, or a joint, in rad."""

    what: str  #: it is, in words

    @property
    def config(self) -> Any:
        """Its parameters."""

    @property
    def usual_end(self) -> float:
        """How near the end it must come where a goal does not say."""

    def in_words(self, error: float) -> str:
        """How far off it is, with its unit."""

    def refuses_goals(self) -> str:
        """Why no goal can be taken now, or ""."""

    def follow(
        self, times_s: list[float], positions: list[float], velocities: list[float] | None, delay_s: float
    ) -> str:
        """Hand a trajectory to the loop; without points the motion ends where its reference has come.  "" or why
        not."""

    def hold(self) -> None:
        """End the motion where it is measured to be."""

    def report(self, sentence: str) -> None:
        """Say why something was refused."""


class FollowJointTrajectoryServer:
    """Serves the action for one node; every method is called in its ROS thread."""

    def __init__(self, node: Any, follower: Follower, now_s: Callable[[], float]):
        """Raises ModuleNotFoundError where ``control_msgs`` is not installed."""
        from control_msgs.action import FollowJointTrajectory

        self._action = FollowJointTrajectory
        self._node, self._follower, self._now_s = node, follower, now_s
        self._handle: Any = None  #: the handle of the one that is pursued
        self._pursuit: Pursuit | None = None
        self._joint_name = ""
        self._tracked = False  #: the loop has begun with it
        self._taken_s = nan  #: when it was handed to the loop
        self._server = ActionServer(
            node,
            FollowJointTrajectory,
            "~/follow_joint_trajectory",
            execute_callback=lambda handle: FollowJointTrajectory.Result(),
            goal_callback=self._on_request,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )
        bound_goals(self._server)

    @property
    def pursues(self) -> bool:
        """Whether there is a goal to be watched; may be asked from any thread."""
        return self._handle is not None

    def _on_request(self, request: Any) -> GoalResponse:
        try:
            refusal = self._follower.refuses_goals() or self._why_not(request)
        except Exception as error:  # noqa: BLE001 - whatever it is, the next goal is as good as any
            refusal = f"{type(error).__name__}: {error}"
        if refusal:
            self._follower.report(f"~/follow_joint_trajectory: the goal was rejected: {refusal}")
        return GoalResponse.REJECT if refusal else GoalResponse.ACCEPT

    def _why_not(self, request: Any) -> str:
        """Why a goal cannot be followed, or ""."""
        if isinstance(request, Refused):
            return str(request)
        try:
            times_s, positions_m, velocities_m_s = trajectory_from(request.trajectory, self._follower.config.joint_name)
            duration_s = Trajectory(times_s, positions_m, velocities_m_s=velocities_m_s).duration_s
        except ValueError as error:
            return str(error)
        if not duration_s + start_from(request.trajectory, self._node.get_clock().now().nanoseconds) >= 0.0:
            return "its last point was due already"
        return ""

    def _on_accepted(self, handle: Any) -> None:
        self.preempt("a new goal has come")
        request, config = handle.request, self._follower.config
        times_s, positions, velocities = trajectory_from(request.trajectory, config.joint_name)
        delay_s = start_from(request.trajectory, self._node.get_clock().now().nanoseconds)
        late_s = request.goal_time_tolerance.sec + 1e-9 * request.goal_time_tolerance.nanosec
        self._pursuit = Pursuit(
            Trajectory(times_s, positions, velocities_m_s=velocities),
            self._now_s() + delay_s,
            path=tolerance(self._of_joint(request.path_tolerance), inf),
            end=tolerance(self._of_joint(request.goal_tolerance), self._follower.usual_end),
            late_s=tolerance(late_s, LATE_s),
        )
        self._taken_s = self._now_s()
        self._handle, self._tracked, self._joint_name = handle, False, config.joint_name
        self._follower.follow(times_s, positions, velocities, delay_s)

    def _of_joint(self, tolerances: Any) -> float:
        asked = [each.position for each in tolerances if each.name in (self._follower.config.joint_name, "")]
        return float(asked[0]) if asked else 0.0

    def watch(self, now_s: float, position: float, status: Status) -> None:
        """Look at what a step has said: feedback, and the result where there is one.  NaN: nobody knows the
        position."""
        handle, pursuit, follower = self._handle, self._pursuit, self._follower
        if handle is None or pursuit is None:
            return
        if handle.is_cancel_requested:
            follower.follow([], [], None, 0.0)
            words = f"canceled: the {follower.what} is held where its reference has come"
            self._end("canceled", self._action.Result.SUCCESSFUL, words)
            return
        tracking = status.mode is Mode.TRACKING
        self._tracked = self._tracked or (tracking and pursuit.begun(now_s))
        if status.mode is Mode.OFF or (self._tracked and not tracking):
            words = f"the {follower.what} does not follow: {status.message}"
            self._end("abort", self._action.Result.INVALID_GOAL, words)
            return
        if status.values.get("joint_commands") == "followed" and now_s > self._taken_s + TAKEN_s:
            self.preempt("joint commands are followed")
            return
        setpoint = pursuit.setpoint(now_s)
        self._feed_back(setpoint, position)
        outcome = pursuit.look(now_s, position)
        if outcome is Outcome.REACHED:
            self._end("succeed", self._action.Result.SUCCESSFUL, "")
        elif outcome is not None:
            follower.hold()
            path = outcome is Outcome.PATH_VIOLATED
            code = self._action.Result.PATH_TOLERANCE_VIOLATED if path else self._action.Result.GOAL_TOLERANCE_VIOLATED
            off = follower.in_words(position - setpoint)
            self._end("abort", code, f"{outcome.value}: the {follower.what} was {off} off; it is held where it is")

    def preempt(self, why: str) -> None:
        """Somebody else commands: the goal that is pursued, if there is one, has ended."""
        if self._handle is not None:
            self._end("abort", self._action.Result.INVALID_GOAL, f"preempted: {why}")

    def _feed_back(self, setpoint: float, position: float) -> None:
        feedback = self._action.Feedback()
        feedback.joint_names = [self._joint_name]
        feedback.header.stamp = time_message(self._node.get_clock().now().nanoseconds)
        feedback.desired.positions = [setpoint]
        feedback.actual.positions = [position]
        feedback.error.positions = [setpoint - position]
        self._handle.publish_feedback(feedback)

    def _end(self, how: str, code: int, words: str) -> None:
        handle, self._handle, self._pursuit = self._handle, None, None
        result = self._action.Result(error_code=code, error_string=words)

        def finish(handle: Any) -> Any:
            getattr(handle, how)()
            return result

        handle.execute(finish)
