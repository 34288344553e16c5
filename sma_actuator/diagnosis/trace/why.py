"""Why a name was given, or was not: what it takes off by witness and by stretch of the log, and what it was refused
for.

Losses are half the sum of squares in the calibration's standard deviations, so what is taken off counts in nats: the
logarithm of how much likelier the logs are with the effect than without, on cycles that its fit has not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sma_actuator.diagnosis.selection import Trial

from .evidence import Evidence
from .race import LOSS, Held, Tracing

STRETCHES = 6  #: of the logs, of as many cycles each
GIVEN, ALTERNATIVE, REFUSED, UNTESTABLE = "given", "alternative", "refused", "untestable"


@dataclass(frozen=True, slots=True)
class Why:
    """What speaks for and against a name."""

    names: tuple[str, ...]
    answer: str  #: GIVEN, ALTERNATIVE, REFUSED or UNTESTABLE
    reason: str  #: one sentence
    trial: Trial | None  #: None where these logs could not have shown it
    held: tuple[Held, ...]  #: all that it was held against
    by_witness: dict[str, float]  #: nats that it takes off, of all cycles that are held out in turn
    by_stretch: tuple[float, ...]  #: the same of each stretch of these


def whys(evidence: Evidence, tracing: Tracing) -> list[Why]:
    """Of every name that was tried or could not be: those given first, then by what they take off."""
    chosen = _chosen(tracing)
    tried = sorted(tracing.singles.values(), key=lambda t: -t.gain)
    if chosen is not None:
        tried = [chosen, *(t for t in tried if t.names != chosen.names)]
    found = [_why(evidence, tracing, trial, chosen) for trial in tried]
    given = [why for why in found if why.answer == GIVEN]
    none = [Why((n,), UNTESTABLE, f"{text}.", None, (), {}, ()) for n, text in tracing.untestable.items()]
    return given + [why for why in found if why.answer != GIVEN] + none


def _chosen(tracing: Tracing) -> Trial | None:
    """What the race chose, whether it was given in the end or not."""
    return next((r.winner for r in reversed(tracing.rounds) if r.winner), None) if tracing.fit else None


def _why(evidence: Evidence, tracing: Tracing, trial: Trial, chosen: Trial | None) -> Why:
    held = tuple(tracing.judge.held(trial))
    nats = tracing.judge.rows**2 / 2.0 - trial.fit.held_out_rows**2 / 2.0
    seen = tracing.train[evidence.unit_of_row]
    by_unit = np.bincount(evidence.unit_of_row, nats, minlength=evidence.units)[tracing.train]
    answer, reason = _answer(tracing, trial, chosen, held)
    return Why(
        trial.names,
        answer,
        reason,
        trial,
        held,
        {name: float(nats[rows & seen].sum()) for name, rows in evidence.rows_by_witness().items()},
        tuple(float(part.sum()) for part in np.array_split(by_unit, STRETCHES)),
    )


def _answer(tracing: Tracing, trial: Trial, chosen: Trial | None, held: Sequence[Held]) -> tuple[str, str]:
    """Whether a name was given, and the one reason that decided it, in a sentence."""
    takes = f"takes {trial.gain:.1f} nats off a cycle"
    chosen_takes = f"{' and '.join(chosen.names)} {chosen.gain:.1f}" if chosen and chosen is not trial else ""
    beside = f" (it {takes}, {chosen_takes})" if chosen_takes else ""
    against = [_against(h, _of(tracing, chosen, h.what)) for h in held if h.refuses]
    if tracing.verdict == "traced" and trial is chosen:
        return GIVEN, f"It {takes} and leaves nothing unusual."
    if tracing.verdict == "traced" and trial.names[-1] in tracing.alternatives:
        return ALTERNATIVE, f"It {takes}, {chosen_takes}: these logs do not tell the two apart."
    if trial is chosen and tracing.beside:
        further, share = tracing.beside
        return REFUSED, f"It leaves nothing unusual, but {further} beside it would take off {share:.0%} more."
    if trial.refusal:
        return REFUSED, f"Refused: {trial.refusal}{beside}."
    if against:
        return REFUSED, f"With it {'; '.join(against[:2])}{beside}."
    if not any(t.names == trial.names for r in tracing.rounds for t in r.trials):
        return (
            REFUSED,
            (
                f"It did not compete: it {takes}{f', {chosen_takes}' * bool(chosen_takes)}, and would leave nothing "
                f"unusual."
            ),
        )
    if tracing.verdict == "none":
        return REFUSED, "What is there without it is usual for these logs: there is nothing to explain."
    return REFUSED, f"It leaves nothing unusual either, but it {takes}, {chosen_takes}."


def _of(tracing: Tracing, chosen: Trial | None, what: str) -> float | None:
    """What is left of the same with what was chosen."""
    if chosen is None:
        return None
    return next((h.found for h in tracing.judge.held(chosen) if h.what == what), None)


def _against(held: Held, chosen: float | None) -> str:
    """What speaks against a name, with the numbers."""
    beside = "" if chosen is None or chosen == held.found else f", {chosen:.2g} with what was chosen"
    if held.what == LOSS:
        return f"a cycle still loses {held.found:.3g} nats, where {held.most:.3g} may be{beside}"
    if held.what.startswith("the trend"):
        return f"{held.what} is left with {held.found:.2g} variances, where {held.most:.2g} may be{beside}"
    return f"{held.what} is off by {held.found:.2g} standard deviations, where {held.most:.2g} may be{beside}"


def as_numbers(found: Sequence[Why]) -> list[dict[str, Any]]:
    """The same for machines."""
    return [
        {
            "effects": list(why.names),
            "answer": why.answer,
            "reason": why.reason,
            "gain": why.trial.gain if why.trial else None,
            "standard_error": why.trial.gain_error if why.trial else None,
            "parameters": why.trial.fit.values if why.trial else {},
            "held_against": [
                {"what": h.what, "found": h.found, "most": h.most, "refuses": h.refuses} for h in why.held
            ],
            "nats_by_witness": why.by_witness,
            "nats_by_stretch": list(why.by_stretch),
        }
        for why in found
    ]
