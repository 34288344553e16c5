"""Samples of logs or cycles that a model was not fitted on, and how far it is off there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.logs.experiments import Experiment
from sma_actuator.logs.kinds import PARTIAL


@dataclass(frozen=True, slots=True)
class Unseen:
    """Arrays of shape (n,)."""

    log: np.ndarray  #: number of the log
    load_N: np.ndarray  #: mean load of that log
    place_m: np.ndarray  #: measured displacement
    error_percent: np.ndarray  #: size of the error, % of the full stroke
    partial: np.ndarray  #: bool: of a log of partial cycles
    what: str = "cycles"  #: that were left out, or "logs", where those were whole ones


def unseen_of(experiments: Sequence[Experiment], estimate_m: np.ndarray, full_stroke_m: float) -> Unseen:
    """Of estimates, shape (N,) over all experiments; samples before the first cycle, and without an estimate, do not
    count."""
    lengths = [len(t.cycle) for t in experiments]
    measured_m = np.concatenate([t.displacement_m for t in experiments])
    cycle = np.concatenate([t.cycle for t in experiments])
    error_percent = np.abs(estimate_m - measured_m) / full_stroke_m * 100.0
    counts = np.isfinite(error_percent) & (cycle > 0)
    loads_N = [float(np.nanmean(t.signals.load_N)) for t in experiments]
    return Unseen(
        log=np.repeat(np.arange(len(experiments)), lengths)[counts],
        load_N=np.repeat(loads_N, lengths)[counts],
        place_m=measured_m[counts],
        error_percent=error_percent[counts],
        partial=np.repeat([t.kind == PARTIAL for t in experiments], lengths)[counts],
    )
