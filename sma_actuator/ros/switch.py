"""The way to switch a wire off, apart from everything else that ROS carries.

``~/enable`` and ``~/stop`` of every node of a process are served by one more node, in a context of its own: another
DDS participant with its own ports, another thread.  A flood of setpoints fills the buffers of the participant it is
sent to, and DDS offers a request lost there again only after seconds; here it comes through.  ``~/stop`` has a node and a
thread to itself: ``~/enable`` is answered when the supply has confirmed it, which a slow one takes seconds for.

No wire waits for another: each has a thread while it is switched, and ``~/stop`` switches all at the same time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool, Trigger

from .guard import refuse_what_raises, spin


class Switchable(Protocol):
    """What the switch asks of a node that drives a wire."""

    def get_name(self) -> str:
        """Its name."""

    def get_namespace(self) -> str:
        """Its namespace."""

    def get_fully_qualified_name(self) -> str:
        """Both."""

    def resolve_service_name(self, service: str) -> str:
        """The full name of one of its services."""

    def on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Switch the wire on or off."""

    def switch_off(self) -> tuple[bool, str]:
        """Switch the wire off: whether it is, and a sentence."""

    def report(self, sentence: str) -> None:
        """Say what went wrong."""


class Switch:
    """Serves ``~/enable`` and ``~/stop`` of ``nodes``; ``arguments`` as for ``rclpy.init``."""

    def __init__(self, nodes: Sequence[Switchable], arguments: list[str]):
        self._nodes = nodes
        self._stops = 0  #: that have come
        self._context = rclpy.Context()
        rclpy.init(args=arguments, context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        first = nodes[0]
        switch, stop = (
            rclpy.create_node(
                f"{first.get_name()}_{what}",
                namespace=first.get_namespace(),
                context=self._context,
                use_global_arguments=False,  # a remapping of the node's name is not meant for this one
                start_parameter_services=False,
                enable_rosout=False,
            )
            for what in ("switch", "stop")
        )
        for wire in nodes:
            group = MutuallyExclusiveCallbackGroup()
            switch.create_service(
                SetBool, wire.resolve_service_name("~/enable"), self._enable(wire), callback_group=group
            )
            stop.create_service(Trigger, wire.resolve_service_name("~/stop"), self._on_stop)
        self._threads = [
            threading.Thread(
                target=spin,
                args=(node, lambda error: first.report(f"{type(error).__name__}: {error}")),
                kwargs={"at_once": len(nodes) if node is switch else 1},
                daemon=True,
                name=node.get_name(),
            )
            for node in (switch, stop)
        ]
        for node, thread in zip((switch, stop), self._threads, strict=True):
            refuse_what_raises(node, first.report)
            thread.start()

    def _enable(self, wire: Switchable) -> Callable[[SetBool.Request, SetBool.Response], SetBool.Response]:
        """Switch one wire; it does not stay on where a stop has come meanwhile."""

        def answer(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            stops = self._stops
            response = wire.on_enable(request, response)
            if request.data and response.success and stops != self._stops:
                response.success, response.message = False, f"not enabled, ~/stop has come: {wire.switch_off()[1]}"
            return response

        return answer

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        """All wires of the process off, at the same time; the answer says of each what became of it."""
        self._stops += 1
        with ThreadPoolExecutor(len(self._nodes)) as pool:
            off = list(pool.map(lambda wire: wire.switch_off(), self._nodes))
        answers = [(wire.get_fully_qualified_name(), *said) for wire, said in zip(self._nodes, off, strict=True)]
        response.success = all(done for _, done, _ in answers)
        response.message = "; ".join(f"{name}: {sentence}" for name, _, sentence in answers)
        return response

    def close(self) -> None:
        """Leave the ROS graph."""
        rclpy.try_shutdown(context=self._context)
        for thread in self._threads:
            thread.join(1.0)
