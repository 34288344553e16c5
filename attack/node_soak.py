"""A soak of a node: one that drives a wire over ROS 2, in real time and faster than usual, while somebody listens; then
one that is configured anew again and again.  What its process takes of this machine's memory is read from outside.

A day of it would take a day: so the loop runs five times as fast as usual.
"""

from __future__ import annotations

import json
import random
import tempfile
import time
from pathlib import Path

from sma_actuator.config import read_parameter_file

from .hours import CONFIG
from .nodes import Client, Node
from .nursery import Nursery
from .result import Result, Violation
from .soak import own_memory_B
from .stand import Stand

# After .nodes, which says where ROS may be heard.
from geometry_msgs.msg import WrenchStamped  # isort: skip
from lifecycle_msgs.msg import Transition  # isort: skip
from lifecycle_msgs.srv import ChangeState  # isort: skip
from sensor_msgs.msg import JointState  # isort: skip
from std_msgs.msg import Float64  # isort: skip

NAME = "soaked"
RATE_Hz = 100.0
SETPOINT_s = 0.05  #: between two setpoints
SETTLED_SHARE = 0.25  #: of the time; then everything is there that is there once
CONFIGURED = 60  #: times, after some to begin with
FIRST_CONFIGURED = 20
#: What may come to it: ten bytes for each step of eight minutes.
MOST_GROWN_B = 500_000
#: A driver gives up its connections in its own time; and so long a busy machine may take to answer.
ANSWER_s = 30.0


def attack(seed: int, seconds: float) -> Result:
    """Drive for ``seconds``, then configure; what grows is a broken promise."""
    result, chance = Result(), random.Random(seed)
    replay = f"python -m attack node_soak --minutes-of-node {seconds / 60:g}"
    with tempfile.TemporaryDirectory(prefix="sma_attack_") as name:
        folder = Path(name)
        stand, nursery, client = Stand("--seed", str(seed)), Nursery(), Client()
        try:
            node = Node(nursery, _parameters(folder, stand), folder / "node.log", NAME)
            try:
                words = client.drive(NAME, stand, lambda: node.ended is None)
                if words:
                    result.violations.append(Violation("a node does not come to drive the wire", words, replay))
                    return result
                looks = _driven(client, node.pid, chance, seconds, result)
                _see(result, "while it drives", looks, replay)
                _see(result, f"while it is configured {CONFIGURED} times", _configured(client, node.pid), replay)
                result.see("memory of the node at the end [MB]", own_memory_B(node.pid) / 1e6)
            finally:
                node.end()
        finally:
            client.close()
            nursery.close()
            stand.close()
    return result


def _parameters(folder: Path, stand: Stand) -> Path:
    """A parameter file of a node that goes on where the machine stalls: nothing is to go wrong here."""
    parameters = read_parameter_file(CONFIG / "flexinol.yaml")
    for role, port in (("supply", stand.supply_port), ("daq", stand.daq_port)):
        parameters["instruments"][role] |= {"resource": f"TCPIP::127.0.0.1::{port}::SOCKET", "timeout": 2.0}
    parameters["loop"] = {"rate": RATE_Hz, "samples_per_block": 10, "overruns_to_fault": 1000}
    parameters["safety"]["reading_timeout"] = 5.0
    parameters["supply"]["watchdog_timeout"] = 20.0
    parameters["recorder"] = {"folder": str(folder / "logs"), "max_files": 3, "max_file_size": 1_000_000}
    path = folder / "parameters.yaml"
    path.write_text(json.dumps({NAME: {"ros__parameters": parameters}}))
    return path


def _driven(client: Client, pid: int, chance: random.Random, seconds: float, result: Result) -> tuple[int, int, int]:
    """Memory of the node once it has settled, in the middle of the rest, and at its end."""

    def heard(_: object) -> None:
        result.counts["messages heard"] += 1

    for topic, kind in (
        ("joint_states", JointState),
        ("load", WrenchStamped),
        ("command_current", Float64),
        ("signals", JointState),
    ):
        client.node.create_subscription(kind, f"/{NAME}/{topic}", heard, 50)
    setpoints = client.node.create_publisher(Float64, f"/{NAME}/setpoint", 10)
    looks = []
    begun_s = time.monotonic()
    for share in (SETTLED_SHARE, 0.5 * (1.0 + SETTLED_SHARE), 1.0):
        while time.monotonic() - begun_s < share * seconds:
            setpoints.publish(Float64(data=chance.uniform(-0.001, 0.006)))
            result.counts["setpoints"] += 1
            client.spin_until(lambda: False, SETPOINT_s)
        looks.append(own_memory_B(pid))
    first, middle, last = looks
    return first, middle, last


def _configured(client: Client, pid: int) -> tuple[int, int, int]:
    """The same of a node that gives its instruments up and takes them again."""

    def change(number: int) -> None:
        request = ChangeState.Request(transition=Transition(id=number))
        client.call(f"/{NAME}/change_state", ChangeState, request, ANSWER_s)

    looks = []
    change(Transition.TRANSITION_DEACTIVATE)
    for times in (FIRST_CONFIGURED, CONFIGURED // 2, CONFIGURED - CONFIGURED // 2):
        for _ in range(times):
            change(Transition.TRANSITION_CLEANUP)
            change(Transition.TRANSITION_CONFIGURE)
        looks.append(own_memory_B(pid))
    first, middle, last = looks
    return first, middle, last


def _see(result: Result, when: str, looks: tuple[int, int, int], replay: str) -> None:
    first, middle, last = looks
    result.see(f"memory of the node grown {when} [kB]", (last - first) / 1e3)
    result.see(f"memory of the node grown {when}, second half [kB]", (last - middle) / 1e3)
    if last - first > MOST_GROWN_B:
        result.violations.append(Violation("memory of a node grows", f"{last - first} B {when}", replay))
