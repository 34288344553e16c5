"""A JointTrajectory as it arrives, for a wire or a joint."""

from __future__ import annotations

from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from sma_msgs_py import start_from, trajectory_from

LONGEST_TRAJECTORY_B = 500_000  #: some thousand points


def trajectory_of(
    serialized: bytes, joint_name: str, now_ns: int
) -> tuple[list[float], list[float], list[float] | None, float]:
    """Times [s], positions, velocities where there are any, and the start in seconds after ``now_ns`` of ROS time.

    Subscribe with ``raw=True``: to make Python objects of a million points would hold up the ROS thread, and the loop
    with it.  Raises ValueError with a sentence.
    """
    if len(serialized) > LONGEST_TRAJECTORY_B:
        raise ValueError(
            f"trajectory refused: its message has {len(serialized)} bytes, more than {LONGEST_TRAJECTORY_B}; "
            "send it in parts"
        )
    message = deserialize_message(serialized, JointTrajectory)
    return *trajectory_from(message, joint_name), start_from(message, now_ns)
