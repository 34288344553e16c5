"""An executor that makes its wait set once, and runs whatever rclpy's would run."""

import threading
import time

import pytest

pytest.importorskip("rclpy")
import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from sma_actuator.ros.quiet import QuietExecutor

SOON_s = 10.0


@pytest.fixture
def node():
    context = Context()
    rclpy.init(context=context)
    yield rclpy.create_node("quiet", context=context)
    rclpy.try_shutdown(context=context)


@pytest.fixture
def executor(node):
    out = QuietExecutor(context=node.context)
    out.add_node(node)
    return out


def spin_until(executor, condition):
    until_s = time.monotonic() + SOON_s
    while not condition():
        assert time.monotonic() < until_s
        executor.spin_once(0.1)


def test_the_wait_set_is_kept_while_nothing_happens_and_made_anew_for_what_comes_and_goes(node, executor):
    executor.spin_once(0.0)
    first = executor._wait_set
    executor.spin_once(0.0)
    assert executor._wait_set is first
    timer = node.create_timer(3600.0, lambda: None)
    executor.spin_once(0.0)
    second = executor._wait_set
    assert second is not first
    node.destroy_timer(timer)
    executor.spin_once(0.0)
    assert executor._wait_set is not second


def test_a_wait_ends_after_its_time_and_not_before(executor):
    executor.spin_once(0.0)
    began_s = time.monotonic()
    executor.spin_once(0.2)
    assert 0.19 < time.monotonic() - began_s < SOON_s


def test_it_runs_timers_messages_services_and_guards_that_come_while_it_waits(node, executor):
    executor.spin_once(0.0)
    heard, ticks, asked, woken = [], [], [], []
    node.create_subscription(Float64, "said", lambda message: heard.append(message.data), 10)
    publisher = node.create_publisher(Float64, "said", 10)
    node.create_timer(0.05, lambda: ticks.append(1))
    spin_until(executor, lambda: len(ticks) > 2 and publisher.get_subscription_count())
    for number in (1.0, 2.0, 3.0):
        publisher.publish(Float64(data=number))
    spin_until(executor, lambda: heard == [1.0, 2.0, 3.0])

    def answer(_, response):
        asked.append(1)
        return response

    node.create_service(Trigger, "ask", answer)
    client = node.create_client(Trigger, "ask")
    spin_until(executor, client.service_is_ready)
    future = client.call_async(Trigger.Request())
    spin_until(executor, future.done)
    assert asked == [1]
    guard = node.create_guard_condition(lambda: woken.append(1))
    executor.spin_once(0.0)
    threading.Timer(0.1, guard.trigger).start()
    spin_until(executor, lambda: woken == [1])


def test_what_a_callback_raises_comes_out_and_the_next_is_run(node, executor):
    calls = []

    def fail():
        calls.append(1)
        if len(calls) == 1:
            raise KeyError("bad")

    guard = node.create_guard_condition(fail)
    guard.trigger()
    with pytest.raises(KeyError):
        executor.spin_once(1.0)
    guard.trigger()
    spin_until(executor, lambda: len(calls) == 2)


def test_the_end_of_ros_ends_a_wait_without_an_end(node, executor):
    executor.spin_once(0.0)
    threading.Timer(0.2, lambda: rclpy.try_shutdown(context=node.context)).start()
    with pytest.raises(ExternalShutdownException):
        while True:
            executor.spin_once(None)
    assert executor._wait_set is None
