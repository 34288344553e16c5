"""What a wire's node does with what moves it: setpoints, trajectories and joint commands go to its loop, in m."""

from __future__ import annotations

from math import isfinite

from sensor_msgs.msg import JointState

from sma_actuator.config import Config
from sma_actuator.driver import DriverStopped
from sma_msgs_py import joint_command_from

from .one_wire import OneWire


class MovedWire:
    """One wire, as ``commands.py`` moves it.  What the loop itself refuses, it says in its output."""

    what = "wire"

    def __init__(self, wire: OneWire):
        self._wire = wire

    @property
    def config(self) -> Config:
        """The parameters as they are now."""
        return self._wire.config

    def report(self, sentence: str) -> None:
        """Say why something was refused."""
        self._wire.report(sentence)

    def ignores_commands(self) -> str:
        """Why none is looked at now, or ""."""
        if not self._wire.is_active or self._wire.driver is None:
            return self._wire.not_active()
        joint = self._wire.turned_by()
        return f"{joint} drives this wire; ask that for an angle, or switch it off" if joint else ""

    def refuses_goals(self) -> str:
        """Why no goal of the action can be taken now, or ""."""
        ignored = self.ignores_commands()
        if ignored:
            return ignored
        try:
            return "" if self._wire.is_driven() else "the output is off; call ~/enable first"
        except (DriverStopped, TimeoutError) as error:
            return str(error)

    def go_to(self, position_m: float) -> str:
        """Hand a setpoint to the loop."""
        if (driver := self._wire.driver) is not None:
            driver.offer_setpoint(position_m)
        return ""

    def follow(
        self, times_s: list[float], positions_m: list[float], velocities_m_s: list[float] | None, delay_s: float
    ) -> str:
        """Hand a trajectory to the loop; without points the motion ends where its reference has come."""
        if (driver := self._wire.driver) is not None:
            driver.offer_trajectory(times_s, positions_m, velocities_m_s, delay_s)
        return ""

    def take_joint_command(self, message: JointState) -> str:
        """Hand a joint command to the loop."""
        position_m, ignored = joint_command_from(message, self.config.joint_name), self.ignores_commands()
        driver = self._wire.driver
        if not ignored and driver is not None:
            driver.offer_joint_command(position_m)
        elif isfinite(position_m):  # before a controller runs nobody commands anything
            return f"a joint command was ignored: {ignored}"
        return ""

    def hold(self) -> None:
        """End the motion where the wire is measured to be."""
        if (driver := self._wire.driver) is not None:
            driver.hold()

    @property
    def usual_end(self) -> float:
        """How near the end the wire must come where a goal does not say [m]."""
        return self.config.controller.arming_distance * self.config.wire.full_stroke_m

    def in_words(self, error_m: float) -> str:
        """How far off it is."""
        return f"{error_m * 1e3:+.3f} mm"
