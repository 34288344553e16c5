"""A strain model of one line: displacement in proportion to resistance, whatever the load and the branch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.base.parameters import parameter
from sma_actuator.base.sections import Wire
from sma_actuator.estimation.models import COEFFICIENTS


class StraightLineModel:
    """δ = a R + b."""

    stress_range_Pa = (0.0, 1e9)

    def __init__(self, slope_m_Ohm: float, intercept_m: float, displacement_range_m: tuple[float, ...]):
        self._slope_m_Ohm, self._intercept_m = slope_m_Ohm, intercept_m
        self.displacement_range_m = displacement_range_m

    def reset(self, resistance_Ohm: float, stress_Pa: float, heating: bool = False) -> float:
        """There is no past to forget."""
        return self.step(resistance_Ohm, stress_Pa, heating)

    def step(self, resistance_Ohm: float, stress_Pa: float, heating: bool) -> float:
        """δ [m] at R."""
        return self._slope_m_Ohm * resistance_Ohm + self._intercept_m

    def run(self, resistance_Ohm: np.ndarray, stress_Pa: np.ndarray, heating: np.ndarray) -> np.ndarray:
        """δ [m] of n samples, arrays of shape (n,)."""
        return self._slope_m_Ohm * resistance_Ohm + self._intercept_m

    def limits_m(self, resistance_Ohm: np.ndarray, stress_Pa: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both curves are the line."""
        line_m = self._slope_m_Ohm * resistance_Ohm + self._intercept_m
        return line_m, line_m


@COEFFICIENTS.register("straight_line")
@dataclass(frozen=True, slots=True)
class StraightLine:
    """The section ``model`` with ``type: straight_line``."""

    slope: float = parameter(description="a", unit="m/Ω", lo=-1.0, hi=1.0)
    intercept: float = parameter(description="b", unit="m", lo=-10.0, hi=10.0)
    displacement_range: tuple[float, ...] = parameter(description="working range", unit="m", lo=-10.0, hi=10.0)

    def mismatches(self, wire: Wire) -> list[str]:
        """It suits any wire."""
        return []

    def build(self, wire: Wire) -> StraightLineModel:
        """The model of the wire the line was fitted on."""
        return StraightLineModel(self.slope, self.intercept, self.displacement_range)
