"""What ``sma-actuator view --foxglove`` serves, heard by Foxglove's own client: every kind of message, and nothing can
be done."""

import asyncio
import contextlib
import json
import subprocess
import sys
import threading
import time

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
pytest.importorskip("aiohttp", reason="aiohttp is not installed (extra 'view')")
pytest.importorskip("foxglove", reason="foxglove-sdk is not installed (extra 'foxglove')")

import aiohttp
import foreign
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from messages import NAME, every_message, kind_of
from rclpy.qos import DurabilityPolicy, QoSProfile

from sma_actuator.cli.main import main
from sma_actuator.view.foxglove import Topics

SOON_s = 60.0


@pytest.fixture
def node():
    """A node of ROS to publish with."""
    context = rclpy.Context()
    rclpy.init(context=context)
    yield rclpy.create_node("sma_actuator", context=context)
    rclpy.try_shutdown(context=context)


class Viewer:
    """Foxglove's client in a process of its own: ``heard``, whatever it says."""

    def __init__(self, address):
        self.heard = []
        self._process = subprocess.Popen(
            ["node", foreign.HERE / "listen.mjs", address], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        for line in self._process.stdout:
            self.heard += foreign.lines(line)

    def messages(self):
        """By topic, the last that came."""
        assert self._process.poll() is None, "the client has ended"
        return {each["topic"]: each for each in self.heard if "topic" in each}

    def close(self):
        self._process.stdin.close()
        assert self._process.wait(SOON_s) == 0
        self._reader.join()
        self._process.stdout.close()


def _until_none(left, turn=lambda: None):
    """Wait until nothing is left of what ``left()`` lists."""
    deadline_s = time.monotonic() + SOON_s
    while still := left():
        assert time.monotonic() < deadline_s, still
        turn()
        time.sleep(0.05)


def test_every_message_arrives_as_it_was_sent_and_nothing_can_be_done(node, outputs):
    foreign.need_node()
    sent = {
        topic: message for topic, message in every_message(outputs) if topic.startswith((f"{NAME}/", "/diagnostics"))
    }
    said_once = {topic for topic, message in sent.items() if isinstance(message, DiagnosticStatus)}
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publishers = {
        topic: node.create_publisher(type(message), topic, latched if topic in said_once else 10)
        for topic, message in sent.items()
    }

    def publish(topics):
        for topic in topics:
            publishers[topic].publish(sent[topic])

    publish(said_once)  # before anybody looks
    with contextlib.closing(Topics([NAME], "127.0.0.1", 0)) as topics:
        assert not any(publisher.get_subscription_count() for publisher in publishers.values())
        viewer = Viewer(f"ws://127.0.0.1:{topics.port}")
        with contextlib.closing(viewer):
            _until_none(lambda: sent.keys() ^ viewer.messages().keys(), lambda: publish(sent.keys() - said_once))
            for topic, heard in viewer.messages().items():
                assert heard["type"] == kind_of(sent[topic])
                assert foreign.same(heard["message"], foreign.plain(sent[topic])), topic
            assert {"capabilities": []} in viewer.heard
            # Its attempt to publish is refused in words.
            _until_none(lambda: {"status"}.difference(*viewer.heard))
            assert node.count_publishers(f"{NAME}/setpoint") == 1, "ours"
        _until_none(lambda: [topic for topic, each in publishers.items() if each.get_subscription_count()])


async def _offers(port, topic):
    """How a viewer that looks at nothing is offered a topic and has it taken back, until it is offered a third time."""
    heard = []
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"ws://127.0.0.1:{port}", protocols=["foxglove.sdk.v1"]) as socket,
    ):
        while [each["op"] for each in heard] != ["advertise", *["unadvertise", "advertise"] * 2]:
            message = json.loads((await socket.receive(SOON_s)).data)
            ids = {channel["id"] for channel in message.get("channels", []) if channel["topic"] == topic}
            ids |= {each["id"] for each in heard} & set(message.get("channelIds", []))
            heard += [{"op": message["op"], "id": each} for each in ids]
    return [each["id"] for each in heard]


def test_what_nobody_looks_at_is_offered_again_since_the_server_may_have_refused_who_asked(node):
    """foxglove-sdk 0.30.3 answers "Unknown channel ID" to a client that asks in the instant of the offer; on a busy
    machine twice."""
    with contextlib.closing(Topics([NAME], "127.0.0.1", 0)) as topics:
        publisher = node.create_publisher(DiagnosticStatus, f"{NAME}/status", 1)
        first, back, second, back_too, third = asyncio.run(_offers(topics.port, publisher.topic_name))
    assert (first, second) == (back, back_too)
    assert len({first, second, third}) == 3


def test_without_the_package_it_says_what_to_install(monkeypatch, capsys):
    for name in [name for name in sys.modules if name.partition(".")[0] == "foxglove"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "sma_actuator.view.foxglove")
    monkeypatch.setitem(sys.modules, "foxglove", None)
    assert main(["view", "--foxglove", "--port", "0"]) == 1
    assert "needs the Python package 'foxglove-sdk' (extra 'foxglove')" in capsys.readouterr().err


def test_what_cannot_be_meant_is_refused(capsys, tmp_path):
    assert main(["view", "--foxglove", "--host", "0.0.0.0"]) == 1
    assert "every address" in capsys.readouterr().err
    assert main(["view", "--foxglove", "--config", str(tmp_path / "x.yaml")]) == 1
    assert "only looks" in capsys.readouterr().err
    with contextlib.closing(Topics([NAME], "127.0.0.1", 0)) as topics:
        assert main(["view", "--foxglove", "--port", str(topics.port)]) == 1
    assert "cannot be opened" in capsys.readouterr().err
