"""The edge to ROS 2: a lifecycle node around a driver, thin.

Every node has its control thread (``driver.py``) and its ROS thread (a single-threaded executor);
the main thread only waits for signals.  The control thread never calls ROS: outputs are handed over
by a slot in which the latest wins, and published by the ROS thread.  Switching the output off never
needs ROS.

``sma_actuator_node --ros-args --params-file FILE``; several wires in one process:
``sma_actuator_node --nodes left right --ros-args --params-file FILE``, a section of the file each.
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import math
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from sma_actuator.actuator import Output
from sma_actuator.base.parameters import ConfigError, Declaration, walk
from sma_actuator.base.signals import Mode, Status
from sma_actuator.config import NODE_NAME, Config
from sma_actuator.driver import Driver, DriverStopped
from sma_actuator.instruments import InstrumentError, open_daq, open_supply
from sma_actuator.instruments.clock import MonotonicClock
from sma_actuator.logs.recorder import BenchLogRecorder
from sma_msgs_py import (
    command_current_message,
    diagnostic_status_from,
    joint_state_message,
    load_message,
    position_from,
    reference_message,
    trajectory_from,
)

from . import arguments as ros_arguments

#: Parameters every ROS 2 node has; rclpy gives them their meaning.
ROS_PARAMETERS = ("use_sim_time", "start_type_description_service")
CALL_TIMEOUT_s = 0.6  #: a service waits no longer for the control thread
FEED_PERIOD_s = 0.2
FEED_TIMEOUT_s = 0.9  #: silence of the ROS thread after which the driver switches the wire off
STATUS_PERIOD_s = 1.0
RETRY_PERIOD_s = 1.0
#: Outputs are published at the loop's rate, but not faster than this: at 1 kHz it would take the loop's own time.
LEAST_PUBLISH_PERIOD_s = 5e-3
#: The interpreter passes the GIL on at least this often; its default, 5 ms, would show in the loop's period.
GIL_INTERVAL_s = 0.1e-3
#: How often the main thread looks whether a signal was noted.
SIGNAL_INTERVAL_s = 0.05

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_DEPTH = 10


class _Handoff:
    """The latest output, from the control thread to the ROS thread; the control thread never waits.

    A thread of its own stands between, because waking an executor is a call into ROS.
    """

    def __init__(self, name: str, wake: Callable[[], None]):
        self.latest: Output | None = None
        self._fresh = threading.Event()
        self._wake = wake
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"{name} hand-off", daemon=True)
        self._thread.start()

    def put(self, output: Output) -> None:
        """Replace the latest output."""
        self.latest = output
        self._fresh.set()

    def close(self) -> None:
        """End the thread; afterwards nobody is woken."""
        self._ended.set()
        self._fresh.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.wait(LEAST_PUBLISH_PERIOD_s):
            self._fresh.wait()
            self._fresh.clear()
            if not self._ended.is_set():
                self._wake()


class SmaActuatorNode(LifecycleNode):
    """One wire on ROS 2.

    ``on_fatal(sentence)`` is called, from any thread, when the process should end: the loop has
    ended with an exception, or autostart failed.  Raises ConfigError where the parameters will not do.
    """

    def __init__(self, name: str, arguments: ros_arguments.RosArguments, on_fatal: Callable[[str], None]):
        super().__init__(name)
        self._on_fatal = on_fatal
        self._driver: Driver | None = None
        self._recorder: BenchLogRecorder | None = None
        self._active = False
        self._refusal = ""
        self._monotonic = MonotonicClock()
        self._published: tuple = ()  #: what the last status said
        values = arguments.parameters_of(self.get_fully_qualified_name())
        own = {key: values.pop(key) for key in ROS_PARAMETERS if key in values}
        self.config = Config.from_mapping(values)
        self._declare(own)
        self._make_interface()
        if self.config.autostart:
            self._steady_timer(0.0, self._autostart, once=True)

    # --- parameters -------------------------------------------------------------------------------

    def _declare(self, own: dict[str, Any]) -> None:
        """Declare every parameter with what is known of it, and listen to changes."""
        for name, value in own.items():
            if self.has_parameter(name):
                self.set_parameters([Parameter(name, value=value)])
        self._declarations: dict[str, tuple[Declaration, str]] = {}
        for name, value, declaration, kind in walk(self.config):
            self._declarations[name] = declaration, kind
            if isinstance(value, tuple):
                if not value:
                    continue  # not given; an empty list has no type in ROS
                value = list(value)
            self.declare_parameter(name, value, _descriptor(declaration, kind))
        self.add_pre_set_parameters_callback(self._whole_numbers_to_floats)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)

    def _whole_numbers_to_floats(self, parameters: list[Parameter]) -> list[Parameter]:
        """Accept ``250`` where a float is wanted, as everybody types it."""
        return [
            Parameter(p.name, value=float(p.value))
            if p.type_ is Parameter.Type.INTEGER and self._declarations.get(p.name, (None, ""))[1] == "float"
            else p
            for p in parameters
        ]

    def _changes(self, parameters: list[Parameter]) -> dict[str, Any]:
        return {p.name: p.value for p in parameters if p.name in self._declarations}

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self.config.replace(self._changes(parameters))
        except ConfigError as error:
            return SetParametersResult(successful=False, reason="; ".join(error.problems))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: list[Parameter]) -> None:
        changes = self._changes(parameters)
        if not changes:
            return
        self.config = self.config.replace(changes)
        if self._driver is not None:
            try:
                self._driver.update(self.config, timeout_s=CALL_TIMEOUT_s)
            except (DriverStopped, TimeoutError) as error:
                self.get_logger().error(f"{', '.join(changes)} changed, but not in the loop: {error}")

    # --- topics and services ----------------------------------------------------------------------

    def _make_interface(self) -> None:
        self._joint_states = self.create_lifecycle_publisher(JointState, "~/joint_states", _DEPTH)
        self._load = self.create_lifecycle_publisher(WrenchStamped, "~/load", _DEPTH)
        self._reference = None
        if self.config.reference_sensor.fitted and self.config.instruments.daq.lvdt_channel:
            self._reference = self.create_lifecycle_publisher(JointState, "~/reference", _DEPTH)
        self._command_current = self.create_lifecycle_publisher(Float64, "~/command_current", _DEPTH)
        # The state of the wire is of interest in every state of the node.
        self._status = self.create_publisher(DiagnosticStatus, "~/status", _LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", _DEPTH)

        self.create_subscription(Float64, "~/setpoint", self._on_setpoint, _DEPTH)
        self.create_subscription(JointTrajectory, "~/joint_trajectory", self._on_trajectory, _DEPTH)

        self.create_service(SetBool, "~/enable", self._on_enable)
        for name in ("clear_fault", "reset_estimator", "tare_load", "measure_lead_resistance"):
            self.create_service(Trigger, f"~/{name}", self._trigger(name))

        self._woken = self.create_guard_condition(self._publish)
        self._handoff = _Handoff(self.get_name(), self._woken.trigger)
        self._steady_timer(STATUS_PERIOD_s, self._publish_status)
        self._steady_timer(FEED_PERIOD_s, self._feed)

    def _steady_timer(self, period_s: float, callback: Callable[[], None], once: bool = False) -> None:
        """A timer that also ticks where /clock does not."""

        def run_once() -> None:
            self.destroy_timer(timer)
            callback()

        timer = self.create_timer(
            period_s, run_once if once else callback, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _on_setpoint(self, message: Float64) -> None:
        if not self._active:
            self._warn(f"a setpoint was ignored: {self._not_active()}")
            return
        self._driver.offer_setpoint(position_from(message))

    def _on_trajectory(self, message: JointTrajectory) -> None:
        if not self._active:
            self._warn(f"a trajectory was ignored: {self._not_active()}")
            return
        try:
            times_s, positions_m = trajectory_from(message, self.config.joint_name)
        except ValueError as error:
            self._warn(str(error))
            return
        self._driver.offer_trajectory(times_s, positions_m)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        return self._answer(response, lambda: self._driver.enable(request.data, timeout_s=CALL_TIMEOUT_s))

    def _trigger(self, name: str) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        return lambda _, response: self._answer(response, lambda: getattr(self._driver, name)(timeout_s=CALL_TIMEOUT_s))

    def _answer(self, response: Any, request: Callable[[], tuple]) -> Any:
        """Fill a response with what the actuator says."""
        if not self._active:
            response.success, response.message = False, self._not_active()
            return response
        try:
            response.success, response.message, *_ = request()
        except (DriverStopped, TimeoutError) as error:
            response.success, response.message = False, str(error)
        return response

    def _not_active(self) -> str:
        return f"the node is {self._state_machine.current_state[1]}; configure and activate it first"

    def _warn(self, sentence: str) -> None:
        self.get_logger().warning(sentence, throttle_duration_sec=1.0)

    # --- publishing, in the ROS thread ------------------------------------------------------------

    def _publish(self) -> None:
        output = self._handoff.latest
        if output is None or self._driver is None:
            return
        for refusal in self._driver.refusals():
            self._warn(refusal)
        signals, estimate = output.signals, output.estimate
        if self._active and math.isfinite(signals.time_s):
            stamp = self._stamp(signals.time_s)
            self._joint_states.publish(joint_state_message(self.config.joint_name, estimate, signals, stamp))
            self._load.publish(load_message(self.config.frame_id, signals, stamp))
            if self._reference is not None:
                self._reference.publish(reference_message(self.config.joint_name, signals, stamp))
            self._command_current.publish(command_current_message(output.command))
        status = output.status
        if (status.mode, status.fault, status.limits) != self._published:
            self._publish_status()

    def _stamp(self, time_s: float) -> Any:
        """ROS time at which the monotonic clock of the loop was at ``time_s``."""
        age = Duration(nanoseconds=round(1e9 * (self._monotonic.now_s() - time_s)))
        return (self.get_clock().now() - age).to_msg()

    def _publish_status(self) -> None:
        output = self._handoff.latest if self._driver is not None else None
        if output is not None:
            status = output.status
            self._published = (status.mode, status.fault, status.limits)
        else:
            status = Status(Mode.OFF, message=self._refusal or self._not_active())
        status = dataclasses.replace(status, values={**status.values, **self._health()})
        message = diagnostic_status_from(self.get_fully_qualified_name(), self._hardware_id(), status)
        lost = self._driver.lost_instruments if self._driver is not None else {}
        if lost or (output is None and self._refusal):
            message.level = DiagnosticStatus.ERROR
        if lost:
            message.message = "; ".join(f"the {name} does not answer: {detail}" for name, detail in lost.items())
        self._status.publish(message)
        array = DiagnosticArray(status=[message])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def _health(self) -> dict[str, float | str]:
        """Key values of the node and the loop, for diagnostics."""
        values: dict[str, float | str] = {"lifecycle": self._state_machine.current_state[1]}
        if self._driver is not None:
            statistics = self._driver.statistics()
            values |= {
                name: getattr(statistics, name)
                for name in ("period_mean_s", "period_p99_s", "period_max_s", "overruns")
            }
        if self._recorder is not None:
            values["recorder"] = self._recorder.problem or f"{self._recorder.dropped_rows} rows dropped"
        return values

    def _hardware_id(self) -> str:
        return self._driver.hardware_id if self._driver is not None else ""

    def _feed(self) -> None:
        if self._driver is not None:
            self._driver.feed()

    # --- life -------------------------------------------------------------------------------------

    def _autostart(self) -> None:
        done = self.trigger_configure() == TransitionCallbackReturn.SUCCESS
        if done and self.trigger_activate() == TransitionCallbackReturn.SUCCESS:
            return
        if self.config.wait_for_instruments:
            self.get_logger().warning(f"{self._refusal}; trying again", throttle_duration_sec=10.0)
            # An attempt feeds the watchdog of the supply: it must have the time to cut what a dead program left on.
            period_s = max(RETRY_PERIOD_s, 2.0 * self.config.supply.watchdog_timeout)
            self._steady_timer(period_s, self._autostart, once=True)
        else:
            self._on_fatal(f"{self.get_fully_qualified_name()}: {self._refusal}")

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open instruments and recorder and start the loop; no current can flow yet."""
        self._refusal = ""
        config = self.config
        try:
            if config.recorder.folder:
                self._recorder = BenchLogRecorder(config, self.get_fully_qualified_name())
            clock = MonotonicClock()
            self._driver = Driver(
                config,
                open_supply(config),
                open_daq(config, clock),
                clock,
                on_output=self._handoff.put,
                recorder=self._recorder,
                on_failure=self._loop_failed,
                feed_timeout_s=FEED_TIMEOUT_s,
                name=self.get_name(),
            )
            self._driver.open()
            gc.freeze()  # what was imported stays: looking through it would take milliseconds out of the loop
            # The loop runs from now on, also while the node is inactive: the watchdog of the supply
            # wants to be fed, and a lost instrument to be found again.
            self._driver.start()
        except (InstrumentError, ConfigError) as error:
            self._refusal = str(error)
            self.get_logger().error(self._refusal)
            self._give_up_driver()
            self._publish_status()
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            # rclpy would go on to on_error without a word.
            self._refusal = f"{type(error).__name__}: {error}"
            self.get_logger().error(traceback.format_exc())
            raise
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish, and accept commands; the current stays off until ~/enable."""
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Output off; the loop goes on measuring."""
        self._active = False
        try:
            off, words = self._driver.enable(False, timeout_s=CALL_TIMEOUT_s)
            if not off:
                self.get_logger().error(words)
        except (DriverStopped, TimeoutError) as error:
            self.get_logger().error(f"the loop did not switch off ({error}); it is ended")
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

    def halt(self) -> None:
        """Output off within a second, the log complete; needs no ROS, from any thread, more than once."""
        self._active = False
        driver, recorder = self._driver, self._recorder
        if driver is not None:
            driver.stop()
        if recorder is not None:
            recorder.close()

    def _give_up_driver(self) -> None:
        self.halt()
        self._driver = self._recorder = None

    def _loop_failed(self, error: BaseException) -> None:
        """Called in the control thread, after the supply was shut down."""
        words = self._driver.output_words if self._driver is not None else "the output is off"
        self._on_fatal(f"{self.get_name()}: the control loop ended with {type(error).__name__}: {error}; {words}")

    def wake_no_more(self) -> None:
        """End the hand-off, so that ROS can be shut down."""
        self._handoff.close()


def _descriptor(declaration: Declaration, kind: str) -> ParameterDescriptor:
    unit = f" [{declaration.unit}]" if declaration.unit not in ("", "1") else ""
    descriptor = ParameterDescriptor(
        description=declaration.description + unit,
        additional_constraints=f"one of {', '.join(declaration.choices)}" if declaration.choices else "",
        read_only=not declaration.live,
        # So that a wrong type comes to our own check, which answers in a sentence.
        dynamic_typing=declaration.live,
    )
    finite = math.isfinite(declaration.lo) and math.isfinite(declaration.hi) and not declaration.optional
    if finite and kind == "float":
        descriptor.floating_point_range = [FloatingPointRange(from_value=declaration.lo, to_value=declaration.hi)]
    elif finite and kind == "int":
        descriptor.integer_range = [IntegerRange(from_value=int(declaration.lo), to_value=int(declaration.hi))]
    return descriptor


def _spin(node: SmaActuatorNode, on_fatal: Callable[[str], None]) -> None:
    """Run the callbacks of one node until ROS is shut down."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        executor.spin()
    except ExternalShutdownException:
        pass
    except Exception as error:  # noqa: BLE001 - it must end the process, and say so
        on_fatal(f"{node.get_name()}: {type(error).__name__} in a ROS callback: {error}")


def main(arguments: list[str] | None = None) -> int:
    """Run until a signal comes (exit code 0) or something fatal happens (1, with a sentence on stderr).

    A signal is only noted: whatever it interrupts goes on, and the outputs are switched off by
    this thread, without ROS.
    """
    noted: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _frame: noted.append(number))
    sys.setswitchinterval(GIL_INTERVAL_s)
    fatal: list[str] = []
    nodes: list[SmaActuatorNode] = []
    threads: list[threading.Thread] = []
    try:
        ros, names = _names(sys.argv[1:] if arguments is None else arguments)
        rclpy.init(args=ros.rclpy, signal_handler_options=SignalHandlerOptions.NO)
        for name in names:
            nodes.append(SmaActuatorNode(name, ros, fatal.append))
        gc.collect()
        for node in nodes:
            thread = threading.Thread(
                target=_spin, args=(node, fatal.append), name=f"{node.get_name()} ROS", daemon=True
            )
            thread.start()
            threads.append(thread)
        while not fatal and not noted:
            time.sleep(SIGNAL_INTERVAL_s)  # a signal does not end a sleep; it need not, it is short
    except ConfigError as error:
        fatal += error.problems
    finally:
        sentences = tuple(fatal)  # what is said while everything ends is no reason for ending
        _stop(nodes, threads)
    for sentence in sentences:
        print(f"sma_actuator_node: {sentence}", file=sys.stderr)
    return 1 if sentences else 0


def _names(arguments: list[str]) -> tuple[ros_arguments.RosArguments, list[str]]:
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
    names = parser.parse_args(ros.user).nodes
    if len(set(names)) != len(names):
        raise ConfigError(f"--nodes: a name stands twice in {', '.join(names)}")
    if len(names) > 1 and ros.renames_node:
        raise ConfigError("-r __node:=…: gives all nodes of this process the same name; name them with --nodes")
    return ros, names


def _stop(nodes: list[SmaActuatorNode], threads: list[threading.Thread]) -> None:
    """All outputs off, at the same time; then ROS."""
    if nodes:
        with ThreadPoolExecutor(len(nodes)) as pool:
            list(pool.map(SmaActuatorNode.halt, nodes))
    for node in nodes:
        node.wake_no_more()
    rclpy.try_shutdown()
    for thread in threads:
        thread.join(1.0)


if __name__ == "__main__":
    sys.exit(main())
