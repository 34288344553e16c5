"""Why a name was given, or was not: what speaks for and against it, by witness and by stretch of the logs, beside the
most probable hypothesis.

All of it counts in nats: logarithms of how much likelier one is than the other.  What the rows say of two hypotheses is
parted among them by each row's part of the squares; what is left is what each costs for all that it could have been.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .probability import NO_NAMES
from .rows import Hypothesis
from .tracing import Tracing

STRETCHES = 6  #: of the logs, of as many cycles each
GIVEN, ALTERNATIVE, REFUSED, UNTESTABLE = "given", "alternative", "refused", "untestable"
LEAST = 0.005  #: probability that is worth its number
LEAST_NATS = 1.0  #: by which something must speak against a name to be worth a word


@dataclass(frozen=True, slots=True)
class Why:
    """What speaks for and against a hypothesis beside the most probable one, in nats; less than nothing is against
    it."""

    names: tuple[str, ...]
    answer: str  #: GIVEN, ALTERNATIVE, REFUSED or UNTESTABLE
    reason: str  #: one sentence
    probability: float
    hypothesis: Hypothesis | None  #: None where these logs could not have shown it
    nats: float  #: all together; the rest is what it costs to be so free, and what was known before the logs
    by_witness: dict[str, float]
    by_stretch: tuple[float, ...]


def whys(tracing: Tracing) -> list[Why]:
    """Of every hypothesis, and every name that could not be: the most probable first."""
    best = tracing.hypotheses[tracing.probabilities.best]
    found = [_why(tracing, one, best) for one in tracing.hypotheses.values()]
    found.sort(key=lambda why: (why.answer != GIVEN, -why.nats))
    none = [Why((n,), UNTESTABLE, f"{text}.", 0.0, None, -math.inf, {}, ()) for n, text in tracing.untestable.items()]
    return found + none


def _why(tracing: Tracing, one: Hypothesis, best: Hypothesis) -> Why:
    evidence, by_row = tracing.evidence, _nats_by_row(one, best)
    by_unit = np.bincount(evidence.unit_of_row, by_row, minlength=evidence.units)
    by_witness = {name: float(by_row[rows].sum()) for name, rows in evidence.rows_by_witness().items()}
    probability = tracing.probabilities.of.get(one.names, 0.0)
    nats = one.log_evidence - best.log_evidence + _before(tracing, one) - _before(tracing, best)
    answer, reason = _answer(tracing, one, probability, nats, by_witness)
    by_stretch = tuple(float(part.sum()) for part in np.array_split(by_unit, STRETCHES))
    return Why(one.names, answer, reason, probability, one, nats, by_witness, by_stretch)


def _before(tracing: Tracing, one: Hypothesis) -> float:
    """Logarithm of its probability before the logs; of what was only asked for, that of any other single name."""
    single = max((p for names, p in tracing.prior.items() if len(names) == 1 and names[0] not in NO_NAMES), default=1.0)
    return math.log(tracing.prior.get(one.names) or single)


def _nats_by_row(one: Hypothesis, best: Hypothesis) -> np.ndarray:
    """What each row says for one hypothesis and against another, so that together they are what all rows say."""
    fewer = best.by_row - one.by_row
    together = float(fewer.sum())
    says = one.log_likelihood - best.log_likelihood
    if abs(together) < 1e-9 * float(np.abs(fewer).sum() + 1.0):
        return np.zeros(len(fewer))
    # where both leave as much and differ in what they cost, a nat is half a square
    rate = says / together if says * together > 0.0 else 0.5
    return fewer * rate


def _answer(
    tracing: Tracing, one: Hypothesis, probability: float, nats: float, by_witness: dict[str, float]
) -> tuple[str, str]:
    """Whether a name was given, and what decided it, in a sentence."""
    best = tracing.probabilities.best
    is_said = f"It has a probability {f'of {probability:.0%}' if probability >= LEAST else f'below {LEAST:.1%}'}"
    if one.names == best:
        rest = 1.0 - probability
        others = f"; all others together have {rest:.1%}." if rest >= LEAST else "; nothing else comes near."
        given = one.found is None or {*one.names} <= {*tracing.names}
        return (GIVEN if given else REFUSED), is_said + others
    beside = f"beside {' and '.join(best)} it is {_times(nats)} less probable"
    if one.why_none:
        return REFUSED, f"It is none: {one.why_none} ({beside} without that)."
    against = sorted((n for n in by_witness if by_witness[n] < -LEAST_NATS), key=lambda n: by_witness[n])
    speaks = "".join(f"; {n} speaks against it with {-by_witness[n]:.1f} nats" for n in against[:2])
    if one.names[-1] in tracing.alternatives:
        return ALTERNATIVE, f"{is_said}: these logs hardly tell the two apart; {beside}{speaks}."
    rows = sum(by_witness.values())
    freedom = "" if against else f"; the logs say {abs(rows):.1f} nats {'for' if rows > 0 else 'against'} it, it could "
    freedom += "" if against else "have been much else"
    return REFUSED, f"{is_said}: {beside}{speaks}{freedom}."


def _times(nats: float) -> str:
    """How many times less probable."""
    tens = -nats / math.log(10.0)
    return f"{10.0**tens:.2g} times" if tens < 3.0 else f"10^{tens:.0f} times"


def as_numbers(found: Sequence[Why]) -> list[dict[str, Any]]:
    """The same for machines; nats are beside the most probable hypothesis."""
    return [
        {
            "effects": list(why.names),
            "answer": why.answer,
            "reason": why.reason,
            "probability": why.probability,
            "nats": why.nats if why.hypothesis else None,
            "parameters": why.hypothesis.found.values if why.hypothesis and why.hypothesis.found else {},
            "nats_by_witness": why.by_witness,
            "nats_by_stretch": list(why.by_stretch),
        }
        for why in found
    ]
