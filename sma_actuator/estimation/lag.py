"""The first-order lag: of a node's samples one by one, and of whole logs."""

from __future__ import annotations

from math import exp, isnan, nan

import numpy as np

from sma_actuator.base.jit import jit


@jit
def lag(
    time: np.ndarray, values: np.ndarray, state: np.ndarray, time_constant: float, from_zero: bool, out: np.ndarray
) -> None:
    """``values`` at ``time`` [s] through a lag, all of shape (n,); ``state`` (2,) = [time, value] is NaN before the
    first sample.

    It starts in balance with the first value, or at zero.  A sample that is not finite leaves it standing.
    """
    for i in range(len(values)):
        x = values[i]
        if not isnan(x):
            if isnan(state[0]):
                state[1] = 0.0 if from_zero else x
            else:
                state[1] += (1.0 - exp(-max(time[i] - state[0], 0.0) / time_constant)) * (x - state[1])
            state[0] = time[i]
        out[i] = state[1]


def lagged(time_s: np.ndarray, values: np.ndarray, time_constant_s: float) -> np.ndarray:
    """The values of a log through a lag that begins settled, shape (n,)."""
    out = np.empty(len(values))
    lag(
        np.ascontiguousarray(time_s, dtype=float),
        np.ascontiguousarray(values, dtype=float),
        np.full(2, nan),
        time_constant_s,
        False,
        out,
    )
    return out
