"""Supply and DAQ measure one current: a drift between them is found, errors that stand still, lags and steps are none."""

import math

import numpy as np
import pytest

from sma_actuator.safety.drift import FLOOR_A, SCALE, CurrentsApart, LAG_s, WINDOW_s

PERIOD_s, SHARE = 0.05, 0.015


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


def test_what_was_noted_outlives_a_pause_and_is_forgotten_when_asked():
    currents = CurrentsApart()
    assert apart(lambda _: 0.2, lambda _: 0.2, 5.0, currents) is None
    currents.pause()
    assert apart(lambda _: 0.2, lambda _: 0.21, 5.0, currents, 10.0) is not None
    currents.forget()
    assert apart(lambda _: 0.2, lambda _: 0.21, 5.0, currents, 20.0) is None


def test_nothing_is_said_before_a_window_and_its_lag_are_full():
    """Of a current that moves; one that stands is noted once it is seen to stand."""
    for wanted_A, seconds, said in ((lambda t: 0.1 + 0.1 * t, WINDOW_s, False), (lambda _: 0.1, LAG_s, True)):
        currents = CurrentsApart()
        assert apart(wanted_A, wanted_A, seconds + PERIOD_s, currents) is None
        now_s = seconds + PERIOD_s
        assert math.isnan(currents.step(now_s, wanted_A(now_s), wanted_A(now_s), wanted_A(now_s), SHARE)[0]) != said


def test_a_gap_of_readings_begins_the_window_anew():
    currents = CurrentsApart()
    assert apart(lambda _: 0.2, lambda _: 0.2, 5.0, currents) is None
    assert math.isnan(currents.step(5.0 + 2.0 * WINDOW_s, 0.3, 0.2, 0.2, SHARE)[0])


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


def _fields(record):
    return {name: getattr(record, name) for name in record.__dataclass_fields__}
