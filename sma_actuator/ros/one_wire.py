"""What the parts of a wire's node know of it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Protocol

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from sma_actuator.base.signals import Output
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.logs.recorder import BenchLogRecorder

from .commands import Commands
from .log import Log


class OneWire(Protocol):
    """The node (``wire.py``), as what it tells and is asked for sees it."""

    driver: Driver | None  #: the loop of the wire; None while no instruments are open
    recorder: BenchLogRecorder | None
    commands: Commands
    log: Log
    is_active: bool  #: it publishes, and takes commands
    refusal: str  #: why the instruments are not open
    left_off: bool  #: the last instruments were given up with the output read back as off
    arming: threading.Lock  #: held while the output goes on, and while the node stops being active
    turned_by: Callable[[], str]  #: the name of the joint that drives it now, else nothing

    @property
    def config(self) -> Config:
        """The parameters as they are now."""

    @property
    def parameter_values(self) -> dict[str, str]:
        """What the status says of the parameters."""

    @property
    def state(self) -> str:
        """Of its life."""

    def get_name(self) -> str:
        """Name of the node."""

    def get_fully_qualified_name(self) -> str:
        """The same with its namespace."""

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all of them, or none."""

    def asked(self, request: Callable[[Driver], tuple[Any, ...]]) -> tuple[bool, str]:
        """What the actuator says to a request, where it can be asked."""

    def is_driven(self) -> bool:
        """Whether the wire is driven.  Raises DriverStopped, or TimeoutError."""

    def not_active(self) -> str:
        """Why it takes no commands."""

    def watch(self, output: Output) -> None:
        """Look how a goal goes."""

    def report(self, sentence: str) -> None:
        """Say why something was refused."""

    def callback_failed(self, error: Exception) -> None:
        """Take an exception that no message is to blame for as a fault."""

    def give_up_driver(self) -> None:
        """Output off, instruments closed."""

    def go_on(self) -> None:
        """Have the driver again."""
