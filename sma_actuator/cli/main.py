"""The edge to a person: ``sma-actuator demo | bench | characterise | identify | replay | trace | forward | loop``.

Each command lives in the package it drives, which offers ``SUMMARY``, ``add_arguments(parser)``
and ``run(args) -> int``; only the one asked for is imported, so ``--help`` is quick and a missing
extra stops nobody who does not need it.
"""

from __future__ import annotations

import argparse
import importlib
import sys

from sma_actuator.base.errors import UserError

COMMANDS = {
    "demo": ("sma_actuator.cli.demo", "drive the virtual bench through the node, live in the terminal"),
    "bench": ("sma_actuator.bench.server", "the virtual bench: a wire behind two SCPI instruments"),
    "characterise": ("sma_actuator.characterise", "run the bench experiments and write logs"),
    "identify": ("sma_actuator.identify", "logs to a calibrated model file"),
    "replay": ("sma_actuator.replay", "any model on any log: errors and traces"),
    "trace": ("sma_actuator.diagnosis.trace", "find the effect a model lacks, and add it"),
    "forward": (
        "sma_actuator.diagnosis.forward",
        "fit power-to-displacement physics to a real bench and find what it lacks",
    ),
    "loop": (
        "sma_actuator.diagnosis.loop",
        "fit and draw isobaric loops: strain against temperature, kinetics compared",
    ),
}


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns its exit code (0 only on success)."""
    argv = sys.argv[1:] if argv is None else argv
    parser = argparse.ArgumentParser(prog="sma-actuator", description="Drive and calibrate shape memory alloy wires.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    chosen = next((word for word in argv if not word.startswith("-")), None)
    for name, (module_name, summary) in COMMANDS.items():
        subparser = commands.add_parser(name, help=summary, description=summary)
        if name == chosen:
            try:
                module = importlib.import_module(module_name)
            except ModuleNotFoundError as error:
                if error.name is None or error.name.startswith("sma_actuator"):
                    raise
                parser.exit(
                    2, f"sma-actuator {name}: needs the Python package '{error.name}', which is not installed\n"
                )
            module.add_arguments(subparser)
            subparser.set_defaults(run=module.run)
    args = parser.parse_args(argv)
    try:
        return args.run(args)
    except UserError as error:
        print(f"sma-actuator {args.command}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"sma-actuator {args.command}: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
