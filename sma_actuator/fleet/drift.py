"""Which wires of a fleet drift, by what and since when: what the rows of its table say together."""

from __future__ import annotations

import datetime
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sma_actuator.estimation.effects import EFFECTS

#: Verdicts that say that something is not as it was when the model was made.
DRIFTS = ("changed", "traced", "unexplained")
#: Verdicts that say that all is as it was.
STANDS = ("as calibrated", "none")


@dataclass(frozen=True, slots=True)
class WireState:
    """One wire, by its rows in the order of time."""

    wire: str
    rows: tuple[Mapping[str, Any], ...]
    since: datetime.datetime | None  #: of the first log of those that say so to the last; None where it does not drift
    effects: tuple[str, ...]  #: that these name, the most frequent first

    @property
    def drifts(self) -> bool:
        """Whether its last log says that something has changed."""
        return self.since is not None

    @property
    def first_percent(self) -> float:
        """Error of its first log, % of full stroke."""
        return next((r["error_percent"] for r in self.rows if math.isfinite(r["error_percent"])), math.nan)

    @property
    def last_percent(self) -> float:
        """Error of its last log."""
        return next((r["error_percent"] for r in reversed(self.rows) if math.isfinite(r["error_percent"])), math.nan)

    @property
    def remedy(self) -> str:
        """What to do, in the words of the effects."""
        known = [EFFECTS[name].REMEDY for name in self.effects[:2] if name in EFFECTS]
        return " ".join(known) or ("`sma-actuator trace` looks for what it is." if self.drifts else "")


def states(rows: Sequence[Mapping[str, Any]]) -> list[WireState]:
    """Every wire, those that drift first; of a log that has several rows of a command the last counts."""
    latest = {(row["command"], row["log"]): row for row in rows if row["verdict"] in (*DRIFTS, *STANDS)}
    by_wire: dict[str, list[Mapping[str, Any]]] = {}
    for row in latest.values():
        by_wire.setdefault(row["wire"], []).append(row)
    found = [_state(wire, sorted(its, key=lambda r: (r["date"], r["log"]))) for wire, its in by_wire.items()]
    return sorted(found, key=lambda s: (not s.drifts, s.wire))


def _state(wire: str, rows: Sequence[Mapping[str, Any]]) -> WireState:
    tail: list[Mapping[str, Any]] = []
    for row in reversed(rows):
        if row["verdict"] not in DRIFTS:
            break
        tail.append(row)
    named = Counter(name for row in tail for name in row["effects"])
    return WireState(wire, tuple(rows), tail[-1]["date"] if tail else None, tuple(n for n, _ in named.most_common()))


def refused(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The rows of logs that could not be judged."""
    latest = {(row["command"], row["log"]): row for row in rows}
    return [row for row in latest.values() if row["verdict"] in ("refused", "not judged")]


def verdict(found: Sequence[WireState]) -> str:
    """What to know of the fleet, in one sentence."""
    drifting = [s for s in found if s.drifts]
    of = f"{len(found)} wire{'s' * (len(found) != 1)}"
    if not drifting:
        return f"None of {of} drifts." if found else "No row of the table says anything of a drift."
    told = "; ".join(
        f"{s.wire} by {' and '.join(_words(n) for n in s.effects) or 'something without a name'} since "
        f"{s.since:%Y-%m-%d}"
        for s in drifting[:3]
    )
    more = f"; and {len(drifting) - 3} more" if len(drifting) > 3 else ""
    return f"{len(drifting)} of {of} drift{'s' * (len(drifting) == 1)}: {told}{more}."


def _words(name: str) -> str:
    return name.replace("_", " ")
