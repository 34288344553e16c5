"""Every kind of message that is sent here, made of what the loop says."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

import sma_msgs_py
from sma_actuator.base.signals import Health, JointEstimate, Verdict
from sma_actuator.ros.named_signals import named_signals

NAME = "/sma_actuator"
STAMP_ns = 1_700_000_000_123_456_789


def every_message(outputs):
    """(topic, message, function that made it) of every kind that there is, as a node and its clients send them."""
    stamp = sma_msgs_py.time_message(STAMP_ns)
    driven = outputs[-1]
    verdict = Verdict(state=Health.DUE, words="due: 25 % — 3 µm off", since_s=-0.0, causes=("stroke", "Ω"))
    health = sma_msgs_py.health_status_from(f"{NAME}: model health", "wire", verdict, np.inf)
    status = sma_msgs_py.diagnostic_status_from(NAME, "wire", driven.status)
    array = DiagnosticArray(status=[status, health])
    array.header.stamp = stamp
    made = [
        ("joint_states", sma_msgs_py.joint_state_message("wire", driven.estimate, driven.signals, stamp)),
        ("reference", sma_msgs_py.reference_message("wire", driven.signals, stamp)),
        ("load", sma_msgs_py.load_message("wire", driven.signals, stamp)),
        ("command_current", sma_msgs_py.command_current_message(driven.command)),
        ("setpoint", sma_msgs_py.setpoint_message(float("-inf"))),
        ("joint_command", sma_msgs_py.joint_command_message("wire", -0.0)),
        ("joint_trajectory", sma_msgs_py.trajectory_message("wire", [0.0, 1.5, 1e9], [0.001, np.nan, 0.003])),
        ("status", sma_msgs_py.diagnostic_status_from(NAME, "wire", outputs[0].status)),
        ("model_health", health),
        ("/diagnostics", array),
        ("/joint/joint_command", sma_msgs_py.pair_command_message("joint", 0.3)),
        (
            "/joint/joint_states",
            sma_msgs_py.joint_estimate_message("joint", JointEstimate(-0.1, cocontraction_N=2.0), stamp),
        ),
    ]  # fmt: skip
    made += [("signals", sma_msgs_py.signals_message(named_signals(each), "enabled; Ω", stamp)) for each in outputs]
    return [(topic if topic.startswith("/") else f"{NAME}/{topic}", message) for topic, message in made]


def kind_of(message):
    """Its name, as recordings have it."""
    return f"{type(message).__module__.partition('.')[0]}/msg/{type(message).__name__}"
