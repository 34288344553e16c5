"""A load as a person reads it: on a thin wire or a coil a thousandth of a newton is much."""

from __future__ import annotations

_SMALL_N = 0.1  #: below, millinewtons are too coarse


def newtons(load_N: float) -> str:
    """To a millinewton, of a small load to ten micronewtons."""
    return f"{load_N:.3f}" if abs(load_N) >= _SMALL_N or load_N == 0.0 else f"{load_N:.5f}"
