"""How long one thread of a node's process may keep the others waiting for the interpreter."""

import pytest

pytest.importorskip("rclpy")

from sma_actuator.ros.node import gil_interval_s


@pytest.mark.parametrize(
    ("rates_Hz", "interval_s"),
    [
        ([20.0] * 16, 1e-3),  # a fiftieth of their period
        ([20.0, 100.0], 0.2e-3),  # of the shortest
        ([1000.0], 0.1e-3),  # more often would be for switching alone
        ([1.0], 1e-3),  # what is not the loop's (switching off, the watchman) does not wait for a slow one
    ],
)
def test_a_thread_holds_the_loops_up_by_a_fiftieth_of_their_period_at_the_most(rates_Hz, interval_s):
    assert gil_interval_s(iter(rates_Hz)) == pytest.approx(interval_s)
