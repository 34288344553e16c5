"""What a node publishes and takes: one row each, which says all that there is to say of a topic or a service.

A publisher is made from its row, listened for by it, and fed by it; no other list names the topic, so none can forget
it.
"""

from __future__ import annotations

import enum
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite, nan
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from sma_actuator.base.record import record
from sma_actuator.base.signals import Branch, Estimate, Output, Quality, Signals
from sma_actuator.config import Config
from sma_actuator.control.pair import PairParameters
from sma_actuator.pair import JointOutput
from sma_msgs_py import (
    Form,
    command_current_message,
    joint_estimate_message,
    joint_state_message,
    load_message,
    reference_message,
    signals_message,
    time_message,
)

from .named_signals import named_signals
from .publishing import OUTPUTS_WAITING

DEPTH = 10
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@lru_cache(maxsize=64)  # steps of all wires of a process that are being published
def stamp(time_s: float) -> Time:
    """ROS time at which the monotonic clock of the loops was at ``time_s``.

    One, to the nanosecond, for all that is said of a step: so messages that belong together can be told.
    ROS time is the system's, since a simulated one is refused; rclpy's own clock takes ten times as long to ask.
    """
    return time_message(time.time_ns() - round(1e9 * (time.monotonic() - time_s)))


class Of(enum.Enum):
    """What a topic is about."""

    LATEST = enum.auto()  #: the latest step, while the node is active
    EVERY = enum.auto()  #: each step, in order: nothing is lost where the publishing thread was held up
    STATUS = enum.auto()  #: what the node says of itself, in every state of its life


@record(frozen=True, slots=True)
class Step:
    """What a message of a step is made of."""

    output: Any  #: an Output, or a JointOutput
    config: Any  #: the parameters of the node: a Config, or PairParameters
    time_s: float  #: when it was measured, on the loop's clock; NaN before anything is
    happened: str = ""  #: since the message before, in words


@dataclass(frozen=True, slots=True)
class Published:
    """One topic.  ``message`` makes one, or its bytes, of a Step or of the list of DiagnosticStatus; None: nothing to
    say."""

    name: str
    kind: type
    message: Callable[[Any], Any]
    of: Of = Of.LATEST
    qos: QoSProfile | int = DEPTH
    is_made: Callable[[Any], bool] = lambda config: True  #: whether there is one, with these parameters

    @property
    def is_kept(self) -> bool:
        """Whether who comes later gets the last message."""
        return isinstance(self.qos, QoSProfile) and self.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL


@lru_cache(maxsize=64)
def _joint_state_form(joint_name: str) -> Form:
    def make(stamp: Time, numbers: Sequence[float]) -> JointState:
        position_m, velocity_m_s, load_N = numbers
        estimate = Estimate(nan, position_m, nan, velocity_m_s, Branch.COOLING, Quality.DETERMINATE)
        return joint_state_message(joint_name, estimate, Signals(nan, nan, nan, nan, load_N, nan), stamp)

    return Form(make, 3)


def _joint_state(step: Step) -> bytes | None:
    estimate, signals = step.output.estimate, step.output.signals
    if estimate.quality is Quality.INVALID:  # silence rather than a position that nobody knows
        return None
    numbers = [estimate.displacement_m, estimate.velocity_m_s, signals.load_N]
    return _joint_state_form(step.config.joint_name).filled(stamp(step.time_s), numbers)


def _load(step: Step) -> WrenchStamped:
    return load_message(step.config.frame_id, step.output.signals, stamp(step.time_s))


def _reference(step: Step) -> JointState:
    return reference_message(step.config.joint_name, step.output.signals, stamp(step.time_s))


def _command_current(step: Step) -> Float64:
    return command_current_message(step.output.command)


def _signals(step: Step) -> JointState | bytes | None:
    output: Output = step.output
    if output.reading is None or not isfinite(output.reading.time_s):
        return None
    return _named(named_signals(output), step.happened, stamp(output.reading.time_s))


@lru_cache(maxsize=64)
def _signals_form(names: tuple[str, ...]) -> Form:
    def make(stamp: Time, numbers: Sequence[float]) -> JointState:
        return signals_message(dict(zip(names, numbers, strict=True)), "", stamp)

    return Form(make, len(names))


def _named(values: dict[str, float], happened: str, stamp: Time) -> JointState | bytes:
    if happened:
        return signals_message(values, happened, stamp)
    return _signals_form(tuple(values)).filled(stamp, list(values.values()))


def _has_reference(config: Config) -> bool:
    return config.reference_sensor.fitted and bool(config.instruments.daq.lvdt_channel)


def _first(statuses: Sequence[DiagnosticStatus]) -> DiagnosticStatus:
    return statuses[0]


def _array(statuses: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    array = DiagnosticArray(status=list(statuses))
    array.header.stamp = time_message(time.time_ns())
    return array


STATUS = (
    Published("~/status", DiagnosticStatus, _first, Of.STATUS, LATCHED),
    Published("/diagnostics", DiagnosticArray, _array, Of.STATUS),
)
WIRE = (
    Published("~/joint_states", JointState, _joint_state),
    Published("~/load", WrenchStamped, _load),
    Published("~/reference", JointState, _reference, is_made=_has_reference),
    Published("~/command_current", Float64, _command_current),
    # some seconds' worth, for who records them
    Published("~/signals", JointState, _signals, Of.EVERY, OUTPUTS_WAITING),
    *STATUS,
)


def _angle(step: Step) -> JointState | None:
    output: JointOutput = step.output
    if not isfinite(output.estimate.angle_rad):
        return None
    return joint_estimate_message(step.config.joint_name, output.estimate, stamp(step.time_s))


def _signals_of_joint(step: Step) -> JointState | bytes | None:
    output: JointOutput = step.output
    if not isfinite(step.time_s):
        return None
    config: PairParameters = step.config
    named = {name: value for name, value in output.status.values.items() if isinstance(value, float)}
    setpoints_m = zip(config.wires, output.setpoints_m, strict=True)
    named |= {f"{wire}_setpoint_m": setpoint_m for wire, setpoint_m in setpoints_m}
    return _named(named, step.happened, stamp(step.time_s))


JOINT = (
    Published("~/joint_states", JointState, _angle),
    Published("~/signals", JointState, _signals_of_joint, Of.EVERY, OUTPUTS_WAITING),
    *STATUS,
)


@dataclass(frozen=True, slots=True)
class Taken:
    """One topic that is subscribed to: ``take(message)`` answers why it was refused, or "", or raises ValueError with
    that.

    ``longest_B``: it comes as bytes, and how many there are is looked at first: to make Python objects of a million
    points would hold up the ROS thread, and the loop with it.
    """

    name: str
    kind: type
    take: Callable[[Any], str]
    longest_B: int = 0
    what: str = ""  #: it is, in words

    def subscribe(self, node: Any, report: Callable[[str], None]) -> None:
        """Have ``node`` take it; ``report`` gets the refusals."""

        def received(message: Any) -> None:
            try:
                refusal = self.take(self._whole(message))
            except ValueError as error:
                refusal = str(error)
            if refusal:
                report(refusal)

        node.create_subscription(self.kind, self.name, received, DEPTH, raw=self.longest_B > 0)

    def _whole(self, message: Any) -> Any:
        if not self.longest_B:
            return message
        if len(message) > self.longest_B:
            raise ValueError(
                f"{self.what} refused: its message has {len(message)} bytes, more than {self.longest_B}; send less at "
                f"once"
            )
        return deserialize_message(message, self.kind)


@dataclass(frozen=True, slots=True)
class Service:
    """One service: ``answer(request, response)`` fills the response and returns it."""

    name: str
    kind: type
    answer: Callable[[Any, Any], Any]


def offer(node: Any, services: Iterable[Service]) -> None:
    """Have ``node`` answer them."""
    for service in services:
        node.create_service(service.kind, service.name, service.answer)
