"""Coefficients of the model without R-phase: heating and cooling polynomials and their transition."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy  # whose modules are loaded where they are first asked for: half of what a program takes to start

from sma_actuator.estimation.models import COEFFICIENTS
from sma_actuator.identify.ranges import distinct_stresses, full_cycles, lowest_order, stress_range_Pa, working_range_m
from sma_actuator.identify.verdict.unseen import Unseen, unseen_of
from sma_actuator.logs.experiments import Experiment

from . import fitting
from .fitting import Data
from .flexinol import HIGHEST_ORDER, STRESS_UNIT_Pa

ORDER_R = 2  #: G_2 R² + G_1 R + G_0 (5.55, 5.56)


@dataclass(frozen=True, slots=True)
class FurukawaFit:
    """What was found."""

    coefficients: Any  #: FurukawaCoefficients
    order: int  #: of the stress polynomials
    order_errors: dict[int, np.ndarray] = field(default_factory=dict)  #: held-out errors of the orders tried
    samples: dict[str, np.ndarray] = field(default_factory=dict)  #: bootstrap: (samples, coefficients) of every field
    unseen: Unseen | None = None  #: how it does on cycles that its fits have not seen

    @property
    def bounds(self) -> list[str]:
        """A sentence for every bound that binds."""
        return fitting.transition_rate_bounds(self.coefficients.transition_rate)


def fit_furukawa(
    experiments: Sequence[Experiment],
    wire,
    variant: str = "average",
    order: int | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> FurukawaFit:
    """Heating curve, cooling curve and transition rate η, all loads and minor loops together.

    The curves are fitted through the variant they are for.  The average variant says nothing of
    their difference: that is taken from the transition model, and their mean from all samples.
    ``order`` of the stress polynomials; None: the lowest that is as good as the best on held-out
    cycles.  Raises IdentificationError.
    """
    lowest = lowest_order(experiments)
    fitting.require_loads(experiments, lowest if order is None else order, "curves")
    data = fitting.make_data(experiments, wire.full_stroke_m)
    fitted_as = "transition" if variant == "average" else variant
    problem = _Curves(experiments, wire, data, fitted_as)
    errors: dict[int, np.ndarray] = {}
    begun: dict[int, np.ndarray] = {}
    if order is None:
        highest = min(HIGHEST_ORDER, distinct_stresses(full_cycles(experiments)) - 1)
        for tried in range(lowest, highest + 1):
            errors[tried], begun[tried] = fitting.held_out_errors(problem.builder(tried), problem.start(tried), data)
            progress(0.6 * (tried + 1 - lowest) / (highest + 1 - lowest))
        order = fitting.choose_simplest(errors, int)
    build = problem.builder(order)
    found = fitting.fit(build, begun[order] if order in begun else problem.start(order), data)
    progress(0.9)
    shift = problem.to_mean_of_all(order, found.x) if variant == "average" else 0.0
    draws = [problem.coefficients(order, theta + shift, variant) for theta in fitting.bootstrap(build, found.x, data)]
    names = [
        f.name
        for f in dataclasses.fields(draws[0])
        if f.name[:7] in ("heating", "cooling") or f.name == "transition_rate"
    ]
    samples = {name: np.array([np.atleast_1d(getattr(d, name)) for d in draws]) for name in names}
    progress(1.0)
    coefficients = problem.coefficients(order, found.x + shift, variant)
    held_out_m = fitting.held_out_m(build, found.x, data, problem.user(order, variant))
    unseen = unseen_of(data.experiments, held_out_m, data.full_stroke_m)
    return FurukawaFit(coefficients, order, errors, samples, unseen)


class _Curves:
    """The parameter vector: c_H[i, j], c_C[i, j] of δ = Σ c[i, j] x^i s^j in mm, with x the resistance
    centred and scaled and s = σ / STRESS_UNIT_Pa; then ln η."""

    def __init__(self, experiments: Sequence[Experiment], wire, data: Data, variant: str):
        self._experiments, self._wire, self._data, self._variant = experiments, wire, data, variant
        resistance_Ohm = np.concatenate([t.resistance_Ohm for t in data.experiments])[data.counts]
        low, high = np.percentile(resistance_Ohm, (1, 99))
        self._centre_Ohm, self._scale_Ohm = 0.5 * (low + high), 0.5 * (high - low)
        self._to_R = _uncentring(self._centre_Ohm, self._scale_Ohm, ORDER_R)
        self._stress_range_Pa = stress_range_Pa(experiments)
        self._range_m = working_range_m(experiments, wire.full_stroke_m)

    def coefficients(self, order: int, theta: np.ndarray, variant: str):
        """FurukawaCoefficients of a parameter vector."""
        curves = theta[:-1].reshape(2, ORDER_R + 1, order + 1)
        values = {}
        for name, curve in zip(("heating", "cooling"), curves, strict=True):
            for i, row in enumerate(self._to_R @ curve):
                values[f"{name}_G{i}"] = tuple(float(c) * 1e-3 / STRESS_UNIT_Pa**j for j, c in enumerate(row))
        return COEFFICIENTS["furukawa"](
            calibrated_length=self._wire.length,
            calibrated_diameter=self._wire.diameter,
            calibrated_form=self._wire.form_text,
            variant=variant,
            transition_rate=fitting.transition_rate(theta[-1]),
            stress_range=self._stress_range_Pa,
            displacement_range=self._range_m,
            **values,
        )

    def builder(self, order: int):
        """Parameter vector → model."""
        return lambda theta: self.coefficients(order, theta, self._variant).build(self._wire)

    def user(self, order: int, variant: str):
        """Parameter vector → model of ``variant``, as it is used."""
        if variant != "average":
            return self.builder(order)
        return lambda theta: self.coefficients(order, theta + self.to_mean_of_all(order, theta), variant).build(
            self._wire
        )

    def start(self, order: int) -> np.ndarray:
        """Robust polynomials through the full cycles' heating and cooling samples."""
        full = fitting.make_data(full_cycles(self._experiments), self._wire.full_stroke_m)
        driven = np.concatenate([t.driven for t in full.experiments])
        parts = [self._polynomial(full.experiments, full.counts & branch, order) for branch in (driven, ~driven)]
        candidates = [np.append(np.concatenate(parts), rate) for rate in np.log((3.0, 10.0, 30.0, 100.0))]
        build, weight = self.builder(order), self._data.counts.astype(float)
        return min(candidates, key=lambda c: float(np.abs(fitting.residuals(build, c, self._data, weight)).mean()))

    def to_mean_of_all(self, order: int, theta: np.ndarray) -> np.ndarray:
        """What to add to a parameter vector so that the mean of its curves is the one through all samples."""
        heating, cooling = theta[:-1].reshape(2, -1)
        shift = self._polynomial(self._data.experiments, self._data.counts, order) - 0.5 * (heating + cooling)
        return np.concatenate([shift, shift, [0.0]])

    def _polynomial(self, experiments: Sequence[Experiment], chosen: np.ndarray, order: int) -> np.ndarray:
        x = (np.concatenate([t.resistance_Ohm for t in experiments]) - self._centre_Ohm) / self._scale_Ohm
        stress = np.concatenate([t.stress_Pa for t in experiments]) / STRESS_UNIT_Pa
        displacement_mm = np.concatenate([t.displacement_m for t in experiments]) * 1e3
        basis = np.polynomial.polynomial.polyvander2d(x, stress, (ORDER_R, order))
        return robust_linear(
            basis[chosen], displacement_mm[chosen], fitting.LOSS_SCALE * self._wire.full_stroke_m * 1e3
        )


def robust_linear(basis: np.ndarray, y: np.ndarray, scale: float) -> np.ndarray:
    """Coefficients (k,) of y ≈ basis @ c with a loss that is linear beyond ``scale``; basis (n, k), y (n,)."""
    start = np.linalg.lstsq(basis, y, rcond=None)[0]
    return scipy.optimize.least_squares(
        lambda c: basis @ c - y, start, jac=lambda c: basis, loss="soft_l1", f_scale=scale
    ).x


def _uncentring(centre: float, scale: float, order: int) -> np.ndarray:
    """Matrix from coefficients in (R − centre)/scale to coefficients in R, lowest order first."""
    out = np.zeros((order + 1, order + 1))
    power = np.polynomial.Polynomial([1.0])
    for i in range(order + 1):
        out[: i + 1, i] = power.coef
        power = power * np.polynomial.Polynomial([-centre / scale, 1.0 / scale])
    return out
