"""Bytes that are written into those of one message are those of the message that would have been made anew."""

import math
import struct

import pytest

pytest.importorskip("rclpy")
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from sma_actuator.base.signals import Branch, Estimate, Quality, Signals
from sma_actuator.ros.topics import _joint_state_form, _signals_form
from sma_msgs_py import Form, joint_state_message, signals_message

STAMPS = st.builds(Time, sec=st.integers(0, 2**31 - 1), nanosec=st.integers(0, 999_999_999))
NUMBERS = st.floats(width=64)
NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)


def bits(numbers):
    """Of NaN there are many."""
    return [struct.pack("d", number) for number in numbers]


def same(one, other):
    """Whether two joint states are, to the last bit."""
    assert (one.header, one.name) == (other.header, other.name)
    for field in ("position", "velocity", "effort"):
        assert bits(getattr(one, field)) == bits(getattr(other, field))


@given(NAMES, STAMPS, NUMBERS, NUMBERS, NUMBERS)
def test_a_joint_state(name, stamp, position_m, velocity_m_s, load_N):
    said = deserialize_message(_joint_state_form(name).filled(stamp, [position_m, velocity_m_s, load_N]), JointState)
    estimate = Estimate(1.0, position_m, 0.0, velocity_m_s, Branch.HEATING, Quality.DETERMINATE)
    same(said, joint_state_message(name, estimate, Signals(1.0, 5.0, 0.1, 0.1, load_N, 1e8), stamp))


@given(st.dictionaries(NAMES, NUMBERS, min_size=1, max_size=40), STAMPS)
def test_signals_whatever_their_names(values, stamp):
    said = deserialize_message(_signals_form(tuple(values)).filled(stamp, list(values.values())), JointState)
    same(said, signals_message(values, "", stamp))


def test_what_has_no_stamp_has_its_number():
    form = Form(lambda _, numbers: Float64(data=numbers[0]), 1)
    assert deserialize_message(form.filled(Time(), [math.pi]), Float64).data == math.pi


def test_whole_numbers_and_truths_are_numbers():
    said = deserialize_message(_signals_form(("a", "b")).filled(Time(), [2, True]), JointState)
    assert list(said.position) == [2.0, 1.0]
