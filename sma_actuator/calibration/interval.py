"""What a model leaves on its own logs at a place, a stress and a branch: what the live interval of an estimate is made
of.

:class:`sma_actuator.estimation.uncertainty.Uncertainty` looks it up, sample by sample.  A trace, which knows the whole
past of a log, is held against :mod:`.expectation` instead.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sma_actuator.base.calibration import IntervalSection
from sma_actuator.base.jit import jit
from sma_actuator.logs.experiments import Experiment

from .stresses import clusters, nearest, rounded

POSITIONS = 13
COVERAGE, INTERVAL = 0.95, 1.96  #: of an interval, and half of it over the standard deviation


def learn(
    experiments: Sequence[Experiment],
    estimates: Sequence[np.ndarray],
    range_m: tuple[float, float],
    full_stroke_m: float,
) -> IntervalSection:
    """The mean residual by position, stress and branch, and the scatter about it.

    ``experiments`` as the model's chain sees them, ``estimates``: its displacements; ``range_m``: where the model
    works.
    """
    residuals = [t.displacement_m - d for d, t in zip(estimates, experiments, strict=True)]
    position_m = np.linspace(*_widened(range_m, estimates), POSITIONS)
    stress_Pa = clusters([t.mean_stress_Pa for t in experiments])
    parts = [
        _sums(position_m, stress_Pa, d, t.stress_Pa, t.heating, r)
        for d, t, r in zip(estimates, experiments, residuals, strict=True)
    ]
    total = np.sum(parts, axis=0)
    rests = []  # of each log, with the residuals of the others taken off
    for part, d, t, r in zip(parts, estimates, experiments, residuals, strict=True):
        heating, cooling = _means(total - part if len(parts) > 1 else total)
        rests.append(r - expected_residual_m(position_m, stress_Pa, heating, cooling, d, t.stress_Pa, t.heating))
    scatter = [float(np.nanmean(np.abs(r))) / full_stroke_m * 100 for r in rests]
    one_stress = np.zeros(1)
    squares = np.sum(
        [
            _sums(position_m, one_stress, d, np.zeros(len(r)), t.heating, r**2)
            for d, t, r in zip(estimates, experiments, rests, strict=True)
        ],
        axis=0,
    )
    scatter_heating, scatter_cooling = (np.sqrt(m[0]) for m in _means(squares))
    heating, cooling = _means(total)
    return IntervalSection(
        scatter=float(np.mean(scatter)),
        residual_stress=rounded(stress_Pa, 0),
        residual_position=rounded(position_m, 8),
        residual_heating=rounded(heating.ravel(), 8),
        residual_cooling=rounded(cooling.ravel(), 8),
        scatter_heating=rounded(scatter_heating, 8),
        scatter_cooling=rounded(scatter_cooling, 8),
    )


def _widened(range_m: tuple[float, float], estimates: Sequence[np.ndarray]) -> tuple[float, float]:
    everything = np.concatenate(estimates)
    low, high = np.nanpercentile(everything, (0.2, 99.8))
    return min(range_m[0], float(low)), max(range_m[1], float(high))


def _sums(position_m, stress_Pa, estimate_m, sample_stress_Pa, heating, residual_m) -> np.ndarray:
    """Sum and number of residuals by branch, stress and position, shape (2, 2, S, P)."""
    out = np.zeros((2, 2, len(stress_Pa), len(position_m)))
    good = np.isfinite(estimate_m + residual_m + sample_stress_Pa)
    step_m = position_m[1] - position_m[0]
    p = np.clip(np.rint((estimate_m[good] - position_m[0]) / step_m), 0, len(position_m) - 1).astype(int)
    s = nearest(sample_stress_Pa[good], stress_Pa)
    b = np.where(heating[good], 0, 1)
    np.add.at(out[0], (b, s, p), residual_m[good])
    np.add.at(out[1], (b, s, p), 1.0)
    return out


def _means(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean residual of heating and of cooling, each of shape (S, P); an empty place takes its neighbours' value."""
    out = []
    for total, number in zip(*sums, strict=True):
        mean = np.zeros_like(total)
        for s in range(len(total)):
            filled = np.flatnonzero(number[s] > 3)
            if len(filled):
                mean[s] = np.interp(np.arange(total.shape[1]), filled, total[s, filled] / number[s, filled])
        out.append(mean)
    return out[0], out[1]


def expected_residual_m(
    position_m, stress_Pa, heating_m, cooling_m, estimate_m, sample_stress_Pa, heating
) -> np.ndarray:
    """Residual of the calibration at each of n samples, between positions (P,) and stresses (S,) linear, else the
    nearest."""
    out = np.empty(len(estimate_m))
    table = np.stack((np.reshape(cooling_m, (len(stress_Pa), -1)), np.reshape(heating_m, (len(stress_Pa), -1))))
    _look_up(np.asarray(position_m), np.asarray(stress_Pa), table, estimate_m, sample_stress_Pa, heating, out)
    return out


@jit
def _look_up(position, stress, table, estimate, sample_stress, heating, out):
    step = (position[-1] - position[0]) / (len(position) - 1)
    last = len(stress) - 1
    for i in range(len(out)):
        x = (estimate[i] - position[0]) / step
        if not (x == x and sample_stress[i] == sample_stress[i]):
            out[i] = np.nan
            continue
        x = min(max(x, 0.0), len(position) - 1.0)
        p = min(int(x), len(position) - 2)
        x -= p
        s = 0
        while s < last - 1 and sample_stress[i] > stress[s + 1]:
            s += 1
        y = 0.0
        above = s
        if last > 0:
            above = s + 1
            y = min(max((sample_stress[i] - stress[s]) / (stress[above] - stress[s]), 0.0), 1.0)
        b = 1 if heating[i] else 0
        low = table[b, s, p] * (1.0 - x) + table[b, s, p + 1] * x
        high = table[b, above, p] * (1.0 - x) + table[b, above, p + 1] * x
        out[i] = low * (1.0 - y) + high * y
