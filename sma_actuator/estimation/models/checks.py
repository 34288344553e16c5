"""Sentences about coefficients that do not suit a wire; every model says them alike."""

from __future__ import annotations

from typing import Any

import numpy as np

from sma_actuator.base.sections import Wire

SIZE_TOLERANCE = 0.02
#: Of wires of either alloy, hot or cold, and more: 0.5 to 1.15 µΩ·m stand in the literature.
_RESISTIVITIES_Ohm_m = np.linspace(0.4e-6, 1.3e-6, 91)
COUNTS_CONTRACTION = (
    "so it counts contraction, and with it a controller would heat where it should cool; turn the sign of the "
    "displacement in its logs (--unit displacement_m=-mm) and identify the wire again"
)


def wrong_size(length_m: float, diameter_m: float, form: str, wire: Wire) -> list[str]:
    """Sentences when coefficients of one wire are used for a wire of another size."""
    problems = []
    for name, wanted, found in (("length", length_m, wire.length), ("diameter", diameter_m, wire.diameter)):
        if not abs(found - wanted) <= SIZE_TOLERANCE * wanted:
            problems.append(
                f"wire.{name}: {found:g} m, but the coefficients were fitted on a wire of {wanted:g} m "
                f"(model.calibrated_{name}); identify this wire, or use a normalised model"
            )
    if form != wire.form_text:
        problems.append(
            f"wire.form: {wire.form_text or 'wire'}, but the coefficients were fitted on {form or 'a straight wire'} "
            "(model.calibrated_form); identify this wire"
        )
    return problems


def wrong_ranges(**ranges: tuple[float, ...]) -> list[str]:
    """Sentences for ranges that are not two ascending numbers."""
    return [
        f"model.{name}: {list(values)} is not a range; two ascending numbers are wanted"
        for name, values in ranges.items()
        if not (len(values) == 2 and values[0] < values[1])
    ]


def as_range(values: tuple[float, ...], scale: float = 1.0) -> tuple[float, float]:
    """Two numbers that :func:`wrong_ranges` has nothing against, times ``scale``."""
    low, high = values
    return low * scale, high * scale


def wrong_sense(model: Any, wire: Wire) -> list[str]:
    """A sentence where a model says that the wire grows shorter as its resistance rises; a wire is long where it is
    cold.

    ``model`` is a StrainModel; where no resistance that such a wire may have lies in its working range, nothing is
    said.
    """
    resistance_Ohm = wire.resistance_Ohm(_RESISTIVITIES_Ohm_m)
    stress_Pa = np.full(len(resistance_Ohm), np.mean(model.stress_range_Pa))
    middle_m = np.mean(model.limits_m(resistance_Ohm, stress_Pa), axis=0)
    low_m, high_m = model.displacement_range_m
    inside = (low_m <= middle_m) & (middle_m <= high_m)
    rises_m = np.diff(middle_m)[inside[1:] & inside[:-1]]
    if rises_m.sum() >= 0.0:
        return []
    return [f"model: its displacement falls as the resistance rises, {COUNTS_CONTRACTION}"]
