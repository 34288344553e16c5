"""Real processes: benches and nodes under test, and a ROS 2 client in this one.

Every wait is bounded and ends when its condition holds; nothing sleeps for a time that "should do".
"""

from __future__ import annotations

import atexit
import functools
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from waiting import Elapsed, SOON_s, wait_until

from attack.nursery import SHOW_STACKS, Nursery, Process

_NODES: set[NodeProcess] = set()  #: that run


def _where_nodes_are():
    return "".join(node.where() for node in _NODES)


#: Without an answer for so long a service is asked again: DDS loses the answer to a client whom the server has not
#: found yet, on a busy machine once or twice in a run.  The slowest that is asked, a self-test, takes 20 s.
AGAIN_s = 5.0
AGAIN_ONCE_s = 40.0
ONCE = ("self_test", "tune", "change_state")  #: what would be another thing the second time


@functools.cache
def nursery():
    """What starts the processes of this one's tests; programs that start like a user's are in tests/cli and others."""
    started = Nursery()
    atexit.register(started.close)
    return started


class Bench:
    """A virtual bench in a process of its own."""

    def __init__(self, folder: Path, *arguments: str):
        ports_file = folder / f"ports{time.monotonic_ns()}.json"
        ports = ["--supply-port", "0", "--daq-port", "0", "--ports-file", str(ports_file)]
        self.process = nursery().start(("-m", "sma_actuator"), ["bench", *ports, *arguments], os.devnull)
        wait_until(lambda: ports_file.exists() or self.process.poll() is not None, what="the bench")
        self.ports = json.loads(ports_file.read_text())
        self._sockets: dict[int, socket.socket] = {}

    def instruments(self, number=0):
        """Section ``instruments`` of a parameter file for one of the benches."""
        ports = self.ports[number]
        return {
            "supply": {"resource": f"TCPIP::127.0.0.1::{ports['supply']}::SOCKET"},
            "daq": {"resource": f"TCPIP::127.0.0.1::{ports['daq']}::SOCKET", "lvdt_channel": 104},
            "reconnect_backoff_max": 0.5,
        }

    def tell(self, command, number=0):
        """A command on the DAQ's port, which does not feed the supply's watchdog; its answer, if it is a query."""
        port = self.ports[number]["daq"]
        if port not in self._sockets:
            self._sockets[port] = socket.create_connection(("127.0.0.1", port), timeout=SOON_s)
        connection = self._sockets[port]
        connection.sendall(f"{command}\n".encode())
        if "?" not in command:
            return ""
        answer = b""
        while not answer.endswith(b"\n"):
            part = connection.recv(4096)
            assert part, f"the bench hung up on {command}"
            answer += part
        return answer.decode().strip()

    def truth(self, number=0):
        """(displacement [m], load [N], current [A]) as they are."""
        values = [float(v) for v in self.tell("BENC:TRUT?", number).split(",")]
        return values[1], values[7], values[9]

    def current_A(self, number=0):
        return self.truth(number)[2]

    def close(self):
        for connection in self._sockets.values():
            connection.close()
        self.process.kill()
        self.process.wait()


def _in_short(words):
    """What a node has written, with its stacks as one line per thread: a record of a run is cut in its middle."""
    lines = []
    for line in words.splitlines():
        where = re.fullmatch(r'  File "(?:.*/)?([^/]+)", line (\d+) in (.*)', line)
        if where is None:
            lines.append(line)
        elif "threading.py" not in line:
            lines[-1] += " < " + ":".join(where.groups())
    return "\n".join(filter(None, lines))


class NodeProcess:
    """The node's process."""

    def __init__(self, arguments, folder, program=("-m", "sma_actuator.ros.node"), fresh=False):
        """``fresh``: by an interpreter of its own, for what is tested is what it imports or reads at the start."""
        self.log = folder / f"node{time.monotonic_ns()}.log"
        _NODES.add(self)
        if not fresh:
            self.popen = nursery().start(program, arguments, self.log)
            return
        with self.log.open("wb") as log:
            self.popen = subprocess.Popen([sys.executable, *program, *arguments], stdout=log, stderr=log)

    @property
    def words(self):
        return self.log.read_text(errors="replace")

    def where(self):
        """What it has written, and where its threads are."""
        if self.popen.poll() is None and isinstance(self.popen, Process):
            written = len(self.words)
            self.popen.send_signal(SHOW_STACKS)
            wait_until(lambda: "most recent call first" in self.words[written:], what="the stacks")
        return f"the node ({self.popen.poll()}) says:\n{_in_short(self.words)}\n"

    def says(self, text):
        """Wait until the node has written ``text``."""
        wait_until(lambda: text in self.words, what=f"'{text}' in:\n{self.words}\n")

    def ends(self):
        """Exit code of the process, once it has ended."""
        return self.popen.wait(SOON_s)

    def ends_in_order(self):
        """Whether it ends with 0, as asked; with 1 where it says that the supply, which was held up, has not confirmed
        off."""
        return self.ends() == int("not confirmed; look at the supply" in self.words)

    def close(self):
        _NODES.discard(self)
        if self.popen.poll() is None:
            self.popen.send_signal(signal.SIGINT)
            try:
                self.popen.wait(5.0)
            except subprocess.TimeoutExpired:
                self.popen.kill()
                self.popen.wait()


def parameter_file(folder: Path, sections) -> Path:
    """Write node names and their parameters as a parameter file (JSON is YAML)."""
    path = folder / f"parameters{time.monotonic_ns()}.yaml"
    path.write_text(json.dumps({name: {"ros__parameters": values} for name, values in sections.items()}))
    return path


class Client:
    """What a ROS 2 program sees of the node."""

    def __init__(self):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("test_client", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._publishers = {}
        self.services = {}
        self.received = {}
        self._others = []

    def spin_until(self, condition, timeout_s=SOON_s, what="it"):
        """Handle callbacks until ``condition`` is true; its value."""
        elapsed = Elapsed()
        while not (value := condition()):
            if elapsed.look() >= timeout_s:
                raise AssertionError(f"{what} did not come within {timeout_s} s; {_where_nodes_are()}")
            self.executor.spin_once(timeout_sec=0.02)
        return value

    def listen(self, topic, kind, latched=False):
        """The list into which the messages of a topic go."""
        from rclpy.qos import DurabilityPolicy, QoSProfile

        if topic not in self.received:
            self.received[topic] = []
            durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
            self.node.create_subscription(
                kind, topic, self.received[topic].append, QoSProfile(depth=50, durability=durability)
            )
        return self.received[topic]

    def next(self, topic, kind, condition=lambda _: True, timeout_s=SOON_s):
        """The next message on ``topic`` for which ``condition`` holds."""
        messages = self.listen(topic, kind)
        messages.clear()
        return self.spin_until(
            lambda: next((m for m in messages if condition(m)), None), timeout_s, f"message on {topic}"
        )

    def publisher(self, topic, kind):
        """The publisher of a topic, once somebody listens."""
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(kind, topic, 10)
        publisher = self._publishers[topic]
        self.spin_until(lambda: publisher.get_subscription_count() > 0, what=f"subscriber of {topic}")
        return publisher

    def publish(self, topic, message):
        """Publish, once somebody listens."""
        self.publisher(topic, type(message)).publish(message)

    def call(self, service, kind, request=None):
        """Response of a service."""
        if service not in self.services:
            self.services[service] = self.node.create_client(kind, service)
        client = self.services[service]
        self.spin_until(client.service_is_ready, what=service)
        asking, asked = [client], []  # that wait for the service, and what was asked
        again_s = AGAIN_ONCE_s if service.endswith(ONCE) else AGAIN_s
        begun_s = time.monotonic()

        def answer():
            # Another participant is heard where this one is not: once one was not for 150 s, whatever it made anew.
            if not asking and time.monotonic() > begun_s + again_s * len(asked):
                self._others.append(Client())
                asking.append(self._others[-1].node.create_client(kind, service))
            for other in self._others:
                other.executor.spin_once(timeout_sec=0.0)
            for ready in [each for each in asking if each.service_is_ready()]:
                asking.remove(ready)
                asked.append(ready.call_async(request or kind.Request()))
            return next((future.result() for future in asked if future.done()), None)

        return self.spin_until(answer, what=f"answer of {service}")

    def close(self):
        import rclpy

        for other in self._others:
            other.close()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)
