"""How well the loop keeps time over TCP, and what a wire costs, beside a bare loop with the same queries.

    python benchmarks/loop.py [periods] [delay] [cpu] [--seconds 4] [--priority 50] [--against CHECKOUT] [--json FILE]
    (make benchmarks)

Three measurements, each against virtual benches in a process of their own, together about two minutes:

* ``periods``: period of the control loop at 20 Hz, 100 Hz and 1 kHz, and of a bare loop (deadline, DAQ block,
  supply read-back, one current setting, a limit looked at twice a second) in turn with it; and, where they are
  installed, of what others wrote to keep time and that asks nothing: ``loop-rate-limiters`` (PyPI), and ``cyclictest``
  (Debian's ``rt-tests``), in C, whose error is how late it wakes;
* ``delay``: from publishing a setpoint to the new current on ``~/command_current``, over real ROS 2;
* ``cpu``: CPU time that a step of a wire takes in a node whose wires are driven, one at 100 Hz and sixteen at 20 Hz,
  beside that of as many bare loops in a process at the same time; with nobody listening, and with one subscriber of
  ``~/joint_states`` for each wire.  With ``--against``, the same of the node of another checkout of this repository.

These machines are shared: compare what stands in one run, do not take the microseconds for more.  The load is said
first.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import importlib.util
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import IO

import numpy as np

from sma_actuator.base import realtime
from sma_actuator.base.yaml_text import yaml_of
from sma_actuator.config import NODE_NAME, Config, read_parameter_file
from sma_actuator.console import write_json
from sma_actuator.driver import CHECK_PERIOD_s, Driver
from sma_actuator.instruments import open_daq, open_supply
from sma_actuator.instruments.clock import MonotonicClock

ROOT = Path(__file__).resolve().parents[1]
WAIT_s = 60.0  #: longest wait for a process, a service or a reading
SETTLING_s = 3.0  #: between the last wire that went on, or is listened to, and the first CPU time that counts
SETPOINTS, PAUSE_s = 12, 0.8  #: of the delay
MIDDLE_m = 2e-3  #: of the wire's range
_LATEST_us = 100_000  #: that cyclictest counts one by one


@contextlib.contextmanager
def a_process(
    words: list[str], checkout: Path = ROOT, stdout: int | IO = subprocess.DEVNULL
) -> Iterator[subprocess.Popen]:
    """A process of Python in a checkout; it is ended afterwards, in bounded time."""
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    process = subprocess.Popen([sys.executable, *words], cwd=checkout, env=environment, stdout=stdout)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(WAIT_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def benches(count: int) -> Iterator[list[dict]]:
    """Ports of ``count`` virtual benches in one process of their own."""
    with tempfile.TemporaryDirectory() as folder:
        ports = Path(folder) / "ports.json"
        words = f"-m sma_actuator bench --count {count} --supply-port 0 --daq-port 0 --ports-file {ports}"
        with a_process(words.split()):
            _wait(ports.exists, "the virtual bench")
            yield json.loads(ports.read_text())


def _wait(condition, what: str) -> None:
    deadline_s = time.monotonic() + WAIT_s
    while not condition():
        if time.monotonic() > deadline_s:
            raise SystemExit(f"{what} did not come within {WAIT_s:g} s")
        time.sleep(0.01)


def parameters(ports: dict, rate_Hz: float = 20.0, checkout: Path = ROOT) -> dict:
    """Parameters of a Flexinol wire at one of the benches, as a checkout names them."""
    out = read_parameter_file(checkout / "config" / "flexinol.yaml")
    for instrument in ("supply", "daq"):
        out["instruments"][instrument]["resource"] = f"TCPIP::127.0.0.1::{ports[instrument]}::SOCKET"
    out["loop"] = {"rate": rate_Hz, "samples_per_block": max(1, int(1000 / rate_Hz))}
    # A machine that runs other things too is late by more than a period, or a time-out, now and then; the figures say
    # so.
    out["loop"]["overruns_to_fault"] = 1000
    out["safety"]["reading_timeout"] = out["supply"]["watchdog_timeout"] = 3.0
    for instrument in ("supply", "daq"):
        out["instruments"][instrument]["timeout"] = 1.4
    return out


def of_periods(starts_s: list[float], period_s: float) -> dict[str, float]:
    """p50, p99 and maximum of the absolute error of the period [µs], and the share of periods lost."""
    periods_s = np.diff(starts_s)
    errors_us = 1e6 * np.abs(periods_s - period_s)
    return {
        "p50_us": float(np.percentile(errors_us, 50)),
        "p99_us": float(np.percentile(errors_us, 99)),
        "max_us": float(errors_us.max()),
        "lost_share": float(1.0 - len(periods_s) / max(len(periods_s), round((starts_s[-1] - starts_s[0]) / period_s))),
    }


def bare_loop(config: Config, seconds: float, ended: threading.Event | None = None) -> list[float]:
    """Start times of a loop that makes the driver's queries and nothing else, for a time or until it is ended."""
    clock = MonotonicClock()
    supply, daq = open_supply(config), open_daq(config, clock)
    supply.open()
    daq.open()
    starts_s, period_s = [], 1.0 / config.loop.rate
    try:
        supply.set_current(config.supply.bias_current)
        supply.set_output(True)
        begin_s, k, checked_s = clock.now_s(), 0, -np.inf
        while clock.now_s() < begin_s + seconds and not (ended and ended.is_set()):
            clock.sleep_until_s(begin_s + k * period_s)
            starts_s.append(clock.now_s())
            daq.read_block()
            supply.read_back()
            supply.set_current(config.supply.bias_current + 1e-5 * (k % 2))
            if starts_s[-1] - checked_s >= CHECK_PERIOD_s:
                checked_s = starts_s[-1]
                supply.check_next_setting()
            k = max(k + 1, int((clock.now_s() - begin_s) / period_s) + 1)
    finally:
        supply.shut_down()
        supply.close()
        daq.close()
    return starts_s


def in_its_thread(loop: Callable[[Config, float], list[float]], config: Config, seconds: float) -> list[float]:
    """A loop in a thread that has what ``loop.realtime`` gives the driver's."""

    def run() -> list[float]:
        realtime.begin(config.loop.realtime)
        return loop(config, seconds)

    with ThreadPoolExecutor(1) as thread:
        return thread.submit(run).result()


def driven_loop(config: Config, seconds: float) -> list[float]:
    """Start times of the driver's steps while it tracks a moving setpoint."""
    clock, starts_s = MonotonicClock(), []
    driver = Driver(config, open_supply(config), open_daq(config, clock), clock)
    inner = driver._loop.deadlines.begun

    def account(now_s: float) -> None:
        starts_s.append(now_s)
        inner(now_s)

    driver._loop.deadlines.begun = account  # type: ignore[method-assign]
    lo_m, hi_m = config.model.build(config.wire).displacement_range_m
    driver.start()
    try:
        _wait(lambda: driver.enable(True)[0], "a reading")
        starts_s.clear()
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            driver.offer_setpoint(lo_m + (hi_m - lo_m) * (0.5 + 0.3 * np.sin(time.monotonic())))
            time.sleep(0.05)
        if driver.failure:
            raise driver.failure
    finally:
        driver.stop()
    return starts_s


def rate_limiter(config: Config, seconds: float) -> list[float]:
    """Start times of an empty loop that ``loop-rate-limiters`` keeps."""
    from loop_rate_limiters import RateLimiter

    limiter, starts_s = RateLimiter(config.loop.rate, warn=False), []
    for _ in range(round(seconds * config.loop.rate)):
        limiter.sleep()
        starts_s.append(time.monotonic())
    return starts_s


def cyclictest(rate_Hz: float, seconds: float, priority: int) -> dict[str, float]:
    """How late a thread in C wakes: p50, p99 and maximum [µs]."""
    words = f"cyclictest -q -i {1e6 / rate_Hz:.0f} -l {rate_Hz * seconds:.0f} -h {_LATEST_us}".split()
    words += ["-m", "-p", str(priority)] if priority else ["--policy=other"]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    counted = np.array([line.split() for line in said if line[:1].isdigit()], float)
    (longest,) = (line for line in said if line.startswith("# Max Latencies:"))
    late_us = np.repeat(counted[:, 0], counted[:, 1].astype(int))
    p50_us, p99_us = np.percentile(late_us, [50, 99]).tolist()
    return {"p50_us": p50_us, "p99_us": p99_us, "max_us": float(longest.split()[-1]), "lost_share": 0.0}


def loop_periods(args: argparse.Namespace) -> list[dict]:
    """Driver, bare loop and what others have, in turn."""
    rows: list[dict] = []

    def say(rate_Hz: float, name: str, found: dict[str, float]) -> None:
        rows.append({"rate_Hz": rate_Hz, "loop": name, **found})
        print(
            f"{rate_Hz:6g} Hz  {name:22s} period error p50 {found['p50_us']:7.0f} µs   p99 {found['p99_us']:7.0f} µs   "
            f"max {found['max_us']:8.0f} µs   {100 * found['lost_share']:5.2f} % lost",
            flush=True,
        )

    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors", flush=True)
    loops = [("bare loop", functools.partial(in_its_thread, bare_loop)), ("driver", driven_loop)]
    if importlib.util.find_spec("loop_rate_limiters"):
        loops.append(("loop-rate-limiters", functools.partial(in_its_thread, rate_limiter)))
    for rate_Hz in (20.0, 100.0, 1000.0):
        with benches(1) as (ports,):
            plain = parameters(ports, rate_Hz)
            first = {**plain, "loop": {**plain["loop"], "realtime": {"priority": args.priority, "lock_memory": True}}}
            kinds = [("", plain), (f", priority {args.priority}", first)] if args.priority else [("", plain)]
            for (note, mapping), (name, loop) in itertools.product(kinds, loops):
                starts_s = loop(Config.from_mapping(mapping), args.seconds)
                say(rate_Hz, name + note, of_periods(starts_s, 1.0 / rate_Hz))
            if shutil.which("cyclictest"):
                for note, _ in kinds:
                    say(rate_Hz, "cyclictest" + note, cyclictest(rate_Hz, args.seconds, args.priority if note else 0))
    return rows


@contextlib.contextmanager
def node(sections: dict[str, dict], checkout: Path = ROOT) -> Iterator[subprocess.Popen]:
    """A node process with one wire for each name."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "wires.yaml"
        nodes = {name: {"ros__parameters": {**p, "autostart": True}} for name, p in sections.items()}
        file.write_text(yaml_of(nodes))
        words = ["-m", "sma_actuator.ros.node", "--nodes", *sections, "--ros-args", "--params-file", str(file)]
        words += ["--log-level", "error"]
        with a_process(words, checkout) as process:
            yield process


class Commander:
    """A ROS client of the wires of these names, in this process."""

    def __init__(self, names: list[str]):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from std_srvs.srv import SetBool

        self.client = rclpy.create_node("loop_benchmark")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.client)
        self._enable = [(SetBool, self.client.create_client(SetBool, f"/{name}/enable")) for name in names]
        self._names = names

    def enable(self) -> None:
        """Switch all of them on."""
        for kind, client in self._enable:
            if not client.wait_for_service(WAIT_s):
                raise SystemExit(f"{client.srv_name} did not come within {WAIT_s:g} s")
            _wait(lambda kind=kind, client=client: self._enabled(kind, client), f"a wire behind {client.srv_name}")

    def _enabled(self, kind: type, client) -> bool:
        future = client.call_async(kind.Request(data=True))
        self.executor.spin_until_future_complete(future, timeout_sec=5.0)
        return future.done() and future.result().success

    def move(self) -> None:
        """Send all of them to the middle of the range, so that their currents change with every step."""
        from std_msgs.msg import Float64

        for name in self._names:
            publisher = self.client.create_publisher(Float64, f"/{name}/setpoint", 1)
            _wait(lambda publisher=publisher: publisher.get_subscription_count() > 0, f"the subscription of {name}")
            publisher.publish(Float64(data=MIDDLE_m))

    def listen(self) -> None:
        """Subscribe to ``~/joint_states`` of all of them."""
        from sensor_msgs.msg import JointState

        for name in self._names:
            self.client.create_subscription(JointState, f"/{name}/joint_states", lambda _: None, 10)

    def periods_s(self) -> tuple[float, float]:
        """Mean of the period and its 99th percentile, as the nodes say themselves, over all wires."""
        from diagnostic_msgs.msg import DiagnosticStatus
        from rclpy.qos import DurabilityPolicy, QoSProfile

        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        periods_s: dict[str, tuple[float, float]] = {}

        def note(message: DiagnosticStatus) -> None:
            values = {each.key: each.value for each in message.values}
            periods_s[message.name] = float(values["period_mean_s"]), float(values["period_p99_s"])

        for name in self._names:
            self.client.create_subscription(DiagnosticStatus, f"/{name}/status", note, latched)
        _wait(lambda: self.spin(0.1) or len(periods_s) == len(self._names), "the status of every wire")
        mean_s, p99_s = np.mean(list(periods_s.values()), axis=0).tolist()
        return mean_s, p99_s

    def spin(self, seconds: float) -> None:
        """Take what arrives, for a time."""
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0.0:
            self.executor.spin_once(timeout_sec=left_s)

    def close(self) -> None:
        """Leave the graph."""
        self.executor.shutdown()
        self.client.destroy_node()


def setpoint_to_current(_: argparse.Namespace) -> dict[str, float]:
    """Delay [ms] from publishing a setpoint to a command that differs, at 100 Hz."""
    from std_msgs.msg import Float64

    with benches(1) as (ports,), node({NODE_NAME: parameters(ports, 100.0)}):
        commander = Commander([NODE_NAME])
        client, executor = commander.client, commander.executor
        latest: list[float] = [0.0]
        client.create_subscription(
            Float64, f"/{NODE_NAME}/command_current", lambda m: latest.__setitem__(0, m.data), 10
        )
        publisher = client.create_publisher(Float64, f"/{NODE_NAME}/setpoint", 10)
        commander.enable()
        _wait(lambda: publisher.get_subscription_count() > 0, "the node's subscription of ~/setpoint")
        delays_ms = []
        for k in range(SETPOINTS):
            commander.spin(PAUSE_s + 0.0007 * k)  # settled, and not in step with the loop
            before_A = latest[0]
            start_s = time.monotonic()
            publisher.publish(Float64(data=(1.5e-3, 2.5e-3)[k % 2]))
            # One period of a new setpoint, rate limited, is worth some 80 mA; noise some 10 mA.
            while abs(latest[0] - before_A) < 0.03 and time.monotonic() < start_s + 1.0:
                executor.spin_once(timeout_sec=0.1)
            delays_ms.append(1e3 * (time.monotonic() - start_s))
        commander.close()
    delays = np.array([d for d in delays_ms if d < 1000.0])
    if not len(delays):
        raise SystemExit("no setpoint changed the current within a second")
    row = {"p50_ms": float(np.median(delays)), "max_ms": float(delays.max()), "count": len(delays)}
    print(
        f"setpoint to current at 100 Hz: p50 {row['p50_ms']:.1f} ms   max {row['max_ms']:.1f} ms   "
        f"({len(delays)} of {SETPOINTS} setpoints; period 10 ms)",
        flush=True,
    )
    return row


def run_bare_loops(file: Path) -> None:
    """Run a bare loop for each wire of a file, a thread each, until SIGINT; then say the mean of their periods [s]."""
    ended = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: ended.set())
    configs = [Config.from_mapping(p) for p in json.loads(file.read_text())]
    with ThreadPoolExecutor(len(configs)) as pool:
        loops = [pool.submit(bare_loop, config, np.inf, ended) for config in configs]
        while not ended.is_set():
            time.sleep(0.1)
    print(np.mean([np.diff(loop.result()).mean() for loop in loops]))


@contextlib.contextmanager
def bare_loops(wires: list[dict], periods_s: list[float]) -> Iterator[subprocess.Popen]:
    """The same as a process; the mean period goes into ``periods_s`` in the end."""
    with tempfile.TemporaryDirectory() as folder:
        file, said = Path(folder) / "wires.json", Path(folder) / "said"
        file.write_text(json.dumps(wires))
        with said.open("w") as out, a_process([__file__, "--bare", str(file)], stdout=out) as process:
            yield process
        periods_s.append(float(said.read_text()))


def cpu_beside(count: int, rate_Hz: float, seconds: float, checkout: Path) -> dict[str, float]:
    """CPU time [µs] of a step of a wire in a node and in bare loops, at the same time.

    While nobody listens, and while joint states are listened to; with the 99th percentile of the node's periods [s].
    """
    bare_s: list[float] = []
    with benches(2 * count) as ports:
        beside = [parameters(p, rate_Hz) for p in ports[count:]]
        sections = {f"wire_{i}": parameters(p, rate_Hz, checkout) for i, p in enumerate(ports[:count])}
        with bare_loops(beside, bare_s) as bare, node(sections, checkout) as driven:
            commander, pids = Commander(list(sections)), (bare.pid, driven.pid)
            commander.enable()
            commander.move()
            commander.spin(SETTLING_s)
            alone = _cpu_shares(pids, seconds, commander.spin)
            commander.listen()
            commander.spin(SETTLING_s)
            heard = _cpu_shares(pids, seconds, commander.spin)
            mean_s, p99_s = commander.periods_s()
            commander.close()
    a_step_us = 1e6 * np.array([bare_s[0], mean_s]) / count
    (bare_alone, node_alone), (bare_heard, node_heard) = (np.array(used) * a_step_us for used in (alone, heard))
    return {
        "bare_us": float(bare_alone + bare_heard) / 2.0,
        "alone_us": float(node_alone),
        "alone_ratio": float(node_alone / bare_alone),
        "heard_us": float(node_heard),
        "heard_ratio": float(node_heard / bare_heard),
        "p99_s": p99_s,
    }


def cpu_per_wire(args: argparse.Namespace) -> list[dict]:
    """CPU time of a step in a node beside that in bare loops, of this checkout and of another."""
    checkouts = {"node": ROOT} | ({f"node of {args.against.name}": args.against.resolve()} if args.against else {})
    rows = []
    for count, rate_Hz in ((1, 100.0), (16, 20.0)):
        for name, checkout in checkouts.items():
            row = cpu_beside(count, rate_Hz, args.seconds, checkout)
            rows.append({"wires": count, "rate_Hz": rate_Hz, "of": name, **row})
            print(
                f"{count:3d} × {rate_Hz:3g} Hz  {name:22s} {row['alone_us']:5.0f} µs a step, {row['alone_ratio']:.2f} "
                f"× bare   with listeners {row['heard_us']:5.0f} µs, {row['heard_ratio']:.2f} × bare   (bare "
                f"{row['bare_us']:.0f} µs; period p99 {1e3 * row['p99_s']:.1f} ms)",
                flush=True,
            )
    return rows


def _cpu_shares(pids: tuple[int, ...], seconds: float, wait: Callable[[float], object]) -> list[float]:
    """CPU time of each process over wall time, while ``wait(seconds)`` lasts."""
    before_s, began_s = [_cpu_s(pid) for pid in pids], time.monotonic()
    wait(seconds)
    lasted_s = time.monotonic() - began_s
    return [(_cpu_s(pid) - used_s) / lasted_s for pid, used_s in zip(pids, before_s, strict=True)]


def _cpu_s(pid: int) -> float:
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


MEASUREMENTS = {"periods": loop_periods, "delay": setpoint_to_current, "cpu": cpu_per_wire}


def main() -> int:
    """Run the measurements that are named, or all."""
    import rclpy

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[[], *MEASUREMENTS], metavar="NAME", help=", ".join(MEASUREMENTS))
    parser.add_argument("--seconds", type=float, default=4.0, help="length of each measurement (default %(default)s)")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="measure the CPU of this one's node as well")
    parser.add_argument(
        "--priority", type=int, default=0, help="periods: also with loop.realtime.priority and memory locked"
    )
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--bare", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.bare:
        run_bare_loops(args.bare)
        return 0
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", str(10 + os.getpid() % 80))
    rclpy.init(args=[])
    result = {name: MEASUREMENTS[name](args) for name in args.names or MEASUREMENTS}
    rclpy.try_shutdown()
    write_json(args, result)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
