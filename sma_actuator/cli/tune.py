"""``sma-actuator tune``: gains for a wire from the wire itself, written to its parameter file."""

from __future__ import annotations

import argparse
import dataclasses
import queue
from collections.abc import Callable, Iterator
from pathlib import Path

from sma_actuator.base.errors import UserError
from sma_actuator.base.interrupts import noted_signals
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Mode, Output, Tuned
from sma_actuator.base.yaml_text import with_values
from sma_actuator.config import NODE_NAME, Config, read_sections
from sma_actuator.console import add_output_arguments, notes, refuse_to_overwrite, results, write_json
from sma_actuator.control.tuning import words_of
from sma_actuator.driver import Driver
from sma_actuator.logs.files import write_atomically
from sma_actuator.plant.loads import parse_load
from sma_actuator.plant.worlds import HOME, WORLDS

#: A wire of which nothing is known counts as cool after this time; and an output comes at least this often.
COOLING_s, SILENCE_s = 180.0, 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator tune``."""
    parser.add_argument("--config", type=Path, required=True, metavar="FILE", help="parameter file of the wire")
    parser.add_argument(
        "--out", type=Path, metavar="NEW.yaml", help="write here (default: FILE, where the old gains stay as a comment)"
    )
    parser.add_argument(
        "--current", type=float, metavar="A", help="no more flows than this (default: by controller.tuning_current)"
    )
    parser.add_argument("--virtual", choices=("flexinol", "furukawa"), help="on this wire of the virtual bench")
    parser.add_argument("--physics", choices=WORLDS, default=HOME, metavar="NAME", help="with --virtual: its physics")
    parser.add_argument(
        "--load", default="weight:0.98", metavar="LOAD", help="with --virtual: weight:N or spring:N/m,N"
    )
    add_output_arguments(parser, "what was found")


def run(args: argparse.Namespace) -> int:
    """Tune with the instruments of the file, and write the gains; 0 when they are written."""
    refuse_to_overwrite(args, args.out)
    config = Config.load(args.config)
    if args.current is not None:
        config = config.replace({"controller.tuning_current": args.current / config.supply.max_current})
    console = notes(args)
    with noted_signals() as interrupts:
        console.print("current will flow for some minutes; Ctrl-C ends it with the output off")
        outputs: queue.SimpleQueue[Output] = queue.SimpleQueue()
        driver, step = _driver(config, args, outputs.put)
        with driver:
            found = tune(
                driver,
                _steps(step, outputs, lambda: bool(interrupts)),
                lambda words: console.print(words, markup=False),
            )
        interrupts.raise_noted()
    out = args.out or args.config
    write_gains(args.config, out, found)
    results(args).print(
        f"{words_of(found.gains)} after {found.duration_s:.0f} s (before: {words_of(found.before)}); written to {out}",
        markup=False,
    )
    write_json(args, dataclasses.asdict(found))
    return 0


def tune(driver: Driver, outputs: Iterator[Output], tell: Callable[[str], None]) -> Tuned:
    """Have the wire of a driver tuned, from off to off.  Raises UserError where it came to nothing."""
    begun_s, words, refused = None, "", False
    for output in outputs:
        time_s = output.signals.time_s
        if begun_s is None and time_s == time_s:
            begun_s = time_s
        if output.tuned is not None:
            driver.enable(False)
            return output.tuned
        tuning = str(output.status.values["tuning"])
        if output.status.mode is Mode.TUNING and tuning != words:
            words = tuning
            tell(words)
        if tuning.startswith("given up"):
            driver.enable(False)
            raise UserError(tuning)
        if output.status.fault:
            raise UserError(output.status.message)
        if output.status.mode is Mode.OFF and output.reading is not None:
            driver.enable(True)
        elif output.status.mode is Mode.HOLD:
            done, refusal = driver.tune()
            if not done and begun_s is not None and time_s - begun_s > COOLING_s:
                raise UserError(refusal)
            if not done and not refused:
                refused = True
                tell(refusal)
    raise UserError("interrupted")


def write_gains(path: Path, out: Path, found: Tuned) -> None:
    """The parameter file at ``path`` with the gains that were found, at ``out``; those of before as a comment."""
    sections = read_sections(path)
    node = next((name for name in (NODE_NAME, f"/{NODE_NAME}", "/**") if name in sections), NODE_NAME)
    text = with_values(
        path.read_text(encoding="utf-8-sig"),
        str(path),
        (node, "ros__parameters", "controller"),
        found.gains,
        f"Tuned; before: {words_of(found.before)}",
    )
    write_atomically(out, lambda stream: stream.write(text.encode()))
    written = Config.load(out).controller
    if any(getattr(written, name) != value for name, value in found.gains.items()):
        raise ConfigError(f"{out}: the gains were not written as they should be: {words_of(found.gains)}")


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
        from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock

        try:
            load = parse_load(args.load)
        except ValueError as error:
            raise ConfigError(f"--load: {error}") from error
        size_m = (config.wire.length, config.wire.diameter)
        bench = VirtualBench.from_name(args.virtual, size_m=size_m, load=load, physics=args.physics)
        driver = Driver(
            config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench), on_output
        )
        return driver, lambda: driver.run_for(1.0 / config.loop.rate)
    from sma_actuator.instruments import open_daq, open_supply
    from sma_actuator.instruments.clock import MonotonicClock

    clock = MonotonicClock()
    driver = Driver(config, open_supply(config), open_daq(config, clock), clock, on_output)
    driver.open()
    driver.start()
    return driver, None
