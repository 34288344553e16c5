"""Candidates compete; one is chosen only if it earns its parameters on data that no fit of it has seen.

Who asks brings a *work*: a function that fits some candidates together and says how much is lost on each unit, a run,
by fits that have not seen it.  The rest is here: what earns, what is alike, which pairs are tried.

A selection asks for fits in batches and may be run beside others, so that no process waits: by joblib, on
this machine's cores or, inside ``joblib.parallel_config("dask")``, on a cluster.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, nan
from typing import Any, Protocol

import numpy as np

from sma_actuator.diagnosis.falls import next_fall, paired
from sma_actuator.fleet import spread

LEADERS = 2  #: so many of the best single candidates are tried with every other
#: What a race is doing, and how far it is, from 0 to 1.
Progress = Callable[[str, float], None]


class Competitor(Protocol):
    """What may be chosen."""

    @property
    def name(self) -> str:
        """What it is called."""

    @property
    def parameters(self) -> int:
        """How many parameters it has to earn."""


@dataclass(frozen=True)
class Trial:
    """Some candidates, fitted together, and how they do on what their fits have not seen."""

    candidates: tuple[Any, ...]  #: each a :class:`Competitor`
    losses: np.ndarray  #: on every unit, by a fit that has not seen it, shape (units,)
    fit: Any  #: what the work made of it
    objection: str = ""  #: why it may not be chosen, whatever it gains: a value at the end of the possible
    gain: float = nan  #: mean fall of a unit's loss against nothing chosen
    refusal: str = ""  #: why it did not earn its parameters; empty if it did

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its candidates."""
        return tuple(c.name for c in self.candidates)

    @property
    def parameters(self) -> int:
        """How many parameters it has."""
        return sum(c.parameters for c in self.candidates)


@dataclass(frozen=True)
class Entry:
    """A request for a trial."""

    candidates: tuple[Any, ...]
    start: Trial | None  #: of some of them, to begin from


@dataclass(frozen=True)
class Selection:
    """Who competed, and who was chosen."""

    trials: list[Trial]  #: the single ones, and the pairs if they were tried, best first
    chosen: Trial | None
    alternatives: list[Trial]  #: others that do as well as that


@dataclass(frozen=True)
class Rules:
    """What it takes.  Losses are in any unit that adds: so are the gains here."""

    probable: float  #: probability with which a new unit, drawn like these, loses less: see :func:`next_fall`
    margin: float = 0.0  #: by so much a unit loses less at the least, in the mean
    worst_rise: float = inf  #: no unit may lose so much more: what is really there is there in all of them

    def falls_short(self, trial: Trial, losses: np.ndarray) -> str:
        """Why ``trial`` does not surely lose less than ``losses``; empty if it does."""
        if trial.objection:
            return trial.objection
        gain, _ = paired(losses, trial.losses)
        if not gain > self.margin:
            return f"it takes {gain:.2f} off a run that it has not seen, where more than {self.margin:g} is wanted"
        chance = next_fall(losses, trial.losses).chance
        if chance < self.probable:
            return f"on a new run it would do better with a probability of {chance:.0%} only"
        rise = float(np.max(trial.losses - losses))
        return f"it makes one run worse that it has not seen, by {rise:.2f}" if rise > self.worst_rise else ""


def select(
    field: Sequence[Any],
    losses: np.ndarray,
    rules: Rules,
    together: Callable[[Sequence[Any]], bool] = lambda candidates: True,
) -> Generator[list[Entry], list[Trial], Selection]:
    """Choose from ``field``; yields batches of entries, wants their trials, and returns the selection.

    ``losses``: of every unit with nothing chosen, shape (units,).  ``together(candidates)``: whether these can be
    fitted together at all.

    Single candidates come first; then pairs of the best few with every other, because two faults may hide each other.
    """
    trials = yield [Entry((c,), None) for c in field if together((c,))]
    alone = _judged(trials, losses, lambda trial: rules.falls_short(trial, losses))
    if not (good := _earned(alone)):
        return Selection(alone, None, [])
    best, alike = _simplest(good)
    single = {t.names[0]: t for t in alone}

    def falls_short(pair: Trial) -> str:
        """Why not each of its two earns its place over the other alone, and over the best one."""
        rivals = {name: single[name] for name in pair.names if name in single} | {best.names[0]: best}
        shorts = {name: rules.falls_short(pair, rival.losses) for name, rival in rivals.items()}
        return next((f"over {name} alone: {why}" for name, why in shorts.items() if why), "")

    trials = yield list(_pairs(alone[:LEADERS], field, together))
    pairs = _judged(trials, losses, falls_short)
    if good := _earned(pairs):
        best, alike = _simplest(good)
    return Selection(_best_first([*alone, *pairs]), best, alike)


def _judged(trials: Iterable[Trial], losses: np.ndarray, falls_short: Callable[[Trial], str]) -> list[Trial]:
    """What they gain, and why those that do not earn it do not, best first."""
    return _best_first(replace(t, gain=paired(losses, t.losses)[0], refusal=falls_short(t)) for t in trials)


def _best_first(trials: Iterable[Trial]) -> list[Trial]:
    return sorted(trials, key=lambda t: -t.gain)


def _earned(trials: Iterable[Trial]) -> list[Trial]:
    return [t for t in trials if not t.refusal]


def _simplest(good: Sequence[Trial]) -> tuple[Trial, list[Trial]]:
    """Of the trials that earn it, best first: the simplest of those as good as the best, and the others of those."""
    alike = [t for t in good if _is_alike(t, good[0])]
    winner = min(alike, key=lambda t: (t.parameters, -t.gain))
    return winner, [t for t in alike if t is not winner]


def _is_alike(trial: Trial, best: Trial) -> bool:
    """Whether unseen units cannot tell two trials apart: within a standard error of their paired difference."""
    behind, error = paired(trial.losses, best.losses)
    return trial is best or behind <= error


def _pairs(
    leaders: Sequence[Trial], field: Sequence[Any], together: Callable[[Sequence[Any]], bool]
) -> Iterator[Entry]:
    seen = set()
    for leader in leaders:
        (first,) = leader.candidates
        for other in field:
            pair = frozenset((first.name, other.name))
            if len(pair) == 2 and pair not in seen and together((first, other)):
                seen.add(pair)
                yield Entry((first, other), leader)


def run(
    selections: Sequence[Generator[list[Entry], list[Trial], Selection]],
    works: Sequence[Callable[[Entry], Trial]],
    jobs: int,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[Selection]:
    """Run selections side by side, each with its work; their results in order.

    ``progress`` is told how much of the present batch is done.
    """
    results: dict[int, Selection] = {}
    asked: dict[int, list[Entry]] = {}

    def go_on(number: int, trials: list[Trial] | None) -> None:
        try:
            selection = selections[number]
            asked[number] = next(selection) if trials is None else selection.send(trials)
        except StopIteration as end:
            results[number] = end.value

    for number in range(len(selections)):
        go_on(number, None)
    with spread(jobs) as do:
        while asked:
            tasks = [(number, entry) for number, entries in asked.items() for entry in entries]
            answers: dict[int, list[Trial]] = {number: [] for number in asked}
            trials = do((works[number], (entry,)) for number, entry in tasks)
            for done, ((number, _), trial) in enumerate(zip(tasks, trials, strict=True), 1):
                answers[number].append(trial)
                progress(done / len(tasks))
            asked.clear()
            for number, found in answers.items():
                go_on(number, found)
    return [results[number] for number in range(len(selections))]
