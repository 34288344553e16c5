"""What ``joint_state_topic_hardware_interface/JointStateTopicSystem`` 1.1.0 does with its topics, written after its
``read`` and ``write``; and a controller on top of it that interpolates from the state, as joint_trajectory_controller
does.

The parameters come from the URDF, through xacro, as the controller manager would read them.
"""

from __future__ import annotations

import math
import threading
import time
import xml.etree.ElementTree as ET

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState

_FIELDS = ("position", "velocity", "effort")


class PluginDouble:
    """One ``<ros2_control>`` block, read and written at the rate of a controller manager, in a thread."""

    def __init__(self, urdf: str, rate_Hz: float = 50.0):
        (block,) = ET.fromstring(urdf).findall("ros2_control")
        parameters = {p.get("name"): p.text for p in block.find("hardware").findall("param")}
        self.joints = [joint.get("name") for joint in block.findall("joint")]
        interfaces = [(j, i) for j in block.findall("joint") for i in j.findall("state_interface")]
        self.state = {f"{j.get('name')}/{i.get('name')}": math.nan for j, i in interfaces}
        assert not any(i.findall("param") for _, i in interfaces), "an initial value would be believed"
        self.command = dict.fromkeys((f"{joint}/position" for joint in self.joints), math.nan)
        self._threshold = float(parameters.get("trigger_joint_command_threshold", "1e-5"))
        self._latest = JointState()
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("controller_manager", context=self._context)
        self._publisher = self._node.create_publisher(
            JointState, parameters.get("joint_commands_topic", "/robot_joint_commands"), QoSProfile(depth=1)
        )
        self._node.create_subscription(
            JointState,
            parameters.get("joint_states_topic", "/robot_joint_states"),
            lambda message: setattr(self, "_latest", message),
            qos_profile_sensor_data,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._period_s = 1.0 / rate_Hz
        #: Updates of it so far, position at its start [m], duration [s], goal [m]; a hold has no duration.  It advances
        #: with the updates, not with the clock: a machine that pauses makes it later, and no command of it leaps.
        self._trajectory = None
        self.path_error_m = 0.0
        self.sent_m: list[float] = []  #: every command since the goal
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def position_m(self):
        """The state interface of the only joint."""
        return self.state[f"{self.joints[0]}/position"]

    def go(self, goal_m: float, duration_s: float) -> None:
        """A goal of the trajectory controller: from the state, in a straight line."""
        self.path_error_m = 0.0
        self.sent_m = []
        self._trajectory = (0, self.position_m, duration_s, goal_m)

    def hold(self, position_m: float) -> None:
        """A controller that commands one position."""
        self._trajectory = (0, position_m, 0.0, position_m)

    def close(self) -> None:
        """As a killed controller manager: silence."""
        self._ended.set()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _run(self):
        while not self._ended.is_set():
            deadline_s = time.monotonic() + self._period_s
            while (left_s := deadline_s - time.monotonic()) > 0.0:
                self._executor.spin_once(timeout_sec=left_s)
            self._read()
            self._update()
            self._write()

    def _read(self):
        message = self._latest
        for i, name in enumerate(message.name):
            if name in self.joints:
                for field in _FIELDS:
                    values = getattr(message, field)
                    if len(values) and math.isfinite(values[i]):
                        self.state[f"{name}/{field}"] = values[i]

    def _update(self):
        if self._trajectory is None:
            return
        updates, from_m, duration_s, goal_m = self._trajectory
        self._trajectory = (updates + 1, from_m, duration_s, goal_m)
        share = min(updates * self._period_s / duration_s, 1.0) if duration_s else 1.0
        wanted_m = self.command[f"{self.joints[0]}/position"] = from_m + share * (goal_m - from_m)
        self.path_error_m = max(self.path_error_m, abs(wanted_m - self.position_m))

    def _write(self):
        difference = sum(abs(self.state[name] - wanted) for name, wanted in self.command.items())
        if difference <= self._threshold:
            return
        message = JointState(name=self.joints, position=[self.command[f"{j}/position"] for j in self.joints])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self.sent_m.extend(message.position)
        self._publisher.publish(message)
