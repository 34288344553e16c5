"""A soak: one driver with its recorder, hour after virtual hour, and what of this machine's memory it takes.

Nothing goes wrong here but setpoints; what grows would end a process that is left to itself for days.
"""

from __future__ import annotations

import gc
import math
import os
import random
import tempfile
from pathlib import Path

from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.driver import Driver
from sma_actuator.logs.recorder import BenchLogRecorder

from .hours import CONFIG
from .result import Result, Violation

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
