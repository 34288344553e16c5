"""What lies between the wire and the place where its displacement counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter

from .effect import EFFECTS, Effect
from .frame import Frame, Place, play
from .free import Free, Scales, shape, size


@EFFECTS.register("slip")
@dataclass(frozen=True, slots=True)
class Slip(Effect):
    """The wire slipped in its crimp once: from then on every position is longer by a length."""

    PART = "mechanism"
    WORDS = "the wire slipped in its crimp"
    REMEDY = "Tighten or renew the crimp, zero the position, and calibrate again."
    TELL_TALE = "time_s"
    SCANNED = "time"
    length: float = parameter(0.0, "length that slipped through", "m", -1.0, 1.0)
    time: float = parameter(0.0, "when, in the sessions one after the other", "s", 0.0, 1e9)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Add the length from then on."""
        frame.displacement_m = frame.displacement_m + self.length * (frame.before_s + frame.elapsed_s >= self.time)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("length", scales.stroke_m, 0.02 * scales.stroke_m)]


@EFFECTS.register("backlash")
@dataclass(frozen=True, slots=True)
class Backlash(Effect):
    """Play between wire and joint: at a reversal the joint waits until the play is taken up."""

    PART = "mechanism"
    WORDS = "there is play between the wire and the joint"
    REMEDY = "Take the play out of the joint, or preload it so that it always pulls the same way."
    TELL_TALE = "distance_from_reversal_m"
    BEHIND_THE_LOAD = True
    STATES = 1
    width: float = parameter(0.0, "free play from side to side", "m", 0.0, 1.0)

    def at_displacement(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the joint follows."""
        joint_m = np.empty(len(frame.displacement_m))
        play(np.ascontiguousarray(frame.displacement_m), state, 0.5 * self.width, joint_m)
        frame.displacement_m = joint_m

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        stroke_m = scales.stroke_m
        return [shape("width", 1e-4 * stroke_m, 0.5 * stroke_m, 0.02 * stroke_m, 0.06 * stroke_m, 0.15 * stroke_m)]
