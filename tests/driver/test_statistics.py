"""How well a loop keeps its period: deadlines and the slowest answer, by their definitions."""

import dataclasses
import math

import numpy as np
import pytest

from sma_actuator.driver.statistics import Deadlines, LoopStatistics, Slowest

PERIOD_s = 0.125  #: a power of two: its multiples are what they are to the last bit


class Loop:
    """A loop that begins each step so late and is busy so long as it is told."""

    def __init__(self, begins_s=1000.0):
        self.deadlines, self.now_s = Deadlines(PERIOD_s), begins_s

    def step(self, busy_s=0.0, late_s=0.0):
        """One step; its deadline."""
        deadline_s = self.deadlines.next_s(lambda: self.now_s)
        self.now_s = max(self.now_s, deadline_s) + late_s
        self.deadlines.begun(self.now_s)
        self.now_s += busy_s
        self.deadlines.done(deadline_s, self.now_s)
        return deadline_s

    def said(self):
        return self.deadlines.statistics(0, 0.0)


def test_the_first_deadline_is_now_and_the_others_follow_a_period_apart():
    loop = Loop()
    assert [loop.step() for _ in range(4)] == [1000.0 + number * PERIOD_s for number in range(4)]
    assert (loop.deadlines.steps, loop.deadlines.overruns) == (4, 0)


def test_loops_that_begin_at_different_times_step_together():
    begun = [Loop(1000.0 + part * PERIOD_s) for part in (0.1, 0.3, 0.45)]
    assert [loop.step() for loop in begun] == [1000.0 + part * PERIOD_s for part in (0.1, 0.3, 0.45)], "none waits"
    for number in range(1, 4):
        assert {loop.step() for loop in begun} == {1000.0 + number * PERIOD_s}


def test_before_a_step_nothing_is_known_and_after_one_no_period():
    loop = Loop()
    assert math.isnan(loop.deadlines.last_step_s)
    for _ in range(2):
        said = loop.deadlines.statistics(3, 0.25)
        numbers = [getattr(said, f.name) for f in dataclasses.fields(LoopStatistics) if f.name.endswith("_s")]
        assert (said.overruns, said.late_answers, numbers[0]) == (0, 3, 0.25)
        assert all(math.isnan(number) for number in numbers[1:])
        began_s = loop.step()
        assert loop.deadlines.last_step_s == began_s


@pytest.mark.parametrize(
    ("busy", "missed"), [(0.0, 0), (0.99, 0), (1.0, 1), (1.0 - 1e-10, 1), (1.5, 1), (2.0, 2), (7.4, 7)]
)
def test_deadlines_that_pass_while_a_step_is_busy_are_counted_and_skipped(busy, missed):
    """One that comes in the very moment, to within the noise of sums, has passed."""
    loop = Loop()
    loop.step()
    loop.step(busy_s=busy * PERIOD_s)
    assert loop.deadlines.overruns == missed
    assert loop.step() == 1000.0 + (2 + missed) * PERIOD_s
    loop.step(busy_s=1.5 * PERIOD_s)
    assert loop.deadlines.overruns == missed + 1, "and they add up"


@pytest.mark.parametrize(("busy", "left"), [(1.4, 0.6), (1.6, 1.4), (1.99, 1.01), (7.9, 1.1), (0.9, 0.1)])
def test_after_a_step_that_took_too_long_its_current_stands_before_it_is_measured(busy, left):
    """The bias that a late answer brings; a step that was in time has no such pause: its changes are small."""
    loop = Loop()
    loop.step()
    loop.step(busy_s=busy * PERIOD_s)
    assert loop.deadlines.next_s(lambda: 0.0) - loop.now_s == pytest.approx(left * PERIOD_s)
    assert loop.deadlines.overruns == math.floor(busy)


def test_a_clock_that_went_back_takes_no_overrun_away():
    loop = Loop()
    loop.step()
    loop.deadlines.done(1000.0, 990.0)
    assert loop.deadlines.overruns == 0 and loop.deadlines.next_s(lambda: 0.0) == 1000.0 + 2 * PERIOD_s


def test_periods_are_from_begin_to_begin_and_busy_is_from_the_deadline():
    loop, late_s, busy_s = Loop(), [0.0, 0.02, 0.0, 0.06, 0.01], [0.01, 0.03, 0.02, 0.005, 0.04]
    for late, busy in zip(late_s, busy_s, strict=True):
        loop.step(busy, late)
    begun_s = np.arange(5) * PERIOD_s + late_s
    said = loop.said()
    assert (said.steps, said.overruns) == (5, 0)
    assert said.period_mean_s == pytest.approx(np.diff(begun_s).mean())
    assert said.period_max_s == pytest.approx(np.diff(begun_s).max())
    assert said.period_p99_s == pytest.approx(np.quantile(np.diff(begun_s), 0.99))
    assert said.busy_mean_s == pytest.approx(np.mean(np.add(late_s, busy_s)))
    assert said.busy_max_s == pytest.approx(0.065)


def test_what_was_2048_steps_ago_is_forgotten_and_no_sooner():
    loop = Loop()
    loop.step()
    loop.step(busy_s=0.1, late_s=0.02)
    for _ in range(2046):
        loop.step()
    said = loop.said()
    assert (said.steps, said.busy_max_s) == (2048, pytest.approx(0.12))
    loop.step()
    assert loop.said().busy_max_s == pytest.approx(0.12)
    loop.step()
    said = loop.said()
    assert (said.steps, said.busy_max_s) == (2050, 0.0)
    assert said.period_max_s == pytest.approx(PERIOD_s)


def test_the_slowest_answer_is_that_of_the_last_minute():
    slowest = Slowest()
    assert slowest.longest_s(0.0) == 0.0
    for now_s, took_s in ((100.2, 0.1), (100.5, 0.4), (100.9, 0.2), (101.0, 0.3)):
        slowest.note(now_s, took_s)
    assert slowest.longest_s(101.0) == slowest.longest_s(159.9) == 0.4
    assert slowest.longest_s(160.0) == 0.3, "seconds are forgotten whole"
    assert slowest.longest_s(161.0) == 0.0


def test_of_every_second_one_is_kept_and_of_more_than_a_minute_none():
    slowest = Slowest()
    for tenth in range(10 * 300):
        slowest.note(100.0 + 0.1 * tenth, 1.0 / (1 + tenth))
        assert len(slowest._by_second) <= 60
    assert len(slowest._by_second) == 60
    assert slowest.longest_s(399.9) == pytest.approx(1.0 / (1 + 2400))


def test_a_late_second_begins_anew_where_one_was_slower():
    slowest = Slowest()
    slowest.note(10.0, 0.5)
    for now_s, took_s in ((11.0, 0.1), (11.5, 0.3), (11.9, 0.2)):
        slowest.note(now_s, took_s)
    assert slowest.longest_s(11.0) == 0.5 and list(slowest._by_second) == [(10, 0.5), (11, 0.3)]
