"""A supply, a DAQ and a clock, driven through programs; every way out ends with the current off."""

from __future__ import annotations

import contextlib
import dataclasses
import signal
from collections.abc import Callable, Collection, Iterator
from math import inf, isfinite, nan
from typing import Any, TypeVar

import numpy as np

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.interrupts import Interrupts, ending_signals, noted_signals, raised_signals
from sma_actuator.base.signals import OFF, Branch, Command, Estimate, Quality, Reading, Signals, SupplyState
from sma_actuator.estimation.circuit import signals_from_reading
from sma_actuator.instruments import Clock, Daq, InstrumentLate, InstrumentLost, InstrumentRefused, PowerSupply
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.safety.faults import gravest
from sma_actuator.safety.guards.program import clock_jump, loop_overrun
from sma_actuator.safety.records import Memory, Step, made_ready
from sma_actuator.safety.supervisor import Supervisor

from .programs import Program

#: The wire stays below max_temperature even where it loses this many times less heat than thermal.heat_loss: that is a
#: guess at a new bench, wrong by two perhaps.  Not more, where thermal.heat_loss_margin says more: it hangs in the
#: open, and is looked at; and a wire that gets no warmer would not contract wholly, which is what is to be measured.
ATTENDED_MARGIN = 2.0
#: Share of the way from the surroundings to max_temperature below which a wire is cool.
COOL = 0.1
_LOOK_s = 0.1
T = TypeVar("T")
_CHANNELS = (
    "supply_voltage_V",
    "reference_voltage_V",
    "load_cell_voltage_V",
    "lvdt_current_A",
    "ambient_temperature_C",
)


class Stalled(InstrumentRefused):
    """This computer stood still while it should have looked, as a busy one does now and then."""


class Rig:
    """Instruments in use, under the guards of the driver.  ``config`` is a Config or what ``bench_from_mapping`` gives;
    it may be replaced when a calibration has been measured."""

    def __init__(self, config, supply: PowerSupply, daq: Daq, clock: Clock):
        self.supply, self.daq, self.clock = supply, daq, clock
        self._config = config
        self._watch = Watch(config, clock)

    @property
    def config(self):
        """The parameters as they are now."""
        return self._config

    @config.setter
    def config(self, config) -> None:
        self._config = config
        self._watch.update(config)

    @contextlib.contextmanager
    def knowing(self, calibration: Calibration) -> Iterator[None]:
        """Guards and limits that know the wire meanwhile, as those of the driver do."""
        self._watch.update(dataclasses.replace(self._config, calibration=calibration))
        try:
            yield
        finally:
            self._watch.update(self._config)

    @contextlib.contextmanager
    def opened(self) -> Iterator[Rig]:
        """Connect; on every way out, SIGTERM included, current to zero and output off.  Raises InstrumentLost where
        nothing else was wrong and that is not read back.

        While nothing is driven a signal ends what is under way at once, since a person may be asked something.
        """
        made_ready()
        with raised_signals(signal.SIGINT, *ending_signals()):  # Ctrl-C also where it was ignored: in the background
            self.supply.patience_s = self.daq.patience_s = self.config.safety.reading_timeout
            try:
                self.supply.open()
                self.daq.open()
                yield self
            finally:
                with noted_signals():  # a second Ctrl-C must not get between
                    off = self.supply.shut_down()
                    self.supply.close()
                    self.daq.close()
            if not off:
                raise InstrumentLost("the supply is told to be off, not confirmed: look at it, switch it off by hand")

    @contextlib.contextmanager
    def _output(self) -> Iterator[None]:
        try:
            tripped = self._answered(self.supply.read_back).tripped
            if tripped not in ("", "WDOG"):
                raise InstrumentRefused(
                    f"the supply's protection has tripped ({tripped}); find out why before going on"
                )
            if tripped or "watchdog_trip" not in self.supply.reads_back:
                self.supply.clear_trip()  # nobody spoke to it while the person was hanging a mass
            self.supply.set_current(self.config.supply.bias_current)
            self.supply.set_output(True)
            yield
        finally:
            self.supply.shut_down()

    def _next_s(self, deadline_s: float) -> float:
        """When the next row is read, after a current was told: at its deadline, or where that has passed a whole period
        later.

        A DAQ that takes one channel at a time and begins at once reads supply and sense resistor on both sides of a
        step of the current: a wire of 6 Ω was shorted, or had 14 Ω.
        """
        now_s = self.clock.now_s()
        return deadline_s if now_s <= deadline_s else now_s + 1.0 / self.config.loop.rate

    def _answered(self, question: Callable[[], T]) -> T:
        """Its answer, though late: it is waited for as long as a reading may be old.  Raises InstrumentLost after
        that, and whatever else the instrument raises."""
        until_s = self.clock.now_s() + self.config.safety.reading_timeout
        while True:
            try:
                return question()
            except InstrumentLate:
                if self.clock.now_s() >= until_s:
                    raise

    def record(
        self,
        program: Program,
        progress: Callable[[float], None] = lambda elapsed_s: None,
        but: Collection[str] = (),
    ) -> BenchLog:
        """Run a program with the output on; return everything that was read.

        The supervisor of the driver stands between: it lowers the current that is asked for where the wire would get
        too hot or the stress too high, and every guard but those named in ``but`` looks at every row.  While the output
        is on signals are noted, and end it after the row at hand with KeyboardInterrupt.  Raises InstrumentRefused
        where a guard finds something, and whatever the instruments raise; the output is off by then.
        """
        clock, watch = self.clock, self._watch
        period_s = 1.0 / self.config.loop.rate
        rows: list[Any] = []
        drive = next(program)
        with noted_signals() as interrupts:
            watch.let_cool(interrupts)
            with self._output():
                watch.begin()
                start_s = deadline_s = clock.now_s()
                while True:
                    interrupts.raise_noted()
                    if drive.held_back:
                        watch.try_anew()
                    current_A = watch.allowed_A(drive.current_A)
                    self.supply.set_current(current_A)
                    deadline_s = self._next_s(deadline_s + period_s)
                    clock.sleep_until_s(deadline_s)
                    reading = self._answered(self.daq.read_block)
                    signals = signals_from_reading(reading, self.config)
                    watch.look(reading, signals, self._answered(self.supply.read_back), but)
                    rows.append(
                        (reading.time_s, *(getattr(reading, name) for name in _CHANNELS), current_A, drive.setpoint_m)
                    )
                    progress(reading.time_s - start_s)
                    try:
                        drive = program.send(signals)
                    except StopIteration:
                        break
        names = ("time_s", *_CHANNELS, "current_command_A", "setpoint_m")
        columns = dict(zip(names, np.array(rows).T.copy(), strict=True))
        columns["time_s"] -= columns["time_s"][0]
        return BenchLog({n: v for n, v in columns.items() if not np.isnan(v).all()})


class Watch:
    """The driver's guards and limits over a wire that has no model yet: nothing is estimated, so nothing of an estimate
    can be wrong."""

    def __init__(self, config, clock: Clock):
        self._clock = clock
        self._supervisor = Supervisor(attended(config))
        self._seen_s = clock.now_s()
        self._told = OFF

    def update(self, config) -> None:
        """Go on with other parameters; what is known of the wire's heat stays."""
        self._supervisor.update(attended(config))

    def let_cool(self, interrupts: Interrupts) -> None:
        """Wait, with the output off, until a wire would be cool whatever it was: of one at the beginning nothing is
        known."""
        supervisor, heat = self._supervisor, self._supervisor.heat
        while True:
            now_s = self._clock.now_s()
            supervisor.keep_heat(0.0, 0.0, now_s - self._seen_s, nan)
            self._seen_s = now_s
            hottest_C, ambient_C = supervisor.config.thermal.max_temperature, heat.ambient.temperature_C
            if heat.at_most_C - ambient_C <= COOL * (hottest_C - ambient_C):
                return
            interrupts.raise_noted()
            self._clock.sleep_until_s(now_s + _LOOK_s)

    def try_anew(self) -> None:
        """Let a wire cool that the heat limit holds back: from there it contracts in one go."""
        self._supervisor.let_cool()

    def begin(self) -> None:
        """The output goes on, at the bias."""
        supervisor = self._supervisor
        supervisor.latched, supervisor.memory = None, Memory()
        supervisor.enabled(self._clock.now_s())
        self._seen_s = self._clock.now_s()
        self._told = Command(supervisor.config.supply.bias_current, True)

    def allowed_A(self, wanted_A: float) -> float:
        """The current [A] that may flow of what is wanted."""
        wanted_A = min(max(wanted_A, 0.0), self._supervisor.config.supply.max_current)
        self._told, _ = self._supervisor.gate(wanted_A, driven=True, faults={})
        return self._told.current_A

    def look(self, reading: Reading, signals: Signals, supply: SupplyState, but: Collection[str]) -> None:
        """Look at a row.  Raises InstrumentRefused where something is wrong with it."""
        supervisor, now_s = self._supervisor, self._clock.now_s()
        config, dt_s = supervisor.config, now_s - self._seen_s
        self._seen_s = now_s
        usable = supervisor.usable(reading, -inf, now_s)
        wire_V = max(reading.supply_voltage_V - reading.reference_voltage_V, 0.0)
        supervisor.keep_heat(
            signals.current_A * wire_V,
            signals.current_A,
            dt_s,
            reading.ambient_temperature_C,
            signals.resistance_Ohm if usable is not None else nan,
            signals.load_N,
        )
        told = supervisor.standing(self._told, now_s, supply)
        place_m = signals.reference_displacement_m
        estimate = Estimate(
            signals.time_s, place_m if isfinite(place_m) else 0.0, nan, 0.0, Branch.HEATING, Quality.DETERMINATE
        )
        found = supervisor.inspect(
            Step(
                config,
                supervisor.memory,
                now_s,
                dt_s,
                True,
                supervisor.settled(now_s),
                reading,
                usable,
                signals,
                estimate,
                supply,
                told,
                supervisor.heat,
            ),
            but,
        )
        supervisor.watch_stress(signals.stress_Pa, estimate.displacement_m, self._told.current_A)
        wrong = [fault for fault in found if fault.prevents_enabling]
        if wrong:
            fault = gravest(wrong)
            kind = Stalled if fault in (clock_jump, loop_overrun) else InstrumentRefused
            raise kind(f"{fault.words} ({found[fault]}). {fault.remedy}; the part is repeated when resumed")


def attended(config):
    """The parameters, with the margin of heat loss of a wire in the open that a person stays beside."""
    margin = min(config.thermal.heat_loss_margin, ATTENDED_MARGIN)
    return dataclasses.replace(config, thermal=dataclasses.replace(config.thermal, heat_loss_margin=margin))
