"""Control laws that were tried beside those of the package.

Importing this registers them; ``control_worlds.py --law`` drives with them.  ``held_heat`` and ``sliding_mode`` keep
the wire's heat balance, on the power that did flow, and from it the current that would hold the wire as warm as it is
now.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isfinite, nan, sqrt

from sma_actuator.base.signals import Estimate, Signals
from sma_actuator.control import CONTROL_LAWS
from sma_actuator.control.law import LawSections
from sma_actuator.control.pid import PidController, PidParameters

TRIALS = ("held_heat", "sliding_mode")
#: Boundary layer of the sliding mode, as share of the full stroke.
LAYER = 0.025


@CONTROL_LAWS.register("held_heat")
@dataclass(frozen=True, slots=True)
class HeldHeatParameters(PidParameters):
    """Gains of a PID that comes out of saturation with what holds the wire there."""

    def build(self, sections: LawSections) -> HeldHeat:
        """The law."""
        return HeldHeat(self, sections)


class HeldHeat(PidController):
    """A PID whose integral, while the current is at a limit, is the current that would hold the heat of that moment."""

    paced = False

    def __init__(self, gains: PidParameters, sections: LawSections):
        self._thermal, self._calibration = sections.thermal, sections.calibration
        self._heat_K = self._time_s = self._resistance_Ohm = nan
        self._above_K = 0.0  #: the wire above its surroundings
        self._share, self._stress_Pa = 1.0, 0.0
        super().__init__(gains, sections.supply.bias_current)

    def update(self, sections: LawSections) -> None:
        """Nothing of other sections changes in a trial."""

    def sense(self, signals: Signals, estimate: Estimate) -> None:
        """Keep the heat balance."""
        thermal, latent_K = self._thermal, self._calibration.power.latent_rise
        if isfinite(signals.stress_Pa):
            self._stress_Pa = signals.stress_Pa
        if signals.resistance_Ohm > 0.0:
            self._resistance_Ohm = signals.resistance_Ohm
        if isfinite(estimate.displacement_m):
            self._share = self._calibration.share_of_stroke(estimate.displacement_m, self._stress_Pa)
        settled_K = max(signals.power_W, 0.0) / thermal.heat_loss - latent_K * self._share
        step_s, self._time_s = signals.time_s - self._time_s, signals.time_s
        if not isfinite(self._heat_K):
            self._heat_K = settled_K
        elif step_s > 0.0:
            decay = exp(-step_s * thermal.heat_loss / thermal.heat_capacity)
            self._heat_K = settled_K + (self._heat_K - settled_K) * decay
        self._above_K = self._heat_K + latent_K * self._share

    def _holds_A(self) -> float:
        """The current that would hold the wire as warm as it is."""
        if not self._resistance_Ohm > 0.0:
            return self.bias_A
        return sqrt(max(self._thermal.heat_loss * self._above_K, 0.0) / self._resistance_Ohm)

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """As that of the PID."""
        if self.at_max or self.at_bias:
            self.integral_A = self._holds_A()
        return super().step(position_m, setpoint_m, dt_s, limit_A)


@CONTROL_LAWS.register("sliding_mode")
@dataclass(frozen=True, slots=True)
class SlidingModeParameters(PidParameters):
    """Only the ratio kd/kp and the filter of the derivative count: it makes the sliding surface."""

    def build(self, sections: LawSections) -> SlidingMode:
        """The law."""
        return SlidingMode(self, sections)


class SlidingMode(HeldHeat):
    """The current that holds the present heat, and all that the limits leave on the side of the surface where the wire
    has to go; within a layer about the surface in proportion, so that it does not chatter."""

    def __init__(self, gains: PidParameters, sections: LawSections):
        self._gain_A_m = sections.supply.max_current / (LAYER * sections.wire.full_stroke_m)
        super().__init__(gains, sections)

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """The PID keeps reference and velocity."""
        super().step(position_m, setpoint_m, dt_s, limit_A)
        if not isfinite(position_m + setpoint_m):
            return self.bias_A
        surface_m = self.error_m + self.gains.kd / self.gains.kp * self.velocity_m_s
        self.output_A = min(max(self._holds_A() + self._gain_A_m * surface_m, self.bias_A), limit_A)
        return self.output_A
