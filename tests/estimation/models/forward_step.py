"""The thesis's forward step (5.14–5.24), kept as a witness of what the exact step avoids."""

import math


def forward_step(resistance, previous, displacement, heating, asymptotes, a_0, tau):
    """One step of eq. 5.24."""
    a, b = asymptotes[0] if heating else asymptotes[1]
    asymptote_resistance = (displacement - b) / a
    z = resistance - asymptote_resistance if heating else asymptote_resistance - resistance
    slope = (a - a_0) * math.exp(-tau * z) + a_0
    return displacement + slope * (resistance - previous)
