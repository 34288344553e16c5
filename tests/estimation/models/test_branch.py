"""Heating or cooling, decided without chatter."""

import dataclasses

import numpy as np
import pytest

from sma_actuator.estimation.branch import BranchDetector, EstimatorParameters, is_heating

DECISIONS = ("heat_balance", "power", "resistance_rate")


def parameters(decision, **changes):
    return dataclasses.replace(EstimatorParameters(), branch_decision=decision, **changes)


def stepped(detector, time_s, resistance_Ohm, power_W):
    """One sample, as a chain's kernel asks it."""
    return is_heating(detector.decision, time_s, resistance_Ohm, power_W, detector.state, detector.numbers)


def test_power_turns_at_the_thresholds_of_its_band():
    detector = BranchDetector(parameters("power", heating_power=0.2, heating_power_hysteresis=0.1))
    detector.reset(0.0, 5.0, 0.0)
    powers_W = (0.0, 0.2, 0.219, 0.221, 0.2, 0.181, 0.179, 0.2)
    answers = [stepped(detector, i * 0.05, 5.0, power) for i, power in enumerate(powers_W)]
    assert answers == [False, False, False, True, True, True, False, False]


def test_resistance_rate_turns_after_the_deadband():
    detector = BranchDetector(parameters("resistance_rate", resistance_deadband=0.01))
    detector.reset(0.0, 5.0, 0.0)
    answers = [stepped(detector, i * 0.05, r, 0.1) for i, r in enumerate((5.0, 5.1, 5.095, 5.085, 4.9, 4.905, 4.911))]
    assert answers == [False, False, False, True, True, True, False]


def test_heat_balance_says_heating_while_power_exceeds_what_holds_the_temperature():
    detector = BranchDetector(parameters("heat_balance", thermal_time_constant=2.0, heating_power_hysteresis=0.1))
    detector.reset(0.0, 5.0, 0.1)
    time_s = np.arange(0.0, 20.0, 0.05)
    power = np.where(time_s < 10.0, 0.3, 0.1)
    heating = detector.run(time_s, np.full_like(time_s, 5.0), power)
    assert heating[1:200].all()
    assert not heating[201:].any()
    # Power that has held for ten time constants is in balance: from there a little less is cooling.
    assert not stepped(detector, 20.05, 5.0, 0.088)
    assert stepped(detector, 20.1, 5.0, 0.112)


@pytest.mark.parametrize("decision", DECISIONS)
def test_holding_a_position_under_a_noisy_pid_does_not_chatter(decision):
    # Power settles near every threshold there is, with the noise of a PID on a noisy estimate.
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, 60.0, 0.05)
    power = 0.2 * (1.0 + 0.02 * rng.standard_normal(time_s.size))
    resistance = 4.9 + 3e-4 * rng.standard_normal(time_s.size)
    detector = BranchDetector(parameters(decision, heating_power=0.2))
    detector.reset(0.0, 4.9, 0.2)
    heating = detector.run(time_s, resistance, power)
    assert np.count_nonzero(np.diff(heating)) <= 1


@pytest.mark.parametrize("decision", DECISIONS)
def test_one_sample_and_many_decide_alike(decision):
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.uniform(0.01, 0.1, 400))
    power, resistance = rng.uniform(0.0, 0.4, 400), 5.0 + 0.1 * np.cumsum(rng.standard_normal(400)) * 0.01
    one, many = BranchDetector(parameters(decision)), BranchDetector(parameters(decision))
    one.reset(time_s[0], resistance[0], power[0])
    many.reset(time_s[0], resistance[0], power[0])
    answers = [stepped(one, t, r, p) for t, r, p in zip(time_s, resistance, power)]
    np.testing.assert_array_equal(answers, many.run(time_s, resistance, power))
