"""The heat balance of a wire that is held: what a current makes of it is what it loses, I² R = h ΔT."""

from __future__ import annotations

from math import sqrt


def held_rise_K(current_A: float, resistance_Ohm: float, loss_W_K: float) -> float:
    """How far above its surroundings a current holds a wire [K]."""
    return current_A**2 * resistance_Ohm / loss_W_K


def holding_A(rise_K: float, resistance_Ohm: float, loss_W_K: float) -> float:
    """The current that holds a wire so far above its surroundings [A]."""
    return sqrt(loss_W_K * rise_K / resistance_Ohm)
