"""Where an error lives: what it depends on, how much of it is noise, how much comes back every cycle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.estimation.lag import lagged

from .evidence import Evidence
from .following import smooth
from .witnesses import Prediction

BINS = 10
POWER_LAGS_s = (1.0, 10.0, 100.0)
BLOCKED = ("time_s", "cycle")  #: quantities that go with the cycle itself


@dataclass(frozen=True, slots=True)
class Anatomy:
    """Of one residual; shares are of its mean square, on cycles that the means were not taken from."""

    noise_percent: float  #: mean absolute error that the sensors' noise alone makes, % of full stroke
    repeats: float  #: share that comes back at the same branch and position in other cycles
    depends: dict[str, float]  #: share that each quantity alone explains, largest first


def quantities(evidence: Evidence, predictions: Sequence[Prediction]) -> dict[str, np.ndarray]:
    """What a residual may depend on, all logs together, of the samples compared, with the unit in the name."""
    out: dict[str, list[np.ndarray]] = {}
    for experiment, unit, rows, p in zip(
        evidence.logs.experiments, evidence.unit, evidence.logs.compared, predictions, strict=True
    ):
        s = experiment.signals
        period_s = float(np.median(np.diff(s.time_s)))
        power_W, resistance_Ohm = p.power_W, p.resistance_Ohm
        slope = np.gradient(smooth(resistance_Ohm, period_s), s.time_s)
        reversal = np.flatnonzero(np.diff(p.heating.astype(int))) + 1
        last = np.concatenate(([0], reversal))[np.searchsorted(reversal, np.arange(len(p.heating)), side="right")]
        values = {
            "time_s": s.time_s - evidence.logs.start_s,
            "resistance_Ohm": resistance_Ohm,
            "displacement_m": p.model_m,
            "stress_Pa": p.stress_Pa,
            "branch": p.heating.astype(float),
            "distance_from_reversal_m": np.abs(p.model_m - p.model_m[last]),
            "power_W": power_W,
            **{f"power_lagged_{lag:g}_s_W": lagged(s.time_s, power_W, lag) for lag in POWER_LAGS_s},
            "cycle": unit.astype(float),
            # Of the current that flows: a model answers the noise of its readings too, which is no error of a sensor.
            "inverse_current_1_A": 1.0 / np.maximum(smooth(s.current_A, period_s), 1e-6),
            "resistance_rate_Ohm_s": slope,
            "ambient_temperature_C": np.broadcast_to(s.ambient_temperature_C, np.shape(power_W)),
        }
        for name, v in values.items():
            out.setdefault(name, []).append(np.asarray(v, dtype=float)[rows])
    together = {name: np.concatenate(parts) for name, parts in out.items()}
    return {name: v for name, v in together.items() if np.isfinite(v).all() and np.ptp(v) > 0.0}


def residual_m(evidence: Evidence, predictions: Sequence[Prediction]) -> np.ndarray:
    """Measured less shown displacement beyond what the calibration lets expect, all logs together, of the samples
    compared."""
    return np.concatenate(evidence.of_displacement.unexpected_m(predictions))


def anatomy(evidence: Evidence, predictions: Sequence[Prediction]) -> Anatomy:
    """Take a residual apart."""
    error_m = residual_m(evidence, predictions)
    unit = evidence.unit_of_row[: evidence.rows_of_samples]
    seen = unit % 2 == 0
    values = quantities(evidence, predictions)
    depends = {name: _share(error_m, _bins(v), seen, blocked=name in BLOCKED) for name, v in values.items()}
    place = _bins(values["displacement_m"]) * 2 + (values.get("branch", np.zeros(len(unit))) > 0.5)
    return Anatomy(
        noise_percent(evidence, predictions),
        _share(error_m, place, seen),
        dict(sorted(depends.items(), key=lambda item: -item[1])),
    )


def noise_percent(evidence: Evidence, predictions: Sequence[Prediction]) -> float:
    """Mean absolute error that no model could remove: the noise of R, load and reference, carried through the model."""
    total, number = 0.0, 0
    for experiment, p, measured_m in zip(evidence.logs.experiments, predictions, evidence.logs.measured_m, strict=True):
        reference_m = _white(measured_m)
        moved = np.gradient(smooth(p.model_m, 0.05)) / _away_from_zero(np.gradient(smooth(p.resistance_Ohm, 0.05)))
        slope = np.median(np.abs(moved[np.isfinite(moved)])) if np.isfinite(moved).any() else 0.0
        total += len(measured_m) * float(np.hypot(reference_m, slope * _white(experiment.resistance_Ohm)))
        number += len(measured_m)
    return float(np.sqrt(2.0 / np.pi) * total / number / evidence.full_stroke_m * 100)


def _white(values: np.ndarray) -> float:
    """Standard deviation of white noise, from second differences: what moves slowly does not count."""
    return float(1.4826 * np.median(np.abs(np.diff(values, 2)))) / np.sqrt(6.0) if len(values) > 3 else 0.0


def _away_from_zero(values: np.ndarray) -> np.ndarray:
    return np.where(np.abs(values) > np.percentile(np.abs(values), 60.0), values, np.nan)


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
