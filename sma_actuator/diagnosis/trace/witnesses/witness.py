"""What a witness is: one thing that logs show, found in them, and held against what is usual."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from sma_actuator.diagnosis.trace.limits import LIMITS
from sma_actuator.diagnosis.trace.prediction import Prediction


class Witness(Protocol):
    """One kind of thing that the logs show; each time that they show it is a row."""

    row_names: np.ndarray  #: which of them each row is, shape (n,)
    row_units: np.ndarray  #: which unit each row lies in, shape (n,)

    @property
    def names(self) -> Sequence[str]:
        """What it shows, as a person reads it."""

    def off(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How far off each row is, in units of what is usual, shape (n,)."""

    def unknown(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How much further off each row is where one thing is the other way that no calibration shows, shape (n,); as
        a rule nothing."""
        return np.zeros(len(self.row_units))


def limited(z: np.ndarray) -> np.ndarray:
    """``z`` with Huber's loss as half its square; what is not finite counts as the largest that counts."""
    most = LIMITS.largest
    z = np.clip(np.nan_to_num(z, nan=most, posinf=most, neginf=-most), -most, most)
    size = np.abs(z)
    return np.where(
        size <= LIMITS.linear_from,
        z,
        np.sign(z) * np.sqrt(np.maximum(LIMITS.linear_from * (2.0 * size - LIMITS.linear_from), 0.0)),
    )
