"""What the wire's heat says of its motion: how warm it is, how warm it has to be, and how much heat takes it there.

The inverse of the wire's transformation says how warm it has to be to stand where the setpoint is, coming from where it
comes (:class:`Wanted`); its heat balance, kept on the power that did flow, how warm it is (:class:`Heat`).  What lies
between them is known before the wire is seen to move: at full current it passes a third of its stroke in the time in
which one reading is averaged and answered, so a law that waits until it sees the wire arrive has gone too far by then
(:class:`Landing`).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, inf, isfinite, nan, sqrt

import numpy as np

from sma_actuator.base.balance import gains
from sma_actuator.base.jit import Floats, jit
from sma_actuator.base.lookup import looked_up, row_of
from sma_actuator.base.signals import Estimate, Signals

from .law import LawSections

#: Shares of the stroke between which temperatures are looked up: at the very ends a wire has any temperature beyond.
LOWEST_SHARE, HIGHEST_SHARE = 0.02, 0.98
#: Way back, as share of the stroke, over which the temperature wanted goes from one branch to the other.
TURN = 0.003
#: Turns of the setpoint that are remembered.
TURNS = 12
#: Where a loop closes, the branch before it and the one that goes on need not agree: what they differ by wears off over
#: this share of the stroke.
CLOSING = 0.05
#: A setpoint that moves by more than this share of the full stroke at once is a jump.
JUMP = 0.03
#: Heat that lacks at the end of a jump, as a rise of temperature, from which on it is there.
LANDED_K = 0.5
#: Time in which the position then shows what came of it.
SEEN_s = 0.25
#: Periods over which the heat that lacks is given: more than one, for a measured power may be that of the one before.
GIVEN_PERIODS = 1.5


class Wanted:
    """How warm a wire has to be to stand at a share of its stroke (0 contracted, 1 cold): its transformation, inverted.

    Each branch inside the loop is the whole one, on what was left to transform when the setpoint turned (as the
    kinetics of Liang and Rogers have it), and a loop that closes is forgotten.
    """

    def __init__(self, sections: LawSections):
        power = sections.calibration.power
        self._cooling_C, self._heating_C = power.transformation_cooling, power.transformation_heating
        self._shift_K_Pa = power.transformation_shift
        self.slope_K = float(max(-np.ptp(self._cooling_C), -np.ptp(self._heating_C)))  #: per share, the flatter branch
        self.forget(1.0)

    def forget(self, share: float) -> None:
        """Begin at a share of the stroke, on the cooling branch."""
        self._share = share
        self._heats = False  #: which way the setpoint went last
        self._side = 0.0  #: how much of the heating branch counts
        self._turns = [0.0]  #: where it turned: the last is where the present branch began
        self._closed_K = 0.0  #: by how much the branch that has closed a loop was above the one that goes on

    def move(self, share: float) -> None:
        """The setpoint is at another share of the stroke."""
        share = min(max(share, 0.0), 1.0)
        change, self._share = share - self._share, share
        if change == 0.0:
            return
        self._closed_K *= exp(-abs(change) / CLOSING)
        self._side = min(max(self._side - change / TURN, 0.0), 1.0)
        turns = self._turns
        if (change < 0.0) != self._heats:
            self._heats = not self._heats
            if len(turns) > 1 and abs(share - change - turns[-1]) < TURN:  # noise of the setpoint, and no way
                turns.pop()
            else:
                turns.append(share - change)
                del turns[:-TURNS]
        while len(turns) > 2 and (share <= turns[-2] if self._heats else share >= turns[-2]):
            before_C = self.temperature_C(share, 0.0)
            del turns[-2:]
            self._closed_K += before_C - self.temperature_C(share, 0.0)

    def temperature_C(self, share: float, stress_Pa: float) -> float:
        """The temperature wanted at a share of the stroke that the load leaves, where ``move`` has been last."""
        last, before = self._turns[-1], self._turns[-2] if len(self._turns) > 1 else 1.0
        heat_from, cool_from = (last, before) if self._heats else (before, last)
        if heat_from <= cool_from:
            heat_from, cool_from = 1.0, 0.0
        cooling_C = _at(self._cooling_C, (share - cool_from) / max(1.0 - cool_from, 0.1))
        heating_C = _at(self._heating_C, share / max(heat_from, 0.1))
        cooling_C += self._shift_K_Pa[0] * stress_Pa
        heating_C += self._shift_K_Pa[1] * stress_Pa
        return cooling_C + self._side * (heating_C - cooling_C) + self._closed_K


def _at(curve_C: Sequence[float], share: float) -> float:
    place = min(max(share, LOWEST_SHARE), HIGHEST_SHARE) * (len(curve_C) - 1)
    below = min(int(place), len(curve_C) - 2)
    return curve_C[below] + (place - below) * (curve_C[below + 1] - curve_C[below])


class Heat:
    """How warm a wire is by its heat balance, with the latent heat of what has transformed."""

    def __init__(self, sections: LawSections):
        thermal = sections.thermal
        self._ends = row_of(*sections.calibration.ends)
        self.loss_W_K, self.capacity_J_K = thermal.heat_loss, thermal.heat_capacity
        self._balance = thermal.balance
        self.update(sections)
        self.latent_K = sections.calibration.power.latent_rise
        self.temperature_C = self.ambient_C = thermal.ambient_temperature
        self.content_C = nan  #: the heat content, as the temperature that goes with it at no share of the stroke
        self.near_K = 0.0  #: how warm its near surroundings are
        self.share = 1.0
        self.stress_Pa = 0.0
        #: Between which displacements it moves at that.
        self._loaded_ends_m = looked_up(self._ends, 0, 0.0), looked_up(self._ends, 1, 0.0)
        self.resistance_Ohm = nan
        self._time_s = nan
        #: Between these a setpoint turns, whatever the load: one that stands still must not turn with its noise.
        short_m, long_m = (float(np.mean(at_m)) for _, at_m in sections.calibration.ends)
        self._ends_m = short_m, long_m

        self.stroke_m = self._ends_m[1] - self._ends_m[0]  #: from the contracted to the cold wire, whatever the load

    def update(self, sections: LawSections) -> None:
        """Take over live parameters; the memory stays."""
        thermal = sections.thermal
        self._usual_C, self._tolerance_K = thermal.ambient_temperature, thermal.ambient_tolerance

    @property
    def known(self) -> bool:
        """Whether it was measured yet."""
        return self.resistance_Ohm > 0.0 and isfinite(self.content_C)

    def sense(self, signals: Signals, estimate: Estimate) -> None:
        """Keep the balance; also while nothing is driven."""
        ambient_C = signals.ambient_temperature_C
        if not abs(ambient_C - self._usual_C) <= self._tolerance_K:
            ambient_C = self._usual_C
        self.ambient_C = ambient_C
        if isfinite(signals.stress_Pa):
            self.stress_Pa = signals.stress_Pa
        if signals.resistance_Ohm > 0.0:
            self.resistance_Ohm = signals.resistance_Ohm
        step_s = signals.time_s - self._time_s
        self._time_s = signals.time_s
        hot_m, cold_m, self.share, self.content_C, self.near_K = _sense(
            self._ends,
            self.stress_Pa,
            estimate.displacement_m,
            self.share,
            self.content_C,
            self.near_K,
            ambient_C,
            max(0.0, signals.power_W) / self.loss_W_K,
            step_s,
            self.latent_K,
            *self._balance,
        )
        self._loaded_ends_m = hot_m, cold_m
        self.temperature_C = self.content_C + self.latent_K * self.share

    def after_C(self, content_C: float, power_W: float, step_s: float) -> float:
        """What a heat content has become of after a time with a power, where the wire is now and as warm as it is
        there."""
        return content_C + self._gains_K(content_C, power_W, step_s)[0]

    def _gains_K(self, content_C: float, power_W: float, step_s: float) -> tuple[float, float]:
        rise_K = content_C + self.latent_K * self.share - self.ambient_C
        return gains(rise_K, self.near_K, power_W / self.loss_W_K, step_s, *self._balance)

    def loses_W(self, temperature_C: float) -> float:
        """What the wire loses at a temperature, as warm as it is around it now."""
        rise_K = temperature_C - self.ambient_C - self.near_K
        return self.loss_W_K * rise_K / (1.0 - self._balance.near_share)

    def share_at(self, position_m: float) -> float:
        """Which share of the stroke a position is at the present stress."""
        hot_m, cold_m = self._loaded_ends_m
        return (position_m - hot_m) / (cold_m - hot_m)

    def share_between_ends(self, position_m: float) -> float:
        """The same, whatever the stress."""
        return (position_m - self._ends_m[0]) / self.stroke_m

    def holds_A(self, temperature_C: float, rate_K_s: float = 0.0) -> float:
        """The current that holds a temperature, and changes it at a rate."""
        power_W = self.loses_W(temperature_C) + self.capacity_J_K * rate_K_s
        return sqrt(max(power_W, 0.0) / self.resistance_Ohm)


@jit
def _sense(
    ends: Floats,
    stress_Pa: float,
    position_m: float,
    share: float,
    content_C: float,
    near_K: float,
    ambient_C: float,
    held_K: float,
    step_s: float,
    latent_K: float,
    time_constant_s: float,
    near_share: float,
    near_s: float,
) -> tuple[float, float, float, float, float]:
    """Both ends at a stress, then share of the stroke, heat content and surroundings after a step in which the power
    would hold a rise."""
    hot_m, cold_m = looked_up(ends, 0, stress_Pa), looked_up(ends, 1, stress_Pa)
    if isfinite(position_m):
        share = min(max((position_m - hot_m) / (cold_m - hot_m), 0.0), 1.0)
    if not isfinite(content_C):
        content_C, near_K = ambient_C + held_K - latent_K * share, near_share * held_K
    elif step_s > 0.0:
        rise_K = content_C + latent_K * share - ambient_C
        wire_K, around_K = gains(rise_K, near_K, held_K, step_s, time_constant_s, near_share, near_s)
        content_C, near_K = content_C + wire_K, near_K + around_K
    return hot_m, cold_m, share, content_C, near_K


class Landing:
    """How much current may flow when the setpoint has jumped to where the wire must be heated to: all there is, until
    the heat is in it that its place there takes, and not more.

    Whether that was enough the position then shows; from there on the law is free again.
    """

    def __init__(self, sections: LawSections):
        self.heat, self.wanted = Heat(sections), Wanted(sections)
        self._jump_m = JUMP * sections.wire.full_stroke_m
        self.begin(nan)

    def begin(self, setpoint_m: float) -> None:
        """From rest at a setpoint, on the cooling branch."""
        self.wanted.forget(self.heat.share_between_ends(setpoint_m))
        self._setpoint_m = setpoint_m
        self._lands, self._landed_s = False, 0.0  #: it is on its way; for how long the heat has been in it
        self._there_C = nan  #: how warm it has to be there, coming from where it was when the setpoint jumped

    @property
    def landed(self) -> bool:
        """Whether the heat is in it and the position does not show yet what comes of it."""
        return self._lands and self._landed_s > 0.0

    @property
    def holds_A(self) -> float:
        """The current that holds it where it lands."""
        return self.heat.holds_A(self._there_C)

    def wanted_C(self, setpoint_m: float) -> float:
        """How warm the wire has to be at a setpoint, coming from where the last one was."""
        self.wanted.move(self.heat.share_between_ends(setpoint_m))
        return self.wanted.temperature_C(self.heat.share_at(setpoint_m), self.heat.stress_Pa)

    def limit_A(self, position_m: float, setpoint_m: float, dt_s: float) -> float:
        """The most that may flow; ∞ where the wire is on no such way."""
        heat = self.heat
        self.wanted.move(heat.share_between_ends(setpoint_m))
        jump_m, self._setpoint_m = setpoint_m - self._setpoint_m, setpoint_m
        if abs(jump_m) > self._jump_m:
            self._lands, self._landed_s = position_m - setpoint_m > self._jump_m, 0.0
            self._there_C = self.wanted_C(setpoint_m)
        if not (self._lands and heat.known):
            return inf
        share = min(max(heat.share_at(setpoint_m), 0.0), 1.0)
        lacks_K = self._there_C - heat.latent_K * share - heat.content_C
        if lacks_K < LANDED_K or self._landed_s > 0.0:
            self._landed_s += dt_s
        self._lands = self._landed_s <= SEEN_s
        if not self._lands:
            return inf
        return heat.holds_A(self._there_C if self.landed else heat.temperature_C, lacks_K / (GIVEN_PERIODS * dt_s))
