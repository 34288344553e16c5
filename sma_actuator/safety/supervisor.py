"""The last word before the supply: what is wrong, and what current is still allowed.

The supervisor may only lower or cut a command.  The guards look at each step, each for its fault;
what follows from a fault stands beside its guard.
"""

from __future__ import annotations

from math import inf, nan
from typing import TYPE_CHECKING

from sma_actuator.base.signals import Command, Reading

from .faults import FAULTS
from .guards.program import command_invalid
from .guards.readings import voltages
from .limits import STRESS_NEAR_LIMIT, TEMPERATURE_DERATING
from .records import Action, Fault, Guard, Limit, Memory, Step
from .thermal import HeatBalance, derated_limit_A
from .timing import SETTLING_READINGS, SETTLING_TIME_S

if TYPE_CHECKING:
    from sma_actuator.config import Config


#: Surroundings a wire can be driven in [°C]; a sensor that says otherwise is not believed.
AMBIENT_RANGE_C = (-60.0, 100.0)
_OFF = Command(0.0, False)


class Supervisor:
    """Watches one wire; latches faults; passes, lowers or cuts the command."""

    def __init__(self, config: Config):
        self.config = config
        self.latched: Fault | None = None
        self.detail = ""  #: of the latched fault
        self.present: dict[Fault, str] = {}  #: of the last step, also those that only prevent enabling
        self.temperature_C = config.thermal.ambient_temperature
        self._heat = HeatBalance(self.temperature_C)
        self.memory = Memory()  #: of the guards
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
        return reading if all(-bound_V < value < bound_V for value in voltages(reading).values()) else None

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
        for fault in FAULTS.values():
            if isinstance(fault, Guard) and fault.each_step and (detail := fault.look(step)):
                self.present[fault] = detail
        found = {f: d for f, d in self.present.items() if step.driven or f.while_off or not f.latches}
        for fault, detail in found.items():  # in the order of FAULTS: the gravest first
            if fault.latches:
                self.latch(fault, detail)
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
        invalid = command_invalid.look(wanted_A)
        if invalid:
            self.latch(command_invalid, invalid)
            return _OFF, limits
        max_A, limit_A = self.config.supply.max_current, self.limit_A()
        if any(fault.action is Action.BIAS for fault in faults):
            limit_A = min(limit_A, self.config.supply.bias_current)
        if self._derated_A() < max_A:
            limits.add(TEMPERATURE_DERATING)
        if self._stress_cap_A < inf:
            limits.add(STRESS_NEAR_LIMIT)
        current_A = min(wanted_A, limit_A, max_A)
        return (Command(current_A, True) if 0.0 <= current_A <= max_A else _OFF), limits
