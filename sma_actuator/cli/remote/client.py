"""A ROS 2 client of one running node.  Every wait is bounded, and what did not answer is named in a sentence."""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import sys
import time
from collections.abc import Callable, Collection, Iterator
from typing import TYPE_CHECKING, Any

from sma_actuator.base.commands import NODE_NAME, as_commands, namespace, node_name
from sma_actuator.base.errors import UserError, without_ros
from sma_actuator.base.interrupts import Interrupts, noted_signals
from sma_actuator.base.joining import beside_a_node
from sma_actuator.base.options import number_within

if TYPE_CHECKING:  # stop is quicker without
    from sma_actuator.base.signals import Status

#: Services are found within three seconds on a quiet machine.
PATIENCE_s = 10.0
#: For the status to say what a service has answered.
SAID_s = 3.0
#: Off is asked for again where no answer comes: DDS loses an answer to whom the node has not found yet.  On never is:
#: it could arrive after a stop.
OFF_AGAIN_s = 0.5
_TURN_s = 0.01  #: a signal, and a service that is found, are looked for this often


def add_node_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare which node is meant, and how long it may take to answer."""
    parser.add_argument(
        "--node", type=node_name, default=NODE_NAME, metavar="NAME", help="name of the node (default %(default)s)"
    )
    parser.add_argument(
        "--namespace", type=namespace, default="/", metavar="NS", help="namespace of the node (default %(default)s)"
    )
    parser.add_argument(
        "--patience",
        type=number_within(0.0),
        default=PATIENCE_s,
        metavar="S",
        help="longest wait for an answer of the node (default %(default)s)",
    )


class Named:
    """The node that the options of a command name."""

    def __init__(self, args: argparse.Namespace):
        self.name, self.namespace = args.node, args.namespace
        self.full_name = f"{self.namespace.rstrip('/')}/{self.name}"

    @property
    def options(self) -> str:
        """What a command says to reach this node; nothing where it is the usual one."""
        options = f" --node {self.name}" if self.name != NODE_NAME else ""
        return options + (f" --namespace {self.namespace}" if self.namespace != "/" else "")

    def words(self, sentence: str) -> str:
        """A sentence of this node, with commands in it that reach it."""
        return as_commands(sentence, self.options)

    def say_next(self, args: argparse.Namespace, words: str) -> None:
        """What to do next, with commands that reach this node; after the results, and nothing with ``-q``."""
        if not args.quiet:
            print(f"next: {self.words(words)}", file=sys.stderr)


class NodeClient(Named):
    """One node, as a program beside it sees it."""

    def __init__(self, args: argparse.Namespace, interrupts: Interrupts):
        import rclpy
        from diagnostic_msgs.msg import DiagnosticStatus
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from rclpy.signals import SignalHandlerOptions

        super().__init__(args)
        self._patience_s = args.patience
        self._interrupts = interrupts
        self._context = rclpy.Context()
        rclpy.init(args=beside_a_node(), context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(
            f"sma_actuator_command_{os.getpid()}",
            context=self._context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._latest: dict[str, tuple[float, Any]] = {}  #: topic → when it came, the message
        self._publishers: dict[str, Any] = {}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.listen("status", DiagnosticStatus, latched)

    def listen(self, topic: str, kind: type, qos: Any = 10) -> None:
        """Keep the latest message of ``~/topic``."""
        self._node.create_subscription(
            kind, f"{self.full_name}/{topic}", lambda m: self._latest.update({topic: (time.monotonic(), m)}), qos
        )

    def latest(self, topic: str, not_older_s: float = math.inf) -> Any:
        """The latest message of ``~/topic``, None where none came within ``not_older_s``."""
        came_s, message = self._latest.get(topic, (-math.inf, None))
        return message if time.monotonic() - came_s <= not_older_s else None

    def spin(self, seconds: float) -> None:
        """Handle what arrives, for a time or until a signal comes."""
        self._spin_until(lambda: False, seconds)

    def _spin_until(self, condition: Callable[[], Any], patience_s: float) -> Any:
        """The value of ``condition`` once it is true, else of its last look when patience or a signal has ended it."""
        deadline_s = time.monotonic() + patience_s
        while not (value := condition()) and not self._interrupts:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0:
                break
            self._executor.spin_once(timeout_sec=min(left_s, _TURN_s))
        self._interrupts.raise_noted()
        return value

    def status(self) -> Status:
        """The node's last word on the wire.  Raises UserError where no such node speaks."""
        from sma_msgs_py import status_from

        if not self._spin_until(lambda: "status" in self._latest, self._patience_s):
            raise UserError(self._nobody())
        return status_from(self.latest("status"))

    def wait_for_status(self, condition: Callable[[Status], bool], patience_s: float) -> bool:
        """Whether ``condition`` came to hold of the status."""
        return bool(self._spin_until(lambda: condition(self.status()), patience_s))

    def wait_until_said(self, on: bool) -> None:
        """Wait until the status says so too, or for a while: who asks next is told the same."""
        with contextlib.suppress(UserError):  # a stop may end a node before it has said anything
            self.wait_for_status(lambda status: (status.mode.value != "off") == on, SAID_s)

    def services(self) -> dict[str, str]:
        """Name and type of the node's services."""
        prefix = f"{self.full_name}/"
        kinds = self._node.get_service_names_and_types()
        return {name.removeprefix(prefix): kind[0] for name, kind in kinds if name.startswith(prefix)}

    def call(
        self, service: str, kind: type, request: Any, patience_s: float | None = None, again_s: float = math.inf
    ) -> Any:
        """The answer of ``~/service``, asked again every ``again_s``.  Raises UserError where none comes."""
        patience_s = self._patience_s if patience_s is None else patience_s
        client = self._node.create_client(kind, f"{self.full_name}/{service}")
        if not self._spin_until(client.service_is_ready, self._patience_s):
            raise UserError(self._nobody())
        asked: list[Any] = []
        begun_s = time.monotonic()

        def answered() -> Any:
            if not asked or time.monotonic() - begun_s >= again_s * len(asked):
                asked.append(client.call_async(request))
            return next((future for future in asked if future.done()), None)

        future = self._spin_until(answered, patience_s)
        if future is None:
            raise UserError(f"{self.full_name}: ~/{service} has not answered within {patience_s:g} s")
        return future.result()

    def advertise(self, topic: str, kind: type) -> None:
        """Be ready to publish on ``~/topic``: the node listens.  Raises UserError where it does not."""
        publisher = self._node.create_publisher(kind, f"{self.full_name}/{topic}", 10)
        if not self._spin_until(lambda: publisher.get_subscription_count() > 0, self._patience_s):
            raise UserError(self._nobody())
        self._publishers[topic] = publisher

    def others_publish(self, topic: str) -> bool:
        """Whether anybody else can publish on ``~/topic``, which was advertised."""
        return self._node.count_publishers(f"{self.full_name}/{topic}") > 1

    def wait_until_heard(self, topics: Collection[str], patience_s: float) -> None:
        """Wait for the first message of each of the topics, but not for ever."""
        self._spin_until(lambda: self._latest.keys() >= set(topics), patience_s)

    def publish(self, topic: str, message: Any) -> None:
        """Publish on ``~/topic``, which was advertised."""
        self._publishers[topic].publish(message)

    def finish(self) -> None:
        """A signal that has come is dealt with: what follows is the way out, and has its time."""
        self._interrupts = Interrupts()

    def _nobody(self) -> str:
        """Who was looked for, and who is there instead."""
        others = sorted(
            topic.removesuffix("/status")
            for topic, kinds in self._node.get_topic_names_and_types()
            if topic.endswith("/status")
            and "diagnostic_msgs/msg/DiagnosticStatus" in kinds
            and self._node.count_publishers(topic) > 0
        )
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        looked = (
            f"no node '{self.name}' in the namespace '{self.namespace}' has answered within {self._patience_s:g} s "
            f"(ROS_DOMAIN_ID is {domain})"
        )
        if self.full_name in others:
            return (
                f"{self.full_name} is there, but has not answered within {self._patience_s:g} s: ask again with a "
                "longer --patience; where another user runs it: docs/security.md, two users"
            )
        if others:
            return f"{looked}; there is {', '.join(others)}: name it with --node and --namespace"
        return f"{looked}, and there is no other; start one: sma_actuator_node --ros-args --params-file FILE"

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()


@contextlib.contextmanager
def connected(args: argparse.Namespace) -> Iterator[NodeClient]:
    """A client of the node that is meant.  Raises UserError where ROS 2 is not installed."""
    with noted_signals() as interrupts:
        try:
            client = NodeClient(args, interrupts)
        except ModuleNotFoundError as error:
            raise without_ros(error) from None
        try:
            yield client
        finally:
            client.close()
