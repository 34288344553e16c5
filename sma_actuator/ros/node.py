"""The process of the nodes: command line, threads, signals and the end.

Every node has its control thread (``driver``) and its ROS thread (a single-threaded executor);
``~/enable`` and ``~/stop`` of all have threads of their own (``switch.py``), and the main thread
only waits for signals.  The control thread never calls ROS: outputs are handed over to one more
thread, which publishes those of all wires and wakes an executor only where there is something to say
(``publishing.py``).  Switching the output off never needs ROS, and no message ends the node
(``guard.py``).

``sma_actuator_node --ros-args --params-file FILE``; several wires in one process: ``sma_actuator_node --nodes left
right --ros-args --params-file FILE``, a section of the file each; two of them that turn one joint: ``--nodes left right
--joints joint`` (``joint.py``).
"""

from __future__ import annotations

import argparse
import faulthandler
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions

from sma_actuator.base.commands import NODE_NAME, NODES_NAMES, is_node_name
from sma_actuator.base.interrupts import noted_signals
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.plug_ins import PlugInError
from sma_actuator.base.streams import keep_standard_streams, unblockable_streams

from . import arguments as ros_arguments
from .guard import spinning
from .joint import JointNode
from .publishers import TURN_PERIOD_s
from .switch import Switch
from .wire import SmaActuatorNode

#: Share of the loops' shortest period after which the interpreter passes the GIL on, and the shortest and longest such
#: time.  Its default, 5 ms, would show in the period; and who waits wakes after each, to ask for it: with the shortest,
#: sixteen loops that step together spend an eighth of their processor time on that.
GIL_SHARE, SHORTEST_GIL_s, LONGEST_GIL_s = 0.02, 0.1e-3, 1e-3
#: How often the main thread looks whether a signal was noted.
SIGNAL_INTERVAL_s = 0.05
#: Once the outputs are off and the logs complete the process has so long to end: Fast DDS hangs for ever on a clock
#: before 1970.  It takes half a second; who launched it kills it after ten.
END_s = 5.0


def main(arguments: list[str] | None = None) -> int:
    """Run until a signal comes (exit code 0) or something fatal happens, or an output is not confirmed to be off (1,
    with a sentence on stderr).

    A signal is only noted: whatever it interrupts goes on, and the outputs are switched off by
    this thread, without ROS.
    """
    keep_standard_streams()
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
            sys.setswitchinterval(gil_interval_s(node.config.loop.rate for node in nodes))
            switch = Switch([*nodes, *joints], ros.rclpy)
            gc.collect()
            every: list[SmaActuatorNode | JointNode] = [*nodes, *joints]
            for node in every:
                name = f"{node.get_name()} ROS"
                threads.append(spinning(node, name, node.callback_failed, node.turn, TURN_PERIOD_s))
            while not fatal and not interrupts:
                time.sleep(SIGNAL_INTERVAL_s)  # a signal does not end a sleep; it need not, it is short
        except ConfigError as error:
            fatal += error.problems
        except PlugInError as error:
            fatal += str(error).splitlines()
        except NameValidationException as error:  # of a node that ROS 2 renames
            fatal.append(f"--ros-args: {str(error).splitlines()[0]} {NODES_NAMES}")
        finally:
            sentences = list(fatal)  # what comes after this is a consequence of ending
            sentences += _stop(nodes, joints, threads, switch)
        for sentence in sentences:
            print(f"sma_actuator_node: {sentence}", file=sys.stderr)
    return 1 if sentences else 0


def gil_interval_s(rates_Hz: Iterable[float]) -> float:
    """How long a thread may keep the others of a process from running, whose loops have these rates [s]."""
    return min(max(GIL_SHARE / max(rates_Hz), SHORTEST_GIL_s), LONGEST_GIL_s)


def begin_ros(arguments: list[str]) -> None:
    """Join ROS 2; without a log file where none can be written: a wire can be driven, and switched off, without.

    Raises ConfigError where ROS 2 does not understand the arguments.
    """
    if broken := [argument for argument in arguments if not _is_text(argument)]:
        raise ConfigError(f"--ros-args: {broken[0]!r} is no text")
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


def _is_text(argument: str) -> bool:
    """Whether it can be written as UTF-8, which bytes of a file's name that are none cannot."""
    return argument == argument.encode(errors="ignore").decode()


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
        if not is_node_name(name):
            raise ConfigError(f"--nodes, --joints: {name[:60]!r} is no name of a node: {NODES_NAMES}")
    for name in ros.new_names:
        if not is_node_name(name):
            raise ConfigError(f"-r __node:=…: {name[:60]!r} is no name of a node: {NODES_NAMES}")
    if len(set(names)) != len(names):
        raise ConfigError(f"--nodes, --joints: a name stands twice in {', '.join(names)}")
    if len(names) > 1 and ros.new_names:
        raise ConfigError("-r __node:=…: gives all nodes of this process the same name; name them with --nodes")
    return ros, args.nodes, args.joints


def _stop(
    nodes: list[SmaActuatorNode], joints: list[JointNode], threads: list[threading.Thread], switch: Switch | None
) -> list[str]:
    """All outputs off, at the same time; then ROS, which may hang in itself: then the process ends without it.

    Nothing is done afterwards but to end: what hangs on the way, a thread that is waited for or a library that tidies
    up, hangs for ``END_s``.

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
    faulthandler.dump_traceback_later(END_s, exit=True)  # by a thread that asks Python for nothing
    signal.setitimer(signal.ITIMER_REAL, END_s + 1.0)  # and where Python is gone already, by the system
    for node in nodes:
        node.wake_no_more()
    for joint in joints:
        joint.wake_no_more()
    if switch is not None:
        switch.close()
    rclpy.try_shutdown()
    for thread in threads:
        thread.join(1.0)
    return on


if __name__ == "__main__":
    sys.exit(main())
