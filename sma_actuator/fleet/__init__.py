"""Many wires at once: logs from anywhere, read where they are worked on, one row of a table for each.

``identify``, ``replay``, ``trace`` and ``forward`` bring the work on one log or one wire; :mod:`.running` spreads it
and keeps the table; ``sma-actuator fleet`` says which wires drift, by what and since when.
"""

from .arguments import add_fleet_arguments
from .command import add_arguments, run
from .running import Finding, Work, run_fleet
from .spreading import Call, cluster, spread

__all__ = [
    "Call",
    "Finding",
    "Work",
    "add_arguments",
    "add_fleet_arguments",
    "cluster",
    "run",
    "run_fleet",
    "spread",
]
