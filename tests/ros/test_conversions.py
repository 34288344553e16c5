"""Every record that crosses to ROS and back is the same afterwards."""

import math

import pytest

pytest.importorskip("rclpy")
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st

import sma_msgs_py as conversions
from sma_actuator.base.signals import Branch, Command, Estimate, Mode, Quality, Signals, Status

NUMBER = st.floats(allow_nan=False)
STAMP = Time(sec=12, nanosec=34)


def _estimate(displacement_m, velocity_m_s=0.0):
    return Estimate(1.0, displacement_m, displacement_m / 0.1, velocity_m_s, Branch.HEATING, Quality.DETERMINATE)


def _signals(load_N, reference_m=math.nan):
    return Signals(1.0, 5.0, 0.2, 0.2, load_N, load_N / 1.8e-8, reference_m)


@given(NUMBER, NUMBER, NUMBER)
def test_joint_state_carries_position_velocity_and_tension(displacement_m, velocity_m_s, load_N):
    message = conversions.joint_state_message("wire", _estimate(displacement_m, velocity_m_s), _signals(load_N), STAMP)
    assert conversions.position_velocity_tension_from(message) == (displacement_m, velocity_m_s, load_N)
    assert (list(message.name), message.header.stamp) == (["wire"], STAMP)


def test_reference_carries_the_measured_position_and_nothing_else():
    message = conversions.reference_message("wire", _signals(1.0, 0.002), STAMP)
    position_m, velocity_m_s, tension_N = conversions.position_velocity_tension_from(message)
    assert position_m == 0.002
    assert math.isnan(velocity_m_s) and math.isnan(tension_N)


@given(NUMBER)
def test_load_is_force_x(load_N):
    message = conversions.load_message("base", _signals(load_N), STAMP)
    assert conversions.load_from(message) == load_N
    assert (message.header.frame_id, message.header.stamp) == ("base", STAMP)


@pytest.mark.parametrize(("output_on", "current_A"), [(True, 0.2), (False, 0.0)])
def test_command_current_is_zero_where_the_output_is_off(output_on, current_A):
    assert conversions.command_current_message(Command(0.2, output_on)).data == current_A


@given(st.floats())
def test_a_setpoint_passes_as_it_is_also_nan(position_m):
    back = conversions.position_from(conversions.setpoint_message(position_m))
    assert back == position_m or (math.isnan(back) and math.isnan(position_m))


@given(st.floats())
def test_a_joint_command_passes_as_it_is_also_nan(position_m):
    back = conversions.joint_command_from(conversions.joint_command_message("wire", position_m), "wire")
    assert back == position_m or (math.isnan(back) and math.isnan(position_m))


def test_a_joint_command_is_found_by_the_name_of_its_joint():
    both = conversions.joint_command_message("elbow", 0.1)
    both.name, both.position = ["elbow", "wire"], [0.1, 0.002]
    assert conversions.joint_command_from(both, "wire") == 0.002
    with pytest.raises(ValueError, match="it is for elbow, wire, and this joint is knee"):
        conversions.joint_command_from(both, "knee")
    both.position = [0.1]
    with pytest.raises(ValueError, match="it has no position for wire"):
        conversions.joint_command_from(both, "wire")


@given(st.lists(st.tuples(st.floats(0, 1e6), NUMBER), max_size=8))
def test_trajectory_keeps_times_to_the_nanosecond_and_positions(points):
    times_s, positions_m = [p[0] for p in points], [p[1] for p in points]
    back_s, back_m, _ = conversions.trajectory_from(
        conversions.trajectory_message("wire", times_s, positions_m), "wire"
    )
    assert back_m == positions_m
    assert back_s == pytest.approx(times_s, abs=2e-9)


def _trajectory(names, *points):
    message = conversions.trajectory_message("x", [float(i) for i in range(len(points))], [0.0] * len(points))
    message.joint_names = list(names)
    for point, positions in zip(message.points, points, strict=True):
        point.positions = list(positions)
    return message


@pytest.mark.parametrize(
    ("names", "points", "positions_m"),
    [
        (["wire"], [[1.0], [2.0]], [1.0, 2.0]),
        (["arm", "wire"], [[1.0, 3.0], [2.0, 4.0]], [3.0, 4.0]),
        ([], [[5.0]], [5.0]),
    ],
)
def test_the_joint_of_a_trajectory_is_found_by_name_or_is_the_only_one(names, points, positions_m):
    assert conversions.trajectory_from(_trajectory(names, *points), "wire")[1] == positions_m


def test_velocities_come_along_where_every_point_has_one():
    message = _trajectory(["arm", "wire"], [1.0, 3.0], [2.0, 4.0])
    assert conversions.trajectory_from(message, "wire")[2] is None
    for point in message.points:
        point.velocities = [0.1, 0.2]
    assert conversions.trajectory_from(message, "wire")[2] == [0.2, 0.2]
    message.points[0].velocities = []
    with pytest.raises(ValueError, match="1 of 2 points have a velocity; all or none is wanted"):
        conversions.trajectory_from(message, "wire")


def test_a_stamp_is_the_start_and_none_is_now():
    message = _trajectory(["wire"], [1.0])
    assert conversions.start_from(message, 5_000_000_000) == 0.0
    message.header.stamp = Time(sec=7, nanosec=500_000_000)
    assert conversions.start_from(message, 5_000_000_000) == pytest.approx(2.5)
    assert conversions.start_from(message, 9_000_000_000) == pytest.approx(-1.5)


@pytest.mark.parametrize(
    ("names", "points", "sentence"),
    [
        (["arm"], [[1.0]], "it moves arm, this joint is wire"),
        (["arm", "wire"], [[1.0]], "point 0 has 1 positions for 2 joints"),
        ([], [[1.0, 2.0]], "point 0 has 2 positions for 1 joint"),
        (["wire"], [[1.0], []], "point 1 has 0 positions"),
        (["wire", "wire"], [[1.0, 2.0]], "it names wire more than once"),
    ],
)
def test_a_trajectory_that_is_not_for_this_joint_is_refused_in_a_sentence(names, points, sentence):
    with pytest.raises(ValueError, match=sentence):
        conversions.trajectory_from(_trajectory(names, *points), "wire")


@pytest.mark.parametrize(
    ("status", "level"),
    [
        (
            Status(Mode.TRACKING, message="all is well", values={"resistance_Ohm": 5.25, "branch": "heating"}),
            DiagnosticStatus.OK,
        ),
        (Status(Mode.HOLD, limits=("current_max", "setpoint_rate"), message="saturated"), DiagnosticStatus.WARN),
        (
            Status(Mode.OFF, fault="open_wire", limits=("current_max",), message="the wire is open"),
            DiagnosticStatus.ERROR,
        ),
    ],
    ids=lambda value: value.mode.value if isinstance(value, Status) else "",
)
def test_status_survives_the_way_there_and_back(status, level):
    message = conversions.diagnostic_status_from("/left", "ACME supply", status)
    assert conversions.status_from(message) == status
    assert (message.level, message.name, message.hardware_id) == (level, "/left", "ACME supply")


@pytest.mark.parametrize(
    ("since_1970_ns", "said"),
    [
        (1_500_000_000_000_000_007, Time(sec=1_500_000_000, nanosec=7)),
        ((2**31 - 1) * 10**9, Time(sec=2**31 - 1)),
        (2**31 * 10**9, Time()),
        (-1, Time()),
    ],
)
def test_a_time_that_messages_have_no_room_for_is_not_known(since_1970_ns, said):
    assert conversions.time_message(since_1970_ns) == said
