"""Errors of a model on experiments, as the thesis counts them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.signals import Signals
from sma_actuator.identify.fitters.fitting import predict
from sma_actuator.logs.experiments import Experiment


@dataclass(frozen=True, slots=True)
class LogError:
    """Mean absolute errors of one log, in % of the full stroke."""

    name: str
    load_N: float  #: mean
    working_percent: float  #: over the samples whose measured displacement is in the working range
    working_share: float  #: the share of samples that is
    full_percent: float  #: over all samples


def log_errors(
    model, experiments: Sequence[Experiment], range_m: tuple[float, float], full_stroke_m: float
) -> list[LogError]:
    """Errors of ``model`` on every experiment."""
    ends = np.cumsum([len(t.displacement_m) for t in experiments])[:-1]
    found = np.split(predict(model, experiments), ends)
    return [log_error(t.name, t.signals, d, range_m, full_stroke_m) for t, d in zip(experiments, found, strict=True)]


def log_error(
    name: str, signals: Signals, estimate_m: np.ndarray, range_m: tuple[float, float], full_stroke_m: float
) -> LogError:
    """Errors of an estimate, shape (n,); samples where it or the measurement is NaN are not judged.

    An error over no sample is NaN.
    """
    measured_m = signals.reference_displacement_m
    error = np.abs(estimate_m - measured_m) / full_stroke_m * 100.0
    judged = np.isfinite(error)
    inside = judged & (range_m[0] <= measured_m) & (measured_m <= range_m[1])
    return LogError(
        name,
        float(np.nanmean(signals.load_N)),
        float(error[inside].mean()) if inside.any() else float("nan"),
        float(inside.mean()),
        float(error[judged].mean()) if judged.any() else float("nan"),
    )
