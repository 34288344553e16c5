"""Soaks: what is left to itself for days must not grow.

One driver with its recorder, hour after virtual hour, and what of this machine's memory it takes; nothing goes wrong there
but setpoints.  And a node that drives a wire in real time, with clients that come and go, setpoints, parameters and now and
then a fault: its memory, threads and open files.
"""

from __future__ import annotations

import gc
import json
import math
import os
import random
import statistics
import tempfile
import time
from pathlib import Path

from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.driver import Driver
from sma_actuator.logs.recorder import BenchLogRecorder

from .hours import CONFIG
from .result import Result, Violation
from .stand import Stand

#: After these everything is there that is there once: compiled code, full windows, full queues.
SETTLED_s = 600.0
SLICE_s = 60.0
#: Growth from then on, in an hour: an allocator gives and takes some pages, what leaks at each step is above a megabyte.
MOST_GROWTH_B_h = 300_000.0


def resident_B() -> int:
    """Memory of this process that is not on disk."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")


def attack(seed: int, seconds: float) -> Result:
    """Drive for ``seconds`` of the bench's time; growth of memory after the first minutes is a broken promise."""
    result = Result()
    chance = random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="sma_attack_") as folder:
        parameters = read_parameter_file(CONFIG / "flexinol.yaml")
        parameters["recorder"] = {"folder": folder, "max_files": 3, "max_file_size": 1_000_000}
        config = Config.from_mapping(parameters)
        bench = VirtualBench.from_name("flexinol", seed=seed)
        recorder = BenchLogRecorder(config)
        driver = Driver(
            config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench), recorder=recorder
        )
        driver.run_for(1.0)
        settled_B, settled_s = 0, math.nan
        while bench.time_s < seconds:
            driver.clear_fault()
            driver.enable(True)
            for _ in range(30):
                driver.offer_setpoint(chance.choice((math.nan, chance.uniform(-0.001, 0.006))))
                driver.run_for(SLICE_s / 30)
            driver.refusals()
            if settled_B == 0 and bench.time_s >= SETTLED_s:
                gc.collect()
                settled_B, settled_s = resident_B(), bench.time_s
        gc.collect()
        driver.stop()
        recorder.close()
    hours = (bench.time_s - settled_s) / 3600.0
    grown_B = resident_B() - settled_B
    result.counts["virtual seconds"] += round(bench.time_s)
    result.counts["steps"] += driver.statistics().steps
    result.see("memory grown [B/h]", grown_B / hours)
    result.see("memory at the end [MB]", resident_B() / 1e6)
    if grown_B > MOST_GROWTH_B_h * hours:
        result.violations.append(
            Violation(
                "memory grows", f"{grown_B} B in {hours:.1f} h", f"python -m attack soak --hours {seconds / 3600:g}"
            )
        )
    return result


# --- a node ------------------------------------------------------------------------------------------

NODE = "soaked"
#: A part that comes and goes (a thread of a service, a connection made anew) is no growth.
COME_AND_GO = 2
NODE_MOST_GROWTH_B_h = 2_000_000.0
LOOK_EACH_s = 5.0
#: Faults of the bench that latch, and leave everything as it was when they are over.
PASSING_FAULTS = ("open_wire", "load_spike 4", "channel_saturated 103", "supply_silent", "daq_silent", "daq_hangup")


class Size:
    """What a process takes of this machine."""

    def __init__(self, pid: int):
        process = Path(f"/proc/{pid}")
        self.memory_B = int((process / "statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
        self.threads = len(list((process / "task").iterdir()))
        self.files = len(list((process / "fd").iterdir()))


class NodeSoak:
    """One node on one bench process, in real time."""

    def __init__(self, seed: int):
        from .nodes import Client, Nursery

        self.seed = seed
        self.result = Result()
        self._chance = random.Random(seed)
        self._temporary = tempfile.TemporaryDirectory(prefix="sma_attack_")
        folder = Path(self._temporary.name)
        self.stand = Stand("--seed", str(seed))
        self.nursery = Nursery()
        self.client = Client()
        self._new_client = Client
        parameters = read_parameter_file(CONFIG / "flexinol.yaml")
        for role, port in (("supply", self.stand.supply_port), ("daq", self.stand.daq_port)):
            parameters["instruments"][role]["resource"] = f"TCPIP::127.0.0.1::{port}::SOCKET"
        parameters["recorder"] = {"folder": str(folder), "max_files": 4, "max_file_size": 200_000}
        parameters["wait_for_instruments"] = True
        self.limit_C = Config.from_mapping(parameters).thermal.max_temperature
        file = folder / "parameters.yaml"
        file.write_text(json.dumps({NODE: {"ros__parameters": parameters}}))
        self.node = self.nursery.start(file, folder / "node.log", NODE)

    def close(self) -> None:
        """End everything."""
        self.node.end()
        self.client.close()
        self.nursery.close()
        self.stand.close()
        self._temporary.cleanup()

    def run(self, seconds: float) -> Result:
        """Drive for ``seconds`` of real time."""
        from std_msgs.msg import Float64

        setpoints = self.client.node.create_publisher(Float64, f"/{NODE}/setpoint", 10)
        began_s = time.monotonic()
        settled_s = min(SETTLED_s, 0.2 * seconds)
        sizes: list[tuple[float, Size]] = []
        while (now_s := time.monotonic() - began_s) < seconds:
            words = self.client.drive(NODE, self.stand, lambda: self.node.ended is None)
            if words:
                self.broken("the node does not drive the wire", f"{words}; {self.node.last_words()}")
                break
            for _ in range(round(LOOK_EACH_s / 0.05)):
                setpoints.publish(Float64(data=self._chance.choice((math.nan, self._chance.uniform(-0.001, 0.006)))))
                self.client.spin_until(lambda: False, 0.05)
                self.result.counts["setpoints"] += 1
            if now_s >= settled_s:
                sizes.append((now_s, Size(self.node.pid)))
            self._chance.choices((self._fault, self._come_and_go, self._odd_parameter), (1, 2, 2))[0]()
            if self.stand.hottest_C > self.limit_C:
                self.broken("the wire is above its limit of temperature", f"{self.stand.hottest_C:.0f} °C")
        self.result.counts["seconds"] += round(time.monotonic() - began_s)
        self._judge(sizes)
        return self.result

    def broken(self, rule: str, detail: str) -> None:
        """Write down a broken promise."""
        self.result.violations.append(Violation(rule, detail, f"python -m attack node --seed {self.seed}"))

    def _fault(self) -> None:
        """Something latches the output off, passes, and is cleared."""
        self.result.counts["faults"] += 1
        name = self._chance.choice(PASSING_FAULTS)
        self.stand.tell(f"BENC:FAUL {','.join(name.split())}")
        self.client.spin_until(lambda: False, 2.0)
        self.stand.tell("BENC:FAUL:CLE")

    def _come_and_go(self) -> None:
        """Another ROS 2 participant looks in, and asks for something."""
        from std_srvs.srv import Trigger

        self.result.counts["clients that came and went"] += 1
        client = self._new_client(self.result.counts["clients that came and went"])
        client.call(f"/{NODE}/{self._chance.choice(('reset_estimator', 'clear_fault'))}", Trigger, timeout_s=3.0)
        client.close()

    def _odd_parameter(self) -> None:
        """A parameter that is refused, or taken over while the wire is driven."""
        from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
        from rcl_interfaces.srv import SetParameters

        self.result.counts["parameters"] += 1
        value = ParameterValue(
            type=ParameterType.PARAMETER_DOUBLE, double_value=self._chance.choice((math.nan, -1.0, 0.002, 0.004))
        )
        request = SetParameters.Request(parameters=[Parameter(name="controller.setpoint_rate_limit", value=value)])
        self.client.call(f"/{NODE}/set_parameters", SetParameters, request, 3.0)

    def _judge(self, sizes: list[tuple[float, Size]]) -> None:
        """Growth between the first and the last third of what was seen after everything was there once."""
        third = len(sizes) // 3
        if third == 0:
            return
        first, last = sizes[:third], sizes[-third:]
        hours = (statistics.mean(at for at, _ in last) - statistics.mean(at for at, _ in first)) / 3600.0

        def grown(what: str) -> float:
            before, after = ([getattr(size, what) for _, size in part] for part in (first, last))
            return statistics.mean(after) - statistics.mean(before)

        for what in ("threads", "files"):
            self.result.see(f"{what} grown", grown(what))
            self.result.see(f"{what}, most", max(getattr(size, what) for _, size in sizes))
            if grown(what) > COME_AND_GO:
                self.broken(f"{what} grow", f"{grown(what):.1f} in {hours:.2f} h")
        growth_B_h = grown("memory_B") / hours
        self.result.see("memory grown [B/h]", growth_B_h)
        self.result.see("memory at the end [MB]", sizes[-1][1].memory_B / 1e6)
        if growth_B_h > NODE_MOST_GROWTH_B_h:
            self.broken("memory grows", f"{growth_B_h:.0f} B in an hour, seen over {hours:.2f} h")


def attack_node(seed: int, seconds: float) -> Result:
    """Soak a node for ``seconds`` of real time."""
    soak = NodeSoak(seed)
    try:
        return soak.run(seconds)
    finally:
        soak.close()
