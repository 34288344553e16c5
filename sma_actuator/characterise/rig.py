"""A supply, a DAQ and a clock, driven through programs; every way out ends with the current off."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from sma_actuator.base.interrupts import noted_signals
from sma_actuator.estimation.circuit import signals_from_reading
from sma_actuator.instruments import Clock, Daq, InstrumentRefused, PowerSupply
from sma_actuator.logs.bench_log import BenchLog

from .programs import Program

_CHANNELS = (
    "supply_voltage_V",
    "reference_voltage_V",
    "load_cell_voltage_V",
    "lvdt_current_A",
    "ambient_temperature_C",
)


class Rig:
    """Instruments in use.  ``config`` is a Config or what ``bench_from_mapping`` gives; it may be
    replaced when a calibration has been measured."""

    def __init__(self, config, supply: PowerSupply, daq: Daq, clock: Clock):
        self.config = config
        self.supply, self.daq, self.clock = supply, daq, clock

    @contextlib.contextmanager
    def opened(self) -> Iterator[Rig]:
        """Connect; on every way out, SIGTERM included, current to zero and output off.

        While nothing is driven a signal ends what is under way at once, since a person may be asked something.
        """
        with _terminate_as_interrupt():
            try:
                self.supply.open()
                self.daq.open()
                yield self
            finally:
                with noted_signals():  # a second Ctrl-C must not get between
                    self.supply.shut_down()
                    self.supply.close()
                    self.daq.close()

    @contextlib.contextmanager
    def _output(self) -> Iterator[None]:
        try:
            tripped = self.supply.read_back().tripped
            if tripped == "WDOG":  # nobody spoke to it while the person was hanging a mass
                self.supply.clear_trip()
            elif tripped:
                raise InstrumentRefused(
                    f"the supply's protection has tripped ({tripped}); find out why before going on"
                )
            self.supply.set_current(self.config.supply.bias_current)
            self.supply.set_output(True)
            yield
        finally:
            self.supply.shut_down()

    def record(self, program: Program, progress: Callable[[float], None] = lambda elapsed_s: None) -> BenchLog:
        """Run a program with the output on; return everything that was read.

        While the output is on signals are noted, and end it after the row at hand with KeyboardInterrupt.
        Raises InstrumentRefused where the stress exceeds ``wire.max_stress`` or the supply has
        tripped, and whatever the instruments raise; the output is off by then.
        """
        config, clock = self.config, self.clock
        period_s = 1.0 / config.loop.rate
        rows: list[Any] = []
        drive = next(program)
        with noted_signals() as interrupts, self._output():
            start_s = deadline_s = clock.now_s()
            while True:
                interrupts.raise_noted()
                current_A = float(np.clip(drive.current_A, 0.0, config.supply.max_current))
                self.supply.set_current(current_A)
                deadline_s = max(deadline_s + period_s, clock.now_s())
                clock.sleep_until_s(deadline_s)
                reading = self.daq.read_block()
                signals = signals_from_reading(reading, config)
                self._check(signals, len(rows))
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

    def _check(self, signals, count: int) -> None:
        stress_Pa, limit_Pa = signals.stress_Pa, self.config.wire.max_stress
        if self.config.load_cell.calibrated and not stress_Pa <= limit_Pa:  # until then the bias current flows alone
            raise InstrumentRefused(
                f"the wire's stress reads {stress_Pa / 1e6:.0f} MPa, above wire.max_stress, {limit_Pa / 1e6:.0f} MPa; "
                "hang less, or check load_cell.slope and load_cell.offset"
            )
        if count % 20 == 10:
            state = self.supply.read_back()
            if state.tripped or not state.output_on:
                raise InstrumentRefused(
                    f"the supply's output is off ({state.tripped or 'switched by someone else'}); "
                    "find out why before going on: the part is repeated when resumed"
                )


@contextlib.contextmanager
def _terminate_as_interrupt() -> Iterator[None]:
    """Let SIGTERM, SIGQUIT and SIGHUP unwind the stack as Ctrl-C does, so that the output is switched off."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(*_):
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGTERM, signal.SIGQUIT, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
