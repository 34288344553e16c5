"""Between which displacements a wire can be held at the load that it carries, by its calibration.

A model's working range is one for all loads of its calibration; at one of them a wire goes less far, or further.
"""

from __future__ import annotations

from math import exp, inf, isfinite, nan
from typing import Protocol

import numpy as np

from sma_actuator.base.calibration import Calibration, through
from sma_actuator.base.jit import Floats, jit
from sma_actuator.base.lookup import looked_up, row_of, values_of

#: Time over which the stress is averaged: a load cell's noise does not move an end.
SMOOTH_s = 0.5
_PLACES = 41  #: stresses at which the ends are worked out beforehand; between them they are straight
_BEYOND = 0.25  #: share of the calibration's range of stress that they go on for at either end
#: What is looked up: either end by the stress, and the temperatures of the heating wire by the share of its stroke.
_SHORT, _LONG, _HEATING = range(3)


class EndsSections(Protocol):
    """The parameters that tell where the ends are."""

    @property
    def calibration(self) -> Calibration:
        """What the model's own logs looked like."""


class Ends:
    """The ends of one wire at the load that it carries.

    ``range_m``: the model's working range; ``whole``: the model follows the wire to both ends of its stroke, at any
    load.
    """

    def __init__(self, sections: EndsSections, range_m: tuple[float, float], whole: bool):
        calibration, hot_end, rest = sections.calibration, sections.calibration.hot_end, sections.calibration.rest
        self._range_m, self._whole = range_m, whole
        self.known = calibration.ends_known
        self._stress_Pa = nan
        if self.known:
            stresses_Pa = (*hot_end.contracted_stress, *rest.cold_stress)
            low_Pa, high_Pa = min(stresses_Pa), max(stresses_Pa)
            beyond_Pa = _BEYOND * (high_Pa - low_Pa)
            at_Pa = np.unique((*np.linspace(low_Pa - beyond_Pa, high_Pa + beyond_Pa, _PLACES), *stresses_Pa))
            short_m, long_m = (through(nodes, values, at_Pa).tolist() for nodes, values in calibration.ends)
            power = calibration.power
            self._shift_K_Pa = power.transformation_shift[1] if power.transformation_shift else nan
            heating = power.heating if power.transformation_shift else ((), ())
            self._row = row_of((at_Pa.tolist(), short_m), (at_Pa.tolist(), long_m), heating)

    def step(self, stress_Pa: float, dt_s: float) -> None:
        """Take note of a stress, NaN where there is none."""
        if not isfinite(stress_Pa):
            return
        if not isfinite(self._stress_Pa):
            self._stress_Pa = stress_Pa
        elif 0.0 <= dt_s < inf:
            self._stress_Pa += (1.0 - exp(-dt_s / SMOOTH_s)) * (stress_Pa - self._stress_Pa)

    def range_m(self, most_rise_K: float, ambient_C: float, longer_m: float = 0.0) -> tuple[float, float]:
        """Shortest and longest displacement that can be held now, in a wire that may be held ``most_rise_K`` above its
        surroundings; the model's working range where nobody knows more.

        ``longer_m``: what its martensite is longer than if all of it had formed under the present load: under a spring
        that is at the long end.  What is shorter is as long as any once it has contracted.
        """
        if not (self.known and isfinite(self._stress_Pa)):
            return self._range_m
        return _range_m(
            self._row,
            self._stress_Pa,
            most_rise_K,
            ambient_C,
            self._shift_K_Pa,
            *self._range_m,
            self._whole,
            max(longer_m, 0.0),
        )


@jit
def _range_m(
    row: Floats,
    stress_Pa: float,
    most_rise_K: float,
    ambient_C: float,
    shift_K_Pa: float,
    low_m: float,
    high_m: float,
    whole: bool,
    longer_m: float,
) -> tuple[float, float]:
    """See :meth:`Ends.range_m`."""
    short_m, long_m = looked_up(row, _SHORT, stress_Pa), looked_up(row, _LONG, stress_Pa)
    if not short_m < long_m:
        return low_m, high_m
    share = _share_held(row, shift_K_Pa * stress_Pa, most_rise_K, ambient_C)
    short_m += share * (long_m - short_m)
    long_m += longer_m
    if not whole:
        short_m, long_m = max(short_m, low_m), min(long_m, high_m)
    return (short_m, long_m) if short_m < long_m else (low_m, high_m)


@jit
def _share_held(row: Floats, shifted_K: float, most_rise_K: float, ambient_C: float) -> float:
    """The least share of the stroke that so much heat holds, 0 where it is enough, or where nobody knows."""
    before_K = inf
    first, count = values_of(row, _HEATING)
    for place in range(count):
        away_K = row[first + place] + shifted_K - ambient_C - most_rise_K
        if away_K <= 0.0:
            return (place - 1 + before_K / (before_K - away_K)) / (count - 1) if place else 0.0
        before_K = away_K
    return 1.0 if count else 0.0
