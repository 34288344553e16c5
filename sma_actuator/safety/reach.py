"""How far the wire goes: all the current there is, and no motion, is an end of the way.

Whatever the reason, a load, the limit of temperature, or an estimate whose sign has turned, more of
the same does not help, and where the sign has turned it harms.  So the shortest setpoint becomes one
that lies a little longer than the wire seems to be: the controller backs off to the side from which
it came and where it could see.
"""

from __future__ import annotations

from math import expm1, inf, nan

#: Time without motion that counts, and the same in the wire's thermal time constants: the longer of the two.
PATIENCE_s, PATIENCE_TIMES = 0.8, 0.3
#: Share of the full stroke that is motion, and the distance from the setpoint at which it is wanted.
MOTION = 0.01
#: Share of the full stroke that it backs off.
BACK_OFF = 0.02
#: Share of its final temperature above which a wire counts as warm as its power makes it; below, motion may still come.
WARM = 0.9
#: So much hotter than a contracted wire was at its calibration, by the heat balance, and no motion will come any more.
BEYOND_K = 10.0
#: Times running that backing off may be in vain.
TRIES = 5
#: Share by which a load may differ from the one it was tried with, before it is tried again.
SAME_LOAD = 0.1


class Reach:
    """Follows how the wire follows; ``floor_m`` is the shortest setpoint that makes sense now."""

    def __init__(self, full_stroke_m: float, thermal_time_constant_s: float):
        self._motion_m = MOTION * full_stroke_m
        self._back_off_m = BACK_OFF * full_stroke_m
        self._time_constant_s = thermal_time_constant_s
        self._patience_s = max(PATIENCE_s, PATIENCE_TIMES * thermal_time_constant_s)
        self._held_W = 0.0  #: the power that would hold the present temperature, of a wire that began cold
        self._now_s = nan
        self.forget()

    def forget(self) -> None:
        """Another setpoint, load or start: try again."""
        self.floor_m = -inf
        self.tries = 0  #: times that it has backed off without reaching what it backed off to
        self._since_s = self._from_m = self._load_N = self._there_s = nan

    def step(
        self,
        now_s: float,
        position_m: float,
        wanted_m: float,
        at_max: bool,
        ample_W: float,
        power_W: float,
        load_N: float,
    ) -> None:
        """Take note of one step: where the wire is, where it should be, and whether all current there is flows.

        ``ample_W`` would hold a wire hotter than it need be to be contracted; NaN where nobody knows.
        """
        if now_s > self._now_s:
            self._held_W -= expm1((self._now_s - now_s) / self._time_constant_s) * (power_W - self._held_W)
        self._now_s = now_s
        other_load = abs(load_N - self._load_N) > SAME_LOAD * abs(self._load_N)
        if self.floor_m > -inf and (wanted_m >= self.floor_m or other_load):
            self.forget()
        aim_m = max(wanted_m, self.floor_m)
        if at_max or not abs(position_m - aim_m) < self._motion_m:
            self._there_s = now_s
        elif now_s - self._there_s >= self._patience_s:
            self.tries = 0
        stuck = (
            at_max
            and position_m > aim_m
            and position_m > self._from_m - self._motion_m
            and (self._held_W > ample_W or self._held_W > WARM * power_W)
        )
        if not stuck:
            self._since_s, self._from_m = now_s, position_m
        elif now_s - self._since_s >= self._patience_s:
            self.floor_m = position_m + self._back_off_m
            self.tries += 1
            self._since_s, self._load_N = now_s, load_N
