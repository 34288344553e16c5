"""``sma-actuator stop``: every wire of the node's process off; with ``--config`` without the node, by the supply
itself."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING

from sma_actuator.base.errors import UserError
from sma_actuator.base.local_stop import ask_here

from .client import Named, OFF_AGAIN_s, add_node_arguments, connected

if TYPE_CHECKING:
    from sma_actuator.instruments.supply import SessionSupply

#: How long a process that was asked to end may take, before it is killed: a node has its outputs off within one second.
ENDING_s = 2.0
#: Off over a session of its own may take so many answers.
ANSWERS = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of ``sma-actuator stop``."""
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="switch off the supply of this parameter file, without ROS: for a node that hangs. Where the supply does "
        "not "
        "obey a second session, the process that drives it is ended",
    )
    add_node_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Switch off; 0 where every supply has confirmed it."""
    if args.config is not None:
        return _at_the_supply(args.config, args.node)
    node = Named(args)
    if answers := _asked_here(node, args.patience):
        return max([_said(node, args, *answer) for answer in answers])
    with connected(args) as client:
        from std_srvs.srv import Trigger

        response = client.call("stop", Trigger, Trigger.Request(), again_s=OFF_AGAIN_s)
        return _said(client, args, response.success, response.message)  # before anything else is waited for


def _asked_here(node: Named, patience_s: float) -> list[tuple[bool, str]]:
    """What the node answers where it runs on this computer: DDS would take up to 3 s to find it."""
    try:
        return ask_here(f"{node.full_name}/stop", os.environ.get("ROS_DOMAIN_ID", ""), patience_s)
    except TimeoutError:
        raise UserError(
            f"{node.full_name} is there, but has not answered within {patience_s:g} s; ask the supply itself: "
            "sma-actuator stop --config FILE"
        ) from None


def _said(node: Named, args: argparse.Namespace, off: bool, words: str) -> int:
    print(node.words(words), flush=True)
    node.say_next(args, "~/enable" if off else "look at the supply, and pull its plug if its output is on")
    return 0 if off else 1


def _at_the_supply(file: Path, node: str) -> int:
    """Off over a session of our own, if need be after the end of the process that has the supply."""
    # What a supply needs and no more: the whole configuration takes seconds to import.
    from sma_actuator.base.parameter_file import parameters_in
    from sma_actuator.instruments import InstrumentError, open_supply
    from sma_actuator.instruments.afterwards import sections_of
    from sma_actuator.instruments.supply import SessionSupply

    mapping = parameters_in(file, node)  # whatever has become of the tables beside it
    sections = sections_of(mapping, str(file))
    supply = open_supply(sections)
    assert isinstance(supply, SessionSupply)  # every supply but the virtual one
    where = sections.instruments.supply.resource
    timeout_s = ANSWERS * sections.instruments.supply.timeout
    try:
        supply.switch_off_beside(timeout_s)
    except InstrumentError as refused:
        holder = supply.driven_by
        if holder is None or holder == os.getpid():
            print(f"NOT CONFIRMED: {refused}; look at the supply, and pull its plug if its output is on")
            return 1
        print(f"process {holder} drives the supply and lets nobody else command it: it is ended", flush=True)
        _end(holder, supply)
        try:
            supply.switch_off_beside(timeout_s)
        except InstrumentError as error:
            print(f"NOT CONFIRMED: {error}; look at the supply, and pull its plug if its output is on")
            return 1
    print(f"the output is off, confirmed by the supply at {where}")
    return 0


def _end(process: int, supply: SessionSupply) -> None:
    """End a process as a user would, then by force; return once it has let the supply go."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(OSError):
            os.kill(process, number)
        until_s = time.monotonic() + ENDING_s
        while supply.driven_by == process and time.monotonic() < until_s:
            time.sleep(0.02)
        if supply.driven_by != process:
            return
