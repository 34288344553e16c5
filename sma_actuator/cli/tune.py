"""``sma-actuator tune``: gains for a wire from the wire itself, written to its parameter file.

With the instruments of that file, or by a running node, whose gains they then are as well.
"""

from __future__ import annotations

import argparse
import dataclasses
import queue
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from sma_actuator.base.errors import UserError
from sma_actuator.base.interrupts import noted_signals
from sma_actuator.base.options import number_within
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Mode, Output, Tuned
from sma_actuator.bench.real import physics_name
from sma_actuator.config import Config, copy_tables, text_with
from sma_actuator.console import add_output_arguments, notes, refuse_to_overwrite, results, say_next, typed, write_json
from sma_actuator.control.pid import PidParameters
from sma_actuator.control.tuning import GAINS, words_of
from sma_actuator.driver import Driver, DriverStopped
from sma_actuator.logs.files import write_atomically
from sma_actuator.plant.loads import parse_load
from sma_actuator.plant.worlds import HOME

from .remote.client import add_node_arguments
from .remote.tune import by_node

#: What is refused for so long is refused for good: a wire of which nothing is known counts as cool by then.
PATIENCE_s = 180.0
SILENCE_s = 5.0  #: an output comes more often than this


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator tune``."""
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="parameter file of the wire")
    parser.add_argument(
        "--running", action="store_true", help="have the running node tune its wire, which must be enabled"
    )
    parser.add_argument(
        "--out", type=Path, metavar="NEW.yaml", help="write here (default: FILE, where the old gains stay as a comment)"
    )
    parser.add_argument(
        "--current",
        type=number_within(0.0),
        metavar="A",
        help="no more flows than this (default: by controller.tuning_current)",
    )
    parser.add_argument(
        "--virtual", choices=("flexinol", "furukawa", "coil", "bundle"), help="on this wire of the virtual bench"
    )
    parser.add_argument(
        "--physics", type=physics_name, default=HOME, metavar="NAME", help="with --virtual: its physics"
    )
    parser.add_argument(
        "--load", metavar="LOAD", help="with --virtual: weight:N or spring:N/m,N (default: the bench's own)"
    )
    add_node_arguments(parser)
    add_output_arguments(parser, "what was found")


def run(args: argparse.Namespace) -> int:
    """Tune, and write the gains; 0 when they are written."""
    refuse_to_overwrite(args, args.out)
    config = Config.load(args.config)
    if args.running and (args.virtual or args.current is not None):
        raise UserError("--running: the node has its instruments and its bound (controller.tuning_current) already")
    out = args.out or args.config
    gains_of_before = {name: getattr(config.controller, name, 0.0) for name in GAINS}
    # else a file that cannot take them is found out too late
    _with_gains(args.config, gains_of_before, gains_of_before)
    found = by_node(args) if args.running else _by_instruments(config, args)
    text = _with_gains(args.config, found.gains, found.before)
    try:
        copy_tables(args.config, out)
        write_atomically(out, lambda stream: stream.write(text.encode()))
    except OSError as error:
        raise UserError(
            f"{out}: not written ({error.strerror or error}); the gains are {words_of(found.gains)}"
        ) from error
    results(args).print(
        f"{words_of(found.gains)} after {found.duration_s:.0f} s (before: {words_of(found.before)}); written to {out}"
    )
    write_json(args, dataclasses.asdict(found))
    if not args.running:
        say_next(args, f"sma_actuator_node --ros-args --params-file {typed(out)}")
    return 0


def _by_instruments(config: Config, args: argparse.Namespace) -> Tuned:
    """Tune with the instruments of the file; the output is off afterwards."""
    if args.current is not None:
        config = config.replace({"controller.tuning_current": args.current / config.supply.max_current})
    config = bounded(config)
    console = notes(args)
    with noted_signals() as interrupts:
        console.print("current will flow for some minutes; Ctrl-C ends it with the output off")
        outputs: queue.SimpleQueue[Output] = queue.SimpleQueue()
        driver, step = _driver(config, args, outputs.put)
        try:
            with driver:
                steps = _steps(step, outputs, lambda: bool(interrupts))
                found = tune(driver, steps, console.print)
        except (DriverStopped, TimeoutError) as error:
            raise UserError(f"{error}; {driver.output_words}") from error
        finally:
            if not driver.output_is_off:
                console.print(f"{driver.output_words}: look at the supply, switch it off by hand")
        interrupts.raise_noted()
    if found is None:
        raise UserError("the loop ended before there were gains")
    return found


def bounded(config: Config) -> Config:
    """Parameters with which no more than the bound flows before the tuning either, while the wire is held."""
    if not isinstance(config.controller, PidParameters):
        return config  # it will be refused
    bound_A = config.controller.tuning_current * config.supply.max_current
    return config.replace({"supply.max_current": bound_A, "controller.tuning_current": 1.0})


def tune(driver: Driver, outputs: Iterator[Output], tell: Callable[[str], None]) -> Tuned | None:
    """Have the wire of a driver tuned, from off to off; None where the outputs end.  Raises UserError where it is given
    up."""
    driven, told = False, ""
    refused_s: float | None = None
    for output in outputs:
        status, tuning = output.status, str(output.status.values["tuning"])
        if output.tuned is not None or tuning.startswith("given up"):
            driver.enable(False)
            if output.tuned is None:
                raise UserError(tuning)
            return output.tuned
        if status.mode is Mode.TUNING:
            if tuning != told:
                tell(tuning)
            told = tuning
            continue
        if status.mode is Mode.OFF and driven:
            raise UserError(status.message)
        if output.reading is None:
            continue
        driven = driven or status.mode is not Mode.OFF
        done, words = driver.tune() if driven else driver.enable(True)
        if done:
            refused_s = None
        elif refused_s is None:
            refused_s = output.reading.time_s
            tell(words)
        elif output.reading.time_s - refused_s > PATIENCE_s:
            raise UserError(words)
    return None


def _with_gains(path: Path, gains: Mapping[str, float], before: Mapping[str, float]) -> str:
    """The parameter file at ``path`` with other gains, and those of before as a comment.  Raises ConfigError."""
    return text_with(path, "controller", gains, f"Tuned; before: {words_of(before)}")


def _steps(
    step: Callable[[], object] | None, outputs: queue.SimpleQueue[Output], interrupted: Callable[[], bool]
) -> Iterator[Output]:
    """Every output of a loop, of one in a thread of its own where there is no ``step``, until a signal comes."""
    while not interrupted():
        if step is not None:
            step()
            if outputs.empty():
                continue
        try:
            yield outputs.get(timeout=SILENCE_s)
        except queue.Empty:
            raise UserError(f"no step of the loop within {SILENCE_s:g} s") from None


def _driver(
    config: Config, args: argparse.Namespace, on_output: Callable[[Output], None]
) -> tuple[Driver, Callable[[], object] | None]:
    """A driver, and what steps it where nothing else does."""
    if args.virtual:
        from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock, setup_of

        try:
            load = parse_load(args.load) if args.load else None
        except ValueError as error:
            raise ConfigError(f"--load: {error}") from error
        setup = setup_of(args.virtual, config, "--virtual")
        bench = VirtualBench.from_name(args.virtual, load=load, physics=args.physics, **setup)
        driver = Driver(
            config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench), on_output
        )
        return driver, lambda: driver.run_for(1.0 / config.loop.rate)
    from sma_actuator.instruments import open_instruments
    from sma_actuator.instruments.clock import MonotonicClock

    clock = MonotonicClock()
    driver = Driver(config, *open_instruments(config, clock), clock, on_output)
    driver.open()
    driver.start()
    return driver, None
