"""What the control law is asked to reach, and what current it asks for: range, reach, tuning and law of a driven
wire."""

from __future__ import annotations

from collections.abc import Callable
from math import isnan, nan
from typing import Any

from sma_actuator.base.record import record
from sma_actuator.base.signals import Estimate, Mode, Signals
from sma_actuator.config import Config
from sma_actuator.control.commanding import Commanding
from sma_actuator.control.law import CONTROL_LAWS, ControlLaw, ControllerParameters, LawError, SensingLaw
from sma_actuator.control.tuning import Sample
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.ends import Ends
from sma_actuator.safety.guards.setpoints import no_motion, setpoint_stale
from sma_actuator.safety.limits import (
    CURRENT_BIAS,
    CURRENT_MAX,
    SETPOINT_PACE,
    SETPOINT_RANGE,
    SETPOINT_RATE,
    SETPOINT_REACH,
)
from sma_actuator.safety.reach import Places, Reach
from sma_actuator.safety.records import Limit
from sma_actuator.safety.supervisor import Supervisor

from .tuner import Tuner

#: Share of the current's limit that counts as all of it: about the limit, a controller's output is noise.
ALL_THERE_IS = 0.95
#: Share of the full stroke that a wire beyond its long end is asked to be longer than it is: more than an estimate
#: scatters by, so that no heat holds it back from where it goes by itself, and little, so that it comes back at once.
LET_GO = 0.02


@record(frozen=True, slots=True)
class Seen:
    """What the law goes by in a step."""

    now_s: float
    time_s: float  #: the last time that was a number
    signals: Signals
    estimate: Estimate
    told_A: float  #: what the supply was told in the step before
    limit_A: float  #: highest current that heat and stress leave


class Following:
    """The control law of one wire, and where it is led."""

    def __init__(
        self,
        config: Config,
        chain: Chain,
        commanding: Commanding,
        supervisor: Supervisor,
        tuner: Tuner,
    ):
        self.config = config
        self.controller: ControlLaw = self._asked(config.controller.build, config)
        self._sensing = self.controller if isinstance(self.controller, SensingLaw) else None
        self._commanding = commanding
        self._supervisor = supervisor
        self._tuner = tuner
        self._ends = Ends(config, chain.displacement_range_m, chain.knows_the_ends)
        self.short_m, self.long_m = chain.displacement_range_m  #: where it can be held at its load and limits
        self._beyond = ""  #: at which end the setpoint is held
        self._goes_on = chain.knows_the_ends and self._ends.known  #: the estimate does, beyond the end of a calibration
        self._places = Places(config.calibration, config.wire.full_stroke_m)
        self._reach = Reach(config.wire.full_stroke_m, config.thermal.balance)
        self._controlled_s = nan  #: when the law was last stepped

    def set_gains(self, gains: ControllerParameters) -> None:
        """Give the law its live parameters."""
        self._asked(self.controller.set_gains, gains)

    def update(self, config: Config) -> None:
        """Take over live parameters; those of the law itself it has been given."""
        self.config = config
        if self._sensing is not None:
            self._asked(self._sensing.update, config)

    def sense(self, signals: Signals, estimate: Estimate, dt_s: float) -> None:
        """Take note of a reading, whether the wire is driven or not."""
        if self._sensing is not None:
            self._asked(self._sensing.sense, signals, estimate)
        self._ends.step(signals.stress_Pa, dt_s)

    def find_the_ends(self, longer_m: float) -> None:
        """Where a wire can be held at the present load and limits whose martensite is so much longer, since some of it
        formed under another load."""
        supervisor = self._supervisor
        rise_K, ambient_C = supervisor.most_rise_K(), supervisor.heat.ambient.temperature_C
        self.short_m, self.long_m = self._ends.range_m(rise_K, ambient_C, longer_m)

    def wanted(self, seen: Seen, settled: bool, known: bool, is_new: bool, limits: set[Limit]) -> tuple[float, float]:
        """Setpoint [m], NaN where there is none, and current asked for [A]; adds to ``limits`` those that are met.

        ``settled``: whether readings belong to the current; ``known``: whether the estimate is good enough to go by;
        ``is_new``: whether there is a reading that the law may learn of.
        """
        commanding, tuner = self._commanding, self._tuner
        setpoint_m, wanted_A = nan, self.config.supply.bias_current
        if settled and self._supervisor.latched is None:
            commanding.advance(seen.now_s, self.limited_setpoint_m)
            self._lose_setpoint(seen.now_s)
        if tuner.running is not None and not commanding.is_tuned:
            tuner.end("something else was wanted of the wire")
        if settled and known and self._supervisor.latched is None:
            if commanding.anew:
                self._begin(seen)
            if commanding.wants_position:
                setpoint_m, wanted_A = self._step(seen, is_new, limits)
        if tuner.running is not None and tuner.running.ended:
            commanding.stop()
            tuner.end("")
        return setpoint_m, wanted_A

    def _begin(self, seen: Seen) -> None:
        """Let the law go on from the present position and current."""
        self._reach.forget()
        self._controlled_s = seen.time_s
        position_m = seen.estimate.displacement_m
        self._commanding.begun(seen.now_s, position_m)
        current_A = max(seen.told_A, self.config.supply.bias_current)
        # What flows in a relay test holds the wire nowhere.
        resting_A = self._tuner.take_resting_A()
        self._asked(self.controller.reset, position_m, current_A if isnan(resting_A) else min(current_A, resting_A))

    def _step(self, seen: Seen, is_new: bool, limits: set[Limit]) -> tuple[float, float]:
        """The same where there is a position to reach; without a new estimate, the current asked for last."""
        setpoint_m = self._setpoint_m(seen, limits)
        return setpoint_m, self._current_A(seen, setpoint_m, is_new, limits)

    def _lose_setpoint(self, now_s: float) -> None:
        """What the parameters say when no setpoint has come for too long."""
        if self._commanding.mode is not Mode.TRACKING:
            return
        why = setpoint_stale.look(self._commanding.silent_s(now_s), self._commanding.armed, self.config)
        if not why:
            return
        action = self.config.controller.on_setpoint_loss
        if action == "off":
            self._supervisor.latch(setpoint_stale, why)
        else:
            self._commanding.lose(why, at_bias=action == "bias")

    @property
    def end_in_words(self) -> str:
        """The end that the setpoint is held at."""
        end_m = self.short_m if self._beyond == "short" else self.long_m
        return f"(at its {self._beyond} end, {end_m * 1e3:.3f} mm)"

    @property
    def limited_setpoint_m(self) -> float:
        """How far the setpoint is followed by now; NaN before the law has begun, and where it has no position."""
        if self._commanding.anew or not self._commanding.wants_position:
            return nan
        tuning = self._tuner.running
        return self.controller.reference_m if tuning is None else tuning.setpoint_m

    def _setpoint_m(self, seen: Seen, limits: set[Limit]) -> float:
        """What the law is to reach [m], inside the working range."""
        tuning, supervisor = self._tuner.running, self._supervisor
        setpoint_m = self._commanding.position_m(seen.now_s) if tuning is None else tuning.setpoint_m
        if self._commanding.mode is Mode.TRACKING and not self.short_m <= setpoint_m <= self.long_m:
            within_m = min(max(setpoint_m, self.short_m), self._longest_m(seen.estimate.displacement_m))
            if within_m != setpoint_m:
                limits.add(SETPOINT_RANGE)
                self._beyond = "short" if setpoint_m < self.short_m else "long"
                setpoint_m = within_m
        setpoint_m = max(setpoint_m, supervisor.stress_floor_m)
        self._reach.step(
            seen.now_s,
            seen.estimate.displacement_m,
            setpoint_m,
            at_max=seen.told_A >= ALL_THERE_IS * self.config.supply.max_current,
            at_limit=seen.told_A >= ALL_THERE_IS * seen.limit_A and not supervisor.heat.cools,
            power_W=max(0.0, seen.signals.power_W),  # of the wire alone; 0 where too little flows to measure
            load_N=seen.signals.load_N,
            heat=self._places.needed(
                seen.estimate.displacement_m,
                seen.estimate.uncertainty_m,
                seen.signals.stress_Pa,
                supervisor.heat.ambient.temperature_C,
                self.config.thermal.heat_loss,
            ),
        )
        supervisor.heat.astray = self._reach.astray
        if self._reach.held_back:
            supervisor.let_cool()
        if self._reach.floor_m > setpoint_m:
            limits.add(SETPOINT_REACH)
            vain = no_motion.look(self._reach.tries)
            if vain:
                supervisor.latch(no_motion, vain)
        return max(setpoint_m, self._reach.floor_m)

    def _longest_m(self, here_m: float) -> float:
        """The longest setpoint [m] of a wire that is here.

        The long end is where a wire came while it was calibrated, in the time that it was given; where it goes beyond
        by itself, nothing is to hold it back.
        """
        if not self._goes_on:
            return self.long_m
        return max(self.long_m, here_m) + LET_GO * self.config.wire.full_stroke_m

    def _current_A(self, seen: Seen, setpoint_m: float, is_new: bool, limits: set[Limit]) -> float:
        controller, tuning = self.controller, self._tuner.running
        wanted_A = controller.output_A
        if is_new:
            # After a gap the integral must not leap.
            dt_s = min(seen.time_s - self._controlled_s, self.config.safety.reading_timeout)
            self._controlled_s = seen.time_s
            position_m, limit_A = seen.estimate.displacement_m, seen.limit_A
            if tuning is None:
                wanted_A = self._asked(controller.step, position_m, setpoint_m, dt_s, limit_A)
            else:
                sample = Sample(seen.time_s, position_m, seen.told_A, self._supervisor.heat.temperature_C)
                wanted_A = tuning.step(sample, setpoint_m, dt_s, limit_A)
        if controller.rate_limited:
            limits.add(SETPOINT_RATE)
        if self._sensing is not None and self._sensing.paced:
            limits.add(SETPOINT_PACE)
        if controller.at_max:
            limits.add(CURRENT_MAX)
        if controller.at_bias:
            limits.add(CURRENT_BIAS)
        return wanted_A

    def _asked(self, method: Callable[..., Any], *arguments: Any) -> Any:
        """What the law answers.  Raises LawError, whatever it raises."""
        try:
            return method(*arguments)
        except (Exception, SystemExit) as error:  # it may be somebody else's
            name = CONTROL_LAWS.name_of(type(self.config.controller))
            raise LawError(f"control law '{name}': {type(error).__name__}: {error}") from error
