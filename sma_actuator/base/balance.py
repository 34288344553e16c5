"""The heat balance of a wire, and of what warms up around it.

What a current makes of a wire that is held is what it loses, I² R = h ΔT.  Everything that keeps a wire's temperature
keeps it by :func:`gains` (the supervisor's guard has its own, which is to err hot: :mod:`sma_actuator.safety.thermal`).

Between a wire and the air may lie near surroundings, a tube, a coating, the clamps, which warm up with it and keep it
warm afterwards: in balance they take a share a of its rise x.  With s, how warm they are,

    C dx/dt = P − h (x − s) / (1 − a),     ds/dt = (a x − s) / τ_s.

With a = 0 the air begins at the wire.
"""

from __future__ import annotations

from math import exp, isnan, nan, sqrt
from typing import NamedTuple

import numpy as np

from .jit import jit


class Balance(NamedTuple):
    """What a wire's temperature follows from, and its power."""

    time_constant_s: float  #: heat capacity over heat loss
    near_share: float = 0.0  #: of its rise that the near surroundings take in balance
    near_s: float = 1.0  #: their time constant


@jit
def gains(
    rise: float,
    near: float,
    held: float,
    step: float,
    time_constant: float,
    near_share: float,
    near_time: float,
    loss_growth: float = 0.0,
) -> tuple[float, float]:
    """How much warmer a wire gets in a step [s], and its near surroundings, which are ``near`` above the air: in the
    unit of the rise.

    ``held``: the rise at which it would lose the power that flows; ``loss_growth``: of the loss, per rise.  Exact for
    power, loss and surroundings that stand during the step.
    """
    loss = (1.0 + loss_growth * max(rise, 0.0)) / (1.0 - near_share)
    wire = (1.0 - exp(-step * loss / time_constant)) * (held / loss - (rise - near))
    return wire, (1.0 - exp(-step / near_time)) * (near_share * rise - near)


def followed(time_s: np.ndarray, held: np.ndarray, released: np.ndarray, balance: Balance) -> np.ndarray:
    """The rise of n samples that begin in balance; ``released``: what the wire has given off of its latent heat, as a
    rise.  NaN where a sample is none."""
    out = np.empty(len(time_s))
    time, held, released = (np.ascontiguousarray(v, dtype=float) for v in (time_s, held, released))
    _follow(time, held, released, *balance, out)
    return out


@jit
def _follow(
    time: np.ndarray,
    held: np.ndarray,
    released: np.ndarray,
    time_constant: float,
    near_share: float,
    near_time: float,
    out: np.ndarray,
) -> None:
    content = near = nan
    last = 0.0
    for i in range(len(time)):
        if isnan(held[i] + released[i]):
            out[i] = nan
            continue
        if isnan(content):
            content, near = held[i] - released[i], near_share * held[i]
        else:
            step = max(time[i] - last, 0.0)
            wire, around = gains(content + released[i], near, held[i], step, time_constant, near_share, near_time)
            content += wire
            near += around
        last = time[i]
        out[i] = content + released[i]


def held_rise_K(current_A: float, resistance_Ohm: float, loss_W_K: float) -> float:
    """How far above its surroundings a current holds a wire [K]."""
    return current_A**2 * resistance_Ohm / loss_W_K


def holding_A(rise_K: float, resistance_Ohm: float, loss_W_K: float) -> float:
    """The current that holds a wire so far above its surroundings [A]."""
    return sqrt(loss_W_K * rise_K / resistance_Ohm)
