"""From the loop to ROS: everything arrives, in order, in a thread of its own."""

import threading

import pytest
from processes import wait_until

from sma_actuator.ros.publishing import OUTPUTS_WAITING, Handoff


@pytest.fixture
def handoff():
    """A hand-over of numbers in place of outputs; it publishes once ``go`` is set."""
    published, errors, go = [], [], threading.Event()

    def publish(latest, waiting):
        go.wait()
        published.append((latest, list(waiting)))
        if latest == "bad":
            raise ZeroDivisionError("provoked")

    made = Handoff("wire", publish, errors.append)
    made.published, made.errors, made.go = published, errors, go
    yield made
    go.set()
    made.close()


def test_every_output_is_handed_over_once_in_order_and_the_last_is_the_latest(handoff):
    handoff.go.set()
    for number in range(100):
        handoff.put(number, True)
    wait_until(lambda: handoff.published and handoff.published[-1][0] == 99)
    assert [each for _, waiting in handoff.published for each in waiting] == list(range(100))
    assert all(latest == waiting[-1] for latest, waiting in handoff.published)


def test_what_raises_is_told_and_the_next_is_as_good_as_any(handoff):
    handoff.go.set()
    handoff.put("bad", True)
    wait_until(lambda: handoff.errors)
    handoff.put("good", True)
    wait_until(lambda: handoff.published[-1][0] == "good")
    assert [str(error) for error in handoff.errors] == ["provoked"]


def test_reporting_that_raises_does_not_end_the_thread(handoff):
    handoff.go.set()
    raised = []

    def mute(error):
        raised.append(error)
        raise OSError("nobody hears")

    handoff._on_error = mute
    handoff.put("bad", True)
    wait_until(lambda: raised)
    handoff.put("good", True)
    wait_until(lambda: handoff.published[-1][0] == "good")


def test_a_thread_that_hangs_is_seen_and_costs_the_loop_neither_time_nor_memory(handoff):
    assert handoff.moves()
    handoff.put("stuck", True)
    wait_until(lambda: not handoff.moves())
    for number in range(3 * OUTPUTS_WAITING):
        handoff.put(number, True)
    assert not handoff.moves()
    assert handoff.latest == 3 * OUTPUTS_WAITING - 1
    assert handoff._fresh.qsize() <= 1, (
        "a sign for each would wait for ever where outputs come faster than they are published"
    )
    handoff.go.set()
    wait_until(lambda: len(handoff.published) >= 2)
    assert len(handoff.published[1][1]) <= OUTPUTS_WAITING
    wait_until(handoff.moves)


def test_what_need_not_be_published_is_the_latest_all_the_same(handoff):
    handoff.go.set()
    handoff.put("quiet", False)
    assert handoff.latest == "quiet"
    handoff.put("loud", True)
    wait_until(lambda: handoff.published)
    assert handoff.published == [("loud", ["loud"])]


def test_after_the_end_nothing_is_published(handoff):
    handoff.go.set()
    handoff.close()
    handoff.put("late", True)
    handoff.close()
    assert handoff.published == []
