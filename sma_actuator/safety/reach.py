"""How far the wire goes: all the heat that can help, and no motion, is an end of the way.

More does not help then, whatever the reason: a load, a wire that is held fast, an estimate whose sign has turned; and
where the sign has turned it harms.  So the shortest setpoint becomes one that lies a little longer than the wire seems
to be: the controller backs off to the side from which it came and where it could see.

A limit that the driver itself has lowered is not all that can help, and a wire that only warms up is not at its end:
what counts is all the current that the parameters allow, in a wire that is warm from it, or so much heat that by its
calibration the wire would long be clearly further.  And what was concluded is tried again: for a setpoint that is new
at once, for one that stands after a while, which doubles as long as it is in vain.
"""

from __future__ import annotations

from math import expm1, inf, isfinite, nan
from typing import NamedTuple

from sma_actuator.base.balance import Balance, gains
from sma_actuator.base.calibration import Calibration
from sma_actuator.base.jit import Floats, jit
from sma_actuator.base.lookup import row_of

from .transformed import share_and_heating_C

#: Time without motion that counts, and the same in the wire's thermal time constants: the longer of the two.
PATIENCE_s, PATIENCE_TIMES = 0.8, 0.3
#: Share of the full stroke that is motion, and the distance from the setpoint at which it is wanted.
MOTION = 0.01
#: Share of the full stroke that it backs off.
BACK_OFF = 0.02
#: Share of its final temperature above which a wire counts as warm as its power makes it; below, motion may still come.
WARM = 0.9
#: So much hotter than a heating wire of this stress is clearly further, and no motion will come any more: five
#: times what passages through the transformation scatter by.
BEYOND_K = 10.0
#: Share of the full stroke that is clearly further; so far from the setpoint, and so long without motion, in the wire's
#: thermal time constants, a wire that the heat limit holds back is tried anew from colder.
FAR, HELD_BACK_TIMES = 0.05, 2.0
#: Times running that backing off may be in vain.
TRIES = 5
#: Share by which a load may differ from the one it was tried with, before it is tried again.
SAME_LOAD = 0.1
#: Time after which the same setpoint is tried again, in the wire's thermal time constants: at first, and at the most.
FIRST_AGAIN_TIMES, LAST_AGAIN_TIMES = 4.0, 32.0


class Needed(NamedTuple):
    """What heat a wire takes to be clearly further than where it seems to be."""

    share: float  #: of the stroke at its stress, 0 contracted
    there_W: float  #: would hold it at the temperature that a heating wire has clearly further
    beyond_W: float  #: and so much more would hold it :data:`BEYOND_K` hotter
    latent_W: float  #: the same for the rise that the latent heat of the whole stroke would make


class Places:
    """Where in its stroke a wire is, and how hot a heating one is there, by its calibration."""

    def __init__(self, calibration: Calibration, full_stroke_m: float):
        self._row: Floats | None = None  #: it does not say
        self._far_m = FAR * full_stroke_m
        if calibration.transformation_known:
            power = calibration.power
            self._latent_K, self._shift_K_Pa = power.latent_rise, power.transformation_shift[1]
            self._row = row_of(*calibration.ends, power.heating)

    def needed(
        self, position_m: float, unsure_m: float, stress_Pa: float, ambient_C: float, loss_W_K: float
    ) -> Needed | None:
        """What heat the wire takes to be clearly further than at a position that may be off by ``unsure_m``, NaN where
        nobody knows; None where the calibration does not say.

        An intermediate phase moves a wire by a little long before it contracts: hotter than a heating one is at this
        very place says nothing.
        """
        if self._row is None:
            return None
        share, _ = share_and_heating_C(self._row, position_m, stress_Pa, self._shift_K_Pa)
        further_m = position_m - max(self._far_m, unsure_m)
        _, heating_C = share_and_heating_C(self._row, further_m, stress_Pa, self._shift_K_Pa)
        there_W = loss_W_K * (heating_C - ambient_C)
        return Needed(share, there_W, loss_W_K * BEYOND_K, loss_W_K * self._latent_K)


class Reach:
    """Follows how the wire follows; ``floor_m`` is the shortest setpoint that makes sense now.

    ``held_back``: far from its setpoint it stands, with all that the limits leave, and by its calibration needs more.
    ``astray``: it is far from its setpoint, or not there for as long as it takes to be called held back.
    """

    def __init__(self, full_stroke_m: float, balance: Balance):
        self._balance = balance
        self._motion_m, self._far_m = MOTION * full_stroke_m, FAR * full_stroke_m
        self._back_off_m = BACK_OFF * full_stroke_m
        self._time_constant_s = balance.time_constant_s
        self._patience_s = max(PATIENCE_s, PATIENCE_TIMES * balance.time_constant_s)
        self._held_W = 0.0  #: the power that would hold the present temperature, of a wire that began cold
        self._near_W = 0.0  #: so much of it the near surroundings hold
        self._slow_share = nan  #: of the stroke, through the same lag
        self._now_s = nan
        self.forget()

    def forget(self) -> None:
        """Another setpoint, load or start: try again."""
        self.floor_m = -inf
        self.tries = 0  #: times that it has backed off without reaching what it backed off to
        self.held_back = False
        self.astray = True
        self._back_s = self._back_m = nan  #: since when it is, and where it was
        self._came_s = nan  #: when it was last where it should be
        self._again_s = FIRST_AGAIN_TIMES * self._time_constant_s  #: how long the next end stands
        self._since_s = self._from_m = self._load_N = self._there_s = self._ended_s = self._asked_m = nan

    def step(
        self,
        now_s: float,
        position_m: float,
        wanted_m: float,
        at_max: bool,
        at_limit: bool,
        power_W: float,
        load_N: float,
        heat: Needed | None = None,
    ) -> None:
        """Take note of one step: where the wire is, where it should be, and what current flows.

        ``at_max``: all that the parameters allow; ``at_limit``: all that heat and stress leave of it now.  ``heat``:
        what the calibration says that the wire needs to be where it is; None where it does not say.
        """
        ample = self._keep_heat(now_s, power_W, heat)
        if self.floor_m > -inf:
            self._try_again(now_s, wanted_m, load_N)
        aim_m = max(wanted_m, self.floor_m)
        if at_limit or not abs(position_m - aim_m) < self._motion_m:
            self._there_s = now_s
        elif now_s - self._there_s >= self._patience_s:
            self.tries = 0
        away_m = abs(position_m - aim_m)
        if away_m <= self._motion_m:
            self._came_s = now_s
        waited = not now_s - self._came_s < HELD_BACK_TIMES * self._time_constant_s
        self.astray = not away_m <= (self._motion_m if waited else self._far_m)
        # Backing off in vain cools a wire that was warm; it need not become it once more.
        warm = self.tries > 0 or self._held_W > WARM * power_W
        # As near as it is wanted all the current may hold it there; that it is too much only its heat can say.
        no_use = (at_limit and ample) or (at_max and warm and position_m - aim_m > self._motion_m)
        waits = at_limit and ample is not None and not ample and position_m - aim_m > self._far_m
        if not (waits and abs(position_m - self._back_m) < self._motion_m):
            self._back_s, self._back_m = now_s, position_m
        self.held_back = now_s - self._back_s >= HELD_BACK_TIMES * self._time_constant_s
        if not (no_use and position_m > aim_m and position_m > self._from_m - self._motion_m):
            self._since_s, self._from_m = now_s, position_m
        elif now_s - self._since_s >= self._patience_s:
            self._end(now_s, position_m, wanted_m, load_N)

    def _keep_heat(self, now_s: float, power_W: float, heat: Needed | None) -> bool | None:
        """Keep the heat balance; whether the wire is hotter than a heating one is where it seems to be, None where
        nobody knows."""
        dt_s = max(now_s - self._now_s, 0.0) if isfinite(self._now_s) else 0.0
        self._now_s = now_s
        self._held_W, self._near_W, self._slow_share = _kept(
            self._held_W,
            self._near_W,
            self._slow_share,
            power_W,
            dt_s,
            *self._balance,
            heat.share if heat is not None else nan,
        )
        if heat is None or not isfinite(heat.share):
            return None
        # What has transformed of late took latent heat, which the balance leaves out.
        return self._held_W + heat.latent_W * (heat.share - self._slow_share) > heat.there_W + heat.beyond_W

    def _end(self, now_s: float, position_m: float, wanted_m: float, load_N: float) -> None:
        """This is an end, for now."""
        if self._ended_s == self._ended_s:  # and was one before
            self._again_s = min(2.0 * self._again_s, LAST_AGAIN_TIMES * self._time_constant_s)
        self.floor_m = position_m + self._back_off_m
        self.tries += 1
        self._since_s = self._ended_s = now_s
        self._load_N, self._asked_m = load_N, wanted_m

    def _try_again(self, now_s: float, wanted_m: float, load_N: float) -> None:
        """Whether what was an end may be none any more."""
        stood_s = now_s - self._ended_s
        other_load = abs(load_N - self._load_N) > SAME_LOAD * abs(self._load_N)
        other_setpoint = abs(wanted_m - self._asked_m) > self._motion_m and stood_s >= self._patience_s
        if wanted_m >= self.floor_m or other_load or other_setpoint:
            self.forget()
        elif stood_s >= self._again_s:
            self.floor_m = -inf


@jit
def _kept(
    held_W: float,
    near_W: float,
    slow_share: float,
    power_W: float,
    dt_s: float,
    time_constant_s: float,
    near_share: float,
    near_s: float,
    share: float,
) -> tuple[float, float, float]:
    """What would hold the wire and its near surroundings as warm as they are after a step, and the share of its stroke
    through the same lag; NaN where it is at none."""
    wire_W, around_W = gains(held_W, near_W, power_W, dt_s, time_constant_s, near_share, near_s)
    if isfinite(share):
        if not isfinite(slow_share):
            slow_share = share
        slow_share -= expm1(-dt_s / time_constant_s) * (share - slow_share)
    return held_W + wire_W, near_W + around_W, slow_share
