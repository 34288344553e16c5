"""From setpoint and displacement to a current."""

from . import pid
from .law import CONTROL_LAWS, ControllerParameters

__all__ = ["CONTROL_LAWS", "ControllerParameters", "pid"]
