"""How long tracing takes: a session of 10 000 samples and ten logs of as many, with nothing, a zero error of the
voltage, or slips in them, by either type of model.

    python benchmarks/trace_speed.py

The last is the longest way: there each log slips where it likes, and pairs come near to the best name.  Seconds are of
the processor, so that what else runs on the machine counts little.
"""

from __future__ import annotations

import argparse
import itertools
import time

import blind_cases
from blind_cases import single, without_effects
from fits_from_nothing import THESIS, WHOLE_RANGE, identified
from rich.console import Console
from rich.table import Table

from sma_actuator.diagnosis.trace import Evidence, trace
from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.plant.worlds import HOME

LOGS, SAMPLES, RATE_Hz = 10, 10_000, 20.0
ALLOY = "furukawa"
HIDDEN = ("voltage_offset", "slip")

blind_cases.LOG_s = SAMPLES / RATE_Hz  # longer than those of the trial: nothing of these is kept
blind_cases.SESSION_s = 2.0 * blind_cases.LOG_s + blind_cases.PAUSE_s


def logs_of(name: str | None) -> list[BenchLog]:
    """Both logs of each of five sessions that last as long as so many samples."""
    out: list[BenchLog] = []
    for seed in range(LOGS // 2):
        case = without_effects(ALLOY, "weight", 9000 + seed)
        if name:
            case = single(name, ALLOY, 2.0, "weight", 9000 + seed)
        out += blind_cases._session(case)
    return out


def main() -> int:
    """Print the table; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.parse_args()
    table = Table(title=f"tracing logs of {SAMPLES} samples, on one core")
    for header in ("hidden", "model", "logs", "time, s", "verdict"):
        table.add_column(header, justify="right" if header in ("logs", "time, s") else "left")
    for name in (None, *HIDDEN):
        every = logs_of(name)
        for model, number in itertools.product((THESIS, WHOLE_RANGE), (1, LOGS)):
            config = identified(ALLOY, HOME, model)
            begun_s = time.process_time()
            found = trace(Evidence(every[:number], config), jobs=1)
            spent_s = time.process_time() - begun_s
            said = f"{found.verdict}: {' and '.join(found.fit.names)}" if found.verdict == "traced" else found.verdict
            table.add_row(name or "nothing", model, str(number), f"{spent_s:.0f}", said)
    Console(width=100).print(table)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
