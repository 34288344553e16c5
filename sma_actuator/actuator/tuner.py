"""A tuning of the gains, from the wish for one to what became of it."""

from __future__ import annotations

from collections.abc import Callable
from math import nan

from sma_actuator.base.signals import Estimate, Quality, Tuned
from sma_actuator.config import Config
from sma_actuator.control.commanding import Commanding
from sma_actuator.control.law import ControlLaw
from sma_actuator.control.pid import PidParameters
from sma_actuator.control.tuning import Surroundings, Tuning, words_of
from sma_actuator.safety.supervisor import Supervisor


class Tuner:
    """The tuning that runs, if one does, and what is left of the last."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        """``tell`` is told what became of each."""
        self._tell = tell
        self.running: Tuning | None = None
        self._last = "not run"  #: what became of the last
        self._found: Tuned | None = None  #: what one has found that no output has told yet
        self._resting_A = nan  #: what holds the wire where a tuning has left it

    @property
    def words(self) -> str:
        """How far the one that runs has come, or what became of the last."""
        return self.running.words if self.running is not None else self._last

    def refusal(
        self, now_s: float, config: Config, commanding: Commanding, supervisor: Supervisor, estimate: Estimate
    ) -> str:
        """Why none can begin now, or ""."""
        gains, bias_A = config.controller, config.supply.bias_current
        if not isinstance(gains, PidParameters):
            return "controller.type is no law with the gains of a PID"
        if not commanding.is_driven:
            return "the output is off; call ~/enable first"
        if self.running is not None:
            return "the gains are being tuned already"
        if commanding.anew or estimate.quality is Quality.INVALID or not supervisor.settled(now_s):
            return "where the wire is is not known yet"
        bound_A, limit_A = gains.tuning_current * config.supply.max_current, supervisor.limit_A()
        if not bound_A > 2.0 * bias_A:
            return f"controller.tuning_current allows {bound_A:.4g} A, more than twice supply.bias_current is wanted"
        if limit_A < bound_A:
            return (
                f"heat and stress leave {limit_A:.4g} A, {bound_A:.4g} A are wanted (controller.tuning_current): "
                "let the wire cool, take load off, or let it be tuned with less (sma-actuator tune --current)"
            )
        return ""

    def begin(self, config: Config, controller: ControlLaw, range_m: tuple[float, float], told_A: float) -> str:
        """Begin one, with ``told_A`` flowing and the model good for ``range_m``; a sentence."""
        gains = config.controller
        assert isinstance(gains, PidParameters)
        surroundings = Surroundings(
            range_m=range_m,
            full_stroke_m=config.wire.full_stroke_m,
            bias_A=config.supply.bias_current,
            bound_A=gains.tuning_current * config.supply.max_current,
            hottest_C=config.thermal.derate_temperature,
            period_s=1.0 / config.loop.rate,
            time_constant_s=config.thermal.heat_capacity / config.thermal.heat_loss,
        )
        self.running = Tuning(controller, gains, surroundings, told_A)
        return f"the gains are tuned, with up to {surroundings.bound_A:.4g} A; any setpoint, or off, ends it"

    def end(self, why: str) -> None:
        """The gains of before are the law's again, where one ran.

        ``why`` counts where it has not ended by itself.
        """
        tuning, self.running = self.running, None
        if tuning is None:
            return
        tuning.end(why)
        self._resting_A = tuning.resting_A
        if tuning.found is not None:
            self._found = tuning.found
            self._last = f"done: {words_of(tuning.found.gains)}"
        else:
            self._last = f"given up: {tuning.given_up}"
        self._tell(f"tuning {self._last}")

    def take_found(self) -> Tuned | None:
        """What one has found, once."""
        found, self._found = self._found, None
        return found

    def take_resting_A(self) -> float:
        """What holds the wire where a tuning has left it, once; NaN where none has."""
        resting_A, self._resting_A = self._resting_A, nan
        return resting_A
