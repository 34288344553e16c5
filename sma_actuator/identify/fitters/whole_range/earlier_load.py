"""Samples in which a wire is where an earlier load left it, which nothing that the model sees can say.

A cold wire is as long as it cooled, under the weight before perhaps: hung on it cold, a heavier one stretches it by
less than cooling under it, a lighter one leaves it longer.  What has been austenite since has forgotten that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sma_actuator.calibration.rest import cold_rests
from sma_actuator.logs.experiments import Experiment, begins_anew
from sma_actuator.logs.kinds import load_numbers


def of_earlier_load(
    experiments: Sequence[Experiment], thermal_time_constant_s: float, least_m: float
) -> list[np.ndarray]:
    """Of each experiment, bool, shape (n,): the samples that an earlier load moves by more than ``least_m``.

    That is how far the wire begins from all places where it rested cold after it was heated under that load, times the
    share of the stroke that it has not gone yet.  None where no log shows such a rest.
    """
    load, anew = load_numbers(experiments), begins_anew(experiments)
    cold_m = [_cold_m(t, thermal_time_constant_s) for t in experiments]
    lowest_m = [np.nanmin(t.displacement_m) for t in experiments]
    out = []
    for k, t in enumerate(experiments):
        alike = np.flatnonzero(load == load[k])
        rests_m = np.concatenate([cold_m[j] for j in alike])
        if not len(rests_m) or not (anew[k] or load[k] != load[k - 1]):
            out.append(np.zeros(len(t.displacement_m), dtype=bool))
            continue
        hot_m = min(lowest_m[j] for j in alike)
        begun_m = t.displacement_m[np.flatnonzero(t.judged)[0]]
        off_m = abs(begun_m - np.clip(begun_m, rests_m.min(), rests_m.max()))
        left = np.fmin.accumulate(np.minimum((t.displacement_m - hot_m) / (rests_m.max() - hot_m), 1.0))
        out.append(off_m * left > least_m)
    return out


def _cold_m(experiment: Experiment, thermal_time_constant_s: float) -> np.ndarray:
    """Displacement at each cold rest after it was heated in this log."""
    return np.array(
        [
            np.mean(experiment.displacement_m[rest.start : rest.stop])
            for rest in cold_rests(experiment, thermal_time_constant_s)
        ]
    )
