"""How far off a model is on some logs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .evidence import Comparison, Evidence
from .witnesses import WITNESSES


@dataclass(frozen=True, slots=True)
class Errors:
    """Of a model with or without effects, in every unit, arrays of shape (units,)."""

    comparison: Comparison  #: by the fit to all of the logs; what follows is by fits that have not seen the unit
    losses: np.ndarray
    percent: np.ndarray  #: mean absolute error, % of full stroke
    unexpected_percent: np.ndarray  #: what of that the calibration does not let expect
    left: float  #: squares of the residual, over those of the calibration
    witnesses: dict[str, float]  #: how far off each is that there is, rms in standard deviations of the calibration


def losses(evidence: Evidence, rows: np.ndarray) -> np.ndarray:
    """Loss of every unit, shape (units,), of the rows of a :class:`Comparison`."""
    return 0.5 * np.bincount(evidence.unit_of_row, rows**2, minlength=evidence.units)


def errors_of(comparison: Comparison) -> Errors:
    """Of a model to which nothing was fitted."""
    return errors_by(comparison, comparison.rows, comparison.errors_percent, comparison.unexpected_percent)


def errors_by(comparison: Comparison, rows: np.ndarray, percent: np.ndarray, unexpected_percent: np.ndarray) -> Errors:
    """By rows and percentages of other fits than the comparison's."""
    evidence = comparison.evidence
    others = slice(evidence.rows_of_samples, None)
    witness, off = evidence.witness_of_row[others], rows[others]
    number = np.bincount(witness, minlength=len(WITNESSES))
    squares = np.bincount(witness, off**2, minlength=len(WITNESSES))
    witnesses = {name: math.sqrt(s / n) for name, s, n in zip(WITNESSES, squares, number, strict=True) if n}
    left = float(np.sum(rows[: evidence.rows_of_samples] ** 2) / evidence.independent.sum())
    return Errors(comparison, losses(evidence, rows), percent, unexpected_percent, left, witnesses)
