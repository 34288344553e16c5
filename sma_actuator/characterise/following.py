"""A wire driven by its own model while it is characterised: the loop of the actuator, without its limits.

Those of the rig stand behind it; the estimate, the law and its gains are those that will drive the wire, and so is
what tells that the heat limit holds it back.
"""

from __future__ import annotations

from math import isfinite, nan

from sma_actuator.base.signals import Estimate, Quality, Signals
from sma_actuator.config import Config
from sma_actuator.control.law import SensingLaw
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.circuit import without_undriven
from sma_actuator.safety.reach import Places, Reach

from .programs import HELD_BACK

#: A current that is so many times what rests the wire heats it.
_HEATS = 1.2


class ModelFollower:
    """Estimate and law of a parameter file; remembers the wire's past."""

    def __init__(self, config: Config):
        self._config = config
        self._chain = Chain(config)
        self._law = config.controller.build(config)
        self._before_s = nan
        self._places = Places(config.calibration, config.wire.full_stroke_m)
        self._reach = Reach(config.wire.full_stroke_m, config.thermal.balance)
        self.rest_A = self._asked_A = config.supply.bias_current
        self.held_back = False  #: see :class:`~sma_actuator.characterise.programs.Following`

    def __call__(self, signals: Signals, setpoint_m: float) -> float:
        """The current [A]; what rests the wire while it is asked to be nowhere, or cannot be told where it is."""
        self._asked_A = self._current_A(signals, setpoint_m)
        return self._asked_A

    def _current_A(self, signals: Signals, setpoint_m: float) -> float:
        seen, estimate = self._chain.step(without_undriven(signals, self.rest_A))
        dt_s, self._before_s = signals.time_s - self._before_s, signals.time_s
        if isinstance(self._law, SensingLaw):
            self._law.sense(seen, estimate)
        self.held_back = self._is_held_back(seen, estimate, setpoint_m)
        if estimate.quality is Quality.INVALID:
            return self.rest_A
        if not isfinite(dt_s + setpoint_m):
            self._law.reset(estimate.displacement_m, self.rest_A)
            return self.rest_A
        return self._law.step(estimate.displacement_m, setpoint_m, dt_s, self._config.supply.max_current)

    def _is_held_back(self, seen: Signals, estimate: Estimate, setpoint_m: float) -> bool:
        """Whether, far from the setpoint, it stands with less than was asked for, and needs more by its calibration."""
        if not isfinite(setpoint_m):
            self._reach.forget()
            return False
        thermal, room_C = self._config.thermal, seen.ambient_temperature_C
        self._reach.step(
            seen.time_s,
            estimate.displacement_m,
            setpoint_m,
            at_max=False,
            at_limit=_HEATS * self.rest_A < seen.current_A < HELD_BACK * self._asked_A,
            power_W=max(0.0, seen.power_W),
            load_N=seen.load_N,
            heat=self._places.needed(
                estimate.displacement_m,
                estimate.uncertainty_m,
                seen.stress_Pa,
                room_C if isfinite(room_C) else thermal.ambient_temperature,
                thermal.heat_loss,
            ),
        )
        return self._reach.held_back
