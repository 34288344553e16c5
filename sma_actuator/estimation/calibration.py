"""What a model's own logs looked like: the section that `identify` writes and `trace` measures against."""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import nan

import numpy as np

from sma_actuator.base.parameters import parameter


@dataclass(frozen=True, slots=True)
class Calibration:
    """What the logs looked like that the model was fitted on; `identify` writes it, `trace` measures against it.

    ``cold_…`` and ``hot_…`` hold a value for each of their stresses; ``expected_…`` say what residual the model leaves at
    a place and with a history, and ``floor`` how far off that is where it was not fitted.
    """

    error: float = parameter(
        nan, "mean absolute error of the model on its own logs, full range", "% of full stroke", 0.0, 1e3, optional=True
    )
    largest_error: float = parameter(
        nan, "largest such error of a single log", "% of full stroke", 0.0, 1e3, optional=True
    )
    floor: float = parameter(
        nan,
        "what is left of it beside what is expected below, where that was not fitted",
        "% of full stroke",
        0.0,
        1e3,
        optional=True,
    )
    independent_time: float = parameter(
        nan, "how far apart two readings are whose errors are independent", "s", 0.0, 1e6, optional=True
    )
    ambient_temperature: float = parameter(nan, "mean ambient temperature", "°C", -60.0, 100.0, optional=True)
    cold_stress: tuple[float, ...] = parameter((), "stresses at cold rest", "Pa", -1e9, 1e9, optional=True)
    cold_resistance: tuple[float, ...] = parameter((), "resistance at cold rest", "Ω", 0.0, 1e6, optional=True)
    cold_displacement: tuple[float, ...] = parameter((), "displacement at cold rest", "m", -10.0, 10.0, optional=True)
    hot_stress: tuple[float, ...] = parameter((), "stresses at the hot end", "Pa", -1e9, 1e9, optional=True)
    hot_resistance: tuple[float, ...] = parameter((), "resistance at the hot end", "Ω", 0.0, 1e6, optional=True)
    hot_displacement: tuple[float, ...] = parameter((), "displacement at the hot end", "m", -10.0, 10.0, optional=True)
    hot_power: float = parameter(nan, "power at the hot end", "W", 0.0, 1e6, optional=True)
    resistance_scatter: float = parameter(nan, "rms scatter of the resistance at rest", "Ω", 0.0, 1e6, optional=True)
    displacement_scatter: float = parameter(
        nan, "rms scatter of the displacement at rest", "m", 0.0, 10.0, optional=True
    )
    resistance_range: float = parameter(nan, "largest less smallest resistance", "Ω", 0.0, 1e6, optional=True)
    expected_stroke: tuple[float, ...] = parameter(
        (), "the stroke that what is expected was learned on", "m", -10.0, 10.0, optional=True
    )
    expected_centre: tuple[float, ...] = parameter(
        (), "mean of each feature that an error may depend on", optional=True
    )
    expected_scale: tuple[float, ...] = parameter((), "its standard deviation", lo=0.0, optional=True)
    expected_least: tuple[float, ...] = parameter((), "the least of it that was seen, in that unit", optional=True)
    expected_most: tuple[float, ...] = parameter((), "and the most", optional=True)
    expected_weights: tuple[float, ...] = parameter(
        (), "of the regression that says what residual to expect", "m", optional=True
    )
    expected_white: tuple[float, ...] = parameter(
        (),
        "lower triangle, row by row, that makes those features white: the floor rises with how strange they are",
        optional=True,
    )

    contracted_stress: tuple[float, ...] = parameter(
        (), "stresses of a wire that is contracted as far as it goes", "Pa", -1e9, 1e9, optional=True
    )
    contracted_resistance: tuple[float, ...] = parameter((), "its resistance", "Ω", 0.0, 1e6, optional=True)
    contracted_displacement: tuple[float, ...] = parameter((), "its displacement", "m", -10.0, 10.0, optional=True)
    contracted_temperature: float = parameter(
        nan, "temperature, by the heat balance, that it has the resistance at", "°C", -60.0, 1000.0, optional=True
    )
    contracted_slope: float = parameter(
        nan, "rise of its resistance with its temperature", "Ω/K", -1e3, 1e3, optional=True
    )
    cooling_position: float = parameter(
        nan, "displacement at which the rises below were noted", "m", -10.0, 10.0, optional=True
    )
    cooling_stress: tuple[float, ...] = parameter((), "stresses of the rises below", "Pa", -1e9, 1e9, optional=True)
    cooling_rise: tuple[float, ...] = parameter(
        (),
        "temperature above ambient by the heat balance when the cooling wire passed that displacement",
        "K",
        0.0,
        1e3,
        optional=True,
    )

    def cooling_rise_K(self, stress_Pa: float) -> float:
        """The rise above ambient at which a cooling wire passes ``cooling_position``; NaN where that is not known."""
        return float(np.interp(stress_Pa, self.cooling_stress, self.cooling_rise)) if self.cooling_rise else nan

    @property
    def hot_end_known(self) -> bool:
        """Whether it says what a wire shows that is contracted as far as it goes."""
        line = self.contracted_temperature + self.contracted_slope + self.resistance_range
        return bool(self.contracted_stress) and math.isfinite(line)

    @property
    def known(self) -> bool:
        """Whether the model says how good it was."""
        return math.isfinite(self.error)
