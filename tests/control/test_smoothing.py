"""What noise is left of a position, and what smoothing costs."""

import numpy as np
import pytest

from sma_actuator.control.pid import UNREST, PidController, PidParameters
from sma_actuator.control.smoothing import Smoother

DT_s = 0.05
NOISE_m = 14e-6


def smoothed(position_m, allowed_m):
    """A record through a smoother, and what it holds the noise for."""
    smoother = Smoother()
    return np.array([smoother.step(float(x), DT_s, allowed_m) for x in position_m]), smoother.noise_m


def noisy(n=4000, seed=3):
    return np.random.default_rng(seed).standard_normal(n) * NOISE_m


def test_it_knows_the_noise_of_a_position_that_moves():
    sine_m = 1.7e-3 * np.sin(2.0 * np.pi * np.arange(4000) * DT_s / 60.0)
    _, noise_m = smoothed(sine_m + noisy(), np.inf)
    assert noise_m == pytest.approx(NOISE_m, rel=0.25)
    _, noise_m = smoothed(sine_m, np.inf)
    assert noise_m < 0.01 * NOISE_m  # motion is no noise


def test_a_quick_wire_that_is_seldom_read_is_no_noise_and_not_late():
    """Up and down within 1.4 s, 16 readings a second: taken for noise of 80 µm its position was so late that the loop
    hunted, by 43 % of the stroke, and that went on being taken for noise."""
    time_s = np.arange(640) / 16.0
    position_m = 0.9e-3 * np.sin(2.0 * np.pi * time_s / 1.4)
    smoother = Smoother()
    seen_m = np.array([smoother.step(float(x), 1.0 / 16.0, 20e-6) for x in position_m + noisy(640)])
    assert smoother.noise_m < 2.0 * NOISE_m
    assert np.abs(seen_m - position_m)[100:].max() < 0.1e-3


def test_a_load_that_jumps_is_no_noise_and_the_wire_is_not_late_after_it():
    """A weight that was hung on a held wire stretched it by 2.4 mm; taken for noise, that made the position 0.3 s late
    for two seconds, and the loop swung through most of the stroke."""
    time_s = np.arange(800) * DT_s
    held_m = np.where(time_s < 20.0, 0.0, 2.4e-3) + 0.5e-3 * np.sin(2.0 * np.pi * np.maximum(time_s - 20.0, 0.0) / 1.4)
    smoother = Smoother()
    seen_m = np.array([smoother.step(float(x), DT_s, 5e-6) for x in held_m + noisy(800)])
    assert smoother.noise_m < 2.0 * NOISE_m
    after = (time_s > 20.6) & (time_s < 22.0)  # by when the filter has taken the jump
    assert np.abs(seen_m - held_m)[after].max() < 0.2e-3


def test_noise_that_grows_is_known_within_seconds():
    _, noise_m = smoothed(np.concatenate([noisy(200), 5.0 * noisy(200, seed=4)]), 5e-6)
    assert noise_m == pytest.approx(5.0 * NOISE_m, rel=0.3)


@pytest.mark.parametrize("allowed", (0.2, 0.5, 1.0))
def test_noise_moves_it_by_no_more_than_is_allowed(allowed):
    position_m, _ = smoothed(noisy(), allowed * NOISE_m)
    jumps_m = np.diff(position_m[400:])
    assert np.sqrt(np.mean(jumps_m**2)) == pytest.approx(allowed * NOISE_m, rel=0.15)


def test_a_position_without_noise_is_left_as_it_is():
    steps_m = np.repeat([0.0, 1e-3, 0.4e-3], 200)
    ramp_m = 1e-3 * np.linspace(0.0, 1.0, 600)
    assert smoothed(ramp_m, 5e-6)[0] == pytest.approx(ramp_m, abs=1e-12)
    assert smoothed(steps_m, np.inf)[0] == pytest.approx(steps_m, abs=1e-12)


def test_a_steady_motion_is_not_late():
    ramp_m = 0.2e-3 * np.arange(4000) * DT_s
    position_m, _ = smoothed(ramp_m + noisy(), 0.2 * NOISE_m)
    late_m = np.mean((ramp_m - position_m)[1000:])
    assert abs(late_m) < 0.2 * NOISE_m  # a low-pass as strong would be 0.2 s, 40 µm, late


def test_it_is_never_slower_than_a_wire():
    smoother = Smoother()
    for x in noisy():
        smoother.step(float(x), DT_s, 1e-12)
    way_m = [smoother.step(1e-3, DT_s, 1e-12) for _ in range(30)]
    assert way_m[-1] > 0.9e-3


def test_the_current_does_not_rattle_with_the_noise():
    """With gains that `init` derives: 14 µm of noise moved it by 3 % of max_current from step to step, rms."""
    bias_A, most_A, setpoint_m = 0.05, 0.35, 2e-3
    rms = {}
    for name, max_A in (("as it was", np.inf), ("smoothed", most_A)):
        pid = PidController(PidParameters(kp=710.0, ki=300.0), bias_A, max_A)
        pid.reset(setpoint_m, 0.2)
        current_A = [pid.step(setpoint_m + float(x), setpoint_m, DT_s, most_A) for x in noisy()]
        rms[name] = np.sqrt(np.mean(np.diff(current_A[400:]) ** 2)) / most_A
    assert rms["as it was"] > 0.03
    assert rms["smoothed"] == pytest.approx(UNREST, rel=0.2)
