"""Heating or cooling: which branch the wire is on (thesis, 5.1.4).

``power``: the electrical power against a threshold with hysteresis.  Right under on/off control and
wherever power changes much from one branch to the other; under a PID that holds a position, power
settles near a threshold and says little.

``heat_balance``: the power against what it takes to hold the present temperature.  Temperature
above ambient follows power through a first-order lag, so that is the power's own low-pass: the
temperature rises while power is above it.  Right under on/off control and under a PID, whatever
the load and the position held; the time constant is the wire's, latent heat included.

``resistance_rate``: where R rises or falls.  R is followed with a deadband: the branch turns when R
has moved back from its extreme by more than the deadband, so noise below it turns nothing.  Right
in the determinate region, where R falls on heating and rises on cooling.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import expm1

import numpy as np

from sma_actuator.base.jit import jit
from sma_actuator.base.parameters import parameter

DECISIONS = "heat_balance", "power", "resistance_rate"


@dataclass(frozen=True, slots=True)
class EstimatorParameters:
    """How the branch is told, what beside the resistance tells the displacement, and how the velocity is smoothed."""

    branch_decision: str = parameter("heat_balance", "how heating is told from cooling", choices=DECISIONS)
    heating_power: float = parameter(0.2, "wire power above which it is heating (power)", "W", 1e-6, 1e3, live="either")
    heating_power_hysteresis: float = parameter(
        0.1, "half-width of the band around the power that decides, as a fraction of it", "1", 0.0, 0.9, live="either"
    )
    thermal_time_constant: float = parameter(
        5.0,
        "lag of the wire's temperature behind power, latent heat included (heat_balance)",
        "s",
        0.01,
        600.0,
        live="either",
    )
    resistance_deadband: float = parameter(
        2e-3,
        "change of resistance against the branch that turns the branch (resistance_rate)",
        "Ω",
        0.0,
        10.0,
        live="either",
    )
    velocity_time_constant: float = parameter(0.1, "low-pass of the published velocity", "s", 0.0, 10.0, live="either")
    elastic_load: bool = parameter(
        True, "whether a load that rises as the wire contracts, a spring's, tells the displacement too (whole_range)"
    )


@jit
def is_heating(
    decision: int, time: float, resistance: float, power: float, state: np.ndarray, numbers: np.ndarray
) -> bool:
    """By the decision of that number in :data:`DECISIONS`, with what a :class:`BranchDetector` has for it.

    ``state`` = [heating, power that holds the present temperature or extreme of R on this branch, time]; ``numbers`` =
    [time constant, hysteresis], [power above, below], or [deadband, –].
    """
    if decision == 0:
        state[1] -= expm1(-max(time - state[2], 0.0) / numbers[0]) * (power - state[1])
        state[2] = time
        if power > state[1] * (1.0 + numbers[1]):
            state[0] = 1.0
        elif power < state[1] * (1.0 - numbers[1]):
            state[0] = 0.0
    elif decision == 1:
        if power >= numbers[0]:
            state[0] = 1.0
        elif power <= numbers[1]:
            state[0] = 0.0
    elif state[0] > 0.5:
        if resistance > state[1] + numbers[0]:
            state[0], state[1] = 0.0, resistance
        elif resistance < state[1]:
            state[1] = resistance
    elif resistance < state[1] - numbers[0]:
        state[0], state[1] = 1.0, resistance
    elif resistance > state[1]:
        state[1] = resistance
    return state[0] > 0.5


@jit
def _are_heating(
    decision: int,
    time: np.ndarray,
    resistance: np.ndarray,
    power: np.ndarray,
    state: np.ndarray,
    numbers: np.ndarray,
    heating: np.ndarray,
) -> None:
    for i in range(len(power)):
        heating[i] = is_heating(decision, time[i], resistance[i], power[i], state, numbers)


class BranchDetector:
    """What :func:`is_heating` decides the branch by, with its memory: of a chain's single samples, and of whole
    logs."""

    def __init__(self, parameters: EstimatorParameters):
        self.state = np.zeros(3)
        self.configure(parameters)

    def configure(self, parameters: EstimatorParameters) -> None:
        """Take over parameters; the memory stays."""
        self.decision = DECISIONS.index(parameters.branch_decision)
        hysteresis = parameters.heating_power_hysteresis
        threshold_W = parameters.heating_power
        self.numbers = np.array(
            (
                (parameters.thermal_time_constant, hysteresis),
                (threshold_W * (1.0 + hysteresis), threshold_W * (1.0 - hysteresis)),
                (parameters.resistance_deadband, 0.0),
            )[self.decision]
        )

    def reset(self, time_s: float, resistance_Ohm: float, power_W: float, heating: bool = False) -> None:
        """Start on one branch, in thermal balance."""
        by_resistance = DECISIONS[self.decision] == "resistance_rate"
        self.state[:] = heating, resistance_Ohm if by_resistance else power_W, time_s

    def run(self, time_s: np.ndarray, resistance_Ohm: np.ndarray, power_W: np.ndarray) -> np.ndarray:
        """Whether the wire is heating, of n samples: arrays of shape (n,), bool."""
        heating = np.empty(len(time_s), dtype=np.bool_)
        _are_heating(self.decision, time_s, resistance_Ohm, power_W, self.state, self.numbers, heating)
        return heating
