"""How much of what a model is off on some logs is unexpected, of every unit of them, in % of full stroke."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .evidence import Evidence
from .witnesses import Prediction


def unexpected_percent(evidence: Evidence, predictions: Sequence[Prediction]) -> np.ndarray:
    """Mean absolute size of the unexpected residual, shape (units,)."""
    return _compared_percent(evidence, np.abs(np.concatenate(evidence.of_displacement.unexpected_m(predictions))))


def floor_percent(evidence: Evidence) -> float:
    """What that is in the mean where there is none, at these places and with these histories."""
    if evidence.beyond_floor:
        return 0.0
    return float(_compared_percent(evidence, np.concatenate(evidence.of_displacement.floor_m)).mean())


def samples_of_unit(evidence: Evidence) -> np.ndarray:
    """Number of samples, shape (units,)."""
    return np.bincount(np.concatenate(evidence.unit), minlength=evidence.units)


def _compared_percent(evidence: Evidence, values_m: np.ndarray) -> np.ndarray:
    """Mean of the samples compared, shape (units,)."""
    unit = evidence.unit_of_row[: evidence.rows_of_samples]
    number = np.bincount(unit, minlength=evidence.units)
    sums_m = np.bincount(unit, np.nan_to_num(values_m), minlength=evidence.units)
    return sums_m / np.maximum(number, 1) / evidence.full_stroke_m * 100
