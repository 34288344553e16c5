"""What a wire at rest shows, against what it showed at the calibration: R and δ, cold and hot, in standard deviations.

There they depend on load, surroundings and, of a contracted wire, its temperature alone, and repeat far better than the
loop between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from sma_actuator.estimation.calibration import COLD_SHARE, Calibration, through

#: Of what a wire's hot end moved while it was calibrated: how much longer such a wire is since then than what was fitted, which is
#: the mean of the calibration: between nothing, where most came with the first cycles, and half, where it came evenly; and how
#: far off that is in the mean.
SINCE_THEN, SINCE_THEN_WITHIN = 0.25, 0.125
SPREAD = 1.25  #: standard deviation over mean absolute error
REPEATS = 0.003, 0.005  #: share of the ranges of R and δ to which a rest repeats at the best
#: How far a rest may be off, of those ranges, per distance from the calibration's nearest stress over its largest; and so
#: many times that per difference from the load that a cold wire came to rest under: it has the variants of that.
BETWEEN, OTHER_VARIANTS = 0.05, 2.0
BENDS_WITHIN = 0.5  #: how far the curve between these stresses may be off, of what it lies beside straight lines
#: The same of a cold wire in surroundings known to be others, per kelvin: many alloys have not transformed to the end at
#: room temperature.
PER_KELVIN = 0.005
#: A hot rest is held against the calibration's where it takes its power to within so much; and how well it is known how much more
#: resistance a contracted wire has that is warmer: of that, or where nobody knows it, per kelvin of the resistance.
AS_HOT, WARMS_WITHIN, WARMS_AT_MOST = 0.3, 0.5, 5e-4
#: Temperature to which what a contracted wire has yet to go is in proportion, where it is not as hot as at the calibration.
TAIL_K = 5.0
ALIKE = 0.05  #: of the largest: what stress and heat of two rests may differ by that are held against each other


@dataclass(frozen=True, slots=True)
class AtRest:
    """What one rest shows."""

    hot: bool
    resistance_Ohm: float  #: of a contracted wire: that it goes to
    displacement_m: float  #: of a cold wire: that it goes to
    further_m: float  #: how much of it there was yet to come
    stress_Pa: float
    since_Pa: float  #: how much its load has changed since the wire came there
    heat_W: float  #: that it loses
    beside_W: float  #: of that, what does not come from the current
    warmer_K: float  #: how much warmer its surroundings are than the calibration's, by what is logged


@dataclass(frozen=True)
class Usual:
    """What is usual at rest."""

    calibration: Calibration
    heat_loss_W_K: float
    resistance_Ohm: float  #: range of the resistance
    stroke_m: float

    def off(self, rests: Sequence[AtRest]) -> np.ndarray:
        """How far off R and δ of n rests are, in standard deviations, shape (n, 2); 0 where nothing is known of such a rest."""
        out = np.zeros((len(rests), 2))
        for hot in (False, True):
            chosen = [k for k, rest in enumerate(rests) if rest.hot == hot]
            if chosen:
                columns = {f.name: np.array([getattr(rests[k], f.name) for k in chosen]) for f in fields(AtRest)}
                out[chosen] = self._off(hot, columns)
        return out

    def _off(self, hot: bool, is_: dict[str, np.ndarray]) -> np.ndarray:
        c = self.calibration
        ranges = np.array([self.resistance_Ohm, self.stroke_m])
        scatter = np.nan_to_num([c.resistance_scatter, c.displacement_scatter])
        expected, away, bent = self._expected(hot, is_)
        to_go_m = np.abs(is_["further_m"])
        known = np.ones(len(away), dtype=bool)
        warms = np.zeros(len(away))
        if not hot:
            away = away + PER_KELVIN * np.abs(is_["warmer_K"] + is_["beside_W"] / self.heat_loss_W_K)
        elif math.isfinite(c.hot_power):
            known = np.abs(is_["heat_W"] / c.hot_power - 1.0) <= AS_HOT
            warmer_K = is_["warmer_K"] + (is_["heat_W"] - c.hot_power) / self.heat_loss_W_K
            warms = WARMS_AT_MOST * expected[:, 0] * np.abs(warmer_K)
            if math.isfinite(c.contracted_slope):
                expected[:, 0] += c.contracted_slope * warmer_K
                warms = WARMS_WITHIN * np.abs(c.contracted_slope * warmer_K)
            to_go_m = to_go_m + c.hot_to_go * np.maximum(1.0, np.abs(warmer_K) / TAIL_K)
        away = np.hypot(away, to_go_m / self.stroke_m)
        squares = scatter**2 + (ranges * REPEATS) ** 2 + np.outer(away, ranges) ** 2 + bent**2
        # What training does to the length of a cold wire is known, but not what to its resistance.
        changed = np.array([c.changed / self.stroke_m * self.resistance_Ohm, self._changed_m(hot)])
        squares += (SPREAD * SINCE_THEN_WITHIN * changed) ** 2
        squares[:, 0] += warms**2
        shown = np.column_stack((is_["resistance_Ohm"], is_["displacement_m"]))
        return np.where(known[:, None], (shown - expected) / np.sqrt(squares), 0.0)

    def _expected(self, hot: bool, is_: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """R and δ of the calibration at the rests' stresses, (n, 2).

        And how far off they may be: of the ranges, (n,), and because they bend between the calibration's loads, (n, 2).
        """
        c, stress_Pa = self.calibration, is_["stress_Pa"]
        nodes_Pa = np.asarray(c.hot_stress if hot else c.cold_stress)
        if not len(nodes_Pa):
            return self._of_the_others(hot, is_), np.zeros(len(stress_Pa)), np.zeros((len(stress_Pa), 2))
        tables = (c.hot_resistance, c.hot_displacement) if hot else (c.cold_resistance, c.cold_displacement)
        expected = np.column_stack([through(nodes_Pa, values, stress_Pa) for values in tables])
        straight = np.column_stack([np.interp(stress_Pa, nodes_Pa, values) for values in tables])
        bent = BENDS_WITHIN * np.abs(expected - straight)
        expected[:, 1] += SINCE_THEN * self._changed_m(hot)
        away_Pa = np.min(np.abs(stress_Pa[:, None] - nodes_Pa), axis=1)
        if not hot:
            away_Pa = away_Pa + OTHER_VARIANTS * np.abs(is_["since_Pa"])
        return expected, BETWEEN * away_Pa / np.max(np.abs(nodes_Pa)), bent

    @staticmethod
    def _of_the_others(hot: bool, is_: dict[str, np.ndarray]) -> np.ndarray:
        """The mean of the session's own rests of the same stress, and heat."""
        same = np.ones((len(is_["stress_Pa"]),) * 2, dtype=bool)
        for values in (is_["stress_Pa"], is_["heat_W"]) if hot else (is_["stress_Pa"],):
            same &= np.abs(values[:, None] - values) <= ALIKE * np.max(np.abs(values))
        shown = np.column_stack((is_["resistance_Ohm"], is_["displacement_m"]))
        return (same @ shown) / same.sum(axis=1)[:, None]

    def _changed_m(self, hot: bool) -> float:
        """How far that end moved while the wire was calibrated."""
        return self.calibration.changed * (1.0 if hot else COLD_SHARE)
