"""What pages ask is done in the order in which it was asked for, however long ROS was held up."""

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed (extra 'ros')")
import rclpy
from rclpy.executors import SingleThreadedExecutor

from sma_actuator.view.in_order import InOrder


@pytest.fixture
def executor():
    context = rclpy.Context()
    rclpy.init(context=context)
    yield SingleThreadedExecutor(context=context)
    rclpy.try_shutdown(context=context)


def test_what_waits_is_done_in_order(executor):
    done = []
    work = InOrder(executor)
    for number in range(5):
        work.put(lambda n=number: done.append(n))
    for _ in range(20):
        executor.spin_once(timeout_sec=0.01)
    assert done == list(range(5))
