"""Setpoints as functions of time."""

import math

import pytest

from sma_actuator.control.setpoints import Trajectory, constant, sine, steps, triangle


def test_constant_is_constant():
    assert constant(0.003)(0.0) == constant(0.003)(1e6) == 0.003


def test_steps_dwell_and_begin_again():
    setpoint = steps([0.001, 0.003], dwell_s=10.0)
    assert [setpoint(t) for t in (0.0, 9.9, 10.0, 19.9, 20.0)] == [0.001, 0.001, 0.003, 0.003, 0.001]


def test_sine_has_its_offset_amplitude_period_and_phase():
    setpoint = sine(0.002, 0.001, 60.0)
    assert [setpoint(t) for t in (0.0, 15.0, 30.0, 45.0)] == pytest.approx([0.002, 0.003, 0.002, 0.001])
    assert sine(0.002, 0.001, 60.0, phase_rad=math.pi / 2)(0.0) == pytest.approx(0.003)


def test_triangle_has_straight_flanks_between_its_peaks():
    setpoint = triangle(0.002, 0.001, 40.0)
    assert [setpoint(t) for t in (0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)] == pytest.approx(
        [0.002, 0.0025, 0.003, 0.0025, 0.002, 0.001, 0.002]
    )


class TestTrajectory:
    POINTS = ([1.0, 2.0, 4.0], [0.001, 0.003, 0.002])

    @pytest.mark.parametrize("velocities_m_s", [None, [0.0, 0.001, 0.0]])
    def test_passes_through_its_points_and_rests_outside_them(self, velocities_m_s):
        trajectory = Trajectory(*self.POINTS, velocities_m_s)
        assert [trajectory(t) for t in (0.0, 1.0, 2.0, 4.0, 99.0)] == pytest.approx([0.001, 0.001, 0.003, 0.002, 0.002])
        assert trajectory.duration_s == 4.0

    def test_without_velocities_it_is_straight_between_them(self):
        assert Trajectory(*self.POINTS)(1.25) == pytest.approx(0.0015)

    @pytest.mark.parametrize(
        ("times_s", "positions_m", "sentence"),
        [
            ([], [], "no points"),
            ([0.0, 1.0], [0.001], "2 times but 1 positions"),
            ([0.0, math.nan], [0.001, 0.002], "point 1: its time, nan, is not finite"),
            ([0.0, 1.0], [0.001, math.inf], "point 1: its position, inf, is not finite"),
            ([0.0, 1.0], [0.001, 1e300], "point 1: its position, 1e.300, is none of a wire or joint"),
            ([-1.0, 1.0], [0.001, 0.002], "point 0: its time, -1 s, is before the start"),
            ([0.0, 2.0, 2.0], [0.001, 0.002, 0.003], "point 2: its time, 2 s, is not after that of point 1"),
            ([0.0, 2.0, 1.0], [0.001, 0.002, 0.003], "point 2: its time, 1 s, is not after that of point 1"),
        ],
    )
    def test_refuses_points_that_cannot_be_followed(self, times_s, positions_m, sentence):
        with pytest.raises(ValueError, match=sentence):
            Trajectory(times_s, positions_m)

    def test_led_in_it_is_the_same_from_its_first_point_on_and_comes_there_from_rest(self):
        slow = Trajectory([1.0, 2.0], [0.004, 0.003], velocities_m_s=[0.0, 0.0])
        led = slow.led_in(0.5, 0.002)
        assert [led(time_s) for time_s in (0.0, 0.5, 1.0, 1.3, 9.0)] == [0.002, 0.002, 0.004, slow(1.3), 0.003]
        assert led(0.51) - 0.002 < 1e-5 and led(0.75) == pytest.approx(0.003)
        assert Trajectory([1.0], [0.004]).led_in(0.5, 0.002)(0.75) == pytest.approx(0.003)
        assert slow.led_in(1.0, 0.002) is slow and slow.led_in(0.5, math.nan) is slow


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: constant(math.nan), "position_m"),
        (lambda: steps([], 1.0), "positions_m"),
        (lambda: steps([0.001, math.inf], 1.0), r"positions_m\[1\]"),
        (lambda: steps([0.001], 0.0), "dwell_s"),
        (lambda: sine(0.0, math.nan, 1.0), "amplitude_m"),
        (lambda: sine(0.0, 1.0, -1.0), "period_s"),
        (lambda: triangle(0.0, 1.0, math.nan), "period_s"),
    ],
)
def test_refuses_what_is_no_number(make, name):
    with pytest.raises(ValueError, match=name):
        make()


class TestVelocities:
    def test_each_point_is_passed_at_its_position_and_velocity(self):
        velocities_m_s = [0.0, 0.002, -0.001]
        trajectory = Trajectory([0.0, 1.0, 3.0], [0.0, 0.001, 0.0005], velocities_m_s=velocities_m_s)
        for time_s, position_m, velocity_m_s in zip([0.0, 1.0, 3.0], [0.0, 0.001, 0.0005], velocities_m_s, strict=True):
            assert trajectory(time_s) == pytest.approx(position_m, abs=1e-12)
            for h in (1e-6, -1e-6):
                if 0.0 < time_s + h < 3.0:
                    assert (trajectory(time_s + h) - position_m) / h == pytest.approx(velocity_m_s, abs=1e-7)

    @pytest.mark.parametrize(
        ("velocities_m_s", "sentence"),
        [
            ([0.0], "1 velocities for 2 points"),
            ([0.0, float("nan")], "point 1: its velocity, nan, is none of a wire or joint"),
        ],
    )
    def test_others_are_refused_in_a_sentence(self, velocities_m_s, sentence):
        with pytest.raises(ValueError, match=sentence):
            Trajectory([0.0, 1.0], [0.0, 0.001], velocities_m_s=velocities_m_s)
