"""The edge to a person: ``sma-actuator COMMAND``.

Each command lives in the package it drives, or in ``cli`` where it drives the whole; that offers
``add_arguments(parser)`` and ``run(args) -> int``; only the one asked for is imported, so ``--help`` is quick and a
missing extra stops nobody who does not need it.  Completion in the shell (extra ``completion``): ``eval
"$(register-python-argcomplete sma-actuator)"``.
"""

from __future__ import annotations

import argparse
import difflib
import importlib
import logging
import os
import signal
import sys

from sma_actuator.base.errors import UserError, printable
from sma_actuator.base.interrupts import asking_signals, raised_signals
from sma_actuator.base.streams import keep_standard_streams

COMMANDS = {
    "demo": ("sma_actuator.cli.demo", "drive the virtual bench through the node, live in the terminal"),
    "view": ("sma_actuator.view", "a running node in the browser: what the wire does, gains, a stop button"),
    "bench": ("sma_actuator.bench.server", "the virtual bench: a wire behind two SCPI instruments"),
    "check": (
        "sma_actuator.check.command",
        "whether a wire is wired as its parameters say; the watchdog put to the test",
    ),
    "tune": ("sma_actuator.cli.tune", "gains for a wire from a relay test and a few trials"),
    "enable": ("sma_actuator.cli.remote.enable", "a running node: current on, the wire is held where it is"),
    "move": ("sma_actuator.cli.remote.move", "a running node: the wire to a position"),
    "stop": ("sma_actuator.cli.remote.stop", "a running node: every wire of its process off"),
    "call": ("sma_actuator.cli.remote.call", "a running node: a service of it, as clear_fault or self_test"),
    "status": ("sma_actuator.cli.remote.status", "a running node: what it says of its wire"),
    "watch": ("sma_actuator.cli.remote.watch", "a running node: position, load and current as they change"),
    "init": ("sma_actuator.cli.init", "a few questions, and a complete bench file"),
    "characterise": ("sma_actuator.characterise", "run the bench experiments and write logs"),
    "check-log": ("sma_actuator.cli.check_log", "are logs fit to test the models on a real wire?"),
    "identify": ("sma_actuator.cli.identify", "logs to a calibrated model file"),
    "replay": ("sma_actuator.replay", "any model on any log: errors and curves"),
    "trace": ("sma_actuator.diagnosis.trace", "find the effect a model lacks, and add it"),
    "forward": (
        "sma_actuator.diagnosis.forward",
        "fit power-to-displacement physics to a real bench and find what it lacks",
    ),
    "fleet": ("sma_actuator.fleet", "many wires at once: which of them drift, by what and since when"),
    "loop": (
        "sma_actuator.kinetics",
        "fit and draw isobaric loops: strain against temperature, kinetics compared",
    ),
}


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns its exit code (0 only on success)."""
    return run(parsed(sys.argv[1:] if argv is None else argv))


def parsed(argv: list[str]) -> argparse.Namespace:
    """What is asked for, with its command loaded.  Raises SystemExit where that is help, or no command."""
    keep_standard_streams()
    parser = argparse.ArgumentParser(
        prog="sma-actuator",
        description="Drive and calibrate shape memory alloy wires.",
        epilog="sma-actuator COMMAND --help says what a command wants.",
    )
    parser.add_argument(
        "--version", action="version", version=f"sma-actuator {_version()}" if "--version" in argv else ""
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    completing = "_ARGCOMPLETE" in os.environ
    words = os.environ.get("COMP_LINE", "").split()[1:] if completing else argv
    chosen = next((word for word in words if not word.startswith("-")), None)
    subparsers = {
        name: commands.add_parser(name, help=summary, description=summary) for name, (_, summary) in COMMANDS.items()
    }
    if chosen in COMMANDS:
        _load(chosen, subparsers[chosen])
    if completing:
        import argcomplete

        argcomplete.autocomplete(parser)
    if not argv:
        parser.print_help()
        parser.exit()
    if chosen is not None and chosen not in COMMANDS:
        near = difflib.get_close_matches(chosen, COMMANDS, n=1)
        parser.error(
            f"'{chosen}' is no command{f'; did you mean {near[0]}?' if near else ''}; commands are "
            f"{', '.join(COMMANDS)}"
        )
    args, unknown = parser.parse_known_args(argv)
    if args.command is None:
        parser.error(f"a command is wanted: {', '.join(COMMANDS)}")
    if unknown:
        subparsers[args.command].error(f"unrecognized arguments: {' '.join(unknown)}")
    return args


def _load(name: str, parser: argparse.ArgumentParser) -> None:
    """Give a command's parser its options."""
    try:
        module = importlib.import_module(COMMANDS[name][0])
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("sma_actuator"):
            raise
        parser.exit(2, f"sma-actuator {name}: needs the Python package '{error.name}', which is not installed\n")
    module.add_arguments(parser)
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress and no notes, only results and errors")
    parser.add_argument("-v", "--verbose", action="store_true", help="also what the parts of the program log")
    parser.set_defaults(run=module.run)


def run(args: argparse.Namespace) -> int:
    """Run the command; its exit code."""
    if args.verbose:
        logging.basicConfig(level=logging.DEBUG, format="%(name)s: %(message)s")
    elif args.quiet:
        logging.basicConfig(level=logging.ERROR, format="%(message)s")
    try:
        with raised_signals(*asking_signals()):
            return args.run(args)
    except UserError as error:
        print(f"sma-actuator {args.command}: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        # Whoever read the results has enough; the interpreter must not write what is left either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except BaseException as error:
        if (number := _interrupted_by(error)) is None:
            if isinstance(error, OSError) and error.errno and not args.verbose:
                print(f"sma-actuator {args.command}: {_denied(error)}", file=sys.stderr)
                return 1
            raise
        print(f"sma-actuator {args.command}: interrupted", file=sys.stderr)
        return 128 + number


def _denied(error: OSError) -> str:
    """What the operating system refused, as a folder that cannot be made or a disk that is full."""
    words = f"{error.filename}: {error.strerror}" if error.filename is not None else f"{error.strerror}"
    return f"{printable(words)} (-v: where)"


def _interrupted_by(error: BaseException | None) -> int | None:
    """The signal that this came of, also where a library stumbled as it tidied up after it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    if error is None:
        return None
    return error.args[0] if error.args else signal.SIGINT


def _version() -> str:
    import importlib.metadata  # by itself as slow as a third of a stop

    try:
        return importlib.metadata.version("sma_actuator")
    except importlib.metadata.PackageNotFoundError:
        return "of a folder that is not installed"
