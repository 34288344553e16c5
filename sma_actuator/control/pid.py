"""Position control: a PID on the estimated displacement (thesis, eq. 2.18, 2.19 and ch. 6).

``u = Kp e + Ki ∫e dt + Kd dx/dt`` with ``e = x − x_d``: a wire that is too long gives a positive
error, hence more current, heat and contraction.  The derivative acts on the position alone, so a
step of the setpoint does not kick.  The integral is half as quick where the wire is held, lest it hunt through its
hysteresis.  All act on the position without its noise (:mod:`.smoothing`), so that the current does not rattle.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf, isfinite

from sma_actuator.base.parameters import parameter
from sma_actuator.base.signals import Estimate, Signals

from .heat import Landing
from .law import CONTROL_LAWS, ControlLaw, ControllerParameters, LawSections
from .smoothing import Smoother

#: Beyond these no position or setpoint of a wire lies; NaN and infinities fail the same comparison.
POSITION_BOUND_m = 100.0
#: Shorter steps carry no information about velocity.
SHORTEST_STEP_s = 1e-6
#: Share of the largest current by which noise of the position may move the current from step to step, rms.
UNREST = 0.01
#: How quick the integral is where a wire is held, over what brings it there.  A play and a PI go round for ever where
#: the integral is quicker than the temperature of a wire that does not transform, heat_capacity / heat_loss: kp over ki
#: of `init` is three quarters of that, and with a half of ki one and a half.
HOLDING = 0.5
#: A wire that is off by so much that the gain alone asks for this share of the largest current is not held any more.
FAR = 0.125


@CONTROL_LAWS.register("pid")
@dataclass(frozen=True, slots=True)
class PidParameters(ControllerParameters):
    """Gains of the PID."""

    kp: float = parameter(description="proportional gain", unit="A/m", lo=0.0, hi=1e6, live="either")
    ki: float = parameter(
        0.0, "integral gain; half of it acts where the wire is held", "A/(m·s)", 0.0, 1e6, live="either"
    )
    kd: float = parameter(0.0, "derivative gain, on the estimate", "A·s/m", 0.0, 1e6, live="either")
    derivative_time_constant: float = parameter(0.1, "low-pass of the derivative", "s", 0.0, 10.0, live="either")
    tuning_current: float = parameter(
        0.9,
        "share of supply.max_current that flows at the most while the gains are tuned",
        "1",
        0.1,
        1.0,
        live="lower",
    )

    def build(self, sections: LawSections) -> ControlLaw:
        """The PID with these gains; of a wire whose calibration says at which temperatures it transforms, one that
        lands."""
        bias_A, max_A = sections.supply.bias_current, sections.supply.max_current
        if sections.calibration.transformation_known:
            return LandingPid(self, bias_A, max_A, Landing(sections))
        return PidController(self, bias_A, max_A)


class PidController:
    """PID with a rate-limited setpoint, clipped output and bumpless changes.

    Anti-windup is by conditional integration: the integral stands still while the output is
    saturated and the error would drive it further.  Unlike back-calculation this needs no gain of
    its own, and a wire spends seconds at the bias while it cools: an integral pulled along for all
    that time by a tracking gain would start the next contraction from the wrong current.
    """

    __slots__ = (
        "ahead_A",
        "at_bias",
        "at_max",
        "bias_A",
        "braking",
        "error_m",
        "gains",
        "held",
        "integral_A",
        "max_A",
        "output_A",
        "position_m",
        "rate_limited",
        "reference_m",
        "smoother",
        "velocity_m_s",
    )

    def __init__(self, gains: PidParameters, bias_current_A: float, max_current_A: float = inf):
        self.gains = gains
        self.bias_A = bias_current_A
        self.max_A = max_current_A  #: what unrest is measured by; infinite: any noise will do
        self.smoother = Smoother()
        self.ahead_A = 0.0  #: what is given ahead of the PID, by a law that is built on it
        self.braking = 1.0  #: share of the derivative that acts, less in a law that brakes otherwise
        self.reset(0.0, bias_current_A)

    def reset(self, position_m: float, output_A: float) -> None:
        """Start at rest at ``position_m`` so that the next output is ``output_A`` (bumpless).

        Arguments that are not finite are ignored: the state stays what it was.
        """
        if not (-POSITION_BOUND_m <= position_m <= POSITION_BOUND_m and 0.0 <= output_A <= 1e6):
            return
        self.reference_m = position_m
        self.position_m = position_m
        self.smoother.reset(position_m)
        self.integral_A = output_A
        self.velocity_m_s = 0.0
        self.error_m = 0.0
        self.output_A = output_A
        self.held = False  #: it has come to where the reference stands
        self.rate_limited = self.at_max = self.at_bias = False

    def set_gains(self, gains: PidParameters) -> None:
        """Change the gains between two steps without a jump of the output.

        The integral takes up what the other two terms change by.
        """
        old = self.gains
        damping_change = self.braking * (old.kd - gains.kd)
        self.integral_A += (old.kp - gains.kp) * self.error_m + damping_change * self.velocity_m_s
        self.gains = gains

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """Advance by ``dt_s`` and return the current [A], between the bias and ``limit_A``.

        The one gate to the state: a position, setpoint, time step or limit that is not finite,
        or out of all proportion, gives the bias current and changes nothing.
        """
        bias_A = self.bias_A
        if not (
            -POSITION_BOUND_m <= position_m <= POSITION_BOUND_m
            and -POSITION_BOUND_m <= setpoint_m <= POSITION_BOUND_m
            and 0.0 <= dt_s <= 1e6
            and bias_A <= limit_A <= 1e6
        ):
            return bias_A
        if dt_s < SHORTEST_STEP_s:
            return min(self.output_A, limit_A)
        gains = self.gains
        most_m = gains.setpoint_rate_limit * dt_s
        before_m, change_m = self.error_m, setpoint_m - self.reference_m
        if -most_m <= change_m <= most_m:
            self.reference_m = setpoint_m
            self.rate_limited = False
        else:
            self.reference_m += most_m if change_m > 0.0 else -most_m
            self.rate_limited = True

        position_m = self.smoother.step(position_m, dt_s, self._allowed_m(dt_s))
        error_m = position_m - self.reference_m
        # First-order low-pass of the difference quotient, implicit in time: stable for any step.
        self.velocity_m_s += (position_m - self.position_m - self.velocity_m_s * dt_s) / (
            gains.derivative_time_constant + dt_s
        )
        self.position_m = position_m
        self.error_m = error_m
        is_near = change_m == 0.0 and abs(gains.kp * error_m) <= FAR * self.max_A
        self.held = is_near and (self.held or error_m * before_m <= 0.0)

        rest_A = gains.kp * error_m + self.braking * gains.kd * self.velocity_m_s + self.ahead_A
        ki = HOLDING * gains.ki if self.held else gains.ki
        integral_A = self.integral_A + ki * error_m * dt_s
        output_A = rest_A + integral_A
        self.at_max = output_A > limit_A
        self.at_bias = output_A < bias_A
        if (self.at_max and error_m > 0.0) or (self.at_bias and error_m < 0.0):
            output_A = rest_A + self.integral_A
        else:
            self.integral_A = integral_A
        if output_A > limit_A:
            output_A = limit_A
        elif output_A < bias_A:
            output_A = bias_A
        self.output_A = output_A
        return output_A

    def _allowed_m(self, dt_s: float) -> float:
        """How far noise may move the position from step to step."""
        gains = self.gains
        derivative = self.braking * gains.kd / (gains.derivative_time_constant + dt_s)
        gain = hypot(gains.kp + derivative, derivative)
        return UNREST * self.max_A / gain if gain > 0.0 else inf


class LandingPid(PidController):
    """A PID that gives a wire no more heat than the setpoint takes, when that jumps."""

    __slots__ = ("_landing", "paced")

    def __init__(self, gains: PidParameters, bias_current_A: float, max_current_A: float, landing: Landing):
        self._landing = landing
        self.paced = False  #: it follows as fast as it can
        super().__init__(gains, bias_current_A, max_current_A)

    def update(self, sections: LawSections) -> None:
        """Take over live parameters of other sections."""
        self._landing.heat.update(sections)

    def sense(self, signals: Signals, estimate: Estimate) -> None:
        """Keep the heat balance; also while nothing is driven."""
        self._landing.heat.sense(signals, estimate)

    def reset(self, position_m: float, output_A: float) -> None:
        """Start at rest at ``position_m`` so that the next output is ``output_A`` (bumpless)."""
        super().reset(position_m, output_A)
        if self.reference_m == position_m:
            self._landing.begin(position_m)

    def step(self, position_m: float, setpoint_m: float, dt_s: float, limit_A: float) -> float:
        """As that of the PID, with no more current than the setpoint takes."""
        if isfinite(position_m + setpoint_m) and SHORTEST_STEP_s <= dt_s <= 1e6 and limit_A >= self.bias_A:
            limit_A = max(min(limit_A, self._landing.limit_A(position_m, setpoint_m, dt_s)), self.bias_A)
            if self._landing.landed:  # what held it before is of no use there
                self.integral_A = max(self._landing.holds_A, self.bias_A)
        return PidController.step(self, position_m, setpoint_m, dt_s, limit_A)  # super() is looked up anew each time
