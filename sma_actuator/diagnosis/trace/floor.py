"""Against which floor effects are held: that of where the wire was.

How far a model is usually off depends on the place, and what has happened may make it mistake that: a resistance that
is off by a lead has the floor of another one.  So effects are looked for with one floor everywhere, in fewer readings
and by their own forms; that is the likeliest which is so with the floor of where it has the wire; and then all are held
against that one: the same for all, so none can buy its rest.
"""

from __future__ import annotations

import numpy as np

from .evidence import Evidence
from .rows import Asked, Hypothesis, Progress, Rows, fitted


def held_where_the_wire_was(
    evidence: Evidence, asked: list[Asked], jobs: int, progress: Progress
) -> tuple[Evidence, list[Asked]]:
    """The evidence with that floor, and the effects that are ``asked`` about with what was found of them on the way."""
    seldom = evidence.seldom_and_anywhere()
    anywhere = Rows(seldom, forms=(0.0,))
    found = fitted(anywhere, asked, jobs, progress, "where the wire was")
    possible = [anywhere.nothing(), *(one for one in found if not one.why_none)]
    best = max(possible, key=lambda one: where_it_was(anywhere, one))
    held = evidence.held_where(best.found.effects) if best.found else evidence
    return held, [(one.fitted.candidates, one.fitted.values) for one in found]


def where_it_was(rows: Rows, one: Hypothesis) -> float:
    """Logarithm of the evidence of what may have happened, were each reading held against the floor of where the
    wire was by that; a narrower one makes the same readings likelier, if they keep to it.

    Of hypotheses whose forms are their own.
    """
    effects = one.found.effects if one.found else {}
    there = rows.evidence.held_where(effects)
    likelihood, _ = rows.usual.likelihood(there.compare(effects).rows)
    floor, here = (np.concatenate(evidence.of_displacement.floor_m) for evidence in (there, rows.evidence))
    counts = rows.evidence.sample_weight**2
    return one.log_evidence - one.log_likelihood + likelihood - 0.5 * rows.usual.of_sizes(floor / here, counts)
