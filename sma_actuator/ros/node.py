"""The edge to ROS 2: a lifecycle node around a driver, thin.

Every node has its control thread (``driver.py``) and its ROS thread (a single-threaded executor);
``~/enable`` and ``~/stop`` of all have threads of their own (``switch.py``), and the main thread
only waits for signals.  The control thread never calls ROS: outputs are handed over to a third
thread, which publishes them itself and wakes the executor only where there is something to say
(``publishing.py``).  Switching the output off never needs ROS, and no message ends the node
(``guard.py``).

``sma_actuator_node --ros-args --params-file FILE``; several wires in one process:
``sma_actuator_node --nodes left right --ros-args --params-file FILE``, a section of the file each; two of them that turn
one joint: ``--nodes left right --joints joint`` (``joint.py``).
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import faulthandler
import functools
import gc
import math
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from diagnostic_msgs.srv import SelfTest as SelfTestService
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.srv import ChangeState
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidNodeNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_node_name import validate_node_name
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from sma_actuator.base.commands import NODE_NAME
from sma_actuator.base.interrupts import noted_signals
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Health, Mode, Output, Quality, Status, Tuned
from sma_actuator.base.streams import keep_standard_streams, unblockable_streams
from sma_actuator.check.selftest import Level, SelfTest, passed
from sma_actuator.config import Config
from sma_actuator.control.tuning import words_of
from sma_actuator.driver import Driver, DriverStopped
from sma_actuator.instruments import InstrumentError, open_instruments
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.logs.recorder import BenchLogRecorder
from sma_msgs_py import (
    command_current_message,
    diagnostic_status_from,
    health_status_from,
    joint_command_from,
    joint_state_message,
    load_message,
    position_from,
    reference_message,
    signals_message,
    time_message,
)

from . import arguments as ros_arguments
from .action import FollowJointTrajectoryServer
from .guard import refuse_what_raises, spin
from .joint import JointNode
from .named_signals import named_signals
from .parameters import NO_SIM_TIME, ROS_PARAMETERS, NodeParameters
from .publishing import OUTPUTS_WAITING, Handoff, is_heard
from .switch import Switch, Switchable
from .trajectories import trajectory_of
from .words import ERROR, INFO, WARNING, Events, Refusals

CALL_TIMEOUT_s = 0.6  #: a service waits no longer for the control thread
ENABLE_TIMEOUT_s = 5.0  #: but ``~/enable`` waits for a supply of any speed to confirm it; off of any kind ends that
SELF_TEST_END_s = 2.0  #: a self-test that is to end has done so by then, instruments that answer given
FEED_PERIOD_s = 0.3
FEED_TIMEOUT_s = 0.9  #: silence of the ROS thread after which the driver switches the wire off
STATUS_PERIOD_s = 1.0
RETRY_PERIOD_s = 1.0
#: The interpreter passes the GIL on at least this often; its default, 5 ms, would show in the loop's period.
GIL_INTERVAL_s = 0.1e-3
#: How often the main thread looks whether a signal was noted.
SIGNAL_INTERVAL_s = 0.05
#: ROS has so long to end once the outputs are off and the logs complete: Fast DDS hangs for ever on a clock before 1970.
ROS_END_s = 30.0

LONGEST_JOINT_COMMAND_B = 20_000  #: a command for some hundred joints

_LEVELS = {
    Level.OK: (INFO, DiagnosticStatus.OK),
    Level.WARNING: (WARNING, DiagnosticStatus.WARN),
    Level.WRONG: (ERROR, DiagnosticStatus.ERROR),
}
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_DEPTH = 10
#: Some seconds' worth at the usual rates, for who records them.
_SIGNALS_DEPTH = OUTPUTS_WAITING
_MOST_HAPPENED = 50  #: events kept while nobody listens


class SmaActuatorNode(LifecycleNode):
    """One wire on ROS 2.

    ``on_fatal(sentence)`` is called, from any thread, when the process should end: the loop has
    ended with an exception, or autostart failed.  Raises ConfigError where the parameters will not do.
    """

    def __init__(self, name: str, arguments: ros_arguments.RosArguments, on_fatal: Callable[[str], None]):
        super().__init__(name)
        self._on_fatal = on_fatal
        self._driver: Driver | None = None
        self._self_test: SelfTest | None = None  #: that runs now
        self._self_test_ended = threading.Event()
        self._recorder: BenchLogRecorder | None = None
        self._log_said = ""  #: what was last said of its log
        self._active = False
        self._ended = False  #: for good
        self._left_off = False  #: the last instruments were given up with the output read back as off
        self._arming = threading.Lock()  #: held while the output goes on, and while the node stops being active
        self._refusal = ""  #: why the instruments are not open
        self._hopeless = False  #: and no waiting will help
        self._awaited = ""  #: the refusal that was said
        self._wait_s = 0.0  #: between the last two looks for the instruments
        self._monotonic = MonotonicClock()
        self._published: tuple[Any, ...] = ()  #: what the last status said
        self._told: tuple[Any, ...] = ()  #: what the executor was last woken for
        self._heard: tuple[Any, ...] = ()  #: publishers of what comes with every step, where somebody subscribes to it
        self._looked_s = -math.inf  #: when it was last looked for listeners
        self._status_due_s = -math.inf
        self._events, self._refusals = Events(), Refusals()
        self._tuned: Tuned | None = None  #: gains that a tuning has found and the parameters do not have yet
        self._health_said = Health.UNKNOWN
        self._happened: list[str] = []  #: what no message of ~/signals has told yet
        #: The joint that the wire turns with another gets every output too, in the control thread.
        self.joint_takes: Callable[[Output], None] | None = None
        values = arguments.parameters_of(self.get_fully_qualified_name())
        own = {key: values.pop(key) for key in ROS_PARAMETERS if key in values}
        self._parameters_of_wire = NodeParameters(
            self, Config.from_mapping(values), self._take_over, self._feed, self._current_may_flow
        )
        if own.get("use_sim_time", False) is not False:
            self._say(WARNING, NO_SIM_TIME)
        self._make_interface()
        refuse_what_raises(self, self.report)
        if self.config.autostart:
            self._steady_timer(0.0, self._autostart, once=True)

    @property
    def config(self) -> Config:
        """The parameters as they are now."""
        return self._parameters_of_wire.config

    @property
    def driver(self) -> Driver | None:
        """The loop of the wire; None while no instruments are open."""
        return self._driver

    def _current_may_flow(self) -> bool:
        return self._driver is not None and not self._driver.output_is_off

    def _take_over(self, config: Config, changed: list[str]) -> None:
        if self._driver is None:
            return
        try:
            self._driver.update(config, timeout_s=CALL_TIMEOUT_s)
        except (DriverStopped, TimeoutError) as error:
            self._say(ERROR, f"{', '.join(changed)} changed, but not in the loop yet: {error}")

    # --- topics and services ----------------------------------------------------------------------

    def _make_interface(self) -> None:
        self._joint_states = self.create_lifecycle_publisher(JointState, "~/joint_states", _DEPTH)
        self._load = self.create_lifecycle_publisher(WrenchStamped, "~/load", _DEPTH)
        self._reference = None
        if self.config.reference_sensor.fitted and self.config.instruments.daq.lvdt_channel:
            self._reference = self.create_lifecycle_publisher(JointState, "~/reference", _DEPTH)
        self._command_current = self.create_lifecycle_publisher(Float64, "~/command_current", _DEPTH)
        self._signals = self.create_lifecycle_publisher(JointState, "~/signals", _SIGNALS_DEPTH)
        # The state of the wire is of interest in every state of the node.
        self._status = self.create_publisher(DiagnosticStatus, "~/status", _LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", _DEPTH)

        self.create_subscription(Float64, "~/setpoint", self._on_setpoint, _DEPTH)
        # As bytes: how many there are is looked at first, since making a million points Python objects would hold up the loop.
        self.create_subscription(JointTrajectory, "~/joint_trajectory", self._on_trajectory, _DEPTH, raw=True)
        self.create_subscription(JointState, "~/joint_command", self._on_joint_command, _DEPTH, raw=True)
        for name in ("clear_fault", "reset_estimator", "tare_load", "measure_lead_resistance"):
            self.create_service(Trigger, f"~/{name}", self._trigger(name))
        self.create_service(Trigger, "~/tune", self._on_tune)
        self.create_service(SelfTestService, "~/self_test", self._on_self_test)
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

        self._follow: FollowJointTrajectoryServer | None = None
        with contextlib.suppress(ModuleNotFoundError):  # control_msgs comes with ros2_control
            self._follow = FollowJointTrajectoryServer(self, self, self._monotonic.now_s)
        self._woken = self.create_guard_condition(self._take_news)
        self._handoff = Handoff(self.get_name(), self._publish, self.callback_failed)

    def _steady_timer(self, period_s: float, callback: Callable[[], None], once: bool = False) -> None:
        """A timer that does not follow the system's clock when that is set."""

        def run_once() -> None:
            self.destroy_timer(timer)
            callback()

        timer = self.create_timer(
            period_s, run_once if once else callback, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _on_setpoint(self, message: Float64) -> None:
        driver = self._driver
        if not self._active or driver is None:
            self.report(f"a setpoint was ignored: {self._not_active()}")
            return
        self._preempt("a setpoint has come")
        driver.offer_setpoint(position_from(message))

    def _on_trajectory(self, serialized: bytes) -> None:
        driver = self._driver
        if not self._active or driver is None:
            self.report(f"a trajectory was ignored: {self._not_active()}")
            return
        try:
            trajectory = trajectory_of(serialized, self.config.joint_name, self.get_clock().now().nanoseconds)
        except ValueError as error:
            self.report(str(error))
            return
        self._preempt("another trajectory has come")
        self.offer(*trajectory)

    # --- what the action asks of its node ---------------------------------------------------------

    def refuses_trajectories(self) -> str:
        """Why no goal of the action can be taken now, or ""."""
        driver = self._driver
        if not self._active or driver is None:
            return self._not_active()
        try:
            return "" if _is_driven(driver) else "the output is off; call ~/enable first"
        except (DriverStopped, TimeoutError) as error:
            return str(error)

    def offer(
        self, times_s: list[float], positions_m: list[float], velocities_m_s: list[float] | None, delay_s: float
    ) -> None:
        """Hand a trajectory to the loop; without points the motion ends where its reference has come."""
        if self._driver is not None:
            self._driver.offer_trajectory(times_s, positions_m, velocities_m_s, delay_s)

    def hold(self) -> None:
        """End the motion where the wire is measured to be."""
        if self._driver is not None:
            self._driver.hold()

    def _preempt(self, why: str) -> None:
        if self._follow is not None:
            self._follow.preempt(why)

    # --- commands and services --------------------------------------------------------------------

    def _on_joint_command(self, serialized: bytes) -> None:
        driver = self._driver
        if len(serialized) > LONGEST_JOINT_COMMAND_B:
            self.report(
                f"joint command refused: its message has {len(serialized)} bytes, more than {LONGEST_JOINT_COMMAND_B}"
            )
            return
        try:
            position_m = joint_command_from(deserialize_message(serialized, JointState), self.config.joint_name)
        except ValueError as error:
            self.report(str(error))
            return
        if self._active and driver is not None:
            driver.offer_joint_command(position_m)
        elif math.isfinite(position_m):  # before a controller runs nobody commands anything
            self.report(f"a joint command was ignored: {self._not_active()}")

    @property
    def parts(self) -> Sequence[Switchable]:
        """A wire has none."""
        return ()

    def switch_on(self, wanted: Callable[[], bool] = lambda: True) -> tuple[bool, str]:
        """Output on, if it is ``wanted`` still when its turn has come; whether that was done, and the sentence that says so."""
        if self._self_test is not None:
            return False, "not enabled: a self-test runs; ~/enable false ends it"
        with self._arming:
            return self._asked(lambda driver: driver.enable(True, ENABLE_TIMEOUT_s, wanted))

    def switch_off(self) -> tuple[bool, str]:
        """Output off, in every state of the node and from any thread; whether it is, and the sentence that says so."""
        self_test, driver = self._self_test, self._driver
        if self_test is not None:
            return self._end_self_test(self_test)
        if driver is None:
            if self._left_off:
                return True, "the output is off: the supply said so before it was given up"
            return (
                False,
                "not known: no instruments are open, so nobody can say whether the output is off; look at the supply",
            )
        try:
            return driver.enable(False, timeout_s=CALL_TIMEOUT_s)
        except DriverStopped:
            return driver.output_is_off, f"the loop has ended; {driver.output_words}"

    def _on_self_test(self, _: SelfTestService.Request, response: SelfTestService.Response) -> Any:
        """Test the instruments with a little current, in the ROS thread; the driver gives them up meanwhile."""
        if self._driver is not None:
            self._driver.cancel_enable()
        with self._arming:  # so that nothing goes on that was asked for before
            refusal = self._refuses_self_test()
            if not refusal:
                clock = MonotonicClock()
                self._self_test_ended.clear()
                self._self_test = SelfTest(self.config, *open_instruments(self.config, clock), clock)
        if refusal:
            self.report(refusal)
            status = DiagnosticStatus(level=DiagnosticStatus.ERROR, name="self-test", message=refusal)
            response.passed, response.status = b"\0", [status]
            return response
        assert self._self_test is not None
        self._say(INFO, "a self-test runs: the bias current flows for some seconds")
        try:
            self._give_up_driver()
            found = self._self_test.run()
            response.id = self._self_test.identity
        finally:
            self._left_off = self._self_test.off_confirmed
            self._self_test = None
            self._self_test_ended.set()
            self._go_on()
        for each in found:
            self._say(_LEVELS[each.level][0], f"self-test: {each.part}: {each.sentence}")
        response.passed = b"\1" if passed(found) else b"\0"
        response.status = [
            DiagnosticStatus(
                level=_LEVELS[each.level][1], name=each.part, hardware_id=response.id, message=each.sentence
            )
            for each in found
        ]
        return response

    def _go_on(self) -> None:
        """Have the driver again after a self-test, however long that takes, unless it was brought to another state."""
        state = self._state_machine.current_state[1]
        if self._ended or self._driver is not None or state not in ("active", "inactive"):
            return
        if not self._open_driver():
            self._later(self._go_on)
            return
        self._active = state == "active"
        if self._ended:  # meanwhile
            self._give_up_driver()

    def _refuses_self_test(self) -> str:
        driver = self._driver
        if driver is None:
            return f"no self-test: {self._refusal or self._not_active()}"
        try:
            driven = _is_driven(driver)
        except (DriverStopped, TimeoutError) as error:
            return f"no self-test: {error}"
        if driven or not driver.output_is_off:
            words = "the output is on" if driven else driver.output_words
            return f"no self-test: {words}; switch it off first: ~/enable false"
        return ""

    def _end_self_test(self, self_test: SelfTest) -> tuple[bool, str]:
        """Off while a self-test runs: it ends, with the output off."""
        self_test.abort()
        if not self._self_test_ended.wait(SELF_TEST_END_s):
            return False, "not confirmed: the self-test has not ended yet; it switches the output off"
        words = "the output is off" if self_test.off_confirmed else "the output is told to be off, not confirmed"
        return self_test.off_confirmed, f"{words}; the self-test was ended"

    def _on_tune(self, _: Trigger.Request, response: Trigger.Response) -> Any:
        """Begin to tune the gains; the answer is that it has begun, the status says how far it is."""
        self._answer(response, lambda driver: driver.tune(timeout_s=CALL_TIMEOUT_s))
        if response.success:
            self._preempt("the gains are tuned")
            self._say(INFO, response.message)
        return response

    def _take_tuned(self) -> None:
        """Make gains that a tuning has found those of the node, as if somebody had set them."""
        tuned, self._tuned = self._tuned, None
        if tuned is None:
            return
        found = [Parameter(f"controller.{name}", value=value) for name, value in tuned.gains.items()]
        result = self.set_parameters_atomically(found)
        if result.successful:
            words = f"tuned: {words_of(tuned.gains)}, before: {words_of(tuned.before)}"
            self._say(INFO, f"{words}; they hold until the node ends, unless they are written to its parameter file")
        else:
            self._say(ERROR, f"tuned, and the gains were not taken over: {result.reason}")

    def _trigger(self, name: str) -> Callable[[Trigger.Request, Trigger.Response], Any]:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Any:
            self._answer(response, lambda driver: getattr(driver, name)(timeout_s=CALL_TIMEOUT_s))
            if response.success and name != "clear_fault":  # of which the log tells by itself
                self._say(INFO, response.message)
            return response

        return answer

    def _answer(self, response: Any, request: Callable[[Driver], tuple[Any, ...]]) -> Any:
        """Fill a response with what the actuator says."""
        response.success, response.message = self._asked(request)
        if not response.success:
            self.report(response.message)
        return response

    def _asked(self, request: Callable[[Driver], tuple[Any, ...]]) -> tuple[bool, str]:
        """What the actuator says to a request, where it can be asked."""
        driver = self._driver
        if not self._active or driver is None:
            return False, self._not_active()
        try:
            done, words, *_ = request(driver)
        except (DriverStopped, TimeoutError) as error:
            return False, str(error)
        return done, words

    def _not_active(self) -> str:
        state = self._state_machine.current_state[1]
        if state == "active":  # and yet it takes no commands
            return f"trying to open the instruments again: {self._refusal}" if self._refusal else "the node ends"
        what = {"unconfigured": "configure and activate it first", "inactive": "activate it first"}.get(state, "")
        return f"the node is {state}" + (f"; {what}" if what else "")

    # --- words ------------------------------------------------------------------------------------

    def report(self, sentence: str) -> None:
        """Say why something was refused; the same again and again only now and then."""
        sentence = self._refusals.worth_saying(sentence, self._monotonic.now_s())
        if sentence:
            self._say(WARNING, sentence)

    def _say(self, level: str, sentence: str) -> None:
        logger = self.get_logger()  # which wants a place of its own for each level
        if level == ERROR:
            logger.error(sentence)
        elif level == WARNING:
            logger.warning(sentence)
        else:
            logger.info(sentence)

    def callback_failed(self, error: Exception) -> None:
        """Take an exception that no message is to blame for as a fault: the output goes off, the node goes on."""
        words = f"{type(error).__name__} in a ROS callback: {error}"
        trace = "".join(traceback.format_exception(error))
        if self._driver is not None:  # before a word is said: what failed may be what says it
            self._driver.submit(lambda actuator, now_s: actuator.raise_fault(now_s, "unhandled_exception", words))
        self.report(f"{words}\n{trace}")

    # --- publishing: what flows in the thread of the hand-over, what is said in the ROS thread ------

    def _take_output(self, output: Output) -> None:
        """Hand an output over, in the control thread: to be published where anybody listens, or where it is news."""
        if self.joint_takes is not None:
            self.joint_takes(output)
        if output.tuned is not None:
            self._tuned = output.tuned
        self._handoff.put(output, bool(self._heard) or bool(output.events) or self._is_news(output))

    def _in_short(self, output: Output) -> tuple[Any, ...]:
        """What of an output is said in words."""
        status, driver = output.status, self._driver
        lost = driver.lost_instruments if driver is not None else ()
        return (status.mode, status.fault, status.limits, output.health.state, *lost)

    def _is_news(self, output: Output) -> bool:
        """Whether the ROS thread has something to do for it."""
        driver, follow = self._driver, self._follow
        asked = (driver is not None and driver.has_refusals) or (follow is not None and follow.pursues)
        return asked or self._in_short(output) != self._told

    def _publish(self, output: Output, waiting: Sequence[Output]) -> None:
        """Publish the latest output, and of all that have come the signals; have said what is new in it."""
        driver = self._driver
        if driver is None:
            return
        signals, estimate, heard = output.signals, output.estimate, self._heard
        if self._active and math.isfinite(signals.time_s):
            stamp, name = self.stamp(signals.time_s), self.config.joint_name
            known = estimate.quality is not Quality.INVALID  # silence rather than a position that nobody knows
            if known and self._joint_states in heard:
                self._joint_states.publish(joint_state_message(name, estimate, signals, stamp))
            if self._load in heard:
                self._load.publish(load_message(self.config.frame_id, signals, stamp))
            if self._reference is not None and self._reference in heard:
                self._reference.publish(reference_message(name, signals, stamp))
            if self._command_current in heard:
                self._command_current.publish(command_current_message(output.command))
        self._publish_signals(waiting)
        if self._is_news(output):
            self._told = self._in_short(output)
            self._woken.trigger()

    def _publish_signals(self, waiting: Sequence[Output]) -> None:
        """Every output that waits, once; nothing is lost where this thread was held up for a while."""
        wanted = self._active and self._signals in self._heard
        for output in waiting:
            self._happened += output.events
            if wanted and output.reading is not None and math.isfinite(output.reading.time_s):
                happened, self._happened = "; ".join(self._happened), []
                stamp = self.stamp(output.reading.time_s)
                self._signals.publish(signals_message(named_signals(output), happened, stamp))
        del self._happened[:-_MOST_HAPPENED]

    def _take_news(self) -> None:
        """Say what is new in the latest output."""
        output, driver = self._handoff.latest, self._driver
        if output is None or driver is None:
            return
        for refusal in driver.refusals():
            self.report(refusal)
        if self._follow is not None:
            self._follow.watch(output)
        status = output.status
        now_s = self._monotonic.now_s()
        for level, sentence in self._events.of_status(status, now_s):
            self._say(level, sentence)
        for level, sentence in self._events.of_instruments(driver.lost_instruments, status.fault):
            self._say(level, sentence)
        if output.health.state is not self._health_said:
            self._health_said = output.health.state
            self._say(WARNING if self._health_said is Health.DUE else INFO, f"model health: {output.health.words}")
        if (status.mode, status.fault, status.limits) != self._published:
            self._publish_status()

    def stamp(self, time_s: float) -> Time:
        """ROS time at which the monotonic clock of the loop was at ``time_s``.

        ROS time is the system's, since a simulated one is refused; rclpy's own clock takes ten times as long to ask.
        """
        return time_message(time.time_ns() - round(1e9 * (self._monotonic.now_s() - time_s)))

    def _publish_status(self) -> None:
        self._take_tuned()  # who reads that the tuning is done finds its gains
        driver = self._driver
        output = self._handoff.latest if driver is not None else None
        if output is not None:
            status = output.status
            self._published = (status.mode, status.fault, status.limits)
        else:
            words = "no reading has come yet" if self._active else self._not_active()
            status = Status(Mode.OFF, message=self._refusal or words)
            if driver is None and not self._left_off:
                status.values["output"] = "not known: look at the supply"
        if output is not None and not self._active:
            status = dataclasses.replace(status, message=f"{status.message}; {self._not_active()}")
        status = dataclasses.replace(status, values={**status.values, **self._key_values()})
        message = diagnostic_status_from(self.get_fully_qualified_name(), self._hardware_id(), status)
        lost = driver.lost_instruments if driver is not None else {}
        if lost or (output is None and self._refusal):
            message.level = DiagnosticStatus.ERROR
        if lost:
            message.message = "; ".join(f"the {name} does not answer: {detail}" for name, detail in lost.items())
        if self._recorder is not None and (self._recorder.problem or self._recorder.lost_rows):
            message.level = max(message.level, DiagnosticStatus.WARN)  # both are one byte
            message.message += f"; bench log: {status.values['recorder']}"
        self._status.publish(message)
        if not is_heard(self._diagnostics):
            return
        array = DiagnosticArray(status=[message])
        if output is not None:
            name = f"{self.get_fully_qualified_name()}: model health"
            health = health_status_from(name, self.config.joint_name, output.health, output.signals.time_s)
            array.status.append(health)
        array.header.stamp = time_message(time.time_ns())
        self._diagnostics.publish(array)

    def _key_values(self) -> dict[str, float | str]:
        """Key values of the node and the loop, for diagnostics."""
        values: dict[str, float | str] = {"lifecycle": self._state_machine.current_state[1]}
        if self._driver is not None:
            statistics = self._driver.statistics()
            values |= {
                name: getattr(statistics, name)
                for name in (
                    "period_mean_s",
                    "period_p99_s",
                    "period_max_s",
                    "overruns",
                    "late_answers",
                    "slowest_answer_s",
                )
            }
        if self._recorder is not None:
            words, lost = self._recorder.words, f"{self._recorder.lost_rows} rows lost"
            values["recorder"] = f"{words}; {lost}" if words else lost
        return values

    def _hardware_id(self) -> str:
        return self._driver.hardware_id if self._driver is not None else ""

    def _feed(self) -> None:
        """Say to the loop that ROS lives."""
        if self._driver is not None and self._handoff.moves():
            self._driver.feed()

    def turn(self) -> None:
        """What the ROS thread does between callbacks, at the latest after ``FEED_PERIOD_s``.

        Timers would have the executor look through all that the node has, twice for each.
        """
        self._feed()
        now_s = self._monotonic.now_s()
        if now_s - self._looked_s >= FEED_PERIOD_s:
            self._looked_s = now_s
            flowing = (self._joint_states, self._load, self._reference, self._command_current, self._signals)
            self._heard = tuple(each for each in flowing if each is not None and is_heard(each))
            self._look_at_the_log()
        if now_s >= self._status_due_s - 0.5 * FEED_PERIOD_s:  # the next turn may be further from it
            self._status_due_s = max(self._status_due_s + STATUS_PERIOD_s, now_s)
            self._take_news()  # what goes on without being new is noted as well, so that it is not said again
            self._publish_status()

    def _look_at_the_log(self) -> None:
        """Say what has become of the bench log, and that it is written again."""
        words = self._recorder.words if self._recorder is not None else ""
        if words != self._log_said:
            self._log_said = words
            self._say(WARNING if words else INFO, words or "the bench log is written")
            self._publish_status()

    # --- life -------------------------------------------------------------------------------------

    def _on_change_state(self, request: ChangeState.Request, response: ChangeState.Response) -> Any:
        """Refuse a transition that the state does not have, in words; rclpy would raise."""
        wanted = request.transition.label or request.transition.id
        possible = self._transitions()
        if wanted not in possible and wanted not in possible.values():
            state = self._state_machine.current_state[1]
            names = ", ".join(f"{label} ({number})" for number, label in possible.items())
            self.report(f"~/change_state: the node is {state}; '{wanted}' is not one of {names}")
            response.success = False
            return response
        response = self._change_state(request, response)
        self._publish_status()
        return response

    def _transitions(self) -> dict[int, str]:
        return {number: label for number, label, *_ in self._state_machine.available_transitions}

    def _autostart(self) -> None:
        """Configure and activate, from whatever state the node was brought to meanwhile."""
        state = self._state_machine.current_state[1]
        if state == "unconfigured" and self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            state = "inactive"
        if state == "inactive":
            self.trigger_activate()
        if state != "unconfigured":
            self._publish_status()
            return
        if self.config.wait_for_instruments and not self._hopeless:
            self._later(self._autostart)
        else:
            self._on_fatal(f"{self.get_fully_qualified_name()}: {self._refusal}")

    def _later(self, attempt: Callable[[], None]) -> None:
        """Look for the instruments again, more and more rarely; why they are waited for is said once."""
        if self._refusal != self._awaited:
            self._awaited = self._refusal
            self._say(WARNING, f"waiting for the instruments: {self._refusal}; looking again until they are there")
        longest_s = max(RETRY_PERIOD_s, self.config.instruments.reconnect_backoff_max)
        self._wait_s = min(max(RETRY_PERIOD_s, 2.0 * self._wait_s), longest_s)
        # An attempt feeds the watchdog of the supply: it must have the time to cut what a dead program left on.
        self._steady_timer(max(self._wait_s, 2.0 * self.config.supply.watchdog_timeout), attempt, once=True)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open instruments and recorder and start the loop; no current can flow yet."""
        try:
            if not self._open_driver():
                config = self.config
                if not (config.autostart and config.wait_for_instruments):  # who waits for them says so himself
                    self._say(ERROR, self._refusal)
                return TransitionCallbackReturn.FAILURE
        except Exception as error:
            # rclpy would go on to on_error without a word.
            self._refusal = f"{type(error).__name__}: {error}"
            self._say(ERROR, traceback.format_exc())
            raise
        return super().on_configure(state)

    def _open_driver(self) -> bool:
        """Whether instruments and recorder could be opened and the loop runs; else ``_refusal`` says why not."""
        self._refusal, self._hopeless = "", False
        self._left_off = False
        config = self.config
        if not self._wait_s:
            self._say(INFO, f"opening {_where(config)}")
        try:
            if config.recorder.folder:
                self._recorder = BenchLogRecorder(config, self.get_fully_qualified_name())
            clock = MonotonicClock()
            self._driver = Driver(
                config,
                *open_instruments(config, clock),
                clock,
                on_output=self._take_output,
                recorder=self._recorder,
                on_failure=self._loop_failed,
                feed_timeout_s=FEED_TIMEOUT_s,
                name=self.get_name(),
            )
            self._driver.open()
            _keep_what_is_imported()
            # The loop runs from now on, also while the node is inactive: the watchdog of the supply
            # wants to be fed, and a lost instrument to be found again.
            self._driver.start()
        except (InstrumentError, ConfigError) as error:
            self._refusal, self._hopeless = str(error), isinstance(error, ConfigError)
            self._give_up_driver()
            self._publish_status()
            return False
        self._awaited, self._wait_s = "", 0.0
        return True

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish, and accept commands; the current stays off until ~/enable."""
        self._active = True
        self._say(INFO, f"ready: {_where(self.config)} answer; the output is off until ~/enable")
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Output off; the loop goes on measuring."""
        self._preempt("the node is deactivated")
        if self._driver is not None:
            self._driver.cancel_enable()
        with self._arming:  # so that nothing goes on that was asked for before
            self._active = False
        driver = self._driver
        if driver is None:  # instruments that a self-test has had did not come back
            return super().on_deactivate(state)
        try:
            off, words = driver.enable(False, timeout_s=CALL_TIMEOUT_s)
            if not off:
                self._say(ERROR, words)
        except DriverStopped as error:
            self._say(ERROR, f"the loop did not switch off ({error}); it is ended")
            self._give_up_driver()
            return TransitionCallbackReturn.ERROR
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Output off, instruments given up."""
        self._give_up_driver()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Output off, instruments given up, for good."""
        self._give_up_driver()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Output off after an exception in a transition; the node may be configured again."""
        self._give_up_driver()
        return TransitionCallbackReturn.SUCCESS

    def halt(self) -> tuple[bool, str]:
        """Output off within a second, the log complete; needs no ROS, from any thread, more than once.

        Whether that is not confirmed, and a sentence; "" where no instrument was open.
        """
        self._ended = True
        self_test, driver = self._self_test, self._driver
        found = [self._end_self_test(self_test)] if self_test is not None else []
        self._let_go()
        if driver is not None:
            found.append((driver.stop(), driver.output_words))
        failed = [words for off, words in found if not off]
        if failed:
            return True, "; ".join(f"{self.get_name()}: {words}; look at the supply" for words in failed)
        return False, f"{self.get_name()}: output off, confirmed by the supply" if found else ""

    def _let_go(self) -> None:
        self._active = False
        driver, recorder = self._driver, self._recorder
        if driver is not None:
            driver.stop()
        if recorder is not None:
            recorder.close()

    def _give_up_driver(self) -> None:
        self._let_go()
        if self._driver is not None:
            self._left_off = self._driver.output_is_off
        self._driver = self._recorder = None

    def _loop_failed(self, error: BaseException) -> None:
        """Called in the control thread, after the supply was shut down."""
        words = self._driver.output_words if self._driver is not None else "the output is off"
        self._on_fatal(f"{self.get_name()}: the control loop ended with {type(error).__name__}: {error}; {words}")

    def wake_no_more(self) -> None:
        """End the hand-off, so that ROS can be shut down."""
        self._handoff.close()


def main(arguments: list[str] | None = None) -> int:
    """Run until a signal comes (exit code 0) or something fatal happens, or an output is not confirmed to be off (1, with a
    sentence on stderr).

    A signal is only noted: whatever it interrupts goes on, and the outputs are switched off by
    this thread, without ROS.
    """
    keep_standard_streams()
    sys.setswitchinterval(GIL_INTERVAL_s)
    fatal: list[str] = []
    nodes: list[SmaActuatorNode] = []
    joints: list[JointNode] = []
    threads: list[threading.Thread] = []
    switch: Switch | None = None
    if os.isatty(sys.stderr.fileno()):
        os.environ.setdefault("RCUTILS_COLORIZED_OUTPUT", "1")  # ROS 2 will see no terminal
    with unblockable_streams(), noted_signals() as interrupts:
        try:
            ros, names, names_of_joints = named(sys.argv[1:] if arguments is None else arguments)
            begin_ros(ros.rclpy)
            nodes += [SmaActuatorNode(name, ros, fatal.append) for name in names]
            joints += [JointNode(name, ros, nodes) for name in names_of_joints]
            switch = Switch([*nodes, *joints], ros.rclpy)
            gc.collect()
            every: list[SmaActuatorNode | JointNode] = [*nodes, *joints]
            for node in every:
                how = (node, node.callback_failed, node.turn, FEED_PERIOD_s)
                threads.append(threading.Thread(target=spin, args=how, daemon=True))
                threads[-1].name = f"{node.get_name()} ROS"
                threads[-1].start()
            while not fatal and not interrupts:
                time.sleep(SIGNAL_INTERVAL_s)  # a signal does not end a sleep; it need not, it is short
        except ConfigError as error:
            fatal += error.problems
        finally:
            sentences = list(fatal)  # what comes after this is a consequence of ending
            sentences += _stop(nodes, joints, threads, switch)
        for sentence in sentences:
            print(f"sma_actuator_node: {sentence}", file=sys.stderr)
    return 1 if sentences else 0


def _where(config: Config) -> str:
    """Where the instruments are, in words."""
    supply, daq = config.instruments.supply, config.instruments.daq
    return f"the supply at {supply.resource} and the DAQ at {daq.resource}"


def _is_driven(driver: Driver) -> bool:
    """Whether a wire is driven.  The loop itself is asked: its last output may be of before an ~/enable that was answered."""
    return bool(driver.call(lambda actuator, _: actuator.is_driven, CALL_TIMEOUT_s))


@functools.cache
def _keep_what_is_imported() -> None:
    """Have the collector pass over all that there is now: looking through it would take milliseconds out of the loop.

    Once in a process: what is kept so is never freed where it refers to itself, and of a later driver nothing is to stay.
    """
    gc.freeze()


def begin_ros(arguments: list[str]) -> None:
    """Join ROS 2; without a log file where none can be written: a wire can be driven, and switched off, without.

    Raises ConfigError where ROS 2 does not understand the arguments.
    """
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as error:
        raise ConfigError(f"--ros-args: ROS 2 does not know {error}") from None
    except rclpy_implementation.RCLError as error:
        if "logging" not in str(error):
            what = str(error).removeprefix("failed to initialize rcl: ").partition(". Error:")[0]
            raise ConfigError(
                f"--ros-args: ROS 2 refuses them: {what}. A name has letters, digits and _ and begins with no digit; "
                "write -r __node:=name, -r __ns:=/robot, -r from:=to"
            ) from None
        print(f"sma_actuator_node: going on without a log file of ROS 2: {error}", file=sys.stderr)
        rclpy.try_shutdown()
        without = ["--ros-args", *arguments[1:], "--disable-external-lib-logs"]
        rclpy.init(args=without, signal_handler_options=SignalHandlerOptions.NO)


def named(arguments: list[str]) -> tuple[ros_arguments.RosArguments, list[str], list[str]]:
    """The command line taken apart, and the names of the wires' nodes and of the joints'.  Raises ConfigError."""
    ros = ros_arguments.parse(arguments)
    parser = argparse.ArgumentParser(
        prog="sma_actuator_node",
        description="Hold shape memory alloy wires at positions, over ROS 2.",
        epilog="ROS arguments follow --ros-args: --params-file FILE, -p name:=value, -r from:=to",
    )
    parser.add_argument(
        "--nodes",
        nargs="+",
        metavar="NAME",
        default=[NODE_NAME],
        help="one node (and wire) for each name, in this process",
    )
    parser.add_argument(
        "--joints", nargs="+", metavar="NAME", default=[], help="a node for each joint that two of those wires turn"
    )
    args = parser.parse_args(ros.user)
    names = [*args.nodes, *args.joints]
    for name in names:
        try:
            validate_node_name(name)
        except InvalidNodeNameException:
            raise ConfigError(
                f"--nodes, --joints: {name[:60]!r} is no name of a node: letters, digits and _ are wanted, no digit first, "
                "255 characters at the most"
            ) from None
    if len(set(names)) != len(names):
        raise ConfigError(f"--nodes, --joints: a name stands twice in {', '.join(names)}")
    if len(names) > 1 and ros.renames_node:
        raise ConfigError("-r __node:=…: gives all nodes of this process the same name; name them with --nodes")
    return ros, args.nodes, args.joints


def _stop(
    nodes: list[SmaActuatorNode], joints: list[JointNode], threads: list[threading.Thread], switch: Switch | None
) -> list[str]:
    """All outputs off, at the same time; then ROS, which may hang in itself: then the process ends without it.

    Sentences about outputs that were not confirmed to be off.
    """
    on: list[str] = []
    if nodes:
        with ThreadPoolExecutor(len(nodes)) as pool:
            for failed, sentence in pool.map(SmaActuatorNode.halt, nodes):
                if failed:
                    on.append(sentence)
                elif sentence:
                    print(f"sma_actuator_node: {sentence}", file=sys.stderr)
    faulthandler.dump_traceback_later(ROS_END_s, exit=True)  # by a thread that asks Python for nothing
    for node in nodes:
        node.wake_no_more()
    for joint in joints:
        joint.wake_no_more()
    if switch is not None:
        switch.close()
    rclpy.try_shutdown()
    for thread in threads:
        thread.join(1.0)
    faulthandler.cancel_dump_traceback_later()
    return on


if __name__ == "__main__":
    sys.exit(main())
