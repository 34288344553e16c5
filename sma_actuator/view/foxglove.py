"""A running node for Foxglove and Lichtblick, by Foxglove's own server: its topics to look at, and nothing to do.

Messages pass as ROS 2 serialised them, so a viewer makes of them what it makes of a recording.  The node is listened to
only while a viewer looks at the topic.  Nothing is taken from viewers: the server offers them no way to publish, call
or set.
"""

from __future__ import annotations

import collections
import importlib
import re
import threading
from collections.abc import Sequence
from functools import partial
from typing import Any

import foxglove
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from foxglove.websocket import ChannelView, Client, ServerListener
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from trajectory_msgs.msg import JointTrajectory

from sma_actuator.base.errors import UserError
from sma_actuator.base.joining import beside_a_node

from .in_order import InOrder

#: The kinds of messages that a node has.  No others are taken: a topic's kind is what anybody on the network says.
_KINDS = {
    f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}": kind
    for kind in (JointState, WrenchStamped, Float64, DiagnosticStatus, DiagnosticArray, JointTrajectory)
}
_OF_ALL_NODES = "/diagnostics"
LOOK_PERIOD_s = 1.0  #: how often is looked for topics
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_USUAL = QoSProfile(depth=100)
#: Names of IDL, in which classes tell of their fields, as message definitions have them.
_PLAIN = {"double": "float64", "float": "float32", "octet": "byte", "boolean": "bool"}


def definition_of(kind: Any) -> str:
    """The fields of a kind of message, and of every kind in it, as recordings and viewers have them (``ros2msg``)."""
    parts: list[str] = []
    wanted, known = collections.deque([kind]), {_name_of(kind)}
    while wanted:
        kind = wanted.popleft()
        lines = [f"MSG: {_name_of(kind)}"] if parts else []
        for field, said in kind.get_fields_and_field_types().items():
            sequence = re.fullmatch(r"sequence<(.+)>", said)
            name = sequence[1] if sequence else said
            if "/" in name and name not in known:
                known.add(name)
                package, _, last = name.partition("/")
                wanted.append(getattr(importlib.import_module(f"{package}.msg"), last))
            lines.append(f"{_PLAIN.get(name, name)}{'[]' if sequence else ''} {field}")
        parts.append("\n".join(lines) + "\n")
    return f"{'=' * 80}\n".join(parts)


def _name_of(kind: Any) -> str:
    return f"{kind.__module__.partition('.')[0]}/{kind.__name__}"


class _Listener(ServerListener):
    """Tells which topics are looked at, from threads of the server."""

    def __init__(self, topics: Topics):
        self._topics = topics

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """One more looks."""
        self._topics.looked_at(channel, client, True)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        """One less."""
        self._topics.looked_at(channel, client, False)


class Topics:
    """The topics of some nodes, as channels of a Foxglove server.  Raises UserError where the port cannot be had."""

    def __init__(self, nodes: Sequence[str], host: str, port: int):
        self._prefixes = tuple(f"{node}/" for node in nodes)
        self._channels: dict[str, tuple[foxglove.Channel, str]] = {}
        self._looks: collections.Counter[str] = collections.Counter()
        self._lookers: collections.defaultdict[str, set[int]] = collections.defaultdict(set)
        self._subscriptions: dict[str, Any] = {}
        self._foxglove = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name=f"sma_actuator {' '.join(nodes)}",
                host=host,
                port=port,
                context=self._foxglove,
                server_listener=_Listener(self),
            )
        except (OSError, RuntimeError) as error:
            raise UserError(
                f"--port: {host}:{port} cannot be opened ({error}); --port 0 takes one that is free"
            ) from error
        self.port: int = self._server.port
        self._ros_context = rclpy.Context()
        rclpy.init(args=beside_a_node(), context=self._ros_context, signal_handler_options=SignalHandlerOptions.NO)
        self._ros = rclpy.create_node(
            "sma_foxglove", context=self._ros_context, use_global_arguments=False, enable_rosout=False
        )
        self._executor = SingleThreadedExecutor(context=self._ros_context)
        self._executor.add_node(self._ros)
        self._tasks = InOrder(self._executor)
        self._ros.create_timer(LOOK_PERIOD_s, self._look)
        self._thread = threading.Thread(target=self._spin, name="foxglove ROS", daemon=True)
        self._thread.start()

    def looked_at(self, channel: ChannelView, client: Client, yes: bool) -> None:
        """A viewer begins or ends to look at a topic."""
        self._tasks.put(partial(self._follow, channel.topic, channel.id, client.id, yes))

    def close(self) -> None:
        """Say goodbye to viewers, and leave the ROS graph."""
        self._server.stop()
        rclpy.try_shutdown(context=self._ros_context)
        self._thread.join(1.0)

    # --- in the thread of ROS ----------------------------------------------------------------------

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except (ExternalShutdownException, rclpy_implementation.RCLError):
            if self._ros_context.ok():  # else it was closed, in the middle of a look round perhaps
                raise

    def _look(self) -> None:
        """Offer the topics that there are."""
        # The server refuses who asks for a channel in the instant in which it is offered, and viewers ask only once:
        # what nobody looks at is offered once more, after 1, 2, 4, ... looks, for a busy machine refuses twice too.
        for topic in [each for each in self._channels if not self._lookers[each]]:
            self._looks[topic] += 1
            if self._looks[topic].bit_count() == 1:
                refused, kind = self._channels[topic]
                refused.close()
                self._offer(topic, kind)
        for topic, kinds in self._ros.get_topic_names_and_types():
            known = next((each for each in kinds if each in _KINDS), None)
            if (
                known is None
                or topic in self._channels
                or not (topic.startswith(self._prefixes) or topic == _OF_ALL_NODES)
            ):
                continue
            if not self._ros.count_publishers(topic):
                continue
            self._offer(topic, known)

    def _offer(self, topic: str, kind: str) -> None:
        schema = foxglove.Schema(name=kind, encoding="ros2msg", data=definition_of(_KINDS[kind]).encode())
        channel = foxglove.Channel(topic, schema=schema, message_encoding="cdr", context=self._foxglove)
        self._channels[topic] = channel, kind

    def _follow(self, topic: str, offer: int, client: int, yes: bool) -> None:
        channel, kind = self._channels[topic]
        if offer != channel.id():
            return  # it is offered anew
        lookers = self._lookers[topic]
        (lookers.add if yes else lookers.discard)(client)
        if lookers and topic not in self._subscriptions:
            latched = any(
                info.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
                for info in self._ros.get_publishers_info_by_topic(topic)
            )
            qos = _LATCHED if latched else _USUAL
            self._subscriptions[topic] = self._ros.create_subscription(_KINDS[kind], topic, channel.log, qos, raw=True)
        elif not lookers and topic in self._subscriptions:
            self._ros.destroy_subscription(self._subscriptions.pop(topic))
