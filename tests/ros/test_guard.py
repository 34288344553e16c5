"""What raises in a callback is refused with a sentence; the node, the executor and the next message go on."""

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
import rclpy
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.executors import ExternalShutdownException
from std_srvs.srv import SetBool, Trigger

from sma_actuator.ros import guard

SENTENCE = "~/do: the request was refused: ValueError: what a request"


def breaks(*_):
    raise ValueError("what a request")


def guarded(callback, said):
    """Service and subscription with a callback, made safe."""
    service = SimpleNamespace(callback=callback, srv_name="~/do", srv_type=None)
    subscription = SimpleNamespace(callback=callback, topic_name="~/hear")
    guard.refuse_what_raises(SimpleNamespace(services=[service], subscriptions=[subscription]), said.append)
    return service.callback, subscription.callback


@pytest.mark.parametrize("kind", [SetBool, Trigger])
def test_a_request_that_raises_is_answered_no_with_the_reason(kind):
    said = []
    response = guarded(breaks, said)[0](kind.Request(), kind.Response(success=True))
    assert (response.success, response.message) == (False, SENTENCE)
    assert said == [SENTENCE]


def test_parameters_that_raise_are_refused_each():
    answer = guarded(breaks, [])[0]
    response = answer(SetParameters.Request(parameters=[Parameter(), Parameter()]), SetParameters.Response())
    assert [(result.successful, result.reason) for result in response.results] == [(False, SENTENCE)] * 2
    response = answer(SetParametersAtomically.Request(), SetParametersAtomically.Response())
    assert (response.result.successful, response.result.reason) == (False, SENTENCE)
    assert not answer(ChangeState.Request(), ChangeState.Response(success=True)).success


def test_a_request_that_was_refused_unread_is_answered_with_the_reason_alone():
    answer = guarded(lambda *_: pytest.fail("it was read"), [])[0]
    response = answer(guard.Refused("too much"), SetParameters.Response())
    assert [(r.successful, r.reason) for r in response.results] == [(False, "~/do: the request was refused: too much")]


def test_only_services_of_parameters_are_asked_how_much_they_hold():
    """The others hold a few words each."""
    services = [SimpleNamespace(callback=breaks, srv_name="~/do", srv_type=kind) for kind in (SetParameters, SetBool)]
    guard.refuse_what_raises(SimpleNamespace(services=services, subscriptions=[]), print)
    assert [service.srv_type in (SetParameters, SetBool) for service in services] == [False, True]
    assert services[0].srv_type.Response is SetParameters.Response


def test_what_does_not_raise_is_passed_on_as_it_is():
    said, heard = [], []
    answer, _ = guarded(lambda request, response: (request, response), said)
    request, response = SetBool.Request(), SetBool.Response()
    assert answer(request, response) == (request, response)
    guarded(heard.append, said)[1]("a message")
    assert heard == ["a message"] and said == []


def test_a_message_that_raises_is_told_and_the_next_is_heard():
    said, heard = [], []

    def hear(message):
        heard.append(message)
        if message == "bad":
            raise KeyError("bad")

    receive = guarded(hear, said)[1]
    for message in ("bad", "good"):
        receive(message)
    assert heard == ["bad", "good"]
    assert said == ["~/hear: a message was refused: KeyError: 'bad'"]


class Executor:
    """Turns that end as they are told to; after the last of them the context is shut down."""

    def __init__(self, ends, node):
        self.ends, self.node, self.waits_s, self.nodes = list(ends), node, [], []

    def add_node(self, node):
        self.nodes.append(node)

    def spin_once(self, wait_s):
        self.waits_s.append(wait_s)
        end = self.ends.pop(0)
        self.node.shut_down = not self.ends
        if end is not None:
            raise end


def spun(monkeypatch, *ends, **more):
    """What was told of turns that end like this, how many turns were looked after, and how long was paused."""
    told, turns, paused_s = [], [], []
    node = SimpleNamespace(shut_down=False)
    node.context = SimpleNamespace(ok=lambda: not node.shut_down)
    executor = Executor(ends, node)
    monkeypatch.setattr(guard, "_Executor", lambda context: executor if context is node.context else None)
    monkeypatch.setattr(guard.time, "sleep", paused_s.append)
    guard.spinning(node, "turns", told.append, lambda: turns.append(1), **more).join(10.0)
    assert executor.nodes == [node]
    return told, len(turns), paused_s, executor


def test_the_executor_goes_on_after_what_raises_until_the_context_is_shut_down(monkeypatch):
    error = ValueError("bad")
    told, turns, paused_s, executor = spun(monkeypatch, None, error, None, None, longest_wait_s=0.3)
    assert told == [error]
    assert turns == 3
    assert paused_s == [guard.PAUSE_s] and 0.0 < guard.PAUSE_s < 0.1
    assert executor.waits_s == [0.3] * 4


def test_what_a_shutdown_raises_is_no_error(monkeypatch):
    told, _, paused_s, executor = spun(monkeypatch, None, ExternalShutdownException(), None)
    assert told == paused_s == [] and len(executor.ends) == 1
    assert spun(monkeypatch, ValueError("of a context that is gone"))[0] == []


def test_a_context_that_is_gone_before_the_first_turn_is_no_error(monkeypatch):
    """On a busy machine a thread may run for the first time when its node has been closed already."""
    context, told = rclpy.Context(), []
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("closed_at_once", context=context)
    started, run = threading.Event(), threading.Thread.run

    def run_late(thread):
        assert started.wait(10.0)
        run(thread)

    monkeypatch.setattr(threading.Thread, "run", run_late)
    thread = guard.spinning(node, "late", told.append)
    rclpy.shutdown(context=context)
    started.set()
    thread.join(10.0)
    assert not thread.is_alive() and told == []


class Unreadable:
    """Of a service: the type whose requests cannot be taken."""

    @property
    def Request(self):
        raise OSError("no room for it")


def test_what_cannot_be_taken_leaves_all_else_heard(client):
    """rclpy held the callback group, which is one for all that a node has: it answered nobody any more."""

    def answer(_, response):
        response.success = True
        return response

    context, told = rclpy.Context(), []
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("taker", context=context)
    broken, _ = (node.create_service(Trigger, f"~/{name}", answer) for name in ("broken", "whole"))
    kind, broken.srv_type = broken.srv_type, Unreadable()
    thread = guard.spinning(node, "taker", told.append)
    try:
        asking = client.node.create_client(Trigger, "/taker/broken")
        client.spin_until(asking.service_is_ready)
        asking.call_async(Trigger.Request())
        client.spin_until(lambda: told, what="the error")
        assert isinstance(told[0], OSError)
        assert client.call("/taker/whole", Trigger).success
        broken.srv_type = kind
        assert client.call("/taker/broken", Trigger).success
    finally:
        rclpy.shutdown(context=context)
        thread.join()
