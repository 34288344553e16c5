"""``sma-actuator check``: the self-test, on instruments that no node holds; and before a wire is heated for the first
time."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from sma_actuator.base.commands import as_commands
from sma_actuator.base.errors import UserError
from sma_actuator.base.interrupts import noted_signals
from sma_actuator.base.parameter_file import read_parameter_file
from sma_actuator.config import BenchConfig, Config, config_from_mapping, require_sense_resistor
from sma_actuator.console import add_output_arguments, notes, refuse_to_overwrite, results, say_next, typed, write_json
from sma_actuator.instruments import Clock, Daq, PowerSupply, open_daq, open_instruments

from .found import Found, Level, passed
from .selftest import SelfTest

PATIENCE_s = 5.0  #: for an answer, to see how late it is
_MARKS = {Level.OK: "ok", Level.WARNING: "look", Level.WRONG: "WRONG"}


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator check``."""
    parser.add_argument(
        "--config", type=Path, required=True, metavar="FILE", help="parameter file of the wire, with a model or without"
    )
    parser.add_argument(
        "--virtual", choices=("flexinol", "furukawa", "coil", "bundle"), help="on this wire of the virtual bench"
    )
    add_output_arguments(parser, "what was found")


def run(args) -> int:
    """Test; 0 where nothing is wrong."""
    refuse_to_overwrite(args)
    config = config_from_mapping(read_parameter_file(args.config), str(args.config))
    require_sense_resistor(config)
    with noted_signals() as interrupts:
        supply, daq, clock = _instruments(config, args.virtual)
        test = SelfTest(config, supply, daq, clock, None if args.virtual else _opening(config, clock))
        if not args.virtual:
            test.as_written = lambda: open_instruments(config, clock)
        found = _test(test, config, lambda: bool(interrupts), notes(args), results(args))
        write_json(args, [dataclasses.asdict(each) | {"level": each.level.name.lower()} for each in found])
        interrupts.raise_noted()
    again = f"sma-actuator check --config {typed(args.config)}"
    say_next(args, next_step(config, args.config) if passed(found) else f"mend that, then look again: {again}")
    return 0 if passed(found) else 1


def look_first(config: BenchConfig, supply: PowerSupply, daq: Daq, clock: Clock, console: Console) -> None:
    """Look at the wiring before a wire is heated.  Raises UserError where it is not as the parameters say."""
    console.print("first the wiring is checked, with the wire between its crimps")
    with noted_signals() as interrupts:
        found = _test(SelfTest(config, supply, daq, clock), config, lambda: bool(interrupts), console, console)
        interrupts.raise_noted()
    if not passed(found):
        wrong = "; ".join(f"{each.part}: {each.sentence}" for each in found if each.level is Level.WRONG)
        raise UserError(
            f"nothing was heated, since the wiring is not what the bench file says: {wrong}. Mend that and start "
            "again; `--skip check` goes on regardless"
        )


def _test(
    test: SelfTest, config: BenchConfig, interrupted: Callable[[], bool], before: Console, lines: Console
) -> list[Found]:
    """Test, and print a line for each part."""
    most_A = min(2.0 * config.supply.bias_current, config.supply.max_current)
    before.print(f"at most {1e3 * most_A:g} mA will flow; the output is off afterwards")
    found = test.run(interrupted)
    for each in found:
        lines.print(f"{_MARKS[each.level]:6} {each.part:15} {as_commands(each.sentence)}")
    return found


def next_step(config: BenchConfig, path: Path) -> str:
    """What to do with a parameter file whose wiring is right."""
    file = typed(path)
    if isinstance(config, Config):
        return f"drive the wire: sma_actuator_node --ros-args --params-file {file}"
    if not config.instruments.daq.lvdt_channel:  # which characterise needs
        return f"identify a model from logs of the wire: sma-actuator identify LOG… --config {file} --out my_wire.yaml"
    return f"measure the wire: sma-actuator characterise --config {file} --out out/wire"


def _instruments(config: BenchConfig, virtual: str | None) -> tuple[PowerSupply, Daq, Clock]:
    if virtual:
        from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock, setup_of

        bench = VirtualBench.from_name(virtual, **setup_of(virtual, config, "--virtual"))
        return InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)
    from sma_actuator.instruments.clock import MonotonicClock

    clock = MonotonicClock()
    return *open_instruments(with_patience(config), clock), clock


def _opening(config: BenchConfig, clock: Clock) -> Callable[[BenchConfig], Daq] | None:
    """What makes the DAQ anew for another configuration; None where it is the supply as well, on one connection."""
    instruments = config.instruments
    if instruments.daq.resource == instruments.supply.resource:
        return None
    return lambda other: open_daq(with_patience(other), clock)


def with_patience(config: BenchConfig) -> BenchConfig:
    """With time-outs that let slow instruments say how slow they are."""
    instruments = {
        name: dataclasses.replace(each, timeout=max(each.timeout, PATIENCE_s))
        for name in ("supply", "daq")
        for each in (getattr(config.instruments, name),)
    }
    return dataclasses.replace(config, instruments=dataclasses.replace(config.instruments, **instruments))
