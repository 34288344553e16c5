"""From a new wire to bench logs: the experiments of the thesis's chapter 4 and appendices A and B.

Works on anything with the interfaces of ``sma_actuator.instruments``: real instruments, the
virtual bench over TCP, or the virtual bench in the same process.
"""

from .command import add_arguments, run
from .plan import Part, PlanOptions, make_plan
from .rig import Rig
from .session import characterise

__all__ = ["Part", "PlanOptions", "Rig", "add_arguments", "characterise", "make_plan", "run"]
