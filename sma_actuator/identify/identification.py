"""Logs in, a complete parameter file out."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sma_actuator.base.parameters import ConfigError, to_mapping
from sma_actuator.config import Config, bench_from_mapping
from sma_actuator.logs.bench_log import BenchLog

from .calibration import calibration_of
from .errors import LogError, log_errors
from .experiments import Experiment
from .fatigue import Fatigue, fit_fatigue
from .fitters import FITTERS, METHODS, Asked, Fitter, Progress
from .kinds import LEFT_OUT, make_experiments
from .normalised import as_one_wire
from .ranges import MARGIN, check_width, shortest_seen_m


@dataclass(frozen=True, slots=True)
class Identification:
    """A calibrated model, and how good it is."""

    mapping: dict[str, Any]  #: the bench's parameters with the model in them: what the node runs on
    config: Config  #: the same, checked
    intervals: dict[str, list[tuple[float, float]]]  #: 95 % of every coefficient, by bootstrap over cycles
    errors: list[LogError]  #: of the logs it was fitted on
    fit: Any  #: how it was found, as its fitter has it
    experiments: tuple[Experiment, ...]
    fatigue: Fatigue | None = None
    notes: list[str] = field(default_factory=list)  #: what the user should know


def identify(
    logs: Sequence[BenchLog],
    config_mapping: Mapping[str, Any],
    model_type: str,
    method: str = "joint",
    variant: str = "average",
    order: int | None = None,
    progress: Progress = lambda fraction: None,
) -> Identification:
    """Fit a model of ``model_type`` on bench logs.

    ``config_mapping`` holds the bench's parameters (a model in it is replaced).  ``order`` of the
    stress polynomials; None: chosen on held-out cycles (appendix C: 2).  ``variant`` of the
    Ni-Ti-Cu model.  Raises IdentificationError naming what the logs lack, BenchLogError, ConfigError.
    """
    fitter = _fitter(model_type, method)
    bench = bench_from_mapping(config_mapping)
    everything = as_one_wire(logs, config_mapping) if fitter.any_size else make_experiments(logs, bench)
    fatigue_traces = [t for t in everything if t.kind == "fatigue"]
    experiments = [t for t in everything if t.kind != "fatigue"]
    fitted = fitter.fit(experiments, bench, Asked(method, variant, order, progress))
    notes = list(fitted.notes)
    mapping = copy.deepcopy(dict(config_mapping))
    for stale in ("effects", "calibration"):
        mapping.pop(stale, None)
    mapping["model"] = {"type": model_type, **to_mapping(fitted.coefficients)}
    config = Config.from_mapping(mapping)
    if "displacement_range" in mapping["model"]:
        low_m, high_m = mapping["model"]["displacement_range"]
        seen_m = shortest_seen_m(experiments, config)
        if seen_m > low_m:
            check_width(seen_m, high_m, bench.wire.full_stroke_m)
            if seen_m > low_m + MARGIN * bench.wire.full_stroke_m:
                notes.append(
                    f"heated as far as it goes, the wire shows the model no less than {seen_m * 1e3:.2f} mm at some load: "
                    "its resistance has a minimum and rises again with temperature; the working range ends there, not at "
                    f"{low_m * 1e3:.2f} mm"
                )
            mapping["model"]["displacement_range"] = [seen_m, high_m]
            config = Config.from_mapping(mapping)
    mapping["calibration"] = to_mapping(calibration_of(experiments, config, at_rest=not fitter.any_size))
    config = Config.from_mapping(mapping)
    model = config.model.build(bench.wire)
    fatigue = None
    if fatigue_traces:
        fatigue = fit_fatigue(fatigue_traces)
    if not any(t.kind == "partial" for t in experiments):
        notes.append("no log of partial cycles: minor loops, and with them the transition, rest on full cycles alone")
    notes += [
        f"{t.name}: fitted on {t.cycle[-1]} of its {t.cycle[-1] + t.log.metadata[LEFT_OUT]} full cycles, which repeat each other"
        for t in experiments
        if LEFT_OUT in t.log.metadata
    ]
    return Identification(
        mapping=mapping,
        config=config,
        intervals={name: _interval(draws) for name, draws in fitted.samples.items()},
        errors=log_errors(model, experiments, model.displacement_range_m, bench.wire.full_stroke_m),
        fit=fitted.how,
        experiments=tuple(experiments),
        fatigue=fatigue,
        notes=notes,
    )


def _fitter(model_type: str, method: str) -> Fitter:
    """The fitter of a model.  Raises ConfigError where there is none, or none that fits so."""
    if model_type not in FITTERS:
        raise ConfigError(f"model: '{model_type}' is not one of {', '.join(FITTERS)}")
    if method not in METHODS:
        raise ConfigError(f"method: '{method}' is not one of {', '.join(METHODS)}")
    fitter = FITTERS[model_type]
    if method not in fitter.methods:
        able = ", ".join(name for name, each in FITTERS.items() if method in each.methods)
        raise ConfigError(f"method: {method} is not for {model_type}; it is for {able}")
    return fitter


def _interval(draws: np.ndarray) -> list[tuple[float, float]]:
    low, high = np.percentile(draws, (2.5, 97.5), axis=0)
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]
