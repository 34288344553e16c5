"""The shipped policy of SROS2: it names what the node really has, and where ROS 2 has security it is enforced."""

import contextlib
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from importlib.util import find_spec
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
from processes import wait_until
from rclpy.impl.implementation_singleton import rclpy_implementation

POLICY = Path(__file__).resolve().parents[2] / "config" / "sros2_policy.xml"
NODES = ("sma_actuator", "sma_actuator_switch", "sma_actuator_stop")
#: What an action that a node executes is made of.
OF_ACTIONS = {
    ("topics", "publish"): ("feedback", "status"),
    ("topics", "subscribe"): (),
    ("services", "reply"): ("cancel_goal", "get_result", "send_goal"),
}


def allowed(enclave, kind, how):
    """Full names that an enclave of the policy allows: ``topics`` to ``publish``, ``services`` to ``reply`` and so
    on."""
    names = set()
    for profile in ET.parse(POLICY).findall(f"./enclaves/enclave[@path='{enclave}']/profiles/profile"):
        for group in profile.findall(kind):
            if group.get(how) == "ALLOW":
                names |= {e.text.replace("~", f"/{profile.get('node')}") for e in group}
    return names


def test_the_policy_allows_the_node_what_it_has_and_nothing_else(client_of_running_node):
    graph = client_of_running_node.node

    def names(of):
        def look():
            found = set()
            for name in NODES:
                with contextlib.suppress(rclpy_implementation.NodeNameNonExistentError):  # not seen yet
                    found |= {topic.replace("/asked/", "/") for topic, _ in of(name, "/asked")}
            return found

        return look

    for kind, how, of in (
        ("topics", "publish", graph.get_publisher_names_and_types_by_node),
        ("topics", "subscribe", graph.get_subscriber_names_and_types_by_node),
        ("services", "reply", graph.get_service_names_and_types_by_node),
    ):
        wanted, look = allowed("/wire", kind, how), names(of)
        if find_spec("control_msgs"):
            for action in allowed("/wire", "actions", "execute"):
                wanted |= {f"{action}/_action/{part}" for part in OF_ACTIONS[kind, how]}
        with contextlib.suppress(AssertionError):
            client_of_running_node.spin_until(lambda: look() == wanted, 20.0)  # noqa: B023
        assert look() ^ wanted == set(), (kind, how)


def test_whoever_commands_may_ask_for_nothing_that_the_node_does_not_serve_and_who_looks_may_ask_for_nothing():
    assert allowed("/commander", "services", "request") <= allowed("/wire", "services", "reply")
    assert allowed("/commander", "topics", "publish") - {"/parameter_events", "/rosout"} == allowed(
        "/wire", "topics", "subscribe"
    )
    assert allowed("/commander", "actions", "call") == allowed("/wire", "actions", "execute")
    assert allowed("/spectator", "services", "request") == allowed("/spectator", "actions", "call") == set()
    assert allowed("/spectator", "topics", "publish") == {"/parameter_events", "/rosout"}
    assert allowed("/spectator", "topics", "subscribe") <= allowed("/wire", "topics", "publish")


_ASK = """
import sys, time, rclpy
from std_srvs.srv import SetBool
rclpy.init(args=["--ros-args", "--enclave", sys.argv[1]])
node = rclpy.create_node(sys.argv[1].strip("/"), start_parameter_services=False)
client = node.create_client(SetBool, "/sma_actuator/enable")
end_s, answer = time.monotonic() + float(sys.argv[2]), None
while answer is None and time.monotonic() < end_s:
    if client.wait_for_service(0.5):
        future = client.call_async(SetBool.Request(data=False))
        rclpy.spin_until_future_complete(node, future, timeout_sec=2.0)
        answer = future.result() if future.done() else None
print("answered" if answer is not None else "not answered")
"""


def test_only_who_holds_the_keys_may_command(start_bench, make_config, start_node, tmp_path, monkeypatch):
    pytest.importorskip("sros2")
    keys = tmp_path / "keys"

    def security(*words):
        subprocess.run(["ros2", "security", *map(str, words)], check=True, timeout=60)

    security("create_keystore", keys)
    for enclave in ("/wire", "/commander", "/spectator"):
        security("create_enclave", keys, enclave)
        security("create_permission", keys, enclave, POLICY)
    bench = start_bench("--load", "weight:0.98")
    for name, value in (("KEYSTORE", str(keys)), ("ENABLE", "true"), ("STRATEGY", "Enforce")):
        monkeypatch.setenv(f"ROS_SECURITY_{name}", value)
    node = start_node(make_config(instruments=bench.instruments()), "--enclave", "/wire")
    wait_until(lambda: "Found security directory" in node.words or node.popen.poll() is not None, what="security")

    def asked(enclave, seconds, **environment):
        run = subprocess.run(
            [sys.executable, "-c", _ASK, enclave, str(seconds)],
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        return run.stdout.strip() or run.stderr

    assert asked("/commander", 30.0) == "answered"
    assert asked("/spectator", 5.0) != "answered"
    assert asked("/", 5.0, ROS_SECURITY_ENABLE="false") == "not answered"
