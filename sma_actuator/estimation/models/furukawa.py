"""Furukawa NT-H (Ni-Ti-Cu): polynomial curves in resistance, no R-phase (thesis, 5.2).

Heating and cooling each have a curve ``δ = G_2 R² + G_1 R + G_0`` whose coefficients are polynomials
in stress (5.55–5.58).  Three ways to use them: their mean (5.62, 5.63), the one of the present
branch (5.71), or a mixture ``δ = h δ_H + (1 − h) δ_C`` that moves from one to the other as R moves
away from its value at the last reversal (5.72–5.74).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial.polynomial import polyval2d

from sma_actuator.base.jit import jit
from sma_actuator.base.parameters import parameter
from sma_actuator.base.sections import Wire
from sma_actuator.base.signals import Value

from .checks import as_range
from .model import COEFFICIENTS
from .thesis import ExclusiveCoefficients, NormalisedCoefficients

VARIANTS = ("average", "direct_switching", "transition")
_AVERAGE, _DIRECT, _TRANSITION = range(3)
_POLYNOMIAL = "polynomial in stress [Pa], lowest order first"


@jit
def _curve(coefficients: np.ndarray, resistance: float, stress: float) -> float:
    """Σ_i Σ_j c[i, j] R^i σ^j."""
    value = 0.0
    for i in range(coefficients.shape[0] - 1, -1, -1):
        at_stress = 0.0
        for j in range(coefficients.shape[1] - 1, -1, -1):
            at_stress = at_stress * stress + coefficients[i, j]
        value = value * resistance + at_stress
    return value


@jit
def _share_of_heating(resistance: float, heating: bool, state: np.ndarray, rate: float) -> float:
    """h of 5.72, 5.73; ``state`` = [h, branch, R_S, h_S], of which R_S, h_S are set at each reversal."""
    branch = 1.0 if heating else 0.0
    if branch != state[1]:
        state[1], state[3] = branch, state[0]
    else:
        moved = rate * (resistance - state[2])
        if heating:
            h = (state[3] - 1.0) * exp(min(moved, 50.0)) + 1.0
        else:
            h = state[3] * exp(min(-moved, 50.0))
        state[0] = min(max(h, 0.0), 1.0)
        return state[0]
    state[2] = resistance
    return state[0]


@jit
def advance(
    resistance: float,
    stress: float,
    heating: bool,
    variant: int,
    state: np.ndarray,
    heating_curve: np.ndarray,
    cooling_curve: np.ndarray,
    rate: float,
) -> float:
    """δ at R and σ on the present branch; ``state`` is changed in place."""
    if variant == _AVERAGE:
        return 0.5 * (_curve(heating_curve, resistance, stress) + _curve(cooling_curve, resistance, stress))
    if variant == _DIRECT:
        return _curve(heating_curve if heating else cooling_curve, resistance, stress)
    h = _share_of_heating(resistance, heating, state, rate)
    return h * _curve(heating_curve, resistance, stress) + (1.0 - h) * _curve(cooling_curve, resistance, stress)


@jit
def advance_all(
    resistance: np.ndarray,
    stress: np.ndarray,
    heating: np.ndarray,
    variant: int,
    state: np.ndarray,
    heating_curve: np.ndarray,
    cooling_curve: np.ndarray,
    rate: float,
    displacement: np.ndarray,
) -> None:
    """``advance`` over arrays."""
    for i in range(len(resistance)):
        displacement[i] = advance(
            resistance[i], stress[i], heating[i], variant, state, heating_curve, cooling_curve, rate
        )


@jit
def _normalised(
    resistance: float,
    stress: float,
    activation: np.ndarray,
    least_Ohm: float,
    greatest: np.ndarray,
    mechanical: np.ndarray,
    stroke: np.ndarray,
) -> float:
    """δ of the normalised model, 5.75, 5.77–5.81 (coefficient arrays as (1, n) curves in stress)."""
    normalised = (resistance - least_Ohm) / (_curve(greatest, 0.0, stress) - least_Ohm)
    return _curve(mechanical, 0.0, stress) + _curve(activation, normalised, 0.0) * _curve(stroke, 0.0, stress)


@jit
def _normalised_all(
    resistance: np.ndarray,
    stress: np.ndarray,
    activation: np.ndarray,
    least_Ohm: float,
    greatest: np.ndarray,
    mechanical: np.ndarray,
    stroke: np.ndarray,
    displacement: np.ndarray,
) -> None:
    for i in range(len(resistance)):
        displacement[i] = _normalised(resistance[i], stress[i], activation, least_Ohm, greatest, mechanical, stroke)


class FurukawaModel:
    """The model of one wire; see :class:`sma_actuator.estimation.models.StrainModel`."""

    def __init__(
        self,
        *,
        variant: str,
        heating_curve: np.ndarray,
        cooling_curve: np.ndarray,
        rate: float,
        stress_range_Pa: tuple[float, float],
        displacement_range_m: tuple[float, float],
    ):
        self._variant = VARIANTS.index(variant)
        self._curves = (np.asarray(heating_curve, dtype=float), np.asarray(cooling_curve, dtype=float), float(rate))
        self.stress_range_Pa, self.displacement_range_m = stress_range_Pa, displacement_range_m
        self._state = np.zeros(4)

    def reset(self, resistance_Ohm: float, stress_Pa: float, heating: bool = False) -> float:
        """Start on the cooling (or heating) curve; return δ [m]."""
        branch = 1.0 if heating else 0.0
        self._state[:] = branch, branch, resistance_Ohm, branch
        return self.step(resistance_Ohm, stress_Pa, heating)

    def step(self, resistance_Ohm: float, stress_Pa: float, heating: bool) -> float:
        """Advance by one sample; return δ [m]."""
        return float(advance(resistance_Ohm, stress_Pa, heating, self._variant, self._state, *self._curves))

    def run(self, resistance_Ohm: np.ndarray, stress_Pa: np.ndarray, heating: np.ndarray) -> np.ndarray:
        """Advance by n samples, arrays of shape (n,); return δ [m], shape (n,)."""
        displacement_m = np.empty(len(resistance_Ohm))
        advance_all(resistance_Ohm, stress_Pa, heating, self._variant, self._state, *self._curves, displacement_m)
        return displacement_m

    def limits_m(self, resistance_Ohm: Value, stress_Pa: Value) -> tuple[Value, Value]:
        """Heating and cooling curve at R and σ, (δ_H, δ_C) [m]; floats or arrays."""
        heating_curve, cooling_curve, _ = self._curves
        resistance, stress = np.broadcast_arrays(resistance_Ohm, stress_Pa)
        return polyval2d(resistance, stress, heating_curve), polyval2d(resistance, stress, cooling_curve)


class FurukawaNormalisedModel:
    """One activation curve for all loads; without memory."""

    def __init__(
        self,
        *,
        activation: Sequence[float],
        least_Ohm: float,
        greatest_Ohm: np.ndarray,
        mechanical_m: np.ndarray,
        stroke_m: np.ndarray,
        stress_range_Pa: tuple[float, float],
        displacement_range_m: tuple[float, float],
    ):
        greatest, mechanical, stroke = (
            np.atleast_2d(np.asarray(p, float)) for p in (greatest_Ohm, mechanical_m, stroke_m)
        )
        self._coefficients = (
            np.asarray(activation, dtype=float).reshape(-1, 1),
            float(least_Ohm),
            greatest,
            mechanical,
            stroke,
        )
        self.stress_range_Pa, self.displacement_range_m = stress_range_Pa, displacement_range_m

    def reset(self, resistance_Ohm: float, stress_Pa: float, heating: bool = False) -> float:
        """δ [m]; there is no past to forget."""
        return self.step(resistance_Ohm, stress_Pa, heating)

    def step(self, resistance_Ohm: float, stress_Pa: float, heating: bool) -> float:
        """δ [m] at R and σ."""
        return float(_normalised(resistance_Ohm, stress_Pa, *self._coefficients))

    def run(self, resistance_Ohm: np.ndarray, stress_Pa: np.ndarray, heating: np.ndarray) -> np.ndarray:
        """δ [m] of n samples, arrays of shape (n,)."""
        displacement_m = np.empty(len(resistance_Ohm))
        _normalised_all(resistance_Ohm, stress_Pa, *self._coefficients, displacement_m)
        return displacement_m

    def limits_m(self, resistance_Ohm: Value, stress_Pa: Value) -> tuple[Value, Value]:
        """The one curve, twice: (δ, δ) [m]; floats or arrays."""
        resistance, stress = np.broadcast_arrays(np.asarray(resistance_Ohm, float), np.asarray(stress_Pa, float))
        delta = np.empty(resistance.size)
        _normalised_all(resistance.ravel(), stress.ravel(), *self._coefficients, delta)
        curve: Any = delta.reshape(resistance.shape)
        return curve, curve


@COEFFICIENTS.register("furukawa")
@dataclass(frozen=True, slots=True)
class FurukawaCoefficients(ExclusiveCoefficients):
    """Heating and cooling curve of one particular wire (exclusive model, eq. 5.55–5.58, 5.72–5.74)."""

    ALLOY: ClassVar[str] = "ni-ti-cu"

    variant: str = parameter("average", "how the two curves are used", choices=VARIANTS)
    heating_G0: tuple[float, ...] = parameter(description=f"G_H0, {_POLYNOMIAL}", unit="m")
    heating_G1: tuple[float, ...] = parameter(description=f"G_H1, {_POLYNOMIAL}", unit="m/Ω")
    heating_G2: tuple[float, ...] = parameter(description=f"G_H2, {_POLYNOMIAL}", unit="m/Ω²")
    cooling_G0: tuple[float, ...] = parameter(description=f"G_C0, {_POLYNOMIAL}", unit="m")
    cooling_G1: tuple[float, ...] = parameter(description=f"G_C1, {_POLYNOMIAL}", unit="m/Ω")
    cooling_G2: tuple[float, ...] = parameter(description=f"G_C2, {_POLYNOMIAL}", unit="m/Ω²")
    transition_rate: float = parameter(10.0, "η of the transition curves", "1/Ω", 1e-6, 1e9)

    def build(self, wire: Wire) -> FurukawaModel:
        """The model of the wire the coefficients were fitted on."""
        return FurukawaModel(
            variant=self.variant,
            heating_curve=_padded(self.heating_G0, self.heating_G1, self.heating_G2),
            cooling_curve=_padded(self.cooling_G0, self.cooling_G1, self.cooling_G2),
            rate=self.transition_rate,
            stress_range_Pa=as_range(self.stress_range),
            displacement_range_m=as_range(self.displacement_range),
        )


@COEFFICIENTS.register("furukawa_normalised")
@dataclass(frozen=True, slots=True)
class FurukawaNormalisedCoefficients(NormalisedCoefficients):
    """One activation curve for any wire of the alloy (eq. 5.75–5.87)."""

    ALLOY: ClassVar[str] = "ni-ti-cu"

    austenite_resistivity: float = parameter(
        description="ρ_A, which gives R_min = ρ_A L_0/A_0", unit="Ω·m", lo=1e-8, hi=1e-4
    )
    martensite_resistivity: tuple[float, ...] = parameter(
        description=f"ρ_M, which gives R_max, {_POLYNOMIAL}", unit="Ω·m"
    )
    activation: tuple[float, ...] = parameter(description="C, polynomial in λ, lowest order first", unit="1")
    mechanical_strain: tuple[float, ...] = parameter(description=f"ε_M, {_POLYNOMIAL}", unit="1")
    stroke_strain: tuple[float, ...] = parameter(description=f"ε_L, {_POLYNOMIAL}", unit="1")

    def build(self, wire: Wire) -> FurukawaNormalisedModel:
        """The model of ``wire``, in its own resistance and displacement."""
        per_resistivity = wire.resistance_Ohm(1.0)
        return FurukawaNormalisedModel(
            activation=self.activation,
            least_Ohm=self.austenite_resistivity * per_resistivity,
            greatest_Ohm=np.multiply(self.martensite_resistivity, per_resistivity),
            mechanical_m=np.multiply(self.mechanical_strain, wire.length),
            stroke_m=np.multiply(self.stroke_strain, wire.length),
            stress_range_Pa=as_range(self.stress_range),
            displacement_range_m=as_range(self.strain_range, wire.length),
        )


def _padded(*polynomials: Sequence[float]) -> np.ndarray:
    """Polynomials of different orders as the rows of one array."""
    out = np.zeros((len(polynomials), max(map(len, polynomials))))
    for row, polynomial in zip(out, polynomials, strict=True):
        row[: len(polynomial)] = polynomial
    return out
