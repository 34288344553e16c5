"""Supply and DAQ measure one current: a drift between them is found, errors that stand still, lags and steps are
none."""

import math

import numpy as np
import pytest

from sma_actuator.base.jit import COMPILED
from sma_actuator.safety import drift
from sma_actuator.safety.drift import (
    FLOOR_A,
    FLOOR_V,
    SCALE,
    CurrentsApart,
    LAG_s,
    METER_LAG_s,
    VoltagesApart,
    WINDOW_s,
)
from sma_actuator.safety.records import made_ready

PERIOD_s, SHARE, SHARE_V = 0.05, 0.005, 0.015  #: of current and voltage that may be a drift


def apart(set_A, measured_A, seconds, apart_=None, begun_s=0.0):
    """Time at which the currents are found apart, or None; both are functions of the time."""
    apart_ = apart_ if apart_ is not None else CurrentsApart()
    for step in range(round(seconds / PERIOD_s)):
        time_s = begun_s + step * PERIOD_s
        told_A = set_A(time_s)
        change_A, allowed_A = apart_.step(time_s, measured_A(time_s), told_A, told_A, SHARE)
        if abs(change_A) > allowed_A:
            return time_s
    return None


def wander_A(time_s):
    """As a wire that is moved: up and down between 50 mA and 0.4 A, now quickly, now slowly."""
    return 0.225 + 0.175 * math.sin(0.4 * time_s + 2.0 * math.sin(0.05 * time_s)) * math.cos(0.07 * time_s)


@pytest.mark.parametrize("scale", [1.0 - SCALE, 1.0, 1.0 + SCALE])
@pytest.mark.parametrize("zero_A", [-5e-3, 0.0, 5e-3])
@pytest.mark.parametrize("lag_s", [0.0, LAG_s])
def test_errors_that_stand_still_and_lags_are_no_drift(scale, zero_A, lag_s):
    assert apart(wander_A, lambda t: scale * wander_A(t - lag_s) + zero_A, 120.0) is None


@pytest.mark.parametrize("step_A", [1e-4, FLOOR_A])
def test_nor_are_the_steps_of_a_supply_that_sets_coarsely(step_A):
    assert apart(wander_A, lambda t: step_A * round(wander_A(t) / step_A), 120.0) is None


@pytest.mark.parametrize("rate", [4e-3, -4e-3, 4e-4, -4e-4])
@pytest.mark.parametrize("moved", [False, True])
def test_a_drift_is_found(rate, moved):
    def set_A(time_s):
        return wander_A(time_s) if moved else 0.2

    found_s = apart(set_A, lambda t: set_A(t) * (1.0 + rate * max(0.0, t - 30.0)), 200.0)
    drifted = abs(rate) * (found_s - 30.0)
    assert SHARE < drifted < (0.06 if moved else SHARE + FLOOR_A / 0.2 + abs(rate) * WINDOW_s)


@pytest.mark.parametrize("moved", [False, True])
def test_nor_are_instruments_that_warm_up(moved):
    """A sense resistor by 0.2 % at 0.4 A, a supply by 0.1 %, which sets in steps of 1 mA; the DAQ is a reading late."""
    random, currents, warm = np.random.default_rng(0), CurrentsApart(), 0.0
    told_A, before_A = 0.05, 0.05
    for step in range(round(600.0 / PERIOD_s)):
        time_s = step * PERIOD_s
        if moved:
            told_A = wander_A(time_s)
        elif step % 400 == 0:
            told_A = (0.05, 0.4, 0.12, 0.3)[step // 400 % 4]
        flows_A = FLOOR_A * round(told_A / FLOOR_A) * (1.0 + 1e-3 * -math.expm1(-time_s / 300.0))
        warm += (2e-3 * (before_A / 0.4) ** 2 - warm) * PERIOD_s / 20.0
        daq_A, before_A = before_A * (1.0 + warm) + 1e-4 * random.standard_normal(), flows_A
        change_A, allowed_A = currents.step(time_s, daq_A, told_A, told_A, SHARE)
        assert not abs(change_A) > allowed_A, time_s


@pytest.mark.parametrize("behind", [1, 2])
@pytest.mark.parametrize("seed", range(5))
def test_nor_is_a_daq_that_is_readings_behind_while_a_busy_machine_stands_still(seed, behind):
    random, currents = np.random.default_rng(seed), CurrentsApart()
    time_s, told_A, set_A = 0.0, 0.05, [0.05] * (behind + 1)
    for _ in range(2000):
        time_s += random.uniform(0.2, 0.9) if random.random() < 0.1 else PERIOD_s
        told_A = random.choice([0.05, 0.125, 0.3]) if random.random() < 0.02 else told_A
        set_A.append(told_A)
        change_A, allowed_A = currents.step(time_s, set_A[-1 - behind], told_A, told_A, SHARE)
        assert not abs(change_A) > allowed_A


@pytest.mark.parametrize("fall", [1.0, 3.0])
@pytest.mark.parametrize("seed", range(10))
def test_nor_is_a_supply_that_is_still_rising_or_falling_when_it_is_measured(seed, fall):
    """Partial cycles by a supply of 20 ms on a slow line: the command comes now 5, now 40 ms before the reading."""
    random, currents = np.random.default_rng(seed), CurrentsApart()
    told_A = flows_A = 0.054
    for step in range(1600):
        phase = step * 0.0625 % 2.0
        before_A, told_A = told_A, 0.273 + 0.013 * phase if phase < 1.2 else 0.054
        left_s = random.uniform(0.005, 0.04)
        rise_s = 0.02 * (fall if told_A < before_A else 1.0)
        daq_A = told_A + (flows_A - told_A) * math.exp(-left_s / rise_s)
        flows_A = told_A + (flows_A - told_A) * math.exp(-0.0625 / rise_s)
        change_A, allowed_A = currents.step(step * 0.0625, daq_A, told_A, told_A, SHARE)
        assert not abs(change_A) > allowed_A, (step, change_A, allowed_A)


def a_world(seed, period_s, irregular, motion, seconds=30.0):
    """Times of the readings and the current that was set until each: steps, ramps, or a loop that hunts."""
    random = np.random.default_rng(seed)
    times, currents, now_s, set_A, wanted_A = [], [], 0.0, 0.05, 0.05
    while now_s < seconds:
        stall_s = random.uniform(0.1, 0.8) if irregular > 0.2 and random.random() < 0.03 else 0.0
        apart_s = period_s * (1.0 + irregular * random.uniform(-1.0, 1.0)) + stall_s
        now_s += apart_s
        times.append(now_s)
        currents.append(set_A)
        if random.random() < period_s / 4.0:
            wanted_A = random.choice([0.05, 0.125, 0.3, 0.4])
        rates = {"steps": math.inf, "ramps": 0.3, "hunting": 0.6}
        step_A = wanted_A - set_A + (0.01 * random.standard_normal() if motion == "hunting" else 0.0)
        set_A = max(0.03, set_A + float(np.clip(step_A, -rates[motion] * apart_s, rates[motion] * apart_s)))
    return np.array(times), np.array(currents)


def seen_by_a_daq(times, currents, late_s, block_s):
    """What it averages over a block that ends so long before each reading."""
    within = np.linspace(-late_s - block_s, -late_s, 9)
    at = np.searchsorted(times, times[:, None] + within[None, :] - 1e-9)
    return currents[np.clip(at, 0, len(currents) - 1)].mean(axis=1)


@pytest.mark.parametrize("motion", ["steps", "ramps", "hunting"])
@pytest.mark.parametrize("irregular", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.1, 0.2, 0.35, 0.53, 0.8])
class TestHoweverSlowlyAndIrregularlyReadingsCome:
    """Two means of one thing differ by when they were taken: the more so, the fewer readings they are of."""

    @pytest.mark.parametrize(("late_s", "block_s"), [(0.0, 0.02), (0.1, 0.05), (0.17, 0.02), (0.0, math.inf)])
    def test_currents_that_are_the_same_are_the_same(self, period_s, irregular, motion, late_s, block_s):
        for seed in range(2):
            times, set_A = a_world(seed, period_s, irregular, motion)
            daq_A = 1.01 * seen_by_a_daq(times, set_A, late_s, min(block_s, period_s)) + 1e-3
            currents = CurrentsApart()
            for time_s, measured_A, told_A in zip(times, daq_A, set_A, strict=True):
                change_A, allowed_A = currents.step(time_s, measured_A, told_A, told_A, SHARE)
                assert not abs(change_A) > allowed_A, (seed, time_s)


@pytest.mark.parametrize("motion", ["steps", "ramps", "hunting"])
@pytest.mark.parametrize("irregular", [0.0, 0.1])
@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("rate", [4e-3, -4e-3])
def test_a_drift_is_found_whatever_the_current_does(period_s, irregular, motion, rate):
    """A loop that hunts shows least."""
    times, set_A = a_world(0, period_s, irregular, motion, 90.0)
    measured_A = seen_by_a_daq(times, set_A, 0.05, 0.02)
    currents = CurrentsApart()
    for time_s, daq_A, told_A in zip(times, measured_A, set_A, strict=True):
        drifted = rate * max(0.0, time_s - 30.0)
        change_A, allowed_A = currents.step(time_s, daq_A * (1.0 + drifted), told_A, told_A, SHARE)
        if abs(change_A) > allowed_A:
            break
    assert SHARE < abs(drifted) < (0.10 if motion == "hunting" else 0.06)


def test_what_was_noted_outlives_a_pause_and_is_forgotten_when_asked():
    currents = CurrentsApart()
    assert apart(lambda _: 0.2, lambda _: 0.2, 5.0, currents) is None
    currents.pause()
    assert apart(lambda _: 0.2, lambda _: 0.21, 5.0, currents, 10.0) is not None
    currents.forget()
    assert apart(lambda _: 0.2, lambda _: 0.21, 5.0, currents, 20.0) is None


@pytest.mark.parametrize("apart", [CurrentsApart, VoltagesApart])
def test_after_a_pause_means_are_taken_of_what_comes_then(apart):
    two = apart()
    for step in range(60):
        said = two.step(PERIOD_s * step, 0.2, 0.2, 0.2 + 1e-3 * (step % 2), SHARE)
    assert not math.isnan(said[0])
    two.pause()
    assert math.isnan(two.step(PERIOD_s * 60, 0.2, 0.2, 0.2, SHARE)[0])


def test_nothing_is_said_before_a_window_and_its_lag_are_full():
    """Of a current that moves; one that stands is noted once it is seen to stand."""
    for wanted_A, seconds, said in ((lambda t: 0.1 + 0.1 * t, WINDOW_s, False), (lambda _: 0.1, LAG_s, True)):
        currents = CurrentsApart()
        assert apart(wanted_A, wanted_A, seconds + PERIOD_s, currents) is None
        now_s = seconds + PERIOD_s
        assert math.isnan(currents.step(now_s, wanted_A(now_s), wanted_A(now_s), wanted_A(now_s), SHARE)[0]) != said


@pytest.mark.parametrize(
    ("gap_s", "begins"),
    [(2.0 * WINDOW_s, True), (PERIOD_s + 1.1 * LAG_s, True), (PERIOD_s + 0.9 * LAG_s, False)],
)
def test_a_gap_of_readings_begins_the_window_anew(gap_s, begins):
    """One that is longer than readings come late."""
    currents = CurrentsApart()
    assert apart(lambda _: 0.2, lambda _: 0.2, 5.0, currents) is None
    assert math.isnan(currents.step(5.0 - PERIOD_s + gap_s, 0.3, 0.2, 0.2, SHARE)[0]) == begins


def seen(currents, begun_s, supply_A, above_A, seconds=1.5, vague_A=0.0, period_s=PERIOD_s):
    """What is said at the end of so long at one current, which the supply tells give or take ``vague_A``."""
    for step in range(round(seconds / period_s) + 1):
        at_s = begun_s + step * period_s
        said = currents.step(at_s, supply_A + above_A, supply_A - vague_A, supply_A + vague_A, SHARE)
    return said


def noted(*points):
    """Currents of the supply and by how much the DAQ's were above them, each seen long enough to be known."""
    currents = CurrentsApart()
    for number, (supply_A, above_A) in enumerate(points):
        currents.pause()
        seen(currents, 10.0 * number, supply_A, above_A)
    currents.pause()
    return currents


def allowed_A(supply_A):
    return SHARE * supply_A + FLOOR_A


@pytest.mark.parametrize("points", [((0.1, 1e-3), (0.3, 3e-3)), ((0.3, 3e-3), (0.1, 1e-3))])
def test_between_two_noted_currents_the_difference_is_on_a_straight_line(points):
    change_A, may_A = seen(noted(*points), 100.0, 0.15, 4e-3)
    assert (change_A, may_A) == pytest.approx((2.5e-3, allowed_A(0.15)))


def test_a_current_a_half_larger_is_noted_and_one_a_twentieth_larger_is_the_same():
    assert seen(noted((0.1, 0.0), (0.15, 1e-3)), 100.0, 0.125, 0.0)[0] == pytest.approx(-0.5e-3)
    assert seen(noted((0.1, 0.0), (0.105, 1e-3)), 100.0, 0.105, 1e-3)[0] == pytest.approx(1e-3)


def test_beyond_those_it_is_the_change_that_the_scales_explain_least():
    """By 1.5 % of 0.2 A, 3 mA of the 12 mA; the noted current that lies farther explains more of it."""
    currents = noted((0.1, 0.0), (0.3, 1e-3))
    change_A, may_A = seen(currents, 100.0, 0.5, 13e-3)
    assert (change_A, may_A) == pytest.approx((12e-3, 3e-3 + allowed_A(0.5)))


def test_a_change_between_them_is_not_learned():
    currents = noted((0.1, 0.0), (0.3, 0.0), (0.2, 2e-3))
    assert seen(currents, 100.0, 0.2, 5.5e-3)[0] == pytest.approx(5.5e-3)


def test_what_was_noted_in_a_moment_is_noted_again_when_it_is_known_exactly():
    """Within what the moment left open, whatever the errors that stand still; a quarter of a milliampere is left open
    then."""
    for above_A in (0.0, 5e-3, -5e-3):
        currents = CurrentsApart()
        seen(currents, 0.0, 0.2, above_A, 0.2)
        _, may_A = seen(currents, 0.25, 0.2, above_A + 0.1e-3, 0.0)
        assert may_A == pytest.approx(allowed_A(0.2) + 2 * 0.25e-3)
        known = [seen(currents, 0.3 + PERIOD_s * k, 0.2, above_A + 0.1e-3, 0.0)[0] for k in range(60)]
        assert not any(map(math.isnan, known)), "at no instant in between is it known no more"
        assert seen(currents, 3.3, 0.2, above_A + 0.1e-3, 0.0) == pytest.approx((0.0, allowed_A(0.2)), abs=1e-12)


def test_what_has_changed_since_that_moment_is_not():
    currents = CurrentsApart()
    seen(currents, 0.0, 0.2, 5e-3, 0.2)
    assert seen(currents, 0.25, 0.2, 6e-3, 3.0) == pytest.approx((1e-3, allowed_A(0.2) + 0.25e-3))


def test_a_drift_is_not_followed_where_the_supply_tells_its_current_only_about():
    currents, above_A = CurrentsApart(), 0.0
    for step in range(400):
        above_A = 2e-5 * step
        change_A, _ = currents.step(PERIOD_s * step, 0.2 + above_A, 0.1998, 0.2002, SHARE)
    assert change_A == pytest.approx(above_A, abs=0.5e-3)


def test_a_supply_that_tells_its_current_only_about_leaves_that_much_open():
    currents = CurrentsApart()
    seen(currents, 0.0, 0.2, 1e-3, 3.0, vague_A=0.2e-3)
    change_A, may_A = seen(currents, 3.05, 0.2, 1e-3, 0.0, vague_A=0.2e-3)
    assert (change_A, may_A) == pytest.approx((0.0, allowed_A(0.2) + 2 * 0.2e-3), abs=1e-9)


def test_currents_on_the_way_from_one_to_another_are_not_noted():
    """The mean of a second's change is no current that stood."""
    currents = CurrentsApart()
    seen(currents, 0.0, 0.1, 0.0)
    seen(currents, 1.55, 0.3, 0.0, 3.0)
    assert seen(currents, 4.6, 0.3, 2e-3, 3.0)[0] == pytest.approx(2e-3)
    currents.pause()
    assert seen(currents, 100.0, 0.2, 2e-3)[0] == pytest.approx(2e-3), "the line between the two that stood"


class TestBetweenAnExactCurrentAndOneKnownAbout:
    """50 mA, where both were alike, and 0.4 A, where the DAQ's was 2 mA above the supply's, give or take 2.5 mA."""

    @pytest.fixture
    def currents(self):
        currents = noted((0.05, 0.0))
        seen(currents, 10.0, 0.4, 2e-3, vague_A=2.5e-3)
        currents.pause()
        return currents

    @pytest.mark.parametrize("way", [0.2, 0.5, 0.8])
    def test_so_much_is_known_as_lies_between(self, currents, way):
        supply_A = 0.05 + way * 0.35
        change_A, may_A = seen(currents, 20.0, supply_A, way * 2e-3 + 1e-3, vague_A=2e-3)
        assert (change_A, may_A) == pytest.approx((1e-3, allowed_A(supply_A) + way * 2.5e-3 + 2e-3))

    @pytest.mark.parametrize("changed_A", [1.0e-3, -1.0e-3])
    def test_what_is_seen_more_exactly_is_noted(self, currents, changed_A):
        above_A = 2e-3 * 0.15 / 0.35 + changed_A
        seen(currents, 20.0, 0.2, above_A)
        assert seen(currents, 30.0, 0.2, above_A) == pytest.approx((0.0, allowed_A(0.2)), abs=1e-12)

    @pytest.mark.parametrize("changed_A", [1.4e-3, -1.4e-3])
    def test_what_contradicts_both_is_not(self, currents, changed_A):
        seen(currents, 20.0, 0.2, 2e-3 * 0.15 / 0.35 + changed_A)
        said = seen(currents, 30.0, 0.2, 2e-3 * 0.15 / 0.35 + changed_A)
        assert said == pytest.approx((changed_A, allowed_A(0.2) + 2.5e-3 * 0.15 / 0.35))

    def test_nor_what_is_hardly_more_exact(self, currents):
        """So a drift is not followed in small steps."""
        seen(currents, 20.0, 0.2, 0.0, vague_A=0.7e-3)
        change_A, _ = seen(currents, 30.0, 0.2, 0.0, vague_A=0.7e-3)
        assert change_A == pytest.approx(-2e-3 * 0.15 / 0.35)


@pytest.mark.parametrize("rate", [4e-3, -4e-3])
def test_a_drift_of_a_wire_that_wandered_is_found_soon(rate):
    """Held at a current between those that it was begun and driven with, all of them in passing but the first."""

    def set_A(time_s):
        return 0.05 if time_s < 2.0 else 0.25 + 0.05 * math.sin(1.5 * time_s) if time_s < 30.0 else 0.14

    found_s = apart(set_A, lambda t: set_A(t - 0.05) * (1.0 + rate * max(0.0, t - 31.5)), 100.0)
    assert abs(rate) * (found_s - 31.5) < SHARE + 1.1 * FLOOR_A / 0.14 + abs(rate) * WINDOW_s


class TestAMomentOfCurrent:
    """It is noted after two tenths of a second and three readings in which nothing moves."""

    def known(self, begun_s, *, period_s, seconds, daq_A=(0.0,), vague_A=0.0):
        currents = CurrentsApart()
        for step in range(round(seconds / period_s) + 1):
            set_A = 0.2 + daq_A[step % len(daq_A)]
            currents.step(begun_s + step * period_s, set_A, 0.2 - vague_A, 0.2 + vague_A, SHARE)
        at_s = begun_s + seconds + 1e-3
        return not math.isnan(currents.step(at_s, 0.2, 0.2 - vague_A, 0.2 + vague_A, SHARE)[0])

    @pytest.mark.parametrize("begun_s", [0.0, 10.0])
    def test_two_tenths_of_a_second(self, begun_s):
        assert self.known(begun_s, period_s=0.05, seconds=0.2)
        assert not self.known(begun_s, period_s=0.05, seconds=0.15)

    def test_three_readings(self):
        assert self.known(0.0, period_s=0.1, seconds=0.2)
        assert not self.known(0.0, period_s=0.2, seconds=0.2)

    def test_that_differ_by_a_quarter_of_a_milliampere_at_most(self):
        assert self.known(0.0, period_s=0.05, seconds=0.3, daq_A=(0.0, 0.2e-3))
        assert not self.known(0.0, period_s=0.05, seconds=0.3, daq_A=(0.0, 0.3e-3))

    def test_as_does_what_the_supply_tells(self):
        assert self.known(0.0, period_s=0.05, seconds=0.3, vague_A=0.1e-3)
        assert not self.known(0.0, period_s=0.05, seconds=0.3, vague_A=0.15e-3)


def test_of_one_that_moves_something_is_known_after_a_second_and_two_tenths():
    currents = CurrentsApart()
    for step in range(30):
        set_A = 0.1 + 0.01 * step
        change_A, _ = currents.step(PERIOD_s * step, set_A, set_A, set_A, 10.0)
        assert math.isnan(change_A) == (step <= 24), step


def test_slow_readings_are_compared_as_well():
    assert not math.isnan(seen(CurrentsApart(), 0.0, 0.2, 0.0, 3.5, period_s=0.35)[0])


def test_a_clock_that_goes_back_begins_the_window_anew():
    for back_s in (0.5, 50.0):
        currents = noted((0.1, 0.0))
        seen(currents, 100.0, 0.3, 0.0, 3.0)
        assert math.isnan(currents.step(103.0 - back_s, 0.1, 0.1, 0.1, SHARE)[0])
        assert seen(currents, 103.05 - back_s, 0.1, 1e-3) == pytest.approx((1e-3, allowed_A(0.1)))


def test_what_is_forgotten_has_to_be_seen_for_as_long_as_at_first():
    currents = noted((0.2, 0.0))
    seen(currents, 100.0, 0.2, 0.0)
    currents.forget()
    assert math.isnan(seen(currents, 101.55, 0.2, 0.0, 0.15)[0])


def test_a_voltage_that_is_no_number_once_does_not_blind(make_rig):
    """It made every later mean of it none, for as long as current flowed."""
    rig = make_rig(**{"safety.current_drift": 1.0})
    rig.enable()
    rig.run(9.0)
    rig.state_of = lambda state: state.__class__(**{**_fields(state), "voltage_V": math.nan})
    rig.step()
    rig.state_of = lambda state: state
    rig.run(9.0)
    rig.reading_of = lambda r: r.__class__(
        **{**_fields(r), **{name: 1.1 * getattr(r, name) for name in ("reference_voltage_V", "supply_voltage_V")}}
    )
    assert rig.seconds_until("voltage_drifts", 3.0) is not None


def test_a_wire_at_the_compliance_voltage_is_not_accused(make_rig):
    """There the supply holds the voltage, and the current is what the wire takes."""
    rig = make_rig()
    rig.enable()
    rig.track()
    rig.run(5.0)
    rig.state_of = lambda state: state.__class__(**{**_fields(state), "voltage_V": rig.config.supply.max_voltage})
    rig.reading_of = lambda r: r.__class__(
        **{**_fields(r), "reference_voltage_V": 0.96 * r.reference_voltage_V, "supply_voltage_V": r.supply_voltage_V}
    )
    assert rig.seconds_until("current_drifts", 3.0) is None


class TestVoltages:
    """Of a wire of some 6 Ω that is moved; the supply measures what its leads drop as well."""

    @staticmethod
    def apart(daq_V, supply_V, seconds, current_A=wander_A, voltages=None, begun_s=0.0):
        """Time at which the voltages are found apart, or None; what they are is told by time and voltage at the
        wire."""
        voltages = voltages if voltages is not None else VoltagesApart()
        for step in range(round(seconds / PERIOD_s)):
            time_s = begun_s + step * PERIOD_s
            set_A = current_A(time_s)
            wire_V = 6.0 * set_A + 1e-3 * (-1) ** step  # no wire is still to the last digit
            seen_V = daq_V(time_s, wire_V), supply_V(time_s, wire_V)
            change_V, allowed_V = voltages.step(time_s, set_A, *seen_V, SHARE_V)
            if abs(change_V) > allowed_V:
                return time_s
        return None

    @pytest.mark.parametrize("leads_Ohm", [0.0, 0.5, 2.0])
    @pytest.mark.parametrize("scale", [1.0 - SCALE, 1.0 + SCALE])
    def test_what_the_leads_drop_and_errors_that_stand_still_are_no_drift(self, leads_Ohm, scale):
        def supply_V(time_s, wire_V):
            return scale * wire_V + leads_Ohm * wander_A(time_s) - 0.02

        assert self.apart(lambda _, wire_V: wire_V, supply_V, 200.0) is None

    @pytest.mark.parametrize("late_s", [METER_LAG_s, -METER_LAG_s])
    def test_nor_is_a_meter_that_is_late_or_a_daq_that_is(self, late_s):
        assert self.apart(lambda _, wire_V: wire_V, lambda t, _: 6.0 * wander_A(t - late_s), 200.0) is None

    @pytest.mark.parametrize("digit_V", [0.01, 0.1])
    def test_nor_are_the_digits_of_a_coarse_meter(self, digit_V):
        def supply_V(_, wire_V):
            return digit_V * round(wire_V / digit_V)

        assert self.apart(lambda _, wire_V: wire_V, supply_V, 200.0) is None

    @pytest.mark.parametrize("rate", [4e-3, -4e-3, 5e-4, -5e-4])
    @pytest.mark.parametrize("leads_Ohm", [0.0, 0.5])
    def test_a_drift_of_a_wire_that_is_held_is_found(self, rate, leads_Ohm):
        def current_A(time_s):
            return 0.05 if time_s < 3.0 else 0.2

        def daq_V(time_s, wire_V):
            return wire_V * (1.0 + rate * max(0.0, time_s - 30.0))

        def supply_V(time_s, wire_V):
            return wire_V + leads_Ohm * current_A(time_s)

        found_s = self.apart(daq_V, supply_V, 150.0, current_A)
        slack = (FLOOR_V + 0.01) / (6.0 * 0.2)  # what noise leaves open
        seen_late = abs(rate) * (0.5 * WINDOW_s + METER_LAG_s)
        assert SHARE_V < abs(rate) * (found_s - 30.0) < SHARE_V + slack + 1.5 * seen_late + 2e-3

    @pytest.mark.parametrize("rate", [4e-3, -4e-3])
    def test_and_of_one_that_moves_where_it_turns(self, rate):
        def daq_V(time_s, wire_V):
            return wire_V * (1.0 + rate * max(0.0, time_s - 60.0))

        found_s = self.apart(daq_V, lambda _, wire_V: wire_V, 200.0)
        assert abs(rate) * (found_s - 60.0) < 0.08

    @pytest.mark.parametrize("rate", [5e-4, -5e-4])
    @pytest.mark.parametrize("motion", ["steps", "ramps", "hunting"])
    def test_also_a_slow_one(self, motion, rate):
        times, set_A = a_world(0, PERIOD_s, 0.1, motion, 250.0)
        wire_V = 6.0 * seen_by_a_daq(times, set_A, 0.05, 0.02)
        voltages, latest_V, next_s = VoltagesApart(), 0.0, 0.0
        for time_s, was_V, current_A in zip(times, wire_V, set_A, strict=True):
            if time_s >= next_s:  # the supply's meter, slow and coarse
                latest_V, next_s = 0.01 * round((was_V + 0.5 * current_A) / 0.01), time_s + 0.25
            drifted = rate * max(0.0, time_s - 50.0)
            change_V, allowed_V = voltages.step(time_s, current_A, was_V * (1.0 + drifted), latest_V, SHARE_V)
            if abs(change_V) > allowed_V:
                break
        assert SHARE_V < abs(drifted) < 0.10

    @pytest.mark.parametrize("motion", ["steps", "ramps", "hunting"])
    @pytest.mark.parametrize("irregular", [0.0, 0.1, 0.3])
    @pytest.mark.parametrize("meter_s", [0.0, 0.2, 0.4])
    @pytest.mark.parametrize("period_s", [0.02, 0.05, 0.2, 0.53])
    def test_nor_is_a_slow_meter_or_a_slow_loop(self, period_s, meter_s, irregular, motion):
        times, set_A = a_world(0, period_s, irregular, motion)
        wire_V = 6.0 * seen_by_a_daq(times, set_A, 0.05, 0.02)
        voltages, latest_V, next_s = VoltagesApart(), 0.0, 0.0
        for time_s, was_V, current_A in zip(times, wire_V, set_A, strict=True):
            if time_s >= next_s:
                latest_V, next_s = 0.01 * round((1.01 * was_V + 0.3 * current_A) / 0.01), time_s + meter_s
            change_V, allowed_V = voltages.step(time_s, current_A, was_V, latest_V, SHARE_V)
            assert not abs(change_V) > allowed_V, time_s

    def test_what_was_noted_outlives_a_pause_and_is_forgotten_when_asked(self):
        def supply_V(_, wire_V):
            return wire_V

        def current_A(time_s):
            return 0.05 if time_s % 20.0 < 3.0 else 0.2

        voltages = VoltagesApart()
        assert self.apart(lambda _, wire_V: wire_V, supply_V, 10.0, current_A, voltages) is None
        voltages.pause()
        assert self.apart(lambda _, wire_V: 1.05 * wire_V, supply_V, 10.0, current_A, voltages, 20.0) is not None
        voltages.forget()
        assert self.apart(lambda _, wire_V: 1.05 * wire_V, supply_V, 10.0, current_A, voltages, 40.0) is None


def _fields(record):
    return {name: getattr(record, name) for name in record.__dataclass_fields__}


class Definition:
    """What of two measurements is known, worked out anew for each reading from all those since the last gap."""

    def __init__(self, share, lag_s, floor, zero=0.0, stands=None, odd_counts=False):
        self.share = share
        self.lag_s, self.floor, self.zero, self.stands, self.odd_counts = lag_s, floor, zero, stands, odd_counts
        self.rows, self.noted, self.usual_s, self.odd, self.last_s = [], [], 1.0, 1.0, math.nan

    def step(self, now_s, stored, taken_from, daq, at=None, is_new=True, digit=0.0):
        """``stored`` are two numbers, one of which is late, and ``taken_from`` what they are taken from."""
        apart_s, self.last_s = now_s - self.last_s, now_s
        if self.rows and 0.0 <= apart_s <= min(self.usual_s + 0.2, 1.0):
            self.odd, self.usual_s = min(abs(apart_s - self.usual_s) / max(self.usual_s, 1e-6), 1.0), apart_s
        else:
            self.rows, self.since_s = [], now_s
        self.rows.append({"s": now_s, "stored": stored, "daq": daq, "at": at, "new": is_new})
        times_s = [row["s"] for row in self.rows]
        then = [next(i for i, s in enumerate(times_s) if s >= now_s - self.lag_s * k / 8 - 1e-6) for k in range(9)]
        then += [max(len(self.rows) - 1 - behind, 0) for behind in (1, 2)]
        been = np.array([[taken_from[k] - self.rows[i]["stored"][k] for i in then] for k in range(2)])
        late = np.abs(been[:, 0] - been[:, 9]).max() if is_new else np.ptp(been[:, :10], axis=1).max()
        self.rows[-1].update(been=been.ravel(), late=late**2 * (max(25.0 * self.odd, 1.0) if self.odd_counts else 1.0))
        if self.stands is not None and now_s - self.since_s < 1.0 + self.lag_s:
            return self.at_first(now_s)
        said = (math.nan, math.nan)
        for number, window_s in enumerate((1.0, 2.0, 4.0, 8.0)):
            if math.isfinite(digit) and now_s - self.since_s >= window_s + self.lag_s:
                one = self.judge(*self.means(now_s, window_s, digit))
                said = one if number == 0 or abs(one[0]) - one[1] > abs(said[0]) - said[1] else said
        return said

    def at_first(self, now_s):
        stored = [number for row in self.rows for number in row["stored"]]
        last = [(row["been"][0] + row["been"][11]) / 2 for row in self.rows[-3:]]
        if len(last) < 3 or now_s - self.since_s < 0.2 - 1e-6 or max(np.ptp(stored), np.ptp(last)) > self.stands:
            return math.nan, math.nan
        middle = (min(stored) + max(stored)) / 2
        return self.judge(middle, np.mean(last), self.stands, self.share * middle + self.floor)

    def means(self, now_s, window_s, digit):
        rows = [row for row in self.rows if now_s - row["s"] < window_s]
        been = np.mean([row["been"] for row in rows], axis=0)
        above = (been.min() + been.max()) / 2
        at_random = math.sqrt(np.mean([row["late"] for row in rows]) / max(1, sum(row["new"] for row in rows)))
        supply = np.mean([row["daq"] for row in rows]) - above
        at = supply if rows[0]["at"] is None else np.mean([row["at"] for row in rows])
        return at, above, (np.ptp(been) + at_random + digit) / 2, self.share * supply + self.floor

    def judge(self, current, above, vague, drift):
        steep = [(abs(was) + self.zero) / at if self.zero else 0.015 for at, was, _ in self.noted]
        said = [
            (above - was, its_vague + each * abs(current - at))
            for (at, was, its_vague), each in zip(self.noted, steep, strict=True)
        ]
        change, known = max(said, key=lambda one: abs(one[0]) - one[1], default=(math.nan, math.nan))
        below = max((one for one in self.noted if one[0] < current), default=None)
        beyond = min((one for one in self.noted if one[0] >= current), default=None)
        if below and beyond:
            _, was, known = np.array(below) + (np.array(beyond) - below) * (current - below[0]) / (beyond[0] - below[0])
            change = above - was
        allowed = known + drift + vague
        if not vague <= drift or abs(change) > allowed:
            return change, allowed
        near = [one for one in self.noted if one[0] / 1.1 <= current <= one[0] * 1.1]
        more_exactly = vague < 0.5 * min([known, *(one[2] for one in near)]) and abs(change) <= vague + known
        if more_exactly or (not near and not (below and beyond)):
            others = [one for one in self.noted if not one[0] / 1.1 <= current <= one[0] * 1.1]
            self.noted = [*others, (current, above, vague)]
        return change, allowed


def readings(seed, count=700):
    """Times that stand still, go back and have gaps; currents that stand, wander and jump."""
    random, now_s, set_A = np.random.default_rng(seed), 0.0, 0.05
    period_s, wanders = random.choice([0.02, 0.05, 0.09, 0.2]), random.random() < 0.5
    for _ in range(count):
        odd = random.random()
        now_s += period_s * (1.0 + 0.03 * random.random())
        now_s += random.uniform(0.1, 1.5) if odd < 0.01 else -0.3 if odd < 0.013 else 0.0
        set_A = random.choice([0.03, 0.05, 0.1, 0.2, 0.25, 0.4]) if random.random() < 0.02 else set_A
        noise_A = (2e-3 if wanders else 2e-5) * random.standard_normal()  # no current is there twice to the last digit
        yield now_s, max(0.02, set_A + noise_A), random


@pytest.mark.parametrize("seed", [*range(2), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(2, 12))])
class TestByTheirDefinition:
    def test_of_two_currents(self, seed):
        currents, definition = CurrentsApart(), Definition(SHARE, 0.2, 1e-3, stands=0.25e-3, odd_counts=True)
        known, before_A = 0, 0.05
        for now_s, told_A, random in readings(seed):
            daq_A = 1.01 * before_A + 1e-3 + 5e-5 * random.standard_normal() + (seed % 3) * 2e-4 * now_s
            from_A, before_A = told_A - (seed % 2) * random.choice([0.0, 2e-4]), told_A
            said = currents.step(now_s, daq_A, from_A, told_A, SHARE)
            wanted = definition.step(now_s, (from_A, told_A), (daq_A, daq_A), daq_A)
            assert said == pytest.approx(wanted, nan_ok=True, abs=1e-9)
            known += math.isfinite(said[0])
        assert known > 50

    def test_of_two_voltages(self, seed):
        voltages, definition = VoltagesApart(), Definition(SHARE_V, 0.5, 10e-3, zero=50e-3)
        known, supply_V, digit_V, latest_V = 0, 0.3, math.inf, math.nan
        for now_s, current_A, random in readings(seed):
            daq_V = 6.0 * current_A * (1.0 + 2e-4 * random.standard_normal() + (seed % 3) * 1e-4 * now_s)
            if random.random() < (1.0, 0.5, 0.1)[seed % 3]:
                supply_V = 0.01 * round((1.01 * daq_V + 0.3 * current_A) / 0.01)
            is_new = supply_V != latest_V
            if is_new and math.isfinite(latest_V):
                digit_V = min(digit_V, abs(supply_V - latest_V))
            latest_V = supply_V
            said = voltages.step(now_s, current_A, daq_V, supply_V, SHARE_V)
            stored, taken_from = (-daq_V, supply_V), (-supply_V, daq_V)
            wanted = definition.step(now_s, stored, taken_from, daq_V, current_A, is_new, digit_V)
            assert said == pytest.approx(wanted, nan_ok=True, abs=1e-9)
            known += math.isfinite(said[0])
        assert known > 50


@pytest.mark.skipif(not COMPILED, reason="numba is not installed: nothing is compiled")
def test_made_ready_no_step_with_current_waits_for_a_kernel():
    """Whatever kind of number it is given: in the first part of characterise they were compiled with the output on."""
    made_ready()
    ready = list(drift._apart.signatures)
    currents, voltages = CurrentsApart(), VoltagesApart()
    for i, number in enumerate((float, np.float64, float)):
        currents.step(0.1 * i, number(0.2), number(0.2), number(0.2), SHARE)
        voltages.step(number(0.1 * i), number(0.2), number(1.0 + i // 2), number(1.0), SHARE)
    assert drift._apart.signatures == ready
