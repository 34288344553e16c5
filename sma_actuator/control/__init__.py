"""From setpoint and displacement to a current."""

from . import feed_forward, pid
from .law import CONTROL_LAWS, ControllerParameters

__all__ = ["CONTROL_LAWS", "ControllerParameters", "feed_forward", "pid"]
