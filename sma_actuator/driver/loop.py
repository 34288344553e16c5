"""The loop that drives one wire: instruments in, actuator, instruments out.  No ROS.

One control thread per wire runs on absolute deadlines of the monotonic clock; nothing else touches
the instruments or the actuator.  What other threads want is handed over: setpoints through a
bounded queue, everything else as a call that is executed between two steps.  Whatever ends the
loop (``stop``, an exception, the end of the interpreter), the supply is shut down: current zero and
output off.  A second thread, the watchman, does nothing but look whether the control thread still
shows life; where it does not, the watchman shuts the supply down beside it.

"Off" is what the supply reads back.  Until it does, the output counts as *told to be off, not
confirmed*, and everything here says so.

Tests and tools step the same loop by hand, in the virtual time of a bench in this process.
"""

from __future__ import annotations

import atexit
import collections
import concurrent.futures
import contextlib
import dataclasses
import logging
import math
import threading
import time
import weakref
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Protocol, Self

from sma_actuator.actuator import Actuator
from sma_actuator.base import realtime
from sma_actuator.base.jit import at_once
from sma_actuator.base.realtime import RealtimeRefused
from sma_actuator.base.signals import Command, Mode, Output, Reading, SupplyState
from sma_actuator.config import Config
from sma_actuator.instruments import (
    Clock,
    Daq,
    InstrumentError,
    PowerSupply,
    highest_rate_Hz,
)
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.guards.program import loop_hung
from sma_actuator.safety.records import Fault, Waited
from sma_actuator.safety.timing import SETTLING_TIME_s

from .link import Link
from .statistics import Deadlines, LoopStatistics

_log = logging.getLogger(__name__)

#: Changes of the commanded current smaller than this are not sent: the finest step of the supplies
#: in use is 0.02 mA (thesis, ch. 3), and each message costs time on the bus.
CURRENT_RESOLUTION_A = 5e-6
_CALL_s = 5.0  #: how long a call waits for its turn between two steps, unless told otherwise
_LONGEST_SLEEP_s = 0.05  #: so that a stop and a call do not wait for a slow loop's next deadline
_CONFIRM_PERIOD_s = 0.005  #: how often it is looked whether the supply has read back that it is on
_ASKED_STEPS = (
    5  #: of the loop, of which the quickest says what the instruments need: a busy machine is no slow instrument
)
_OFF_PATIENCE_s = 0.1  #: how long off waits for its turn between two steps, before it is said beside them
_JOIN_TIMEOUT_s = 0.3  #: what ``stop`` leaves a thread that waits for an instrument, of the second it has
_WATCH_PERIOD_s = 0.05  #: how often the watchman looks
#: Silence after a failed attempt to reach a supply that may be on, in multiples of its watchdog's delay: every word,
#: also a question, feeds a watchdog, and one that is fed never cuts.
_QUIET_WATCHDOGS = 1.25
#: The longest wait for a supply that may be on and hears nothing: one that restarts may switch its output on by itself.
_UNHEARD_WAIT_s = 0.5
CHECK_PERIOD_s = 0.5  #: how often one of the supply's settings is read back while driving
_OFF = Command(0.0, False)
OFF_MEANWHILE = "not enabled: it was switched off meanwhile"
_SETPOINT_QUEUE = 1024


class DriverStopped(RuntimeError):
    """The loop does not run any more, so the call was not made."""


class Recording(Protocol):
    """What the loop needs of a recorder."""

    def record(self, reading: Reading | None, output: Output) -> None:
        """Take one step's row; never wait."""


class Driver:
    """Drives one wire.

    ``on_output(output)`` is called in the control thread after every step, by the watchman where that
    thread hangs, and must return at once; ``on_failure(exception)`` likewise in the control thread when
    an exception has ended the loop, after the supply has been shut down.  ``recorder`` gets every step.
    With a ``feed_timeout_s`` somebody must call :meth:`feed` that often, or the wire is switched off: its
    commander is gone.
    """

    def __init__(
        self,
        config: Config,
        supply: PowerSupply,
        daq: Daq,
        clock: Clock,
        on_output: Callable[[Output], None] | None = None,
        recorder: Recording | None = None,
        on_failure: Callable[[BaseException], None] | None = None,
        feed_timeout_s: float = math.inf,
        name: str = "sma_actuator",
    ):
        self.name = name
        self.failure: BaseException | None = None  #: the exception that ended the loop
        self._config = config
        self._clock = clock
        self._actuator = Actuator(config)
        self._supply_instrument = supply
        self._daq_instrument = daq
        instruments = config.instruments
        longest_wait_s = instruments.reconnect_backoff_max
        self._supply = Link("supply", supply, instruments.supply.timeout, longest_wait_s, clock.now_s)
        self._daq = Link("daq", daq, instruments.daq.timeout, longest_wait_s, clock.now_s)
        self._links = (self._supply, self._daq)
        supply.patience_s = daq.patience_s = config.safety.reading_timeout
        self._on_output = on_output
        self._on_failure = on_failure
        self._recorder = recorder
        self._feed_timeout_s = feed_timeout_s
        self._fed_at_s = clock.now_s()
        self._written: Command | None = None  #: what the supply was last told; None: not known
        self._may_flow = False  #: the output was told to be on, and since then not read back as off
        self._flows_since_s = math.inf  #: from when on current was measured behind an output that reads back as off
        self._output: Output | None = None  #: of the last step
        self._alive_s = math.inf  #: when the control thread last showed life; infinite while there is none
        self._waited_alive = Waited()  #: for the instruments until then
        self._waited = Waited()  #: and until the last step
        self._hung = ""  #: what the watchman found, until the control thread goes on
        self._checked_s = -math.inf  #: when a setting of the supply was last looked at
        self._writing = threading.Lock()  #: held while the supply is told what a step has found, or off beside a step
        self._reads_on = False  #: the supply has read back that its output is on, since it was told so
        self._cancelled = 0  #: how often an ``enable`` that waits was told to end
        self._asking_s: collections.deque[tuple[float, float]] = collections.deque(maxlen=_ASKED_STEPS)
        self._off_asked: Future | None = None  #: what the loop was told when off was last said beside a step
        #: As which fault and why the watchman has shut the supply down, until the control thread has noted it.
        self._cut: tuple[Fault, str] | None = None
        self._prepared: Future = Future()  #: of the thread: that it has what loop.realtime asks for
        self._thread: threading.Thread | None = None
        self._at_exit: Callable[[], None] | None = None  #: what the interpreter calls at its end
        self._stopping = threading.Event()
        self._gate = threading.Lock()  #: guards _ended and the mailbox against each other
        self._opened = False
        self._supply_opened = False  #: before that nothing is known of its output
        self._ended = False
        self._mailbox: collections.deque[tuple[Callable[[Actuator, float], Any], Future]] = collections.deque()
        self._setpoints: collections.deque[tuple[float, Callable[[Actuator, float], str]]] = collections.deque()
        self._flooded = 0
        self._refusals: collections.deque[str] = collections.deque(maxlen=16)
        self._deadlines = Deadlines(1.0 / config.loop.rate)

    # --- life ------------------------------------------------------------------------------------

    def open(self) -> None:
        """Connect both instruments; the output is off afterwards.  Raises InstrumentError."""
        self._require_alive()
        _warm_up(self._config)
        try:
            for link in self._links:
                link.instrument.open()
                link.answers = True
                self._supply_opened = True
            self._opened = True
        except BaseException:
            self._finish()
            raise

    def start(self) -> None:
        """Run the loop in a thread of its own.  Opens the instruments where :meth:`open` has not.

        Raises InstrumentError, and RealtimeRefused where the system does not allow ``loop.realtime``.
        """
        self._open_once()
        self._at_exit = _stop_at_exit(self)
        self.feed()
        # A daemon: at the interpreter's end atexit stops it, where joining it would wait for ever.
        self._thread = threading.Thread(target=self._loop, name=f"{self.name} control", daemon=True)
        self._thread.start()
        try:
            self._prepared.result()
        except RealtimeRefused:
            self._thread.join()  # it has ended with the output off
            raise
        threading.Thread(target=self._watch, name=f"{self.name} watchman", daemon=True).start()

    def stop(self) -> bool:
        """End the loop with the current at zero and the output off; whether off was read back.

        Off is said at once; that it is confirmed takes 0.4 s and twice ``instruments.supply.timeout`` at the most.

        May be called from any thread but the control thread, and more than once.  A thread that
        hangs in an instrument's answer is not waited for: the supply is then shut down from here.
        """
        self._stopping.set()
        if self._thread is None:
            self._finish()
        else:
            self._thread.join(_JOIN_TIMEOUT_s)
            if self._thread.is_alive():
                self._shut_down()  # before a word is said: what holds the loop up may be the log
                _log.warning("%s: something holds up the loop; the supply was shut down beside it", self.name)
        return not self._may_flow

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    # --- requests, from any thread ----------------------------------------------------------------

    def submit(self, request: Callable[[Actuator, float], Any]) -> Future:
        """Have ``request(actuator, now_s)`` executed between two steps; its result comes as a Future.

        Without a control thread it is executed at once.
        """
        future: Future = Future()
        with self._gate:
            if self._ended:
                future.set_exception(DriverStopped(f"{self.name}: the loop has ended"))
            elif self._thread is not None and threading.current_thread() is not self._thread:
                self._mailbox.append((request, future))
            else:
                _fulfil(future, request, self._actuator, self._clock.now_s())
        return future

    def call(self, request: Callable[[Actuator, float], Any], timeout_s: float = _CALL_s) -> Any:
        """Result of ``request(actuator, now_s)``, executed between two steps.

        Raises DriverStopped, TimeoutError (then it will not be executed later either), and
        whatever the request raises.
        """
        future = self.submit(request)
        try:
            return future.result(timeout_s)
        except TimeoutError:
            if not future.cancel():  # it began in the last moment
                return future.result(timeout_s)
            raise TimeoutError(
                f"{self.name}: the loop did not answer within {timeout_s:g} s: an instrument holds it up"
            ) from None

    def offer_setpoint(self, position_m: float) -> None:
        """Hand over a setpoint [m]; never waits.  Refusals come back by :meth:`refusals`."""
        self._offer(lambda actuator, now_s: actuator.offer_setpoint(now_s, position_m))

    def offer_joint_command(self, position_m: float) -> None:
        """Hand over a joint command [m], which may be NaN; never waits."""
        self._offer(lambda actuator, now_s: actuator.offer_joint_command(now_s, position_m))

    def offer_trajectory(
        self,
        times_s: list[float],
        positions_m: list[float],
        velocities_m_s: list[float] | None = None,
        delay_s: float = 0.0,
    ) -> None:
        """Hand over a trajectory: positions [m] at times [s] from ``delay_s`` after now; never waits."""
        self._offer(
            lambda actuator, now_s: actuator.offer_trajectory(now_s, times_s, positions_m, velocities_m_s, delay_s)
        )

    def hold(self) -> None:
        """Have the motion end where the wire is measured to be; never waits."""
        self._offer(lambda actuator, now_s: actuator.hold(now_s))

    def feed(self) -> None:
        """Say that the commander is alive."""
        self._fed_at_s = self._clock.now_s()

    @property
    def has_refusals(self) -> bool:
        """Whether :meth:`refusals` has any."""
        return bool(self._refusals)

    def refusals(self) -> list[str]:
        """Sentences of the setpoints refused since the last call."""
        out = []
        with contextlib.suppress(IndexError):
            while True:
                out.append(self._refusals.popleft())
        return out

    def enable(
        self, on: bool, timeout_s: float = _CALL_s, wanted: Callable[[], bool] = lambda: True
    ) -> tuple[bool, str]:
        """Switch the current on or off; whether that was done, and the sentence that says so.

        Either is done when the supply has read it back.  Off does not wait for a DAQ that takes its time, and ends an
        ``enable`` of another thread that still waits.  On is done only if it is ``wanted`` still when its turn has come
        between two steps: who asks for off after having said that on is not wanted has the last word.
        """
        return self._on(timeout_s, wanted) if on else self._off(timeout_s)

    def cancel_enable(self) -> None:
        """Have an ``enable`` that another thread waits for end at once."""
        self._cancelled += 1

    def clear_fault(self, timeout_s: float = _CALL_s) -> tuple[bool, str]:
        """Clear a latched fault and the supply's own trips; the output stays off."""
        return self.call(self._clear_fault, timeout_s)

    def reset_estimator(self, timeout_s: float = _CALL_s) -> tuple[bool, str]:
        """Forget the past of the estimate."""
        return self.call(lambda actuator, _: actuator.reset_estimator(), timeout_s)

    def tune(self, timeout_s: float = _CALL_s) -> tuple[bool, str]:
        """Begin to tune the gains; the wire must be driven."""
        return self.call(lambda actuator, now_s: actuator.tune(now_s), timeout_s)

    def tare_load(self, timeout_s: float = _CALL_s) -> tuple[bool, str]:
        """Take the present load for zero."""
        return self.call(lambda actuator, _: actuator.tare_load(), timeout_s)

    def measure_lead_resistance(self, timeout_s: float = _CALL_s) -> tuple[bool, str, float]:
        """Lead resistance [Ω], with a short in place of the wire."""
        return self.call(lambda actuator, _: actuator.measure_lead_resistance(), timeout_s)

    def update(self, config: Config, timeout_s: float = _CALL_s) -> None:
        """Take over changed parameters; only those declared ``live`` may differ.

        Raises TimeoutError where that is not done yet; it will be, as soon as the loop goes on.
        """
        future = self.submit(lambda actuator, _: self._update(actuator, config))
        try:
            future.result(timeout_s)
        except TimeoutError:
            raise TimeoutError("it takes them over as soon as an instrument that holds it up answers") from None

    @property
    def hardware_id(self) -> str:
        """What the supply calls itself."""
        return self._supply_instrument.identity

    @property
    def output_is_off(self) -> bool:
        """Whether the supply has read back that its output is off, and was told nothing else since."""
        return self._supply_opened and not self._may_flow

    @property
    def output_words(self) -> str:
        """What is known of the supply's output."""
        if not self._may_flow:
            return "the output is off"
        told = self._written
        if told is not None and told.output_on:
            return "the output is on"
        return "the output is told to be off, not confirmed"

    @property
    def lost_instruments(self) -> dict[str, str]:
        """Instruments that do not answer, and why; also the control loop itself, where it hangs."""
        lost = {link.name: link.detail for link in self._links if not link.answers}
        if self._may_flow and "supply" in lost:
            lost["supply"] += f"; {self.output_words}"
        return {"control loop": self._hung, **lost} if self._hung else lost

    def statistics(self) -> LoopStatistics:
        """Period and overruns of the loop."""
        now_s = self._clock.now_s()
        late = sum(link.late_answers for link in self._links)
        slowest_s = max(link.slowest.longest_s(now_s) for link in self._links)
        return self._deadlines.statistics(late, slowest_s)

    # --- the loop ---------------------------------------------------------------------------------

    def run_for(self, seconds: float) -> Output | None:
        """Step by hand, deadline after deadline, for a time; the last output.  Not with a thread."""
        until_s = self._clock.now_s() + seconds
        output = None
        while self._next_deadline_s() < until_s - 1e-9:
            output = self._step_at_deadline()
        self._clock.sleep_until_s(until_s)
        return output

    def tick(self) -> Output:
        """One step: read, think, write.  Any exception ends the driver, with the output off."""
        try:
            self._open_once()
            return self._tick()
        except BaseException as error:
            self._fail(error)
            raise

    def _loop(self) -> None:
        try:
            _fulfil(self._prepared, lambda *_: realtime.begin(self._config.loop.realtime), self._actuator, 0.0)
            if self._prepared.exception() is not None:
                return
            with at_once():  # what the warm-up has not reached is not waited for
                while not self._stopping.is_set():
                    self._step_at_deadline()
        except BaseException as error:  # noqa: BLE001 - reported by _fail: nobody awaits this thread
            if self.failure is None:
                self._fail(error)
        finally:
            self._finish()

    def _step_at_deadline(self) -> Output | None:
        deadline_s = self._next_deadline_s()
        target_s = -math.inf
        while target_s < deadline_s and (now_s := self._clock.now_s()) < deadline_s:
            target_s = min(deadline_s, now_s + _LONGEST_SLEEP_s)
            self._clock.sleep_until_s(target_s)
            self._run_calls()
            if self._stopping.is_set():
                return None
        self._alive_s = self._clock.now_s()
        self._waited_alive = self._waited_so_far()  # after that: the watchman reads it before
        self._deadlines.begun(self._alive_s)
        output = self.tick()
        self._deadlines.done(deadline_s, self._clock.now_s())
        return output

    def _next_deadline_s(self) -> float:
        return self._deadlines.next_s(self._clock.now_s)

    def _tick(self) -> Output:
        self._run_calls()
        self._reconnect()
        began_s, answered = self._clock.now_s(), self._daq.answers
        reading: Reading | None = self._daq.ask(self._daq_instrument.read_block)
        read_s = self._clock.now_s()
        state: SupplyState | None = None
        if self._daq.answers or not answered:  # else it has just been lost, and off waits for no other answer
            state = self._supply.ask(self._supply_instrument.read_back)
        self._asking_s.append((read_s - began_s, self._clock.now_s() - read_s))
        if self._off_is_asked:  # the supply may have said what it is since then
            self._run_calls()
            state = self._supply.ask(self._supply_instrument.read_back)
        now_s, so_far = self._clock.now_s(), self._waited_so_far()
        waited, self._waited = so_far.since(self._waited), so_far
        self._reads_on = state is not None and state.output_on and self._written is not None and self._written.output_on
        self._check_a_setting(now_s)
        self._report_losses(now_s)
        if now_s - self._fed_at_s > self._feed_timeout_s:
            self._actuator.raise_fault(
                now_s, "node_lost", f"the node has not been heard of for {self._feed_timeout_s:g} s"
            )
        self._offer_setpoints(now_s)
        output = self._actuator.step(now_s, reading, state, waited)
        self._supply.ask(lambda: self._write(output.command, state))
        overtaken = self._cut  # what the watchman has put out is newer than this
        self._report_losses(now_s)
        output = self._output = self._with_truth(output)
        if self._recorder is not None:
            self._recorder.record(reading, output)
        if self._on_output is not None and not (overtaken or self._cut):
            self._on_output(output)
        return output

    def _waited_so_far(self) -> Waited:
        return Waited(self._daq.waited_s(), self._supply.waited_s())

    def _check_a_setting(self, now_s: float) -> None:
        """While driving, look now and then whether limits and watchdog still stand, one of them at a time."""
        if self._supply.late or now_s - self._checked_s < CHECK_PERIOD_s:
            return
        if self._written is not None and self._written.output_on:
            self._checked_s = now_s
            self._supply.ask(self._supply_instrument.check_next_setting)

    def _write(self, command: Command, state: SupplyState | None) -> None:
        """Tell the supply what it does not know yet."""
        with self._writing:
            self._write_alone(command, state)

    def _write_alone(self, command: Command, state: SupplyState | None) -> None:
        if self._cut or self._off_is_asked or self._stopping.is_set():
            command = _OFF  # thought out before the supply was shut down beside this thread
        written = self._written
        if command.output_on:
            self._may_flow = True
            if written is None or abs(command.current_A - written.current_A) > CURRENT_RESOLUTION_A:
                self._supply_instrument.set_current(command.current_A)
            else:
                command = Command(written.current_A, True)
            if written is None or not written.output_on:
                self._supply_instrument.set_output(True)
        elif written is None or written.output_on or (state is not None and state.output_on):
            self._switch_off()
        self._written = command

    def _switch_off(self) -> None:
        """Have the output off, and know it."""
        self._written, self._reads_on = None, False
        self._may_flow = True
        self._supply_instrument.switch_off()
        self._written, self._may_flow = _OFF, False

    def _reconnect(self) -> None:
        if not self._daq.answers:
            self._daq.reconnect(quiet_s=0.0)
        if not self._supply.answers:
            self._written = None
            if self._may_flow:
                quiet_s = _QUIET_WATCHDOGS * self._config.supply.watchdog_timeout
                self._supply.reconnect(quiet_s, _UNHEARD_WAIT_s)
            else:
                self._supply.reconnect(quiet_s=0.0)

    def _with_truth(self, output: Output) -> Output:
        """The output of a step with what is known of the supply's output beside what was commanded."""
        words, flows = self.output_words, self._flows_on(output)
        if flows:
            words = f"the output is read back as off, and {output.signals.current_A:.3g} A flow: pull the supply's plug"
        output.status.values["output"] = words.removeprefix("the output is ")
        if output.command.output_on or not (self._may_flow or flows):
            return output
        message = words + output.status.message.removeprefix("off")
        return dataclasses.replace(output, status=dataclasses.replace(output.status, message=message))

    def _flows_on(self, output: Output) -> bool:
        """Whether current has flown longer than readings may be wrong, though the supply says that its output is off."""
        safety, reading = self._config.safety, output.reading
        if reading is None or not self.output_is_off or not output.signals.current_A > safety.current_disagreement:
            self._flows_since_s = math.inf
            return False
        self._flows_since_s = min(self._flows_since_s, reading.time_s)
        return reading.time_s - self._flows_since_s >= safety.disagreement_time

    def _report_losses(self, now_s: float) -> None:
        self._note_hang(now_s)  # what was cut for it is lost for it
        if not self._supply.answers:
            self._written = None
        for link in self._links:
            if not link.answers:
                self._actuator.raise_fault(now_s, link.fault, link.detail)

    def _clear_fault(self, actuator: Actuator, now_s: float) -> tuple[bool, str]:
        lost = self.lost_instruments
        if lost:
            return False, "; ".join(f"the {name} still does not answer: {detail}" for name, detail in lost.items())
        if not actuator.latched:
            return actuator.clear_fault(now_s)  # a wire that is driven goes on being driven
        self._insist(self._supply_instrument.clear_trip)
        self._insist(self._switch_off)
        if self._may_flow or not self._supply.answers:
            return False, f"not cleared: {self.output_words} ({self._supply.detail})"
        return actuator.clear_fault(now_s)

    def _on(self, timeout_s: float, wanted: Callable[[], bool]) -> tuple[bool, str]:
        """On, as soon as the loop has its turn, and read back as on: by its thread, where it has one."""
        cancelled, until_s = self._cancelled, time.monotonic() + timeout_s
        future = self.submit(
            lambda actuator, now_s: self._enable_checked(actuator, now_s) if wanted() else (False, OFF_MEANWHILE)
        )
        while not future.done() and time.monotonic() < until_s and self._cancelled == cancelled:
            concurrent.futures.wait([future], _CONFIRM_PERIOD_s)
        if future.cancel():
            if self._cancelled != cancelled:
                return False, OFF_MEANWHILE
            raise TimeoutError(
                f"{self.name}: the loop did not answer within {timeout_s:g} s: an instrument holds it up"
            )
        done, words = future.result(_CALL_s)
        if not done or self._thread is None or threading.current_thread() is self._thread:
            return done, words
        while not self._reads_on:
            if not self._actuator.is_driven or self._cancelled != cancelled or self._ended:
                return False, f"{OFF_MEANWHILE}; {self.output_words}"
            if time.monotonic() >= until_s:
                return False, f"the supply was told to switch on, and has not read that back within {timeout_s:g} s"
            time.sleep(_CONFIRM_PERIOD_s)
        return done, words

    def _rate_refusal(self) -> str:
        """Why the loop's rate cannot be met, by the quickest of the last steps; "" where it can."""
        if len(self._asking_s) < _ASKED_STEPS or not all(link.answers for link in self._links):
            return ""
        daq_s, supply_s = min(self._asking_s, key=sum)
        if daq_s + supply_s <= self._deadlines.period_s:
            return ""
        return (
            f"a step takes the instruments {daq_s + supply_s:.3g} s (supply {supply_s:.3g} s, DAQ {daq_s:.3g} s), so loop.rate can "
            f"be {highest_rate_Hz(daq_s + supply_s):.2g} Hz at the most; it is {self._config.loop.rate:g} Hz"
        )

    def _enable_checked(self, actuator: Actuator, now_s: float) -> tuple[bool, str]:
        if not actuator.is_driven and (refusal := self._rate_refusal()):
            return False, f"not enabled: {refusal}"
        self._insist(self._supply_instrument.check_settings)
        self._report_losses(now_s)
        if self._supply.late:
            return False, f"not enabled: {self._supply.detail}"
        return actuator.enable(now_s, True)

    def _insist(self, question: Callable[[], Any]) -> None:
        """Have the supply answer, though late."""
        self._supply.insist(question, self._config.safety.reading_timeout)

    def _off(self, timeout_s: float) -> tuple[bool, str]:
        """Off between two steps, or beside one that lasts: then the loop takes it over as soon as it goes on."""
        self.cancel_enable()
        future = self.submit(self._disable)
        with contextlib.suppress(TimeoutError):
            return future.result(min(timeout_s, _OFF_PATIENCE_s))
        until_s = time.monotonic() + timeout_s - _OFF_PATIENCE_s
        if self._writing.acquire(timeout=max(until_s - time.monotonic(), 0.0)):  # not while the loop says "on"
            try:
                self._off_asked, self._written, self._reads_on = future, None, False
                self._supply_instrument.switch_off()
                self._may_flow = False
            except InstrumentError:
                pass  # of which the loop will hear
            finally:
                self._writing.release()
        if not self._may_flow:
            return True, self.output_words
        with contextlib.suppress(TimeoutError):
            return future.result(max(until_s - time.monotonic(), 0.0))
        return False, f"{self.output_words}; an instrument holds the loop up"

    @property
    def _off_is_asked(self) -> bool:
        """Whether off was said beside the loop, which has not taken that over yet."""
        return self._off_asked is not None and not self._off_asked.done()

    def _disable(self, actuator: Actuator, now_s: float) -> tuple[bool, str]:
        done, words = actuator.enable(now_s, False)
        self._insist(self._switch_off)
        if not self._may_flow:
            actuator.switched_off()
            return done, words
        actuator.raise_fault(now_s, "output_not_confirmed", self._supply.detail)
        return False, f"{self.output_words}: {self._supply.detail}"

    def _update(self, actuator: Actuator, config: Config) -> None:
        actuator.update(config)
        self._config = config
        self._supply_instrument.patience_s = self._daq_instrument.patience_s = config.safety.reading_timeout

    # --- hand-over --------------------------------------------------------------------------------

    def _offer(self, offer: Callable[[Actuator, float], str]) -> None:
        if len(self._setpoints) >= _SETPOINT_QUEUE:
            self._flooded += 1
        else:
            self._setpoints.append((self._clock.now_s(), offer))

    def _offer_setpoints(self, now_s: float) -> None:
        flooded, self._flooded = self._flooded, 0
        if flooded:
            self._actuator.raise_fault(
                now_s, "setpoint_flood", f"{flooded} setpoints came faster than the loop could look at them"
            )
        for _ in range(len(self._setpoints)):
            arrived_s, offer = self._setpoints.popleft()
            refusal = offer(self._actuator, arrived_s)
            if refusal:
                self._refusals.append(refusal)

    def _run_calls(self) -> None:
        while self._mailbox:
            request, future = self._mailbox.popleft()
            _fulfil(future, request, self._actuator, self._clock.now_s())

    # --- the end ----------------------------------------------------------------------------------

    def _require_alive(self) -> None:
        if self._ended:
            raise DriverStopped(f"{self.name}: the driver has ended; make a new one")

    def _open_once(self) -> None:
        self._require_alive()
        if not self._opened:
            self.open()

    def _fail(self, error: BaseException) -> None:
        self.failure = error
        self._finish()
        _log.error("%s: the loop ended, %s: %r", self.name, self.output_words, error)
        if self._on_failure is not None:
            self._on_failure(error)

    def _finish(self) -> None:
        """Supply shut down, instruments closed, waiting calls answered.  Does so once."""
        with self._gate:
            if self._ended:
                return
            self._ended = True
            waiting, self._mailbox = self._mailbox, collections.deque()
        self._shut_down()
        for _, future in waiting:
            if future.set_running_or_notify_cancel():
                future.set_exception(DriverStopped(f"{self.name}: the loop has ended"))
        for link in self._links:
            link.answers = False
            link.instrument.close()
        if self._at_exit is not None:
            atexit.unregister(self._at_exit)

    def _shut_down(self) -> None:
        self._written = None
        confirmed = self._supply_instrument.shut_down()
        self._may_flow = not confirmed and self._may_flow

    # --- the watchman -----------------------------------------------------------------------------

    def _watch(self) -> None:
        """In a thread of its own: shut the supply down beside a control thread that shows no life."""
        while not self._ended and not self._stopping.is_set():
            time.sleep(_WATCH_PERIOD_s)  # half of what waiting for an event takes; nobody waits for this thread
            self._look()

    def _look(self) -> None:
        """Cut, once, where no step came for as long as readings may be old; the fault names who the loop waits for."""
        waited = self._waited_so_far().since(self._waited_alive)
        silent_s, bound_s = self._clock.now_s() - self._alive_s, self._config.safety.reading_timeout
        if self._hung or silent_s <= bound_s:
            return
        name, part = waited.most(silent_s, self._deadlines.period_s)
        fault = FAULTS[f"{name}_lost"] if name else loop_hung
        self._hung = why = f"no step for {silent_s:.3g} s{part}; safety.reading_timeout is {bound_s:g} s"
        if not (self._may_flow and self._supply.answers):
            return  # nothing flows, or the control thread is about to say off on a new connection
        try:
            self._cut = fault, why
            self._shut_down()
            _log.error("%s: %s (%s); %s", self.name, fault.words, why, self.output_words)
            self._show_hang(fault, why)
        except Exception:  # noqa: BLE001 - the last pair of eyes must stay open
            _log.exception("%s: the watchman failed", self.name)

    def _show_hang(self, fault: Fault, why: str) -> None:
        """Put out what is known while the control thread says nothing."""
        output = self._output
        if output is None or self._on_output is None:
            return
        status = dataclasses.replace(
            output.status,
            mode=Mode.OFF,
            fault=fault.name,
            limits=(),
            message=f"off: {fault.words} ({why})",
            values=dict(output.status.values),
        )
        # What was read before the output went off says nothing of what flows now.
        self._on_output(self._with_truth(dataclasses.replace(output, reading=None, command=_OFF, status=status)))

    def _note_hang(self, now_s: float) -> None:
        """In the control thread, when it goes on: what the watchman has done is a fault."""
        if self._cut is not None:
            fault, why = self._cut
            self._actuator.raise_fault(now_s, fault.name, why)
            self._written, self._cut = None, None
        self._hung = ""


def _warm_up(config: Config) -> None:
    """Drive a wire that does not exist, so that nothing is compiled or imported while the real one is driven.

    Loading the kernels takes some tenths of a second, and compiling them, once on a machine, many seconds, which the
    loop would miss in its first step with current.
    """
    actuator = Actuator(config)
    current_A, circuit, safety = config.supply.bias_current, config.circuit, config.safety
    wire_Ohm = math.sqrt(safety.resistance_min * safety.resistance_max)
    load_V = (0.5 * config.wire.max_stress * config.wire.area_m2 - config.load_cell.offset) / config.load_cell.slope
    for number in range(2 + math.ceil(2.0 * SETTLING_TIME_s * config.loop.rate)):
        now_s = number / config.loop.rate
        total_Ohm = circuit.reference_resistance + circuit.lead_resistance + wire_Ohm * (1.0 - 1e-4 * number)
        reading = Reading(now_s, current_A * total_Ohm, current_A * circuit.reference_resistance, load_V)
        actuator.step(now_s, reading, SupplyState(now_s, current_A, number > 0, current_A * total_Ohm, current_A))
        if number == 0:
            actuator.enable(now_s, True)


def _fulfil(future: Future, request: Callable[[Actuator, float], Any], actuator: Actuator, now_s: float) -> None:
    if not future.set_running_or_notify_cancel():
        return
    try:
        future.set_result(request(actuator, now_s))
    except Exception as error:  # noqa: BLE001 - it is the caller's
        future.set_exception(error)


def _stop_at_exit(driver: Driver) -> Callable[[], None]:
    """Stop the driver when the interpreter ends, unless it is gone by then; what does so."""
    reference = weakref.ref(driver)

    def stop() -> None:
        alive = reference()
        if alive is not None:
            alive.stop()

    atexit.register(stop)
    return stop
