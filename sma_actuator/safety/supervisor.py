"""The last word before the supply: what is wrong, and what current is still allowed.

The supervisor may only lower or cut a command.  Each guard is one function that looks at the
present step and answers why its fault is there, or with nothing; ``GUARDS`` lists them, the table
in :mod:`sma_actuator.safety.faults` says what follows from each.  Bounds are written ``lo <= x <= hi``, so
that NaN fails them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from typing import TYPE_CHECKING

from sma_actuator.base.signals import MEASURABLE, Command, Estimate, Quality, Reading, Signals, SupplyState

from .faults import FAULTS, FLOOD_BURST_MIN, FLOOD_BURST_S, SETTLING_READINGS, SETTLING_TIME_S, Action, Fault, Limit
from .thermal import HeatBalance, derated_limit_A

if TYPE_CHECKING:
    from sma_actuator.config import Config

#: A step later than this many periods after the one before is an overrun.
OVERRUN_PERIODS = 1.5
#: Share of supply.max_voltage that counts as being at the compliance voltage.
COMPLIANCE = 0.95
#: Settings of supplies are coarser than the command: 0.02 mA in the thesis, up to 1 mA elsewhere.
SETTING_TOLERANCE_A = 2e-3
#: Surroundings a wire can be driven in [°C]; a sensor that says otherwise is not believed.
AMBIENT_RANGE_C = (-60.0, 100.0)
_OFF = Command(0.0, False)
_ORDER = {fault: number for number, fault in enumerate(Fault)}


@dataclass(slots=True)
class Step:
    """What the guards see of one step.  ``reading`` is None where there is no usable new one."""

    now_s: float
    dt_s: float
    driven: bool  #: the output is meant to be on
    settled: bool  #: enabled long enough for current and reading to belong together
    raw: Reading | None
    reading: Reading | None
    signals: Signals
    estimate: Estimate
    supply: SupplyState | None
    told: Command  #: what the supply was told in the step before
    temperature_C: float


@dataclass(slots=True)
class Memory:
    """What the guards remember from one step to the next."""

    reading_s: float = nan  #: loop time of the last usable reading
    daq_s: float = nan  #: of the last answer of the DAQ
    supply_s: float = nan  #: of the last usable read-back
    load_N: float = nan
    channels: dict[str, tuple[float, float]] = field(default_factory=dict)  #: value, and since when it stands
    since_s: dict[str, float] = field(default_factory=dict)  #: since when a condition holds
    count: dict[str, int] = field(default_factory=dict)  #: how many times running

    def lasts_s(self, name: str, holds: bool, now_s: float) -> float:
        """How long a condition has held without a break; −inf where it does not."""
        if not holds:
            self.since_s.pop(name, None)
            return -inf
        return now_s - self.since_s.setdefault(name, now_s)

    def running(self, name: str, holds: bool) -> int:
        """How many steps running a condition has held."""
        self.count[name] = self.count.get(name, 0) + 1 if holds else 0
        return self.count[name]


def _finite(reading: Reading) -> bool:
    return (
        isfinite(reading.time_s)
        and isfinite(reading.supply_voltage_V)
        and isfinite(reading.reference_voltage_V)
        and isfinite(reading.load_cell_voltage_V)
    )


def _voltages(reading: Reading) -> dict[str, float]:
    return {
        "supply voltage": reading.supply_voltage_V,
        "reference voltage": reading.reference_voltage_V,
        "load cell": reading.load_cell_voltage_V,
    }


def clock_jump(step: Step, memory: Memory, config: Config) -> str:
    """Monotonic time that is not.  Without current a pause harms nobody."""
    if not step.driven or 0.0 <= step.dt_s <= config.safety.reading_timeout:
        return ""
    return f"{step.dt_s:g} s since the step before; 0 to {config.safety.reading_timeout:g} s is plausible"


def supply_tripped(step: Step, memory: Memory, config: Config) -> str:
    """The supply's own protections."""
    return step.supply.tripped if step.supply is not None else ""


def second_commander(step: Step, memory: Memory, config: Config) -> str:
    """The read-back changes without us."""
    supply, told = step.supply, step.told
    if supply is None or supply.tripped or not isfinite(supply.current_setting_A):
        return ""
    same_setting = not told.output_on or abs(supply.current_setting_A - told.current_A) <= SETTING_TOLERANCE_A
    if same_setting and supply.output_on == told.output_on:
        return ""
    return (
        f"the supply says {supply.current_setting_A:g} A, output {'on' if supply.output_on else 'off'}; "
        f"it was told {told.current_A:g} A, output {'on' if told.output_on else 'off'}"
    )


def supply_lost(step: Step, memory: Memory, config: Config) -> str:
    """No usable read-back."""
    supply = step.supply
    if supply is not None and isfinite(supply.current_setting_A + supply.voltage_V + supply.current_A):
        memory.supply_s = step.now_s
    return _silent(step, memory.supply_s, "read-back of the supply", config)


def daq_lost(step: Step, memory: Memory, config: Config) -> str:
    """No answer of the DAQ."""
    if step.raw is not None:
        memory.daq_s = step.now_s
    return _silent(step, memory.daq_s, "answer of the DAQ", config)


def reading_stale(step: Step, memory: Memory, config: Config) -> str:
    """Answers, but none that can be used."""
    if step.reading is not None:
        memory.reading_s = step.now_s
    return _silent(step, memory.reading_s, "new and finite reading", config)


def _silent(step: Step, last_s: float, what: str, config: Config) -> str:
    if step.now_s - last_s <= config.safety.reading_timeout:
        return ""
    return f"no {what} for {step.now_s - last_s:.3g} s; safety.reading_timeout is {config.safety.reading_timeout:g} s"


def reading_not_finite(step: Step, memory: Memory, config: Config) -> str:
    """NaN or infinity on entry."""
    if step.raw is None or _finite(step.raw):
        return ""
    bad = [name for name, value in {"time": step.raw.time_s, **_voltages(step.raw)}.items() if not isfinite(value)]
    return f"{', '.join(bad)}: not a finite number"


def reading_saturated(step: Step, memory: Memory, config: Config) -> str:
    """A channel at the end of its range."""
    if step.raw is None:
        return ""
    bound_V = config.safety.channel_max_voltage
    for name, value in _voltages(step.raw).items():
        if value <= -bound_V or value >= bound_V:
            return f"{name}: {value:g} V; the channel ends at ±{bound_V:g} V (safety.channel_max_voltage)"
    return ""


def open_wire(step: Step, memory: Memory, config: Config) -> str:
    """All the voltage there is, and little current."""
    least_A = config.safety.open_wire_current_fraction * step.told.current_A
    is_open = (
        step.told.output_on
        and step.reading is not None
        and step.reading.supply_voltage_V >= COMPLIANCE * config.supply.max_voltage
        and not step.signals.current_A >= least_A
    )
    if memory.running("open_wire", is_open) < 2:
        return ""
    return (
        f"{step.signals.current_A:.3g} A flow of {step.told.current_A:.3g} A at {step.reading.supply_voltage_V:.3g} V"
    )


def short(step: Step, memory: Memory, config: Config) -> str:
    """Too little resistance."""
    if not (step.settled and step.reading is not None and step.signals.resistance_Ohm < config.safety.resistance_min):
        return ""
    return f"{step.signals.resistance_Ohm:.3g} Ω; safety.resistance_min is {config.safety.resistance_min:g} Ω"


def reading_implausible(step: Step, memory: Memory, config: Config) -> str:
    """Readings no wire on this bench can give."""
    if step.reading is None:
        return ""
    safety, signals = config.safety, step.signals
    if signals.resistance_Ohm > safety.resistance_max:
        return f"resistance {signals.resistance_Ohm:.3g} Ω; safety.resistance_max is {safety.resistance_max:g} Ω"
    if not signals.load_N >= safety.load_min:
        return f"load {signals.load_N:.3g} N; safety.load_min is {safety.load_min:g} N"
    if not signals.current_A >= -MEASURABLE * config.supply.bias_current:
        return f"current {signals.current_A:.3g} A flows backwards; is the sense resistor's channel wired the wrong way round?"
    return ""


def sensor_stuck(step: Step, memory: Memory, config: Config) -> str:
    """Not one changed digit where there must be noise."""
    if step.reading is None:
        return ""
    if not step.told.output_on:
        memory.channels.clear()
        return ""
    for name, value in _voltages(step.reading).items():
        stands, since_s = memory.channels.get(name, (nan, step.now_s))
        if value != stands:
            since_s = step.now_s
            memory.channels[name] = (value, since_s)
        if step.now_s - since_s > config.safety.stuck_time:
            return f"{name}: {value:g} V for {step.now_s - since_s:.3g} s to the last digit; safety.stuck_time is {config.safety.stuck_time:g} s"
    return ""


def stress_above_limit(step: Step, memory: Memory, config: Config) -> str:
    """More stress than the wire survives."""
    if step.reading is None or step.signals.stress_Pa <= config.wire.max_stress:
        return ""
    return f"{step.signals.stress_Pa / 1e6:.4g} MPa; wire.max_stress is {config.wire.max_stress / 1e6:g} MPa"


def load_spike(step: Step, memory: Memory, config: Config) -> str:
    """A blow, or a load cell that lost its mind."""
    if step.reading is None:
        return ""
    change_N = step.signals.load_N - memory.load_N
    memory.load_N = step.signals.load_N
    if not abs(change_N) > config.safety.load_spike:
        return ""
    return f"{change_N:+.3g} N from one reading to the next; safety.load_spike is {config.safety.load_spike:g} N"


def too_hot(step: Step, memory: Memory, config: Config) -> str:
    """The heat balance on measured power."""
    if step.temperature_C <= config.thermal.max_temperature:
        return ""
    return f"estimated {step.temperature_C:.0f} °C; thermal.max_temperature is {config.thermal.max_temperature:g} °C"


def supply_disagrees(step: Step, memory: Memory, config: Config) -> str:
    """Another current flows than was commanded."""
    if step.reading is None:
        return ""
    told_A = step.told.current_A if step.told.output_on else 0.0
    measured_A = step.signals.current_A
    tolerance_A = config.safety.current_disagreement
    lasts_s = memory.lasts_s("supply_disagrees", not abs(measured_A - told_A) <= tolerance_A, step.now_s)
    if not lasts_s >= config.safety.disagreement_time:
        return ""
    return f"{measured_A:.3g} A flow, {told_A:.3g} A were commanded, for {lasts_s:.3g} s; safety.current_disagreement is {tolerance_A:g} A"


def estimator_outside(step: Step, memory: Memory, config: Config) -> str:
    """Too long without an estimate inside the calibration."""
    outside = step.settled and step.estimate.quality >= Quality.OUTSIDE_CALIBRATION
    lasts_s = memory.lasts_s("estimator_outside", outside, step.now_s)
    if not lasts_s >= config.safety.outside_calibration_time:
        return ""
    return (
        f"{step.estimate.quality.name.lower().replace('_', ' ')} for {lasts_s:.3g} s at {step.signals.stress_Pa / 1e6:.3g} MPa; "
        f"safety.outside_calibration_time is {config.safety.outside_calibration_time:g} s"
    )


def estimate_invalid(step: Step, memory: Memory, config: Config) -> str:
    """No estimate at all."""
    if not step.settled or (step.estimate.quality is not Quality.INVALID and isfinite(step.estimate.displacement_m)):
        return ""
    return "the estimate is not valid"


def loop_overrun(step: Step, memory: Memory, config: Config) -> str:
    """The computer does not keep up."""
    late = memory.running("loop_overrun", step.driven and not step.dt_s <= OVERRUN_PERIODS / config.loop.rate)
    if late < config.loop.overruns_to_fault:
        return ""
    return f"{late} steps running came later than {OVERRUN_PERIODS:g} periods after the one before (loop.overruns_to_fault)"


def setpoint_not_finite(position_m: float) -> str:
    """NaN or infinity on entry."""
    return "" if isfinite(position_m) else f"setpoint {position_m}: a finite position in metres is wanted"


def setpoint_stale(age_s: float, config: Config) -> str:
    """Nobody has said for too long where the wire should be."""
    timeout_s = config.controller.setpoint_timeout
    if timeout_s == 0.0 or -timeout_s <= age_s <= timeout_s:
        return ""
    return f"none for {age_s:.3g} s; controller.setpoint_timeout is {timeout_s:g} s"


class SetpointFlood:
    """A bucket of tokens, one per setpoint, that fills at ``safety.setpoint_flood_rate``."""

    def __init__(self) -> None:
        self._tokens = inf
        self._filled_s = nan

    def __call__(self, now_s: float, config: Config) -> str:
        """Take one setpoint's token; why there is none, or ""."""
        rate_Hz = config.safety.setpoint_flood_rate
        passed_s = now_s - self._filled_s
        if passed_s > 0.0:
            self._tokens += passed_s * rate_Hz
        self._tokens = min(self._tokens, max(FLOOD_BURST_MIN, FLOOD_BURST_S * rate_Hz))
        if isfinite(now_s):
            self._filled_s = now_s
        if self._tokens < 1.0:
            return f"setpoints come faster than safety.setpoint_flood_rate, {rate_Hz:g} Hz; this one is refused"
        self._tokens -= 1.0
        return ""


def command_invalid(wanted_A: float) -> str:
    """The last look at a command before it is a current."""
    return "" if 0.0 <= wanted_A < inf else f"{wanted_A} A; a finite current of at least zero is wanted"


Guard = Callable[[Step, Memory, "Config"], str]

GUARDS: dict[Fault, Guard] = {
    Fault[guard.__name__.upper()]: guard
    for guard in (
        clock_jump,
        supply_tripped,
        second_commander,
        supply_lost,
        daq_lost,
        reading_stale,
        reading_not_finite,
        reading_saturated,
        open_wire,
        short,
        reading_implausible,
        sensor_stuck,
        stress_above_limit,
        load_spike,
        too_hot,
        supply_disagrees,
        estimator_outside,
        estimate_invalid,
        loop_overrun,
    )
}


class Supervisor:
    """Watches one wire; latches faults; passes, lowers or cuts the command."""

    def __init__(self, config: Config):
        self.config = config
        self.latched: Fault | None = None
        self.detail = ""  #: of the latched fault
        self.present: dict[Fault, str] = {}  #: of the last step, also those that only prevent enabling
        self.temperature_C = config.thermal.ambient_temperature
        self._heat = HeatBalance(self.temperature_C)
        self._memory = Memory()
        self._enabled_s = nan
        self._good_readings = 0
        self._stress_cap_A = inf
        self.stress_floor_m = -inf  #: the shortest setpoint the stress allows

    def enabled(self, now_s: float) -> None:
        """The output is about to go on."""
        self._enabled_s = now_s
        self._good_readings = 0
        self._stress_cap_A, self.stress_floor_m = inf, -inf

    def settled(self, now_s: float) -> bool:
        """Whether current and readings belong together since the output went on."""
        return now_s - self._enabled_s >= SETTLING_TIME_S and self._good_readings >= SETTLING_READINGS

    def latch(self, fault: Fault, detail: str) -> None:
        """Latch a fault; the first one stays, since it is the cause."""
        if self.latched is None:
            self.latched, self.detail = fault, detail

    def usable(self, reading: Reading | None, last_time_s: float, now_s: float) -> Reading | None:
        """The reading where it is new, of about now, and finite inside the converter's range; else None."""
        if reading is None or not reading.time_s > last_time_s:
            return None
        if not abs(now_s - reading.time_s) <= self.config.safety.reading_timeout:
            return None
        bound_V = self.config.safety.channel_max_voltage
        return reading if all(-bound_V < value < bound_V for value in _voltages(reading).values()) else None

    def heat(self, power_W: float, dt_s: float, ambient_C: float) -> None:
        """Keep the heat balance, on measured power [W]; ambient from the parameters where it is not measured."""
        if not AMBIENT_RANGE_C[0] <= ambient_C <= AMBIENT_RANGE_C[1]:
            ambient_C = self.config.thermal.ambient_temperature
        self.temperature_C = self._heat.step(power_W, dt_s, ambient_C, self.config.thermal)

    def inspect(self, step: Step) -> dict[Fault, str]:
        """The faults of this step and why; those that latch are latched.

        While the output is off, most only prevent it from going on (``present``).
        """
        if step.reading is not None and step.driven:
            self._good_readings += 1
        self.present = {}
        for fault, guard in GUARDS.items():
            detail = guard(step, self._memory, self.config)
            if detail:
                self.present[fault] = detail
        if not self.present:
            return {}
        found = {f: d for f, d in self.present.items() if step.driven or FAULTS[f].while_off or not FAULTS[f].latches}
        for fault in sorted(found, key=_ORDER.__getitem__):
            if FAULTS[fault].latches:
                self.latch(fault, found[fault])
        return found

    def watch_stress(self, stress_Pa: float, position_m: float, told_A: float) -> None:
        """Near the bound of stress: from here on no more current, and no shorter setpoint, than now.

        Both are needed: the wire also contracts while the current stays what it is.
        """
        if stress_Pa <= self.config.safety.stress_limit_fraction * self.config.wire.max_stress:
            self._stress_cap_A, self.stress_floor_m = inf, -inf
            return
        if self._stress_cap_A == inf:
            self.stress_floor_m = position_m
        self._stress_cap_A = max(min(self._stress_cap_A, told_A), self.config.supply.bias_current)

    def limit_A(self) -> float:
        """Highest current that temperature and stress leave [A], from the bias to ``supply.max_current``."""
        return min(self._derated_A(), self._stress_cap_A)

    def _derated_A(self) -> float:
        supply = self.config.supply
        return derated_limit_A(self.temperature_C, supply.max_current, supply.bias_current, self.config.thermal)

    def gate(self, wanted_A: float, driven: bool, faults: dict[Fault, str]) -> tuple[Command, set[Limit]]:
        """The command that goes to the supply, and the limits that bent it."""
        limits: set[Limit] = set()
        if not driven or self.latched is not None:
            return _OFF, limits
        invalid = command_invalid(wanted_A)
        if invalid:
            self.latch(Fault.COMMAND_INVALID, invalid)
            return _OFF, limits
        max_A, limit_A = self.config.supply.max_current, self.limit_A()
        if any(FAULTS[fault].action is Action.BIAS for fault in faults):
            limit_A = min(limit_A, self.config.supply.bias_current)
        if self._derated_A() < max_A:
            limits.add(Limit.TEMPERATURE_DERATING)
        if self._stress_cap_A < inf:
            limits.add(Limit.STRESS_NEAR_LIMIT)
        current_A = min(wanted_A, limit_A, max_A)
        return (Command(current_A, True) if 0.0 <= current_A <= max_A else _OFF), limits
