"""The main job, to be seen: a wire of the virtual bench, held by the node, commanded by this process.

Three processes, as on a robot: the bench (two SCPI instruments over TCP), the node, and this one,
which sends setpoints and shows what comes back over ROS 2.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pyvisa
import yaml
from rich.console import Console
from rich.live import Live
from rich.table import Table

from sma_actuator.base.commands import NODE_NAME
from sma_actuator.base.errors import without_ros
from sma_actuator.base.interrupts import Interrupts, noted_signals
from sma_actuator.base.jit import COMPILING
from sma_actuator.base.joining import beside_a_node
from sma_actuator.base.options import number_within
from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.base.parent import end_with
from sma_actuator.base.share import shared_file
from sma_actuator.bench.real import PHYSICS, physics_name
from sma_actuator.config import Config
from sma_actuator.console import add_output_arguments, refuse_to_overwrite, results, say_next, write_json
from sma_actuator.control.setpoints import Setpoint, sine, steps, triangle
from sma_actuator.control.tracking import TrackingErrors
from sma_actuator.instruments import InstrumentError
from sma_actuator.plant.worlds import HOME

#: How long a process may take to be ready: the first start on a machine compiles its kernels, and the machine may be
#: busy.
READY_TIMEOUT_s = 600.0
STOP_TIMEOUT_s = 5.0
ANSWER_TIMEOUT_s = 5.0
SILENT_s = 2.0  #: after which what was told last is not shown as what is so
_STEPS_WAITING = 10  #: of which one of two messages has come
SETPOINT_PERIOD_s = 0.05
DWELL, PERIOD = 1.2, 3.6  #: of a step and a wave, in time constants of the wire: 6 and 18 s of the thesis's
SETTLING_s = 2.0  #: after this the first setpoint counts in the errors
PICTURES_Hz = 5
BAR_WIDTH = 48


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator demo``."""
    parser.add_argument("--wire", choices=("flexinol", "furukawa", "coil"), default="flexinol", help="wire and model")
    parser.add_argument(
        "--physics",
        type=physics_name,
        default=HOME,
        metavar="NAME",
        help=f"of the bench: {PHYSICS} (default %(default)s)",
    )
    parser.add_argument("--load", help="as for the bench: weight:N, spring:N/m,N (default: its own)")
    parser.add_argument(
        "--duration",
        type=number_within(0.0),
        default=60.0,
        metavar="S",
        help="seconds to run; 0: until Ctrl-C (default %(default)s)",
    )
    parser.add_argument("--seed", type=number_within(0, kind=int), default=0, help="seed of the bench's noise")
    parser.add_argument("--view", action="store_true", help="also serve the page of the node, and print its address")
    add_output_arguments(parser, "the errors")


def run(args) -> int:
    """Run the demonstration; 0 when the wire was driven and the output is off at the end."""
    refuse_to_overwrite(args)
    try:
        import rclpy  # noqa: F401 - before bench and node are started
    except ModuleNotFoundError as error:
        raise without_ros(error) from None
    console = results(args)
    parameters = read_parameter_file(shared_file(f"config/{args.wire}.yaml"))
    with noted_signals() as interrupts, _folder() as folder, contextlib.ExitStack() as stack:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        ports_file = Path(folder) / "ports.json"
        bench = stack.enter_context(
            _process("virtual bench", _bench_command(args, ports_file), Path(folder) / "bench.log", console)
        )
        ports = _wait_for_ports(ports_file, bench, interrupts)
        for instrument in ("supply", "daq"):
            parameters["instruments"][instrument]["resource"] = f"TCPIP::127.0.0.1::{ports[instrument]}::SOCKET"
        config = Config.from_mapping(parameters)
        parameter_file = Path(folder) / "node.yaml"
        parameter_file.write_text(yaml.safe_dump({NODE_NAME: {"ros__parameters": {**parameters, "autostart": True}}}))
        node = stack.enter_context(
            _process(
                "node",
                [sys.executable, "-m", "sma_actuator.ros.node", "--ros-args", "--params-file", str(parameter_file)],
                Path(folder) / "node.log",
                console,
            )
        )
        children = [bench, node]
        if args.view:
            command = [sys.executable, "-m", "sma_actuator", "view", "--quiet", "--port", "0"]
            children.append(stack.enter_context(_process("page", command, Path(folder) / "view.log", console)))
            console.print(f"open {_address_of(children[-1], interrupts)}", soft_wrap=True)
        errors = TrackingErrors(config.wire.full_stroke_m)
        _drive(config, args.duration, errors, console, children, interrupts)
        node.stop()
        supply_is_off = _supply_is_off(config)
    console.print(str(errors))
    if args.physics != HOME:
        console.print(f"the model is of a wire in '{HOME}', not in '{args.physics}': identify one of this wire")
    console.print(
        f"supply output {'off' if supply_is_off else 'STILL ON'}; node and bench have ended"
        + (f" ({_words_of(interrupts.number)})" if interrupts else "")
    )
    write_json(args, errors.as_dict())
    say_next(args, 'drive it yourself: "Drive a wire" in README.md; a wire of your own: docs/first_wire.md')
    return 0 if supply_is_off and (errors.samples or interrupts) else 1


def _bench_command(args, ports_file: Path) -> list[str]:
    """What starts the virtual bench."""
    command = [sys.executable, "-m", "sma_actuator", "bench", "--wire", args.wire, "--physics", args.physics]
    command += ["--load", args.load] if args.load else []
    command += ["--seed", str(args.seed), "--supply-port", "0", "--daq-port", "0"]
    return [*command, "--ports-file", str(ports_file)]


def _words_of(number: int) -> str:
    return "Ctrl-C" if number == signal.SIGINT else str(signal.strsignal(number))


def _program(ends_m: tuple[float, float], lag_s: float, duration_s: float) -> Setpoint:
    """Steps for the first half, then a sine, then a triangle, within what the wire reaches and as slow as it is."""
    lo, hi = ends_m
    middle, half = (lo + hi) / 2.0, 0.4 * (hi - lo)
    duration_s = duration_s if duration_s > 0.0 else 90.0
    dwell_s, period_s = DWELL * lag_s, PERIOD * lag_s
    ups_and_downs = steps([middle + x * half for x in (0.6, -0.4, 0.2, -0.8, 0.8, 0.0)], dwell_s)
    wave, ramp = sine(middle, half, period_s), triangle(middle, half, period_s)

    def position_m(time_s: float) -> float:
        part = (time_s % duration_s) / duration_s
        if part < 0.5:
            return ups_and_downs(time_s)
        return wave(time_s) if part < 0.75 else ramp(time_s)

    return position_m


def _drive(
    config: Config, duration_s: float, errors: TrackingErrors, console: Console, children, interrupts: Interrupts
) -> None:
    """Be the third process: enable the node, send setpoints, show what it publishes; until a signal is noted."""
    # Imported here: rclpy belongs to the extra 'ros', and --help must not need it.
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(args=beside_a_node(), signal_handler_options=SignalHandlerOptions.NO)
    try:
        client = _Client(config, errors)
        client.enable(children, interrupts)
        program = _program(client.ends_m, config.estimator.thermal_time_constant, duration_s)
        start = next_setpoint = time.monotonic()
        next_picture = start
        with (
            Live(console=console, refresh_per_second=PICTURES_Hz)
            if console.is_terminal
            else contextlib.nullcontext() as live
        ):
            while not interrupts and (elapsed := time.monotonic() - start) < (duration_s or math.inf):
                for child in children:
                    child.check()
                client.spin_until(next_setpoint)
                client.send(program(elapsed), counts=elapsed > SETTLING_s)
                next_setpoint += SETPOINT_PERIOD_s
                if time.monotonic() >= next_picture:
                    if live is not None:
                        live.update(client.picture(elapsed))
                    else:
                        print(client.line(elapsed), flush=True)
                    next_picture += 1.0 / PICTURES_Hz if live is not None else 1.0
        client.destroy()
    finally:
        rclpy.try_shutdown()


class _Client:
    """What any ROS 2 program does with the node: subscribe, enable, send setpoints."""

    def __init__(self, config: Config, errors: TrackingErrors):
        from diagnostic_msgs.msg import DiagnosticStatus
        from geometry_msgs.msg import WrenchStamped
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.node import Node
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64
        from std_srvs.srv import SetBool

        self._config = config
        self._errors = errors
        self._float64 = Float64
        self._request = SetBool.Request(data=True)
        self._latest = dict.fromkeys(("setpoint", "estimate", "measured", "load", "current"), math.nan)
        self._waiting: dict[tuple[int, int], dict[str, float]] = {}  #: of a time, what came of it
        self._counts = False
        self._told = "no status yet"
        self.ends_m = config.model.build(config.wire).displacement_range_m  #: until the node says them of its load
        self._heard_s = time.monotonic()
        self._node = Node("sma_demo")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        prefix = f"/{NODE_NAME}"
        subscribe = self._node.create_subscription
        subscribe(JointState, f"{prefix}/joint_states", self._on_estimate, 10)
        subscribe(JointState, f"{prefix}/reference", self._on_reference, 10)
        subscribe(WrenchStamped, f"{prefix}/load", self._on_load, 10)
        subscribe(Float64, f"{prefix}/command_current", lambda m: self._latest.update(current=m.data), 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        subscribe(DiagnosticStatus, f"{prefix}/status", self._on_status, latched)
        self._setpoint = self._node.create_publisher(Float64, f"{prefix}/setpoint", 10)
        self._enable = self._node.create_client(SetBool, f"{prefix}/enable")

    def _on_estimate(self, message) -> None:
        self._latest["estimate"] = message.position[0]
        self._judge(message, estimate_m=message.position[0])

    def _on_reference(self, message) -> None:
        self._latest["measured"] = message.position[0]
        self._judge(message, measured_m=message.position[0])

    def _judge(self, message, **position_m: float) -> None:
        """Estimate and truth of the same time belong together, whichever is handled first."""
        time = message.header.stamp.sec, message.header.stamp.nanosec
        both = self._waiting.pop(time, {}) | position_m
        if len(both) < 2:
            self._waiting = {**dict(list(self._waiting.items())[-_STEPS_WAITING:]), time: both}
        elif self._counts:
            self._errors.add(self._latest["setpoint"], **both)

    def _on_load(self, message) -> None:  # comes with every step, whatever the wire does
        self._heard_s = time.monotonic()
        self._latest["load"] = message.wrench.force.x

    def _on_status(self, message) -> None:
        self._told = message.message
        said = {each.key: each.value for each in message.values}
        if "shortest_m" in said:  # there was a reading
            self.ends_m = float(said["shortest_m"]), float(said["longest_m"])

    @property
    def _status(self) -> str:
        silent_s = time.monotonic() - self._heard_s
        return self._told if silent_s < SILENT_s else f"nothing has come from the node for {silent_s:.0f} s"

    def enable(self, children, interrupts: Interrupts) -> None:
        """Switch the current on once the node has readings.  Raises InstrumentError when it will not."""
        deadline = time.monotonic() + READY_TIMEOUT_s
        answer = "the node did not appear"
        while not interrupts and time.monotonic() < deadline:
            for child in children:
                child.check()
            if self._enable.wait_for_service(timeout_sec=0.2):
                future = self._enable.call_async(self._request)
                answer_deadline = time.monotonic() + ANSWER_TIMEOUT_s
                while not (interrupts or future.done()) and time.monotonic() < answer_deadline:
                    self.spin_until(time.monotonic() + 0.05)
                if future.done() and future.result().success:
                    return
                answer = future.result().message if future.done() else "~/enable did not answer"
                self.spin_until(time.monotonic() + 0.1)
        if not interrupts:
            raise InstrumentError(f"the node would not enable the wire: {answer}")

    def send(self, position_m: float, counts: bool) -> None:
        """Publish one setpoint; from then on samples count in the errors or do not."""
        self._latest["setpoint"] = position_m
        self._counts = counts
        self._setpoint.publish(self._float64(data=position_m))

    def spin_until(self, deadline_s: float) -> None:
        """Handle what arrives until ``deadline_s`` of the monotonic clock."""
        while (left := deadline_s - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def picture(self, elapsed_s: float) -> Table:
        """The state as a table with position bars; full extension is to the right."""
        stroke_m = self._config.wire.full_stroke_m
        table = Table(title=f"sma_actuator on the virtual bench, {elapsed_s:5.1f} s", title_justify="left")
        table.add_column("")
        table.add_column("value", justify="right", min_width=12)
        table.add_column(f"0 … {stroke_m * 1e3:.1f} mm", min_width=BAR_WIDTH)
        for name, words in (
            ("setpoint", "setpoint"),
            ("estimate", "estimate (from resistance)"),
            ("measured", "true displacement (LVDT)"),
        ):
            value_m = self._latest[name]
            table.add_row(words, f"{value_m * 1e3:.3f} mm", _bar(value_m / stroke_m))
        table.add_row("load", f"{self._latest['load']:.3f} N", "")
        table.add_row(
            "current",
            f"{self._latest['current'] * 1e3:.1f} mA",
            _bar(self._latest["current"] / self._config.supply.max_current),
        )
        table.add_row("status", "", self._status)
        return table

    def line(self, elapsed_s: float) -> str:
        """The state on one line, for where there is no terminal."""
        now = self._latest
        return (
            f"{elapsed_s:6.1f} s  setpoint {now['setpoint'] * 1e3:6.3f} mm  estimate {now['estimate'] * 1e3:6.3f} mm  "
            f"true displacement (LVDT) {now['measured'] * 1e3:6.3f} mm  load {now['load']:6.3f} N  "
            f"current {now['current'] * 1e3:5.1f} mA  status {self._status}"
        )

    def destroy(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()


def _bar(part: float) -> str:
    if not math.isfinite(part):
        return ""
    return "█" * round(BAR_WIDTH * min(max(part, 0.0), 1.0))


@dataclass
class _Child:
    """A process of the demonstration, in a session of its own so that Ctrl-C reaches us alone."""

    name: str
    popen: subprocess.Popen
    log: Path
    console: Console
    _shown: int = 0  #: lines of the log that were looked at

    def stop(self) -> None:
        """End it as a user would, with SIGINT; by force if it does not listen."""
        if self.popen.poll() is None:
            self.popen.send_signal(signal.SIGINT)
            try:
                self.popen.wait(STOP_TIMEOUT_s)
            except subprocess.TimeoutExpired:
                self.popen.kill()
                self.popen.wait()

    def check(self) -> None:
        """Show that it compiles, where it does; raise InstrumentError with its last words when it has ended."""
        ended = self.popen.poll() is not None
        lines = self.log.read_text(errors="replace").strip().splitlines()
        for line in lines[self._shown :]:
            if COMPILING in line:
                self.console.print(f"{self.name}: {line}", soft_wrap=True)
        self._shown = len(lines)
        if ended:
            words = lines[-1] if lines else "it said nothing"
            raise InstrumentError(f"the {self.name} ended with code {self.popen.returncode}: {words}")


@contextlib.contextmanager
def _folder():
    """A folder for the files of the run, gone after it unless the run failed: then the logs in it say why."""
    folder = tempfile.mkdtemp(prefix="sma_demo_")
    failed = False
    try:
        yield folder
    except InstrumentError as error:
        failed = True
        raise InstrumentError(
            f"{error}\nRun it once more; if it fails so again, the logs in {folder} say what came before"
        ) from error
    finally:
        if not failed:
            shutil.rmtree(folder)


@contextlib.contextmanager
def _process(name: str, command: list[str], log: Path, console: Console):
    with log.open("wb") as output:
        popen = subprocess.Popen(
            command,
            stdout=output,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            # Killed, we cannot stop it; there are no threads yet.
            preexec_fn=partial(end_with, os.getpid(), signal.SIGINT),  # noqa: PLW1509
        )
    child = _Child(name, popen, log, console)
    try:
        yield child
    finally:
        child.stop()


def _wait_for_ports(ports_file: Path, bench: _Child, interrupts: Interrupts) -> dict[str, int]:
    """The ports of the first bench, once it has announced them."""
    deadline = time.monotonic() + READY_TIMEOUT_s
    while not ports_file.exists():
        interrupts.raise_noted()
        bench.check()
        if time.monotonic() > deadline:
            raise InstrumentError(f"the virtual bench did not open its ports within {READY_TIMEOUT_s:g} s")
        time.sleep(0.02)
    return json.loads(ports_file.read_text())[0]


def _address_of(page: _Child, interrupts: Interrupts) -> str:
    """Where the page is, once it has said so."""
    deadline = time.monotonic() + READY_TIMEOUT_s
    while True:
        interrupts.raise_noted()
        page.check()
        for word in page.log.read_text(errors="replace").split():
            if word.startswith("http"):
                return word
        if time.monotonic() > deadline:
            raise InstrumentError(f"the page did not say its address within {READY_TIMEOUT_s:g} s")
        time.sleep(0.02)


def _supply_is_off(config: Config) -> bool:
    """Ask the instrument itself, as a second person at the bench would."""
    session: Any = pyvisa.ResourceManager("@py").open_resource(
        config.instruments.supply.resource, read_termination="\n", write_termination="\n", open_timeout=2000
    )
    try:
        return session.query("OUTP?").strip() == "0"
    finally:
        session.close()
