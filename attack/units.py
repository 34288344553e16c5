"""The attacks as functions that a process of a pool can be given."""

from __future__ import annotations

import os
from collections.abc import Sequence

from .result import Result


def run_hours(first: int, sessions: int) -> Result:
    """Sessions of ten virtual minutes, in this process."""
    from .hours import attack

    return attack(first, sessions)


def run_ends(unit: int, seconds: float) -> Result:
    """One wire driven to and fro."""
    from .ends import attack

    return attack(unit, seconds)


def run_lies(unit: int) -> Result:
    """One wire whose sensors lie."""
    from .lies import attack

    return attack(unit)


def run_lines(seed: int, only: Sequence[int] = ()) -> Result:
    """Every kind of mischief once on each instrument's line."""
    from .lines import ALL, attack

    return attack(seed, [ALL[number] for number in only] or ALL)


def run_kills(seed: int, count: int) -> Result:
    """Nodes killed at random instants."""
    _own_domain(seed)
    from .kills import attack

    return attack(seed, count)


def run_boards(seed: int, count: int) -> Result:
    """Nodes, firmware and lines of a board ended at random instants."""
    _own_domain(seed + 20)
    from .boards import attack

    return attack(seed, count)


def run_fuzz(seed: int, messages: int) -> Result:
    """Messages, parameters and calls with odd values."""
    _own_domain(seed + 40)
    from .fuzz import attack

    return attack(seed, messages)


def run_soak(seed: int, hours: float) -> Result:
    """One driver for virtual hours, and its memory."""
    from .soak import attack

    return attack(seed, 3600.0 * hours)


def run_node_soak(seed: int, minutes: float) -> Result:
    """One node in real time, and its memory."""
    _own_domain(seed + 80)
    from .node_soak import attack

    return attack(seed, 60.0 * minutes)


def run_heat(*units: int) -> Result:
    """Wires that lose half the heat that is believed."""
    from .heat import attack

    return attack(units)


def _own_domain(number: int) -> None:
    """A ROS domain of its own for each process that attacks; 1 to 99 are for those who work on this machine."""
    os.environ["ROS_DOMAIN_ID"] = str(100 + number % 100)


RUNNERS = {
    "ends": run_ends,
    "hours": run_hours,
    "lies": run_lies,
    "lines": run_lines,
    "kills": run_kills,
    "boards": run_boards,
    "fuzz": run_fuzz,
    "soak": run_soak,
    "node_soak": run_node_soak,
    "heat": run_heat,
}
