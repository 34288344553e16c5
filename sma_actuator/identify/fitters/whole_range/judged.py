"""How good the whole-range model is where it was not fitted: logs, loads and cycles left out; and beside the thesis's
model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.calibration.interval import COVERAGE
from sma_actuator.estimation.models.whole_range import WholeRangeCoefficients
from sma_actuator.estimation.models.whole_range_kernel import CURVE_TERMS
from sma_actuator.identify.fitters.fitting import predict
from sma_actuator.identify.verdict.unseen import Unseen
from sma_actuator.logs.experiments import Experiment

from .data import FOLDS, Data
from .learner import LEARNERS, Team, physical_curve, terms_of

PLACES = 6  #: at which the interval is stated, on either branch
_PLACE_WIDTH = 0.8  #: of the window around a place, in distances of places
#: A load left out leaves a gap twice as wide as the one that a load between its neighbours finds, and what is between
#: is off by the square of it.
LOAD_LEFT_OUT = 0.25
LEARNERS_OF_LOADS = 2  #: at such a load
HELD_OUT_ITERATIONS = 40


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Errors of the model on cycles that it was not fitted on, mean absolute, % of full stroke."""

    cycles_percent: float
    regions: dict[str, float]  #: by region (:func:`regions`)


@dataclass(frozen=True, slots=True)
class WholeRangeFit:
    """What was found, and how good it is where it was not fitted."""

    coefficients: WholeRangeCoefficients
    held_out: HeldOut
    unseen: Unseen  #: samples of logs left out, as far off as at loads between those of the fit
    bounds: list[str]  #: a sentence for every number of the heat balance that stands at the end of its range


def regions(place: np.ndarray, partial: np.ndarray, size: np.ndarray) -> dict[str, float]:
    """Mean of ``size`` at either end of the stroke (a tenth of it), between them, and in logs of partial cycles."""
    low, high = np.percentile(place, (0.5, 99.5))
    hot, cold = place < low + 0.1 * (high - low), place > high - 0.1 * (high - low)
    chosen = {"hot end": hot, "cold end": cold, "between": ~hot & ~cold, "partial cycles": partial}
    return {name: float(size[rows].mean()) for name, rows in chosen.items() if rows.any()}


def beside_the_thesis(
    experiments: Sequence[Experiment], thesis, found: WholeRangeFit, full_stroke_m: float
) -> tuple[bool, str]:
    """Whether to take the thesis's rather, and why: one sentence.

    ``thesis`` is a model of the thesis fitted on the very logs it is judged on; the whole-range model is judged on
    cycles left out, so what speaks for it is not the fit.
    """
    measured_m = np.concatenate([t.displacement_m for t in experiments])
    size = np.abs(predict(thesis, experiments) - measured_m) / full_stroke_m * 100.0
    good = np.isfinite(size)
    partial = np.repeat([t.kind == "partial" for t in experiments], [len(t.displacement_m) for t in experiments])
    theirs = regions(measured_m[good], partial[good], size[good])
    ours = found.held_out.regions
    words = ", ".join(f"{name} {ours[name]:.2f} against {theirs[name]:.2f} %" for name in ours if name in theirs)
    worse = [name for name in ours if name in theirs and ours[name] > theirs[name]]
    if not worse:
        return (
            False,
            f"take whole_range: on cycles left out it is better in every region than the thesis's model ({words})",
        )
    if found.held_out.cycles_percent < float(size[good].mean()):
        return (
            False,
            (
                f"take whole_range, but not for its sake at {' and '.join(worse)}, where the thesis's model is better "
                f"({words})"
            ),
        )
    return True, f"take the thesis's model: on cycles left out whole_range is worse ({words}); it may want more logs"


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Of every row, by learners that did not see it: error, their spread, error of the curve alone [%]."""

    error: np.ndarray
    spread: np.ndarray
    curve_error: np.ndarray

    @property
    def floor(self) -> float:
        """What is added to a spread before errors are counted in it: how far learners are usually apart, or off where
        that is more, since what all of them lack is in no spread; else a spread twice as wide said twenty times that
        error."""
        return max(float(np.median(self.spread)), float(np.median(np.abs(self.error))))

    def beside(self, other: LeftOut, share: float) -> LeftOut:
        """The same with so much of another's error and spread added, which are independent of it."""
        error = np.hypot(self.error, share * other.error)
        return LeftOut(
            np.where(self.error < 0.0, -error, error), np.hypot(self.spread, share * other.spread), self.curve_error
        )


def errors_left_out(z: np.ndarray, data: Data, fold: np.ndarray, learners: int = LEARNERS) -> LeftOut:
    """Learn afresh without each fold in turn, from fewer rows; the heat balance stands.  No error where a row is NEVER
    left out."""
    target = data.displacement[data.rows]
    found = LeftOut(*(np.zeros(len(z)) for _ in range(3)))
    for number in range(FOLDS):
        out = fold == number
        if not out.any():
            continue
        learn = ~out & data.learned & data.fewer
        along_stress = data.along_stress_of(learn)
        team = Team(z[learn], target[learn], HELD_OUT_ITERATIONS, along_stress, learners)
        value, found.spread[out] = team.values(z[out])
        found.error[out] = value - target[out]
        found.curve_error[out] = (
            terms_of(z[out])[:, :CURVE_TERMS] @ physical_curve(z[learn], target[learn], along_stress) - target[out]
        )
    return found


def intervals_of(
    place: np.ndarray, heating: np.ndarray, score: np.ndarray, places: np.ndarray, level: float = COVERAGE
) -> np.ndarray:
    """A quantile of a score on either branch near each place, shape (2, PLACES)."""

    def quantile(near: np.ndarray) -> float:
        # The level is the one that conformal prediction asks for of so many.
        return float(np.quantile(near, min(1.0, level * (1.0 + 1.0 / len(near)))))

    return near_places(place, heating, score, places, quantile)


def near_places(
    place: np.ndarray,
    heating: np.ndarray,
    score: np.ndarray,
    places: np.ndarray,
    of: Callable[[np.ndarray], float],
) -> np.ndarray:
    """What is made ``of`` a score on either branch near each place, shape (2, PLACES); of all of it where there is
    little."""
    out = np.full((2, len(places)), of(score))
    reach = _PLACE_WIDTH * (places[1] - places[0])
    for row in range(2):
        for k, middle in enumerate(places):
            near = (heating == bool(row)) & (np.abs(place - middle) < reach)
            if near.sum() >= 40:
                out[row, k] = of(score[near])
    return out
