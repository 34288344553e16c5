"""Effects a strain model can lack, each at its own stage of the chain.

An effect is a class (or a file) of its own: parameters with ranges, and a method for every stage at
which it acts, which changes a :class:`Frame` of n samples in place.

* ``measured``: circuit and load cell, before anything is made of the signals;
* ``at_resistance``: the wire, on the resistance that the strain model sees;
* ``at_displacement``: the wire and the mechanism, on the displacement that it gives;
* ``shown``: the reference sensor, only where a log is judged.

With all parameters of size at zero an effect changes nothing.  What else it says of itself is in
:class:`Effect`; ``@EFFECTS.register("its_name")`` makes it known.
"""

from . import circuit, load_cell, mechanism, reference, wire
from .effect import EFFECTS, NOT_THE_MODEL, PARTS, QUANTITIES, STAGES, Effect, EffectError, in_order
from .section import Effects, effects_from_mapping

__all__ = [
    "EFFECTS",
    "NOT_THE_MODEL",
    "PARTS",
    "QUANTITIES",
    "STAGES",
    "Effect",
    "EffectError",
    "Effects",
    "circuit",
    "effects_from_mapping",
    "in_order",
    "load_cell",
    "mechanism",
    "reference",
    "wire",
]
