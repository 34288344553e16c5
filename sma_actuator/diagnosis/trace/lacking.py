"""What a model lacked from its beginning: one effect after the other, as long as one more is probable."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .candidates import Candidate
from .evidence import Evidence
from .limits import LIMITS
from .rows import Hypothesis, Progress, Rows, fitted


def lacking(
    evidence: Evidence, candidates: Sequence[Candidate], jobs: int, progress: Progress
) -> tuple[Rows, list[tuple[float, Hypothesis]]]:
    """Each set of effects that was tried, with its probability before the logs, and what all were held against."""
    rows = Rows(evidence)
    found = [(LIMITS.nothing, rows.nothing())]
    for number in range(1, LIMITS.names + 1):
        before, best = max(found, key=lambda one: math.log(one[0]) + one[1].log_evidence)
        if len(best.names) + (best.found is not None) < number:
            break
        has = best.found.candidates if best.found else ()
        more = [c for c in candidates if c not in has]
        known = best.found.values if best.found else None
        tried = fitted(rows, [((*has, c), known) for c in more], jobs, progress, f"effect {number}")
        found += [((1.0 - LIMITS.nothing) * before / max(len(more), 1), one) for one in tried if not one.why_none]
    return rows, found
