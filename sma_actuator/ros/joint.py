"""A joint that two wires of this process turn against each other, as a node of its own beside theirs.

``sma_actuator_node --nodes left right --joints joint --ros-args --params-file FILE``: the section ``joint`` of the file
holds the joint's parameters.  What is asked of it and what it shows are angle [rad] and co-contraction [N], in the fields
``position`` and ``effort`` of a JointState.  The wires' nodes stay what they are; a wire's own setpoints last until the
next step of the joint.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Mode, Output, Status
from sma_actuator.config import Config
from sma_actuator.control.pair import PairParameters
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.pair import JointOutput, PairDriver, PairedWire
from sma_msgs_py import (
    diagnostic_status_from,
    joint_estimate_message,
    pair_command_from,
    signals_message,
    time_message,
)

from .arguments import RosArguments
from .guard import refuse_what_raises
from .parameters import ROS_PARAMETERS, NodeParameters
from .publishing import Handoff, is_heard
from .trajectories import trajectory_of
from .words import Refusals

CALL_TIMEOUT_s = 0.6  #: a service waits no longer for the control thread of either wire
STATUS_PERIOD_s = 1.0
LONGEST_COMMAND_B = 20_000  #: for some hundred joints
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_DEPTH = 10


class WireNode(PairedWire, Protocol):
    """The node of one of its wires."""

    joint_takes: Callable[[Output], None] | None

    @property
    def config(self) -> Config:
        """The wire's parameters."""

    def get_name(self) -> str:
        """Name of the node."""

    def stamp(self, time_s: float) -> Any:
        """ROS time at which the loop's clock was at ``time_s``."""


class JointNode(Node):
    """One joint on ROS 2.  Raises ConfigError where its parameters will not do, or its wires are not in this process."""

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
        self._monotonic, self._refusals = MonotonicClock(), Refusals()
        self._wires = wires
        self._status_due_s = -math.inf
        self._published: tuple[Any, ...] = ()
        self._said: tuple[Any, ...] = (Mode.OFF, "")
        self._pair = PairDriver(parameters, [wire.config for wire in wires], wires, self._take_output)
        self._declared = NodeParameters(self, parameters, lambda changed, _: self._pair.update(changed))
        self._joint_states = self.create_publisher(JointState, "~/joint_states", _DEPTH)
        self._signals = self.create_publisher(JointState, "~/signals", _DEPTH)
        self._status = self.create_publisher(DiagnosticStatus, "~/status", _LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", _DEPTH)
        self.create_subscription(JointState, "~/joint_command", self._on_joint_command, _DEPTH, raw=True)
        self.create_subscription(JointTrajectory, "~/joint_trajectory", self._on_trajectory, _DEPTH, raw=True)
        self.create_service(Trigger, "~/clear_fault", self._on_clear_fault)
        self._woken = self.create_guard_condition(self._take_news)
        refuse_what_raises(self, self.report)
        self._handoff: Handoff[JointOutput] = Handoff(self.get_name(), self._publish, self.callback_failed)
        for number, wire in enumerate(wires):
            wire.joint_takes = partial(self._pair.take_output, number)

    # --- commands and services --------------------------------------------------------------------

    def _on_joint_command(self, serialized: bytes) -> None:
        if len(serialized) > LONGEST_COMMAND_B:
            self.report(
                f"joint command refused: its message has {len(serialized)} bytes, more than {LONGEST_COMMAND_B}"
            )
            return
        try:
            asked = pair_command_from(deserialize_message(serialized, JointState), self._declared.config.joint_name)
        except ValueError as error:
            self.report(str(error))
            return
        refusal = self._pair.command(*asked)
        if refusal:
            self.report(refusal)

    def _on_trajectory(self, serialized: bytes) -> None:
        name, now_ns = self._declared.config.joint_name, self.get_clock().now().nanoseconds
        try:
            refusal = self._pair.follow(*trajectory_of(serialized, name, now_ns))
        except ValueError as error:
            refusal = str(error)
        if refusal:
            self.report(refusal)

    @property
    def parts(self) -> Sequence[WireNode]:
        """Its wires."""
        return self._wires

    def switch_on(self, wanted: Callable[[], bool] = lambda: True) -> tuple[bool, str]:
        """Both wires on, if they are ``wanted`` still when their turn has come; whether they are, and a sentence."""
        return self._pair.switch_on(wanted)

    def switch_off(self) -> tuple[bool, str]:
        """Both wires off, from any thread; whether they are, and what became of each."""
        return self._pair.switch_off()

    def _on_clear_fault(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        response.success, response.message = self._pair.clear_fault(CALL_TIMEOUT_s)
        if not response.success:
            self.report(response.message)
        return response

    # --- words ------------------------------------------------------------------------------------

    def report(self, sentence: str) -> None:
        """Say why something was refused; the same again and again only now and then."""
        sentence = self._refusals.worth_saying(sentence, self._monotonic.now_s())
        if sentence:
            self.get_logger().warning(sentence)

    def callback_failed(self, error: Exception) -> None:
        """An exception that no message is to blame for: both wires go off, the node goes on."""
        self.report(f"{type(error).__name__} in a ROS callback: {error}; {self.switch_off()[1]}")

    # --- publishing ---------------------------------------------------------------------------------

    def _take_output(self, output: JointOutput) -> None:
        """Hand an output over, in the control thread of the first wire."""
        self._handoff.put(output, True)

    def _publish(self, output: JointOutput, _: Sequence[JointOutput]) -> None:
        if math.isfinite(output.time_s):
            stamp = self._wires[0].stamp(output.time_s)
            # Silence rather than an angle that nobody knows, as of a wire.
            if math.isfinite(output.estimate.angle_rad) and is_heard(self._joint_states):
                name = self._declared.config.joint_name
                self._joint_states.publish(joint_estimate_message(name, output.estimate, stamp))
            if is_heard(self._signals):
                setpoints = zip(self._declared.config.wires, output.setpoints_m, strict=True)
                named = {name: value for name, value in output.status.values.items() if isinstance(value, float)}
                named |= {f"{wire}_setpoint_m": setpoint_m for wire, setpoint_m in setpoints}
                self._signals.publish(signals_message(named, "", stamp))
        if _in_short(output.status) != self._published:
            self._woken.trigger()

    def _take_news(self) -> None:
        """Say what is new in the latest output."""
        output = self._handoff.latest
        status = output.status if output is not None else Status(Mode.OFF, message="no reading has come yet")
        if (status.mode, status.fault) != self._said:
            self._said = status.mode, status.fault
            if status.fault:
                self.get_logger().error(status.message)
            else:
                self.get_logger().info(f"the joint: {status.message}")
        self._published = _in_short(status)
        message = diagnostic_status_from(self.get_fully_qualified_name(), self._declared.config.joint_name, status)
        self._status.publish(message)
        if is_heard(self._diagnostics):
            array = DiagnosticArray(status=[message])
            array.header.stamp = time_message(self.get_clock().now().nanoseconds)
            self._diagnostics.publish(array)

    def turn(self) -> None:
        """What the ROS thread does between callbacks."""
        now_s = self._monotonic.now_s()
        if now_s >= self._status_due_s:
            self._status_due_s = now_s + STATUS_PERIOD_s
            self._take_news()

    def wake_no_more(self) -> None:
        """End the hand-off, so that ROS can be shut down."""
        self._handoff.close()


def _in_short(status: Status) -> tuple[Any, ...]:
    return status.mode, status.fault, status.limits
