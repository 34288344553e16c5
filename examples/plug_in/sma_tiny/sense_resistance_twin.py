"""The hidden twin of the effect: a virtual bench whose sense resistor is not what everybody thinks."""

from __future__ import annotations

import numpy as np

from sma_actuator.bench import TWINS, Hidden
from sma_actuator.bench.hidden import CURRENT
from sma_actuator.plant import physics


@TWINS.register("sense_resistance")
class WrongResistor(Hidden):
    """The resistor has more than its nominal resistance by this share, and so has the voltage over it."""

    unit, where = "1", "circuit"

    def drive(self, inputs: np.ndarray, time_s: float) -> None:
        """The circuit has more resistance."""
        inputs[physics.MORE_SERIES] += self.strength * self.bench.setup.chain.reference_resistance_Ohm

    def read(self, rows: np.ndarray, time_s: np.ndarray) -> None:
        """The same current makes more voltage."""
        rows[:, CURRENT] *= 1.0 + self.strength
