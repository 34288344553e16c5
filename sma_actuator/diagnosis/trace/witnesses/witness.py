"""What a witness is: one thing that logs show, found in them, and held against what is usual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sma_actuator.diagnosis.trace.limits import LIMITS


@dataclass(frozen=True, slots=True)
class Prediction:
    """A model with effects on one log, arrays of shape (n,)."""

    shown_m: np.ndarray  #: displacement that the reference sensor should show
    model_m: np.ndarray  #: displacement of the strain model alone
    sensor_m: np.ndarray  #: what it should show beyond what the load pulls at
    beside_m: np.ndarray  #: how much further than the wire it should show the joint, where the wire is as expected
    expected_m: np.ndarray  #: residual that is expected, of the samples that are compared
    heating: np.ndarray
    resistance_Ohm: np.ndarray  #: as the strain model sees it
    power_W: np.ndarray
    heat_W: np.ndarray  #: what of it the calibration's heat balance sees
    stress_Pa: np.ndarray
    elapsed_s: np.ndarray


class Witness(Protocol):
    """One kind of thing that the logs show; each time that they show it is a row."""

    row_names: np.ndarray  #: which of them each row is, shape (n,)
    row_units: np.ndarray  #: which unit each row lies in, shape (n,)

    @property
    def names(self) -> Sequence[str]:
        """What it shows, as a person reads it."""

    def off(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How far off each row is, in units of what is usual, shape (n,)."""

    def late(self, predictions: Sequence[Prediction]) -> np.ndarray:
        """How much further off each row is where the load is read one reading later, shape (n,); as a rule nothing."""
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
