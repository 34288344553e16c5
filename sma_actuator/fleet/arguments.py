"""The options that every command has that takes many wires at once."""

from __future__ import annotations

import argparse
from pathlib import Path

from sma_actuator.base.options import number_within


def add_fleet_arguments(parser: argparse.ArgumentParser, per: str) -> None:
    """Declare ``--table`` and what goes with it; ``per``: what is worked on at a time, "log" or "wire"."""
    group = parser.add_argument_group("many wires at once")
    group.add_argument(
        "--table",
        type=Path,
        metavar="FILE.parquet",
        help=f"work on every {per} by itself, and append a row for each log to this table; folders, patterns and URLs "
        f"(s3://…) "
        "may be given, {wire} in the name of a file stands for the wire; what is in the table already is left out",
    )
    group.add_argument(
        "--wire-name",
        metavar="REGEX",
        default="",
        help="where the name of the wire stands in the place of a log (default: the folder that the log lies in)",
    )
    names = {word for action in parser._actions for word in action.option_strings}
    if "--jobs" not in names:
        group.add_argument("--jobs", type=number_within(1, kind=int), default=2, help="processes (default %(default)s)")
    if "--dask" not in names:
        group.add_argument(
            "--dask", metavar="ADDRESS", help="spread the work over this Dask cluster, as tcp://127.0.0.1:8786"
        )
