"""Fits the straight line by least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sma_actuator.config import BenchConfig
from sma_actuator.identify.fitters import FITTERS, Asked, Fitted, Fitter
from sma_actuator.logs.experiments import Experiment

from .straight_line import StraightLine


def fit(experiments: Sequence[Experiment], bench: BenchConfig, asked: Asked) -> Fitted:
    """All samples count alike."""
    resistance_Ohm = np.concatenate([t.resistance_Ohm for t in experiments])
    displacement_m = np.concatenate([t.displacement_m for t in experiments])
    good = np.isfinite(resistance_Ohm + displacement_m)
    slope, intercept = np.polyfit(resistance_Ohm[good], displacement_m[good], 1)
    low_m, high_m = np.percentile(displacement_m[good], (5.0, 95.0))
    return Fitted(
        StraightLine(slope=float(slope), intercept=float(intercept), displacement_range=(float(low_m), float(high_m)))
    )


FITTERS.register("straight_line")(Fitter(fit))
