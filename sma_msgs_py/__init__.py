"""Conversions between the core's records and standard ROS 2 messages, and nothing else."""

from .conversions import (
    command_current_message,
    diagnostic_status_from,
    joint_state_message,
    load_from,
    load_message,
    position_from,
    position_velocity_tension_from,
    reference_message,
    setpoint_message,
    signals_from,
    signals_message,
    start_from,
    status_from,
    trajectory_from,
    trajectory_message,
)

__all__ = [
    "command_current_message",
    "diagnostic_status_from",
    "joint_state_message",
    "load_from",
    "load_message",
    "position_from",
    "position_velocity_tension_from",
    "reference_message",
    "setpoint_message",
    "signals_from",
    "signals_message",
    "start_from",
    "status_from",
    "trajectory_from",
    "trajectory_message",
]
