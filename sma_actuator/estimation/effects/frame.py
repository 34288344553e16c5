"""What an effect sees and changes: the signals of n samples, and the kernels that several effects share."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from math import isnan, nan
from typing import Any

import numpy as np

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.jit import jit
from sma_actuator.base.signals import Signals
from sma_actuator.estimation.lag import lag


@dataclass(frozen=True, slots=True)
class Place:
    """Where a wire is mounted; what effects need to know of the configuration."""

    reference_resistance_Ohm: float
    lead_resistance_Ohm: float
    area_m2: float
    length_m: float
    heat_loss_W_K: float
    ambient_C: float  #: where none is measured
    working_range_m: tuple[float, float]
    resistance_range_Ohm: float = nan  #: of the calibration; NaN where it is not known
    stroke: Calibration | None = None  #: what knows the ends of the stroke by stress, where something does

    def __deepcopy__(self, memo: dict[int, object]) -> Place:
        """Itself: nothing in it changes, and a calibration's tables are what takes longest to copy of a chain."""
        return self

    def share_of_stroke(self, frame: Frame) -> np.ndarray:
        """How far the wire is between the contracted (0) and the cold end (1) of its stroke, shape (n,)."""
        if self.stroke is not None:
            return self.stroke.share_of_stroke(frame.displacement_m, frame.load_N / self.area_m2)
        hot_m, cold_m = self.working_range_m
        return (frame.displacement_m - hot_m) / (cold_m - hot_m)

    def share_by_resistance(self, frame: Frame) -> np.ndarray:
        """The same, roughly, by its resistance: where the displacement is not estimated yet; 0 where the ends are not
        known."""
        known = self.stroke
        if known is None or not (known.hot_end.contracted_resistance and known.rest.cold_resistance):
            return np.zeros(len(frame.resistance_Ohm))
        return known.share_by_resistance(frame.resistance_Ohm, frame.load_N / self.area_m2)


@dataclass(slots=True)
class Frame:
    """Signals of n samples, arrays of shape (n,); effects change them in place, stage after stage.

    ``displacement_m`` and ``heating`` are there from the strain model on, ``cycles`` from a counter on.
    """

    elapsed_s: np.ndarray  #: since the session began
    resistance_Ohm: np.ndarray
    current_A: np.ndarray
    power_W: np.ndarray
    load_N: np.ndarray
    ambient_C: np.ndarray
    before_s: float = 0.0  #: how long the sessions before this one lasted
    heating: np.ndarray = None  # type: ignore[assignment]  # not yet
    displacement_m: np.ndarray = None  # type: ignore[assignment]
    cycles: np.ndarray = None  # type: ignore[assignment]

    @classmethod
    def of(cls, signals: Signals, start_s: float, before_s: float = 0.0) -> Frame:
        """The frame of n samples (arrays) or of one (floats) of a session that began at ``start_s``, after others that
        had lasted ``before_s``."""
        return cls(
            elapsed_s=np.maximum(np.atleast_1d(signals.time_s) - start_s, 0.0),  # a clock may be set back
            resistance_Ohm=np.atleast_1d(signals.resistance_Ohm),
            current_A=np.atleast_1d(signals.current_A),
            power_W=np.atleast_1d(signals.power_W),
            load_N=np.atleast_1d(signals.load_N),
            ambient_C=np.atleast_1d(signals.ambient_temperature_C),
            before_s=before_s,
        )

    def rows(self, chosen: np.ndarray) -> Frame:
        """The frame with some of its samples only (bool, shape (n,))."""
        values: dict[str, Any] = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        there = {name: np.broadcast_to(v, chosen.shape)[chosen] for name, v in values.items() if v is not None}
        return Frame(**there)

    def lag(self, values: np.ndarray, state: np.ndarray, time_constant_s: float, from_zero: bool = False) -> np.ndarray:
        """``values`` through a first-order lag, shape (n,); ``state`` (2,) is NaN before the first sample.

        It starts in balance with the first value, or at zero.  A sample that is not finite leaves it standing.
        """
        out = np.empty(len(values))
        lag(self.elapsed_s, np.ascontiguousarray(values), state, time_constant_s, from_zero, out)
        return out


def settled_s(elapsed_s: np.ndarray, time_constant_s: float) -> np.ndarray:
    """For how long what settles moved as fast as at first, to be where it is [s]: ``τ (1 − e^(−t/τ))``."""
    return -time_constant_s * np.expm1(-elapsed_s / time_constant_s)


@jit
def play(values: np.ndarray, state: np.ndarray, half_width: float, out: np.ndarray) -> None:
    """The play operator: ``out`` follows ``values`` only where they are ``half_width`` away; ``state`` (2,)."""
    for i in range(len(values)):
        x = values[i]
        if isnan(state[0]):
            state[0] = x
        else:
            state[0] = min(max(state[0], x - half_width), x + half_width)
        out[i] = state[0]


@jit
def count_cycles(power: np.ndarray, state: np.ndarray, threshold: float, out: np.ndarray) -> None:
    """Number of the heating cycle, from 1; one begins where the power rises above ``threshold``; ``state`` (2,)."""
    for i in range(len(power)):
        if isnan(state[0]):
            state[0], state[1] = 0.0, 1.0
            if power[i] > threshold:
                state[0] = 1.0
        elif state[0] > 0.5:
            if power[i] < 0.8 * threshold:
                state[0] = 0.0
        elif power[i] > 1.2 * threshold:
            state[0] = 1.0
            state[1] += 1.0
        out[i] = state[1]


#: Share of its range that the resistance moves back before a wire has turned, and again until its branch has begun.
TURNED = 0.01


@jit
def incompleteness(
    heating: np.ndarray,
    share: np.ndarray,
    resistance: np.ndarray,
    state: np.ndarray,
    missing: np.ndarray,
    begun: np.ndarray,
) -> None:
    """How far from its end the last transformation turned back (0 at the end, 1 where it did not begin), and whether
    the next has begun.

    ``share`` of the stroke and ``resistance`` over its range fall on heating.  The current turns first; the wire has
    where the resistance goes back.  ``missing`` is positive on cooling (heating was incomplete), negative on heating
    (cooling was); ``begun`` goes from 0 to 1 where the wire leaves the turn.  ``state`` (5,) = [branch, missing,
    resistance farthest along it, share there, resistance at its turn].
    """
    for i in range(len(share)):
        s, r = share[i], resistance[i]
        if isnan(s) or isnan(r):
            missing[i], begun[i] = 0.0, 0.0
            continue
        now = 1.0 if heating[i] else 0.0
        if isnan(state[0]):
            state[0], state[1], state[2], state[3], state[4] = now, 0.0, r, s, r
        back = r - state[2] if state[0] > 0.5 else state[2] - r
        if now != state[0] and back > TURNED:
            left = min(max(state[3] if now < 0.5 else 1.0 - state[3], 0.0), 1.0)
            state[0], state[1] = now, left if now < 0.5 else -left
            state[4], state[2], state[3] = state[2], r, s
        elif back < 0.0:
            state[2], state[3] = r, s
        missing[i] = state[1]
        begun[i] = min(max(abs(r - state[4]) / TURNED - 1.0, 0.0), 1.0)
