"""What lies between the wire and the place where its displacement counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter

from .effect import Effect
from .frame import Frame, Place, play


@dataclass(frozen=True, slots=True)
class Slip(Effect):
    """The wire slipped in its crimp once: from then on every position is longer by a length."""

    STAGE = "mechanism"
    STATES = 0
    length: float = parameter(0.0, "length that slipped through", "m", -1.0, 1.0)
    time: float = parameter(0.0, "when, since the session began", "s", 0.0, 1e9)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Add the length from then on."""
        frame.displacement_m = frame.displacement_m + self.length * (frame.elapsed_s >= self.time)


@dataclass(frozen=True, slots=True)
class Backlash(Effect):
    """Play between wire and joint: at a reversal the joint waits until the play is taken up."""

    STAGE = "mechanism"
    STATES = 1
    width: float = parameter(0.0, "free play from side to side", "m", 0.0, 1.0)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the joint follows."""
        joint_m = np.empty(len(frame.displacement_m))
        play(np.ascontiguousarray(frame.displacement_m), state, 0.5 * self.width, joint_m)
        frame.displacement_m = joint_m
