"""What the parts of the self-test share: the instruments, what is asked of them, and what is said."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterator
from typing import NoReturn

import numpy as np

from sma_actuator.base.sections import Wire
from sma_actuator.base.signals import Reading, SupplyState
from sma_actuator.config import BenchConfig
from sma_actuator.instruments import Clock, Daq, InstrumentError, PowerSupply

from .found import Found, Level
from .pace import Pace

BLOCKS = 20  #: read for each mean
STEPS = 10  #: of the loop, of which the median says what the instruments take
#: Resistivity that a wire of each alloy may have, cold or hot [Ω·m].
RESISTIVITY_Ohm_m = {"ni-ti": (0.65e-6, 1.15e-6), "ni-ti-cu": (0.45e-6, 1.15e-6)}
_ROUNDING_s = 1e-3  #: a clock that goes by steps may stand half of one before what was waited for
#: Channels, as a person calls them.
WORDS = {
    "time_s": "time",
    "supply_voltage_V": "supply voltage",
    "reference_voltage_V": "sense resistor",
    "load_cell_voltage_V": "load cell",
}


class Ends(Exception):
    """Later parts make no sense."""


class Probe:
    """Instruments that are not connected yet, of a wire with a model or without."""

    def __init__(self, config: BenchConfig, supply: PowerSupply, daq: Daq, clock: Clock):
        self.config, self.supply, self.daq, self.clock = config, supply, daq, clock
        self.other_daq: Callable[[BenchConfig], Daq] | None = None  #: the DAQ for other blocks; None: it stays
        self.aborted = threading.Event()
        self.interrupted: Callable[[], bool] = lambda: False
        self.opened = False  #: the supply was, so that what flows is ours
        self.feeding = False  #: the watchdog of the supply
        self.found: list[Found] = []
        self.identity = ""
        self.cold_Ohm = math.nan  #: what the calibration has at this load
        self.resistance_Ohm = math.nan  #: at the bias current

    def say(self, part: str, sentence: str, level: Level = Level.OK) -> None:
        """Say what a part has found."""
        self.found.append(Found(part, level, sentence))

    def wrong(self, part: str, sentence: str) -> None:
        """Say that something is wrong; the next part is done all the same."""
        self.say(part, sentence, Level.WRONG)

    def end(self, part: str, sentence: str) -> NoReturn:
        """Say what makes later parts pointless, and end the test there."""
        self.wrong(part, sentence)
        raise Ends

    def wait(self, seconds: float) -> None:
        """Wait, feeding the watchdog where current flows."""
        until_s = self.clock.now_s() + seconds
        while (now_s := self.clock.now_s()) < until_s - _ROUNDING_s:
            self.clock.sleep_until_s(min(until_s, now_s + 1.0 / self.config.loop.rate))
            self.look_up()

    def look_up(self) -> None:
        """Feed the watchdog, and see whether it is to end before its time."""
        if self.feeding:
            self.flows()
        if self.aborted.is_set() or self.interrupted():
            self.end("abort", "ended before its time: asked to")

    def flows(self) -> SupplyState:
        """What the supply reads back while current flows, which feeds its watchdog."""
        state = self.supply.read_back()
        if "WDOG" in state.tripped:
            self.end(
                "watchdog",
                "the supply's watchdog cut meanwhile: this computer stood still for longer than "
                f"supply.watchdog_timeout, {self.config.supply.watchdog_timeout:g} s; look again "
                "when it has less to do",
            )
        if state.tripped:
            self.end("bias", f"the supply's protection tripped at the bias current ({state.tripped})")
        return state

    @contextlib.contextmanager
    def other_currents(self) -> Iterator[None]:
        """Where others than the bias are told: the bias again at its end, which hides nothing that went wrong before.

        A supply that is lost meanwhile cannot be told; what it says then, "not connected", is no reason.
        """
        bias_A = self.config.supply.bias_current
        try:
            yield
        except BaseException:
            with contextlib.suppress(InstrumentError):
                self.supply.set_current(bias_A)
            raise
        self.supply.set_current(bias_A)

    def _blocks(self) -> Iterator[Reading]:
        """Readings at the loop's rate."""
        period_s, deadline_s = 1.0 / self.config.loop.rate, self.clock.now_s()
        for _ in range(BLOCKS):
            self.look_up()
            deadline_s = max(deadline_s + period_s, self.clock.now_s())
            self.clock.sleep_until_s(deadline_s)
            yield self.daq.read_block()

    def read(self) -> dict[str, np.ndarray]:
        """Every channel of BLOCKS readings, and their times."""
        rows = list(self._blocks())
        names = ("time_s", "supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V")
        return {name: np.array([getattr(row, name) for row in rows]) for name in names}

    def pace(self) -> Pace:
        """What a step of the loop takes both instruments."""
        clock, times_s = self.clock, []
        for _ in range(STEPS):
            self.look_up()
            began_s = clock.now_s()
            self.daq.read_block()
            read_s = clock.now_s()
            self.supply.read_back()
            back_s = clock.now_s()
            self.supply.check_next_setting()
            times_s.append((back_s - read_s, read_s - began_s, clock.now_s() - back_s))
        return Pace.of(times_s, self.config)

    def expected_Ohm(self, other: Wire | None = None) -> tuple[float, float]:
        """The least and the most that a wire of this size and alloy has, hot and contracted, cold and extended: then it
        is longer and thinner."""
        wire = other or self.config.wire
        low, high = RESISTIVITY_Ohm_m[wire.alloy]
        return wire.resistance_Ohm(low), (1.0 + 2.0 * wire.full_stroke_strain) * wire.resistance_Ohm(high)
