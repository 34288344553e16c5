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
    witnesses: dict[str, float]  #: how far off each is that there is, rms in standard deviations of the calibration


def errors_of(comparison: Comparison) -> Errors:
    """Of a model to which nothing was fitted."""
    c, evidence = comparison, comparison.evidence
    return Errors(c, evidence.losses(c.rows), c.errors_percent, c.unexpected_percent, off_by_witness(evidence, c.rows))


def off_by_witness(evidence: Evidence, rows: np.ndarray) -> dict[str, float]:
    """How far off each of WITNESSES is of which there is something, by the rows of a comparison."""
    others = slice(evidence.rows_of_samples, None)
    witness, off = evidence.witness_of_row[others], rows[others]
    number = np.bincount(witness, minlength=len(WITNESSES))
    squares = np.bincount(witness, off**2, minlength=len(WITNESSES))
    return {name: math.sqrt(s / n) for name, s, n in zip(WITNESSES, squares, number, strict=True) if n}
