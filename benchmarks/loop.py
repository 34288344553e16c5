"""How well the loop keeps time over TCP, and what a wire costs, beside a bare loop that only asks the instruments the same.

    python benchmarks/loop.py [periods] [delay] [cpu] [--seconds 4] [--against CHECKOUT] [--json FILE]     (make benchmarks)

Three measurements, each against virtual benches in a process of their own, together about two minutes:

* ``periods``: period of the control loop at 20 Hz, 100 Hz and 1 kHz, and of a bare loop (deadline, DAQ block,
  supply read-back, one current setting) in turn with it;
* ``delay``: from publishing a setpoint to the new current on ``~/command_current``, over real ROS 2;
* ``cpu``: CPU time that a step of a wire takes in a node whose wires are driven, one at 100 Hz and sixteen at 20 Hz,
  beside that of bare loops; with nobody listening, and with one subscriber of ``~/joint_states`` for each wire.  With
  ``--against``, the node of another checkout of this repository in turn with this one's.

These machines are shared: compare what stands in one run, do not take the microseconds for more.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import yaml

from sma_actuator.base.share import shared_file
from sma_actuator.config import NODE_NAME, Config, read_parameter_file
from sma_actuator.driver import Driver
from sma_actuator.instruments import open_daq, open_supply
from sma_actuator.instruments.clock import MonotonicClock

ROOT = Path(__file__).resolve().parents[1]
WAIT_s = 60.0  #: longest wait for a process, a service or a reading
SETTLING_s = 3.0  #: between the last wire that went on, or is listened to, and the first CPU time that counts
SETPOINTS, PAUSE_s = 12, 0.8  #: of the delay


@contextlib.contextmanager
def a_process(words: list[str], checkout: Path = ROOT) -> Iterator[subprocess.Popen]:
    """A process of Python in a checkout; it is ended afterwards, in bounded time."""
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    process = subprocess.Popen([sys.executable, *words], cwd=checkout, env=environment, stdout=subprocess.DEVNULL)
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


def parameters(ports: dict, rate_Hz: float = 20.0) -> dict:
    """Parameters of a Flexinol wire at one of the benches."""
    out = read_parameter_file(shared_file("config/flexinol.yaml"))
    for instrument in ("supply", "daq"):
        out["instruments"][instrument]["resource"] = f"TCPIP::127.0.0.1::{ports[instrument]}::SOCKET"
    out["loop"] = {"rate": rate_Hz, "samples_per_block": max(1, int(1000 / rate_Hz))}
    # A machine that runs other things too is late by more than a period, or a time-out, now and then; the figures say so.
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


def bare_loop(config: Config, seconds: float) -> list[float]:
    """Start times of a loop that makes the driver's queries and nothing else."""
    clock = MonotonicClock()
    supply, daq = open_supply(config), open_daq(config, clock)
    supply.open()
    daq.open()
    starts_s, period_s = [], 1.0 / config.loop.rate
    try:
        supply.set_current(config.supply.bias_current)
        supply.set_output(True)
        begin_s, k = clock.now_s(), 0
        while clock.now_s() < begin_s + seconds:
            clock.sleep_until_s(begin_s + k * period_s)
            starts_s.append(clock.now_s())
            daq.read_block()
            supply.read_back()
            supply.set_current(config.supply.bias_current + 1e-5 * (k % 2))
            k = max(k + 1, int((clock.now_s() - begin_s) / period_s) + 1)
    finally:
        supply.shut_down()
        supply.close()
        daq.close()
    return starts_s


def driven_loop(config: Config, seconds: float) -> list[float]:
    """Start times of the driver's steps while it tracks a moving setpoint."""
    clock, starts_s = MonotonicClock(), []
    driver = Driver(config, open_supply(config), open_daq(config, clock), clock)
    inner = driver._account_start

    def account(now_s: float) -> None:
        starts_s.append(now_s)
        inner(now_s)

    driver._account_start = account
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


def loop_periods(args: argparse.Namespace) -> list[dict]:
    """Driver and bare loop in turn."""
    rows = []
    for rate_Hz in (20.0, 100.0, 1000.0):
        with benches(1) as (ports,):
            config = Config.from_mapping(parameters(ports, rate_Hz))
            for name, loop in (("bare loop", bare_loop), ("driver", driven_loop)):
                rows.append({"rate_Hz": rate_Hz, "loop": name, **of_periods(loop(config, args.seconds), 1.0 / rate_Hz)})
                r = rows[-1]
                print(
                    f"{rate_Hz:6g} Hz  {name:10s} period error p50 {r['p50_us']:7.0f} µs   p99 {r['p99_us']:7.0f} µs   "
                    f"max {r['max_us']:8.0f} µs   {100 * r['lost_share']:5.2f} % lost",
                    flush=True,
                )
    return rows


@contextlib.contextmanager
def node(sections: dict[str, dict], checkout: Path = ROOT) -> Iterator[subprocess.Popen]:
    """A node process with one wire for each name."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "wires.yaml"
        file.write_text(
            yaml.safe_dump({name: {"ros__parameters": {**p, "autostart": True}} for name, p in sections.items()})
        )
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

    def listen(self) -> None:
        """Subscribe to ``~/joint_states`` of all of them."""
        from sensor_msgs.msg import JointState

        for name in self._names:
            self.client.create_subscription(JointState, f"/{name}/joint_states", lambda _: None, 10)

    def steps_a_second(self) -> float:
        """Of each wire, as the nodes say themselves; their mean."""
        from diagnostic_msgs.msg import DiagnosticStatus
        from rclpy.qos import DurabilityPolicy, QoSProfile

        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        periods_s: dict[str, float] = {}

        def note(message: DiagnosticStatus) -> None:
            values = {each.key: each.value for each in message.values}
            periods_s[message.name] = float(values["period_mean_s"])

        for name in self._names:
            self.client.create_subscription(DiagnosticStatus, f"/{name}/status", note, latched)
        _wait(lambda: self.spin(0.1) or len(periods_s) == len(self._names), "the status of every wire")
        return float(np.mean([1.0 / period_s for period_s in periods_s.values()]))

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


def bare_cpu(sections: dict[str, dict], seconds: float) -> tuple[float, float]:
    """Share of a core that bare loops take, a thread each, in this process, and the steps that each makes a second."""
    configs = [Config.from_mapping(p) for p in sections.values()]
    whole_s = SETTLING_s + seconds + 1.0
    with ThreadPoolExecutor(len(configs)) as pool:
        loops = [pool.submit(bare_loop, config, whole_s) for config in configs]
        time.sleep(SETTLING_s)
        used = _cpu_share(os.getpid(), seconds, time.sleep)
        steps = sum(len(loop.result()) for loop in loops)
    return used, steps / whole_s / len(configs)


def node_cpu(sections: dict[str, dict], seconds: float, checkout: Path) -> tuple[float, float, float]:
    """Share of a core that a node takes whose wires are on: nobody listens, and joint states are listened to.

    Then the steps that each wire makes a second.
    """
    with node(sections, checkout) as process:
        commander = Commander(list(sections))
        commander.enable()
        commander.spin(SETTLING_s)
        alone = _cpu_share(process.pid, seconds, commander.spin)
        commander.listen()
        commander.spin(SETTLING_s)
        heard = _cpu_share(process.pid, seconds, commander.spin)
        steps_s = commander.steps_a_second()
        commander.close()
    return alone, heard, steps_s


def cpu_per_wire(args: argparse.Namespace) -> list[dict]:
    """CPU time of a node's process beside that of bare loops."""
    checkouts = {"node": ROOT} | ({f"node of {args.against.name}": args.against.resolve()} if args.against else {})
    rows = []
    for count, rate_Hz in ((1, 100.0), (16, 20.0)):
        with benches(count) as ports:
            names = [f"wire_{i}" for i in range(count)]
            sections = {name: parameters(p, rate_Hz) for name, p in zip(names, ports, strict=True)}
            of = f"{count:3d} × {rate_Hz:3g} Hz"
            bare, steps_s = bare_cpu(sections, args.seconds)
            bare_us = 1e6 * bare / steps_s / count
            print(f"{of}  {'bare loops':22s} {bare_us:5.0f} µs a step   ({100 * bare:.1f} % of a core)", flush=True)
            for name, checkout in checkouts.items():
                alone, heard, steps_s = node_cpu(sections, args.seconds, checkout)
                alone_us, heard_us = (1e6 * used / steps_s / count for used in (alone, heard))
                row = {"wires": count, "rate_Hz": rate_Hz, "of": name}
                rows.append({**row, "bare_us": bare_us, "alone_us": alone_us, "heard_us": heard_us})
                print(
                    f"{of}  {name:22s} {alone_us:5.0f} µs, {alone_us / bare_us:.2f} × bare   ({100 * alone:.1f} %)"
                    f"   with listeners {heard_us:5.0f} µs, {heard_us / bare_us:.2f} × bare   ({100 * heard:.1f} %)",
                    flush=True,
                )
    return rows


def _cpu_share(pid: int, seconds: float, wait: Callable[[float], object]) -> float:
    """CPU time of a process over wall time, while ``wait(seconds)`` lasts."""
    before_s, began_s = _cpu_s(pid), time.monotonic()
    wait(seconds)
    return (_cpu_s(pid) - before_s) / (time.monotonic() - began_s)


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
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", str(10 + os.getpid() % 80))
    rclpy.init(args=[])
    result = {name: MEASUREMENTS[name](args) for name in args.names or MEASUREMENTS}
    rclpy.try_shutdown()
    if args.json:
        args.json.write_text(json.dumps(result, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
