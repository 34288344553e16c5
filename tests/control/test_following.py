"""What becomes of a trajectory that somebody waits for."""

from math import inf, nan

import pytest

from sma_actuator.control.following import Outcome, Pursuit, tolerance
from sma_actuator.control.setpoints import Trajectory

RAMP = Trajectory([0.0, 2.0], [0.004, 0.002])


def pursuit(path_m=inf, end_m=1e-4, late_s=1.0):
    return Pursuit(RAMP, 10.0, path_m, end_m, late_s)


@pytest.mark.parametrize(
    ("now_s", "position_m", "outcome"),
    [
        (9.0, 0.001, None),  # not begun
        (11.0, 0.0031, None),
        (11.0, 0.0036, Outcome.PATH_VIOLATED),
        (11.0, nan, Outcome.PATH_VIOLATED),
        (11.99, 0.0020, None),  # near the end, but it is not over
        (12.0, 0.00205, Outcome.REACHED),
        (12.5, 0.0022, None),  # late
        (13.0, 0.0022, None),
        (13.01, 0.0022, Outcome.END_MISSED),
        (13.01, nan, Outcome.END_MISSED),
        (13.01, 0.00195, Outcome.REACHED),
    ],
)
def test_it_is_open_until_it_is_reached_or_violated(now_s, position_m, outcome):
    assert pursuit(path_m=5e-4).look(now_s, position_m) is outcome


def test_without_a_path_tolerance_only_the_end_counts():
    assert pursuit().look(11.0, 0.1) is None
    assert pursuit().look(11.0, nan) is None
    assert pursuit(late_s=inf).look(1e9, 0.1) is None


def test_on_the_way_to_a_later_first_point_it_is_where_it_came_from_that_counts():
    later = Pursuit(Trajectory([4.0], [0.002]), 10.0, 5e-4, 1e-4, 1.0)
    assert later.look(10.0, 0.004) is None
    assert later.setpoint(12.0) == pytest.approx(0.003)
    assert later.look(12.0, 0.0031) is None
    assert later.look(12.0, 0.004) is Outcome.PATH_VIOLATED
    assert later.look(14.0, 0.002) is Outcome.REACHED


def test_where_the_wire_should_be_is_said_also_before_the_beginning():
    assert pursuit().setpoint(9.0) == 0.004
    assert pursuit().setpoint(11.0) == pytest.approx(0.003)


@pytest.mark.parametrize(("asked", "wanted"), [(0.0, 0.3), (-1.0, inf), (0.2, 0.2)])
def test_tolerances_are_as_ros_has_them(asked, wanted):
    assert tolerance(asked, usual=0.3) == wanted
