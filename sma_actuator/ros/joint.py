"""A joint that two wires of this process turn against each other, as a node of its own beside theirs.

``sma_actuator_node --nodes left right --joints joint --ros-args --params-file FILE``: the section ``joint`` of the file
holds the joint's parameters.  What is asked of it and what it shows are angle [rad] and co-contraction [N], in the
fields ``position`` and ``effort`` of a JointState.  The wires' nodes stay what they are; while the joint drives them
they take no setpoints of their own, which would pull against it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import isfinite
from typing import Any, Protocol

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Mode, Output, Status
from sma_actuator.config import Config
from sma_actuator.control.pair import PairParameters
from sma_actuator.pair import JointOutput, PairDriver, PairedWire
from sma_msgs_py import diagnostic_status_from, pair_command_from

from .arguments import RosArguments
from .commands import Commands
from .guard import refuse_what_raises
from .log import ERROR, INFO, Log, namesakes
from .parameters import ROS_PARAMETERS, NodeParameters
from .publishers import Publishers
from .services import CALL_TIMEOUT_s
from .topics import JOINT, Service, offer


class WireNode(PairedWire, Protocol):
    """The node of one of its wires."""

    joint_takes: Callable[[Output], None] | None
    turned_by: Callable[[], str]

    @property
    def config(self) -> Config:
        """The wire's parameters."""

    def get_name(self) -> str:
        """Name of the node."""


class JointNode(Node):
    """One joint on ROS 2.  Raises ConfigError where its parameters will not do, or its wires are not in this
    process."""

    what = "joint"
    is_active = True

    def __init__(self, name: str, arguments: RosArguments, nodes: Sequence[WireNode]):
        super().__init__(name)
        values = arguments.parameters_of(self.get_fully_qualified_name())
        for own in ROS_PARAMETERS:
            values.pop(own, None)
        parameters = PairParameters.from_mapping(values, source=name)
        by_name = {node.get_name(): node for node in nodes}
        missing = [wire for wire in parameters.wires if wire not in by_name]
        if missing:
            raise ConfigError(f"{name}: wires: {', '.join(missing)} is no node of this process; --nodes names them")
        wires = [by_name[wire] for wire in parameters.wires]
        taken = [wire.get_name() for wire in wires if wire.joint_takes is not None]
        if taken:
            raise ConfigError(f"{name}: wires: {', '.join(taken)} turns another joint already")
        self._wires = wires
        self._said: tuple[Any, ...] = (Mode.OFF, "")
        self.log = Log(self)
        self._pair = PairDriver(parameters, [wire.config for wire in wires], wires, self._take_output)
        self._declared = NodeParameters(
            self, parameters, lambda changed, _: self._pair.update(changed), flows=lambda: self._pair.is_driven
        )
        self._commands = Commands(self, self)
        self._topics: Publishers[JointOutput] = Publishers(self, self, JOINT)
        offer(self, [Service("~/clear_fault", Trigger, self._on_clear_fault)])
        refuse_what_raises(self, self.report)
        for number, wire in enumerate(wires):
            wire.joint_takes = partial(self._pair.take_output, number)
            wire.turned_by = lambda: self.get_fully_qualified_name() if self._pair.is_driven else ""

    @property
    def config(self) -> PairParameters:
        """The parameters as they are now."""
        return self._declared.config

    # --- what moves it (commands.py) ---------------------------------------------------------------

    def ignores_commands(self) -> str:
        """None: one that is off says so itself."""
        return ""

    def refuses_goals(self) -> str:
        """Why no goal of the action can be taken now, or ""."""
        return "" if self._pair.is_driven else "the joint is off; call ~/enable first"

    def go_to(self, angle_rad: float) -> str:
        """Hand an angle to the law; "" or why it was refused."""
        return self._pair.go_to(angle_rad)

    def follow(
        self, times_s: list[float], angles_rad: list[float], velocities_rad_s: list[float] | None, delay_s: float
    ) -> str:
        """Hand a trajectory to the law; without points the motion ends where its reference has come.  "" or why not."""
        return self._pair.follow(times_s, angles_rad, velocities_rad_s, delay_s)

    def take_joint_command(self, message: JointState) -> str:
        """Hand an angle and a co-contraction to the law; "" or why they were refused."""
        angle_rad, cocontraction_N = pair_command_from(message, self.config.joint_name)
        refusal = self._pair.command(angle_rad, cocontraction_N)
        if not refusal and isfinite(angle_rad):
            self._commands.preempt("joint commands are followed")
        return refusal

    def hold(self) -> None:
        """End the motion where the joint is measured to be."""
        self._pair.hold()

    @property
    def usual_end(self) -> float:
        """How near the end the joint must come where a goal does not say [rad]: as near as its wires."""
        ends_m = [wire.config.controller.arming_distance * wire.config.wire.full_stroke_m for wire in self._wires]
        return max(ends_m) / self.config.pulley_radius

    def in_words(self, error_rad: float) -> str:
        """How far off it is."""
        return f"{error_rad:+.3f} rad"

    # --- on, off and faults ------------------------------------------------------------------------

    @property
    def parts(self) -> Sequence[WireNode]:
        """Its wires."""
        return self._wires

    def switch_on(self, wanted: Callable[[], bool] = lambda: True) -> tuple[bool, str]:
        """Both wires on, if they are ``wanted`` still when their turn has come; whether they are, and a sentence."""
        done, words = self._pair.switch_on(wanted)
        return done, words + namesakes(self)

    def switch_off(self) -> tuple[bool, str]:
        """Both wires off, from any thread; whether they are, and what became of each."""
        return self._pair.switch_off()

    def _on_clear_fault(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        response.success, response.message = self._pair.clear_fault(CALL_TIMEOUT_s)
        if not response.success:
            self.report(response.message)
        return response

    def report(self, sentence: str) -> None:
        """Say why something was refused."""
        self.log.refuse(sentence)

    def callback_failed(self, error: Exception) -> None:
        """An exception that no message is to blame for: both wires go off, the node goes on."""
        self.report(f"{type(error).__name__} in a ROS callback: {error}; {self.switch_off()[1]}")

    # --- what it says (publishers.py) -----------------------------------------------------------------

    def _take_output(self, output: JointOutput) -> None:
        """Hand an output over, in the control thread of the first wire."""
        self._topics.take(output)

    def turn(self) -> None:
        """What the ROS thread does between callbacks."""
        self._topics.turn()

    def wake_no_more(self) -> None:
        """End the hand-off, so that ROS can be shut down."""
        self._topics.close()

    @property
    def has_to_act(self) -> bool:
        """Whether there is a goal to be watched."""
        return self._commands.pursues

    def time_of(self, output: JointOutput) -> float:
        """When it was measured [s]."""
        return output.time_s

    def events_of(self, output: JointOutput) -> Sequence[str]:
        """The logs of its wires tell them."""
        return ()

    def in_short(self, output: JointOutput) -> tuple[Any, ...]:
        """What of it is said in words."""
        return output.status.mode, output.status.fault, output.status.limits

    def say(self, output: JointOutput | None) -> None:
        """Say what is new in an output, and look how a goal goes."""
        if output is None:
            return
        status = output.status
        self._commands.watch(output.time_s, output.estimate.angle_rad, status)
        if (status.mode, status.fault) != self._said:
            self._said = status.mode, status.fault
            self.log.say(
                ERROR if status.fault else INFO, status.message if status.fault else f"the joint: {status.message}"
            )

    def statuses(self, output: JointOutput | None) -> list[DiagnosticStatus]:
        """The status."""
        status = output.status if output is not None else Status(Mode.OFF, message="no reading has come yet")
        status = replace(status, values={**status.values, **self._declared.key_values()})
        return [diagnostic_status_from(self.get_fully_qualified_name(), self.config.joint_name, status)]
