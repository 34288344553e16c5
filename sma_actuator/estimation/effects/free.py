"""What a fit may vary of an effect, in the measures of the logs that it is fitted on.

Bounds are shares of the logs' own scales (stroke, resistance, load, power, duration), so they hold
for any wire.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SLOWEST_s = 0.5  #: between two readings that show when the joint moves


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """Sizes of what some logs hold, and what they could show."""

    stroke_m: float
    resistance_Ohm: float
    resistance_range_Ohm: float
    current_A: float
    voltage_V: float
    load_N: float
    most_load_N: float  #: that is shown
    power_W: float
    rise_K: float  #: above ambient, at that power
    duration_s: float
    period_s: float
    cycles: int
    cycle_power_W: float  #: between cold and hot
    thermal_s: float  #: C/h of the wire
    heat_loss_W_K: float
    latent_heat_J: float  #: set free over the whole stroke; 0 where the calibration does not say
    sense_Ohm: float
    reference_zero_m: float  #: displacement where the reference sensor shows nothing
    ambient_logged: bool
    ambient_change_K: float  #: within the logs, or against the calibration
    calibration_ambient_known: bool
    calibration_ambient_C: float  #: that of the configuration where it is not known
    loads_differ: bool
    model_feels_stress: bool
    partial_cycles: bool
    power_known: bool  #: what it takes to transform the wire, from the calibration
    calibration_counts: bool  #: what was there at the calibration is looked for too


@dataclass(frozen=True, slots=True)
class Free:
    """One parameter that a fit may vary."""

    name: str
    low: float
    high: float
    typical: float  #: of a size parameter, before the logs: it is varied in units of that
    starts: tuple[float, ...] = ()  #: of a shape parameter (time constant …), which alone changes nothing
    logarithmic: bool = True  #: whether a shape parameter is varied as its logarithm
    #: Ends, "low" or "high", at which the effect is another one: a contact that has drifted at once is a lead.  A size
    #: has them wherever it may not be larger.
    other_at: tuple[str, ...] = ()

    @property
    def is_size(self) -> bool:
        """Whether the effect is in proportion to it, and absent at zero."""
        return not self.starts

    def to_unit(self, value: float) -> float:
        """The number the optimiser sees."""
        return math.log(value) if self.starts and self.logarithmic else value / self.typical

    def from_unit(self, u: float) -> float:
        """Back from it, inside the bounds."""
        value = math.exp(u) if self.starts and self.logarithmic else u * self.typical
        return min(max(value, self.low), self.high)


def size(name: str, limit: float, typical: float, low: float | None = None, other_at: tuple[str, ...] = ()) -> Free:
    """A parameter that the effect is in proportion to, within ± ``limit`` (or from ``low``)."""
    return Free(name, -limit if low is None else low, limit, typical, other_at=other_at)


def shape(name: str, low: float, high: float, *starts: float, other_at: tuple[str, ...] = ()) -> Free:
    """A parameter that alone changes nothing, with the values from which a fit starts."""
    return Free(name, low, high, 1.0, tuple(min(max(start, low), high) for start in starts), other_at=other_at)


def settling(scales: Scales) -> Free:
    """How slowly a zero that moves comes to rest: as electronics that warm up do, or not within the logs."""
    slow_s = scales.duration_s
    return shape("time_constant", 0.05 * slow_s, 5.0 * slow_s, 4.0 * slow_s, 0.6 * slow_s, 0.15 * slow_s)


def too_slow(scales: Scales, what: str) -> str:
    """Why such readings do not show it; empty where they do."""
    if scales.period_s > SLOWEST_s:
        return f"one reading in {scales.period_s:.2g} s is too slow to show {what}"
    return ""
