"""Wires of one process are switched beside each other: one whose instrument holds it up delays no other."""

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("rclpy")
from processes import wait_until
from std_srvs.srv import SetBool, Trigger

from sma_actuator.base.local_stop import ask_here
from sma_actuator.driver import OFF_MEANWHILE
from sma_actuator.ros.switch import QUIET_s, Switch, Way

MANY = 16


class Wire:
    """What the switch sees of a node; one that ``hangs`` answers only when it is released."""

    def __init__(self, number, parts=()):
        self.name = f"wire_{number}"
        self.parts = parts
        self.on = False
        self.said = []
        self.hangs = False
        self.waiting, self.released = threading.Event(), threading.Event()

    def get_name(self):
        return self.name

    def get_namespace(self):
        return "/"

    def get_fully_qualified_name(self):
        return f"/{self.name}"

    def resolve_service_name(self, service):
        return service.replace("~", f"/{self.name}")

    def _hang(self):
        if self.hangs:
            self.waiting.set()
            assert self.released.wait(120.0)

    def switch_on(self, wanted):
        self._hang()
        self.on = wanted()
        return self.on, "the output is on" if self.on else "not enabled: it was switched off meanwhile"

    def switch_off(self):
        self.hangs = False  # as off ends an on that waits
        self.on = False
        return True, "the output is off"

    def report(self, sentence):
        self.said.append(sentence)


@pytest.fixture
def wires():
    wires = [Wire(number) for number in range(MANY)]
    switch = Switch(wires, [])
    yield wires
    for wire in wires:
        wire.released.set()
    switch.close()


@pytest.fixture
def later(client):
    """Asks for on, and does not wait for the answer."""

    def ask(name):
        # what is asked before both sides know each other is lost
        client.call(name, SetBool, SetBool.Request(data=False))
        return client.services[name].call_async(SetBool.Request(data=True))

    return ask


def test_a_wire_that_is_held_up_delays_the_switching_of_no_other(wires, client, later):
    slow, *others = wires
    waits = later("/wire_0/enable")
    slow.hangs = True
    client.spin_until(slow.waiting.is_set, what="the wire that hangs")
    for wire in others:
        assert client.call(f"/{wire.name}/enable", SetBool, SetBool.Request(data=True)).success
        assert wire.on
    assert not waits.done()


def test_a_stop_switches_all_at_the_same_time_and_no_enabling_outlives_it(wires, client, later):
    slow, *others = wires
    enabled = later("/wire_0/enable")
    slow.hangs = True
    for wire in others:
        wire.on = True
    client.spin_until(slow.waiting.is_set, what="the wire that hangs")
    stopped = client.call("/wire_5/stop", Trigger)
    assert stopped.success and stopped.message.count("the output is off") == MANY
    assert not any(wire.on for wire in wires)
    slow.released.set()
    client.spin_until(enabled.done, what="the answer to the enabling")
    assert not slow.on
    assert not enabled.result().success and "it was switched off meanwhile" in enabled.result().message


def test_a_stop_from_the_same_computer_switches_all_too(wires):
    for wire in wires:
        wire.on = True
    [(off, words)] = ask_here("/wire_5/stop", os.environ["ROS_DOMAIN_ID"], 60.0)
    assert off and words.count("the output is off") == MANY
    assert not any(wire.on for wire in wires)


@pytest.fixture
def way(wires):
    """The way of the first wire, whose on hangs, and what it has replied to."""
    wire = wires[0]
    pool = ThreadPoolExecutor(2)
    yield Way(wire, pool), wire, []
    wire.released.set()
    pool.shutdown()


def replying(said, what):
    return lambda done, words: said.append((what, done, words))


def test_an_on_that_was_asked_for_before_an_off_is_dropped(way):
    way, wire, said = way
    wire.hangs = True
    way.on(replying(said, "first"))
    assert wire.waiting.wait(60.0)
    way.on(replying(said, "second"))  # waits for the first
    way.off(replying(said, "off"))
    assert ("second", False, OFF_MEANWHILE) in said  # by the thread that asks for off
    wait_until(lambda: "off" in [what for what, *_ in said])
    wire.released.set()
    wait_until(lambda: len(said) == 3)
    assert said[-1] == ("first", False, OFF_MEANWHILE) and not wire.on


def test_after_an_off_one_on_waits_for_half_a_second_of_silence_and_one_after_another_is_refused(way):
    way, wire, said = way
    way.off(replying(said, "off"))
    off_s = time.monotonic()
    for number in range(5):
        way.on(replying(said, number))
    wait_until(lambda: (4, True, "the output is on") in said)
    assert time.monotonic() - off_s >= QUIET_s
    assert [(what, done) for what, done, _ in said if what not in ("off", 4)] == [(n, False) for n in range(4)]
    assert any("leave 0.5 s between two requests" in sentence for sentence in wire.said)
    said.clear()
    way.on(replying(said, "again"))  # nobody has switched it off since
    wait_until(lambda: said == [("again", True, "the output is on")])


def test_off_of_a_wire_drops_what_was_asked_of_its_joint():
    wire = Wire(0)
    joint = Wire(1, parts=(wire,))
    with ThreadPoolExecutor(4) as pool:
        way, of_joint = Way(wire, pool), Way(joint, pool)
        way.joints, said = [of_joint], []
        joint.hangs = True
        of_joint.on(replying(said, "joint"))
        assert joint.waiting.wait(60.0)
        way.off(replying(said, "off"))
        joint.released.set()
        wait_until(lambda: len(said) == 2)
    assert ("joint", False, OFF_MEANWHILE) in said and not joint.on


def test_the_context_is_gone_after_the_end():
    switch = Switch([Wire(0)], [])
    switch.close()
    assert not any(thread.is_alive() for thread in switch._threads)


def test_an_off_has_begun_before_what_it_drops_is_answered():
    order = []

    class Pool:
        def submit(self, work):
            order.append(work.__name__)

    way = Way(Wire(0), Pool())
    way.on(lambda done, words: order.append(words))
    way.off(lambda done, words: None)
    assert order == ["_do_ons", "_do_offs", OFF_MEANWHILE]
