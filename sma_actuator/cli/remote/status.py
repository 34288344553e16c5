"""``sma-actuator status``: what a running node says of its wire."""

from __future__ import annotations

import dataclasses
import math

from sma_actuator.console import add_output_arguments, refuse_to_overwrite, results, write_json

from .client import add_node_arguments, connected
from .watch import after

#: What people read numbers in, by the unit that the end of a name says: the unit, and how many there are in it.
_READ_IN = {
    "m": ("mm", 1e3),
    "Pa": ("MPa", 1e-6),
    "A": ("mA", 1e3),
    "s": ("ms", 1e3),
    "C": ("°C", 1.0),
    "rad": ("°", 180.0 / math.pi),
    **{unit: (unit, 1.0) for unit in ("N", "Nm", "W", "K", "Ohm")},
}


def shown(name: str, value: float | str) -> str:
    """A value of the status for people: ``displacement_m``, 0.00223 is "displacement  2.23 mm".  JSON keeps SI."""
    if isinstance(value, str):
        return f"{name:24} {value}"
    what, _, unit = name.rpartition("_")
    if unit not in _READ_IN:
        return f"{name:24} {value:.6g}"
    words, in_one = _READ_IN[unit]
    return f"{what:24} {value * in_one:.4g} {words}"


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
        console.print(f"  {shown(key, value)}")
    client.say_next(args, after(client, status))
    write_json(args, {"node": name, **dataclasses.asdict(status), "mode": status.mode.value})
    return 0
