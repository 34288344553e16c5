"""Coefficients of the R-phase model: appendix C, and all loads and minor loops fitted together."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sma_actuator.estimation.models import COEFFICIENTS
from sma_actuator.identify.ranges import distinct_stresses, full_cycles, lowest_order, stress_range_Pa, working_range_m
from sma_actuator.identify.verdict.unseen import Unseen, unseen_of
from sma_actuator.logs.experiments import Experiment

from . import fitting
from .appendix_c import Asymptotes, asymptotes
from .fitting import Data
from .material import RPhaseAlloy, asymptotes_from_material

STRESS_UNIT_Pa = 100e6  #: polynomials are fitted in units of this, so that their coefficients are of one size
HIGHEST_ORDER = 3
_NAMES = ("heating_slope", "heating_intercept", "cooling_slope", "cooling_intercept")


@dataclass(frozen=True, slots=True)
class FlexinolFit:
    """What was found: coefficients, and how."""

    coefficients: Any  #: FlexinolCoefficients
    orders: tuple[int, int]  #: order of the stress polynomials of the heating and of the cooling asymptote
    lines: tuple[Asymptotes, ...] = ()  #: appendix C: the asymptotes of each load
    order_errors: dict[tuple[int, int], np.ndarray] = field(
        default_factory=dict
    )  #: held-out errors of the orders tried
    samples: dict[str, np.ndarray] = field(default_factory=dict)  #: bootstrap: (samples, coefficients) of every field
    unseen: Unseen | None = None  #: how it does on cycles that its fits have not seen

    @property
    def bounds(self) -> list[str]:
        """A sentence for every bound that binds."""
        return fitting.transition_rate_bounds(self.coefficients.transition_rate)


def fit_appendix_c(experiments: Sequence[Experiment], wire, order: int = 2) -> FlexinolFit:
    """Appendix C, then polynomials in stress (5.3–5.6); τ and a_0, found by trial in the thesis, by least squares here.

    Raises IdentificationError naming what the logs lack.
    """
    fitting.require_loads(experiments, order, "asymptotes")
    data = fitting.make_data(experiments, wire.full_stroke_m)
    lines = tuple(asymptotes(t) for t in full_cycles(experiments))
    stress = np.array([line.stress_Pa for line in lines]) / STRESS_UNIT_Pa
    values = np.array([[*line.heating, *line.cooling] for line in lines])
    polynomials = np.polynomial.polynomial.polyfit(stress, values, order).T  # (4, order + 1)
    base = _coefficients(
        polynomials, wire, stress_range_Pa(experiments), working_range_m(experiments, wire.full_stroke_m)
    )

    def with_transition(theta):
        rate = fitting.transition_rate(theta[1])
        return dataclasses.replace(base, initial_slope=float(theta[0] * 1e-3), transition_rate=rate)

    def build(theta):
        return with_transition(theta).build(wire)

    theta = _best_start(build, data, [(a, t) for a in (0.2, 0.6, 1.5) for t in (2.0, 3.0, 4.0)])
    found = fitting.fit(build, theta, data)
    return FlexinolFit(with_transition(found.x), (order, order), lines)


def _degrees(orders: tuple[int, int]) -> int:
    return sum(orders)


def fit_joint(
    experiments: Sequence[Experiment],
    wire,
    orders: tuple[int, int] | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> FlexinolFit:
    """All loads and minor loops together, through the model itself.

    ``orders`` of the stress polynomials (heating, cooling); None: the lowest that are as good
    as the best on held-out cycles.  Raises IdentificationError.
    """
    lowest = lowest_order(experiments)
    fitting.require_loads(experiments, max(orders) if orders else lowest, "asymptotes")
    data = fitting.make_data(experiments, wire.full_stroke_m)
    problem = _Joint(experiments, wire, data)
    errors: dict[tuple[int, int], np.ndarray] = {}
    begun: dict[tuple[int, int], np.ndarray] = {}
    if orders is None:
        highest = min(HIGHEST_ORDER, distinct_stresses(full_cycles(experiments)) - 1)
        tried = [(h, c) for h in range(lowest, highest + 1) for c in range(h, highest + 1)]
        for i, pair in enumerate(tried):
            errors[pair], begun[pair] = fitting.held_out_errors(problem.builder(pair), problem.start(pair), data)
            progress(0.8 * (i + 1) / len(tried))
        orders = fitting.choose_simplest(errors, _degrees)
    build = problem.builder(orders)
    found = fitting.fit(build, begun[orders] if orders in begun else problem.start(orders), data)
    progress(0.95)
    draws = fitting.bootstrap(build, found.x, data)
    samples = {
        name: np.array([np.atleast_1d(getattr(problem.coefficients(orders, theta), name)) for theta in draws])
        for name in (*_NAMES, "initial_slope", "transition_rate")
    }
    progress(1.0)
    held_out_m = fitting.held_out_m(build, found.x, data)
    unseen = unseen_of(data.experiments, held_out_m, data.full_stroke_m)
    return FlexinolFit(problem.coefficients(orders, found.x), orders, (), errors, samples, unseen)


class _Joint:
    """The parameter vector of the joint fit: for each asymptote the displacement [mm] it has at a
    resistance in mid-range and its slope [mm/Ω], as polynomials in stress; then a_0 [mm/Ω] and ln τ."""

    def __init__(self, experiments: Sequence[Experiment], wire, data: Data):
        self._experiments, self._wire, self._data = experiments, wire, data
        resistance_Ohm = np.concatenate([t.resistance_Ohm for t in data.experiments])[data.counts]
        self._centre_Ohm = float(np.median(resistance_Ohm))
        self._ranges = stress_range_Pa(experiments), working_range_m(experiments, wire.full_stroke_m)

    def coefficients(self, orders: tuple[int, int], theta: np.ndarray):
        """FlexinolCoefficients of a parameter vector."""
        heating, cooling = orders[0] + 1, orders[1] + 1
        d_h, a_h, d_c, a_c = np.split(theta[:-2], np.cumsum([heating, heating, cooling]))
        polynomials = [a_h, d_h - a_h * self._centre_Ohm, a_c, d_c - a_c * self._centre_Ohm]
        return _coefficients(
            [p * 1e-3 for p in polynomials],
            self._wire,
            *self._ranges,
            initial_slope=float(theta[-2]) * 1e-3,
            transition_rate=fitting.transition_rate(theta[-1]),
        )

    def builder(self, orders: tuple[int, int]):
        """Parameter vector → model."""
        return lambda theta: self.coefficients(orders, theta).build(self._wire)

    def start(self, orders: tuple[int, int]) -> np.ndarray:
        """The better of two: lines through the middle of each branch at each load, and lines from
        material properties (5.41–5.54); polynomials in stress through them."""
        full = full_cycles(self._experiments)
        stress_Pa = np.array([t.mean_stress_Pa for t in full])
        length_m, unit_Ohm = self._wire.strain_length_m, self._wire.resistance_Ohm(1.0)
        from_material = [asymptotes_from_material(RPhaseAlloy(), length_m, unit_Ohm, s) for s in stress_Pa]
        candidates = []
        for lines in ([self._middle_lines(t) for t in full], from_material):
            (a_h, b_h), (a_c, b_c) = np.array(lines).transpose(1, 2, 0) * 1e3
            wanted = [(b_h + a_h * self._centre_Ohm, 0), (a_h, 0), (b_c + a_c * self._centre_Ohm, 1), (a_c, 1)]
            polynomials = [
                np.polynomial.polynomial.polyfit(stress_Pa / STRESS_UNIT_Pa, y, orders[i]) for y, i in wanted
            ]
            candidates += [
                np.concatenate([*polynomials, (slope, rate)]) for slope in (0.3, 1.0) for rate in (2.0, 3.0, 4.0)
            ]
        return _best_start(self.builder(orders), self._data, candidates)

    @staticmethod
    def _middle_lines(experiment: Experiment) -> list[tuple[float, float]]:
        """(slope, intercept) of heating and cooling in the middle of the stroke."""
        low_m, high_m = np.percentile(experiment.displacement_m, (0.5, 99.5))
        middle = np.abs(experiment.displacement_m - 0.5 * (low_m + high_m)) < 0.25 * (high_m - low_m)
        return [
            tuple(np.polyfit(experiment.resistance_Ohm[middle & branch], experiment.displacement_m[middle & branch], 1))
            for branch in (experiment.driven, ~experiment.driven)
        ]


def _best_start(build, data: Data, candidates) -> np.ndarray:
    weight = data.counts.astype(float)
    return min(
        (np.asarray(c, float) for c in candidates),
        key=lambda c: float(np.abs(fitting.residuals(build, c, data, weight)).mean()),
    )


def _coefficients(polynomials, wire, stress_range, displacement_range, initial_slope=1e-3, transition_rate=20.0):
    """FlexinolCoefficients from polynomials in units of STRESS_UNIT_Pa."""
    scaled = [tuple(float(b) / STRESS_UNIT_Pa**i for i, b in enumerate(p)) for p in polynomials]
    return COEFFICIENTS["flexinol"](
        calibrated_length=wire.length,
        calibrated_diameter=wire.diameter,
        calibrated_form=wire.form_text,
        **dict(zip(_NAMES, scaled, strict=True)),
        initial_slope=initial_slope,
        transition_rate=transition_rate,
        stress_range=stress_range,
        displacement_range=displacement_range,
    )
