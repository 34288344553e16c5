"""From the loop to ROS: everything arrives, in order, in a thread of its own."""

import itertools
import threading
import time
from math import inf

import pytest
import rclpy
from processes import wait_until
from std_msgs.msg import Float64

from sma_actuator.ros import publishing
from sma_actuator.ros.publishing import OUTPUTS_WAITING, Handoff, _Thread, is_heard, waits_s


@pytest.fixture
def handoff():
    """A hand-over of numbers in place of outputs; it publishes once ``go`` is set."""
    published, errors, go = [], [], threading.Event()

    def publish(latest, waiting):
        go.wait()
        published.append((latest, list(waiting)))
        if latest == "bad":
            raise ZeroDivisionError("provoked")

    made = Handoff(publish, errors.append)
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
    wait_until(handoff._publishing.locked)
    wait_until(lambda: not handoff.moves())
    for number in range(3 * OUTPUTS_WAITING):
        handoff.put(number, True)
    assert not handoff.moves()
    assert handoff.latest == 3 * OUTPUTS_WAITING - 1
    assert handoff._thread._signs.qsize() <= 1, (
        "a sign for each would wait for ever where outputs come faster than they are published"
    )
    handoff.go.set()
    wait_until(lambda: len(handoff.published) >= 2)
    assert len(handoff.published[1][1]) <= OUTPUTS_WAITING
    wait_until(handoff.moves)


def test_a_thread_that_hangs_is_seen_by_all_that_wait_for_it(handoff):
    """It publishes for all wires of a process; one that says nothing goes on."""
    published = []
    other, silent = (Handoff(lambda latest, _: published.append(latest), print) for _ in range(2))
    handoff.put("stuck", True)
    wait_until(handoff._publishing.locked)
    wait_until(lambda: not handoff.moves())
    other.put("waits", True)
    silent.put("unheard", False)
    other.moves()
    assert (other.moves(), silent.moves(), published) == (False, True, [])
    handoff.go.set()
    wait_until(lambda: published == ["waits"] and other.moves())


def test_one_that_fails_keeps_nothing_from_the_others(handoff):
    handoff.go.set()
    published = []
    other = Handoff(lambda latest, _: published.append(latest), print)
    for number in range(5):
        handoff.put("bad", True)
        other.put(number, True)
        wait_until(lambda number=number: published and published[-1] == number)
    wait_until(lambda: handoff.errors)


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
    after = []
    other = Handoff(lambda latest, _: after.append(latest), print)
    other.put("of another, whose turn comes later", True)
    wait_until(lambda: after)
    assert handoff.published == []


def test_before_the_first_output_there_is_none(handoff):
    assert handoff.latest is None


def test_the_end_waits_for_what_is_being_published(handoff):
    handoff.put("under way", True)
    wait_until(handoff._publishing.locked)
    threading.Timer(0.1, handoff.go.set).start()
    handoff.close()
    assert handoff.published == [("under way", ["under way"])]


def test_no_process_waits_for_the_thread():
    before = set(threading.enumerate())
    _Thread()
    (thread,) = (each for each in set(threading.enumerate()) - before if each.name == "hand-off")
    assert thread.daemon, "one that hangs must not keep a process that ends"


def test_a_sign_of_what_was_taken_with_the_one_before_ends_nothing(handoff):
    handoff.go.set()
    handoff._thread.look_at(handoff)
    handoff.put("next", True)
    wait_until(lambda: handoff.published)
    handoff._thread.look_at(handoff)
    handoff.put("and the next", True)
    wait_until(lambda: len(handoff.published) == 2)
    assert handoff.errors == []


def test_one_that_waits_for_an_output_moves_however_often_it_is_asked(handoff):
    handoff.go.set()
    handoff.put("only", True)
    wait_until(lambda: handoff.published)
    wait_until(lambda: handoff.moves() and handoff.moves() and handoff.moves())


def test_one_that_is_slow_moves_once_for_each_time_that_it_has_published():
    began, may_end = threading.Semaphore(0), threading.Semaphore(0)

    def publish(_, __):
        began.release()
        may_end.acquire()

    slow = Handoff(publish, lambda error: None)
    slow.put(1, True)
    assert began.acquire(timeout=30.0)
    slow.moves()
    assert not slow.moves()
    slow.put(2, True)
    may_end.release()
    assert began.acquire(timeout=30.0)
    assert [slow.moves(), slow.moves()] == [True, False]
    may_end.release()
    slow.close()


def test_at_a_thousand_outputs_a_second_it_does_not_take_the_loops_time():
    at_s = []
    fast = Handoff(lambda _, __: at_s.append(time.monotonic()), lambda error: None)
    until_s = time.monotonic() + 30.0
    while len(at_s) < 30 and time.monotonic() < until_s:
        fast.put(len(at_s), True)
        time.sleep(5e-4)
    fast.close()
    gaps_s = sorted(after - before for before, after in itertools.pairwise(at_s))
    assert gaps_s[len(gaps_s) // 4] > 2.5e-3, "a busy machine makes some longer, the next shorter"


def test_those_that_step_together_are_waited_for_and_one_alone_is_not():
    at_20_Hz, at_100_Hz = 0.05, 0.01
    assert waits_s(at_20_Hz, 1) < 0.0 and waits_s(0.002, 1) == pytest.approx(0.003)
    assert waits_s(at_20_Hz, 16) == pytest.approx(0.01) and waits_s(at_100_Hz, 2) == pytest.approx(0.002)
    assert waits_s(0.002, 2) == pytest.approx(0.003), "never more often than every 5 ms"
    assert waits_s(60.0, 2) == waits_s(inf, 2) == pytest.approx(0.01)


def test_a_turn_knows_how_many_were_published_in_the_one_before(handoff, monkeypatch):
    numbers = []
    monkeypatch.setattr(publishing, "waits_s", lambda since_s, number: numbers.append(number) or 0.0)
    others = [Handoff(lambda latest, waiting: None, print) for _ in range(2)]
    handoff.put("first", True)
    wait_until(handoff._publishing.locked)
    for other in others:
        other.put("beside it", True)
    handoff.go.set()
    wait_until(lambda: all(other.moves() for other in others))
    handoff.put("next", True)
    wait_until(lambda: handoff.published[-1][0] == "next")
    assert numbers[-1] == 3


def test_a_topic_is_heard_from_the_first_subscriber_on_and_not_before():
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        node = rclpy.create_node("hearing", context=context)
        publisher = node.create_publisher(Float64, "heard", 1)
        assert not is_heard(publisher)
        node.create_subscription(Float64, "heard", lambda _: None, 1)
        wait_until(lambda: is_heard(publisher))
    finally:
        rclpy.shutdown(context=context)
