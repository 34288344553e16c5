"""How well the loop keeps time over TCP, beside a bare loop that only asks the instruments the same.

    python benchmarks/loop.py [--seconds 10] [--json FILE]     (make benchmarks)

Three measurements, each against virtual benches in a process of their own:

* period of the control loop at 20 Hz, 100 Hz and 1 kHz, and of a bare loop (deadline, DAQ block,
  supply read-back, one current setting) in turn with it;
* delay from publishing a setpoint to the new current on ``~/command_current``, over real ROS 2;
* CPU time per wire for 1, 4 and 16 wires in one node process.

These machines are shared: compare the two loops of one run, do not take the microseconds for more.
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
from pathlib import Path

import numpy as np
import yaml

from sma_actuator.base.share import shared_file
from sma_actuator.config import NODE_NAME, Config, read_parameter_file
from sma_actuator.driver import Driver
from sma_actuator.instruments import open_daq, open_supply
from sma_actuator.instruments.clock import MonotonicClock

WAIT_s = 30.0


@contextlib.contextmanager
def benches(count: int):
    """Ports of ``count`` virtual benches in one process of their own."""
    with tempfile.TemporaryDirectory() as folder:
        ports = Path(folder) / "ports.json"
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "sma_actuator",
                "bench",
                "--count",
                str(count),
                "--supply-port",
                "0",
                "--daq-port",
                "0",
                "--ports-file",
                str(ports),
            ],
            stdout=subprocess.DEVNULL,
        )
        try:
            _wait(ports.exists, "the virtual bench")
            yield json.loads(ports.read_text())
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(WAIT_s)


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
    # At 1 kHz the operating system alone is late by more than a period now and then; the figures say so.
    out["loop"]["overruns_to_fault"] = 1000
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


def loop_periods(seconds: float) -> list[dict]:
    """Driver and bare loop in turn."""
    rows = []
    for rate_Hz in (20.0, 100.0, 1000.0):
        with benches(1) as (ports,):
            config = Config.from_mapping(parameters(ports, rate_Hz))
            for name, loop in (("bare loop", bare_loop), ("driver", driven_loop)):
                rows.append({"rate_Hz": rate_Hz, "loop": name, **of_periods(loop(config, seconds), 1.0 / rate_Hz)})
                r = rows[-1]
                print(
                    f"{rate_Hz:6g} Hz  {name:10s} period error p50 {r['p50_us']:7.0f} µs   p99 {r['p99_us']:7.0f} µs   "
                    f"max {r['max_us']:8.0f} µs   {100 * r['lost_share']:5.2f} % lost",
                    flush=True,
                )
    return rows


@contextlib.contextmanager
def node(sections: dict[str, dict]):
    """A node process with one wire for each name."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "wires.yaml"
        file.write_text(
            yaml.safe_dump({name: {"ros__parameters": {**p, "autostart": True}} for name, p in sections.items()})
        )
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "sma_actuator.ros.node",
                "--nodes",
                *sections,
                "--ros-args",
                "--params-file",
                str(file),
            ]
        )
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(WAIT_s)


def setpoint_to_current(count: int = 40) -> dict[str, float]:
    """Delay [ms] from publishing a setpoint to a command that differs, at 100 Hz."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from std_msgs.msg import Float64
    from std_srvs.srv import SetBool

    rclpy.init(args=[])
    with benches(1) as (ports,), node({NODE_NAME: parameters(ports, 100.0)}):
        client = rclpy.create_node("setpoint_delay")
        executor = SingleThreadedExecutor()
        executor.add_node(client)
        latest: list[float] = [0.0]
        client.create_subscription(
            Float64, f"/{NODE_NAME}/command_current", lambda m: latest.__setitem__(0, m.data), 10
        )
        publisher = client.create_publisher(Float64, f"/{NODE_NAME}/setpoint", 10)
        enable = client.create_client(SetBool, f"/{NODE_NAME}/enable")
        enable.wait_for_service(WAIT_s)

        def enabled() -> bool:
            future = enable.call_async(SetBool.Request(data=True))
            executor.spin_until_future_complete(future, timeout_sec=5.0)
            return future.done() and future.result().success

        _wait(enabled, "the node")
        delays_ms = []
        for k in range(count):
            before_A = latest[0]
            start_s = time.monotonic()
            publisher.publish(Float64(data=(1.5e-3, 2.5e-3)[k % 2]))
            # One period of a new setpoint, rate limited, is worth some 80 mA; noise some 10 mA.
            while abs(latest[0] - before_A) < 0.03 and time.monotonic() < start_s + 1.0:
                executor.spin_once(timeout_sec=0.1)
            delays_ms.append(1e3 * (time.monotonic() - start_s))
            pause_s = time.monotonic() + 1.5 + 0.0007 * k  # settled, and not in step with the loop
            while time.monotonic() < pause_s:
                executor.spin_once(timeout_sec=0.01)
        executor.shutdown()
        client.destroy_node()
    rclpy.try_shutdown()
    delays = np.array([d for d in delays_ms if d < 1000.0])
    row = {
        "p50_ms": float(np.percentile(delays, 50)),
        "p99_ms": float(np.percentile(delays, 99)),
        "max_ms": float(delays.max()),
        "count": len(delays),
    }
    print(
        f"setpoint to current at 100 Hz: p50 {row['p50_ms']:.1f} ms   p99 {row['p99_ms']:.1f} ms   max {row['max_ms']:.1f} ms   (period 10 ms)",
        flush=True,
    )
    return row


def cpu_per_wire(seconds: float) -> list[dict]:
    """CPU time of the node process per wire, at 20 Hz."""
    rows = []
    for count in (1, 4, 16):
        with benches(count) as ports:
            sections = {f"wire_{i}" if count > 1 else NODE_NAME: parameters(p) for i, p in enumerate(ports)}
            with node(sections) as process:
                time.sleep(6.0)  # start-up is not counted
                before_s = _cpu_s(process.pid)
                time.sleep(seconds)
                used = (_cpu_s(process.pid) - before_s) / seconds
        rows.append({"wires": count, "cpu_pct": 100 * used, "cpu_pct_per_wire": 100 * used / count})
        print(
            f"{count:3d} wires in one process: {100 * used:6.1f} % of a core, {100 * used / count:5.2f} % each",
            flush=True,
        )
    return rows


def _cpu_s(pid: int) -> float:
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    """Run the three measurements."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each measurement (default %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", str(10 + os.getpid() % 80))
    result = {
        "periods": loop_periods(args.seconds),
        "setpoint_to_current": setpoint_to_current(),
        "cpu": cpu_per_wire(args.seconds),
    }
    if args.json:
        args.json.write_text(json.dumps(result, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
