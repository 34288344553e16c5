"""How far a cold wire may be from its estimate since another load hung on it.

A cold wire stays as long as a heavier load has made it, and is shorter under one as heavy as none before, until it has
contracted; a model that is calibrated under constant loads takes it for as long as the present load makes it.  What has
not contracted since stays so.
"""

from __future__ import annotations

from math import exp, inf, nan

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.jit import Floats, floats, jit
from sma_actuator.base.lookup import looked_up, row_of

from .ends import SMOOTH_s

#: Shares of the stroke up to which a wire has contracted wholly, and from which on it is cold.
CONTRACTED, COLD = 0.05, 0.9
#: From so many times the other on a load is another one; a spring pulls a cold wire less differently.
OTHER = 1.25
#: Of what the cold ends under both loads are apart.  A model sees the rest by resistance: on a wire of other physics it
#: was 0.18 to 0.27 of it off after four changes of the load.
UNSEEN = 0.5
#: So many times as far apart they are by yet another load; by less the same one, whose stress is smooth, may differ.
MORE = 1.02
#: What is remembered: time and smooth stress; the heaviest and the lightest that the cold wire had since it contracted;
#: how far apart the ends are under these and the present one, and what share of the stroke has not contracted since.
_TIME_s, _STRESS_Pa, _HEAVIEST_Pa, _LIGHTEST_Pa, _APART_m, _LEFT = range(6)
#: What is looked up by the stress: both ends.
_SHORT, _LONG = range(2)


class OtherLoad:
    """Of one wire; nothing where its calibration does not say where it ends."""

    def __init__(self, calibration: Calibration):
        self.state = floats(6)
        self.state[_STRESS_Pa] = nan
        self.row = row_of(*calibration.ends) if calibration.ends_known else floats(0)

    def step(self, time_s: float, stress_Pa: float, displacement_m: float) -> float:
        """How much more the estimate of a sample may be off [m]."""
        return apart_m(self.row, self.state, time_s, stress_Pa, displacement_m)


@jit
def apart_m(row: Floats, state: Floats, time_s: float, stress_Pa: float, displacement_m: float) -> float:
    """See :meth:`OtherLoad.step`, whose are ``row`` and ``state``."""
    if not len(row):
        return 0.0
    dt_s = time_s - state[_TIME_s]
    state[_TIME_s] = time_s
    if state[_STRESS_Pa] != state[_STRESS_Pa]:  # NaN: nothing is known of before
        state[_STRESS_Pa] = state[_HEAVIEST_Pa] = state[_LIGHTEST_Pa] = stress_Pa
    elif 0.0 <= dt_s < inf:
        state[_STRESS_Pa] += (1.0 - exp(-dt_s / SMOOTH_s)) * (stress_Pa - state[_STRESS_Pa])
    now_Pa = state[_STRESS_Pa]
    short_m, long_m = looked_up(row, _SHORT, now_Pa), looked_up(row, _LONG, now_Pa)
    if short_m < long_m:
        share = (displacement_m - short_m) / (long_m - short_m)
        if share <= CONTRACTED:
            state[_HEAVIEST_Pa] = state[_LIGHTEST_Pa] = now_Pa
            state[_APART_m] = state[_LEFT] = 0.0
        elif share < COLD:
            state[_LEFT] = min(state[_LEFT], share)
        else:
            state[_HEAVIEST_Pa] = max(state[_HEAVIEST_Pa], now_Pa)
            state[_LIGHTEST_Pa] = min(state[_LIGHTEST_Pa], now_Pa)
            longer_m = looked_up(row, _LONG, state[_HEAVIEST_Pa]) - long_m
            shorter_m = long_m - looked_up(row, _LONG, state[_LIGHTEST_Pa])
            ends_apart_m = max(
                longer_m if state[_HEAVIEST_Pa] > OTHER * now_Pa else 0.0,
                shorter_m if now_Pa > OTHER * state[_LIGHTEST_Pa] else 0.0,
            )
            if ends_apart_m > MORE * state[_APART_m]:
                state[_LEFT] = 1.0
            if state[_LEFT] == 1.0 or ends_apart_m < state[_APART_m]:
                state[_APART_m] = ends_apart_m
    return UNSEEN * state[_LEFT] * state[_APART_m]
