"""What the pages know of a node, and what they ask of it: a ROS client whose executor has a thread of its own.

Everything that touches ROS runs in that thread; the rest of the program awaits it.
"""

from __future__ import annotations

import asyncio
import collections
import logging
import math
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from diagnostic_msgs.srv import SelfTest
from rcl_interfaces.msg import ParameterDescriptor, ParameterEvent, ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from sma_actuator.base.errors import UserError
from sma_actuator.base.joining import beside_a_node
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.limits import LIMITS
from sma_msgs_py import setpoint_message, signals_from, trajectory_message

from .asymptotes import OF_ROS
from .in_order import InOrder

_log = logging.getLogger(__name__)

#: What a page gets of every row; ``at_s`` is the time of sampling by the system's clock.
COLUMNS = (
    "at_s",
    "setpoint_m",
    "limited_setpoint_m",
    "displacement_estimate_m",
    "uncertainty_m",
    "displacement_m",
    "current_A",
    "current_limit_A",
    "temperature_C",
    "resistance_Ohm",
    "stress_Pa",
    "load_N",
    "power_W",
    "shortest_m",
    "longest_m",
    "quality",
    "branch",
    # Of a joint that two wires turn.
    "asked_angle_rad",
    "reference_rad",
    "angle_rad",
    "uncertainty_rad",
    "asked_cocontraction_N",
    "cocontraction_N",
    "torque_Nm",
)
ROW_PERIOD_s = 0.05  #: a page draws no faster, however fast the loop is
ROWS_WAITING = 200  #: rows kept where nobody takes them
RECORDED_s = 120.0  #: of every step, for who wants to keep what was just seen
MOST_RECORDED = 24_000  #: a node publishes no more than 200 a second
LOOK_PERIOD_s = 1.0  #: how often is looked whether the node is there, and still the same
SILENCE_s = 3.5  #: a node says its status once a second
ANSWER_TIMEOUT_s = 3.0
#: Off is asked for again where no answer comes, since a node that has just come may not be reached yet.  On never is:
#: it could arrive after a stop.
OFF_AGAIN_s = 0.4
#: For what is done with the wire before it is answered: a self-test, a relay test.
LONG_TIMEOUT_s = 900.0
MOST_DIAGNOSTICS = 50

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_TYPES = {"std_srvs/srv/Trigger": Trigger, "diagnostic_msgs/srv/SelfTest": SelfTest}
#: Services of the node that have a place of their own on the page.
_PLACED = ("stop",)


class Refused(UserError):
    """What was asked of the node was not done; the sentence says why."""


class WatchedNode:
    """One node, as the pages see it.

    ``rows`` are taken by whoever shows them; ``version`` counts changes of everything else.
    """

    def __init__(self, node: str):
        self.node = node
        self.rows: collections.deque[list[float | None]] = collections.deque(maxlen=ROWS_WAITING)
        self.version = 0
        self.parameters_version = 0
        self.present = False
        self.status: dict[str, Any] | None = None
        self.diagnostics: dict[str, dict[str, Any]] = {}
        self.parameters: dict[str, Any] = {}  #: values of all, by dotted name
        self.live: dict[str, dict[str, Any]] = {}  #: those that may be changed, as they are declared
        self.services: list[str] = []  #: that are asked without an argument
        self._heard_s = -math.inf
        self._row_s = -math.inf
        self._recorded: collections.deque[tuple[float, bytes]] = collections.deque(maxlen=MOST_RECORDED)
        self._identity: frozenset[bytes] = frozenset()
        self._is_stale = True  #: the parameters, since something has changed
        self._clients: dict[str, Any] = {}
        self._kinds: dict[str, Any] = {}
        self._signals: Any = None
        self._context = rclpy.Context()
        rclpy.init(args=beside_a_node(), context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._ros = rclpy.create_node(
            "sma_view", context=self._context, use_global_arguments=False, enable_rosout=False
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._ros)
        self._tasks = InOrder(self._executor)
        subscribe = self._ros.create_subscription
        subscribe(DiagnosticStatus, f"{node}/status", self._on_status, _LATCHED)
        subscribe(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        subscribe(ParameterEvent, "/parameter_events", self._on_parameter_event, 50)
        self._setpoint = self._ros.create_publisher(Float64, f"{node}/setpoint", 1)
        self._trajectory = self._ros.create_publisher(JointTrajectory, f"{node}/joint_trajectory", 1)
        # Made at once, since a client takes a while to find its service.
        self._client("enable", SetBool)
        self._client("stop", Trigger)
        for name, kind in (
            ("list_parameters", ListParameters),
            ("describe_parameters", DescribeParameters),
            ("get_parameters", GetParameters),
            ("set_parameters", SetParameters),
        ):
            self._client(name, kind)
        self._thread = threading.Thread(target=self._spin, name="view ROS", daemon=True)
        self._thread.start()

    # --- what pages ask ---------------------------------------------------------------------------

    async def stop(self) -> str:
        """Every wire of the node's process off; the node's sentence.  Raises Refused."""
        return _done(await self._ask("stop", Trigger.Request(), again_s=OFF_AGAIN_s))

    async def enable(self, on: bool) -> str:
        """The output on or off; the node's sentence.  Raises Refused."""
        return _done(await self._ask("enable", SetBool.Request(data=on), again_s=math.inf if on else OFF_AGAIN_s))

    async def send_setpoint(self, position_m: float) -> str:
        """Publish one setpoint, once.  Raises Refused where nobody would hear it."""
        if not math.isfinite(position_m):
            raise Refused(f"a setpoint is a finite number of metres, not {position_m}")

        def publish() -> int:
            self._setpoint.publish(setpoint_message(position_m))
            return self._setpoint.get_subscription_count()

        if not await self._in_ros(publish):
            raise Refused(f"nobody takes setpoints of {self.node}: the node is not there")
        return f"setpoint {position_m * 1e3:.3f} mm"

    async def send_angle(self, angle_rad: float) -> str:
        """Ask a joint for an angle, once: a trajectory of one point, since a command would have to be repeated.  Raises
        Refused."""
        if not math.isfinite(angle_rad):
            raise Refused(f"an angle is a finite number of radians, not {angle_rad}")
        joint_name = str(self.parameters.get("joint_name", ""))

        def publish() -> int:
            self._trajectory.publish(trajectory_message(joint_name, [0.0], [angle_rad]))
            return self._trajectory.get_subscription_count()

        if not await self._in_ros(publish):
            raise Refused(f"nobody takes angles of {self.node}: the node is not there")
        return f"angle {math.degrees(angle_rad):.2f}°"

    @property
    def angle_range_rad(self) -> tuple[float, float] | None:
        """Of a joint, the angles at which one of its wires would have no length of its stroke left; None of a wire."""
        radius_m, at_zero_m = (self.parameters.get(name) for name in ("pulley_radius", "displacement_at_zero"))
        if not radius_m or not at_zero_m:
            return None
        return -at_zero_m[1] / radius_m, at_zero_m[0] / radius_m

    async def trigger(self, name: str) -> str:
        """Call one of ``services``; the node's sentence.  Raises Refused."""
        if name not in self.services:
            raise Refused(f"{self.node} does not offer ~/{name}")
        kind = self._kinds[name]
        response = await self._ask(name, kind.Request(), LONG_TIMEOUT_s)
        if kind is Trigger:
            return _done(response)
        for status in response.status:
            self._note(status)
        words = "; ".join(f"{status.name}: {status.message}" for status in response.status)
        if response.passed == b"\0":
            raise Refused(f"not passed: {words}")
        return f"passed: {words}"

    async def set_parameter(self, name: str, value: float | str | bool) -> str:
        """Change a parameter; what changed.  Raises Refused with the node's own sentence."""
        message = Parameter(name, value=value).to_parameter_msg()
        response = await self._ask("set_parameters", SetParameters.Request(parameters=[message]))
        result = response.results[0]
        if not result.successful:
            raise Refused(result.reason or f"{name}: refused without a reason")
        await self._read_parameters()
        return f"{name} is {value}"

    async def listen(self, wanted: bool) -> None:
        """Take ``~/signals``, which the node makes only while somebody does, or leave it."""

        def subscribe() -> None:
            if wanted and self._signals is None:
                # As bytes: what comes faster than a page draws is not even taken apart.
                self._signals = self._ros.create_subscription(
                    JointState, f"{self.node}/signals", self._on_signals, 10, raw=True
                )
            elif not wanted and self._signals is not None:
                self._ros.destroy_subscription(self._signals)
                self._signals = None
                self.rows.clear()
                self._recorded.clear()

        await self._in_ros(subscribe)

    async def recorded(self) -> dict[float, tuple[dict[str, float], str]]:
        """Named values of the last :data:`RECORDED_s` in which a page was open, and what happened before each, by
        ``time_s``."""
        messages = await self._in_ros(lambda: [serialized for _, serialized in self._recorded])
        return await asyncio.to_thread(_by_time, messages)

    async def watch(self) -> None:
        """Look after the node for ever: whether it is there, and what it offers when it has come anew."""
        while True:
            identity, switchable, services = await self._in_ros(self._look)
            present = bool(identity) and switchable and time.monotonic() - self._heard_s < SILENCE_s
            if present != self.present or services != self.services:
                self.present, self.services = present, services
                self.version += 1
            if identity and (self._is_stale or identity != self._identity):
                self._is_stale = False  # before: what changes meanwhile is read again
                try:
                    await self._read_parameters()
                    self._identity = identity
                except Refused:  # it is not ready yet; in a second again
                    self._is_stale = True
            await asyncio.sleep(LOOK_PERIOD_s)

    def close(self) -> None:
        """Leave the ROS graph."""
        rclpy.try_shutdown(context=self._context)
        self._thread.join(1.0)

    # --- asking, in the thread of ROS -------------------------------------------------------------

    def _spin(self) -> None:
        while self._context.ok():
            try:
                self._executor.spin()
            except ExternalShutdownException:
                return
            except Exception:  # noqa: BLE001 - said; the next message is as good as any
                if self._context.ok():
                    _log.exception("a message was dropped")

    async def _in_ros(self, work: Callable[[], Any]) -> Any:
        """The result of ``work``, done in the thread of ROS."""
        loop = asyncio.get_running_loop()
        done = loop.create_future()

        def run() -> None:
            try:
                result = work()
            except Exception as error:  # noqa: BLE001 - raised where it is awaited
                loop.call_soon_threadsafe(_settle, done, None, error)
            else:
                loop.call_soon_threadsafe(_settle, done, result, None)

        self._tasks.put(run)
        # Not wait_for: before Python 3.12 it loses a cancellation that comes together with the result, and whoever was
        # to end goes on for ever.
        async with asyncio.timeout(ANSWER_TIMEOUT_s):
            return await done

    async def _ask(
        self, name: str, request: Any, timeout_s: float = ANSWER_TIMEOUT_s, again_s: float = math.inf
    ) -> Any:
        """The response of one of the node's services, asked again every ``again_s``.  Raises Refused where there is
        none."""
        loop = asyncio.get_running_loop()
        answer = loop.create_future()
        client = self._clients[name]
        asked: list[Any] = []

        def send() -> None:
            if not client.service_is_ready():
                raise Refused(f"{self.node} does not offer ~/{name} now; is the node running?")
            asked.append(client.call_async(request))
            asked[-1].add_done_callback(lambda f: loop.call_soon_threadsafe(_settle, answer, f.result(), f.exception()))

        def forget() -> None:
            for future in asked:
                if not future.done():
                    client.remove_pending_request(future)

        deadline_s = loop.time() + timeout_s
        try:
            while (left_s := deadline_s - loop.time()) > 0.0:
                await self._in_ros(send)
                await asyncio.wait([answer], timeout=min(left_s, again_s))
                if answer.done():
                    return answer.result()
        finally:
            await self._in_ros(forget)
        raise Refused(f"~/{name} of {self.node} did not answer within {timeout_s:g} s")

    def _client(self, name: str, kind: Any) -> None:
        self._kinds[name] = kind
        self._clients[name] = self._ros.create_client(kind, f"{self.node}/{name}")

    def _look(self) -> tuple[frozenset[bytes], bool, list[str]]:
        """Who publishes the status, whether the wire can be switched, and which services want no argument."""
        publishers = self._ros.get_publishers_info_by_topic(f"{self.node}/status")
        offered = []
        for full, kinds in self._ros.get_service_names_and_types():
            name = full.removeprefix(f"{self.node}/")
            kind = next((_TYPES[k] for k in kinds if k in _TYPES), None)
            if name == full or "/" in name or kind is None or name in _PLACED:
                continue
            if name not in self._clients:
                self._client(name, kind)
            offered.append(name)
        switchable = all(self._clients[name].service_is_ready() for name in ("enable", "stop"))
        return frozenset(bytes(p.endpoint_gid) for p in publishers), switchable, sorted(offered)

    async def _read_parameters(self) -> None:
        listed = await self._ask("list_parameters", ListParameters.Request())
        names = list(listed.result.names)
        described = await self._ask("describe_parameters", DescribeParameters.Request(names=names))
        got = await self._ask("get_parameters", GetParameters.Request(names=names))
        values = {name: parameter_value_to_python(value) for name, value in zip(names, got.values, strict=True)}
        self.live = {
            d.name: _declared(d, values[d.name])
            for d in described.descriptors
            if not d.read_only
            and isinstance(values.get(d.name), bool | int | float | str)
            and not d.name.startswith(OF_ROS)
        }
        self.parameters = values
        self.parameters_version += 1

    # --- what comes, in the thread of ROS ---------------------------------------------------------

    def _on_signals(self, serialized: bytes) -> None:
        now_s = time.monotonic()
        self._recorded.append((now_s, serialized))
        while self._recorded[0][0] < now_s - RECORDED_s:
            self._recorded.popleft()
        if now_s - self._row_s < 0.8 * ROW_PERIOD_s:
            return
        self._row_s = now_s
        message = deserialize_message(serialized, JointState)
        values = signals_from(message)
        values["at_s"] = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        self.rows.append(row_of(values))

    def _on_status(self, message: DiagnosticStatus) -> None:
        self._heard_s = time.monotonic()
        status = status_of(message)
        if status != self.status:
            self.status = status
            self.version += 1

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name != self.node:  # of which ~/status tells
                self._note(status)

    def _note(self, message: DiagnosticStatus) -> None:
        said = diagnostic_of(message)
        if self.diagnostics.get(message.name) == said:
            return
        if message.name in self.diagnostics or len(self.diagnostics) < MOST_DIAGNOSTICS:
            self.diagnostics = {**self.diagnostics, message.name: said}
            self.version += 1

    def _on_parameter_event(self, message: ParameterEvent) -> None:
        if message.node == self.node:  # that it has changed something; what to, it is asked, since anybody can say so
            self._is_stale = True


def _settle(future: asyncio.Future[Any], result: Any, error: BaseException | None) -> None:
    if future.done():
        return
    if error is not None:
        future.set_exception(error)
    else:
        future.set_result(result)


def _done(response: Any) -> str:
    """The sentence of a response that says yes.  Raises Refused with that of one that says no."""
    if not response.success:
        raise Refused(response.message or "refused without a reason")
    return response.message


def _by_time(messages: list[bytes]) -> dict[float, tuple[dict[str, float], str]]:
    rows = {}
    for serialized in messages:
        message = deserialize_message(serialized, JointState)
        values = signals_from(message)
        if "time_s" in values:
            rows[values["time_s"]] = values, message.header.frame_id
    return rows


def row_of(values: Mapping[str, float]) -> list[float | None]:
    """The columns of a page, rounded to what is drawn; a number that is none becomes None."""
    at_s = values["at_s"]
    return [round(at_s, 3), *(rounded(values.get(name, math.nan)) for name in COLUMNS[1:])]


def rounded(value: float) -> float | None:
    """Six digits, or None for what is not finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def diagnostic_of(message: DiagnosticStatus) -> dict[str, Any]:
    """A DiagnosticStatus as the page shows it."""
    level = message.level[0] if isinstance(message.level, bytes) else message.level
    values = {pair.key: pair.value for pair in message.values}
    return {"level": level, "name": message.name, "message": message.message, "values": values}


def status_of(message: DiagnosticStatus) -> dict[str, Any]:
    """The node's own status: with what its fault and its limits mean, and what can be done about them."""
    status = diagnostic_of(message)
    values = status["values"]
    fault = FAULTS.get(values.get("fault", ""))
    limits = [LIMITS[name] for name in values.get("limits", "").split(", ") if name in LIMITS]
    status["mode"] = values.get("mode", "")
    status["hardware"] = message.hardware_id
    status["fault"] = {"name": fault.name, "words": fault.words, "advice": fault.advice} if fault else None
    status["limits"] = [{"name": e.name, "words": e.words, "advice": e.advice} for e in limits]
    return status


def _declared(descriptor: ParameterDescriptor, value: Any) -> dict[str, Any]:
    """A parameter with what its declaration says, as the page shows it."""
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    constraints = descriptor.additional_constraints
    numeric = descriptor.type in (ParameterType.PARAMETER_DOUBLE, ParameterType.PARAMETER_INTEGER)
    return {
        "value": value,
        "description": descriptor.description,
        "range": [ranges[0].from_value, ranges[0].to_value] if ranges and numeric else None,
        "whole": descriptor.type == ParameterType.PARAMETER_INTEGER,
        "choices": constraints.removeprefix("one of ").split(", ") if constraints else [],
    }
