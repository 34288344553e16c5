"""Nodes in processes of their own, and a ROS 2 client that talks to them."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
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

from .stand import SOON_s, wait_until


class Nursery:
    """Starts nodes by :mod:`attack.nursery`."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "attack.nursery"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._started: queue.Queue[int] = queue.Queue()
        self._codes: dict[int, int] = {}
        threading.Thread(target=self._listen, name="nursery", daemon=True).start()

    def start(self, parameters: Path, log: Path, name: str) -> Node:
        """A node of this name."""
        arguments = ["--nodes", name, "--ros-args", "--params-file", str(parameters)]
        self._process.stdin.write(json.dumps({"arguments": arguments, "log": str(log)}) + "\n")
        self._process.stdin.flush()
        return Node(self, self._started.get(timeout=SOON_s), log, name)

    def code(self, pid: int) -> int | None:
        """Exit code of a node, None while it runs."""
        return self._codes.get(pid)

    def close(self) -> None:
        """Start no more."""
        self._process.stdin.close()
        self._process.wait(SOON_s)

    def _listen(self) -> None:
        for line in self._process.stdout:
            word, pid, *code = line.split()
            if word == "started":
                self._started.put(int(pid))
            else:
                self._codes[int(pid)] = int(code[0])


class Node:
    """One node's process."""

    def __init__(self, nursery: Nursery, pid: int, log: Path, name: str):
        self.pid, self.log, self.name = pid, log, name
        self._nursery = nursery

    @property
    def ended(self) -> int | None:
        """Exit code, None while it runs."""
        return self._nursery.code(self.pid)

    def send(self, number: int) -> float:
        """Send a signal; the monotonic time just before."""
        now_s = time.monotonic()
        os.kill(self.pid, number)
        return now_s

    def end(self) -> None:
        """End it, if need be by force."""
        for number in (signal.SIGCONT, signal.SIGINT, signal.SIGKILL):
            if self.ended is not None:
                return
            try:
                os.kill(self.pid, number)
                wait_until(lambda: self.ended is not None, 0.0 if number == signal.SIGCONT else 5.0)
            except (ProcessLookupError, TimeoutError):
                continue

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
