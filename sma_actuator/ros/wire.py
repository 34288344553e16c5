"""One wire as a lifecycle node: its life, and the loop that is opened, asked and given up with it.

What it publishes: ``topics.py`` and ``publishers.py``, in which words: ``reporter.py``; what moves it: ``commands.py``
and ``moved_wire.py``; what else it is asked for: ``services.py``, ``switch.py``, ``self_testing.py``; the process
around it: ``node.py``.
"""

from __future__ import annotations

import functools
import gc
import threading
import traceback
from collections.abc import Callable, Sequence
from math import nan
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from sma_actuator.base.errors import UserError, brief
from sma_actuator.base.signals import Output, Quality
from sma_actuator.config import Config
from sma_actuator.derived import not_survived
from sma_actuator.driver import Driver, DriverStopped
from sma_actuator.instruments import InstrumentError, open_instruments
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.logs.recorder import BenchLogRecorder

from . import arguments as ros_arguments
from .commands import Commands
from .guard import refuse_what_raises
from .log import ERROR, INFO, WARNING, Log, namesakes
from .moved_wire import MovedWire
from .parameters import NO_SIM_TIME, ROS_PARAMETERS, NodeParameters
from .publishers import Publishers
from .reporter import WireReporter
from .self_testing import SelfTesting
from .services import CALL_TIMEOUT_s, services_of
from .switch import Switchable
from .topics import WIRE, offer

ENABLE_TIMEOUT_s = 5.0  #: ``~/enable`` waits for a supply of any speed to confirm it; off of any kind ends that
FEED_TIMEOUT_s = 0.9  #: silence of the ROS thread after which the driver switches the wire off
RETRY_PERIOD_s = 1.0


class SmaActuatorNode(LifecycleNode):
    """One wire on ROS 2.

    ``on_fatal(sentence)`` is called, from any thread, when the process should end: the loop has
    ended with an exception, or autostart failed.  Raises ConfigError where the parameters will not do.
    """

    def __init__(self, name: str, arguments: ros_arguments.RosArguments, on_fatal: Callable[[str], None]):
        super().__init__(name)
        self._on_fatal = on_fatal
        self.driver: Driver | None = None  #: the loop of the wire; None while no instruments are open
        self.recorder: BenchLogRecorder | None = None
        self.is_active = False  #: it publishes, and takes commands
        self._ended = False  #: for good
        self.left_off = False  #: the last instruments were given up with the output read back as off
        self.arming = threading.Lock()  #: held while the output goes on, and while the node stops being active
        self.refusal = ""  #: why the instruments are not open
        self._hopeless = False  #: and no waiting will help
        self._awaited: set[str] = set()  #: the refusals that were said: a gateway has several words for one cause
        self._wait_s = 0.0  #: between the last two looks for the instruments
        #: The joint that the wire turns with another gets every output too, in the control thread.
        self.joint_takes: Callable[[Output], None] | None = None
        self.turned_by: Callable[[], str] = str  #: the name of the joint that drives it now, else nothing
        self.log = Log(self)
        values = arguments.parameters_of(self.get_fully_qualified_name())
        own = {key: values.pop(key) for key in ROS_PARAMETERS if key in values}
        self._parameters_of_wire = NodeParameters(
            self, Config.from_mapping(values), self._take_over, self._feed, self._current_may_flow
        )
        if own.get("use_sim_time", False) is not False:
            self.log.say(WARNING, NO_SIM_TIME)
        if hot := not_survived(self.config.wire, self.config.supply, self.config.thermal):
            self.log.say(WARNING, hot)
        self.self_testing = SelfTesting(self)
        self.commands = Commands(self, MovedWire(self))
        self._reporter = WireReporter(self)
        self._topics: Publishers[Output] = Publishers(self, self._reporter, WIRE)
        offer(self, (*services_of(self), self.self_testing.service))
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state
        refuse_what_raises(self, self.report)
        if self.config.autostart:
            self._steady_timer(0.0, self._autostart, once=True)

    @property
    def config(self) -> Config:
        """The parameters as they are now."""
        return self._parameters_of_wire.config

    @property
    def parameter_values(self) -> dict[str, str]:
        """What the status says of the parameters."""
        return self._parameters_of_wire.key_values()

    @property
    def state(self) -> str:
        """Of its life."""
        return str(self._state_machine.current_state[1])

    def _current_may_flow(self) -> bool:
        return self.driver is not None and not self.driver.output_is_off

    def _take_over(self, config: Config, changed: list[str]) -> None:
        if self.driver is None:
            return
        try:
            self.driver.update(config, timeout_s=CALL_TIMEOUT_s)
        except (DriverStopped, TimeoutError) as error:
            self.log.say(ERROR, f"{', '.join(changed)} changed, but not in the loop yet: {error}")

    def _steady_timer(self, period_s: float, callback: Callable[[], None], once: bool = False) -> None:
        """A timer that does not follow the system's clock when that is set."""

        def run_once() -> None:
            self.destroy_timer(timer)
            callback()

        timer = self.create_timer(
            period_s, run_once if once else callback, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    # --- the loop and ROS, each in its turn --------------------------------------------------------

    def _take_output(self, output: Output) -> None:
        """Hand an output over, in the control thread."""
        if self.joint_takes is not None:
            self.joint_takes(output)
        self._reporter.note(output)
        self._topics.take(output)

    def _feed(self) -> None:
        """Say to the loop that ROS lives."""
        if self.driver is not None and self._topics.moves():
            self.driver.feed()

    def turn(self) -> None:
        """What the ROS thread does between callbacks."""
        self._feed()
        self._topics.turn()

    def report(self, sentence: str) -> None:
        """Say why something was refused."""
        self.log.refuse(sentence)

    def callback_failed(self, error: Exception) -> None:
        """Take an exception that no message is to blame for as a fault: the output goes off, the node goes on."""
        words = f"{type(error).__name__} in a ROS callback: {error}"
        trace = "".join(traceback.format_exception(error))
        if self.driver is not None:  # before a word is said: what failed may be what says it
            self.driver.submit(lambda actuator, now_s: actuator.raise_fault(now_s, "unhandled_exception", words))
        self.report(f"{words}\n{trace}")

    def watch(self, output: Output) -> None:
        """Look how a goal goes."""
        known = output.estimate.quality is not Quality.INVALID
        position_m = output.estimate.displacement_m if known else nan
        self.commands.watch(output.signals.time_s, position_m, output.status)

    def wake_no_more(self) -> None:
        """End the hand-off, so that ROS can be shut down."""
        self._topics.close()

    # --- on, off, and whatever else the loop is asked ------------------------------------------------

    @property
    def parts(self) -> Sequence[Switchable]:
        """A wire has none."""
        return ()

    def switch_on(self, wanted: Callable[[], bool] = lambda: True) -> tuple[bool, str]:
        """Output on, if it is ``wanted`` still when its turn has come; whether that was done, and the sentence that
        says so."""
        if self.self_testing.runs:
            return False, "not enabled: a self-test runs; ~/enable false ends it"
        with self.arming:
            done, words = self.asked(lambda driver: driver.enable(True, ENABLE_TIMEOUT_s, wanted))
        return done, words + namesakes(self)

    def switch_off(self) -> tuple[bool, str]:
        """Output off, in every state of the node and from any thread; whether it is, and the sentence that says so."""
        tested, driver = self.self_testing.end(), self.driver
        if tested is not None:
            return tested
        if driver is None:
            if self.left_off:
                return True, "the output is off: the supply said so before it was given up"
            return (
                False,
                "not known: no instruments are open, so nobody can say whether the output is off; look at the supply",
            )
        try:
            return driver.enable(False, timeout_s=CALL_TIMEOUT_s)
        except DriverStopped:
            return driver.output_is_off, f"the loop has ended; {driver.output_words}"

    def asked(self, request: Callable[[Driver], tuple[Any, ...]]) -> tuple[bool, str]:
        """What the actuator says to a request, where it can be asked."""
        driver = self.driver
        if not self.is_active or driver is None:
            return False, self.not_active()
        try:
            done, words, *_ = request(driver)
        except (DriverStopped, TimeoutError) as error:
            return False, str(error)
        return done, words

    def is_driven(self) -> bool:
        """Whether the wire is driven.  Raises DriverStopped, or TimeoutError.

        The loop itself is asked: its last output may be of before an ~/enable that was answered.
        """
        driver = self.driver
        return driver is not None and bool(driver.call(lambda actuator, _: actuator.is_driven, CALL_TIMEOUT_s))

    def not_active(self) -> str:
        """Why it takes no commands."""
        if self.state == "active":  # and yet it takes none
            return f"trying to open the instruments again: {self.refusal}" if self.refusal else "the node ends"
        if self._awaited:  # also while it looks again
            return f"waiting for the instruments: {self.refusal}"
        what = {"unconfigured": "configure and activate it first", "inactive": "activate it first"}.get(self.state, "")
        return f"the node is {self.state}" + (f"; {what}" if what else "")

    # --- life -------------------------------------------------------------------------------------

    def _on_change_state(self, request: ChangeState.Request, response: ChangeState.Response) -> Any:
        """Refuse a transition that the state does not have, in words; rclpy would raise."""
        wanted = request.transition.label or request.transition.id
        possible = self._transitions()
        if wanted not in possible and wanted not in possible.values():
            state = self.state
            names = ", ".join(f"{label} ({number})" for number, label in possible.items())
            self.report(f"~/change_state: the node is {state}; '{brief(str(wanted))}' is not one of {names}")
            response.success = False
            return response
        response = self._change_state(request, response)
        self._topics.publish_status()
        return response

    def _transitions(self) -> dict[int, str]:
        return {number: label for number, label, *_ in self._state_machine.available_transitions}

    def _autostart(self) -> None:
        """Configure and activate, from whatever state the node was brought to meanwhile."""
        state = self.state
        if state == "unconfigured" and self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            state = "inactive"
        if state == "inactive":
            self.trigger_activate()
        if state != "unconfigured":
            self._topics.publish_status()
            return
        if self.config.wait_for_instruments and not self._hopeless:
            self._later(self._autostart)
        else:
            self._on_fatal(f"{self.get_fully_qualified_name()}: {self.refusal}")

    def _later(self, attempt: Callable[[], None]) -> None:
        """Look for the instruments again, more and more rarely; why they are waited for is said once."""
        if self.refusal not in self._awaited:
            self._awaited.add(self.refusal)
            self.log.say(WARNING, f"waiting for the instruments: {self.refusal}; looking again until they are there")
        longest_s = max(RETRY_PERIOD_s, self.config.instruments.reconnect_backoff_max)
        self._wait_s = min(max(RETRY_PERIOD_s, 2.0 * self._wait_s), longest_s)
        # An attempt feeds the watchdog of the supply: it must have the time to cut what a dead program left on.
        self._steady_timer(max(self._wait_s, 2.0 * self.config.supply.watchdog_timeout), attempt, once=True)

    def go_on(self) -> None:
        """Have the driver again after a self-test, however long that takes, unless it was brought to another state."""
        if self._ended or self.driver is not None or self.state not in ("active", "inactive"):
            return
        if not self._open_driver():
            self._later(self.go_on)
            return
        self.is_active = self.state == "active"
        if self._ended:  # meanwhile
            self.give_up_driver()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open instruments and recorder and start the loop; no current can flow yet."""
        if not self._open_driver():
            config = self.config
            if not (config.autostart and config.wait_for_instruments):  # who waits for them says so himself
                self.log.say(ERROR, self.refusal)
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def _open_driver(self) -> bool:
        """Whether instruments and recorder could be opened and the loop runs; else ``_refusal`` says why not."""
        self.left_off = False
        config = self.config
        if not self._wait_s:
            self.log.say(INFO, f"opening {_where(config)}")
        try:
            if config.recorder.folder:
                self.recorder = BenchLogRecorder(config, self.get_fully_qualified_name())
            clock = MonotonicClock()
            self.driver = Driver(
                config,
                *open_instruments(config, clock),
                clock,
                on_output=self._take_output,
                recorder=self.recorder,
                on_failure=self._loop_failed,
                feed_timeout_s=FEED_TIMEOUT_s,
                name=self.get_name(),
            )
            self.driver.open()
            _keep_what_is_imported()
            # The loop runs from now on, also while the node is inactive: the watchdog of the supply
            # wants to be fed, and a lost instrument to be found again.
            self.driver.start()
        except (Exception, SystemExit) as error:  # noqa: BLE001 - parts of other packages leave by anything
            self.refusal, self._hopeless = str(error), not isinstance(error, InstrumentError)
            if not isinstance(error, UserError):
                self.refusal = f"{type(error).__name__}: {error}"
                self.log.say(ERROR, traceback.format_exc())
            self.give_up_driver()
            self._topics.publish_status()
            return False
        self.refusal, self._awaited, self._wait_s = "", set(), 0.0
        return True

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish, and accept commands; the current stays off until ~/enable."""
        self.is_active = True
        self.log.say(INFO, f"ready: {_where(self.config)} answer; the output is off until ~/enable")
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Output off; the loop goes on measuring."""
        self.commands.preempt("the node is deactivated")
        if self.driver is not None:
            self.driver.cancel_enable()
        with self.arming:  # so that nothing goes on that was asked for before
            self.is_active = False
        driver = self.driver
        if driver is None:  # instruments that a self-test has had did not come back
            return super().on_deactivate(state)
        try:
            off, words = driver.enable(False, timeout_s=CALL_TIMEOUT_s)
            if not off:
                self.log.say(ERROR, words)
        except DriverStopped as error:
            self.log.say(ERROR, f"the loop did not switch off ({error}); it is ended")
            self.give_up_driver()
            return TransitionCallbackReturn.ERROR
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Output off, instruments given up."""
        self.give_up_driver()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Output off, instruments given up, for good."""
        self.give_up_driver()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Output off after an exception in a transition; the node may be configured again."""
        self.give_up_driver()
        return TransitionCallbackReturn.SUCCESS

    def halt(self) -> tuple[bool, str]:
        """Output off within a second, the log complete; needs no ROS, from any thread, more than once.

        Whether that is not confirmed, and a sentence; "" where no instrument was open.
        """
        self._ended = True
        tested, driver = self.self_testing.end(), self.driver
        found = [tested] if tested is not None else []
        self._let_go()
        if driver is not None:
            found.append((driver.stop(), driver.output_words))
        failed = [words for off, words in found if not off]
        if failed:
            return True, "; ".join(f"{self.get_name()}: {words}; look at the supply" for words in failed)
        return False, f"{self.get_name()}: output off, confirmed by the supply" if found else ""

    def _let_go(self) -> None:
        self.is_active = False
        driver, recorder = self.driver, self.recorder
        if driver is not None:
            driver.stop()
        if recorder is not None:
            recorder.close()

    def give_up_driver(self) -> None:
        """Output off, instruments closed; whether it was read back as off is kept."""
        self._let_go()
        if self.driver is not None:
            self.left_off = self.driver.output_is_off
        self.driver = self.recorder = None

    def _loop_failed(self, error: BaseException) -> None:
        """Called in the control thread, after the supply was shut down."""
        words = self.driver.output_words if self.driver is not None else "the output is off"
        self._on_fatal(f"{self.get_name()}: the control loop ended with {type(error).__name__}: {error}; {words}")


def _where(config: Config) -> str:
    """Where the instruments are, in words."""
    supply, daq = config.instruments.supply, config.instruments.daq
    return f"the supply at {supply.resource} and the DAQ at {daq.resource}"


@functools.cache
def _keep_what_is_imported() -> None:
    """Have the collector pass over all that there is now: looking through it would take milliseconds out of the loop.

    Once in a process: what is kept so is never freed where it refers to itself, and of a later driver nothing is to
    stay.
    """
    gc.freeze()
