"""The way to switch a wire off, apart from everything else that ROS carries.

``~/enable`` and ``~/stop`` of every node of a process are served by one more node, in a context of its own: another DDS
participant with its own ports, another thread.  A flood of setpoints fills the buffers of the participant it is sent
to, and DDS offers a request lost there again only after seconds; here it comes through.  ``~/stop`` has a node and a
thread to itself, and is heard beside DDS too by who is on the same computer (``base/local_stop.py``).

These threads only take requests, all that wait at once, and never wait themselves: DDS keeps but so many for a server
that is busy, and forgets the oldest, be it an off.  What a request asks for is done by two threads of the wire
(``Way``), one for on and one for off: no off waits for an on, and no wire for another.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from math import inf
from typing import Any, Protocol

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool, Trigger

from sma_actuator.base.local_stop import Reply, StopListener
from sma_actuator.driver import OFF_MEANWHILE

from .guard import spinning

#: Once switched off, a wire goes on again only where nobody has asked for anything for so long: who asks faster does
#: not know of the off yet, and a person does not.
QUIET_s = 0.5
#: Requests of one service that DDS keeps until they are taken: four seconds of a client that asks a hundred times a
#: second.  With 2000 what killed clients had sent in part filled what DDS has room for (by default 400 of a reader's
#: samples), and nobody else was heard until it held them for gone, twenty seconds later.
REQUESTS_KEPT = 400
_AT_ONCE = 100  #: requests of one service that are taken before the others have their turn
_MOST_WAITING = 100  #: requests that wait for the same "on"; more are refused


class Switchable(Protocol):
    """What the switch asks of a node that drives a wire, or a joint."""

    @property
    def parts(self) -> Sequence[Switchable]:
        """The wires of a joint: off of one of them is off of the joint."""

    def get_name(self) -> str:
        """Its name."""

    def get_namespace(self) -> str:
        """Its namespace."""

    def get_fully_qualified_name(self) -> str:
        """Both."""

    def resolve_service_name(self, service: str) -> str:
        """The full name of one of its services."""

    def switch_on(self, wanted: Callable[[], bool]) -> tuple[bool, str]:
        """Switch it on, unless by then it is not ``wanted`` any more: whether it is, and a sentence."""

    def switch_off(self) -> tuple[bool, str]:
        """Switch it off: whether it is, and a sentence."""

    def report(self, sentence: str) -> None:
        """Say what went wrong."""


class Way:
    """Off wins: what one wire is asked for, by anybody and as often as they like.

    Every off is followed by a switching off that began after it came.  It drops each on that was asked for before, and
    until somebody asks for on who did not ask in the ``QUIET_s`` before, nothing goes on.  Requests for on that come
    while another is done are done together, once.
    """

    def __init__(self, wire: Switchable, pool: Executor):
        self.wire = wire
        self.joints: list[Way] = []  #: that this wire turns
        self._pool = pool
        self._lock = threading.Lock()
        self._offs, self._ons = list[Reply](), list[Reply]()  #: that wait
        self._offs_done = self._ons_done = True  #: whether no thread is at it
        self._offs_come = 0
        self._held = False  #: an off has come, and nothing was switched on since
        self._asked_s = self._due_s = -inf  #: when something was last asked for; when what waits may go on

    def off(self, reply: Reply) -> None:
        """Switch it off; never waits."""
        dropped = [each for way in (self, *self.joints) for each in way._drop()]
        with self._lock:
            self._offs.append(reply)
            begins, self._offs_done = self._offs_done, False
        if begins:
            self._pool.submit(self._do_offs)
        for each in dropped:  # last: DDS may take 0.1 s for each client that is gone, and off does not wait for that
            each(False, OFF_MEANWHILE)

    def _drop(self) -> list[Reply]:
        with self._lock:
            self._offs_come += 1
            self._held, self._asked_s = True, time.monotonic()
            dropped, self._ons = self._ons, []
        return dropped

    def on(self, reply: Reply) -> None:
        """Switch it on, if nothing speaks against it; never waits."""
        now_s = time.monotonic()
        dropped = []
        with self._lock:
            if self._held:
                dropped, self._ons = self._ons, []
                self._due_s = now_s + (QUIET_s if now_s < self._asked_s + QUIET_s else 0.0)
            elif len(self._ons) >= _MOST_WAITING:
                dropped = [self._ons.pop()]
            self._asked_s = now_s
            self._ons.append(reply)
            begins, self._ons_done = self._ons_done, False
        if begins:
            self._pool.submit(self._do_ons)
        if dropped:
            words = f"not enabled: ~/enable true comes again and again; leave {QUIET_s:g} s between two requests"
            self.wire.report(words)
            for each in dropped:
                each(False, words)

    def _do_offs(self) -> None:
        while True:
            with self._lock:
                replies, self._offs = self._offs, []
                self._offs_done = not replies
            if not replies:
                return
            self._do(self.wire.switch_off, replies)

    def _do_ons(self) -> None:
        while True:
            with self._lock:
                wait_s = self._due_s - time.monotonic() if self._ons else 0.0
                if wait_s <= 0.0:
                    replies, self._ons = self._ons, []
                    self._ons_done = not replies
                    self._held = self._held and not replies
                    come = self._offs_come
            if wait_s > 0.0:
                time.sleep(wait_s)  # nobody is kept by that: off has a thread of its own
            elif replies:
                self._do(partial(self.wire.switch_on, partial(self._has_only_had, come)), replies)
            else:
                return

    def _has_only_had(self, offs: int) -> bool:
        return self._offs_come == offs

    def _do(self, what: Callable[[], tuple[bool, str]], replies: list[Reply]) -> None:
        try:
            done, words = what()
        except Exception as error:  # noqa: BLE001 - whatever it is, the next request is as good as any
            done, words = False, f"{type(error).__name__}: {error}"
        if not done:
            self.wire.report(words)
        for reply in replies:
            reply(done, words)


class Switch:
    """Serves ``~/enable`` and ``~/stop`` of ``nodes``; ``arguments`` as for ``rclpy.init``."""

    def __init__(self, nodes: Sequence[Switchable], arguments: list[str]):
        self._pool = ThreadPoolExecutor(2 * len(nodes), "switch")
        self._ways = [Way(node, self._pool) for node in nodes]
        for way in self._ways:
            way.joints = [joint for joint in self._ways if way.wire in joint.wire.parts]
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
        for way in self._ways:
            _serve(switch, SetBool, way.wire.resolve_service_name("~/enable"), partial(_on_enable, way))
        stops = [node.resolve_service_name("~/stop") for node in nodes]
        for name in stops:
            _serve(stop, Trigger, name, lambda _, reply: self._stop_all(reply))
        self._threads = [
            spinning(node, node.get_name(), lambda error: first.report(f"{type(error).__name__}: {error}"))
            for node in (switch, stop)
        ]
        self._beside: StopListener | None = None
        try:
            self._beside = StopListener(stops, str(self._context.get_domain_id()), self._stop_all)
        except OSError as error:  # ~/stop is heard all the same
            first.report(f"who asks for ~/stop on this computer has to find the node first: {error}")

    def _stop_all(self, reply: Reply) -> None:
        """All wires of the process off, at the same time; the answer says of each what became of it."""
        lock, said = threading.Lock(), dict[str, tuple[bool, str]]()

        def note(name: str, done: bool, words: str) -> None:
            with lock:
                said[name] = done, f"{name}: {words}"
                complete = len(said) == len(self._ways)
            if complete:
                reply(all(done for done, _ in said.values()), "; ".join(said[name][1] for name in names))

        names = [way.wire.get_fully_qualified_name() for way in self._ways]
        for name, way in zip(names, self._ways, strict=True):
            way.off(partial(note, name))

    def close(self) -> None:
        """Hear nobody any more."""
        if self._beside is not None:
            self._beside.close()
        rclpy.try_shutdown(context=self._context)
        for thread in self._threads:
            thread.join(1.0)
        self._pool.shutdown(wait=False, cancel_futures=True)


def _on_enable(way: Way, request: SetBool.Request, reply: Reply) -> None:
    (way.on if request.data else way.off)(reply)


def _as_asked(request: Any, _: Any) -> Any:
    return request


def _serve(node: Node, kind: Any, name: str, take: Callable[[Any, Reply], None]) -> None:
    """A service whose requests all go to ``take(request, reply)``, which must not wait; the reply may come from any
    thread.

    The executor of rclpy takes one request at a time and wants its response from the callback: so what it would send as
    the response is the request itself, and where it would send it the others that wait are taken too.
    """
    service: Any = node.create_service(kind, name, _as_asked, qos_profile=QoSProfile(depth=REQUESTS_KEPT))
    send, lock = service.send_response, threading.Lock()

    def reply(header: Any, done: bool, words: str) -> None:
        with lock:  # rcl sends for one thread at a time
            if node.context.ok():
                send(kind.Response(success=done, message=words), header)

    def received(request: Any, header: Any) -> None:
        for _ in range(_AT_ONCE):
            take(request, partial(reply, header))
            with service.handle:
                request, header = service.handle.service_take_request(kind.Request)
            if header is None:
                return
        take(request, partial(reply, header))

    service.send_response = received
