"""What the reference sensor may do: the witness is wrong, not the model.

These turn the displacement into what the sensor shows.  They serve to find such a fault; the live
estimate is never changed by them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter

from .effect import Effect
from .frame import Frame, Place


@dataclass(frozen=True, slots=True)
class ReferenceLag(Effect):
    """The sensor follows with a first-order lag."""

    STAGE = "reference"
    STATES = 2
    time_constant: float = parameter(1e-3, "its lag", "s", 1e-6, 1e3)

    def shown(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the sensor shows."""
        frame.displacement_m = frame.lag(frame.displacement_m, state, self.time_constant)


@dataclass(frozen=True, slots=True)
class ReferenceGain(Effect):
    """The slope of the sensor is not the calibrated one."""

    STAGE = "reference"
    STATES = 0
    gain: float = parameter(0.0, "displacement shown over true displacement, less one", "1", -0.9, 9.0)
    pivot: float = parameter(0.0, "displacement that is shown right", "m", -10.0, 10.0)

    def shown(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the sensor shows."""
        frame.displacement_m = frame.displacement_m + self.gain * (frame.displacement_m - self.pivot)


@dataclass(frozen=True, slots=True)
class ReferenceDrift(Effect):
    """The zero of the sensor moved since its calibration, and goes on moving."""

    STAGE = "reference"
    STATES = 0
    offset: float = parameter(0.0, "displacement shown too much when the session began", "m", -1.0, 1.0)
    rate: float = parameter(0.0, "its change with time", "m/s", -1.0, 1.0)

    def shown(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the sensor shows."""
        frame.displacement_m = frame.displacement_m + self.offset + self.rate * frame.elapsed_s
