"""What becomes of a goal of the action, for a joint in the bench's own time; with the real action:
test_follow_joint_trajectory.py."""

import sys
from types import ModuleType, SimpleNamespace

import pytest

pytest.importorskip("rclpy")
from trajectory_msgs.msg import JointTrajectory

from sma_actuator.base.share import shared_file
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.bench.joint import JointBench
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.control.pair import PairParameters
from sma_actuator.pair import SteppedPair
from sma_actuator.plant.joint import Joint
from sma_actuator.ros import action
from sma_actuator.ros.joint import JointNode
from sma_msgs_py import trajectory_message

FILE = shared_file("config/pair.yaml")


class Result(SimpleNamespace):
    """As the action's."""

    SUCCESSFUL, INVALID_GOAL, PATH_TOLERANCE_VIOLATED, GOAL_TOLERANCE_VIOLATED = 0, -1, -4, -5


class Goal:
    """A goal, and its handle in the server."""

    def __init__(self, trajectory, path_rad=0.0):
        tolerance = SimpleNamespace(name="joint", position=path_rad)
        seconds = SimpleNamespace(sec=0, nanosec=0)
        self.request = SimpleNamespace(
            trajectory=trajectory, path_tolerance=[tolerance], goal_tolerance=[], goal_time_tolerance=seconds
        )
        self.is_cancel_requested, self.feedback, self.ended, self.result = False, [], "", None

    def publish_feedback(self, feedback):
        self.feedback.append(feedback)

    def execute(self, finish):
        self.result = finish(self)

    def succeed(self):
        self.ended = "succeeded"

    def abort(self):
        self.ended = "aborted"

    def canceled(self):
        self.ended = "canceled"


class Stand:
    """A joint of the bench that is driven, with the action of its node."""

    what = JointNode.what
    usual_end, in_words, follow, hold, refuses_goals = (
        vars(JointNode)[name] for name in ("usual_end", "in_words", "follow", "hold", "refuses_goals")
    )

    def __init__(self):
        mapping = {**read_parameter_file(FILE, "joint"), "joint_command_timeout": 0.0}
        self.config = PairParameters.from_mapping(mapping)
        configs = [Config.load(FILE, name) for name in self.config.wires]
        at_zero_m = self.config.displacement_at_zero
        joint = Joint(self.config.pulley_radius, at_zero_m, self.config.series_stiffness)
        benches = JointBench.from_name("flexinol", joint, seed=1).benches
        instruments = [(InProcessSupply(b, c), InProcessDaq(b, c)) for b, c in zip(benches, configs)]
        self._pair = SteppedPair(self.config, configs, instruments, VirtualClock(benches[0]))
        self._wires = [SimpleNamespace(config=config) for config in configs]
        self.reported = []
        node = SimpleNamespace(get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=0)))
        self.server = action.FollowJointTrajectoryServer(node, self, lambda: self.output.time_s)
        self.run(0.5)

    def report(self, sentence):
        self.reported.append(sentence)

    def run(self, seconds):
        for _ in range(round(seconds / 0.05)):
            self.output = self._pair.run_for(0.05)
            self.server.watch(self.output.time_s, self.output.estimate.angle_rad, self.output.status)

    def take(self, goal):
        taken = self.server._on_request(goal.request) is action.GoalResponse.ACCEPT
        if taken:
            self.server._on_accepted(goal)
        return taken

    def switch_on(self):
        done, words = self._pair.switch_on()
        assert done, words
        self.run(6.0)


@pytest.fixture
def stand(monkeypatch):
    module, package = ModuleType("control_msgs.action"), ModuleType("control_msgs")
    point = lambda: SimpleNamespace(positions=[])  # noqa: E731
    feedback = lambda: SimpleNamespace(header=SimpleNamespace(), desired=point(), actual=point(), error=point())  # noqa: E731
    module.FollowJointTrajectory = SimpleNamespace(Result=Result, Feedback=feedback)
    monkeypatch.setitem(sys.modules, "control_msgs", package)
    monkeypatch.setitem(sys.modules, "control_msgs.action", module)
    of_its_own = SimpleNamespace(Goal=SimpleNamespace(get_fields_and_field_types=dict))  # laid out as no goal is
    server = SimpleNamespace(action_type=of_its_own)
    monkeypatch.setattr(action, "ActionServer", lambda *arguments, **callbacks: server)
    return Stand()


def test_a_joint_follows_goals_of_the_action(stand):
    goal = Goal(trajectory_message("joint", [2.0], [0.15]))
    assert not stand.take(goal)
    assert "the goal was rejected: the joint is off; call ~/enable first" in stand.reported[-1]
    stand.switch_on()
    assert not stand.take(Goal(trajectory_message("elbow", [2.0], [0.15]))) and not stand.take(Goal(JointTrajectory()))

    assert stand.take(goal)
    stand.run(8.0)
    assert (goal.ended, goal.result.error_code) == ("succeeded", Result.SUCCESSFUL), goal.result
    assert abs(stand.output.estimate.angle_rad - 0.15) < 2.0 * stand.usual_end
    assert goal.feedback[-1].desired.positions == [0.15]

    violated = Goal(trajectory_message("joint", [0.3], [-0.2]), path_rad=0.01)
    assert stand.take(violated)
    stand.run(1.0)
    assert (violated.ended, violated.result.error_code) == ("aborted", Result.PATH_TOLERANCE_VIOLATED)
    assert "the joint was " in violated.result.error_string and " rad off; it is held" in violated.result.error_string


def test_a_goal_that_is_cancelled_ends_where_the_reference_has_come(stand):
    stand.switch_on()
    goal = Goal(trajectory_message("joint", [4.0], [0.2]))
    assert stand.take(goal)
    stand.run(2.0)
    there_rad, goal.is_cancel_requested = stand.output.reference_rad, True
    stand.run(0.1)
    assert goal.ended == "canceled" and "the joint is held where its reference has come" in goal.result.error_string
    stand.run(1.0)
    # The step that has seen the cancel was made already, and the next one's law still follows.
    assert stand.output.reference_rad == pytest.approx(there_rad, abs=0.2 / 4.0 * 0.15)


def test_a_goal_ends_with_the_fault_that_switches_the_joint_off(stand):
    stand.switch_on()
    goal = Goal(trajectory_message("joint", [4.0], [0.2]))
    assert stand.take(goal)
    stand.run(1.0)
    stand._pair.wires[0].driver.call(lambda actuator, now_s: actuator.raise_fault(now_s, "node_lost", "provoked"))
    stand.run(0.2)
    assert goal.ended == "aborted" and "the joint does not follow: off: left: off: " in goal.result.error_string


def test_somebody_else_who_commands_ends_it(stand):
    stand.switch_on()
    goal = Goal(trajectory_message("joint", [4.0], [0.2]))
    assert stand.take(goal)
    stand.server.preempt("a setpoint has come")
    assert (goal.ended, goal.result.error_string) == ("aborted", "preempted: a setpoint has come")
