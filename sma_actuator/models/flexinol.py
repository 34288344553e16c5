"""Flexinol (Ni-Ti with R-phase): two asymptotes and exponential transitions (thesis, 5.1)."""

from __future__ import annotations

from dataclasses import dataclass

from ..parameters import parameter

_POLYNOMIAL = "polynomial in stress [Pa], lowest order first"


@dataclass(frozen=True, slots=True)
class FlexinolCoefficients:
    """Asymptotes of one particular wire (exclusive model, eq. 5.1–5.6, 5.22, 5.23)."""

    calibrated_length: float = parameter(description="length of the wire the coefficients were fitted on", unit="m", lo=0.005, hi=20.0)
    calibrated_diameter: float = parameter(description="its diameter", unit="m", lo=10e-6, hi=2e-3)
    heating_slope: tuple[float, ...] = parameter(description=f"a_H, {_POLYNOMIAL}", unit="m/Ω")
    heating_intercept: tuple[float, ...] = parameter(description=f"b_H, {_POLYNOMIAL}", unit="m")
    cooling_slope: tuple[float, ...] = parameter(description=f"a_C, {_POLYNOMIAL}", unit="m/Ω")
    cooling_intercept: tuple[float, ...] = parameter(description=f"b_C, {_POLYNOMIAL}", unit="m")
    initial_slope: float = parameter(description="a_0, slope far from the asymptote", unit="m/Ω")
    transition_rate: float = parameter(description="τ of the transition", unit="1/Ω", lo=1e-6, hi=1e9)
    stress_range: tuple[float, ...] = parameter(description="lowest and highest stress of the calibration", unit="Pa", lo=-1e9, hi=1e9)
    displacement_range: tuple[float, ...] = parameter(description="determinate part of the stroke", unit="m", lo=-10.0, hi=10.0)
