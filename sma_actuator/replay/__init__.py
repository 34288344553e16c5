"""Any model on any log: errors, curves and loops, beside the literature's models."""

from sma_actuator.logs.bags import log_from_bag

from .command import add_arguments, run
from .replaying import Replay, estimate_m, replay

__all__ = ["Replay", "add_arguments", "estimate_m", "log_from_bag", "replay", "run"]
