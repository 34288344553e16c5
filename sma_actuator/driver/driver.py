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
import concurrent.futures
import contextlib
import logging
import math
import threading
import time
import weakref
from collections.abc import Callable
from concurrent.futures import Future
from typing import Self

from sma_actuator.actuator import Actuator
from sma_actuator.base import realtime
from sma_actuator.base.jit import at_once
from sma_actuator.base.realtime import RealtimeRefused
from sma_actuator.base.signals import Output
from sma_actuator.config import Config
from sma_actuator.instruments import Clock, Daq, PowerSupply

from .loop import Loop, Recording
from .output import Known
from .requests import CALL_s, DriverStopped, Requests, fulfil
from .statistics import LoopStatistics
from .warm_up import warm_up

_log = logging.getLogger(__name__)

_LONGEST_SLEEP_s = 0.05  #: so that a stop and a call do not wait for a slow loop's next deadline
_CONFIRM_PERIOD_s = 0.005  #: how often it is looked whether the supply has read back that it is on
_OFF_PATIENCE_s = 0.1  #: how long off waits for its turn between two steps, before it is said beside them
_JOIN_TIMEOUT_s = 0.3  #: what ``stop`` leaves a thread that waits for an instrument, of the second it has
OFF_MEANWHILE = "not enabled: it was switched off meanwhile"


class Driver(Requests):
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
        actuator = Actuator(config)
        super().__init__(name, actuator, clock)
        self.failure: BaseException | None = None  #: the exception that ended the loop
        self._config = config
        self._supply = supply
        self._on_output = on_output
        self._on_failure = on_failure
        self._stopping = threading.Event()
        self._loop = Loop(
            config, supply, daq, clock, actuator, self, self._put_out, recorder, feed_timeout_s, self._stopping
        )
        self._output = self._loop.output
        self._cancelled = 0  #: how often an ``enable`` that waits was told to end
        self._prepared: Future = Future()  #: of the thread: that it has what loop.realtime asks for
        self._at_exit: Callable[[], None] | None = None  #: what the interpreter calls at its end
        self._opened = False

    # --- life -------------------------------------------------------------------------------------

    def open(self) -> None:
        """Connect both instruments; the output is off afterwards.  Raises InstrumentError."""
        self._require_alive()
        warm_up(self._config)
        try:
            self._loop.open()
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
        self._thread = threading.Thread(target=self._run, name=f"{self.name} control", daemon=True)
        self._thread.start()
        try:
            self._prepared.result()
        except RealtimeRefused:
            self._thread.join()  # it has ended with the output off
            raise
        watch = threading.Thread(
            target=self._loop.watchman.watch, args=(self._is_over,), name=f"{self.name} watchman", daemon=True
        )
        watch.start()

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
                self._output.shut_down()  # before a word is said: what holds the loop up may be the log
                _log.warning("%s: something holds up the loop; the supply was shut down beside it", self.name)
        return not self._output.known.may_flow

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    # --- requests, from any thread ----------------------------------------------------------------

    def feed(self) -> None:
        """Say that the commander is alive."""
        self._loop.fed_at_s = self._clock.now_s()

    def enable(
        self, on: bool, timeout_s: float = CALL_s, wanted: Callable[[], bool] = lambda: True
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

    def clear_fault(self, timeout_s: float = CALL_s) -> tuple[bool, str]:
        """Clear a latched fault and the supply's own trips; the output stays off."""
        return self.call(self._loop.clear_fault, timeout_s)

    def update(self, config: Config, timeout_s: float = CALL_s) -> None:
        """Take over changed parameters; only those declared ``live`` may differ.

        Raises TimeoutError where that is not done yet; it will be, as soon as the loop goes on.
        """
        future = self.submit(lambda actuator, _: self._loop.update(actuator, config))
        try:
            future.result(timeout_s)
        except TimeoutError:
            raise TimeoutError("it takes them over as soon as an instrument that holds it up answers") from None

    def _on(self, timeout_s: float, wanted: Callable[[], bool]) -> tuple[bool, str]:
        """On, as soon as the loop has its turn, and read back as on: by its thread, where it has one."""
        cancelled, until_s = self._cancelled, time.monotonic() + timeout_s
        future = self.submit(
            lambda actuator, now_s: self._loop.enable(actuator, now_s) if wanted() else (False, OFF_MEANWHILE)
        )
        while not future.done() and time.monotonic() < until_s and self._cancelled == cancelled:
            concurrent.futures.wait([future], _CONFIRM_PERIOD_s)
        if future.cancel():
            if self._cancelled != cancelled:
                return False, OFF_MEANWHILE
            raise self._held_up(timeout_s)
        done, words = future.result(CALL_s)
        if not done or self._thread is None or threading.current_thread() is self._thread:
            return done, words
        while self._output.known is not Known.READ_ON:
            if not self._actuator.is_driven or self._cancelled != cancelled or self._ended:
                # Told to be on, its turn to be told off has not come: that it is on is none of the news.
                return False, OFF_MEANWHILE if self._output.known.is_on else f"{OFF_MEANWHILE}; {self.output_words}"
            if time.monotonic() >= until_s:
                return False, f"the supply was told to switch on, and has not read that back within {timeout_s:g} s"
            time.sleep(_CONFIRM_PERIOD_s)
        return done, words

    def _off(self, timeout_s: float) -> tuple[bool, str]:
        """Off between two steps, or beside one that lasts: then the loop takes it over as soon as it goes on."""
        self.cancel_enable()
        future = self.submit(self._loop.disable)
        with contextlib.suppress(TimeoutError):
            return future.result(min(timeout_s, _OFF_PATIENCE_s))
        until_s = time.monotonic() + timeout_s - _OFF_PATIENCE_s
        self._output.off_beside(future, max(until_s - time.monotonic(), 0.0))
        if not self._output.known.may_flow:
            return True, self.output_words
        with contextlib.suppress(TimeoutError):
            return future.result(max(until_s - time.monotonic(), 0.0))
        return False, f"{self.output_words}; an instrument holds the loop up"

    # --- what is known, from any thread -----------------------------------------------------------

    @property
    def hardware_id(self) -> str:
        """What the supply calls itself."""
        return self._supply.identity

    @property
    def output_is_off(self) -> bool:
        """Whether the supply has read back that its output is off, and was told nothing else since."""
        return self._output.known.is_off

    @property
    def output_words(self) -> str:
        """What is known of the supply's output."""
        return self._output.words

    @property
    def lost_instruments(self) -> dict[str, str]:
        """Instruments that do not answer, and why; also the control loop itself, where it hangs."""
        return self._loop.lost_instruments

    def statistics(self) -> LoopStatistics:
        """Period and overruns of the loop."""
        return self._loop.statistics()

    # --- the loop ---------------------------------------------------------------------------------

    def run_for(self, seconds: float) -> Output | None:
        """Step by hand, deadline after deadline, for a time; the last output.  Not with a thread."""
        until_s = self._clock.now_s() + seconds
        output = None
        while self._loop.deadlines.next_s(self._clock.now_s) < until_s - 1e-9:
            output = self._step_at_deadline()
        self._clock.sleep_until_s(until_s)
        return output

    def tick(self) -> Output:
        """One step: read, think, write.  Any exception ends the driver, with the output off."""
        try:
            self._open_once()
            return self._loop.step()
        except BaseException as error:
            self._fail(error)
            raise

    def _run(self) -> None:
        try:
            fulfil(self._prepared, lambda *_: realtime.begin(self._config.loop.realtime), self._actuator, 0.0)
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
        deadlines = self._loop.deadlines
        deadline_s = deadlines.next_s(self._clock.now_s)
        target_s = -math.inf
        while target_s < deadline_s and (now_s := self._clock.now_s()) < deadline_s:
            target_s = min(deadline_s, now_s + _LONGEST_SLEEP_s)
            self._clock.sleep_until_s(target_s)
            self.run_calls()
            if self._stopping.is_set():
                return None
        deadlines.begun(self._loop.watchman.show_life())
        output = self.tick()
        deadlines.done(deadline_s, self._clock.now_s())
        return output

    def _put_out(self, output: Output) -> None:
        if self._on_output is not None:
            self._on_output(output)

    # --- the end ----------------------------------------------------------------------------------

    def _is_over(self) -> bool:
        return self._ended or self._stopping.is_set()

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
        waiting = self._end()
        if waiting is None:
            return
        self._output.shut_down()
        self._refuse(waiting)
        self._loop.close()
        if self._at_exit is not None:
            atexit.unregister(self._at_exit)


def _stop_at_exit(driver: Driver) -> Callable[[], None]:
    """Stop the driver when the interpreter ends, unless it is gone by then; what does so."""
    reference = weakref.ref(driver)

    def stop() -> None:
        alive = reference()
        if alive is not None:
            alive.stop()

    atexit.register(stop)
    return stop
