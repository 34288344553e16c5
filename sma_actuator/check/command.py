"""``sma-actuator check``: the self-test, on instruments that no node holds."""

from __future__ import annotations

import dataclasses

from sma_actuator.base.interrupts import noted_signals
from sma_actuator.config import Config
from sma_actuator.console import add_output_arguments, notes, refuse_to_overwrite, results, write_json

from .selftest import Level, SelfTest, passed

_MARKS = {Level.OK: "ok", Level.WARNING: "look", Level.WRONG: "WRONG"}


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator check``."""
    parser.add_argument("--config", required=True, metavar="FILE", help="parameter file of the wire")
    parser.add_argument("--virtual", choices=("flexinol", "furukawa"), help="on this wire of the virtual bench")
    add_output_arguments(parser, "what was found")


def run(args) -> int:
    """Test; 0 where nothing is wrong."""
    refuse_to_overwrite(args)
    config = Config.load(args.config)
    with noted_signals() as interrupts:
        test = SelfTest(config, *_instruments(config, args.virtual))
        notes(args).print(f"at most {2e3 * config.supply.bias_current:g} mA will flow; the output is off afterwards")
        found = test.run(lambda: bool(interrupts))
        for each in found:
            results(args).print(f"{_MARKS[each.level]:6} {each.part:15} {each.sentence}", markup=False)
        write_json(args, [dataclasses.asdict(each) | {"level": each.level.name.lower()} for each in found])
        interrupts.raise_noted()
    return 0 if passed(found) else 1


def _instruments(config: Config, virtual: str | None):
    if virtual:
        from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock

        bench = VirtualBench.from_name(virtual, size_m=(config.wire.length, config.wire.diameter))
        return InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench)
    from sma_actuator.instruments import open_daq, open_supply
    from sma_actuator.instruments.clock import MonotonicClock

    clock = MonotonicClock()
    return open_supply(config), open_daq(config, clock), clock
