"""Feed-forward beside the PID: the current that the wire's heat asks for, given before there is an error.

The inverse of the wire's transformation says how warm it has to be to stand where the setpoint is, coming from where
it comes (:class:`Wanted`); its heat balance, kept on the power that did flow, how warm it is.  The power

    P = h (T_wanted − T_ambient) + C (T_wanted − T) / heating_time

takes the wire there and holds it there.  Until it is there the first term gives way to the second, which the limits of
the current cut off: full current, or none.  A long way ends where the wire is seen to arrive, whatever its heat is
reckoned to be; a short one, as from one branch to the other where the setpoint turns, where the heat is reckoned to be
enough.  The PID gives what is left, without its derivative: that would brake the motion that is asked for.  Nothing
else of it comes from the position but the latent heat in T, so that a wrong number costs error and not stability: the
PID makes up for it as for everything that it is not told.

A wire cools no faster than its surroundings let it, and heats no faster than the limit of the current does.  What
the setpoint asks for beyond that is not followed but shaped: the reference of the PID moves as the wire can, so that
it does not wait for the wire with an ever larger answer, and ``paced`` says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, isfinite, nan, sqrt

import numpy as np

from sma_actuator.base.parameters import parameter
from sma_actuator.base.signals import Estimate, Signals

from .law import CONTROL_LAWS, LawSections
from .pid import PidController, PidParameters, SHORTEST_STEP_s

#: Shares of the stroke between which temperatures are looked up: at the very ends a wire has any temperature beyond.
LOWEST_SHARE, HIGHEST_SHARE = 0.02, 0.98
#: Way back, as share of the stroke, over which the temperature wanted goes from one branch to the other.
TURN = 0.003
#: Turns of the setpoint that are remembered.
TURNS = 12
#: How much faster than reckoned the reference may move: the heat is not known better.
PACE_MARGIN = 1.3
#: Distance between setpoint and reference, as share of the stroke, from which the setpoint counts as shaped.
SHAPED = 0.005
#: Distance of the temperature wanted from which the wire is on its way, and that at which it is there.
ON_THE_WAY_K, THERE_K = 4.0, 0.5
#: Share of the full stroke by which a wire that has gone too far is there, whatever its heat is reckoned to be.
TOO_FAR = 0.01
#: A way that is longer than this share of the full stroke ends where the wire arrives, by when a command acts, and not
#: where its heat is reckoned to be enough; unless the heat is beyond that by so much.
LONG_WAY, MOST_BEYOND_K = 0.03, 25.0
#: Periods of the loop until what is asked for now acts: a reading is of the one before, and a command stands for one.
OWN_PERIODS = 1.5
#: Where a loop closes, the branch before it and the one that goes on need not agree: what they differ by wears off over
#: this share of the stroke.
CLOSING = 0.05
#: Time over which what is asked for changes on a short way: a wire that turns can wait for it, and its current does not
#: jump.
TURNING_s = 0.15
#: Time in which a jump of the current is worn off that taking over would have made.
TAKE_OVER_s = 1.0


@CONTROL_LAWS.register("feed_forward_pid")
@dataclass(frozen=True, slots=True)
class FeedForwardPidParameters(PidParameters):
    """Gains of the PID, and how much of the current is given ahead of it."""

    feed_forward: float = parameter(
        1.0,
        "share of the current that the wire's heat asks for which is given ahead of the PID",
        "1",
        0.0,
        1.0,
        live=True,
    )
    heating_time: float = parameter(
        0.5, "time in which the wire is to be as warm as the setpoint wants it", "s", 0.05, 60.0, live=True
    )

    def mismatches(self, sections: LawSections) -> list[str]:
        """Without the temperatures of the transformation there is nothing to give ahead."""
        if sections.calibration.transformation_known:
            return []
        sentence = (
            "controller.type: feed_forward_pid wants calibration.power.transformation_heating and "
            "_cooling; identify the model anew from logs of full pulses, or take controller.type pid"
        )
        return [sentence]

    def build(self, sections: LawSections) -> FeedForwardPid:
        """The law for a wire whose calibration says at which temperatures it transforms."""
        return FeedForwardPid(self, sections)


class Wanted:
    """How warm a wire has to be to stand at a share of its stroke (0 contracted, 1 cold): its transformation, inverted.

    Each branch inside the loop is the whole one, on what was left to transform when the setpoint turned (as the
    kinetics of Liang and Rogers have it), and a loop that closes is forgotten.
    """

    def __init__(self, sections: LawSections):
        power = sections.calibration.power
        self._cooling_C = np.array(power.transformation_cooling)
        self._heating_C = np.array(power.transformation_heating)
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


def _at(curve_C: np.ndarray, share: float) -> float:
    place = min(max(share, LOWEST_SHARE), HIGHEST_SHARE) * (len(curve_C) - 1)
    below = min(int(place), len(curve_C) - 2)
    return float(curve_C[below] + (place - below) * (curve_C[below + 1] - curve_C[below]))


class FeedForwardPid(PidController):
    """A PID, and ahead of it what the wire's heat asks for."""

    gains: FeedForwardPidParameters

    def __init__(self, gains: FeedForwardPidParameters, sections: LawSections):
        thermal, supply = sections.thermal, sections.supply
        self._calibration = sections.calibration
        self._loss_W_K, self._capacity_J_K = thermal.heat_loss, thermal.heat_capacity
        self._usual_C, self._tolerance_K = thermal.ambient_temperature, thermal.ambient_tolerance
        self._latent_K = sections.calibration.power.latent_rise
        self._highest_A = supply.max_current
        self._full_m = sections.wire.full_stroke_m
        #: Between these a setpoint turns, whatever the load: one that stands still must not turn with its noise.
        self._ends_m = (
            float(np.mean(sections.calibration.hot_end.contracted_displacement)),
            float(np.mean(sections.calibration.rest.cold_displacement)),
        )
        self.wanted = Wanted(sections)
        self._way = 0  #: 1: heating towards the temperature wanted, -1: cooling, 0: there, or about there
        self._long = False  #: the way is so long that the wire is seen to arrive
        self._seen = self._soon = (nan, nan)  #: position and temperature of the last step, and when a command acts
        self._led_C = nan  #: temperature of a wire that is given nothing but what is asked for here
        self.temperature_C = self._ambient_C = thermal.ambient_temperature
        self._heat_C = nan  #: the heat content, as the temperature that goes with it at no share of the stroke
        self._share = 1.0
        self._time_s = nan
        self._stress_Pa = 0.0
        self._resistance_Ohm = nan
        self._asked_A = 0.0  #: what the heat asks for
        self._wearing_off_A = 0.0
        self._paced_m = nan
        self.paced = False
        super().__init__(gains, supply.bias_current, supply.max_current)
        self.braking = 1.0 - gains.feed_forward

    # --- what the wire does -------------------------------------------------------------------------

    def sense(self, signals: Signals, estimate: Estimate) -> None:
        """Keep the heat balance; also while nothing is driven."""
        calibration = self._calibration
        ambient_C = signals.ambient_temperature_C
        if not abs(ambient_C - self._usual_C) <= self._tolerance_K:
            ambient_C = self._usual_C
        self._ambient_C = ambient_C
        if isfinite(signals.stress_Pa):
            self._stress_Pa = signals.stress_Pa
        if signals.resistance_Ohm > 0.0:
            self._resistance_Ohm = signals.resistance_Ohm
        if isfinite(estimate.displacement_m):
            share = float(calibration.share_of_stroke(estimate.displacement_m, self._stress_Pa))
            self._share = min(max(share, 0.0), 1.0)
        power_W = max(0.0, signals.power_W)
        step_s = signals.time_s - self._time_s
        self._time_s = signals.time_s
        settled_C = ambient_C + power_W / self._loss_W_K - self._latent_K * self._share
        if not isfinite(self._heat_C):
            self._heat_C = settled_C
        elif step_s > 0.0:
            self._heat_C = settled_C + (self._heat_C - settled_C) * exp(-step_s * self._loss_W_K / self._capacity_J_K)
        self.temperature_C = self._heat_C + self._latent_K * self._share

    # --- what is asked for --------------------------------------------------------------------------

    def reset(self, position_m: float, output_A: float) -> None:
        """Start at rest at ``position_m`` so that the next output is ``output_A`` (bumpless)."""
        super().reset(position_m, output_A)
        if self.reference_m != position_m:
            return
        self.paced, self._paced_m = False, position_m
        self.wanted.forget((position_m - self._ends_m[0]) / (self._ends_m[1] - self._ends_m[0]))
        self._led_C, self._way = self._heat_C, 0
        share = self.gains.feed_forward
        self._asked_A = self._asks_A(position_m, position_m)
        self.integral_A = (1.0 - share) * output_A
        self._wearing_off_A = share * (output_A - self._asked_A)

    def set_gains(self, gains: FeedForwardPidParameters) -> None:  # type: ignore[override]
        """Change the gains between two steps without a jump of the output."""
        self._wearing_off_A += (self.gains.feed_forward - gains.feed_forward) * self._asked_A
        super().set_gains(gains)
        braking = 1.0 - gains.feed_forward
        self.integral_A += (self.braking - braking) * gains.kd * self.velocity_m_s
        self.braking = braking

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """As that of the PID, on the reference as far as the wire can follow it."""
        if isfinite(position_m + setpoint_m) and SHORTEST_STEP_s <= dt_s <= 1e6 and limit_A >= self.bias_A:
            self._look_ahead(position_m)
            asks_A = self._asks_A(position_m, setpoint_m)
            self._asked_A += (1.0 if self._long else dt_s / (TURNING_s + dt_s)) * (asks_A - self._asked_A)
            self._lead(min(self._asked_A, limit_A), dt_s)
            self._wearing_off_A *= exp(-dt_s / TAKE_OVER_s)
            self.ahead_A = self.gains.feed_forward * self._asked_A + self._wearing_off_A
            setpoint_m = self._pace(position_m, setpoint_m, dt_s, limit_A)
        return super().step(position_m, setpoint_m, dt_s, limit_A)

    def _look_ahead(self, position_m: float) -> None:
        """Where the wire will be, and how warm, when what is asked for now acts."""
        before, self._seen = self._seen, (position_m, self.temperature_C)
        soon = [now + OWN_PERIODS * (now - old) for now, old in zip(self._seen, before, strict=True)]
        self._soon = (soon[0], soon[1]) if isfinite(sum(soon)) else self._seen

    def _lead(self, current_A: float, dt_s: float) -> None:
        """Warm the wire that is given nothing but what is asked for here."""
        if isfinite(self._led_C) and self._resistance_Ohm > 0.0:
            power_W = self._resistance_Ohm * current_A**2
            settled_C = self._ambient_C + power_W / self._loss_W_K - self._latent_K * self._share
            decay = exp(-dt_s * self._loss_W_K / self._capacity_J_K)
            self._led_C = settled_C + (self._led_C - settled_C) * decay

    def _share_at(self, position_m: float) -> float:
        return float(self._calibration.share_of_stroke(position_m, self._stress_Pa))

    def _asks_A(self, position_m: float, setpoint_m: float) -> float:
        """The current that takes the wire to a setpoint and holds it there."""
        if not (self._resistance_Ohm > 0.0 and isfinite(self._heat_C)):
            return self.bias_A
        if not isfinite(self._led_C):
            self._led_C = self._heat_C
        self.wanted.move((setpoint_m - self._ends_m[0]) / (self._ends_m[1] - self._ends_m[0]))
        wanted_C = self.wanted.temperature_C(self._share_at(setpoint_m), self._stress_Pa)
        led_C = self._led_C + self._latent_K * self._share
        if abs(wanted_C - led_C) > ON_THE_WAY_K and not self._way:
            self._way = 1 if wanted_C > self.temperature_C else -1
            self._long = False
            # What held the wire inside its loop is of no use on the way.
            held_A = self.gains.feed_forward * self.integral_A
            self.integral_A -= held_A
            self._wearing_off_A += held_A
        if self._way:
            led_C = self.temperature_C
            left_m = self._way * (position_m - setpoint_m)
            if abs(left_m) > LONG_WAY * self._full_m:
                self._long, self._wearing_off_A = True, 0.0
                self._way = self._way if left_m > 0.0 else -self._way  # the setpoint is behind the wire by now
            if self._is_there(position_m, setpoint_m, wanted_C):
                self._way = 0
                led_C = wanted_C
            elif self._long:
                return self._highest_A if self._way > 0 else self.bias_A
            self._led_C = led_C - self._latent_K * self._share
        return self._holds_A(wanted_C, (wanted_C - led_C) / self.gains.heating_time)

    def _is_there(self, position_m: float, setpoint_m: float, wanted_C: float) -> bool:
        """Whether the way is at its end; what then holds the wire is the integral's where it is otherwise than
        reckoned."""
        beyond_K = self._way * (self.temperature_C - wanted_C)
        if not self._long:
            return beyond_K > -THERE_K or self._way * (setpoint_m - position_m) > TOO_FAR * self._full_m
        soon_m, soon_C = self._soon
        if self._way * (setpoint_m - soon_m) < 0.0:
            return beyond_K > MOST_BEYOND_K
        self.integral_A += self.gains.feed_forward * (self._holds_A(soon_C) - self._holds_A(wanted_C))
        return True

    def _holds_A(self, temperature_C: float, rate_K_s: float = 0.0) -> float:
        """The current, between bias and what there is, that holds a temperature, and changes it at a rate."""
        power_W = self._loss_W_K * (temperature_C - self._ambient_C) + self._capacity_J_K * rate_K_s
        current_A = sqrt(max(power_W, 0.0) / self._resistance_Ohm)
        return min(max(current_A, self.bias_A), self._highest_A)

    def _pace(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """The setpoint, or how far towards it the wire can be by now."""
        if not (self.gains.feed_forward > 0.0 and self._resistance_Ohm > 0.0):
            self._paced_m, self.paced = setpoint_m, False
            return setpoint_m
        per_share_J = self._capacity_J_K * (self._latent_K - self.wanted.slope_K)
        lost_W = self._loss_W_K * (self.temperature_C - self._ambient_C)
        current_A = self.bias_A if setpoint_m > self._paced_m else limit_A
        rate_1_s = abs(lost_W - self._resistance_Ohm * current_A**2) / per_share_J
        most_m = PACE_MARGIN * rate_1_s * (self._ends_m[1] - self._ends_m[0]) * dt_s
        ahead_m = setpoint_m - self._paced_m
        if not abs(ahead_m) > most_m:
            self._paced_m = setpoint_m
        else:
            self._paced_m += most_m if ahead_m > 0.0 else -most_m
            if (position_m - self._paced_m) * ahead_m > 0.0:  # the wire is faster
                self._paced_m = position_m if (setpoint_m - position_m) * ahead_m > 0.0 else setpoint_m
        self.paced = abs(setpoint_m - self._paced_m) > SHAPED * self._full_m
        return self._paced_m
