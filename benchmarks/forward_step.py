"""The thesis's own forward step (5.14–5.24), a plain Python loop: what the exact step is compared with."""

from __future__ import annotations

import math


def forward_step(resistance_Ohm, stress_Pa, heating, coefficients):
    """Displacement [m] of n samples, a list; ``coefficients`` are FlexinolCoefficients.

    z is saturated at zero, as the thesis recommends; exponents are left to overflow into infinity.
    """
    a_h, b_h = coefficients.heating_slope, coefficients.heating_intercept
    a_c, b_c = coefficients.cooling_slope, coefficients.cooling_intercept
    a_0, tau = coefficients.initial_slope, coefficients.transition_rate

    def at(polynomial, stress):
        value = 0.0
        for c in reversed(polynomial):
            value = value * stress + c
        return value

    previous = float(resistance_Ohm[0])
    delta = at(a_c, stress_Pa[0]) * previous + at(b_c, stress_Pa[0])
    out = []
    for resistance, stress, is_heating in zip(resistance_Ohm, stress_Pa, heating):
        if is_heating:
            a, b = at(a_h, stress), at(b_h, stress)
            z = resistance - (delta - b) / a
        else:
            a, b = at(a_c, stress), at(b_c, stress)
            z = (delta - b) / a - resistance
        slope = (a - a_0) * math.exp(-tau * max(z, 0.0)) + a_0
        delta += slope * (resistance - previous)
        previous = resistance
        out.append(delta)
    return out
