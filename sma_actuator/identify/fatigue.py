"""Drift with the number of cycles, y = g₁ ln N + g₂ (4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.logs.experiments import Experiment, IdentificationError

#: What is followed, with the words for a picture.
EXTREMES = {
    "resistance_min_Ohm": "smallest resistance [Ω]",
    "resistance_max_Ohm": "largest resistance [Ω]",
    "displacement_min_m": "smallest displacement [m]",
    "displacement_max_m": "largest displacement [m]",
}


@dataclass(frozen=True, slots=True)
class Drift:
    """One quantity against the cycle number."""

    g1: float  #: change per e-fold of the cycle number, in the quantity's unit
    g2: float  #: value at the first cycle
    g1_interval: tuple[float, float]  #: 95 %
    rms: float  #: of what is left over


@dataclass(frozen=True, slots=True)
class Fatigue:
    """Extremes of every cycle, shape (n,) each, and the lines through them in ln N."""

    cycle: np.ndarray
    extremes: dict[str, np.ndarray]
    drift: dict[str, Drift]


def fit_fatigue(experiments: Sequence[Experiment]) -> Fatigue:
    """ln N lines of the extremes of R and δ over the fatigue logs, numbered from ``first_cycle`` in their metadata.

    The first cycle of a log does not count: it begins at a rest of any length, the others where the pause between
    pulses leaves the wire.  Raises IdentificationError where fewer than five are left.
    """
    number, rows = [], []
    for experiment in experiments:
        first = int(experiment.log.metadata.get("first_cycle", 1))
        for cycle in range(2, int(experiment.cycle.max()) + 1):
            inside = experiment.cycle == cycle
            resistance_Ohm, displacement_m = experiment.resistance_Ohm[inside], experiment.displacement_m[inside]
            number.append(first + cycle - 1)
            rows.append((*_ends(resistance_Ohm), *_ends(displacement_m)))
    if len(number) < 5:
        raise IdentificationError(
            f"fatigue: {len(number)} cycles in the logs, without the first of each; at least 5 are needed for a line "
            f"in ln N"
        )
    order = np.argsort(number)
    numbers, values = np.array(number)[order], np.array(rows)[order].T
    return Fatigue(
        numbers,
        dict(zip(EXTREMES, values, strict=True)),
        {q: _line(numbers, v) for q, v in zip(EXTREMES, values, strict=True)},
    )


def _ends(values: np.ndarray) -> tuple[float, float]:
    return float(np.percentile(values, 1)), float(np.percentile(values, 99))


def _line(number: np.ndarray, y: np.ndarray) -> Drift:
    x = np.log(number)
    g1, g2 = np.polyfit(x, y, 1)
    left = y - g1 * x - g2
    error = np.sqrt(left @ left / max(len(y) - 2, 1) / np.sum((x - x.mean()) ** 2))
    return Drift(
        float(g1), float(g2), (float(g1 - 1.96 * error), float(g1 + 1.96 * error)), float(np.sqrt(np.mean(left**2)))
    )
