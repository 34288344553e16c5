"""From setpoint and displacement to a current."""

from .law import ControllerParameters
from .pid import PidParameters

#: The section ``controller`` for each ``controller.type``.
CONTROL_LAWS: dict[str, type[ControllerParameters]] = {"pid": PidParameters}
