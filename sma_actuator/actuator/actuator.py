"""One wire: reading in, command out.  The whole behaviour, without I/O and without a clock of its own.

The node drives it from live instruments, experiments and tests from the virtual bench: what is
tested offline is what runs on the robot.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from math import inf, isfinite, nan

from sma_actuator.base.parameters import live_changes
from sma_actuator.base.signals import OFF, Branch, Command, Estimate, Output, Quality, Reading, Signals, SupplyState
from sma_actuator.config import Config, require_calibrated
from sma_actuator.control.commanding import Commanding
from sma_actuator.estimation.chain import ESTIMATOR_RESET, Chain
from sma_actuator.estimation.circuit import signals_from_reading, without_undriven
from sma_actuator.estimation.health import ModelHealth
from sma_actuator.estimation.uncertainty import Uncertainty
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.guards.estimate import estimate_invalid
from sma_actuator.safety.guards.program import unhandled_exception
from sma_actuator.safety.records import NOT_WAITED, Fault, Limit, Step, Waited
from sma_actuator.safety.supervisor import Supervisor

from .following import Following, Seen
from .measured import Measured
from .offered import Offered
from .said import Said, refusal_to_enable, status_of, words_of_latched
from .tuner import Tuner

_log = logging.getLogger(__name__)

_NOTHING = Signals(nan, nan, nan, nan, nan, nan)
_NO_ESTIMATE = Estimate(nan, nan, nan, 0.0, Branch.COOLING, Quality.INVALID)


class Actuator:
    """Estimator, controller and supervisor of one wire.  Not thread-safe: one owner."""

    def __init__(self, config: Config):
        require_calibrated(config)
        self._config = config
        self._chain = Chain(config)
        self._uncertainty = Uncertainty(config.model.build(config.wire), config.calibration)
        self._health = ModelHealth(config, config.supply.bias_current)
        self._supervisor = Supervisor(config)
        self._commanding = Commanding()
        self._said = Said()
        self._offered = Offered(config, self._commanding, self._said)
        self._measured = Measured()
        self._tuner = Tuner(self._said.changed)
        self._following = Following(config, self._chain, self._commanding, self._supervisor, self._tuner)
        self._now_s = nan
        self._reading_s = -inf  #: time stamp of the last usable reading
        self._signals = _NOTHING
        self._estimate = _NO_ESTIMATE
        self._told = OFF
        self._told_s = -inf  #: since when that is so
        self._limit_A = 0.0  #: highest current that heat and stress leave

    # --- what others may ask ----------------------------------------------------------------------

    def enable(self, now_s: float, on: bool) -> tuple[bool, str]:
        """Switch the current on or off; whether it was done, and a sentence."""
        if not on:
            if self._commanding.is_driven:
                self._said.changed("disabled")
            self._commanding.switch_off()
            self._tuner.end("the output was switched off")
            return True, "the output is off"
        if self._commanding.is_driven and not self.latched:
            return True, "the output is on already"
        if refusal := refusal_to_enable(self._supervisor):
            return False, f"not enabled: {refusal}"
        if not self._is_fresh(now_s):
            return False, "not enabled: there is no reading of the DAQ yet"
        self._commanding.enable()
        self._measured.enabled()
        self._supervisor.enabled(now_s)
        self._said.changed("enabled")
        return True, "the output is on; the wire is held where it is"

    @property
    def is_driven(self) -> bool:
        """Whether current is to flow: from ``enable`` on, also before the first step that says so."""
        return self._commanding.is_driven

    @property
    def latched(self) -> str:
        """Name of the latched fault, "" where there is none."""
        return self._supervisor.latched.name if self._supervisor.latched is not None else ""

    def switched_off(self) -> None:
        """Take note that the supply was switched off since the last step: it will read back so, and nobody else did
        it."""
        self._tell(OFF)

    def clear_fault(self, now_s: float) -> tuple[bool, str]:
        """Clear a latched fault; the output stays off until enabled again."""
        self._said.forget_events()
        latched = self._supervisor.latched
        if latched is None:
            return True, "there is no fault to clear"
        words = words_of_latched(self._supervisor)
        self._said.changed(f"cleared {latched.name}")
        self._supervisor.latched, self._supervisor.detail = None, ""
        return True, f"cleared: {words}; the output stays off until ~/enable"

    def raise_fault(self, now_s: float, name: str, detail: str) -> None:
        """Report what only the driver can see.  Raises ValueError for a name that is not in the table."""
        if name not in FAULTS:
            raise ValueError(f"'{name}' is no fault; one of {', '.join(FAULTS)} is wanted")
        fault = FAULTS[name]
        if fault.latches:
            if self._commanding.is_driven or fault.while_off:
                self._latch(fault, detail)
            else:
                self._supervisor.present[fault] = detail
        else:
            self._said.event(now_s, fault, detail)

    def end_fault(self, name: str) -> None:
        """What was reported by :meth:`raise_fault` is over: where it is what is latched, it is so no more.  The output
        stays off."""
        if self.latched == name:
            self._said.changed(f"passed {name}")
            self._supervisor.latched, self._supervisor.detail = None, ""

    def offer_setpoint(self, now_s: float, position_m: float) -> str:
        """Take a setpoint [m]; "" or the sentence why it was refused.  The last good one stands."""
        return self._offered.setpoint(now_s, position_m)

    def offer_joint_command(self, now_s: float, position_m: float) -> str:
        """Take a position [m] of a stream of joint commands; "" or the sentence why it was refused.

        They are followed from the first on that is near the estimate (``controller.arming_distance``): a stream knows
        nothing of a wire that was switched on, stopped or moved by somebody else, and must not make it jump.  NaN is
        no command, and no fault: ros2_control sends it until a controller runs.
        """
        return self._offered.joint_command(now_s, position_m, self._estimate)

    def offer_trajectory(
        self,
        now_s: float,
        times_s: Sequence[float],
        positions_m: Sequence[float],
        velocities_m_s: Sequence[float] | None = None,
        delay_s: float = 0.0,
    ) -> str:
        """Take positions [m] at times [s] from ``delay_s`` after now; "" or the sentence why they were refused.

        Until a later start the wire goes on with what it does; of one that has begun already the rest is followed.
        Without points the motion ends where its reference has come.
        """
        reference_m = self._following.limited_setpoint_m
        return self._offered.trajectory(now_s, times_s, positions_m, velocities_m_s, delay_s, reference_m)

    def hold(self, now_s: float) -> str:
        """End the motion where the wire is measured to be; "" or the sentence why that was refused."""
        refusal = self._offered.not_driven
        if not refusal:
            self._commanding.stop()
        return refusal

    def tune(self, now_s: float) -> tuple[bool, str]:
        """Begin to tune the gains; whether that was done, and a sentence.

        What else is wanted of the wire ends it, with the gains of before.  So does its own end: what it has found is in
        that step's output, to be taken over by who keeps the parameters (``update``).
        """
        refusal = self._tuner.refusal(now_s, self._config, self._commanding, self._supervisor, self._estimate)
        if refusal:
            return False, f"not tuned: {refusal}"
        range_m = self._chain.displacement_range_m
        words = self._tuner.begin(self._config, self._following.controller, range_m, self._told.current_A)
        self._commanding.tune()
        self._said.changed("tuning")
        return True, words

    def reset_estimator(self) -> tuple[bool, str]:
        """Forget where on its loop the wire is: the next reading is taken for a wire at rest on its cooling curve.

        What has come over the wire since the session began (creep, a slip, cycles) stays: it was not estimated away.
        """
        self._chain.reset()
        self._said.changed(ESTIMATOR_RESET)
        self._commanding.stop()
        return True, "the estimator starts anew on the cooling curve; the wire is held there"

    def tare_load(self) -> tuple[bool, str]:
        """Take the mean load of the last readings for zero: the drift of a load cell, with the load taken off.

        More than a tenth of what the wire may carry is refused: a load that is tared away is a
        stress nobody watches any more.
        """
        if self._commanding.is_driven:
            return False, "not tared: the wire is driven; switch it off first: ~/enable false"
        done, words = self._measured.tare(self._config, self._is_fresh(self._now_s))
        if done:
            self._chain.reset()
            self._said.changed(f"tared {self._measured.tare_N:.6g} N", ESTIMATOR_RESET)
        return done, words

    def measure_lead_resistance(self) -> tuple[bool, str, float]:
        """Lead resistance [Ω] from the last readings with current, with a short in place of the wire.

        Put the short in, enable, wait for the fault ``short`` (it comes once the bias current has
        settled, and switches the output off), then ask.  The value is returned, not applied: it
        belongs in ``circuit.lead_resistance``.
        """
        return self._measured.lead_resistance(self._config)

    def update(self, config: Config) -> None:
        """Take over live parameters, without a jump of the current.

        Raises ConfigError where a parameter differs that is not live, and LawError; nothing is taken over then.
        """
        changes = live_changes(self._config, config)
        if config.controller != self._config.controller:
            if self._tuner.running is not None:
                self._commanding.stop()
                self._tuner.end("the parameters of the controller were changed")
            self._following.set_gains(config.controller)
        self._said.changed(*changes)
        self._config = config
        self._offered.config = config
        self._following.update(config)
        self._supervisor.update(config)
        self._chain.update(config)
        self._health.update(config)

    # --- the step ---------------------------------------------------------------------------------

    def step(
        self,
        now_s: float,
        reading: Reading | None,
        supply: SupplyState | None,
        waited: Waited = NOT_WAITED,
        came_late: bool = False,
    ) -> Output:
        """Advance to ``now_s`` of the loop's monotonic clock.

        ``reading`` and ``supply`` are None where the instrument gave no answer; ``waited``: for either, since the step
        before; ``came_late``: one of them says what was a while ago.  Never raises: an exception inside becomes a
        latched fault with the output off.
        """
        try:
            return self._step(now_s, reading, supply, waited, came_late)
        except Exception as error:  # noqa: BLE001 - whatever it is, the current must go off
            _log.exception("the control step failed")
            self._latch(unhandled_exception, f"{type(error).__name__}: {error}")
            self._tell(OFF)
            return self._output({}, set(), nan, reading)

    def _step(
        self, now_s: float, raw: Reading | None, supply: SupplyState | None, waited: Waited, came_late: bool
    ) -> Output:
        supervisor, config = self._supervisor, self._config
        dt_s = 0.0 if self._now_s != self._now_s else now_s - self._now_s
        if isfinite(now_s):
            self._now_s = now_s
        if dt_s < 0.0:
            self._reading_s = -inf  # else every reading until the old time would count as old
        reading = supervisor.usable(raw, self._reading_s, now_s)
        self._keep_heat(reading, supply, dt_s)
        driven = self._commanding.is_driven
        told = supervisor.standing(self._told, now_s, supply)
        settled = driven and supervisor.settled(now_s)
        longer_m = self._chain.longer_m
        faults = supervisor.inspect(
            Step(
                config,
                supervisor.memory,
                now_s,
                dt_s,
                driven,
                settled,
                raw,
                reading,
                self._signals,
                self._estimate,
                supply,
                told,
                supervisor.heat,
                waited,
                self._told_s,
                longer_m,
            )
        )
        late = came_late or self._late(raw, supply)  # the bias current flows, of which the law must not learn
        supervisor.watch_stress(self._signals.stress_Pa, self._estimate.displacement_m, self._told.current_A)
        self._limit_A = supervisor.limit_A()
        self._following.find_the_ends(longer_m)
        limits: set[Limit] = set()
        seen = Seen(now_s, self._now_s, self._signals, self._estimate, self._told.current_A, self._limit_A)
        setpoint_m, wanted_A = self._following.wanted(
            seen, settled, estimate_invalid not in faults, reading is not None and not late, limits
        )
        if back := supervisor.let_go(now_s, reading, supply):
            self._said.changed(f"passed {back}")
        command, bent = supervisor.gate(wanted_A, driven, faults, late)
        limits |= bent
        if supervisor.latched is not None:
            self._commanding.switch_off()
            self._tuner.end(f"fault {supervisor.latched.name}: {supervisor.detail}")
        self._tell(command)
        self._said.show_events(now_s, faults, self._commanding.lost)
        return self._output(faults, limits, setpoint_m, raw)

    def _keep_heat(self, reading: Reading | None, supply: SupplyState | None, dt_s: float) -> None:
        """Keep the heat balance of this step, with the signals and the estimate of a usable reading."""
        if reading is not None:
            self._sense(reading)
        elif supply is not None and not supply.output_on:
            self._measured.power_W = 0.0  # without either, the current may well flow on
        signals = self._signals
        shown_Ohm = signals.resistance_Ohm if reading is not None else nan
        self._supervisor.keep_heat(
            self._measured.power_W, signals.current_A, dt_s, signals.ambient_temperature_C, shown_Ohm, signals.load_N
        )

    def _output(
        self, faults: dict[Fault, str], limits: set[Limit], setpoint_m: float, reading: Reading | None
    ) -> Output:
        """What this step has to say, with what has changed since the one before."""
        changes, tuned = self._said.take_changes(self._supervisor), self._tuner.take_found()
        status = status_of(
            faults,
            limits,
            self._limit_A,
            self._supervisor,
            self._commanding,
            self._signals,
            self._estimate,
            self._chain.loses,
            self._following,
            self._offered.joint_commands,
            self._tuner,
            self._now_s,
        )
        return Output(
            self._signals,
            self._estimate,
            self._told,
            status,
            setpoint_m,
            self._measured.tare_N,
            changes,
            reading,
            self._health.verdict,
            tuned,
        )

    def _sense(self, reading: Reading) -> None:
        """Signals and estimate of a usable reading."""
        config, before_s = self._config, self._reading_s
        self._reading_s = reading.time_s
        calibrated = without_undriven(
            signals_from_reading(reading, config, self._measured.tare_N), config.supply.bias_current
        )
        self._signals, estimate = self._chain.step(calibrated)
        self._estimate = estimate.with_uncertainty(self._uncertainty.step(self._signals, estimate))
        self._following.sense(self._signals, self._estimate, reading.time_s - before_s)
        if self._health.step(self._signals, self._estimate):
            self._said.changed(f"model health: {self._health.verdict.words}")
        self._measured.note(reading, calibrated.current_A, self._signals.load_N, config.supply.bias_current)

    def _late(self, reading: Reading | None, supply: SupplyState | None) -> bool:
        """Whether an instrument has not answered, and has not done so for longer than an answer may take."""
        instruments, memory = self._config.instruments, self._supervisor.memory
        return (reading is None and self._now_s - memory.daq_s > instruments.daq.timeout) or (
            supply is None and self._now_s - memory.supply_s > instruments.supply.timeout
        )

    # --- small print --------------------------------------------------------------------------------

    def _latch(self, fault: Fault, detail: str) -> None:
        self._supervisor.latch(fault, detail)
        self._commanding.switch_off()
        self._tuner.end(f"fault {fault.name}: {detail}")

    def _tell(self, command: Command) -> None:
        """Take note of what the supply is told from now on."""
        if command != self._told:
            self._told, self._told_s = command, self._now_s

    def _is_fresh(self, now_s: float) -> bool:
        """Whether the last usable reading is no older than readings may be."""
        return now_s - self._reading_s <= self._config.safety.reading_timeout
