"""Two driven wires on one joint.

``driver``: the law of the pair between their loops; ``fit``: whether they can turn that joint; ``stepped``: by hand."""

from .driver import JointOutput, PairDriver, PairedWire
from .stepped import SteppedPair, SteppedWire

__all__ = ["JointOutput", "PairDriver", "PairedWire", "SteppedPair", "SteppedWire"]
