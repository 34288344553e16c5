"""What a control law is: it turns position and setpoint into a current, and takes over without a jump."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.errors import UserError
from sma_actuator.base.parameters import parameter
from sma_actuator.base.registry import Registry
from sma_actuator.base.sections import SupplyParameters, ThermalParameters, Wire
from sma_actuator.base.signals import Estimate, Signals

#: Periods of the loop until what is asked for now acts: a reading is the mean over the one before, and a command stands
#: for one.
OWN_PERIODS = 1.5


class LawSections(Protocol):
    """The parameters that a control law is built from; a ``Config`` has them."""

    @property
    def wire(self) -> Wire:
        """The wire."""

    @property
    def supply(self) -> SupplyParameters:
        """The limits of the current."""

    @property
    def thermal(self) -> ThermalParameters:
        """The heat balance."""

    @property
    def calibration(self) -> Calibration:
        """What the model's own logs looked like."""


@dataclass(frozen=True, slots=True)
class ControllerParameters:
    """What every control law has: how setpoints are followed, and what happens when they stop."""

    setpoint_rate_limit: float = parameter(
        0.01, "fastest change of the setpoint the controller follows", "m/s", 1e-6, 10.0, live="lower"
    )
    setpoint_timeout: float = parameter(
        0.0,
        "silence on the setpoint topic that counts as lost; 0: a setpoint stands until the next",
        "s",
        0.0,
        3600.0,
        live="lower",
        zero_is_never=True,
    )
    joint_command_timeout: float = parameter(
        0.5,
        "silence on the joint command topic that counts as lost, once one is followed",
        "s",
        0.02,
        3600.0,
        live="lower",
    )
    arming_distance: float = parameter(
        0.05,
        "joint commands are followed from the first on that is this near the estimate, as a share of full stroke",
        "1",
        0.0,
        1.0,
        live="lower",
    )
    on_setpoint_loss: str = parameter(
        "hold", "what to do when the setpoint is lost", choices=("hold", "bias", "off"), live="later"
    )

    def build(self, sections: LawSections) -> ControlLaw:
        """The law with these parameters, whose output lies between ``supply.bias_current`` and the limit of each
        step."""
        raise NotImplementedError

    def mismatches(self, sections: LawSections) -> list[str]:
        """Why this law cannot drive that wire."""
        return []


class LawError(UserError):
    """A control law that cannot do what it is for.  The sentence names it."""


class ControlLaw(Protocol):
    """One control law of one wire, with its memory."""

    output_A: float  #: the current of the last step
    reference_m: float  #: the setpoint as far as it is followed yet (rate limited)
    rate_limited: bool  #: the setpoint moves faster than it is followed
    at_max: bool  #: the law wants more than the limit
    at_bias: bool  #: the law wants less than the bias

    def reset(self, position_m: float, output_A: float) -> None:
        """Start at a position and a current [A], without a jump."""

    def set_gains(self, gains: Any) -> None:
        """Take over live parameters between two steps without a jump of the output."""

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """Advance by ``dt_s`` and return the current [A], between the bias and ``limit_A``.

        Arguments that are not finite give the bias current and change nothing.
        """


@runtime_checkable
class SensingLaw(Protocol):
    """A control law that also looks at what is measured, whether the wire is driven or not."""

    paced: bool  #: the wire cannot follow the setpoint so fast, and the law does not ask it to

    def update(self, sections: LawSections) -> None:
        """Take over live parameters of other sections."""

    def sense(self, signals: Signals, estimate: Estimate) -> None:
        """Take note of a reading, before the step that it is used in."""


def _refusal(_name: str, cls: type[ControllerParameters]) -> str:
    if not (isinstance(cls, type) and issubclass(cls, ControllerParameters)):
        return "it is no class of parameters that derives from ControllerParameters"
    return "build is missing: what makes the law" if cls.build is ControllerParameters.build else ""


#: The section ``controller`` for each ``controller.type``.
CONTROL_LAWS: Registry[type[ControllerParameters]] = Registry("control law", "sma_actuator.control_laws", _refusal)
