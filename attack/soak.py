"""A soak: one driver with its recorder, hour after virtual hour, and what of this machine's memory it takes.

Nothing goes wrong here but setpoints; what grows would end a process that is left to itself for days.  Two things are
looked at.  Python's own objects are counted, exactly: what is kept at each step shows within minutes.  And memory that
is this process' own is measured, with whatever else takes any.  Pages of programs and libraries on disk are left out:
they come and go with what else the machine does.
"""

from __future__ import annotations

import gc
import math
import os
import random
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from sma_actuator.base.signals import Output
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.driver import Driver
from sma_actuator.logs.recorder import BenchLogRecorder

from .hours import CONFIG
from .result import Result, Violation
from .stand import SOON_s, wait_until

#: After these everything is there that is there once: compiled code, full windows, full queues.
SETTLED_s = 600.0
SLICE_s = 60.0
#: What may come to it from then on, however long it lasts: an allocator gives and takes some pages, and Python keeps
#: some objects for the next use.
MOST_GROWN_B = 1_000_000
MOST_GROWN_OBJECTS = 1000


def own_memory_B(pid: int) -> int:
    """Memory of a process that is not that of files."""
    (own,) = (line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("RssAnon:"))
    return 1024 * int(own.split()[1])


@dataclass(frozen=True, slots=True)
class Footprint:
    """What this process takes."""

    memory_B: int  #: its own, not that of files
    objects: int  #: of Python

    @classmethod
    def now(cls) -> Self:
        """With all garbage collected."""
        gc.collect()
        return cls(own_memory_B(os.getpid()), sys.getallocatedblocks())


def attack(
    seed: int, seconds: float, settled_s: float = SETTLED_s, on_output: Callable[[Output], None] | None = None
) -> Result:
    """Drive for ``seconds`` of the bench's time; what is more than after ``settled_s`` is a broken promise."""
    result = Result()
    chance = random.Random(seed)
    footprints: list[tuple[float, Footprint]] = []
    with tempfile.TemporaryDirectory(prefix="sma_attack_") as folder:
        parameters = read_parameter_file(CONFIG / "flexinol.yaml")
        parameters["recorder"] = {"folder": folder, "max_files": 3, "max_file_size": 1_000_000}
        config = Config.from_mapping(parameters)
        bench = VirtualBench.from_name("flexinol", seed=seed)
        recorder = BenchLogRecorder(config)
        supply, daq = InProcessSupply(bench, config), InProcessDaq(bench, config)
        driver = Driver(config, supply, daq, VirtualClock(bench), on_output, recorder)
        driver.run_for(1.0)
        for look_s in (settled_s, 0.5 * (settled_s + seconds), seconds):
            while bench.time_s < look_s:
                driver.clear_fault()
                driver.enable(True)
                for _ in range(30):
                    driver.offer_setpoint(chance.choice((math.nan, chance.uniform(-0.001, 0.006))))
                    driver.run_for(SLICE_s / 30)
                driver.refusals()
                # A disk has a minute for a minute's rows; here a minute is over in a second.
                wait_until(lambda: not recorder.waiting_rows, SOON_s, "the log")
            footprints.append((bench.time_s, Footprint.now()))
        driver.stop()
        recorder.close()
    result.counts["virtual seconds"] += round(bench.time_s)
    result.counts["steps"] += driver.statistics().steps
    (begun_s, first), (_, middle), (ended_s, last) = footprints
    grown_B, grown_objects = last.memory_B - first.memory_B, last.objects - first.objects
    result.see("memory at the end [MB]", last.memory_B / 1e6)
    result.see("memory grown [kB]", grown_B / 1e3)
    result.see("memory grown in the second half [kB]", (last.memory_B - middle.memory_B) / 1e3)
    result.see("objects grown", grown_objects)
    if grown_B > MOST_GROWN_B or grown_objects > MOST_GROWN_OBJECTS:
        words = f"{grown_B} B and {grown_objects} objects in {(ended_s - begun_s) / 3600.0:.2f} h"
        result.violations.append(Violation("memory grows", words, f"python -m attack soak --hours {seconds / 3600:g}"))
    return result
