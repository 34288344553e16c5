"""The bench's instruments without sockets, in virtual time: for tests, fitting and characterisation."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan

import numpy as np

from sma_actuator.base.signals import Reading, SupplyState
from sma_actuator.config import BenchConfig
from sma_actuator.instruments import (
    InstrumentLate,
    InstrumentLost,
    InstrumentRefused,
    InstrumentUnreachable,
    LimitsNotHeld,
    OutputStaysOn,
    WatchdogNotHeld,
)

from .bench import VirtualBench
from .chain import CHANNELS
from .supply import SettingRefused


class VirtualClock:
    """Time of the bench; sleeping lets the physics run."""

    def __init__(self, bench: VirtualBench):
        self._bench = bench

    def now_s(self) -> float:
        """Bench time [s]."""
        return self._bench.time_s

    def sleep_until_s(self, deadline_s: float) -> None:
        """Advance the bench to ``deadline_s``."""
        self._bench.advance(deadline_s)


class _InProcess:
    """What both instruments have in common: they may stay silent, hang up or be slow."""

    name = ""

    def __init__(self, bench: VirtualBench, config: BenchConfig):
        self._bench = bench
        self._config = config
        self._open = False
        self._owed: tuple[float, float] | None = (
            None  #: when the last question was asked that has no answer, when it has
        )
        self.identity = ""
        self.patience_s = 0.0

    def _reach(self, timeout_s: float) -> None:
        """Spend the time a query takes; raise InstrumentLost or InstrumentLate where a real one would."""
        bench = self._bench
        if not bench.faults and self._owed is None:
            return  # it answers at once
        if f"{self.name}_hangup" in bench.faults:
            self._open, self._owed = False, None
            raise InstrumentUnreachable(f"virtual {self.name}: the connection was closed")
        by_s = bench.time_s + timeout_s
        if self._owed is not None:  # answers come in the order of their questions
            self._await(*self._owed, by_s, timeout_s)
        answer_s = (
            inf if f"{self.name}_silent" in bench.faults else bench.time_s + bench.faults.get("slow_answers", 0.0)
        )
        self._await(bench.time_s, answer_s, by_s, timeout_s)

    def _await(self, asked_s: float, answer_s: float, by_s: float, timeout_s: float) -> None:
        """An answer that comes at ``answer_s`` to a question of ``asked_s``."""
        bench, lost_s = self._bench, asked_s + self.patience_s
        self._owed = None
        if answer_s <= by_s:
            bench.advance(max(answer_s, bench.time_s))
            return
        why = f"virtual {self.name}: no answer within {timeout_s:g} s"
        bench.advance(min(by_s, max(lost_s, bench.time_s)) if self.patience_s else by_s)
        if bench.time_s >= lost_s - 1e-9:
            raise InstrumentLost(why)
        self._owed = (asked_s, answer_s)
        raise InstrumentLate(why, asked_s)

    def _must_be_open(self) -> None:
        if not self._open:
            raise InstrumentLost(f"virtual {self.name}: not open")

    def close(self) -> None:
        """Give up the connection."""
        self._open, self._owed = False, None


class InProcessSupply(_InProcess):
    """The bench's supply behind the interface :class:`~sma_actuator.instruments.PowerSupply`."""

    name = "supply"
    reads_back = frozenset({"voltage_setting", "over_current_trip", "watchdog_trip"})

    def open(self) -> None:
        """Output off, limits and protections programmed and read back, watchdog armed.

        Raises InstrumentLost or InstrumentRefused.
        """
        self._owed = None
        self._reach(self._timeout_s)
        self._open = True
        self.identity = "SMA Actuator,Virtual Supply,0,in process"
        limits, supply = self._config.supply, self._bench.supply
        self._command(supply.set_output, False)
        self._command(supply.clear_trips)
        self._command(supply.set_current, 0.0)
        self._command(supply.set_voltage, limits.max_voltage)
        self._command(supply.set_ovp, limits.over_voltage_V)
        self._command(supply.set_ocp, limits.over_current_trip)
        supply.ovp_on = supply.ocp_on = True
        if limits.watchdog_timeout > 0.0:
            self._command(supply.set_watchdog_delay, limits.watchdog_timeout)
            supply.watchdog_on = True
            self.check_settings()
        else:
            supply.watchdog_on = False

    def set_current(self, current_A: float) -> None:
        """Program the current limit [A]."""
        self._command(self._bench.supply.set_current, current_A)

    def set_output(self, on: bool) -> None:
        """Switch the output."""
        self._command(self._bench.supply.set_output, on)

    def read_back(self) -> SupplyState:
        """Settings and measurements."""
        self._command()
        bench, supply = self._bench, self._bench.supply
        return SupplyState(
            time_s=bench.time_s,
            current_setting_A=supply.current_A,
            output_on=supply.output_on,
            voltage_V=bench.voltage_V,
            current_A=bench.current_A,
            tripped=",".join(supply.trips),
        )

    def check_settings(self) -> None:
        """Whether limits and watchdog read back as they were programmed; raises LimitsNotHeld or WatchdogNotHeld."""
        self._command()
        limits, supply = self._config.supply, self._bench.supply
        if (supply.voltage_V, supply.ocp_A) != (limits.max_voltage, limits.over_current_trip):
            self.switch_off()
            raise LimitsNotHeld(
                f"virtual supply: does not hold its limits: it reads back {supply.voltage_V:g} V, {supply.ocp_A:g} A"
            )
        if not (supply.ovp_on and supply.ocp_on):
            self.switch_off()
            raise LimitsNotHeld("virtual supply: does not hold its limits: a protection is switched off")
        if limits.watchdog_timeout > 0.0 and not (
            supply.watchdog_on and self._bench.faults.get("watchdog_dead") != 0.0
        ):
            self.switch_off()
            raise WatchdogNotHeld("virtual supply: its watchdog was armed and does not read back so")

    def check_next_setting(self) -> None:
        """All of them: here they cost nothing."""
        self.check_settings()

    def clear_trip(self) -> None:
        """Clear a tripped protection; the output stays off."""
        self._command(self._bench.supply.clear_trips)

    def switch_off(self) -> None:
        """Output off and 0 A, read back.  Raises InstrumentLost, or OutputStaysOn."""
        self._command(self._bench.supply.set_output, False)
        self._command(self._bench.supply.set_current, 0.0)
        if self._bench.supply.output_on:
            raise OutputStaysOn("virtual supply")

    def shut_down(self) -> bool:
        """Current to zero and output off; whether it read back as off.  Never raises."""
        supply = self._bench.supply
        try:
            self._reach(self._timeout_s)
        except InstrumentLost:
            return False
        supply.set_current(0.0)
        supply.set_output(False)
        return not supply.output_on

    @property
    def _timeout_s(self) -> float:
        return self._config.instruments.supply.timeout

    def _command(self, setter: Callable[..., None] | None = None, *values: float) -> None:
        self._must_be_open()
        self._reach(self._timeout_s)
        self._bench.supply.heard(self._bench.time_s)
        if setter is None:
            return
        try:
            setter(*values)
        except SettingRefused as error:
            raise InstrumentRefused(f"virtual supply: {error} ({error.code})") from error


class InProcessDaq(_InProcess):
    """The bench's DAQ behind the interface :class:`~sma_actuator.instruments.Daq`."""

    name = "daq"

    def open(self) -> None:
        """Check the channel list.  Raises InstrumentLost or InstrumentRefused."""
        self._owed = None
        self._reach(self._config.instruments.daq.timeout)
        daq = self._config.instruments.daq
        wanted = (daq.supply_voltage_channel, daq.reference_voltage_channel, daq.load_cell_channel)
        optional = tuple(c for c in (daq.lvdt_channel, daq.ambient_temperature_channel) if c)
        for channel in wanted + optional:
            if channel not in CHANNELS:
                raise InstrumentRefused(f"virtual daq: has no channel {channel}; {CHANNELS[0]} to {CHANNELS[-1]} exist")
        self._open = True
        self.identity = "SMA Actuator,Virtual DAQ,0,in process"

    def read_block(self) -> Reading:
        """The average of the newest block; waits for the first one to fill."""
        self._must_be_open()
        daq, n, bench = self._config.instruments.daq, self._config.loop.samples_per_block, self._bench
        self._reach(daq.timeout)
        if bench.samples < n:
            bench.advance(n * 1e-3)
        samples, times_s = bench.daq.block(n)
        mean = np.add.reduce(samples) / n

        def channel(number: int) -> float:
            return float(mean[CHANNELS.index(number)]) if number else nan

        return Reading(
            time_s=float(times_s[-1]),
            supply_voltage_V=channel(daq.supply_voltage_channel),
            reference_voltage_V=channel(daq.reference_voltage_channel),
            load_cell_voltage_V=channel(daq.load_cell_channel),
            lvdt_current_A=channel(daq.lvdt_channel) / daq.lvdt_shunt_resistance,
            ambient_temperature_C=channel(daq.ambient_temperature_channel),
        )
