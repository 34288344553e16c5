"""Close in on the temperature at which something that rises with it is zero."""

from sma_actuator.base.jit import inlined


@inlined
def close_in(wrong, of, t1, slope, steep, near):
    """The temperature at which ``wrong(t, of)`` is no further from zero than ``near``: from ``t1``, walk until the
    sign changes, then close in (Illinois).

    ``slope`` is how steeply it is expected to rise; ``steep`` is the least that it can, always a sound guess.  Inlined,
    for a kernel that is handed a function cannot be kept on disk, and would be compiled at every start.
    """
    f1 = wrong(t1, of)
    if abs(f1) <= near:
        return t1
    t0 = t1 - f1 / slope
    f0 = wrong(t0, of)
    for _ in range(40):
        if f0 * f1 <= 0.0 or abs(f0) <= near:
            break
        t1 = t0
        f1 = f0
        t0 = t1 - f1 / steep
        f0 = wrong(t0, of)
    for _ in range(60):
        if abs(f0) <= near:
            return t0
        t = t0 - f0 * (t0 - t1) / (f0 - f1)
        f = wrong(t, of)
        if f * f0 < 0.0:
            t1 = t0
            f1 = f0
        else:
            f1 *= 0.5
        t0 = t
        f0 = f
    return t0
