"""The virtual bench: a wire in a test stand, and the instruments around it.

Nothing here knows of the estimator, its models or the measuring circuit's equations: the bench stands for the world.
The physics of the wire is a room of its own, :mod:`sma_actuator.plant`, which ``forward`` and ``loop`` use openly too,
to fit it to real wires: what these say of a record of the virtual bench would prove nothing, and is nowhere a figure.
"""

from sma_actuator.plant.loads import Schedule, Spring, Weight

from .bench import Setup, Truth, VirtualBench, setup_of
from .chain import Chain
from .hidden import FOREIGN, TWINS, require_twins
from .hidden.effect import Hidden
from .hidden.hiding import HiddenBench
from .in_process import InProcessDaq, InProcessSupply, VirtualClock

__all__ = [
    "FOREIGN",
    "TWINS",
    "Chain",
    "Hidden",
    "HiddenBench",
    "InProcessDaq",
    "InProcessSupply",
    "Schedule",
    "Setup",
    "Spring",
    "Truth",
    "VirtualBench",
    "VirtualClock",
    "Weight",
    "require_twins",
    "setup_of",
]
