"""One wire: reading in, command out.  The whole behaviour, without I/O and without a clock of its own.

The node drives it from live instruments, experiments and tests from the virtual bench: what is
tested offline is what runs on the robot.
"""

from __future__ import annotations

import collections
import dataclasses
import logging
from dataclasses import dataclass
from math import inf, isfinite, nan

from .circuit import signals_from_reading
from .config import Config
from .controller import PidController
from .estimator import Estimator
from .faults import FAULTS, FLOOD_BURST_MIN, FLOOD_BURST_S, LIMITS, Action, Fault, Limit
from .setpoints import Trajectory
from .signals import Branch, Command, Estimate, Mode, Quality, Reading, Signals, Status, SupplyState
from .supervisor import MEASURABLE, Step, Supervisor

_log = logging.getLogger(__name__)

#: An event without duration (a refused setpoint) stays in the status for this long.
EVENT_SHOWN_S = 1.0
#: Readings that ``tare_load`` and ``measure_lead_resistance`` average, at the most.
AVERAGED_READINGS = 20
#: And at the least.
FEWEST_READINGS = 5
_NOTHING = Signals(nan, nan, nan, nan, nan, nan)
_NO_ESTIMATE = Estimate(nan, nan, nan, 0.0, Branch.COOLING, Quality.INVALID)
_SEVERITY = {fault: number for number, fault in enumerate(Fault)}


@dataclass(frozen=True, slots=True)
class Output:
    """Everything one step has to say."""

    signals: Signals  #: of the last usable reading
    estimate: Estimate
    command: Command
    status: Status
    setpoint_m: float  #: what the controller was asked for, NaN where nothing


class Actuator:
    """Estimator, controller and supervisor of one wire.  Not thread-safe: one owner."""

    def __init__(self, config: Config):
        self._config = config
        self._estimator = Estimator(config)
        self._controller = PidController(config.controller, config.supply.bias_current)
        self._supervisor = Supervisor(config)
        self._mode = Mode.OFF
        self._starting = False  #: the controller starts where the wire is, once that is known
        self._bias_only = False  #: the setpoint is lost, and the parameters say bias
        self._setpoint_m = nan
        self._setpoint_s = nan
        self._trajectory: tuple[float, Trajectory] | None = None
        self._tare_N = 0.0
        self._now_s = nan
        self._reading_s = -inf  #: time stamp of the last usable reading
        self._readings: collections.deque[Reading] = collections.deque(maxlen=AVERAGED_READINGS)
        self._signals = _NOTHING
        self._estimate = _NO_ESTIMATE
        self._told = Command(0.0, False)
        self._power_W = 0.0
        self._tokens = inf
        self._tokens_s = nan
        self._events: dict[Fault, tuple[float, str]] = {}  #: fault without duration → when, detail
        self._present: dict[Fault, str] = {}  #: faults of the last step

    # --- what others may ask ----------------------------------------------------------------------

    def enable(self, now_s: float, on: bool) -> tuple[bool, str]:
        """Switch the current on or off; whether it was done, and a sentence."""
        if not on:
            self._switch_off()
            return True, "the output is off"
        if self._supervisor.latched is not None:
            return False, f"not enabled: {self._fault_words()}; call ~/clear_fault first"
        if not now_s - self._reading_s <= self._config.safety.reading_timeout:
            return False, "not enabled: there is no reading of the DAQ yet"
        blocking = [fault for fault in self._present if FAULTS[fault].action in (Action.OFF, Action.BIAS)]
        if blocking:
            return False, f"not enabled: {FAULTS[blocking[0]].words}: {self._present[blocking[0]]}"
        if self._mode is not Mode.OFF:
            return True, "the output is on already"
        self._mode, self._starting = Mode.HOLD, True
        self._forget_setpoints()
        self._supervisor.enabled(now_s)
        return True, "the output is on; the wire is held where it is"

    def clear_fault(self, now_s: float) -> tuple[bool, str]:
        """Clear a latched fault; the output stays off until enabled again."""
        self._events.clear()
        if self._supervisor.latched is None:
            return True, "there is no fault to clear"
        words = self._fault_words()
        self._supervisor.latched, self._supervisor.detail = None, ""
        return True, f"cleared: {words}; the output stays off until ~/enable"

    def raise_fault(self, now_s: float, name: str, detail: str) -> None:
        """Report what only the driver can see.  Raises ValueError for a name that is not in the table."""
        fault = Fault(name)
        if FAULTS[fault].latches:
            if self._mode is not Mode.OFF or FAULTS[fault].while_off:
                self._latch(fault, detail)
            else:
                self._present[fault] = detail
        else:
            self._events[fault] = (now_s, detail)

    def offer_setpoint(self, now_s: float, position_m: float) -> str:
        """Take a setpoint [m]; "" or the sentence why it was refused.  The last good one stands."""
        refusal = self._refuses_setpoints(now_s)
        if refusal:
            return refusal
        if not isfinite(position_m):
            detail = f"setpoint {position_m}: a finite position in metres is wanted"
            self._events[Fault.SETPOINT_NOT_FINITE] = (now_s, detail)
            return detail
        self._trajectory = None
        self._setpoint_m, self._setpoint_s = float(position_m), now_s
        self._mode, self._bias_only = Mode.TRACKING, False
        return ""

    def offer_trajectory(self, now_s: float, times_s, positions_m) -> str:
        """Take positions [m] at times [s] from now; "" or the sentence why they were refused."""
        refusal = self._refuses_setpoints(now_s)
        if refusal:
            return refusal
        try:
            trajectory = Trajectory(times_s, positions_m)
        except (TypeError, ValueError) as error:
            self._events[Fault.SETPOINT_NOT_FINITE] = (now_s, str(error))
            return str(error)
        self._trajectory = (now_s, trajectory)
        self._setpoint_m, self._setpoint_s = trajectory(0.0), now_s
        self._mode, self._bias_only = Mode.TRACKING, False
        return ""

    def reset_estimator(self) -> tuple[bool, str]:
        """Forget the past of the estimate: the next reading is taken for a wire at rest on its cooling curve."""
        self._estimator.reset()
        if self._mode is not Mode.OFF:
            self._mode, self._starting = Mode.HOLD, True
            self._forget_setpoints()
        return True, "the estimator starts anew on the cooling curve; the wire is held there"

    def tare_load(self) -> tuple[bool, str]:
        """Take the mean load of the last readings for zero."""
        if self._mode is not Mode.OFF:
            return False, "not tared: the wire is driven; switch it off with ~/enable first"
        if len(self._readings) < FEWEST_READINGS:
            return False, f"not tared: {len(self._readings)} readings so far, {FEWEST_READINGS} are wanted"
        cell = self._config.load_cell
        load_N = cell.slope * self._mean("load_cell_voltage_V") + cell.offset
        bound_N = self._config.wire.max_stress * self._config.wire.area_m2
        if not abs(load_N) <= bound_N:
            return False, f"not tared: {load_N:.3g} N hang on the load cell, more than the wire may carry, {bound_N:.3g} N"
        self._tare_N = load_N
        return True, f"tared: {load_N:.4f} N count as zero from now on"

    def measure_lead_resistance(self) -> tuple[bool, str, float]:
        """Lead resistance [Ω] from the last readings, with a short in place of the wire and current flowing.

        The value is returned, not applied: it belongs in ``circuit.lead_resistance``.
        """
        if len(self._readings) < FEWEST_READINGS:
            return False, f"not measured: {len(self._readings)} readings so far, {FEWEST_READINGS} are wanted", nan
        circuit = self._config.circuit
        reference_V = self._mean("reference_voltage_V")
        current_A = reference_V / circuit.reference_resistance
        if not current_A >= MEASURABLE * self._config.supply.bias_current:
            return False, f"not measured: {current_A:.3g} A flow; replace the wire by a short and let the bias current flow", nan
        total_Ohm = circuit.reference_resistance * (self._mean("supply_voltage_V") / reference_V - 1.0)
        if not 0.0 <= total_Ohm < self._config.safety.resistance_min:
            return False, (
                f"not measured: {total_Ohm:.4g} Ω is not that of leads (0 to safety.resistance_min, "
                f"{self._config.safety.resistance_min:g} Ω); is there a short in place of the wire?"
            ), nan
        return True, f"the leads have {total_Ohm:.4f} Ω; write it to circuit.lead_resistance", total_Ohm

    def update(self, config: Config) -> None:
        """Take over live parameters, without a jump of the current."""
        self._config = self._supervisor.config = config
        self._controller.set_gains(config.controller)
        self._estimator.update(config)

    # --- the step ---------------------------------------------------------------------------------

    def step(self, now_s: float, reading: Reading | None, supply: SupplyState | None) -> Output:
        """Advance to ``now_s`` of the loop's monotonic clock.

        ``reading`` and ``supply`` are None where the instrument gave no answer.  Never raises: an
        exception inside becomes a latched fault with the output off.
        """
        try:
            return self._step(now_s, reading, supply)
        except Exception as error:  # noqa: BLE001 - whatever it is, the current must go off
            _log.exception("the control step failed")
            self._latch(Fault.UNHANDLED_EXCEPTION, f"{type(error).__name__}: {error}")
            self._told = Command(0.0, False)
            return Output(self._signals, self._estimate, self._told, self._status({}, set()), nan)

    def _step(self, now_s: float, raw: Reading | None, supply: SupplyState | None) -> Output:
        supervisor, config = self._supervisor, self._config
        dt_s = 0.0 if self._now_s != self._now_s else now_s - self._now_s
        if isfinite(now_s):
            self._now_s = now_s
        reading = supervisor.usable(raw, self._reading_s)
        if reading is not None:
            self._sense(reading)
        elif self._mode is Mode.OFF:
            self._power_W = 0.0
        supervisor.heat(self._power_W, dt_s, self._signals.ambient_temperature_C)

        driven = self._mode is not Mode.OFF
        settled = driven and supervisor.settled(now_s)
        faults = supervisor.inspect(
            Step(now_s, dt_s, driven, settled, raw, reading, self._signals, self._estimate, supply, self._told,
                 supervisor.temperature_C)
        )
        limits: set[Limit] = set()
        setpoint_m = nan
        wanted_A = config.supply.bias_current
        if driven and settled and supervisor.latched is None:
            self._lose_setpoint(now_s, faults)
        if driven and settled and supervisor.latched is None and Fault.ESTIMATE_INVALID not in faults:
            if self._starting:
                self._start_controller()
            if self._bias_only:
                self._controller.reset(self._estimate.displacement_m, wanted_A)
            else:
                setpoint_m = self._setpoint(now_s, limits)
                wanted_A = self._control(setpoint_m, dt_s, limits)
        command, bent = supervisor.gate(wanted_A, driven, faults, self._signals.stress_Pa)
        limits |= bent
        if supervisor.latched is not None:
            self._switch_off()
        self._told = command
        self._present = faults
        self._show_events(now_s, faults)
        return Output(self._signals, self._estimate, command, self._status(faults, limits), setpoint_m)

    def _sense(self, reading: Reading) -> None:
        """Signals and estimate of a usable reading."""
        config = self._config
        self._reading_s = reading.time_s
        self._readings.append(reading)
        signals = signals_from_reading(reading, config, self._tare_N)
        if signals.current_A >= MEASURABLE * config.supply.bias_current:
            # The leads count with the wire: the heat balance errs on the hot side.
            self._power_W = signals.current_A * max(reading.supply_voltage_V - reading.reference_voltage_V, 0.0)
        else:
            # Noise divided by noise is no resistance.
            self._power_W = 0.0
            signals = dataclasses.replace(signals, resistance_Ohm=nan, power_W=nan)
        self._signals = signals
        self._estimate = self._estimator.step(signals)

    def _setpoint(self, now_s: float, limits: set[Limit]) -> float:
        """What the controller is to reach [m], inside the working range."""
        if self._trajectory is not None:
            start_s, trajectory = self._trajectory
            self._setpoint_m = trajectory(now_s - start_s)
            if now_s - start_s < trajectory.duration_s:
                self._setpoint_s = now_s
        setpoint_m = self._setpoint_m
        if self._mode is Mode.TRACKING:
            lo_m, hi_m = self._estimator.displacement_range_m
            if not lo_m <= setpoint_m <= hi_m:
                limits.add(Limit.SETPOINT_RANGE)
                setpoint_m = min(max(setpoint_m, lo_m), hi_m)
        return setpoint_m

    def _control(self, setpoint_m: float, dt_s: float, limits: set[Limit]) -> float:
        """Current the controller asks for [A]."""
        controller = self._controller
        wanted_A = controller.step(self._estimate.displacement_m, setpoint_m, dt_s, self._supervisor.limit_A())
        if controller.rate_limited:
            limits.add(Limit.SETPOINT_RATE)
        if controller.at_max:
            limits.add(Limit.CURRENT_MAX)
        if controller.at_bias:
            limits.add(Limit.CURRENT_BIAS)
        return wanted_A

    def _lose_setpoint(self, now_s: float, faults: dict[Fault, str]) -> None:
        """What the parameters say when no setpoint has come for too long."""
        gains = self._config.controller
        if self._mode is not Mode.TRACKING or gains.setpoint_timeout == 0.0:
            return
        if now_s - self._setpoint_s <= gains.setpoint_timeout:
            return
        detail = f"none for {now_s - self._setpoint_s:.3g} s; controller.setpoint_timeout is {gains.setpoint_timeout:g} s"
        if gains.on_setpoint_loss == "off":
            self._supervisor.latch(Fault.SETPOINT_STALE, detail)
        elif gains.on_setpoint_loss == "hold":
            self._hold_here()
        else:
            self._bias_only = True
        self._events[Fault.SETPOINT_STALE] = (now_s, detail)
        faults[Fault.SETPOINT_STALE] = detail

    def _hold_here(self) -> None:
        """Hold the wire where it is, from the present current on."""
        self._mode, self._trajectory = Mode.HOLD, None
        self._start_controller()

    def _start_controller(self) -> None:
        """Let the controller go on from the present position and current."""
        self._starting = False
        position_m = self._estimate.displacement_m
        if self._mode is Mode.HOLD:
            self._setpoint_m = position_m
        self._controller.reset(position_m, max(self._told.current_A, self._config.supply.bias_current))

    # --- small print --------------------------------------------------------------------------------

    def _switch_off(self) -> None:
        self._mode, self._starting = Mode.OFF, False
        self._forget_setpoints()

    def _forget_setpoints(self) -> None:
        self._setpoint_m = self._setpoint_s = nan
        self._trajectory, self._bias_only = None, False

    def _latch(self, fault: Fault, detail: str) -> None:
        self._supervisor.latch(fault, detail)
        self._switch_off()

    def _refuses_setpoints(self, now_s: float) -> str:
        """Why no setpoint is taken now, or ""."""
        rate_Hz = self._config.safety.setpoint_flood_rate
        burst = max(FLOOD_BURST_MIN, FLOOD_BURST_S * rate_Hz)
        if isfinite(now_s - self._tokens_s):
            self._tokens = min(burst, self._tokens + max(now_s - self._tokens_s, 0.0) * rate_Hz)
        self._tokens = min(self._tokens, burst)
        self._tokens_s = now_s
        if self._tokens < 1.0:
            detail = f"setpoints come faster than safety.setpoint_flood_rate, {rate_Hz:g} Hz; this one is refused"
            self._events[Fault.SETPOINT_FLOOD] = (now_s, detail)
            return detail
        self._tokens -= 1.0
        if self._mode is Mode.OFF:
            return "setpoint refused: the output is off; call ~/enable first"
        return ""

    def _show_events(self, now_s: float, faults: dict[Fault, str]) -> None:
        """Let faults without duration stay in the status for a while."""
        for fault, (when_s, detail) in list(self._events.items()):
            if 0.0 <= now_s - when_s <= EVENT_SHOWN_S:
                faults.setdefault(fault, detail)
            else:
                del self._events[fault]

    def _mean(self, channel: str) -> float:
        return sum(getattr(reading, channel) for reading in self._readings) / len(self._readings)

    def _fault_words(self) -> str:
        return f"{FAULTS[self._supervisor.latched].words} ({self._supervisor.detail})"

    def _status(self, faults: dict[Fault, str], limits: set[Limit]) -> Status:
        supervisor = self._supervisor
        fault = supervisor.latched
        words = {Mode.OFF: "off", Mode.HOLD: "holding", Mode.TRACKING: "tracking"}[self._mode]
        if fault is not None:
            words = f"off: {self._fault_words()}; ~/clear_fault, then ~/enable"
        elif faults:
            fault = min(faults, key=_SEVERITY.__getitem__)
            words = f"{words}: {FAULTS[fault].words} ({faults[fault]})"
        shown = tuple(limit for limit in Limit if limit in limits)
        if fault is None and shown:
            words = f"{words}: {', '.join(LIMITS[limit].words for limit in shown)}"
        signals, estimate = self._signals, self._estimate
        return Status(
            mode=self._mode,
            fault=fault.value if fault is not None else "",
            limits=tuple(limit.value for limit in shown),
            message=words,
            values={
                "resistance_Ohm": signals.resistance_Ohm,
                "current_A": signals.current_A,
                "power_W": signals.power_W,
                "load_N": signals.load_N,
                "stress_Pa": signals.stress_Pa,
                "temperature_C": supervisor.temperature_C,
                "branch": estimate.branch.name.lower(),
                "quality": estimate.quality.name.lower(),
            },
        )
