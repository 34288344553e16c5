"""The page of a fleet: which wires drift, by what, since when, and what to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.report import Page, figure

from .drift import WireState, verdict

_COLOURED = 8  #: wires that have a colour and a name in the picture


def write_page(path: Path, found: Sequence[WireState], not_judged: Sequence[Mapping[str, Any]]) -> None:
    """Write the HTML page."""
    page = Page("A fleet of wires", verdict(found))
    if found:
        _errors(page, found)
    drifting = [s for s in found if s.drifts]
    if drifting:
        page.heading("What drifts, and what to do")
        page.table(
            ("wire", "by", "since", "error at first [%]", "error now [%]", "what to do"),
            [
                (
                    s.wire,
                    " + ".join(n.replace("_", " ") for n in s.effects) or "not named",
                    f"{s.since:%Y-%m-%d}",
                    s.first_percent,
                    s.last_percent,
                    s.remedy,
                )
                for s in drifting
            ],
            "Errors are mean absolute, in % of full stroke, with the model as it is.",
        )
    page.heading("Every wire")
    page.table(
        ("wire", "logs", "first", "last", "error at first [%]", "error now [%]", "last verdict"),
        [
            (
                s.wire,
                len(s.rows),
                f"{s.rows[0]['date']:%Y-%m-%d}",
                f"{s.rows[-1]['date']:%Y-%m-%d}",
                s.first_percent,
                s.last_percent,
                s.rows[-1]["verdict"],
            )
            for s in found
        ],
    )
    if not_judged:
        page.heading("Logs that could not be judged")
        page.table(("log", "why"), [(row["log"], row["sentence"]) for row in not_judged])
    page.write(path)


def _errors(page: Page, found: Sequence[WireState]) -> None:
    """The error of every wire over time; days, so that the picture can be looked into."""
    begin = min(row["date"] for s in found for row in s.rows)
    drawing, axes = figure(1, width_in=10.0, height_in=4.2)
    ax, coloured = axes[0, 0], [s for s in found if s.drifts][:_COLOURED]
    for s in reversed(found):
        days = [(row["date"] - begin).total_seconds() / 86400.0 for row in s.rows]
        percents = np.array([row["error_percent"] for row in s.rows])
        if s in coloured:
            ax.plot(days, percents, "o-", ms=3, lw=1.2, color=f"C{coloured.index(s)}", label=s.wire)
        else:
            ax.plot(days, percents, "o-", ms=1.5, lw=0.6, color="0.75")
    ax.set(xlabel=f"days since {begin:%Y-%m-%d}", ylabel="error of the model as it is [% of full stroke]")
    if coloured:
        ax.legend(fontsize=8, loc="upper left")
    page.figure(
        drawing,
        "Every log of every wire; in colour those that drift"
        + (", the first of them." if len(coloured) == _COLOURED else "."),
        zoom=True,
    )
