"""One step of the loop, in the control thread: instruments in, actuator, instruments out.  And what is done between two
steps."""

from __future__ import annotations

import collections
import math
import threading
from collections.abc import Callable
from typing import Any, Protocol

from sma_actuator.actuator import Actuator
from sma_actuator.base.signals import Output, Reading, SupplyState
from sma_actuator.config import Config
from sma_actuator.instruments import Clock, Daq, PowerSupply, highest_rate_Hz
from sma_actuator.safety.records import Waited

from .link import Link
from .output import SupplyOutput
from .requests import Requests
from .statistics import Deadlines, LoopStatistics
from .watchman import Watchman

#: Of the loop, of which the quickest says what the instruments need: a busy machine is no slow instrument.
_ASKED_STEPS = 5
#: Silence after a failed attempt to reach a supply that may be on, in multiples of its watchdog's delay: every word,
#: also a question, feeds a watchdog, and one that is fed never cuts.
_QUIET_WATCHDOGS = 1.25
#: The longest wait for a supply that may be on and hears nothing: one that restarts may switch its output on by itself.
_UNHEARD_WAIT_s = 0.5
CHECK_PERIOD_s = 0.5  #: how often one of the supply's settings is read back while driving
_ROUND_s = 3 * CHECK_PERIOD_s  #: from the first of them to the last: however long a step lasted, none is read twice


class Recording(Protocol):
    """What the loop needs of a recorder."""

    def record(self, reading: Reading | None, output: Output) -> None:
        """Take one step's row; never wait."""


class Loop:
    """Both instruments of a wire, its actuator, and what goes between them in a step.  The control thread's alone, but
    where something else is said."""

    def __init__(
        self,
        config: Config,
        supply: PowerSupply,
        daq: Daq,
        clock: Clock,
        actuator: Actuator,
        requests: Requests,
        put_out: Callable[[Output], None],
        recorder: Recording | None,
        feed_timeout_s: float,
        ending: threading.Event,
    ):
        instruments, longest_wait_s = config.instruments, config.instruments.reconnect_backoff_max
        self.supply = Link("supply", supply, instruments.supply.timeout, longest_wait_s, clock.now_s)
        self.daq = Link("daq", daq, instruments.daq.timeout, longest_wait_s, clock.now_s)
        self.links = (self.supply, self.daq)
        self.output = SupplyOutput(supply, config.safety, ending)
        self.deadlines = Deadlines(1.0 / config.loop.rate)
        self.watchman = Watchman(
            requests.name,
            self.output,
            self.supply,
            clock,
            self._waited_so_far,
            config.safety.reading_timeout,
            self.deadlines.period_s,
            put_out,
        )
        supply.patience_s = daq.patience_s = config.safety.reading_timeout
        self.fed_at_s = clock.now_s()  #: when the commander was last heard of
        self._config = config
        self._supply_instrument = supply
        self._daq_instrument = daq
        self._clock = clock
        self._actuator = actuator
        self._requests = requests
        self._put_out = put_out
        self._recorder = recorder
        self._feed_timeout_s = feed_timeout_s
        self._waited = Waited()  #: for the instruments, until the last step
        self._check_s = -math.inf  #: when the next setting of the supply is looked at
        self._asking_s: collections.deque[tuple[float, float]] = collections.deque(maxlen=_ASKED_STEPS)

    def open(self) -> None:
        """Connect both instruments; the output is off afterwards.  Raises InstrumentError."""
        for link in self.links:
            link.instrument.open()
            link.answers = True
            if link is self.supply:
                self.output.opened()

    def close(self) -> None:
        """Give both up."""
        for link in self.links:
            link.answers = False
            link.instrument.close()

    # --- the step ---------------------------------------------------------------------------------

    def step(self) -> Output:
        """Read, think, write."""
        self._requests.run_calls()
        self._reconnect()
        began_s, answered = self._clock.now_s(), self.daq.answers
        reading: Reading | None = self.daq.ask(self._daq_instrument.read_block)
        read_s = self._clock.now_s()
        state: SupplyState | None = None
        if self.daq.answers or not answered:  # else it has just been lost, and off waits for no other answer
            state = self.supply.ask(self._supply_instrument.read_back)
        now_s = self._clock.now_s()
        self._asking_s.append((read_s - began_s, now_s - read_s))
        if self.output.off_is_asked:  # the supply may have said what it is since then
            self._requests.run_calls()
            state = self.supply.ask(self._supply_instrument.read_back)
            now_s = self._clock.now_s()
        came_late = self._came_late(reading, read_s, state, now_s)
        so_far = self._waited_so_far()
        waited, self._waited = so_far.since(self._waited), so_far
        self.output.seen(state)
        self._check_a_setting(now_s)
        self._report_losses(now_s)
        if now_s - self.fed_at_s > self._feed_timeout_s:
            self._actuator.raise_fault(
                now_s, "node_lost", f"the node has not been heard of for {self._feed_timeout_s:g} s"
            )
        self._requests.take_offers(now_s)
        output = self._actuator.step(now_s, reading, state, waited, came_late)
        self.supply.ask(lambda: self.output.write(output.command, state))
        overtaken = self.output.was_cut  # what the watchman has put out is newer than this
        self._report_losses(now_s)
        output = self.watchman.last = self.output.with_truth(output)
        if self._recorder is not None:
            self._recorder.record(reading, output)
        if not (overtaken or self.output.was_cut):
            self._put_out(output)
        return output

    def _came_late(self, reading: Reading | None, read_s: float, state: SupplyState | None, now_s: float) -> bool:
        """Whether what has been answered, by then, is of longer ago than an answer may take."""
        instruments = self._config.instruments
        return (reading is not None and read_s - reading.time_s > instruments.daq.timeout) or (
            state is not None and now_s - state.time_s > instruments.supply.timeout
        )

    def _waited_so_far(self) -> Waited:
        return Waited(self.daq.waited_s(), self.supply.waited_s())

    def _check_a_setting(self, now_s: float) -> None:
        """While driving, look now and then whether limits and watchdog still stand, one of them at a time.

        By instants that the steps do not shift: counted from the last look, each would come up to a step later.
        """
        if not self.output.known.is_on:
            self._check_s = now_s
            return
        self._check_s = max(self._check_s, now_s - _ROUND_s)
        while self._check_s <= now_s and self.supply.answers and not self.supply.late:
            self._check_s += CHECK_PERIOD_s
            self.supply.ask(self._supply_instrument.check_next_setting)

    def _reconnect(self) -> None:
        if not self.daq.answers:
            self.daq.reconnect(quiet_s=0.0)
        if not self.supply.answers:
            self.output.lost()
            if self.output.known.may_flow:
                quiet_s = _QUIET_WATCHDOGS * self._config.supply.watchdog_timeout
                self.supply.reconnect(quiet_s, _UNHEARD_WAIT_s)
            else:
                self.supply.reconnect(quiet_s=0.0)

    def _report_losses(self, now_s: float) -> None:
        cut = self.output.take_cut()
        if cut is not None:  # what was cut for a hang is lost for it
            fault, why = cut
            self._actuator.raise_fault(now_s, fault.name, why)
        self.watchman.hung = ""
        if not self.supply.answers:
            self.output.lost()
        for link in self.links:
            if not link.answers:
                self._actuator.raise_fault(now_s, link.fault, link.detail)

    # --- between two steps ------------------------------------------------------------------------

    def enable(self, actuator: Actuator, now_s: float) -> tuple[bool, str]:
        """Switch the current on, with the next step, where every setting of the supply stands."""
        if not actuator.is_driven and (refusal := self._rate_refusal()):
            return False, f"not enabled: {refusal}"
        self._insist(self._supply_instrument.check_settings)
        self._report_losses(now_s)
        if self.supply.late:
            return False, f"not enabled: {self.supply.detail}"
        return actuator.enable(now_s, True)

    def disable(self, actuator: Actuator, now_s: float) -> tuple[bool, str]:
        """Switch it off, read back; else that is a fault."""
        done, words = actuator.enable(now_s, False)
        self._insist(self.output.switch_off)
        if not self.output.known.may_flow:
            actuator.switched_off()
            return done, words
        actuator.raise_fault(now_s, "output_not_confirmed", self.supply.detail)
        return False, f"{self.output.words}: {self.supply.detail}"

    def clear_fault(self, actuator: Actuator, now_s: float) -> tuple[bool, str]:
        """Clear a latched fault and the supply's own trips, with the output off, read back."""
        lost = self.lost_instruments
        if lost:
            return False, "; ".join(f"the {name} still does not answer: {detail}" for name, detail in lost.items())
        if not actuator.latched:
            return actuator.clear_fault(now_s)  # a wire that is driven goes on being driven
        self._insist(self._supply_instrument.clear_trip)
        self._insist(self.output.switch_off)
        if self.output.known.may_flow or not self.supply.answers:
            return False, f"not cleared: {self.output.words} ({self.supply.detail})"
        return actuator.clear_fault(now_s)

    def update(self, actuator: Actuator, config: Config) -> None:
        """Take over live parameters.  Raises ConfigError where others differ."""
        actuator.update(config)
        self._config = config
        self.output.safety = config.safety
        self.watchman.patience_s = config.safety.reading_timeout
        self._supply_instrument.patience_s = self._daq_instrument.patience_s = config.safety.reading_timeout

    def _insist(self, question: Callable[[], Any]) -> None:
        """Have the supply answer, though late."""
        self.supply.insist(question, self._config.safety.reading_timeout)

    def _rate_refusal(self) -> str:
        """Why the loop's rate cannot be met, by the quickest of the last steps; "" where it can."""
        if len(self._asking_s) < _ASKED_STEPS or not all(link.answers for link in self.links):
            return ""
        daq_s, supply_s = min(self._asking_s, key=sum)
        if daq_s + supply_s <= self.deadlines.period_s:
            return ""
        return (
            f"a step takes the instruments {daq_s + supply_s:.3g} s (supply {supply_s:.3g} s, DAQ {daq_s:.3g} s), so "
            f"loop.rate can be {highest_rate_Hz(daq_s + supply_s):.2g} Hz at the most; it is "
            f"{self._config.loop.rate:g} Hz"
        )

    # --- from any thread --------------------------------------------------------------------------

    @property
    def lost_instruments(self) -> dict[str, str]:
        """Instruments that do not answer, and why; also the control loop itself, where it hangs."""
        if self.supply.answers and self.daq.answers and not self.watchman.hung:
            return {}
        lost = {link.name: link.detail for link in self.links if not link.answers}
        if self.output.known.may_flow and "supply" in lost:
            lost["supply"] += f"; {self.output.words}"
        return {"control loop": self.watchman.hung, **lost} if self.watchman.hung else lost

    def statistics(self) -> LoopStatistics:
        """How the loop keeps its period, and its instruments their time."""
        now_s = self._clock.now_s()
        return self.deadlines.statistics(
            sum(link.late_answers for link in self.links), max(link.slowest.longest_s(now_s) for link in self.links)
        )
