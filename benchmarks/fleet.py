"""A fleet judged over a Dask cluster that shares no folder with its client, one worker killed on the way.

    python benchmarks/fleet.py [--wires N] [--logs N] [--workers N] [--command replay trace] [--json FILE]
    (make fleet)

Logs of so many wires on so many days are made on the virtual bench and put into an S3-compatible server (moto), and
nowhere else; some wires have an effect that grows.  ``replay --table`` judges all of them, ``trace --table`` those of
ten wires, each over a cluster of worker processes that stand in a folder of their own; once some rows are there a
worker is killed.  The rows must be those of one process, bit by bit, but for what tells of the worker.  Stated are logs
per second and core and the largest memory of a worker, for a tenth of the logs and for all.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import logging
import os
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

import fsspec
import joblib
import numpy as np
import yaml
from blind_cases import identified
from rich.console import Console

from sma_actuator.base.parameters import to_mapping
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock, Weight
from sma_actuator.bench.hidden.hiding import HiddenBench
from sma_actuator.characterise import Rig
from sma_actuator.characterise.plan import default_heat_current_A
from sma_actuator.characterise.programs import Drive
from sma_actuator.cli.main import main as sma_actuator
from sma_actuator.config import NODE_NAME, Config
from sma_actuator.fleet.table import OF_THE_WORKER, read_table
from sma_actuator.logs.bench_log import BenchLog, write_bench_log

BUCKET = "fleet"
EFFECTS = (("voltage_offset", 0.004), ("load_cell_drift", 0.3), ("reference_gain", 0.05))
EVERY = 10  #: one wire in so many drifts, from the middle of its days on
LOG_s = 30.0
TRACED_WIRES = 10
AWS = {"AWS_ACCESS_KEY_ID": "fleet", "AWS_SECRET_ACCESS_KEY": "fleet", "AWS_DEFAULT_REGION": "us-east-1"}


def one_log(wire: int, day: int, days: int, config: Config) -> BenchLog:
    """Some full and partial cycles of a wire on a day."""
    name, size = EFFECTS[wire // EVERY % len(EFFECTS)]
    late = max(day - days // 2, 0) / max(days - days // 2 - 1, 1) if wire % EVERY == 0 else 0.0
    seed = 1000 * wire + day
    hidden = {name: size * late} if late > 0.0 else {}
    load = Weight((0.6, 0.98, 1.5)[wire % 3])
    bench = HiddenBench.from_name("flexinol", seed=seed, load=load, hidden=hidden, session_s=LOG_s)
    rig = Rig(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    rng = np.random.default_rng(seed)
    low_A, high_A = config.supply.bias_current, default_heat_current_A(config)
    slow_s = config.thermal.heat_capacity / config.thermal.heat_loss
    steps = [(low_A, 2.0), (high_A, 4.0 * slow_s), (low_A, 6.0 * slow_s), (high_A, 4.0 * slow_s), (low_A, 6.0 * slow_s)]
    steps += [
        step
        for _ in range(20)
        for step in (
            (high_A * rng.uniform(0.85, 1.0), rng.uniform(0.6, 1.6) * slow_s),
            (low_A, rng.uniform(0.6, 2.0) * slow_s),
        )
    ]
    drive = np.concatenate([np.full(round(s * config.loop.rate), level) for level, s in steps])
    with rig.opened():
        log = rig.record(Drive(float(current_A)) for current_A in drive[: round(LOG_s * config.loop.rate)])
    started = f"2026-{1 + day // 28:02d}-{1 + day % 28:02d}T08:00:00+00:00"
    return BenchLog(log.columns, {"kind": "session", "started": started})


def put_logs(numbers: list[tuple[int, int]], days: int, config: Config, endpoint: str) -> None:
    """Make logs and put them into the bucket."""
    files = fsspec.filesystem("s3", endpoint_url=endpoint)
    with tempfile.TemporaryDirectory(prefix="sma_fleet_made_") as folder:
        for wire, day in numbers:
            path = Path(folder) / f"day_{day:03d}.csv"
            write_bench_log(path, one_log(wire, day, days, config))
            for each in (path, path.with_suffix(".json")):
                files.put_file(str(each), f"{BUCKET}/wire_{wire:03d}/{each.name}")


@contextlib.contextmanager
def server():
    """An S3-compatible server of this machine, known to this process and to those that it starts; its address."""
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    moto = ThreadedMotoServer(port=0, verbose=False)
    moto.start()
    endpoint = "http://{}:{}".format(*moto.get_host_and_port())
    before = {name: os.environ.get(name) for name in (*AWS, "AWS_ENDPOINT_URL")}
    os.environ.update(AWS, AWS_ENDPOINT_URL=endpoint)
    try:
        fsspec.filesystem("s3", endpoint_url=endpoint).mkdir(BUCKET)
        yield endpoint
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.__setitem__(name, value)
        moto.stop()


@contextlib.contextmanager
def cluster(workers: int):
    """A Dask cluster whose workers are processes in a folder of their own; its address and their process ids."""
    from dask.distributed import LocalCluster

    with (
        tempfile.TemporaryDirectory(prefix="sma_fleet_workers_") as folder,
        LocalCluster(
            n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0", local_directory=folder
        ) as made,
    ):
        yield (
            made.scheduler_address,
            [w.process.pid if hasattr(w.process, "pid") else w.pid for w in made.workers.values()],
        )


def kill_when(table: Path, pid: int, stop: threading.Event) -> None:
    """Kill a worker as soon as there are rows in the table."""
    while not stop.wait(0.05):
        if table.exists():
            os.kill(pid, signal.SIGKILL)
            return


def results_of(table: Path) -> list[str]:
    """The rows of a table with every digit, but for what tells of the worker, in order."""
    return sorted(repr({name: v for name, v in row.items() if name not in OF_THE_WORKER}) for row in read_table(table))


def judged(command: str, places: list[str], model: str, table: Path, *more: str) -> float:
    """Seconds that the command takes; raises RuntimeError where it fails."""
    begun = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        code = sma_actuator([command, *places, "--config", model, "--table", str(table), "-q", *more])
    if code != 0:
        raise RuntimeError(f"{command} ended with code {code}")
    return time.perf_counter() - begun


def main() -> int:
    """Make, judge, kill, compare; 0 where the rows are the same."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wires", type=int, default=100)
    parser.add_argument("--logs", type=int, default=1000, help="of all wires together")
    parser.add_argument("--workers", type=int, default=3)
    parser.add_argument("--command", nargs="+", choices=("replay", "trace"), default=["replay", "trace"])
    parser.add_argument("--report", type=Path, default=Path("out/fleet.html"))
    args = parser.parse_args()
    console = Console(width=200, highlight=False)
    config, days = identified("flexinol"), args.logs // args.wires
    with server() as endpoint, tempfile.TemporaryDirectory(prefix="sma_fleet_client_") as folder:
        model = f"s3://{BUCKET}/models/flexinol.yaml"
        text = yaml.safe_dump({NODE_NAME: {"ros__parameters": to_mapping(config)}})
        fsspec.filesystem("s3", endpoint_url=endpoint).pipe_file(model, text.encode())
        numbers = [(wire, day) for wire in range(args.wires) for day in range(days)]
        begun = time.perf_counter()
        joblib.Parallel(n_jobs=2)(joblib.delayed(put_logs)(numbers[k::8], days, config, endpoint) for k in range(8))
        console.print(f"{len(numbers)} logs of {args.wires} wires made in {time.perf_counter() - begun:.0f} s")
        same = True
        for command in args.command:
            wires = range(args.wires if command == "replay" else min(args.wires, TRACED_WIRES))
            for share in (10, 1):
                chosen = [wire for wire in wires if wire % share == 0]
                same &= compared(console, command, chosen, days, model, Path(folder), args.workers)
        table = Path(folder) / f"{args.command[-1]}_all.parquet"
        args.report.parent.mkdir(parents=True, exist_ok=True)
        sma_actuator(["fleet", str(table), "--report", str(args.report), "--force", "-q"])
    console.print("the rows are those of one process" if same else "the rows are not those of one process")
    return 0 if same else 1


def compared(
    console: Console, command: str, wires: list[int], days: int, model: str, folder: Path, workers: int
) -> bool:
    """The logs of some wires by one process and by a cluster of which a worker is killed; whether the rows are the
    same."""
    places = [f"s3://{BUCKET}/wire_{wire:03d}" for wire in wires]
    number = len(wires) * days
    alone, spread = folder / f"{command}_alone_{number}.parquet", folder / f"{command}_all.parquet"
    spread.unlink(missing_ok=True)
    alone_s = judged(command, places, model, alone, "--jobs", "1")
    stop = threading.Event()
    with cluster(workers) as (address, pids):
        killer = threading.Thread(target=kill_when, args=(spread, pids[0], stop))
        killer.start()
        cluster_s = judged(command, places, model, spread, "--dask", address)
        stop.set()
        killer.join()
    again_s = judged(command, places, model, spread, "--jobs", "1")
    rows = read_table(spread)
    cores = min(workers, os.cpu_count() or 1)
    console.print(
        f"{command}, {number} logs: one process {number / alone_s:.1f} logs/s; {workers} workers, one killed, "
        f"{number / cluster_s / cores:.1f} logs/s per core ({cores} cores), "
        f"{max(r['peak_memory_MB'] for r in rows):.0f} MB at the most "
        f"in a worker; asked again {again_s:.1f} s, {len(read_table(spread)) - len(rows)} rows more"
    )
    return results_of(alone) == results_of(spread) and len(read_table(spread)) == len(rows) == number


if __name__ == "__main__":
    sys.exit(main())
