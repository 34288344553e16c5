"""What a session in which nothing has happened looks like: what is off together in all that logs say.

Rows of the evidence are in standard deviations of the calibration.  What is off in one reading is off in the next for
two reasons: readings that are near to each other share their error (the evidence weighs them for that), and a model
errs in the same way wherever the wire comes to the same place by the same way.  The latter are *smooth errors* over
where the wire is and what it does, and an offset of each witness; they are no more likely to be small in a long
session than in a short one (Kennedy and O'Hagan 2001).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .evidence import Comparison
from .witnesses import WITNESSES

PLACE = "place"  #: of the wire, and by which branch it came there
KNOTS = 6  #: of the hat functions over each quantity, at its quantiles
FEWER = 4  #: of those that are asked at each place
#: What a model's errors go with, beside the place and the branch.
REPEATING = (
    "stress_Pa",
    "distance_from_reversal_m",
    "power_W",
    "power_lagged_10_s_W",
    "resistance_rate_Ohm_s",
)
#: What errors may go with when something has happened, beside all of that, and what at each place.
NEW = (
    "time_s",
    "power_lagged_100_s_W",
    "inverse_current_1_A",
    "ambient_temperature_C",
    "resistance_Ohm",
)
WITH_PLACE = ("time_s", "stress_Pa", "power_lagged_10_s_W")


class SmoothErrors:
    """What may be off together, as columns of the rows of some evidence, each of the size of the floor."""

    def __init__(self, comparison: Comparison, found: Mapping[str, np.ndarray]):
        """``comparison``: with the model as it is; ``found``: the quantities that its residual may depend on."""
        evidence = comparison.evidence
        samples, rows = evidence.rows_of_samples, len(evidence.unit_of_row)
        #: Root of how many readings each row counts as, shape (rows,).
        self.weight = np.concatenate((evidence.sample_weight, np.ones(rows - samples)))
        nowhere = np.zeros(samples)
        place = _hats(found.get("displacement_m", nowhere), KNOTS)
        heating = (found.get("branch", nowhere) > 0.5)[:, None]
        repeating = [place * heating, place * ~heating, *(_hats(found[n], KNOTS) for n in REPEATING if n in found)]
        witness = evidence.witness_of_row[samples:]
        offsets = np.equal.outer(witness, np.unique(witness)).astype(float)
        self._offsets = np.column_stack((offsets, comparison.unknown))
        when = 2.0 * evidence.unit_of_row[samples:] / max(evidence.units - 1, 1) - 1.0
        #: Of a model on any session, shape (rows, …).
        self.repeating = self._columns(np.column_stack(repeating), self._offsets)
        alone = {name: _hats(found[name], KNOTS) for name in (*REPEATING, *NEW) if name in found}
        alone[PLACE] = np.column_stack(repeating[:2])
        #: Over what the form of an effect may be off, which may move the other witnesses more or less too.
        self.of_forms = {name: self._columns(hats, self._offsets) for name, hats in alone.items() if hats.shape[1]}
        with_place = {name: _hats(found[name], FEWER) for name in WITH_PLACE if name in found}
        alone |= {f"place and {name}": _products(place, hats) for name, hats in with_place.items()}
        still, nothing = np.zeros((len(witness), 0)), np.zeros((samples, 0))
        #: Of a session in which something has happened that has no name: what it may go with, or in which of the other
        #: witnesses alone it drifts; and these.
        self.new = {name: self._columns(columns, still) for name, columns in alone.items() if columns.shape[1]}
        for k in np.unique(witness):
            of_it = (witness == k)[:, None]
            self.new[WITNESSES[k]] = self._columns(nothing, of_it * np.column_stack((np.ones(len(when)), when)))

    def _columns(self, of_samples: np.ndarray, of_others: np.ndarray) -> np.ndarray:
        out = np.zeros((len(self.weight), of_samples.shape[1] + of_others.shape[1]))
        out[: len(of_samples), : of_samples.shape[1]] = of_samples
        out[len(of_samples) :, of_samples.shape[1] :] = of_others
        return out * self.weight[:, None]

    def of_form(self, moved: np.ndarray, over: str) -> np.ndarray:
        """What is off where an effect moves the rows by ``moved`` and its form is not quite its own, (rows, …)."""
        return self.of_forms[over] * np.abs(moved / self.weight)[:, None]


def _products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Of every column of the one and of the other, shape (n, …)."""
    return (a[:, :, None] * b[:, None, :]).reshape(len(a), -1)


def _hats(values: np.ndarray, number: int) -> np.ndarray:
    """Hat functions of a quantity, shape (n, number or fewer); none where it stands still."""
    knots = np.unique(np.quantile(values, np.linspace(0.0, 1.0, number)))
    if len(knots) < 2:
        return np.zeros((len(values), 0))
    return np.column_stack([np.interp(values, knots, hat) for hat in np.eye(len(knots))])
