"""Asymptotes of the R-phase wire by the algorithm of the thesis's appendix C, to the letter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sma_actuator.logs.experiments import Experiment, IdentificationError


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Parameters of the algorithm; the defaults are the thesis's."""

    heating_window: int = 4  #: w_H
    cooling_window: int = 10  #: w_C
    heating_correlation: float = 0.999  #: r_tol,H
    cooling_correlation: float = 0.995  #: r_tol,C
    cooling_correlation_rate: float = 0.001  #: r'_tol,C


@dataclass(frozen=True, slots=True)
class Asymptotes:
    """Lines δ = slope·R + intercept at one load, and the samples they went through."""

    stress_Pa: float
    heating: tuple[float, float]  #: a_H [m/Ω], b_H [m]
    cooling: tuple[float, float]  #: a_C, b_C
    heating_points: np.ndarray  #: shape (m, 2): R [Ω], δ [m]
    cooling_points: np.ndarray


def mean_cycle(experiment: Experiment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Resistance, displacement and current state of the mean over the complete cycles of a square wave.

    Raises IdentificationError where there is no complete cycle.
    """
    starts = np.flatnonzero(np.diff(experiment.cycle)) + 1
    ends = np.append(starts[1:], len(experiment.cycle))
    if not len(starts):
        raise IdentificationError(f"{experiment.log.source}: holds no cycle: the current is never switched on")
    length = int(np.min(ends - starts))
    rows = starts[:, None] + np.arange(length)
    driven = experiment.driven[rows].mean(axis=0) > 0.5
    return experiment.resistance_Ohm[rows].mean(axis=0), experiment.displacement_m[rows].mean(axis=0), driven


def asymptotes(experiment: Experiment, tolerances: Tolerances = Tolerances()) -> Asymptotes:
    """Steps 1 to 3 of appendix C.  Raises IdentificationError naming the branch that cannot be found."""
    resistance_Ohm, displacement_m, driven = mean_cycle(experiment)
    source = experiment.log.source
    branches = []
    for name, mask, line in (("heating", driven, _heating_line), ("cooling", ~driven, _cooling_line)):
        if np.count_nonzero(mask) < 2 * tolerances.cooling_window + 3:
            raise IdentificationError(
                f"{source}: the {name} branch has {np.count_nonzero(mask)} samples; there is no {name} branch to fit"
            )
        points = np.column_stack((resistance_Ohm[mask], displacement_m[mask]))
        found = line(points, tolerances)
        if found is None:
            raise IdentificationError(
                f"{source}: the {name} curve is nowhere as straight as appendix C wants it; slow the actuation "
                "down or use the joint fit"
            )
        branches.append(found)
    (heating, heating_points), (cooling, cooling_points) = branches
    return Asymptotes(experiment.mean_stress_Pa, heating, cooling, heating_points, cooling_points)


def _heating_line(points: np.ndarray, tolerances: Tolerances):
    slope, correlation = moving_fit(points, tolerances.heating_window)
    region = _longest_run((correlation > tolerances.heating_correlation) & (slope > 0.0))
    if region is None:
        return None
    return _line(points[region]), points[region]


def _cooling_line(points: np.ndarray, tolerances: Tolerances):
    slope, correlation = moving_fit(points, tolerances.cooling_window)
    correlation = np.where(slope > 0.0, correlation, np.nan)  # c
    rate = np.gradient(correlation)  # d
    bend = np.gradient(rate)
    keep = (correlation > tolerances.cooling_correlation) & (np.abs(rate) < tolerances.cooling_correlation_rate)  # e, f
    runs = _merged(_runs(keep), tolerances.cooling_window)
    if not runs:
        return None
    last = runs[-1]  # g: the one before it is austenite → R-phase; noise may add more before that
    candidates = last.start + np.flatnonzero(keep[last])
    size = np.abs(bend[candidates])
    if np.isnan(size).all():
        return None
    best = int(np.clip(candidates[np.nanargmin(size)], 1, len(points) - 2))  # h
    chosen = points[best - 1 : best + 2]  # i
    return (_line(chosen), chosen) if np.ptp(chosen[:, 0]) > 0.0 else None


def moving_fit(points: np.ndarray, window: int) -> tuple[np.ndarray, np.ndarray]:
    """Slope and correlation of the line through i − window … i + window, NaN at the ends; each shape (n,)."""
    n, width = len(points), 2 * window + 1
    slope, correlation = np.full(n, np.nan), np.full(n, np.nan)
    if n < width:
        return slope, correlation
    windows = np.lib.stride_tricks.sliding_window_view(points, width, axis=0)  # (n − 2w, 2, width)
    centred = windows - windows.mean(axis=2, keepdims=True)
    x, y = centred[:, 0], centred[:, 1]
    xx, yy, xy = (x * x).sum(1), (y * y).sum(1), (x * y).sum(1)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope[window : n - window] = xy / xx
        correlation[window : n - window] = xy / np.sqrt(xx * yy)
    return slope, correlation


def _line(points: np.ndarray) -> tuple[float, float]:
    slope, intercept = np.polyfit(points[:, 0], points[:, 1], 1)
    return float(slope), float(intercept)


def _runs(mask: np.ndarray) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _merged(runs: list[slice], gap: int) -> list[slice]:
    """Runs less than ``gap`` apart are one region: a window cannot tell them apart."""
    out: list[slice] = []
    for run in runs:
        if out and run.start - out[-1].stop < gap:
            out[-1] = slice(out[-1].start, run.stop)
        else:
            out.append(run)
    return out


def _longest_run(mask: np.ndarray) -> slice | None:
    runs = [r for r in _runs(mask) if r.stop - r.start >= 2]
    return max(runs, key=lambda r: r.stop - r.start) if runs else None
