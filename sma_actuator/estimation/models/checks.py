"""Sentences about coefficients that do not suit a wire; every model says them alike."""

from __future__ import annotations

from sma_actuator.base.sections import Wire

SIZE_TOLERANCE = 0.02


def wrong_size(length_m: float, diameter_m: float, wire: Wire) -> list[str]:
    """Sentences when coefficients of one wire are used for a wire of another size."""
    problems = []
    for name, wanted, found in (("length", length_m, wire.length), ("diameter", diameter_m, wire.diameter)):
        if not abs(found - wanted) <= SIZE_TOLERANCE * wanted:
            problems.append(
                f"wire.{name}: {found:g} m, but the coefficients were fitted on a wire of {wanted:g} m "
                f"(model.calibrated_{name}); identify this wire, or use a normalised model"
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
