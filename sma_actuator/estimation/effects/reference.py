"""What the reference sensor may do: the witness is wrong, not the model.

These turn the displacement into what the sensor shows.  They serve to find such a fault; the live
estimate is never changed by them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter

from .effect import EFFECTS, Effect
from .frame import Frame, Place, settled_s
from .free import Free, Scales, settling, shape, size, too_slow

PAST = 1024  #: samples that a late channel is behind at the most: 10 s at 100 Hz


@EFFECTS.register("reference_lag")
@dataclass(frozen=True, slots=True)
class ReferenceLag(Effect):
    """The sensor follows with a first-order lag."""

    PART = "reference"
    WORDS = "the reference sensor lags"
    REMEDY = "Switch off the reference sensor's filter, or log it faster; the model is not at fault."
    TELL_TALE = "resistance_rate_Ohm_s"
    STATES = 2
    time_constant: float = parameter(1e-3, "its lag", "s", 1e-6, 1e3)

    def shown(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the sensor shows."""
        frame.displacement_m = frame.lag(frame.displacement_m, state, self.time_constant)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [shape("time_constant", 1e-3, 5.0, 0.1, 0.5)]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return too_slow(scales, "a lag")


@EFFECTS.register("reference_gain")
@dataclass(frozen=True, slots=True)
class ReferenceGain(Effect):
    """The slope of the sensor is not the calibrated one."""

    PART = "reference"
    WORDS = "the reference sensor shows too much or too little in proportion"
    REMEDY = "Calibrate the reference sensor again with gauge blocks; the model is not at fault."
    TELL_TALE = "displacement_m"
    gain: float = parameter(0.0, "displacement shown over true displacement, less one", "1", -0.9, 9.0)
    pivot: float = parameter(0.0, "displacement that is shown right", "m", -10.0, 10.0)

    def shown(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the sensor shows."""
        frame.displacement_m = frame.displacement_m + self.gain * (frame.displacement_m - self.pivot)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        # A gain of the electronics turns about the sensor's electrical zero, one of the mechanics about the
        # calibration's.
        zero_m = scales.reference_zero_m
        low_m, high_m = min(zero_m, 0.0) - 1e-9, max(zero_m, 0.0) + 1e-9
        return [size("gain", 0.5, 0.03), Free("pivot", low_m, high_m, scales.stroke_m, (0.0, zero_m), False)]


@EFFECTS.register("reference_nonlinearity")
@dataclass(frozen=True, slots=True)
class ReferenceNonlinearity(Effect):
    """The sensor is not straight, as beyond the linear part of its range: a parabola, right at two places."""

    PART = "reference"
    WORDS = "the reference sensor is not straight"
    REMEDY = (
        "Calibrate the reference sensor again with gauge blocks at five or more places, and mount it so that the "
        "stroke lies in the middle of its range; the model is not at fault."
    )
    TELL_TALE = "displacement_m"
    bend: float = parameter(0.0, "displacement shown too much per distance from both places", "1/m", -1e4, 1e4)
    low: float = parameter(0.0, "displacement that is shown right", "m", -10.0, 10.0)
    high: float = parameter(0.0, "another displacement that is shown right", "m", -10.0, 10.0)

    def shown(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the sensor shows."""
        true_m = frame.displacement_m
        frame.displacement_m = true_m + self.bend * (true_m - self.low) * (true_m - self.high)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        stroke_m = scales.stroke_m
        return [
            size("bend", 2.0 / stroke_m, 0.1 / stroke_m),
            # A sensor may have twice the stroke as its range, and the stroke may lie anywhere in that.
            Free("low", -stroke_m, 0.5 * stroke_m, stroke_m, (0.0,), False),
            Free("high", 0.5 * stroke_m, 2.0 * stroke_m, stroke_m, (stroke_m,), False),
        ]


@EFFECTS.register("reference_drift")
@dataclass(frozen=True, slots=True)
class ReferenceDrift(Effect):
    """The zero of the sensor moved since its calibration, and goes on moving."""

    PART = "reference"
    WORDS = "the zero of the reference sensor has moved, or moves"
    REMEDY = "Re-zero the reference sensor with the wire cold, and let it warm up before; the model is not at fault."
    TELL_TALE = "time_s"
    offset: float = parameter(0.0, "displacement shown too much when the session began", "m", -1.0, 1.0)
    rate: float = parameter(0.0, "its change with time, at first", "m/s", -1.0, 1.0)
    time_constant: float = parameter(1e12, "how slowly it settles", "s", 1.0, 1e12)

    def shown(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the sensor shows."""
        drift_m = self.offset + self.rate * settled_s(frame.elapsed_s, self.time_constant)
        frame.displacement_m = frame.displacement_m + drift_m

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        stroke_m = scales.stroke_m
        return [
            size("offset", stroke_m, 0.02 * stroke_m),
            size("rate", stroke_m / scales.duration_s, 0.02 * stroke_m / scales.duration_s),
            settling(scales),
        ]


@EFFECTS.register("channel_delay")
@dataclass(frozen=True, slots=True)
class ChannelDelay(Effect):
    """The displacement is logged on another clock than current and voltage: every reading of it is late (or early).

    What was is remembered, as many samples as PAST; what will be is known only as far as the log goes.
    """

    PART = "reference"
    WORDS = "the displacement is logged late, or early, against the other channels"
    REMEDY = "Log all channels on one clock, or shift the displacement's times by the delay; the model is not at fault."
    TELL_TALE = "resistance_rate_Ohm_s"
    STATES = 2 * PAST
    delay: float = parameter(0.0, "how late the displacement is logged", "s", -100.0, 100.0)

    def shown(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the sensor shows: what was so long ago.  Before and after what is known it stands."""
        past, good = state.reshape(2, PAST), np.isfinite(frame.displacement_m)
        now = np.stack((frame.elapsed_s[good], frame.displacement_m[good]))
        known = np.concatenate((past[:, np.isfinite(past[0])], now), axis=1)
        if known.size:
            was_m = np.interp(frame.elapsed_s - self.delay, *known)
            frame.displacement_m = np.where(good, was_m, frame.displacement_m)
        latest = known[:, -PAST:]
        past[:, PAST - latest.shape[1] :] = latest

    def forget_the_loop(self, state: np.ndarray) -> None:
        """Where the joint was before a pause says nothing of what is shown after it."""
        state[:] = np.nan

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("delay", min(10.0, 0.2 * scales.duration_s), 0.5)]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return too_slow(scales, "a delay")


@EFFECTS.register("current_feedthrough")
@dataclass(frozen=True, slots=True)
class CurrentFeedthrough(Effect):
    """The current that drives the wire gets into the sensor's signal: what it shows steps with the current."""

    PART = "reference"
    WORDS = "the reference sensor moves in step with the drive current"
    REMEDY = (
        "Lead the sensor's cable away from the current's, shield and ground it at one end, and give it a supply "
        "of its own; the model is not at fault."
    )
    TELL_TALE = "power_W"
    coupling: float = parameter(0.0, "displacement shown too much per ampere", "m/A", -10.0, 10.0)

    def shown(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """What the sensor shows."""
        frame.displacement_m = frame.displacement_m + self.coupling * frame.current_A

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        per_A = scales.stroke_m / scales.current_A
        return [size("coupling", 0.5 * per_A, 0.02 * per_A)]
