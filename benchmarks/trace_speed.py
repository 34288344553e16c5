"""How long tracing takes: ten logs of 10 000 samples, with nothing, a zero error of the voltage, or slips in them.

    python benchmarks/trace_speed.py [--jobs 2]

The last is the longest way: there each session slips where it likes, and pairs come near to the best name.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from blind_cases import identified, make_logs, single, without_effects
from rich.console import Console
from rich.table import Table

from sma_actuator.diagnosis.trace import Evidence, trace
from sma_actuator.logs.bench_log import BenchLog, read_bench_log

LOGS, SAMPLES = 10, 10_000
ALLOY = "furukawa"
HIDDEN = ("voltage_offset", "slip")


def logs_of(name: str | None) -> list[BenchLog]:
    """Ten logs from the middle of five sessions."""
    out: list[BenchLog] = []
    for seed in range(LOGS // 2):
        case = without_effects(ALLOY, "weight", 9000 + seed)
        if name:
            case = single(name, ALLOY, 2.0, "weight", 9000 + seed)
        with tempfile.TemporaryDirectory(prefix="sma_speed_") as folder:
            for path in make_logs(case, Path(folder)):
                log = read_bench_log(path)
                first = (len(log) - SAMPLES) // 2
                columns = {key: np.asarray(values)[first : first + SAMPLES] for key, values in log.columns.items()}
                out.append(replace(log, columns=columns))
    return out


def main() -> int:
    """Print the table; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="fits at a time (default %(default)s)")
    jobs = parser.parse_args().jobs
    config = identified(ALLOY)
    table = Table(title=f"tracing {LOGS} logs of {SAMPLES} samples, {jobs} fits at a time, {os.cpu_count()} cores")
    for header in ("hidden", "time, s", "verdict"):
        table.add_column(header, justify="right" if "time" in header else "left")
    for name in (None, *HIDDEN):
        logs = logs_of(name)
        begun_s = time.perf_counter()
        found = trace(Evidence(logs, config), jobs=jobs)
        spent_s = time.perf_counter() - begun_s
        said = f"{found.verdict}: {' and '.join(found.fit.names)}" if found.verdict == "traced" else found.verdict
        table.add_row(name or "nothing", f"{spent_s:.0f}", said)
    Console(width=80).print(table)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
