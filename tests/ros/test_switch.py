"""Wires of one process are switched beside each other: one whose instrument holds it up delays no other."""

import threading

import pytest

pytest.importorskip("rclpy")
from std_srvs.srv import SetBool, Trigger

from sma_actuator.ros.switch import Switch

MANY = 16


class Wire:
    """What the switch sees of a node; one that ``hangs`` answers only when it is released."""

    def __init__(self, number):
        self.name = f"wire_{number}"
        self.on = False
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

    def on_enable(self, request, response):
        self._hang()
        self.on = request.data
        response.success = True
        return response

    def switch_off(self):
        self._hang()
        self.on = False
        return True, "the output is off"

    def report(self, sentence):
        raise AssertionError(sentence)


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
    """Asks, and does not wait for the answer."""

    def ask(name, kind, request):
        service = client.node.create_client(kind, name)
        client.spin_until(service.service_is_ready, what=name)
        return service.call_async(request)

    return ask


def test_a_wire_that_is_held_up_delays_the_switching_of_no_other(wires, client, later):
    slow, *others = wires
    slow.hangs = True
    waits = later("/wire_0/enable", SetBool, SetBool.Request(data=True))
    client.spin_until(slow.waiting.is_set, what="the wire that hangs")
    for wire in others:
        assert client.call(f"/{wire.name}/enable", SetBool, SetBool.Request(data=True)).success
        assert wire.on
    assert not waits.done()


def test_a_stop_switches_all_at_the_same_time_and_no_enabling_outlives_it(wires, client, later):
    slow, *others = wires
    for wire in others:
        wire.on = True
    slow.hangs = True
    enabled = later("/wire_0/enable", SetBool, SetBool.Request(data=True))
    client.spin_until(slow.waiting.is_set, what="the wire that hangs")
    stopped = later("/wire_5/stop", Trigger, Trigger.Request())
    client.spin_until(lambda: not any(wire.on for wire in others), what="off of the others")
    assert not stopped.done()  # of one it is not known yet
    slow.released.set()
    client.spin_until(lambda: stopped.done() and enabled.done(), what="both answers")
    assert stopped.result().success and stopped.result().message.count("the output is off") == MANY
    assert not slow.on
    assert not enabled.result().success and "~/stop has come" in enabled.result().message


def test_the_context_is_gone_after_the_end():
    switch = Switch([Wire(0)], [])
    switch.close()
    assert not any(thread.is_alive() for thread in switch._threads)
