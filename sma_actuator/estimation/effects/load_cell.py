"""What the load cell may do to the load, and with it to the stress the model sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter

from .effect import EFFECTS, Effect
from .frame import Frame, Place, settled_s
from .free import Free, Scales, settling, size


@EFFECTS.register("load_cell_drift")
@dataclass(frozen=True, slots=True)
class LoadCellDrift(Effect):
    """The zero of the load cell moved since its calibration, and goes on moving (thesis, app. A: it drifts)."""

    PART = "load cell"
    WORDS = "the zero of the load cell has moved, or moves"
    REMEDY = "Re-zero the load cell (~/tare_load) with nothing hanging on the wire, and let it warm up before."
    TELL_TALE = "time_s"
    offset: float = parameter(0.0, "load shown at no load when the session began", "N", -1e5, 1e5)
    rate: float = parameter(0.0, "its change with time, at first", "N/s", -1e3, 1e3)
    time_constant: float = parameter(1e12, "how slowly it settles", "s", 1.0, 1e12)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Take the zero's movement off."""
        frame.load_N = frame.load_N - self.offset - self.rate * settled_s(frame.elapsed_s, self.time_constant)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [
            size("offset", 2.0 * scales.load_N, 0.1 * scales.load_N),
            size("rate", 2.0 * scales.load_N / scales.duration_s, 0.1 * scales.load_N / scales.duration_s),
            settling(scales),
        ]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return "" if scales.model_feels_stress else "the model hardly depends on stress at this load"


@EFFECTS.register("load_cell_gain")
@dataclass(frozen=True, slots=True)
class LoadCellGain(Effect):
    """The slope of the load cell is not the calibrated one."""

    PART = "load cell"
    WORDS = "the load cell shows too much or too little in proportion"
    REMEDY = "Calibrate the load cell again with two known masses."
    TELL_TALE = "stress_Pa"
    gain: float = parameter(0.0, "load shown over true load, less one", "1", -0.9, 9.0)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """Divide by the slope's error."""
        frame.load_N = frame.load_N / (1.0 + self.gain)

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        return [size("gain", 0.6, 0.1)]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        return "" if scales.model_feels_stress else "the model hardly depends on stress at this load"


@EFFECTS.register("load_cell_nonlinearity")
@dataclass(frozen=True, slots=True)
class LoadCellNonlinearity(Effect):
    """The load cell bends: it shows ``F + b F²``, so its slope is right for small loads only."""

    PART = "load cell"
    WORDS = "the load cell is not straight: it shows large loads too large or too small"
    REMEDY = "Calibrate the load cell with three or more known masses, up to the largest load; renew one that bends."
    TELL_TALE = "stress_Pa"
    bend: float = parameter(0.0, "load shown too much per load squared", "1/N", -1e3, 1e3)

    def measured(self, frame: Frame, state: np.ndarray, place: Place) -> None:
        """The load of which it shows this."""
        inside = np.maximum(1.0 + 4.0 * self.bend * frame.load_N, 0.0)  # beyond, no load shows so much
        frame.load_N = 2.0 * frame.load_N / (1.0 + np.sqrt(inside))

    @classmethod
    def free(cls, scales: Scales) -> list[Free]:
        """What a fit may vary."""
        # Where 1 + 4bF vanishes no more load is shown: a fit that came beyond would stay there.
        return [size("bend", 0.6 / scales.load_N, 0.1 / scales.load_N, -0.24 / scales.most_load_N)]

    @classmethod
    def untestable(cls, scales: Scales) -> str:
        """Why logs could not show it."""
        if not scales.model_feels_stress:
            return "the model hardly depends on stress at this load"
        return "" if scales.loads_differ else "under one load a bent load cell shows too much in proportion, as any"
