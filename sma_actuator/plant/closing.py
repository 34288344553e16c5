"""Close in on the temperature at which something that rises with it is zero."""

from sma_actuator.base.jit import inlined

_LOOKS = 100  #: at most, so that what is not a number ends too


@inlined
def close_in(wrong, of, t1, slope, steep, near):
    """The temperature at which ``wrong(t, of)`` is no further from zero than ``near``: from ``t1``, walk until the
    sign changes, then close in (Illinois).

    ``slope`` is how steeply it is expected to rise; ``steep`` is the least that it can, always a sound guess.  Inlined,
    for a kernel that is handed a function cannot be kept on disk, and would be compiled at every start; and ``wrong``,
    which is inlined too, stands here once, for it is most of what there is to compile.
    """
    t = t1
    t0 = t1
    f0 = 0.0
    f1 = 0.0
    closing = False
    for look in range(_LOOKS):
        f = wrong(t, of)
        if abs(f) <= near:
            return t
        if look == 0:
            f1 = f
            t = t1 - f1 / slope
            continue
        if closing:
            if f * f0 < 0.0:
                t1 = t0
                f1 = f0
            else:
                f1 *= 0.5
        elif f * f1 <= 0.0:
            closing = True
        else:
            t1 = t
            f1 = f
            t = t1 - f1 / steep
            continue
        t0 = t
        f0 = f
        t = t0 - f0 * (t0 - t1) / (f0 - f1)
    return t0
