"""A fleet of wires traced at once: the same work one after the other, on this machine's cores, and on a local Dask cluster.

    python benchmarks/fleet.py [--wires N] [--workers N]     (make fleet)

joblib spreads the wires; which of its backends does it is decided around the call, not in it, so a
Dask or Ray cluster serves without new code.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import joblib
from blind_cases import cases, identified, make_logs
from dask.distributed import Client, LocalCluster
from rich.console import Console

from sma_actuator.diagnosis.trace import Evidence, trace
from sma_actuator.logs.bench_log import read_bench_log


def trace_wire(logs, config) -> tuple[str, tuple[str, ...], float]:
    """Verdict, names and error after of one wire."""
    evidence = Evidence(logs, config)
    found = trace(evidence, jobs=1)
    return found.verdict, found.fit.names if found.fit else (), float(found.errors_percent["after"].mean())


def trace_fleet(wires) -> list:
    """Every wire, (logs, model), by joblib's backend of the moment."""
    return joblib.Parallel(n_jobs=-1)(joblib.delayed(trace_wire)(logs, config) for logs, config in wires)


def main() -> int:
    """Experiment the fleet three ways and compare; 0 where all three say the same."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wires", type=int, default=8)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    console = Console()
    chosen = [c for c in cases(1, (1,)) if c.kind == "single"][: args.wires]
    wires = []
    for case in chosen:
        with tempfile.TemporaryDirectory(prefix="sma_fleet_") as folder:
            wires.append(([read_bench_log(path) for path in make_logs(case, Path(folder))], identified(case.alloy)))
    trace_wire(*wires[0])  # compiled before the clock runs
    answers, took = {}, {}

    def timed(name: str) -> None:
        begun = time.perf_counter()
        answers[name] = trace_fleet(wires)
        took[name] = time.perf_counter() - begun

    with joblib.parallel_config("sequential"):
        timed("one after the other")
    with joblib.parallel_config("loky", n_jobs=args.workers):
        timed(f"{args.workers} processes")
    with (
        LocalCluster(n_workers=args.workers, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster),
        joblib.parallel_config("dask"),
    ):
        timed(f"Dask cluster of {args.workers} workers")
    for name, seconds in took.items():
        console.print(
            f"{len(wires)} wires, {name}: {seconds:.1f} s ({took['one after the other'] / seconds:.2f} × the first)"
        )
    for case, answer in zip(chosen, answers["one after the other"], strict=True):
        console.print(
            f"  {', '.join(case.hidden)} ({case.alloy}): {answer[0]} {' + '.join(answer[1])}, {answer[2]:.2f} % after"
        )
    first, *others = answers.values()
    same = all(other == first for other in others)
    console.print("all three say the same" if same else "they do not say the same")
    return 0 if same else 1


if __name__ == "__main__":
    raise SystemExit(main())
