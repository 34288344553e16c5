"""``sma-actuator status``: what a running node says of its wire."""

from __future__ import annotations

import dataclasses

from sma_actuator.console import add_output_arguments, refuse_to_overwrite, results, write_json

from .client import add_node_arguments, connected
from .watch import after


def add_arguments(parser) -> None:
    """Declare the options of ``sma-actuator status``."""
    add_node_arguments(parser)
    add_output_arguments(parser, "the status")


def run(args) -> int:
    """Print the status; 0 where the node has answered."""
    refuse_to_overwrite(args)
    with connected(args) as client:
        status = client.status()
        name, words = client.full_name, client.words(status.message)
    console = results(args)
    console.print(f"{name}: {words}")
    for key, value in status.values.items():
        console.print(f"  {key:24} {value if isinstance(value, str) else f'{value:.6g}'}")
    client.say_next(args, after(client, status))
    write_json(args, {"node": name, **dataclasses.asdict(status), "mode": status.mode.value})
    return 0
