"""Nodes in processes of their own, and a ROS 2 client that talks to them."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Before rclpy is imported: nothing outside this machine, and no other run, is heard.
os.environ.setdefault("ROS_DOMAIN_ID", str(100 + os.getpid() % 80))
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import SetBool, Trigger

from .nursery import Nursery
from .result import Result, Violation
from .stand import SOON_s


class Node:
    """A node of this name, in a process of its own."""

    def __init__(self, nursery: Nursery, parameters: Path, log: Path, name: str):
        arguments = ["--nodes", name, "--ros-args", "--params-file", str(parameters)]
        self.log, self.name = log, name
        self._process = nursery.start(("-m", "sma_actuator.ros.node"), arguments, log)
        self.pid = self._process.pid

    @property
    def ended(self) -> int | None:
        """Exit code, None while it runs."""
        return self._process.poll()

    def send(self, number: int) -> float:
        """Send a signal; the monotonic time just before."""
        now_s = time.monotonic()
        os.kill(self.pid, number)
        return now_s

    def end(self) -> None:
        """End it, if need be by force."""
        for number, patience_s in ((signal.SIGCONT, 0.0), (signal.SIGINT, 5.0), (signal.SIGKILL, 5.0)):
            self._process.send_signal(number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(patience_s)
                return

    def last_words(self) -> str:
        """The end of what it wrote."""
        return self.log.read_text(errors="replace")[-600:] if self.log.exists() else ""


class Client:
    """What a ROS 2 program sees of a node."""

    def __init__(self, number: int = 0) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node(f"attacker_{os.getpid()}_{number}", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._clients: dict[str, Any] = {}

    def spin_until(self, condition: Callable[[], Any], timeout_s: float) -> Any:
        """Handle callbacks until ``condition`` is true; its value, or None when the time is over."""
        deadline_s = time.monotonic() + timeout_s
        while not (value := condition()):
            if time.monotonic() > deadline_s:
                return None
            self._executor.spin_once(timeout_sec=0.01)
        return value

    def call(self, service: str, kind: Any, request: Any = None, timeout_s: float = 5.0) -> Any:
        """Response of a service, None where there is none in time; the next call then has a client of its own, as a
        person's has."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        client, answer = self._clients[service], None
        if self.spin_until(client.service_is_ready, timeout_s):
            future = client.call_async(request or kind.Request())
            answer = self.spin_until(lambda: future.done() and future.result(), timeout_s)
        if answer is None:
            self.node.destroy_client(self._clients.pop(service))
        return answer

    def drive(self, name: str, stand: Any, alive: Callable[[], bool], timeout_s: float = SOON_s) -> str:
        """Enable a node until current flows; "" or why it does not."""
        deadline_s = time.monotonic() + timeout_s
        words = "no answer"
        while time.monotonic() < deadline_s and alive():
            self.call(f"/{name}/clear_fault", Trigger, timeout_s=2.0)
            answer = self.call(f"/{name}/enable", SetBool, SetBool.Request(data=True), timeout_s=2.0)
            words = answer.message if answer is not None else words
            if answer is not None and answer.success:
                if self.spin_until(lambda: stand.now.current_A > 0.02, 2.0):
                    return ""
                words = "enabled, and no current flows"
        return words if alive() else "the node has ended"

    def close(self) -> None:
        """Leave ROS."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


class AttackedNodes:
    """Nodes that are attacked at random, a client that talks to them, and what came of it."""

    def __init__(self, seed: int):
        self.seed = seed
        self.result = Result()
        self._chance = random.Random(seed)
        self._temporary = tempfile.TemporaryDirectory(prefix="sma_attack_")
        self.folder = Path(self._temporary.name)
        self.nursery, self.client = Nursery(), Client()

    def close(self) -> None:
        """End everything."""
        self.client.close()
        self.nursery.close()
        self._close_stand()
        self._temporary.cleanup()

    def _close_stand(self) -> None:
        """End what the nodes were driven on, while the folder is there yet."""

    @property
    def replay(self) -> str:
        """The command that does the same again."""
        raise NotImplementedError

    def broken(self, rule: str, detail: str) -> None:
        """Write down a broken promise."""
        self.result.violations.append(Violation(rule, detail, self.replay))


class KilledNodes(AttackedNodes):
    """Of which each is ended by a signal, or what it drives is."""

    ATTACK = ""  #: its name at the command line
    present = 0  #: how many were before

    @property
    def replay(self) -> str:
        """See :class:`AttackedNodes`."""
        return f"python -m attack {self.ATTACK} --seed {self.seed} --count {self.present + 1}"

    def kill(self, number: int) -> None:
        """Start a node, drive the wire, end something, see the current go."""
        raise NotImplementedError

    @classmethod
    def attack(cls, seed: int, count: int) -> Result:
        """So many ends, one after the other, at random instants."""
        with contextlib.closing(cls(seed)) as killing:
            for number in range(count):
                killing.present = number
                killing.kill(number)
        return killing.result
