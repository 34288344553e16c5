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
from math import copysign, exp, isfinite, nan

from sma_actuator.base.parameters import parameter
from sma_actuator.base.signals import Estimate, Signals

from .heat import Landing
from .law import CONTROL_LAWS, OWN_PERIODS, LawSections
from .pid import PidController, PidParameters, SHORTEST_STEP_s

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
        live="either",
    )
    heating_time: float = parameter(
        0.5, "time in which the wire is to be as warm as the setpoint wants it", "s", 0.05, 60.0, live="either"
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


class FeedForwardPid(PidController):
    """A PID, and ahead of it what the wire's heat asks for."""

    gains: FeedForwardPidParameters

    def __init__(self, gains: FeedForwardPidParameters, sections: LawSections):
        supply = sections.supply
        self._highest_A = supply.max_current
        self._full_m = sections.wire.full_stroke_m
        self.landing = Landing(sections)
        self.heat, self.wanted = self.landing.heat, self.landing.wanted
        self._long = False  #: the way is so long that the wire is seen to arrive
        self._seen = self._soon = (nan, nan)  #: position and temperature of the last step, and when a command acts
        super().__init__(gains, supply.bias_current, supply.max_current)
        self.braking = 1.0 - gains.feed_forward

    def update(self, sections: LawSections) -> None:
        """Take over live parameters of other sections."""
        self.heat.update(sections)

    def sense(self, signals: Signals, estimate: Estimate) -> None:
        """Keep the heat balance; also while nothing is driven."""
        self.heat.sense(signals, estimate)

    # --- what is asked for --------------------------------------------------------------------------

    def reset(self, position_m: float, output_A: float) -> None:
        """Start at rest at ``position_m`` so that the next output is ``output_A`` (bumpless)."""
        super().reset(position_m, output_A)
        if self.reference_m != position_m:
            return
        self.paced, self._paced_m = False, position_m
        self.landing.begin(position_m)
        self._led_C = self.heat.content_C  #: temperature of a wire that is given nothing but what is asked for here
        self._way = 0  #: 1: heating towards the temperature wanted, -1: cooling, 0: there, or about there
        share = self.gains.feed_forward
        self._asked_A = self._asks_A(position_m, position_m)  #: what the heat asks for
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
            limit_A = max(min(limit_A, self.landing.limit_A(position_m, setpoint_m, dt_s)), self.bias_A)
            asks_A = self._asks_A(position_m, setpoint_m)
            self._asked_A += (1.0 if self._long else dt_s / (TURNING_s + dt_s)) * (asks_A - self._asked_A)
            self._lead(min(self._asked_A, limit_A), dt_s)
            self._wearing_off_A *= exp(-dt_s / TAKE_OVER_s)
            self.ahead_A = self.gains.feed_forward * self._asked_A + self._wearing_off_A
            setpoint_m = self._pace(position_m, setpoint_m, dt_s, limit_A)
        return super().step(position_m, setpoint_m, dt_s, limit_A)

    def _look_ahead(self, position_m: float) -> None:
        """Where the wire will be, and how warm, when what is asked for now acts."""
        before, self._seen = self._seen, (position_m, self.heat.temperature_C)
        (now_m, now_C), (then_m, then_C) = self._seen, before
        soon = now_m + OWN_PERIODS * (now_m - then_m), now_C + OWN_PERIODS * (now_C - then_C)
        self._soon = soon if isfinite(sum(soon)) else self._seen

    def _lead(self, current_A: float, dt_s: float) -> None:
        """Warm the wire that is given nothing but what is asked for here."""
        if self.heat.known:
            self._led_C = self.heat.after_C(self._led_C, self.heat.resistance_Ohm * current_A**2, dt_s)

    def _asks_A(self, position_m: float, setpoint_m: float) -> float:
        """The current that takes the wire to a setpoint and holds it there."""
        if not self.heat.known:
            return self.bias_A
        if not isfinite(self._led_C):
            self._led_C = self.heat.content_C
        wanted_C = self.landing.wanted_C(setpoint_m)
        led_C = self._led_C + self.heat.latent_K * self.heat.share
        if abs(wanted_C - led_C) > ON_THE_WAY_K and not self._way:
            self._way = 1 if wanted_C > self.heat.temperature_C else -1
            self._long = False
            # What held the wire inside its loop is of no use on the way.
            held_A = self.gains.feed_forward * self.integral_A
            self.integral_A -= held_A
            self._wearing_off_A += held_A
        if self._way:
            led_C = self.heat.temperature_C
            left_m = self._way * (position_m - setpoint_m)
            if abs(left_m) > LONG_WAY * self._full_m:
                self._long, self._wearing_off_A = True, 0.0
                self._way = self._way if left_m > 0.0 else -self._way  # the setpoint is behind the wire by now
            if self._is_there(position_m, setpoint_m, wanted_C):
                self._way = 0
                led_C = wanted_C
            elif self._long:
                return self._highest_A if self._way == 1 else self.bias_A
            self._led_C = led_C - self.heat.latent_K * self.heat.share
        return self._holds_A(wanted_C, (wanted_C - led_C) / self.gains.heating_time)

    def _is_there(self, position_m: float, setpoint_m: float, wanted_C: float) -> bool:
        """Whether the way is at its end; what then holds the wire is the integral's where it is otherwise than
        reckoned."""
        if self._way == 1 and self.landing.landed:
            return True
        beyond_K = self._way * (self.heat.temperature_C - wanted_C)
        if not self._long:
            return beyond_K > -THERE_K or self._way * (setpoint_m - position_m) > TOO_FAR * self._full_m
        soon_m, soon_C = self._soon
        if self._way * (setpoint_m - soon_m) < 0.0:
            return beyond_K > MOST_BEYOND_K
        self.integral_A += self.gains.feed_forward * (self._holds_A(soon_C) - self._holds_A(wanted_C))
        return True

    def _holds_A(self, temperature_C: float, rate_K_s: float = 0.0) -> float:
        """The current, between bias and what there is, that holds a temperature, and changes it at a rate."""
        return min(max(self.heat.holds_A(temperature_C, rate_K_s), self.bias_A), self._highest_A)

    def _pace(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """The setpoint, or how far towards it the wire can be by now."""
        if not (self.gains.feed_forward > 0.0 and self.heat.known):
            self._paced_m, self.paced = setpoint_m, False
            return setpoint_m
        per_share_J = self.heat.capacity_J_K * (self.heat.latent_K - self.wanted.slope_K)
        lost_W = self.heat.loses_W(self.heat.temperature_C)
        current_A = self.bias_A if setpoint_m > self._paced_m else limit_A
        rate_1_s = abs(lost_W - self.heat.resistance_Ohm * current_A**2) / per_share_J
        most_m = PACE_MARGIN * rate_1_s * self.heat.stroke_m * dt_s
        ahead_m = setpoint_m - self._paced_m
        if not abs(ahead_m) > most_m:
            self._paced_m = setpoint_m
        else:
            self._paced_m += copysign(most_m, ahead_m)
            if (position_m - self._paced_m) * ahead_m > 0.0:  # the wire is faster
                self._paced_m = position_m if (setpoint_m - position_m) * ahead_m > 0.0 else setpoint_m
        self.paced = abs(setpoint_m - self._paced_m) > SHAPED * self._full_m
        return self._paced_m
