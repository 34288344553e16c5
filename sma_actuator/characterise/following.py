"""A wire driven by its own model while it is characterised: the loop of the actuator, without its limits.

Those of the rig stand behind it; the estimate, the law and its gains are those that will drive the wire.
"""

from __future__ import annotations

from math import isfinite, nan

from sma_actuator.base.signals import Quality, Signals
from sma_actuator.config import Config
from sma_actuator.control.law import SensingLaw
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.circuit import without_undriven


class ModelFollower:
    """Estimate and law of a parameter file; remembers the wire's past."""

    def __init__(self, config: Config):
        self._config = config
        self._chain = Chain(config)
        self._law = config.controller.build(config)
        self._before_s = nan
        self.rest_A = config.supply.bias_current

    def __call__(self, signals: Signals, setpoint_m: float) -> float:
        """The current [A]; what rests the wire while it is asked to be nowhere, or cannot be told where it is."""
        seen, estimate = self._chain.step(without_undriven(signals, self.rest_A))
        dt_s, self._before_s = signals.time_s - self._before_s, signals.time_s
        if isinstance(self._law, SensingLaw):
            self._law.sense(seen, estimate)
        if estimate.quality is Quality.INVALID:
            return self.rest_A
        if not isfinite(dt_s + setpoint_m):
            self._law.reset(estimate.displacement_m, self.rest_A)
            return self.rest_A
        return self._law.step(estimate.displacement_m, setpoint_m, dt_s, self._config.supply.max_current)
