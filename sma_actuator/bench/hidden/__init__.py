"""A bench with effects that nobody declared: in the wire, in its circuit, in the mechanism or in a sensor.

They act where they act in the world: heat, strain and resistance follow from them by the bench's own
physics, and what the instruments show is computed from what is so.  One number says how strong an
effect is; time constants and phases are drawn from the bench's seed.
"""

from . import foreign, twins  # noqa: F401 - which register themselves
from .effect import AMBIENT, CURRENT, FOREIGN, LOAD, POSITION, TWINS, VOLTAGE, require_twins
from .hiding import hidden_effects

__all__ = [
    "AMBIENT",
    "CURRENT",
    "FOREIGN",
    "LOAD",
    "POSITION",
    "TWINS",
    "VOLTAGE",
    "hidden_effects",
    "require_twins",
]
