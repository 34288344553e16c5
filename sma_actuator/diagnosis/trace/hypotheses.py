"""All that may have happened in some logs, tried: nothing, each effect, pairs of them, and something else."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.fleet import spread

from .candidates import Candidate, Field
from .evidence import Evidence
from .limits import LIMITS
from .rows import BESIDE, UNNAMED, Hypothesis, Rows

IN_EARNEST = 5  #: pairs that are fitted, at the most

#: What tracing is doing, and how far it is, from 0 to 1.
Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """What was tried."""

    rows: Rows  #: that all were held against in the end
    weighed: list[tuple[float, Hypothesis]]  #: each with its probability before the logs
    explained: list[Hypothesis]  #: that have none, and are there to say what speaks for and against them


def hypotheses(evidence: Evidence, field: Field, together: bool, jobs: int, progress: Progress) -> Hypotheses:
    """All that may have happened; ``together``: all effects of the field at once or none, and nothing else."""
    if evidence.beyond_floor and not together:
        rows = Rows(evidence)
        weighed = _lacking(rows, field.candidates, jobs, progress)
    else:
        each = [field.candidates] if together else [[c] for c in field.candidates]
        rows, alone = _alone(evidence, each, jobs, progress)
        weighed = _asked(rows, alone) if together else _all(rows, alone, jobs, progress)
    return Hypotheses(rows, weighed, [rows.effects([c]) for c in field.explained])


def _alone(
    evidence: Evidence, candidates: Sequence[Sequence[Candidate]], jobs: int, progress: Progress
) -> tuple[Rows, list[Hypothesis]]:
    """Each of some effects, held against the floor of where the wire was by the likeliest of them.

    How far a model is usually off depends on the place, and what has happened may make it mistake that: a resistance
    that is off by a lead has the floor of another one.  So effects are looked for with one floor everywhere, in fewer
    readings and by their own forms; that is the likeliest which is so with the floor of where it has the wire; and then
    all are held against that one: the same for all, so none can buy its rest.  What a model leaves beyond its floor has
    one everywhere anyway.
    """
    if evidence.beyond_floor:
        rows = Rows(evidence)
        return rows, fitted(rows, [(each, None) for each in candidates], jobs, progress, "effects")
    anywhere = Rows(evidence.seldom_and_anywhere(), forms=(0.0,))
    found = fitted(anywhere, [(each, None) for each in candidates], jobs, progress, "effects")
    best = max([anywhere.nothing(), *(one for one in found if not one.why_none)], key=anywhere.where_it_was)
    if best.found:
        evidence = evidence.held_where(best.found.effects)
    rows = Rows(evidence)
    known = [(one.fitted.candidates, one.fitted.values) for one in found]
    return rows, fitted(rows, known, jobs, progress, "effects again")


def _without_a_name(rows: Rows, alone: Sequence[Hypothesis], other: float) -> list[tuple[float, Hypothesis]]:
    """Nothing, and something else where that can be, with its probability before the logs."""
    found = [(LIMITS.nothing, rows.nothing())]
    if rows.smooth is not None:
        found.append((other, rows.something_else(alone)))
    return found


def _asked(rows: Rows, together: Sequence[Hypothesis]) -> list[tuple[float, Hypothesis]]:
    """Some effects together or none of them, each with its probability before the logs."""
    without_a_name = _without_a_name(rows, together, LIMITS.rare)
    return [*without_a_name, *((1.0 - LIMITS.nothing - LIMITS.rare, one) for one in together)]


def _all(rows: Rows, alone: Sequence[Hypothesis], jobs: int, progress: Progress) -> list[tuple[float, Hypothesis]]:
    """Everything, each with its probability before the logs."""
    each = (1.0 - LIMITS.nothing - 3.0 * LIMITS.rare) / max(len(alone), 1)
    without_a_name = _without_a_name(rows, alone, UNNAMED * LIMITS.rare)
    return [*without_a_name, *((each, one) for one in alone), *pairs(rows, alone, jobs, progress)]


def _lacking(
    rows: Rows, candidates: Sequence[Candidate], jobs: int, progress: Progress
) -> list[tuple[float, Hypothesis]]:
    """What a model lacked from its beginning: one effect after the other, as long as one more is probable."""
    found = [(LIMITS.nothing, rows.nothing())]
    for number in range(1, LIMITS.missing + 1):
        before, best = max(found, key=lambda one: math.log(one[0]) + one[1].log_evidence)
        if len(best.names) + (best.found is not None) < number:
            break
        has = best.found.candidates if best.found else ()
        more = [c for c in candidates if c not in has]
        known = best.found.values if best.found else None
        tried = fitted(rows, [((*has, c), known) for c in more], jobs, progress, f"effect {number}")
        found += [((1.0 - LIMITS.nothing) * before / max(len(more), 1), one) for one in tried if not one.why_none]
    return found


def fitted(
    rows: Rows,
    calls: Sequence[tuple[Sequence[Candidate], Mapping[str, Mapping[str, float]] | None]],
    jobs: int,
    progress: Progress,
    what: str,
) -> list[Hypothesis]:
    """:meth:`Rows.effects` of some effects each, with what is known of their parameters."""
    found = []
    with spread(jobs) as run:
        for number, one in enumerate(run([(rows.effects, call) for call in calls]), 1):
            progress(what, number / len(calls))
            found.append(one)
    return found


def pairs(rows: Rows, alone: Sequence[Hypothesis], jobs: int, progress: Progress) -> list[tuple[float, Hypothesis]]:
    """Two effects at once, with what each had before the logs, of which any two were as likely.

    What each effect moves alone says of all of them at once which promise most; these are sketched from where the
    better of the two was fitted, and of those that do better than any one effect that may have happened the best few
    are fitted.  One that happens once is fitted beside that one whatever its sketch: when it was, it was looked for
    alone; and from there too, since without it the other one had to take its part.
    """
    # What is none alone may be there beside another, which it had to take the part of; it is no measure for them.
    ranked = sorted(alone, key=lambda one: (bool(one.why_none), -one.log_evidence))
    to_beat = max([rows.nothing().log_evidence, *(one.log_evidence for one in ranked if not one.why_none)])
    beside: dict[int, list[Hypothesis]] = {}
    for first, other in rows.promising(ranked):
        beside.setdefault(first, []).append(ranked[other])
    sketched: list[tuple[float, Hypothesis, Hypothesis]] = []
    with spread(jobs) as run:
        calls = [
            (rows.sketches, (ranked[k].fitted, [other.fitted for other in others])) for k, others in beside.items()
        ]
        for (k, others), found in zip(beside.items(), run(calls), strict=True):
            sketched += zip(found, [ranked[k]] * len(others), others, strict=True)
    sketched.sort(key=lambda one: -one[0])
    better = [(first, other) for evidence, first, other in sketched if evidence > to_beat][:IN_EARNEST]
    better += [(ranked[0], other) for other in ranked[1:] if _happens_once(other) and (ranked[0], other) not in better]
    better += [(other, first) for first, other in better if _happens_once(other)]
    out: dict[frozenset[str], Hypothesis] = {}
    for one in fitted(rows, [_together(*two) for two in better], jobs, progress, "pairs"):
        of_two = frozenset(one.names)
        out[of_two] = max(out.get(of_two, one), one, key=lambda two: -np.inf if two.why_none else two.log_evidence)
    return [((1.0 - BESIDE) * LIMITS.rare / math.comb(len(alone), 2), one) for one in out.values()]


def _happens_once(alone: Hypothesis) -> bool:
    return any(c.scanned for c in alone.fitted.candidates)


def _together(first: Hypothesis, other: Hypothesis) -> tuple:
    """What :meth:`Rows.effects` asks: two effects, of which one is known from when it was alone."""
    return (*first.fitted.candidates, *other.fitted.candidates), first.fitted.values
