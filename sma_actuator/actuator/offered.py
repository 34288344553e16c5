"""What is asked of a wire's position: setpoints, joint commands, trajectories, and why one of them is not taken."""

from __future__ import annotations

from collections.abc import Sequence

from sma_actuator.base.signals import Estimate, Quality
from sma_actuator.config import Config
from sma_actuator.control.commanding import Commanding
from sma_actuator.control.setpoints import Trajectory
from sma_actuator.safety.guards.setpoints import Bucket, setpoint_flood, setpoint_not_finite
from sma_actuator.safety.records import Fault

from .said import Said


class Offered:
    """Looks at what is offered, and hands what is taken on to ``commanding``.  ``config`` may be replaced."""

    def __init__(self, config: Config, commanding: Commanding, said: Said):
        self.config = config
        self._commanding = commanding
        self._said = said
        self._bucket = Bucket()
        self._joint_commands = "none"  #: what became of the last, in words

    def setpoint(self, now_s: float, position_m: float) -> str:
        """Take a setpoint [m]; "" or the sentence why it was refused."""
        refusal = self.refusal(now_s) or self._not_finite(now_s, position_m)
        if not refusal:
            self._commanding.track(now_s, float(position_m))
        return refusal

    def joint_command(self, now_s: float, position_m: float, estimate: Estimate) -> str:
        """Take a position [m] of a stream of joint commands; "" or the sentence why it was refused."""
        flooded = self._flood(now_s)
        if flooded:
            return flooded
        if position_m != position_m:
            self._joint_commands = "no number yet"
            return ""
        refusal = self._not_finite(now_s, position_m)
        if refusal:
            return refusal
        if not self._commanding.is_driven:
            self._joint_commands = "not followed: the output is off"
            return ""
        if estimate.quality is Quality.INVALID:
            self._joint_commands = "not followed: where the wire is is not known yet"
            return ""
        was_armed = self._commanding.armed
        near_m = self.config.controller.arming_distance * self.config.wire.full_stroke_m
        wire_m = estimate.displacement_m
        if self._commanding.command(now_s, float(position_m), wire_m, near_m):
            self._joint_commands = "followed"
            if not was_armed:
                self._said.changed("joint commands followed")
        else:
            self._joint_commands = (
                f"not followed: {position_m * 1e3:.3f} mm, and the wire is at {wire_m * 1e3:.3f} mm; "
                f"{near_m * 1e3:.3g} mm or nearer is wanted first (controller.arming_distance)"
            )
        return ""

    def trajectory(
        self,
        now_s: float,
        times_s: Sequence[float],
        positions_m: Sequence[float],
        velocities_m_s: Sequence[float] | None,
        delay_s: float,
        reference_m: float,
    ) -> str:
        """Take a trajectory from where the ``reference_m`` has come, or the end of one there; "" or why it was
        refused."""
        is_end = not len(times_s)  # no flood keeps a wire from coming to rest
        if refusal := self.not_driven if is_end else self.refusal(now_s):
            return refusal
        if is_end:
            self._commanding.cancel(reference_m)
            return ""
        try:
            trajectory = Trajectory(times_s, positions_m, velocities_m_s=velocities_m_s)
        except (TypeError, ValueError) as error:
            return self._refused(now_s, setpoint_not_finite, str(error))
        if refusal := trajectory.refusal(delay_s):
            return refusal
        self._commanding.follow(now_s, trajectory, delay_s, reference_m)
        return ""

    def refusal(self, now_s: float) -> str:
        """Why nothing is taken now, or ""."""
        return self._flood(now_s) or self.not_driven

    @property
    def not_driven(self) -> str:
        """That there is nothing to move or to end, in words, or ""."""
        return "" if self._commanding.is_driven else "setpoint refused: the output is off; call ~/enable first"

    @property
    def joint_commands(self) -> str:
        """What became of the last joint command."""
        if self._joint_commands == "followed" and not self._commanding.armed:
            return "not followed any more"
        return self._joint_commands

    def _flood(self, now_s: float) -> str:
        return self._refused(now_s, setpoint_flood, setpoint_flood.look(self._bucket, now_s, self.config))

    def _not_finite(self, now_s: float, position_m: float) -> str:
        return self._refused(now_s, setpoint_not_finite, setpoint_not_finite.look(position_m))

    def _refused(self, now_s: float, fault: Fault, why: str) -> str:
        if why:
            self._said.event(now_s, fault, why)
        return why
