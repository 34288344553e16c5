"""The virtual bench: the physics of a wire in a test stand, and the instruments around it.

Nothing here knows of the estimator, its models or the measuring circuit's equations: the bench
stands for the world, and shares no mathematics with what is judged against it.
"""

from sma_actuator.plant.loads import Schedule, Spring, Weight

from .bench import Setup, Truth, VirtualBench
from .chain import Chain
from .hidden import EFFECTS, FOREIGN, Hidden, HiddenBench
from .in_process import InProcessDaq, InProcessSupply, VirtualClock

__all__ = [
    "EFFECTS",
    "FOREIGN",
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
]
