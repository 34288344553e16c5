"""Where an error lives: what it depends on, how much of it is noise, how much comes back every cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .evidence import Comparison
from .prediction import smooth
from .quantities import quantities

BINS = 10  #: of a quantity, with as many samples each
#: Readings are smoothed as if they were so far apart, so over six of them whatever their rate: noise goes from one to
#: the next.
APART_s = 0.05
STILL_percent = 60.0  #: of the readings: where the resistance moves least, its slope says nothing
NORMAL = 1.4826  #: standard deviation of a normal distribution over its median absolute deviation
SECOND_DIFFERENCE = 6.0  #: variance of one of white noise, over that of the noise
BLOCKED = ("time_s", "cycle")  #: quantities that go with the cycle itself


@dataclass(frozen=True, slots=True)
class Anatomy:
    """Of one residual; shares are of its mean square, on cycles that the means were not taken from."""

    noise_percent: float  #: mean absolute error that the sensors' noise alone makes, % of full stroke
    repeats: float  #: share that comes back at the same branch and position in other cycles
    depends: dict[str, float]  #: share that each quantity alone explains, largest first


def anatomy(comparison: Comparison) -> Anatomy:
    """Take the unexpected residual apart."""
    error_m, unit = comparison.unexpected_m, comparison.evidence.of_displacement.row_units
    seen = unit % 2 == 0
    values = quantities(comparison)
    depends = {name: _share(error_m, _bins(v), seen, blocked=name in BLOCKED) for name, v in values.items()}
    place = _bins(values["displacement_m"]) * 2 + (values.get("branch", np.zeros(len(unit))) > 0.5)
    return Anatomy(
        noise_percent(comparison),
        _share(error_m, place, seen),
        dict(sorted(depends.items(), key=lambda item: -item[1])),
    )


def noise_percent(comparison: Comparison) -> float:
    """Mean absolute error that no model could remove: the noise of R, load and reference, carried through the model."""
    evidence, total, number = comparison.evidence, 0.0, 0
    logs = zip(evidence.logs.experiments, comparison.predictions, evidence.logs.measured_m, strict=True)
    for experiment, p, measured_m in logs:
        reference_m = white_noise(measured_m)
        moved_m, moved_Ohm = (np.gradient(smooth(values, APART_s)) for values in (p.model_m, p.resistance_Ohm))
        moved = moved_m / _away_from_zero(moved_Ohm)
        slope = np.median(np.abs(moved[np.isfinite(moved)])) if np.isfinite(moved).any() else 0.0
        total += len(measured_m) * float(np.hypot(reference_m, slope * white_noise(experiment.resistance_Ohm)))
        number += len(measured_m)
    return float(np.sqrt(2.0 / np.pi) * total / number / evidence.full_stroke_m * 100)


def white_noise(values: np.ndarray) -> float:
    """Standard deviation of white noise, from second differences: what moves slowly does not count."""
    return (
        float(NORMAL * np.median(np.abs(np.diff(values, 2)))) / np.sqrt(SECOND_DIFFERENCE) if len(values) > 3 else 0.0
    )


def _away_from_zero(values: np.ndarray) -> np.ndarray:
    return np.where(np.abs(values) > np.percentile(np.abs(values), STILL_percent), values, np.nan)


def _bins(values: np.ndarray) -> np.ndarray:
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)[1:-1]))
    return np.searchsorted(edges, values, side="right")


def _share(error: np.ndarray, place: np.ndarray, seen: np.ndarray, blocked: bool = False) -> float:
    """Share of the mean square that the means over the places explain in the samples that were not seen.

    ``blocked``: for quantities that go with the cycle itself, whose bins hold both kinds of cycles anyway.
    """
    size = np.mean(error**2)
    if size == 0.0:
        return 0.0
    explained = []
    for train in (seen, ~seen):
        if not train.any() or train.all():
            return 0.0
        number = np.bincount(place[train], minlength=place.max() + 1)
        mean = np.bincount(place[train], error[train], minlength=place.max() + 1) / np.maximum(number, 1)
        rest = error[~train] - mean[place[~train]]
        explained.append(1.0 - np.mean(rest**2) / np.mean(error[~train] ** 2))
    return float(max(np.mean(explained), 0.0))
