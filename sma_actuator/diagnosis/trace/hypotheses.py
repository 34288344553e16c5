"""All that may have happened in some logs, tried: nothing, each effect, pairs of them, and something else."""

from __future__ import annotations

from collections.abc import Sequence

from .candidates import Candidate
from .evidence import Evidence
from .floor import held_where_the_wire_was
from .limits import LIMITS
from .pairs import pairs
from .rows import KINDS, UNNAMED, Asked, Hypothesis, Progress, Rows, fitted


def hypotheses(
    evidence: Evidence, candidates: Sequence[Candidate], together: bool, jobs: int, progress: Progress
) -> tuple[Rows, list[tuple[float, Hypothesis]]]:
    """Each with its probability before the logs, and what all were held against.

    ``together``: all candidates at once have happened, or none, or something else.
    """
    asked: list[Asked] = [(candidates, None)] if together else [((c,), None) for c in candidates]
    if not evidence.beyond_floor:  # what a model leaves beyond its floor has one everywhere anyway
        evidence, asked = held_where_the_wire_was(evidence, asked, jobs, progress)
    rows = Rows(evidence)
    alone = fitted(rows, asked, jobs, progress, "effects")
    # Asked about together: they have, or nothing, or something else; no two of them by themselves.
    rare, unnamed = (1.0, 1.0) if together else (KINDS, UNNAMED)
    single = (1.0 - LIMITS.nothing - rare * LIMITS.rare) / max(len(alone), 1)
    tried = [(LIMITS.nothing, rows.nothing())]
    if rows.smooth is not None:
        tried.append((unnamed * LIMITS.rare, rows.something_else(alone)))
    tried += [(single, one) for one in alone]
    if not together:
        tried += pairs(rows, alone, jobs, progress)
    return rows, tried
