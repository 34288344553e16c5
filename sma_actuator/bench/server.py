"""The virtual bench as a process: its two instruments on TCP ports, in real time or faster.

One thread serves everything, so no lock is needed: physics, instruments and connections take
turns.  The bench is advanced before every command to the time it is then, and between commands
often enough that no command ever waits for a long past to be caught up.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from sma_actuator.base.jit import at_once
from sma_actuator.base.options import number_within
from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.base.parameters import ConfigError
from sma_actuator.bench.real import PHYSICS, physics_name
from sma_actuator.config import bench_from_mapping
from sma_actuator.console import refuse_to_overwrite, say_next
from sma_actuator.instruments import InstrumentError
from sma_actuator.logs.files import write_atomically
from sma_actuator.plant.joint import Joint, parse_joint
from sma_actuator.plant.loads import Load, parse_load
from sma_actuator.plant.materials import WIRES
from sma_actuator.plant.worlds import HOME

from .bench import VirtualBench, setup_of, wire_of_alloy
from .faults import FAULTS, parse_fault
from .joint import JointBench
from .scpi import Client, Instrument, ScpiDaq, ScpiError, ScpiSupply

TICK_s = 0.02
LONGEST_TURN_s = 0.05  #: real time spent on physics before connections are served again
CHUNK_s = 0.25
SUMMARY = "the virtual bench: a wire behind two SCPI instruments"


class Pacer:
    """Holds the time of a bench to that of the machine, times ``speed``.

    A machine that cannot keep up, or that slept, lets the bench's time lag instead of freezing
    its instruments.
    """

    def __init__(self, bench: VirtualBench, speed: float, now_s: Callable[[], float] = time.monotonic):
        self.bench = bench
        self.speed = speed
        self._now_s = now_s
        self._real_0_s = now_s()
        self._bench_0_s = bench.time_s

    def catch_up(self) -> None:
        """Advance the bench to now."""
        began_s = self._now_s()
        target_s = self._bench_0_s + (began_s - self._real_0_s) * self.speed
        while self.bench.time_s < target_s - 1e-3:
            self.bench.advance(min(target_s, self.bench.time_s + CHUNK_s))
            if self._now_s() - began_s > LONGEST_TURN_s:
                self._real_0_s, self._bench_0_s = self._now_s(), self.bench.time_s
                return

    def real_s_until(self, bench_s: float) -> float:
        """Real seconds until the bench's time is ``bench_s``."""
        return max(bench_s - self.bench.time_s, 0.0) / self.speed


class BenchServer:
    """One or more benches, each behind a supply port and a DAQ port."""

    def __init__(self, benches: VirtualBench | Sequence[VirtualBench], speed: float = 1.0):
        self.benches = [benches] if isinstance(benches, VirtualBench) else list(benches)
        _warm_up(self.benches[0])  # before the ports open, not after
        self.ports: list[dict[str, Any]] = []
        self._pacers = [Pacer(bench, speed) for bench in self.benches]
        for number, bench in enumerate(self.benches):
            if bench.joint is not None:  # benches of one joint have one time
                self._pacers[number] = self._pacers[self.benches.index(bench.joint.benches[0])]
        self._servers: list[asyncio.Server] = []
        self._writers: dict[Instrument, set[asyncio.StreamWriter]] = {}
        self._tasks: set[asyncio.Task] = set()

    async def start(self, host: str = "127.0.0.1", supply_port: int = 0, daq_port: int = 0) -> None:
        """Open the ports (0: any free one; else consecutive pairs).  Raises InstrumentError where one is taken."""
        for number, (bench, pacer) in enumerate(zip(self.benches, self._pacers, strict=True)):
            ports: dict[str, Any] = {"host": host, "wire": bench.setup.wire.name}
            for kind, first in ((ScpiSupply, supply_port), (ScpiDaq, daq_port)):
                instrument = kind(bench, serial=str(number))
                port = first + 2 * number if first else 0
                try:
                    server = await asyncio.start_server(self._serve(instrument, pacer), host, port)
                except (OSError, OverflowError) as error:
                    await self.stop()
                    raise InstrumentError(
                        f"{host}:{port} cannot be opened for the {instrument.name}: {error}"
                    ) from error
                self._servers.append(server)
                self._writers[instrument] = set()
                ports[instrument.name] = server.sockets[0].getsockname()[1]
            self.ports.append(ports)
        self._tasks.add(asyncio.create_task(self._keep_time()))

    async def stop(self) -> None:
        """Close every port and connection."""
        for server in self._servers:
            server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _keep_time(self) -> None:
        while True:
            for pacer in self._pacers:
                pacer.catch_up()
            for instrument in self._writers:
                if f"{instrument.name}_hangup" in instrument.bench.faults:
                    self._hang_up(instrument)
            await asyncio.sleep(TICK_s)

    def _hang_up(self, instrument: Instrument) -> None:
        for writer in self._writers[instrument]:
            writer.close()

    def _serve(self, instrument: Instrument, pacer: Pacer):
        faults = instrument.bench.faults

        async def connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            client = Client()
            task = asyncio.current_task()
            assert task is not None  # we are in one
            self._tasks.add(task)
            self._writers[instrument].add(writer)
            try:
                while f"{instrument.name}_hangup" not in faults:
                    try:
                        raw = await reader.readline()
                    except ValueError:  # no end of line within 64 KiB
                        instrument.report(ScpiError(-363))
                        continue
                    if not raw:
                        break
                    line = raw.decode("ascii", errors="replace").strip()
                    pacer.catch_up()
                    for_the_bench = line.lstrip(":").upper().startswith("BENC")
                    if not for_the_bench:
                        if f"{instrument.name}_silent" in faults or f"{instrument.name}_hangup" in faults:
                            continue
                        if delay_s := faults.get("slow_answers", 0.0):
                            await asyncio.sleep(delay_s)
                            pacer.catch_up()
                    answer = await self._answer(instrument, pacer, line, client)
                    if answer is not None:
                        writer.write(answer.encode("ascii", errors="replace") + b"\n")
                        await writer.drain()
            except (OSError, asyncio.CancelledError):
                pass  # the other side is gone, or we are going
            finally:
                self._tasks.discard(task)
                self._writers[instrument].discard(writer)
                instrument.disconnected(client)
                writer.close()

        return connection

    async def _answer(self, instrument: Instrument, pacer: Pacer, line: str, client: Client) -> str | None:
        steps = instrument.steps(line, client)
        while True:
            try:
                until_s = next(steps)
            except StopIteration as end:
                return end.value
            while pacer.bench.time_s < until_s - 1e-9:
                await asyncio.sleep(max(pacer.real_s_until(until_s), 1e-4))
                pacer.catch_up()


def _warm_up(like: VirtualBench) -> None:
    """Run every kernel that an answer can reach, on a bench that nobody asks: compiling takes seconds, once on a
    machine."""
    bench = VirtualBench(like.setup)
    bench.advance(0.01)
    bench.daq.block(1)
    if isinstance(like.joint, JointBench):
        JointBench(bench, VirtualBench(like.setup), like.joint.joint).advance(0.02)


async def _run(
    server: BenchServer, host: str, supply_port: int, daq_port: int, ready: Callable[[], None], stop: asyncio.Event
) -> None:
    with at_once():
        await server.start(host, supply_port, daq_port)
        try:
            ready()
            await stop.wait()
        finally:
            await server.stop()


@contextlib.contextmanager
def background(
    benches: VirtualBench | Sequence[VirtualBench],
    speed: float = 1.0,
    host: str = "127.0.0.1",
    supply_port: int = 0,
    daq_port: int = 0,
) -> Iterator[BenchServer]:
    """Serve benches from a thread of this process while the block lasts; ``server.ports`` says where.

    The benches belong to that thread: reach them through their ports (``BENCh:`` commands) alone.
    """
    server = BenchServer(benches, speed)
    loop = asyncio.new_event_loop()
    started = threading.Event()
    stop = asyncio.Event()
    failed: list[Exception] = []

    def work() -> None:
        try:
            loop.run_until_complete(_run(server, host, supply_port, daq_port, started.set, stop))
        except (InstrumentError, OSError) as error:
            failed.append(error)
        finally:
            started.set()

    thread = threading.Thread(target=work, name="virtual bench", daemon=True)
    thread.start()
    started.wait()
    try:
        if failed:
            raise failed[0]
        yield server
    finally:
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(stop.set)
        thread.join()
        loop.close()


def serve(
    benches: VirtualBench | Sequence[VirtualBench],
    host: str = "127.0.0.1",
    supply_port: int = 0,
    daq_port: int = 0,
    speed: float = 1.0,
    ports_file: Path | None = None,
) -> None:
    """Serve until SIGINT or SIGTERM.  The ports are printed and, when ready, written to ``ports_file`` (JSON).

    Raises InstrumentError where a port cannot be opened.
    """
    server = BenchServer(benches, speed)

    def announce() -> None:
        for number, ports in enumerate(server.ports):
            print(
                f"bench {number} ({server.benches[number].setup.wire.text}): "
                f"supply TCPIP::{host}::{ports['supply']}::SOCKET, DAQ TCPIP::{host}::{ports['daq']}::SOCKET",
                flush=True,
            )
        if ports_file is not None:
            text = json.dumps(server.ports) + "\n"
            write_atomically(ports_file, lambda stream: stream.write(text.encode()))

    async def work() -> None:
        stop = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        await _run(server, host, supply_port, daq_port, announce, stop)

    asyncio.run(work())


def _checked(function: Callable[[str], Any]) -> Callable[[str], Any]:
    """Let argparse show the sentence of a ValueError."""

    def convert(text: str) -> Any:
        try:
            return function(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    return convert


def _parse_load(text: str) -> Load | Joint:
    kind, _, values = text.partition(":")
    return parse_joint(values) if kind == "joint" else parse_load(text)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator bench``."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    _of_the_wire(parser)
    _of_the_sockets(parser)
    parser.add_argument(
        "--fault",
        type=_checked(parse_fault),
        action="append",
        default=[],
        metavar="NAME[=VALUE][@SECONDS]",
        help="misbehave, from a bench time on; may be given often",
    )
    parser.epilog = "faults:\n" + "\n".join(
        f"  {name:18} {fault.effect}"
        + (f" (value in {fault.value}, {fault.default:g} if not given)" if fault.value else "")
        for name, fault in FAULTS.items()
    )


def _of_the_wire(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--wire", choices=sorted(WIRES), help="default flexinol; with --config the first of these of its alloy"
    )
    parser.add_argument(
        "--physics",
        type=physics_name,
        default=HOME,
        metavar="NAME",
        help=f"what the wire is made of and how it transforms: {PHYSICS} (default %(default)s)",
    )
    parser.add_argument(
        "--config",
        type=Path,
        metavar="BENCH.yaml",
        help="the wire has the size and form of the one in this file, as `init` writes it, and the bench its sense "
        "resistor and a supply that gives what it asks for (default: its own)",
    )
    parser.add_argument(
        "--load",
        type=_checked(_parse_load),
        metavar="LOAD",
        help="weight:N, spring:N/m,N[,m] (stiffness, tension, displacement where it has it), schedule:s,N,s,N,… or "
        "joint:m,m[,m] (radius of the pulley, displacement of both or each of two wires at angle zero), which takes "
        "two benches (default weight:0.98; of a coil, a bundle or another diameter, the same stress)",
    )
    parser.add_argument(
        "--ambient", type=number_within(-40, 100), default=22.0, metavar="°C", help="default %(default)s"
    )
    parser.add_argument(
        "--seed", type=number_within(0, kind=int), default=0, help="seed of the noise; bench i takes seed + i"
    )
    parser.add_argument(
        "--speed", type=number_within(0.01, 1e4), default=1.0, help="bench seconds per second (default %(default)s)"
    )
    parser.add_argument(
        "--count",
        type=number_within(1, 256, kind=int),
        default=1,
        help="benches, or joints of two benches, each bench on its own pair of ports",
    )


def _of_the_sockets(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default %(default)s)")
    parser.add_argument(
        "--supply-port",
        type=number_within(0, 65535, kind=int),
        default=5025,
        help="0: any free port (default %(default)s)",
    )
    parser.add_argument(
        "--daq-port",
        type=number_within(0, 65535, kind=int),
        default=5026,
        help="0: any free port (default %(default)s)",
    )
    parser.add_argument(
        "--ports-file", type=Path, metavar="FILE", help="write the ports here, as JSON, once they are open"
    )
    parser.add_argument("--force", action="store_true", help="overwrite the file of the ports if it exists already")


def run(args: argparse.Namespace) -> int:
    """Serve the benches that the options ask for; 0 after SIGINT or SIGTERM."""
    refuse_to_overwrite(args, args.ports_file)
    config = bench_from_mapping(read_parameter_file(args.config), str(args.config)) if args.config else None
    if config and isinstance(args.load, Joint):
        raise ConfigError(
            "--config: the wires of a joint have their own size; leave out one of --config and --load joint"
        )
    wire = args.wire or (wire_of_alloy(config.wire.alloy) if config else "flexinol")
    setup = {"ambient_C": args.ambient} | (setup_of(wire, config, "--wire") if config else {})
    benches: list[VirtualBench] = []
    for number in range(args.count):
        if isinstance(args.load, Joint):
            joint = JointBench.from_name(wire, args.load, args.seed + 2 * number, args.physics, args.ambient)
            benches += joint.benches
        else:
            seed = args.seed + number
            benches.append(VirtualBench.from_name(wire, seed, args.load, physics=args.physics, **setup))
    for bench in benches:
        for name, value, at_s in args.fault:
            bench.inject(name, value, at_s=at_s)
    say_next(args, "name these as instruments.supply.resource and instruments.daq.resource; Ctrl-C ends the bench")
    serve(benches, args.host, args.supply_port, args.daq_port, args.speed, args.ports_file)
    return 0


if __name__ == "__main__":
    command = argparse.ArgumentParser(prog="python -m sma_actuator.bench.server", description=SUMMARY)
    add_arguments(command)
    sys.exit(run(command.parse_args()))
