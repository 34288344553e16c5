"""The hidden twin of the effect: a virtual bench whose voltage channel is not what everybody thinks."""

from __future__ import annotations

import numpy as np

from sma_actuator.bench import TWINS, Hidden
from sma_actuator.bench.hidden import VOLTAGE


@TWINS.register("voltage_gain")
class WrongSlope(Hidden):
    """The channel shows this share more than the supply voltage."""

    unit, where = "1", "circuit"

    def read(self, rows: np.ndarray, time_s: np.ndarray) -> None:
        """What is so stays as it is."""
        rows[:, VOLTAGE] *= 1.0 + self.strength
