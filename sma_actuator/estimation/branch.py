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


@dataclass(frozen=True, slots=True)
class EstimatorParameters:
    """How the branch is told, and how the velocity is smoothed."""

    branch_decision: str = parameter(
        "heat_balance", "how heating is told from cooling", choices=("heat_balance", "power", "resistance_rate")
    )
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


@jit
def _by_power(power: float, state: np.ndarray, on: float, off: float) -> bool:
    """``state`` = [heating, –]."""
    if power >= on:
        state[0] = 1.0
    elif power <= off:
        state[0] = 0.0
    return state[0] > 0.5


@jit
def _by_heat_balance(time: float, power: float, state: np.ndarray, time_constant: float, hysteresis: float) -> bool:
    """``state`` = [heating, power that holds the present temperature, time]."""
    state[1] -= expm1(-max(time - state[2], 0.0) / time_constant) * (power - state[1])
    state[2] = time
    if power > state[1] * (1.0 + hysteresis):
        state[0] = 1.0
    elif power < state[1] * (1.0 - hysteresis):
        state[0] = 0.0
    return state[0] > 0.5


@jit
def _by_resistance(resistance: float, state: np.ndarray, deadband: float) -> bool:
    """``state`` = [heating, extreme of R on this branch]."""
    if state[0] > 0.5:
        if resistance > state[1] + deadband:
            state[0], state[1] = 0.0, resistance
        elif resistance < state[1]:
            state[1] = resistance
    else:
        if resistance < state[1] - deadband:
            state[0], state[1] = 1.0, resistance
        elif resistance > state[1]:
            state[1] = resistance
    return state[0] > 0.5


@jit
def _by_power_all(power: np.ndarray, state: np.ndarray, on: float, off: float, heating: np.ndarray) -> None:
    for i in range(len(power)):
        heating[i] = _by_power(power[i], state, on, off)


@jit
def _by_heat_balance_all(
    time: np.ndarray, power: np.ndarray, state: np.ndarray, time_constant: float, hysteresis: float, heating: np.ndarray
) -> None:
    for i in range(len(power)):
        heating[i] = _by_heat_balance(time[i], power[i], state, time_constant, hysteresis)


@jit
def _by_resistance_all(resistance: np.ndarray, state: np.ndarray, deadband: float, heating: np.ndarray) -> None:
    for i in range(len(resistance)):
        heating[i] = _by_resistance(resistance[i], state, deadband)


class BranchDetector:
    """Decides the branch, one sample or many at a time, with one memory."""

    def __init__(self, parameters: EstimatorParameters):
        self._state = np.zeros(3)
        self.configure(parameters)

    def configure(self, parameters: EstimatorParameters) -> None:
        """Take over parameters; the memory stays."""
        self._decision = parameters.branch_decision
        hysteresis = parameters.heating_power_hysteresis
        threshold_W = parameters.heating_power
        self._thresholds_W = (threshold_W * (1.0 + hysteresis), threshold_W * (1.0 - hysteresis))
        self._lag = (parameters.thermal_time_constant, hysteresis)
        self._deadband_Ohm = parameters.resistance_deadband

    def reset(self, time_s: float, resistance_Ohm: float, power_W: float, heating: bool = False) -> None:
        """Start on one branch, in thermal balance."""
        self._state[:] = heating, resistance_Ohm if self._decision == "resistance_rate" else power_W, time_s

    def step(self, time_s: float, resistance_Ohm: float, power_W: float) -> bool:
        """Whether the wire is heating."""
        if self._decision == "heat_balance":
            return bool(_by_heat_balance(time_s, power_W, self._state, *self._lag))
        if self._decision == "power":
            return bool(_by_power(power_W, self._state, *self._thresholds_W))
        return bool(_by_resistance(resistance_Ohm, self._state, self._deadband_Ohm))

    def run(self, time_s: np.ndarray, resistance_Ohm: np.ndarray, power_W: np.ndarray) -> np.ndarray:
        """Whether the wire is heating, of n samples: arrays of shape (n,), bool."""
        heating = np.empty(len(time_s), dtype=np.bool_)
        if self._decision == "heat_balance":
            _by_heat_balance_all(time_s, power_W, self._state, *self._lag, heating)
        elif self._decision == "power":
            _by_power_all(power_W, self._state, *self._thresholds_W, heating)
        else:
            _by_resistance_all(resistance_Ohm, self._state, self._deadband_Ohm, heating)
        return heating
