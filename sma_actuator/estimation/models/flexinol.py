"""Flexinol (Ni-Ti with R-phase): two asymptotes and exponential transitions (thesis, 5.1).

The exact step
--------------
On one branch and at constant stress let ``a``, ``b`` be its asymptote and ``z ≥ 0`` the distance in
resistance from it, ``z_H = R − (δ − b_H)/a_H`` and ``z_C = (δ − b_C)/a_C − R`` (5.20, 5.21).  With
the slope of 5.22, 5.23, ``dδ/dR = (a − a_0) e^(−τz) + a_0``, it obeys

    dz_H/dR = +k (1 − e^(−τz)),   dz_C/dR = −k (1 − e^(−τz)),   k = 1 − a_0/a,

so ``w = e^(τz) − 1`` is exactly exponential in R, ``w_new = w e^(±τkΔR)``, and with it
``z_new = ln(1 + w_new)/τ`` and ``δ_new = a (R_new ∓ z_new) + b``.  The step holds for any ΔR, does
not depend on the sampling rate, and ``z`` cannot change its sign: the forward step (5.24) of the
thesis crosses the asymptote and then diverges.

Beyond an asymptote
-------------------
A change of stress, or the cold end, where the asymptotes cross, can leave the state on the far
side of the asymptote it should approach (z < 0).  There R moves with temperature and δ hardly at
all: as long as R moves towards the asymptote δ stands still, until z = 0; when R moves away, the size of z
decays by the same law as on the near side, so the state is always drawn to the asymptote.  On the
asymptote itself (z = 0) δ follows it both ways.

Outside the loop
----------------
δ is kept between the two asymptotes at (R, σ), give or take ``LOOP_SLACK`` of the working range.
Without that, one bad reading, a sudden change of load or a branch decided late leaves δ outside the
loop, where only the next full cycle would bring it back.  The slack is there because a block of
readings that straddles a reversal belongs to both branches, and because at a cold rest δ does stand
a little beyond both asymptotes.  The bounds lie outside both
asymptotes, so they never push δ across one, and inside them the step is the exact one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, expm1, log, log1p
from typing import ClassVar

import numpy as np

from sma_actuator.base.jit import jit
from sma_actuator.base.parameters import parameter
from sma_actuator.base.sections import Wire
from sma_actuator.base.signals import Value

from .checks import as_range
from .model import COEFFICIENTS
from .thesis import ExclusiveCoefficients, NormalisedCoefficients

Polynomial = Sequence[float] | np.ndarray  #: in stress, lowest order first
_POLYNOMIAL = "polynomial in stress [Pa], lowest order first"
LOOP_SLACK = 0.05  #: how far δ may lie outside the loop, as a share of the working range
#: |z| below this is zero, for it is rounding, which must not decide whether R, turning back, leaves the asymptote.
_ON_ASYMPTOTE_Ohm = 1e-12
_LARGE = 40.0  # e^40 ≈ 2e17: beyond it ln(e^y ± 1) is y to the last digit


@jit
def _polynomial(coefficients: np.ndarray, x: float) -> float:
    value = 0.0
    for i in range(len(coefficients) - 1, -1, -1):
        value = value * x + coefficients[i]
    return value


def _at(x: Value, coefficients: Sequence[float]) -> Value:
    """The polynomial at x, a float or an array; for a float some ten times faster than numpy's."""
    value = 0.0 * x
    for coefficient in reversed(coefficients):
        value = value * x + coefficient
    return value


@jit
def _decayed(x: float, s: float) -> float:
    """``ln(1 + (e^x − 1) e^s)`` for x ≥ 0, without overflow or cancellation."""
    if x <= 0.0:
        return 0.0
    if x < _LARGE and s < _LARGE:
        return log1p(expm1(x) * exp(s))
    y = s + (x if x > _LARGE else log(expm1(x)))
    return y if y > _LARGE else log1p(exp(y))


@jit
def _along_branch(
    resistance: float,
    heating: bool,
    previous_resistance: float,
    displacement: float,
    a: float,
    b: float,
    a_0: float,
    tau: float,
) -> float:
    """The exact step towards or away from the asymptote a R + b of the present branch."""
    # In x = ± R both branches are the heating branch: z = x − x_asymptote(δ).
    sign = 1.0 if heating else -1.0
    x = sign * resistance
    z = sign * previous_resistance - sign * (displacement - b) / a
    dx = x - sign * previous_resistance
    rate = tau * (1.0 - a_0 / a)
    if abs(z) < _ON_ASYMPTOTE_Ohm:
        return a * resistance + b
    if z < 0.0:
        if dx > 0.0:
            still = min(dx, -z)  # δ stands still until the asymptote is reached
            z += still
            dx -= still
            if z < 0.0:
                return displacement
            z = 0.0
        else:
            z = -_decayed(-tau * z, rate * dx) / tau
            return a * (sign * (x - z)) + b
    z = _decayed(tau * z, rate * dx) / tau
    return a * (sign * (x - z)) + b


@jit
def advance(
    resistance: float,
    stress: float,
    heating: bool,
    state: np.ndarray,
    a_h: np.ndarray,
    b_h: np.ndarray,
    a_c: np.ndarray,
    b_c: np.ndarray,
    a_0: float,
    tau: float,
    slack: float,
) -> float:
    """δ after the resistance moved to ``resistance`` on one branch, at one stress; ``state`` = [previous resistance,
    displacement] is carried on."""
    slope_h, intercept_h = _polynomial(a_h, stress), _polynomial(b_h, stress)
    slope_c, intercept_c = _polynomial(a_c, stress), _polynomial(b_c, stress)
    if heating:
        a, b = slope_h, intercept_h
    else:
        a, b = slope_c, intercept_c
    displacement = _along_branch(resistance, heating, state[0], state[1], a, b, a_0, tau)
    on_h, on_c = slope_h * resistance + intercept_h, slope_c * resistance + intercept_c
    state[0] = resistance
    state[1] = min(max(displacement, min(on_h, on_c) - slack), max(on_h, on_c) + slack)
    return state[1]


@jit
def _limits(
    resistance: float, stress: float, a_h: np.ndarray, b_h: np.ndarray, a_c: np.ndarray, b_c: np.ndarray
) -> tuple[float, float]:
    """δ on both asymptotes."""
    return (
        _polynomial(a_h, stress) * resistance + _polynomial(b_h, stress),
        _polynomial(a_c, stress) * resistance + _polynomial(b_c, stress),
    )


@jit
def advance_all(
    resistance: np.ndarray,
    stress: np.ndarray,
    heating: np.ndarray,
    state: np.ndarray,
    a_h: np.ndarray,
    b_h: np.ndarray,
    a_c: np.ndarray,
    b_c: np.ndarray,
    a_0: float,
    tau: float,
    slack: float,
    displacement: np.ndarray,
) -> None:
    """``advance`` over arrays."""
    for i in range(len(resistance)):
        displacement[i] = advance(resistance[i], stress[i], heating[i], state, a_h, b_h, a_c, b_c, a_0, tau, slack)


class FlexinolModel:
    """The model of one wire; see :class:`sma_actuator.estimation.models.StrainModel`."""

    def __init__(
        self,
        *,
        a_h: Polynomial,
        b_h: Polynomial,
        a_c: Polynomial,
        b_c: Polynomial,
        a_0: float,
        tau: float,
        stress_range_Pa: tuple[float, float],
        displacement_range_m: tuple[float, float],
    ):
        self.stress_range_Pa, self.displacement_range_m = stress_range_Pa, displacement_range_m
        heating_a, heating_b, cooling_a, cooling_b = (np.asarray(p, dtype=float) for p in (a_h, b_h, a_c, b_c))
        self._asymptotes: tuple[list[float], ...] = tuple(
            p.tolist() for p in (heating_a, heating_b, cooling_a, cooling_b)
        )
        slack_m = LOOP_SLACK * float(np.ptp(self.displacement_range_m))
        self._coefficients = (heating_a, heating_b, cooling_a, cooling_b, float(a_0), float(tau), slack_m)
        self._state = np.zeros(2)

    def reset(self, resistance_Ohm: float, stress_Pa: float, heating: bool = False) -> float:
        """Start on the cooling (or heating) asymptote; return δ [m]."""
        delta_h, delta_c = self.limits_m(resistance_Ohm, stress_Pa)
        self._state[:] = resistance_Ohm, delta_h if heating else delta_c
        return float(self._state[1])

    def step(self, resistance_Ohm: float, stress_Pa: float, heating: bool) -> float:
        """Advance by one sample; return δ [m]."""
        return float(advance(resistance_Ohm, stress_Pa, heating, self._state, *self._coefficients))

    def run(self, resistance_Ohm: np.ndarray, stress_Pa: np.ndarray, heating: np.ndarray) -> np.ndarray:
        """Advance by n samples, arrays of shape (n,); return δ [m], shape (n,)."""
        displacement_m = np.empty(len(resistance_Ohm))
        advance_all(resistance_Ohm, stress_Pa, heating, self._state, *self._coefficients, displacement_m)
        return displacement_m

    def limits_m(self, resistance_Ohm: Value, stress_Pa: Value) -> tuple[Value, Value]:
        """Heating and cooling asymptote at R and σ, (δ_H, δ_C) [m]; floats or arrays."""
        if isinstance(resistance_Ohm, float) and isinstance(stress_Pa, float):
            return _limits(resistance_Ohm, stress_Pa, *self._coefficients[:4])
        a_h, b_h, a_c, b_c = self._asymptotes
        return (
            _at(stress_Pa, a_h) * resistance_Ohm + _at(stress_Pa, b_h),
            _at(stress_Pa, a_c) * resistance_Ohm + _at(stress_Pa, b_c),
        )


@COEFFICIENTS.register("flexinol")
@dataclass(frozen=True, slots=True)
class FlexinolCoefficients(ExclusiveCoefficients):
    """Asymptotes of one particular wire (exclusive model, eq. 5.1–5.6, 5.22, 5.23)."""

    ALLOY: ClassVar[str] = "ni-ti"

    heating_slope: tuple[float, ...] = parameter(description=f"a_H, {_POLYNOMIAL}", unit="m/Ω")
    heating_intercept: tuple[float, ...] = parameter(description=f"b_H, {_POLYNOMIAL}", unit="m")
    cooling_slope: tuple[float, ...] = parameter(description=f"a_C, {_POLYNOMIAL}", unit="m/Ω")
    cooling_intercept: tuple[float, ...] = parameter(description=f"b_C, {_POLYNOMIAL}", unit="m")
    initial_slope: float = parameter(description="a_0, slope far from the asymptote", unit="m/Ω")
    transition_rate: float = parameter(description="τ of the transition", unit="1/Ω", lo=1e-6, hi=1e9)

    def build(self, wire: Wire) -> FlexinolModel:
        """The model of the wire the coefficients were fitted on."""
        return FlexinolModel(
            a_h=self.heating_slope,
            b_h=self.heating_intercept,
            a_c=self.cooling_slope,
            b_c=self.cooling_intercept,
            a_0=self.initial_slope,
            tau=self.transition_rate,
            stress_range_Pa=as_range(self.stress_range),
            displacement_range_m=as_range(self.displacement_range),
        )


@COEFFICIENTS.register("flexinol_normalised")
@dataclass(frozen=True, slots=True)
class FlexinolNormalisedCoefficients(NormalisedCoefficients):
    """Asymptotes of any wire of the alloy, in λ = (R − R_0)/R_0 and ε (eq. 5.26–5.40).

    R = R_0 (1 + λ) put into 5.1 and divided by L_0 gives ε = (a R_0/L_0) λ + (a R_0 + b)/L_0: the
    normalised slope is â = a R_0/L_0 (5.30, 5.31) and the intercept b̂ = (b + a R_0)/L_0, since it is
    the strain at λ = 0, not at R = 0.
    """

    ALLOY: ClassVar[str] = "ni-ti"

    martensite_resistivity: float = parameter(
        description="ρ_M, which gives R_0 = ρ_M L_0/A_0", unit="Ω·m", lo=1e-8, hi=1e-4
    )
    heating_slope: tuple[float, ...] = parameter(description=f"â_H, {_POLYNOMIAL}", unit="1")
    heating_intercept: tuple[float, ...] = parameter(description=f"b̂_H, {_POLYNOMIAL}", unit="1")
    cooling_slope: tuple[float, ...] = parameter(description=f"â_C, {_POLYNOMIAL}", unit="1")
    cooling_intercept: tuple[float, ...] = parameter(description=f"b̂_C, {_POLYNOMIAL}", unit="1")
    initial_slope: float = parameter(description="â_0, slope far from the asymptote", unit="1")
    transition_rate: float = parameter(description="τ̂ of the transition", unit="1", lo=1e-6, hi=1e9)

    def build(self, wire: Wire) -> FlexinolModel:
        """The model of ``wire``, in its own resistance and displacement."""
        length_m = wire.length
        initial_Ohm = wire.resistance_Ohm(self.martensite_resistivity)
        slope = length_m / initial_Ohm
        a_h, a_c = np.multiply(self.heating_slope, slope), np.multiply(self.cooling_slope, slope)
        return FlexinolModel(
            a_h=a_h,
            b_h=_sum(np.multiply(self.heating_intercept, length_m), -initial_Ohm * a_h),
            a_c=a_c,
            b_c=_sum(np.multiply(self.cooling_intercept, length_m), -initial_Ohm * a_c),
            a_0=self.initial_slope * slope,
            tau=self.transition_rate / initial_Ohm,
            stress_range_Pa=as_range(self.stress_range),
            displacement_range_m=as_range(self.strain_range, length_m),
        )


def _sum(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Sum of two polynomials, lowest order first, of different orders."""
    out = np.zeros(max(len(p), len(q)))
    out[: len(p)] += p
    out[: len(q)] += q
    return out
