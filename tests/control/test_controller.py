"""The PID against its closed form, its saturation, and what must never get into it."""

import math
from dataclasses import replace

import pytest
from simple_pid import PID

from sma_actuator.control.pid import PidController, PidParameters

BIAS_A, MAX_A = 0.05, 0.40
FAST = {"derivative_time_constant": 0.0, "setpoint_rate_limit": 10.0}


def controller(**gains):
    return PidController(PidParameters(**{"kp": 0.0, **FAST, **gains}), BIAS_A)


def held(pid, position_m, setpoint_m, seconds, dt_s=0.05, limit_A=MAX_A):
    for _ in range(round(seconds / dt_s)):
        output_A = pid.step(position_m, setpoint_m, dt_s, limit_A)
    return output_A


def test_a_wire_that_is_too_long_gets_more_current_in_proportion():
    pid = controller(kp=100.0)
    pid.reset(0.003, 0.1)
    assert pid.step(0.003, 0.002, 0.05, MAX_A) == pytest.approx(0.1 + 100.0 * 0.001)


def test_the_integral_grows_by_ki_times_error_times_time():
    pid = controller(ki=40.0)
    pid.reset(0.003, 0.1)
    assert held(pid, 0.003, 0.002, seconds=2.0) == pytest.approx(0.1 + 40.0 * 0.001 * 2.0)


def test_the_derivative_of_a_ramp_is_its_slope():
    pid = controller(kd=50.0)
    pid.reset(0.003, 0.1)
    for k in range(1, 5):
        output_A = pid.step(0.003 + 0.001 * 0.05 * k, 0.003, 0.05, MAX_A)
    assert output_A == pytest.approx(0.1 + 50.0 * 0.001)


def test_the_derivative_is_low_passed_with_its_time_constant():
    pid = controller(kd=50.0, derivative_time_constant=0.2)
    pid.reset(0.003, 0.1)
    dt_s = 1e-4
    for k in range(1, 2001):  # one time constant of a ramp
        output_A = pid.step(0.003 + 0.001 * dt_s * k, 0.003, dt_s, MAX_A)
    assert output_A - 0.1 == pytest.approx(50.0 * 0.001 * (1.0 - math.exp(-1.0)), rel=1e-3)


def test_a_step_of_the_setpoint_does_not_kick_the_derivative():
    pid = controller(kd=50.0)
    pid.reset(0.003, 0.1)
    assert pid.step(0.003, 0.001, 0.05, MAX_A) == pytest.approx(0.1)


def test_it_agrees_with_simple_pid_where_neither_saturates():
    peer = PID(-60.0, -30.0, -8.0, setpoint=0.0025, sample_time=None)
    peer(0.003, dt=1e-9)  # it knows no position to start from
    peer._integral = 0.0
    pid = PidController(PidParameters(kp=60.0, ki=30.0, kd=8.0, **FAST), 0.0)
    pid.reset(0.003, 0.0)
    for k in range(1, 100):
        position_m = 0.003 + 2e-4 * math.sin(0.1 * k)
        assert pid.step(position_m, 0.0025, 0.05, 100.0) == pytest.approx(
            max(peer(position_m, dt=0.05), 0.0), abs=1e-12
        )


@pytest.mark.parametrize("limit_A", [0.05, 0.2, 0.4])
@pytest.mark.parametrize("error_m", [-1.0, -1e-3, 0.0, 1e-3, 1.0])
def test_the_output_lies_between_the_bias_and_the_limit(error_m, limit_A):
    pid = controller(kp=1e6, ki=1e6, kd=1e6)
    for _ in range(20):
        assert BIAS_A <= pid.step(0.003 + error_m, 0.003, 0.05, limit_A) <= limit_A


class TestAntiWindup:
    def test_a_minute_of_saturation_leaves_the_integral_where_it_was(self):
        pid = controller(kp=1000.0, ki=100.0)
        pid.reset(0.003, 0.1)
        held(pid, 0.004, 0.003, seconds=0.05)  # into saturation
        before_A = pid.integral_A
        assert held(pid, 0.004, 0.003, seconds=60.0) == MAX_A
        assert pid.at_max
        assert pid.integral_A == before_A

    def test_likewise_at_the_bias(self):
        pid = controller(kp=1000.0, ki=100.0)
        pid.reset(0.003, 0.1)
        held(pid, 0.002, 0.003, seconds=0.05)
        before_A = pid.integral_A
        assert held(pid, 0.002, 0.003, seconds=60.0) == BIAS_A
        assert pid.at_bias
        assert pid.integral_A == before_A

    def test_so_the_output_leaves_saturation_in_the_step_in_which_the_error_turns(self):
        pid = controller(kp=200.0, ki=100.0)
        pid.reset(0.003, 0.1)
        held(pid, 0.006, 0.003, seconds=60.0)
        assert pid.step(0.0029, 0.003, 0.05, MAX_A) < 0.1

    def test_the_integral_may_run_back_out_of_saturation(self):
        pid = controller(kp=0.0, ki=100.0)
        pid.reset(0.003, 0.6)  # above the limit, as after a limit that fell
        assert held(pid, 0.0025, 0.003, seconds=10.0) < MAX_A


class TestSetpointRate:
    def test_the_reference_moves_no_faster_than_the_limit(self):
        pid = controller(kp=1.0, setpoint_rate_limit=0.002)
        pid.reset(0.004, BIAS_A)
        pid.step(0.004, 0.001, 0.5, MAX_A)
        assert pid.reference_m == pytest.approx(0.003)
        assert pid.rate_limited

    def test_and_arrives_exactly(self):
        pid = controller(kp=1.0, setpoint_rate_limit=0.002)
        pid.reset(0.004, BIAS_A)
        held(pid, 0.004, 0.001, seconds=1.6)
        assert pid.reference_m == 0.001
        assert not pid.rate_limited


class TestBumpless:
    def test_starting_goes_on_from_the_present_current(self):
        pid = controller(kp=500.0, ki=100.0, kd=50.0)
        pid.reset(0.0021, 0.17)
        assert pid.step(0.0021, 0.0021, 0.05, MAX_A) == pytest.approx(0.17)

    def test_new_gains_do_not_move_the_output(self):
        pid = controller(kp=100.0, ki=10.0, kd=5.0)
        pid.reset(0.003, 0.1)
        for k in range(20):
            before_A = pid.step(0.003 + 1e-5 * k, 0.0028, 0.05, MAX_A)
        pid.set_gains(replace(pid.gains, kp=300.0, kd=15.0))
        after_A = pid.step(0.003 + 1e-5 * 19 + 1e-5, 0.0028, 0.05, MAX_A)
        assert abs(after_A - before_A) < 300.0 * 1e-5 + 10.0 * 4e-4 * 0.05 + 1e-4

    def test_and_the_new_gain_acts_from_then_on(self):
        pid = controller(kp=100.0)
        pid.reset(0.003, 0.1)
        pid.step(0.003, 0.003, 0.05, MAX_A)
        pid.set_gains(replace(pid.gains, kp=300.0))
        assert pid.step(0.0031, 0.003, 0.05, MAX_A) == pytest.approx(0.1 + 300.0 * 1e-4)


def state_of(pid):
    return {name: getattr(pid, name) for name in pid.__slots__}


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300], ids=str)
@pytest.mark.parametrize("argument", ["position", "setpoint", "step", "limit"])
def test_what_is_not_a_number_gives_the_bias_and_leaves_no_trace(argument, bad):
    pid = controller(kp=100.0, ki=100.0, kd=10.0)
    pid.reset(0.003, 0.1)
    held(pid, 0.0031, 0.003, seconds=1.0)
    before = state_of(pid)
    good = {"position": 0.0031, "setpoint": 0.003, "step": 0.05, "limit": MAX_A}
    assert pid.step(*{**good, argument: bad}.values()) == BIAS_A
    assert state_of(pid) == before


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_nor_can_a_start_from_nowhere_poison_it(bad):
    pid = controller(kp=100.0)
    before = state_of(pid)
    pid.reset(bad, 0.1)
    pid.reset(0.003, bad)
    assert state_of(pid) == before


def test_a_step_without_time_changes_nothing():
    pid = controller(kp=100.0, ki=100.0, kd=10.0)
    pid.reset(0.003, 0.1)
    before = state_of(pid)
    assert pid.step(0.005, 0.001, 0.0, MAX_A) == 0.1
    assert pid.step(0.005, 0.001, 0.0, 0.08) == 0.08
    assert state_of(pid) == before


def swing_of_a_held_wire(current_for, play_K, transforms_K, lag_s):
    """How far a wire goes to and fro in the last of a minute in which it is held in the middle; shares of its stroke.

    ``current_for``: position [m], setpoint [m], time step [s].
    Its temperature follows the power with 1.5 s; it moves along one line of temperature while it gets warmer, along
    another, ``2 play_K`` below, while it gets colder, each over ``transforms_K``, lags ``lag_s`` behind both, and 25 K
    of latent heat go with its stroke.
    """
    stroke_m, dt_s, fine = 0.004, 0.05, 10
    temperature_C, share, goes_to, seen = 24.0, 1.0, 1.0, []
    for n in range(1200):
        current_A = current_for(share * stroke_m, 0.5 * stroke_m, dt_s)
        for _ in range(fine):
            temperature_C += (24.0 + 875.0 * current_A**2 - temperature_C) / 1.5 * dt_s / fine
            warmer, colder = (1.0 - (temperature_C - 55.0 + sign * play_K) / transforms_K for sign in (-1.0, 1.0))
            goes_to = min(max(goes_to, colder, 0.0), warmer, 1.0)
            moved = (goes_to - share) / lag_s * dt_s / fine
            share, temperature_C = share + moved, temperature_C + 25.0 * moved
        if n >= 800:
            seen.append(share)
    assert sum(seen) / len(seen) == pytest.approx(0.5, abs=0.005)
    return max(seen) - min(seen)


@pytest.mark.parametrize(("play_K", "transforms_K", "lag_s"), [(3.0, 12.0, 0.15), (5.0, 16.0, 0.2), (5.0, 20.0, 0.2)])
def test_a_held_wire_does_not_hunt_through_its_hysteresis(play_K, transforms_K, lag_s):
    """With the integral that brought it there it swings for ever, as by any PI."""
    kp = 4.0 * MAX_A / 0.004
    ki = kp / (0.25 * 4.5)  # as `init` derives them
    pid = PidController(PidParameters(kp=kp, ki=ki), BIAS_A, MAX_A)
    pid.reset(0.004, BIAS_A)
    wire = (play_K, transforms_K, lag_s)
    assert swing_of_a_held_wire(lambda *now: pid.step(*now, MAX_A), *wire) < 0.005
    other = PID(-kp, -ki, 0.0, setpoint=0.002, sample_time=None, output_limits=(BIAS_A, MAX_A))
    assert swing_of_a_held_wire(lambda position_m, _, dt_s: other(position_m, dt=dt_s), *wire) > 0.02
