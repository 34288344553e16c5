"""What the load cell may do to the load, and with it to the stress the model sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter

from .effect import Effect
from .frame import Frame, Place


@dataclass(frozen=True, slots=True)
class LoadCellDrift(Effect):
    """The zero of the load cell moved since its calibration, and goes on moving (thesis, app. A: it drifts)."""

    STAGE = "load cell"
    STATES = 0
    offset: float = parameter(0.0, "load shown at no load when the session began", "N", -1e5, 1e5)
    rate: float = parameter(0.0, "its change with time", "N/s", -1e3, 1e3)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the zero's movement off."""
        frame.load_N = frame.load_N - self.offset - self.rate * frame.elapsed_s


@dataclass(frozen=True, slots=True)
class LoadCellGain(Effect):
    """The slope of the load cell is not the calibrated one."""

    STAGE = "load cell"
    STATES = 0
    gain: float = parameter(0.0, "load shown over true load, less one", "1", -0.9, 9.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Divide by the slope's error."""
        frame.load_N = frame.load_N / (1.0 + self.gain)
