"""One wire: reading in, command out.  The whole behaviour, without I/O and without a clock of its own.

The node drives it from live instruments, experiments and tests from the virtual bench: what is
tested offline is what runs on the robot.
"""

from __future__ import annotations

import collections
import logging
from collections.abc import Collection, Sequence
from dataclasses import replace
from math import inf, isfinite, isnan, nan

from sma_actuator.base.parameters import ConfigError, walk
from sma_actuator.base.signals import (
    Branch,
    Command,
    Estimate,
    Mode,
    Output,
    Quality,
    Reading,
    Signals,
    Status,
    SupplyState,
    Tuned,
)
from sma_actuator.config import Config, require_calibrated
from sma_actuator.control.commanding import Commanding
from sma_actuator.control.law import SensingLaw
from sma_actuator.control.pid import PidParameters
from sma_actuator.control.setpoints import Trajectory
from sma_actuator.control.tuning import Sample, Surroundings, Tuning, words_of
from sma_actuator.estimation.chain import ESTIMATOR_RESET, Chain
from sma_actuator.estimation.circuit import is_driven, signals_from_reading, without_undriven
from sma_actuator.estimation.ends import Ends
from sma_actuator.estimation.health import ModelHealth
from sma_actuator.estimation.uncertainty import Uncertainty
from sma_actuator.safety.faults import FAULTS, gravest
from sma_actuator.safety.guards.estimate import estimate_invalid
from sma_actuator.safety.guards.program import unhandled_exception
from sma_actuator.safety.guards.setpoints import Bucket, no_motion, setpoint_flood, setpoint_not_finite, setpoint_stale
from sma_actuator.safety.limits import (
    CURRENT_BIAS,
    CURRENT_MAX,
    LIMITS,
    SETPOINT_PACE,
    SETPOINT_RANGE,
    SETPOINT_RATE,
    SETPOINT_REACH,
)
from sma_actuator.safety.reach import BEYOND_K, Needed, Reach
from sma_actuator.safety.records import NOT_WAITED, Fault, Limit, Step, Waited
from sma_actuator.safety.supervisor import Supervisor

_log = logging.getLogger(__name__)

#: An event without duration (a refused setpoint) stays in the status for this long.
EVENT_SHOWN_s = 1.0
#: Readings that ``tare_load`` and ``measure_lead_resistance`` average, at the most.
AVERAGED_READINGS = 20
#: And at the least.
FEWEST_READINGS = 3
#: Share of the current's limit that counts as all of it: about the limit, a controller's output is noise.
ALL_THERE_IS = 0.95
#: Share of the load at wire.max_stress that may be tared away: drift of a load cell, not a load.
MOST_TARE = 0.1
#: How the message of a latched fault ends.
AFTER_A_FAULT = "; ~/clear_fault, then ~/enable"
#: And of one that passes when its instrument answers again.
AFTER_A_LOSS = "; ~/enable once it answers again"
_WORDS_OF_MODE = {Mode.OFF: "off", Mode.HOLD: "holding", Mode.TRACKING: "tracking", Mode.TUNING: "tuning"}
_NOTHING = Signals(nan, nan, nan, nan, nan, nan)
_NO_ESTIMATE = Estimate(nan, nan, nan, 0.0, Branch.COOLING, Quality.INVALID)


def without_advice(message: str) -> str:
    """What a status says of a latched fault, without what to do about it."""
    return message.removesuffix(AFTER_A_FAULT).removesuffix(AFTER_A_LOSS)


class Actuator:
    """Estimator, controller and supervisor of one wire.  Not thread-safe: one owner."""

    def __init__(self, config: Config):
        require_calibrated(config)
        self._config = config
        self._chain = Chain(config)
        self._ends = Ends(config, self._chain.displacement_range_m, self._chain.knows_the_ends)
        self._beyond = ""  #: which end the setpoint is held at
        self._uncertainty = Uncertainty(config.model.build(config.wire), config.calibration)
        self._controller = config.controller.build(config)
        self._sensing = self._controller if isinstance(self._controller, SensingLaw) else None
        self._health = ModelHealth(config, config.supply.bias_current)
        self._supervisor = Supervisor(config)
        self._reach = Reach(config.wire.full_stroke_m, config.thermal.heat_capacity / config.thermal.heat_loss)
        self._commanding = Commanding()
        self._tuning: Tuning | None = None  #: that runs now
        self._tuning_words = "not run"  #: what became of the last
        self._tuned: Tuned | None = None  #: what one has found that no output has told yet
        self._resting_A = nan  #: what holds the wire where a tuning has left it
        self._now_s = nan
        self._reading_s = -inf  #: time stamp of the last usable reading
        self._controlled_s = nan  #: when the controller was last stepped
        self._tare_N = 0.0
        #: Loads of the last readings, as they would be without a tare.
        self._loads_N: collections.deque[float] = collections.deque(maxlen=AVERAGED_READINGS)
        #: Those with current since the output went on; they outlast it.
        self._readings_with_current: collections.deque[Reading] = collections.deque(maxlen=AVERAGED_READINGS)
        self._signals = _NOTHING
        self._estimate = _NO_ESTIMATE
        self._told = Command(0.0, False)
        self._power_W = 0.0
        self._setpoint_bucket = Bucket()
        self._events: dict[Fault, tuple[float, str]] = {}  #: fault without duration → when, detail
        self._joint_commands = "none"  #: what became of the last, in words
        self._changes: list[str] = []  #: that no output has told yet
        self._latched_told: Fault | None = None

    # --- what others may ask ----------------------------------------------------------------------

    def enable(self, now_s: float, on: bool) -> tuple[bool, str]:
        """Switch the current on or off; whether it was done, and a sentence."""
        if not on:
            if self._commanding.is_driven:
                self._changes.append("disabled")
            self._commanding.switch_off()
            self._end_tuning("the output was switched off")
            return True, "the output is off"
        latched = self._supervisor.latched
        if latched is not None:
            then = "ask again once it answers" if latched.until_back else "call ~/clear_fault first"
            return False, f"not enabled: {self._words_of(latched)}; {then}"
        if self._commanding.is_driven:
            return True, "the output is on already"
        present = self._supervisor.present
        blocking = [fault for fault in present if fault.prevents_enabling]
        if blocking:
            fault = gravest(blocking)
            return False, f"not enabled: {fault.words}: {present[fault]}"
        if not now_s - self._reading_s <= self._config.safety.reading_timeout:
            return False, "not enabled: there is no reading of the DAQ yet"
        self._commanding.enable()
        self._readings_with_current.clear()
        self._supervisor.enabled(now_s)
        self._changes.append("enabled")
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
        """Take note that the supply was switched off since the last step: it will read back so, and nobody else did it."""
        self._told = Command(0.0, False)

    def clear_fault(self, now_s: float) -> tuple[bool, str]:
        """Clear a latched fault; the output stays off until enabled again."""
        self._events.clear()
        latched = self._supervisor.latched
        if latched is None:
            return True, "there is no fault to clear"
        words = self._words_of(latched)
        self._changes.append(f"cleared {latched.name}")
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
            self._events[fault] = (now_s, detail)

    def end_fault(self, name: str) -> None:
        """What was reported by :meth:`raise_fault` is over: where it is what is latched, it is so no more.  The output stays off."""
        if self.latched == name:
            self._changes.append(f"passed {name}")
            self._supervisor.latched, self._supervisor.detail = None, ""

    def offer_setpoint(self, now_s: float, position_m: float) -> str:
        """Take a setpoint [m]; "" or the sentence why it was refused.  The last good one stands."""
        refusal = self._refuses_setpoints(now_s)
        if refusal:
            return refusal
        refusal = setpoint_not_finite.look(position_m)
        if refusal:
            self._events[setpoint_not_finite] = (now_s, refusal)
            return refusal
        self._commanding.track(now_s, float(position_m))
        return ""

    def offer_joint_command(self, now_s: float, position_m: float) -> str:
        """Take a position [m] of a stream of joint commands; "" or the sentence why it was refused.

        They are followed from the first on that is near the estimate (``controller.arming_distance``): a stream knows
        nothing of a wire that was switched on, stopped or moved by somebody else, and must not make it jump.  NaN is
        no command, and no fault: ros2_control sends it until a controller runs.
        """
        flooded = self._flood(now_s)
        if flooded:
            return flooded
        if position_m != position_m:
            self._joint_commands = "no number yet"
            return ""
        refusal = setpoint_not_finite.look(position_m)
        if refusal:
            self._events[setpoint_not_finite] = (now_s, refusal)
            return refusal
        if not self._commanding.is_driven:
            self._joint_commands = "not followed: the output is off"
            return ""
        if self._estimate.quality is Quality.INVALID:
            self._joint_commands = "not followed: where the wire is is not known yet"
            return ""
        was_armed = self._commanding.armed
        near_m = self._config.controller.arming_distance * self._config.wire.full_stroke_m
        wire_m = self._estimate.displacement_m
        if self._commanding.command(now_s, float(position_m), wire_m, near_m):
            self._joint_commands = "followed"
            if not was_armed:
                self._changes.append("joint commands followed")
        else:
            self._joint_commands = (
                f"not followed: {position_m * 1e3:.3f} mm, and the wire is at {wire_m * 1e3:.3f} mm; "
                f"{near_m * 1e3:.3g} mm or nearer is wanted first (controller.arming_distance)"
            )
        return ""

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
        refusal = self._refuses_setpoints(now_s)
        if refusal:
            return refusal
        if not len(times_s):
            self._commanding.cancel(self._limited_setpoint_m())
            return ""
        try:
            trajectory = Trajectory(times_s, positions_m, velocities_m_s=velocities_m_s)
        except (TypeError, ValueError) as error:
            self._events[setpoint_not_finite] = (now_s, str(error))
            return str(error)
        if not trajectory.duration_s + delay_s >= 0.0:
            return f"trajectory refused: its last point was due {-delay_s - trajectory.duration_s:.3g} s ago"
        self._commanding.follow(now_s, trajectory, delay_s)
        return ""

    def hold(self, now_s: float) -> str:
        """End the motion where the wire is measured to be; "" or the sentence why that was refused."""
        refusal = self._refuses_setpoints(now_s)
        if not refusal:
            self._commanding.stop()
        return refusal

    def tune(self, now_s: float) -> tuple[bool, str]:
        """Begin to tune the gains; whether that was done, and a sentence.

        What else is wanted of the wire ends it, with the gains of before.  So does its own end: what it has found is in
        that step's output, to be taken over by who keeps the parameters (``update``).
        """
        refusal = self._refuses_tuning(now_s)
        if refusal:
            return False, f"not tuned: {refusal}"
        config, gains = self._config, self._config.controller
        assert isinstance(gains, PidParameters)
        surroundings = Surroundings(
            range_m=self._chain.displacement_range_m,
            full_stroke_m=config.wire.full_stroke_m,
            bias_A=config.supply.bias_current,
            bound_A=gains.tuning_current * config.supply.max_current,
            hottest_C=config.thermal.derate_temperature,
            period_s=1.0 / config.loop.rate,
            time_constant_s=config.thermal.heat_capacity / config.thermal.heat_loss,
        )
        self._tuning = Tuning(self._controller, gains, surroundings, self._told.current_A)
        self._commanding.tune()
        self._changes.append("tuning")
        return True, f"the gains are tuned, with up to {surroundings.bound_A:.4g} A; any setpoint, or off, ends it"

    def _refuses_tuning(self, now_s: float) -> str:
        gains, bias_A = self._config.controller, self._config.supply.bias_current
        if not isinstance(gains, PidParameters):
            return "controller.type is no law with the gains of a PID"
        if not self._commanding.is_driven:
            return "the output is off; call ~/enable first"
        if self._tuning is not None:
            return "the gains are being tuned already"
        if self._commanding.anew or self._estimate.quality is Quality.INVALID or not self._supervisor.settled(now_s):
            return "where the wire is is not known yet"
        bound_A, limit_A = gains.tuning_current * self._config.supply.max_current, self._supervisor.limit_A()
        if not bound_A > 2.0 * bias_A:
            return f"controller.tuning_current allows {bound_A:.4g} A, more than twice supply.bias_current is wanted"
        if limit_A < bound_A:
            return (
                f"heat and stress leave {limit_A:.4g} A, {bound_A:.4g} A are wanted (controller.tuning_current): "
                "let the wire cool, take load off"
            )
        return ""

    def _end_tuning(self, why: str) -> None:
        """The gains of before are the law's again; ``why`` counts where it has not ended by itself."""
        tuning, self._tuning = self._tuning, None
        if tuning is None:
            return
        tuning.end(why)
        self._resting_A = tuning.resting_A
        if tuning.found is not None:
            self._tuned = tuning.found
            self._tuning_words = f"done: {words_of(tuning.found.gains)}"
        else:
            self._tuning_words = f"given up: {tuning.given_up}"
        self._changes.append(f"tuning {self._tuning_words}")

    def reset_estimator(self) -> tuple[bool, str]:
        """Forget where on its loop the wire is: the next reading is taken for a wire at rest on its cooling curve.

        What has come over the wire since the session began (creep, a slip, cycles) stays: it was not estimated away.
        """
        self._chain.reset()
        self._changes.append(ESTIMATOR_RESET)
        self._commanding.stop()
        return True, "the estimator starts anew on the cooling curve; the wire is held there"

    def tare_load(self) -> tuple[bool, str]:
        """Take the mean load of the last readings for zero: the drift of a load cell, with the load taken off.

        More than a tenth of what the wire may carry is refused: a load that is tared away is a
        stress nobody watches any more.
        """
        if self._commanding.is_driven:
            return False, "not tared: the wire is driven; switch it off first: ~/enable false"
        if (
            len(self._loads_N) < FEWEST_READINGS
            or not self._now_s - self._reading_s <= self._config.safety.reading_timeout
        ):
            return False, f"not tared: {FEWEST_READINGS} readings of just now are wanted"
        wire = self._config.wire
        load_N = sum(self._loads_N) / len(self._loads_N)
        bound_N = MOST_TARE * wire.max_stress * wire.area_m2
        if not abs(load_N) <= bound_N:
            return (
                False,
                f"not tared: {load_N:.3g} N is more than the drift of a load cell (up to {bound_N:.3g} N); take the load off",
            )
        self._tare_N = load_N
        self._chain.reset()
        self._changes += [f"tared {load_N:.6g} N", ESTIMATOR_RESET]
        return True, f"tared: {load_N:.4f} N count as zero from now on"

    def measure_lead_resistance(self) -> tuple[bool, str, float]:
        """Lead resistance [Ω] from the last readings with current, with a short in place of the wire.

        Put the short in, enable, wait for the fault ``short`` (it comes once the bias current has
        settled, and switches the output off), then ask.  The value is returned, not applied: it
        belongs in ``circuit.lead_resistance``.
        """
        readings = self._readings_with_current
        if len(readings) < FEWEST_READINGS:
            return (
                False,
                (
                    f"not measured: {len(readings)} readings with current since the output went on, {FEWEST_READINGS} are wanted; "
                    "put a short in place of the wire and call ~/enable"
                ),
                nan,
            )
        ratio = _mean(readings, "supply_voltage_V") / _mean(readings, "reference_voltage_V")
        total_Ohm = self._config.circuit.reference_resistance * (ratio - 1.0)
        most_Ohm = self._config.safety.resistance_min + self._config.circuit.lead_resistance
        if not 0.0 <= total_Ohm < most_Ohm:
            return (
                False,
                (
                    f"not measured: {total_Ohm:.4g} Ω is not that of leads (0 to {most_Ohm:.4g} Ω); "
                    "is there a short in place of the wire?"
                ),
                nan,
            )
        return True, f"the leads have {total_Ohm:.4f} Ω; write it to circuit.lead_resistance", total_Ohm

    def update(self, config: Config) -> None:
        """Take over live parameters, without a jump of the current.

        Raises ConfigError where a parameter differs that is not live; nothing is taken over then.
        """
        before = {name: repr(value) for name, value, *_ in walk(self._config)}
        wanted = {name: (repr(value), declaration.live) for name, value, declaration, _ in walk(config)}
        differing = {name: live for name, (value, live) in wanted.items() if value != before.get(name)}
        changed = [name for name, live in differing.items() if not live]
        if changed:
            raise ConfigError([f"{name}: cannot be changed while the actuator runs; start it anew" for name in changed])
        self._changes += [f"{name} {before[name]} -> {wanted[name][0]}" for name in differing]
        if config.controller != self._config.controller:
            if self._tuning is not None:
                self._commanding.stop()
                self._end_tuning("the parameters of the controller were changed")
            self._controller.set_gains(config.controller)
        self._config = self._supervisor.config = config
        self._chain.update(config)
        self._health.update(config)

    # --- the step ---------------------------------------------------------------------------------

    def step(
        self, now_s: float, reading: Reading | None, supply: SupplyState | None, waited: Waited = NOT_WAITED
    ) -> Output:
        """Advance to ``now_s`` of the loop's monotonic clock.

        ``reading`` and ``supply`` are None where the instrument gave no answer; ``waited``: for either, since the step
        before.  Never raises: an exception inside becomes a latched fault with the output off.
        """
        try:
            return self._step(now_s, reading, supply, waited)
        except Exception as error:  # noqa: BLE001 - whatever it is, the current must go off
            _log.exception("the control step failed")
            self._latch(unhandled_exception, f"{type(error).__name__}: {error}")
            self._told = Command(0.0, False)
            return self._output({}, set(), nan, reading)

    def _step(self, now_s: float, raw: Reading | None, supply: SupplyState | None, waited: Waited) -> Output:
        supervisor, config = self._supervisor, self._config
        dt_s = 0.0 if self._now_s != self._now_s else now_s - self._now_s
        if isfinite(now_s):
            self._now_s = now_s
        if dt_s < 0.0:
            self._reading_s = -inf  # else every reading until the old time would count as old
        reading = supervisor.usable(raw, self._reading_s, now_s)
        if reading is not None:
            self._sense(reading)
        elif supply is not None and not supply.output_on:
            self._power_W = 0.0  # without either, the current may well flow on
        signals = self._signals
        shown_Ohm = signals.resistance_Ohm if reading is not None else nan
        supervisor.keep_heat(
            self._power_W, signals.current_A, dt_s, signals.ambient_temperature_C, shown_Ohm, signals.load_N
        )

        driven = self._commanding.is_driven
        settled = driven and supervisor.settled(now_s)
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
                self._told,
                supervisor.heat,
                waited,
            )
        )
        late = self._late(raw, supply)  # the bias current flows, of which the law must not learn
        supervisor.watch_stress(self._signals.stress_Pa, self._estimate.displacement_m, self._told.current_A)
        limits: set[Limit] = set()
        setpoint_m = nan
        wanted_A = config.supply.bias_current
        if settled and supervisor.latched is None:
            self._commanding.advance(now_s)
            self._lose_setpoint(now_s)
        if self._tuning is not None and not self._commanding.is_tuned:
            self._end_tuning("something else was wanted of the wire")
        if settled and supervisor.latched is None and estimate_invalid not in faults:
            if self._commanding.anew:
                self._start_controller()
            if self._commanding.wants_position:
                setpoint_m = self._setpoint(now_s, limits)
                wanted_A = self._control(setpoint_m, reading is not None and not late, limits)
        if self._tuning is not None and self._tuning.ended:
            self._commanding.stop()
            self._end_tuning("")
        if back := supervisor.let_go(now_s, reading, supply):
            self._changes.append(f"passed {back}")
        command, bent = supervisor.gate(wanted_A, driven, faults, late)
        limits |= bent
        if supervisor.latched is not None:
            self._commanding.switch_off()
            self._end_tuning(f"fault {supervisor.latched.name}: {supervisor.detail}")
        self._told = command
        self._show_events(now_s, faults)
        return self._output(faults, limits, setpoint_m, raw)

    def _output(
        self, faults: dict[Fault, str], limits: set[Limit], setpoint_m: float, reading: Reading | None
    ) -> Output:
        """What this step has to say, with what has changed since the one before."""
        latched = self._supervisor.latched
        if latched is not self._latched_told and latched is not None:
            self._changes.append(f"fault {latched.name}: {self._supervisor.detail}")
        self._latched_told = latched
        changes, self._changes = tuple(self._changes), []
        tuned, self._tuned = self._tuned, None
        status = self._status(faults, limits)
        return Output(
            self._signals,
            self._estimate,
            self._told,
            status,
            setpoint_m,
            self._tare_N,
            changes,
            reading,
            self._health.verdict,
            tuned,
        )

    def _sense(self, reading: Reading) -> None:
        """Signals and estimate of a usable reading."""
        config, before_s = self._config, self._reading_s
        self._reading_s = reading.time_s
        calibrated = without_undriven(signals_from_reading(reading, config, self._tare_N), config.supply.bias_current)
        self._signals, estimate = self._chain.step(calibrated)
        self._estimate = replace(estimate, uncertainty_m=self._uncertainty.step(self._signals, estimate))
        if self._sensing is not None:
            self._sensing.sense(self._signals, self._estimate)
        if self._health.step(self._signals, self._estimate):
            self._changes.append(f"model health: {self._health.verdict.words}")
        self._ends.step(self._signals.stress_Pa, reading.time_s - before_s)
        self._loads_N.append(self._signals.load_N + self._tare_N)
        self._power_W = 0.0
        if is_driven(calibrated.current_A, config.supply.bias_current):
            # Leads and leaks count with the wire: the heat balance errs on the hot side.
            self._power_W = calibrated.current_A * max(reading.supply_voltage_V - reading.reference_voltage_V, 0.0)
            self._readings_with_current.append(reading)

    def _setpoint(self, now_s: float, limits: set[Limit]) -> float:
        """What the controller is to reach [m], inside the working range."""
        setpoint_m = self._commanding.position_m(now_s) if self._tuning is None else self._tuning.setpoint_m
        if self._commanding.mode is Mode.TRACKING:
            short_m, long_m = self._range_m()
            if not short_m <= setpoint_m <= long_m:
                limits.add(SETPOINT_RANGE)
                self._beyond = "short" if setpoint_m < short_m else "long"
                setpoint_m = min(max(setpoint_m, short_m), long_m)
        setpoint_m = max(setpoint_m, self._supervisor.stress_floor_m)
        told_A, most_A = self._told.current_A, self._config.supply.max_current
        self._reach.step(
            now_s,
            self._estimate.displacement_m,
            setpoint_m,
            at_max=told_A >= ALL_THERE_IS * most_A,
            at_limit=told_A >= ALL_THERE_IS * self._supervisor.limit_A(),
            power_W=self._power_W,
            load_N=self._signals.load_N,
            heat=self._needed_heat(),
        )
        if self._reach.floor_m > setpoint_m:
            limits.add(SETPOINT_REACH)
            vain = no_motion.look(self._reach.tries)
            if vain:
                self._supervisor.latch(no_motion, vain)
        return max(setpoint_m, self._reach.floor_m)

    def _range_m(self) -> tuple[float, float]:
        """Shortest and longest displacement that can be held at the present load and limits [m]."""
        return self._ends.range_m(self._supervisor.most_rise_K(), self._supervisor.heat.ambient.temperature_C)

    def _needed_heat(self) -> Needed | None:
        """What heat the wire takes to be where it seems to be; None where the calibration does not say."""
        calibration, thermal, stress_Pa = self._config.calibration, self._config.thermal, self._signals.stress_Pa
        if not calibration.transformation_known:
            return None
        share = calibration.share_of_stroke(self._estimate.displacement_m, stress_Pa)
        rise_K = calibration.heating_C(share, stress_Pa) - self._supervisor.heat.ambient.temperature_C
        loss_W_K = thermal.heat_loss
        return Needed(share, loss_W_K * rise_K, loss_W_K * BEYOND_K, loss_W_K * calibration.latent_rise)

    def _control(self, setpoint_m: float, is_new: bool, limits: set[Limit]) -> float:
        """Current the controller asks for [A]; without a new estimate, the one it asked for last."""
        controller = self._controller
        wanted_A = controller.output_A
        if is_new:
            # After a gap the integral must not leap.
            dt_s = min(self._now_s - self._controlled_s, self._config.safety.reading_timeout)
            self._controlled_s = self._now_s
            position_m, limit_A = self._estimate.displacement_m, self._supervisor.limit_A()
            if self._tuning is None:
                wanted_A = controller.step(position_m, setpoint_m, dt_s, limit_A)
            else:
                sample = Sample(self._now_s, position_m, self._told.current_A, self._supervisor.heat.temperature_C)
                wanted_A = self._tuning.step(sample, setpoint_m, dt_s, limit_A)
        if controller.rate_limited:
            limits.add(SETPOINT_RATE)
        if self._sensing is not None and self._sensing.paced:
            limits.add(SETPOINT_PACE)
        if controller.at_max:
            limits.add(CURRENT_MAX)
        if controller.at_bias:
            limits.add(CURRENT_BIAS)
        return wanted_A

    def _late(self, reading: Reading | None, supply: SupplyState | None) -> bool:
        """Whether an instrument has not answered, and has not done so for longer than an answer may take."""
        instruments, memory = self._config.instruments, self._supervisor.memory
        return (reading is None and self._now_s - memory.daq_s > instruments.daq.timeout) or (
            supply is None and self._now_s - memory.supply_s > instruments.supply.timeout
        )

    def _lose_setpoint(self, now_s: float) -> None:
        """What the parameters say when no setpoint has come for too long."""
        if self._commanding.mode is not Mode.TRACKING:
            return
        why = setpoint_stale.look(self._commanding.silent_s(now_s), self._commanding.armed, self._config)
        if not why:
            return
        action = self._config.controller.on_setpoint_loss
        if action == "off":
            self._supervisor.latch(setpoint_stale, why)
        else:
            self._commanding.lose(why, at_bias=action == "bias")

    def _start_controller(self) -> None:
        """Let the controller go on from the present position and current."""
        self._reach.forget()
        self._controlled_s = self._now_s
        position_m = self._estimate.displacement_m
        self._commanding.begun(position_m)
        current_A = max(self._told.current_A, self._config.supply.bias_current)
        # What flows in a relay test holds the wire nowhere.
        self._controller.reset(position_m, current_A if isnan(self._resting_A) else min(current_A, self._resting_A))
        self._resting_A = nan

    # --- small print --------------------------------------------------------------------------------

    def _latch(self, fault: Fault, detail: str) -> None:
        self._supervisor.latch(fault, detail)
        self._commanding.switch_off()
        self._end_tuning(f"fault {fault.name}: {detail}")

    def _refuses_setpoints(self, now_s: float) -> str:
        """Why no setpoint is taken now, or ""."""
        flooded = self._flood(now_s)
        if flooded:
            return flooded
        if not self._commanding.is_driven:
            return "setpoint refused: the output is off; call ~/enable first"
        return ""

    def _flood(self, now_s: float) -> str:
        flooded = setpoint_flood.look(self._setpoint_bucket, now_s, self._config)
        if flooded:
            self._events[setpoint_flood] = (now_s, flooded)
        return flooded

    def _show_events(self, now_s: float, faults: dict[Fault, str]) -> None:
        """Let faults without duration stay in the status for a while, a lost setpoint until the next."""
        if self._commanding.lost:
            faults.setdefault(setpoint_stale, self._commanding.lost)
        for fault, (when_s, detail) in list(self._events.items()):
            if 0.0 <= now_s - when_s <= EVENT_SHOWN_s:
                faults.setdefault(fault, detail)
            else:
                del self._events[fault]

    def _words_of(self, latched: Fault) -> str:
        return f"{latched.words} ({self._supervisor.detail})"

    def _words_of_limit(self, limit: Limit) -> str:
        if limit is not SETPOINT_RANGE:
            return limit.words
        short_m, long_m = self._range_m()
        end_m = short_m if self._beyond == "short" else long_m
        return f"{limit.words} (at its {self._beyond} end, {end_m * 1e3:.3f} mm)"

    def _limited_setpoint_m(self) -> float:
        """How far the setpoint is followed by now; NaN before the controller has begun, and where it has no position."""
        if self._commanding.anew or not self._commanding.wants_position:
            return nan
        return self._controller.reference_m if self._tuning is None else self._tuning.setpoint_m

    def _joint_command_words(self) -> str:
        if self._joint_commands == "followed" and not self._commanding.armed:
            return "not followed any more"
        return self._joint_commands

    def _status(self, faults: dict[Fault, str], limits: set[Limit]) -> Status:
        supervisor = self._supervisor
        fault = supervisor.latched
        words = _WORDS_OF_MODE[self._commanding.mode]
        if self._tuning is not None:
            words += f" ({self._tuning.words})"
        if fault is not None:
            words = f"off: {self._words_of(fault)}{AFTER_A_LOSS if fault.until_back else AFTER_A_FAULT}"
        elif faults:
            fault = gravest(faults)
            words = f"{words}: {fault.words} ({faults[fault]})"
        shown = tuple(limit for limit in LIMITS.values() if limit in limits)
        if fault is None and shown:
            words = f"{words}: {', '.join(self._words_of_limit(limit) for limit in shown)}"
        short_m, long_m = self._range_m()
        signals, estimate = self._signals, self._estimate
        # With the mode "off" no position is said, though the last reading may be of before the output went off:
        # this status stands for a while, and the wire moves.
        known = self._commanding.is_driven and estimate.quality is not Quality.INVALID
        return Status(
            mode=self._commanding.mode,
            fault=fault.name if fault is not None else "",
            limits=tuple(limit.name for limit in shown),
            message=words,
            values={
                "displacement_m": estimate.displacement_m if known else nan,
                "uncertainty_m": estimate.uncertainty_m if known else nan,
                "resistance_Ohm": signals.resistance_Ohm,
                "current_A": signals.current_A,
                "power_W": signals.power_W,
                "load_N": signals.load_N,
                "stress_Pa": signals.stress_Pa,
                "temperature_C": supervisor.heat.temperature_C,
                "temperature_at_most_C": supervisor.heat.at_most_C,
                "temperature_guessed_K": supervisor.heat.guessed_K,
                "current_limit_A": supervisor.limit_A(),
                "limited_setpoint_m": self._limited_setpoint_m(),
                "shortest_m": short_m,
                "longest_m": long_m,
                "branch": estimate.branch.name.lower(),
                "quality": estimate.quality.name.lower(),
                "joint_commands": self._joint_command_words(),
                "tuning": self._tuning.words if self._tuning is not None else self._tuning_words,
            },
        )


def _mean(readings: Collection[Reading], channel: str) -> float:
    return sum(getattr(reading, channel) for reading in readings) / len(readings)
