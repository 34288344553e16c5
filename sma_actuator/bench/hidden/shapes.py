"""How what is shown follows what is so: behind it, with play, or in jumps.  Kernels over consecutive samples."""

from __future__ import annotations

from sma_actuator.base.jit import jit


@jit
def lag(values, start, share, out):
    """First-order lag over consecutive samples; returns its last value."""
    y = start
    for i in range(len(values)):
        y += share * (values[i] - y)
        out[i] = y
    return y


@jit
def play(values, start, half, out):
    """What a pin in a slot of width 2 ``half`` follows."""
    y = start
    for i in range(len(values)):
        y = min(max(y, values[i] - half), values[i] + half)
        out[i] = y
    return y


@jit
def stick(values, start, force, out):
    """What sticks until the pull exceeds ``force``, and then jumps to where it should be."""
    y = start
    for i in range(len(values)):
        if abs(values[i] - y) > force:
            y = values[i]
        out[i] = y
    return y
