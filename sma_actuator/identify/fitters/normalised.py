"""Models for any wire of an alloy, from logs of wires of several lengths and diameters.

Resistance times area over length and displacement over length are properties of the alloy.  So
every log is first rewritten as if it had been measured on the wire of the configuration; the
model of that wire, fitted on all of them, is then divided by its dimensions (5.26–5.40, 5.75–5.87).
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from sma_actuator.config import bench_from_mapping
from sma_actuator.estimation.models import COEFFICIENTS
from sma_actuator.identify.ranges import distinct_stresses, full_cycles, lowest_order, stress_range_Pa, working_range_m
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.experiments import (
    NOT_FITTED,
    Experiment,
    IdentificationError,
    judged_rows,
    make_experiment,
    sessions,
)
from sma_actuator.logs.kinds import with_kinds

from . import fitting
from .flexinol import HIGHEST_ORDER, FlexinolFit, STRESS_UNIT_Pa

_ASYMPTOTES = ("heating_slope", "heating_intercept", "cooling_slope", "cooling_intercept")


def as_one_wire(logs: Sequence[BenchLog], mapping: Mapping[str, Any]) -> list[Experiment]:
    """Traces of logs of any wires, as the wire of ``mapping`` would have given them.

    A log says in its metadata which wire it is of; one that does not is of the wire of ``mapping``.
    """
    reference = bench_from_mapping(mapping).wire
    experiments = []
    for log in logs:
        if log.metadata.get("kind") in NOT_FITTED:
            continue
        said = log.metadata.get("wire", {})
        own = copy.deepcopy(dict(mapping))
        own["wire"] = {
            **own["wire"],
            "length": said.get("length_m", reference.length),
            "diameter": said.get("diameter_m", reference.diameter),
        }
        unscaled = bench_from_mapping(own).wire
        resistance = reference.resistance_Ohm(1.0) / unscaled.resistance_Ohm(1.0)
        own["safety"] = {**own["safety"]}
        for name in ("resistance_min", "resistance_max"):
            own["safety"][name] /= resistance
        for experiment in map(judged_rows, sessions(make_experiment(log, bench_from_mapping(own)))):
            signals = dataclasses.replace(
                experiment.signals,
                resistance_Ohm=experiment.signals.resistance_Ohm * resistance,
                reference_displacement_m=experiment.signals.reference_displacement_m
                * (reference.length / unscaled.length),
            )
            experiments.append(dataclasses.replace(experiment, signals=signals))
    if not experiments:
        raise IdentificationError("no log to fit: pulses or partial cycles of at least one wire are needed")
    return with_kinds(experiments)


def martensite_resistivity_Ohm_m(experiments: Sequence[Experiment], wire) -> float:
    """ρ_M from the cold resistance, extrapolated to zero load over the loads there are (5.27)."""
    full = full_cycles(experiments)
    cold_Ohm = [float(np.median(t.resistance_Ohm[t.cycle == 0])) for t in full]
    stress_Pa = [t.mean_stress_Pa for t in full]
    at_zero_Ohm = np.polyfit(stress_Pa, cold_Ohm, 1)[-1] if len(set(stress_Pa)) > 1 else np.mean(cold_Ohm)
    return float(wire.resistivity_Ohm_m(at_zero_Ohm))


def flexinol_normalised(fit: FlexinolFit, experiments: Sequence[Experiment], wire):
    """FlexinolNormalisedCoefficients of an exclusive fit, and its bootstrap samples, both in λ and ε."""
    resistivity = martensite_resistivity_Ohm_m(experiments, wire)
    initial_Ohm, length_m = wire.resistance_Ohm(resistivity), wire.length

    def convert(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Works on one set of coefficients and on samples of them (last axis: order in stress)."""
        out = {}
        for branch in ("heating", "cooling"):
            slope, intercept = (np.asarray(values[f"{branch}_{what}"], float) for what in ("slope", "intercept"))
            out[f"{branch}_slope"] = slope * initial_Ohm / length_m
            out[f"{branch}_intercept"] = (intercept + slope * initial_Ohm) / length_m
        out["initial_slope"] = np.asarray(values["initial_slope"]) * initial_Ohm / length_m
        out["transition_rate"] = np.asarray(values["transition_rate"]) * initial_Ohm
        return out

    exclusive = fit.coefficients
    own = convert({name: getattr(exclusive, name) for name in (*_ASYMPTOTES, "initial_slope", "transition_rate")})
    coefficients = COEFFICIENTS["flexinol_normalised"](
        martensite_resistivity=resistivity,
        **{name: tuple(float(v) for v in own[name]) for name in _ASYMPTOTES},
        initial_slope=float(own["initial_slope"]),
        transition_rate=float(own["transition_rate"]),
        stress_range=exclusive.stress_range,
        strain_range=tuple(d / length_m for d in exclusive.displacement_range),
    )
    return coefficients, convert(fit.samples) if fit.samples else {}


def fit_furukawa_normalised(experiments: Sequence[Experiment], wire, order: int | None = None):
    """FurukawaNormalisedCoefficients and bootstrap samples: ends of R and δ at every load as a start
    (5.75–5.80), then everything but ρ_A together, robustly.

    ``order`` of the stress polynomials; None: the lowest that is as good as the best on held-out
    cycles.  Raises IdentificationError.
    """
    lowest = lowest_order(experiments)
    fitting.require_loads(experiments, lowest if order is None else order, "curves")
    data = fitting.make_data(experiments, wire.full_stroke_m)
    full = full_cycles(experiments)
    stress = np.array([t.mean_stress_Pa for t in full]) / STRESS_UNIT_Pa
    r_low, r_high = np.array([np.percentile(t.resistance_Ohm, (1, 99)) for t in full]).T
    d_low, d_high = np.array([np.percentile(t.displacement_m, (1, 99)) for t in full]).T
    per_resistivity = wire.resistance_Ohm(1.0)
    least_Ohm = float(np.mean(r_low))
    lam = np.concatenate(
        [(t.resistance_Ohm - least_Ohm) / (high - least_Ohm) for t, high in zip(full, r_high, strict=True)]
    )
    xi = np.concatenate(
        [(t.displacement_m - low) / (high - low) for t, low, high in zip(full, d_low, d_high, strict=True)]
    )
    middle = (xi > 0.05) & (xi < 0.95)
    activation = polynomial.polyfit(lam[middle], xi[middle], 2)
    ends = (r_high / per_resistivity * 1e6, d_low / wire.length * 1e2, (d_high - d_low) / wire.length * 1e2)
    stress_range = stress_range_Pa(experiments)
    strain_range = tuple(d / wire.length for d in working_range_m(experiments, wire.full_stroke_m))

    def coefficients(theta: np.ndarray):
        polynomials = theta[2:].reshape(3, -1)
        rho, mechanical, stroke = polynomials / STRESS_UNIT_Pa ** np.arange(polynomials.shape[1])
        # λ = 1 is full stroke, ξ = 1: without that the scale of ξ and of the stroke could not be told apart.
        return COEFFICIENTS["furukawa_normalised"](
            austenite_resistivity=least_Ohm / per_resistivity,
            martensite_resistivity=tuple(float(v) * 1e-6 for v in rho),
            activation=(float(theta[0]), float(1.0 - theta[0] - theta[1]), float(theta[1])),
            mechanical_strain=tuple(float(v) * 1e-2 for v in mechanical),
            stroke_strain=tuple(float(v) * 1e-2 for v in stroke),
            stress_range=stress_range,
            strain_range=strain_range,
        )

    def build(theta: np.ndarray):
        return coefficients(theta).build(wire)

    def start(order: int) -> np.ndarray:
        return np.concatenate([[activation[0], activation[2]], *(polynomial.polyfit(stress, y, order) for y in ends)])

    begun: dict[int, np.ndarray] = {}
    if order is None:
        errors = {}
        for tried in range(lowest, min(HIGHEST_ORDER, distinct_stresses(full) - 1) + 1):
            errors[tried], begun[tried] = fitting.held_out_errors(build, start(tried), data)
        order = fitting.choose_simplest(errors, int)
    found = fitting.fit(build, begun[order] if order in begun else start(order), data)
    draws = [coefficients(theta) for theta in fitting.bootstrap(build, found.x, data)]
    names = ("martensite_resistivity", "activation", "mechanical_strain", "stroke_strain")
    return coefficients(found.x), {name: np.array([getattr(d, name) for d in draws]) for name in names}
