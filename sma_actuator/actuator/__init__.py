"""One wire: reading in, command out.

``actuator``: the step; ``offered``: what is asked of its position; ``following``: what the control law makes of it;
``tuner``: a tuning of the gains; ``measured``: tare and leads; ``said``: what a step has to say."""

from .actuator import Actuator
from .said import AFTER_A_FAULT, AFTER_A_LOSS, without_advice

__all__ = ["AFTER_A_FAULT", "AFTER_A_LOSS", "Actuator", "without_advice"]
