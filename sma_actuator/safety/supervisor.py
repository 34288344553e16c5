"""The last word before the supply: what is wrong, and what current is still allowed.

The supervisor may only lower or cut a command.  The guards look at each step, each for its fault;
what follows from a fault stands beside its guard.
"""

from __future__ import annotations

from collections.abc import Collection
from math import inf, nan, sqrt

from sma_actuator.base.balance import held_rise_K
from sma_actuator.base.signals import OFF, Command, Reading, SupplyState

from .faults import FAULTS
from .guards.program import command_invalid
from .guards.readings import are_inside
from .limits import ANSWER_LATE, STRESS_NEAR_LIMIT, TEMPERATURE_DERATING
from .parameters import SafetySections
from .records import Action, Fault, Guard, Limit, Memory, Step
from .thermal import WireHeat, derated_limit_A
from .timing import SETTLING_READINGS, COMES_ON_s, SETTLING_TIME_s
from .transformed import Transforms, most_contracted_Ohm


def unwatched_s(config: SafetySections) -> float:
    """How long what flows may flow on before anybody looks; without a watchdog that is while the computer lives."""
    return max(config.supply.watchdog_timeout, config.safety.reading_timeout) + 1.0 / config.loop.rate


def may_flow_W(heat: WireHeat, config: SafetySections, until_s: float) -> tuple[float, float]:
    """Power that may flow on for ``until_s`` by thermal.heat_loss_margin, and where no watchdog cuts it for ever by
    thermal.unwatched_margin."""
    for_ever_W = inf if config.supply.watchdog_timeout > 0.0 else heat.power_for_ever_W(config.thermal)
    return heat.power_limit_W(until_s, config.thermal), for_ever_W


class Supervisor:
    """Watches one wire; latches faults; passes, lowers or cuts the command."""

    def __init__(self, config: SafetySections):
        self.heat = WireHeat(config.thermal)
        self._resistance_Ohm = inf  #: of wire and leads, as measured; so much until it is
        self.update(config)
        self.latched: Fault | None = None
        self.detail = ""  #: of the latched fault
        self.present: dict[Fault, str] = {}  #: of the last step, also those that only prevent enabling
        self.memory = Memory()  #: of the guards
        #: Those that look at every step, the gravest first.
        self._guards = [one for one in FAULTS.values() if isinstance(one, Guard) and one.each_step]
        self._looks = [one.look for one in self._guards]
        self.enabled(nan)  # never yet

    def update(self, config: SafetySections) -> None:
        """Take over live parameters; the memory stays."""
        self.config = config
        self._contracted_Ohm, self._just_contracted_Ohm = (
            most_contracted_Ohm(config.calibration.hot_end, each_C)
            for each_C in (config.thermal.max_temperature, config.thermal.transformed_temperature)
        )
        self.heat.transforms = Transforms(config.calibration, config.thermal)
        self._unwatched_s = unwatched_s(config)
        self._heat_leaves_A = self._derated_A()

    def enabled(self, now_s: float) -> None:
        """The output is about to go on."""
        self._enabled_s = self._settles_s = now_s
        self._came_on = False
        self._good_readings = 0
        self._free_of_stress()

    def _free_of_stress(self) -> None:
        self._stress_cap_A = inf
        self.stress_floor_m = -inf  #: the shortest setpoint the stress allows

    def standing(self, told: Command, now_s: float, supply: SupplyState | None) -> Command:
        """Of what the supply was told, what stands: off where an output that was told to be on reads back as off yet,
        and may; settling begins when it does not any more."""
        if supply is None or self._came_on or not told.output_on:
            return told
        self._came_on = supply.output_on or not now_s - self._enabled_s < COMES_ON_s
        if self._came_on:
            return told
        self._settles_s, self._good_readings = now_s, 0
        return OFF

    def settled(self, now_s: float) -> bool:
        """Whether current and readings belong together since the output went on."""
        return now_s - self._settles_s >= SETTLING_TIME_s and self._good_readings >= SETTLING_READINGS

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
        return reading if are_inside(reading, self.config.safety.channel_max_voltage) else None

    def keep_heat(
        self,
        power_W: float,
        current_A: float,
        dt_s: float,
        ambient_C: float,
        resistance_Ohm: float = nan,
        load_N: float = nan,
    ) -> None:
        """Keep the heat balance, on the power [W] and current [A] measured in wire and leads.

        ``resistance_Ohm`` of the wire alone and its load, NaN where none was measured in this step.
        """
        if power_W > 0.0 and current_A > 0.0:
            self._resistance_Ohm = power_W / current_A**2
        thermal, wire_W = self.config.thermal, current_A**2 * resistance_Ohm
        self.heat.step(
            power_W,
            dt_s,
            ambient_C,
            thermal,
            resistance_Ohm,
            load_N,
            self._contracted_Ohm,
            self._just_contracted_Ohm,
            wire_W,
            load_N / self.config.wire.area_m2,
        )
        self._heat_leaves_A = self._derated_A()

    def let_cool(self) -> None:
        """Try a wire anew from colder that the heat limit holds back."""
        if self._heat_leaves_A < self.config.supply.max_current:
            self.heat.let_cool()

    def inspect(self, step: Step, but: Collection[str] = ()) -> dict[Fault, str]:
        """The faults of this step and why, but for those of these names; those that latch are latched.

        While the output is off, most only prevent it from going on (``present``).
        """
        if step.reading is not None and step.driven:
            self._good_readings += 1
        if but:
            self.present = {one: why for one in self._guards if one.name not in but and (why := one.look(step))}
        else:
            details = [look(step) for look in self._looks]
            if not any(details):  # as in almost every step
                self.present = {}
                return {}
            self.present = {one: why for one, why in zip(self._guards, details, strict=True) if why}
        found = {f: d for f, d in self.present.items() if step.driven or f.while_off or not f.latches}
        for fault, detail in found.items():  # in the order of FAULTS: the gravest first
            if fault.latches:
                self.latch(fault, detail)
        return found

    def let_go(self, now_s: float, reading: Reading | None, supply: SupplyState | None) -> str:
        """End the latch of an instrument that was away, once both have answered for a while and nothing else is wrong;
        the fault's name then, else "".  The output stays off."""
        latched = self.latched
        well = reading is not None and supply is not None and not supply.output_on
        back = well and not any(fault.prevents_enabling for fault in self.present)
        if self.memory.lasts_s("instruments are back", back, now_s) < self.config.safety.reading_timeout:
            return ""
        if latched is None or not latched.until_back:
            return ""
        self.latched, self.detail = None, ""
        return latched.name

    def watch_stress(self, stress_Pa: float, position_m: float, told_A: float) -> None:
        """Near the bound of stress: from here on no more current, and no shorter setpoint, than now.

        Both are needed: the wire also contracts while the current stays what it is.
        """
        if stress_Pa <= self.config.safety.stress_limit_fraction * self.config.wire.max_stress:
            self._free_of_stress()
            return
        if self._stress_cap_A == inf:
            self.stress_floor_m = position_m
        self._stress_cap_A = max(min(self._stress_cap_A, told_A), self.config.supply.bias_current)

    def limit_A(self) -> float:
        """Highest current that temperature and stress leave [A], from the bias to ``supply.max_current``."""
        return min(self._heat_leaves_A, self._stress_cap_A)

    def most_rise_K(self) -> float:
        """How far above its surroundings the wire can be held for long, by the parameters' heat balance [K]."""
        supply, thermal = self.config.supply, self.config.thermal
        held_K = held_rise_K(supply.max_current, self._resistance_Ohm, thermal.heat_loss)
        if supply.watchdog_timeout > 0.0:
            return held_K
        return min(held_K, self.heat.power_for_ever_W(thermal) / thermal.heat_loss) if not self.heat.cools else held_K

    def _derated_A(self) -> float:
        """Highest current that the heat leaves [A]: what may flow on, if nobody looks any more, until the supply's
        watchdog cuts it; where there is none also for ever."""
        supply, thermal = self.config.supply, self.config.thermal
        power_W = min(may_flow_W(self.heat, self.config, self._unwatched_s))
        heat_A = sqrt(max(power_W, 0.0) / self._resistance_Ohm)
        derated_A = derated_limit_A(self.heat.temperature_C, supply.max_current, supply.bias_current, thermal)
        return max(supply.bias_current, min(heat_A, derated_A))  # in an order that leaves the bias where heat_A is NaN

    def gate(
        self, wanted_A: float, driven: bool, faults: dict[Fault, str], late: bool = False
    ) -> tuple[Command, set[Limit]]:
        """The command that goes to the supply, and the limits that bent it; ``late``: an instrument owes an answer."""
        limits: set[Limit] = set()
        if not driven or self.latched is not None:
            return OFF, limits
        invalid = command_invalid.look(wanted_A)
        if invalid:
            self.latch(command_invalid, invalid)
            return OFF, limits
        max_A, derated_A = self.config.supply.max_current, self._heat_leaves_A
        limit_A = min(derated_A, self._stress_cap_A)
        if late:
            limits.add(ANSWER_LATE)
        if late or (faults and any(fault.action is Action.BIAS for fault in faults)):
            limit_A = min(limit_A, self.config.supply.bias_current)
        if wanted_A >= derated_A < max_A:
            limits.add(TEMPERATURE_DERATING)
        if self._stress_cap_A < inf:
            limits.add(STRESS_NEAR_LIMIT)
        current_A = min(wanted_A, limit_A, max_A)
        return (Command(current_A, True) if 0.0 <= current_A <= max_A else OFF), limits
