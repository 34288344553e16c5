"""Candidates compete; one is chosen only if it earns its parameters on data that no fit of it has seen.

One competition serves everything that is diagnosed: what tracing looks for in bench logs, whose units are
cycles, and what the forward model lacks, whose units are runs.  Who asks brings a *work*: a function that
fits some candidates together and says how much is lost on each unit by fits that have not seen it.  The rest
is here: what earns, what is alike, which pairs are tried, when it ends.

A selection asks for fits in batches and may be run beside others, so that no process waits: by joblib, on
this machine's cores or, inside ``joblib.parallel_config("dask")``, on a cluster.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import inf, nan
from typing import Any, Protocol

import numpy as np
from scipy.special import stdtr, stdtrit

from sma_actuator.fleet import spread

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
    gain: float = nan  #: mean fall of a unit's loss against what it competed with
    gain_error: float = nan  #: standard error of that, over units
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
    sketch: bool = False  #: whether it is enough to know about how well they do


@dataclass
class Round:
    """What competed after what, and who won."""

    before: tuple[str, ...]
    trials: list[Trial]  #: best first
    winner: Trial | None
    alternatives: list[Trial] = field(default_factory=list)  #: others that do as well


@dataclass
class Selection:
    """How it went, and who was chosen in the end."""

    rounds: list[Round]
    chosen: Trial | None
    #: Where that leaves nothing to be looked for: the sketch of it with one more beside, which takes off too much for
    #: that.
    unsettled: Trial | None = None

    @property
    def trials(self) -> list[Trial]:
        """All that competed, by name once, the last judgement of each."""
        return list({t.names: t for r in self.rounds for t in r.trials}.values())


@dataclass(frozen=True)
class Rules:
    """What it takes.  Losses are in any unit that adds: so are the gains here."""

    significant: float  #: so many standard errors must be left of a gain …
    margin: float = 0.0  #: … above this
    least_gain: Callable[[float], float] = lambda mean_loss: 0.0  #: of what is lost so far; less is not worth a name
    #: So much less lost in all units but the best one together is sure too: where few of them hold a change (what came
    #: late, or once), their scatter says little.  In units of a logarithm of likelihood.
    decisive: float = inf
    worst_rise: float = inf  #: no unit may lose so much more: what is really there is there in all of them
    probable: float = 0.0  #: probability with which a new unit, drawn like these, loses less: see :func:`next_fall`
    alike: float = 0.0  #: share of a gain within which two count as alike, even where their units tell them apart
    #: The same of those that leave nothing to be looked for: they explain it too, however surely others do better.
    alike_if_clean: float = 0.0
    tie: float = 0.0  #: the simplest of those alike wins, if it has this share of the best's gain
    leaders: int = 0  #: so many of the best single ones are tried with every other …
    sketched: int = 0  #: … and, where this is not 0, so many of these pairs in earnest: those that do best in a sketch
    least_beside: float = 0.0  #: share of a pair's gain that is lost at least where either of the two is left out
    #: Of the gain of one that leaves nothing to be looked for: what one more may take off beside it; more, and it was
    #: the wrong one.
    most_beside: Callable[[float], float] = lambda gain: inf
    #: Names that may take off as much as they like there, and beside which others may: what has but roughly the form of
    #: what it is called leaves a rest where it is right, too.
    no_sign_beside: tuple[str, ...] = ()
    most: int = 1  #: candidates chosen at the most
    unit: str = "cycle"  #: what a unit is called

    def falls_short(self, trial: Trial, losses: np.ndarray) -> str:
        """Why ``trial`` does not surely lose less than ``losses``; empty if it does."""
        if trial.objection:
            return trial.objection
        gain, error = paired(losses, trial.losses)
        if not gain > self.margin:
            return (
                f"it takes {gain:.2f} off a {self.unit} that it has not seen, where more than {self.margin:g} is wanted"
            )
        falls = np.sort(losses - trial.losses)
        if not (gain - self.significant * error > self.margin or falls[:-1].sum() > self.decisive):
            return (
                f"it takes {gain:.2f} ± {error:.2f} off a {self.unit} that it has not seen, "
                f"which is not sure by {self.significant:g} standard errors"
            )
        chance = next_fall(losses, trial.losses).chance if self.probable else 1.0
        if chance < self.probable:
            return f"on a new {self.unit} it would do better with a probability of {chance:.0%} only"
        rise = float(np.max(trial.losses - losses))
        return f"it makes one {self.unit} worse that it has not seen, by {rise:.2f}" if rise > self.worst_rise else ""


def paired(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Mean fall from ``before`` to ``after``, unit by unit, shape (units,), and its standard error."""
    fall = before - after
    return float(fall.mean()), float(fall.std(ddof=1) / np.sqrt(len(fall))) if len(fall) > 1 else inf


@dataclass(frozen=True, slots=True)
class NextFall:
    """What a unit that nobody has seen will lose less, by Student's predictive distribution of the units seen."""

    chance: float  #: that it loses less at all
    low: float  #: with a probability of INSIDE it loses less by between this …
    high: float  #: … and this


INSIDE = 0.8


def next_fall(before: np.ndarray, after: np.ndarray) -> NextFall:
    """The fall of a new unit's loss; each of the units seen, shape (units,), was judged by a fit that had not seen
    it."""
    fall, n = before - after, len(before)
    if n < 2:
        return NextFall(0.0, -inf, inf)
    mean, spread_ = float(fall.mean()), float(fall.std(ddof=1) * np.sqrt(1.0 + 1.0 / n))
    reach = float(stdtrit(n - 1, 0.5 + 0.5 * INSIDE)) * spread_
    chance = float(stdtr(n - 1, mean / spread_)) if spread_ > 0.0 else float(mean > 0.0)
    return NextFall(chance, mean - reach, mean + reach)


def select(
    field_: Sequence[Any],
    losses: np.ndarray,
    rules: Rules,
    clean: Callable[[Trial], bool] = lambda trial: False,
    together: Callable[[Sequence[Any]], bool] = lambda candidates: True,
) -> Generator[list[Entry], list[Trial], Selection]:
    """Choose from ``field_``; yields batches of entries, wants their trials, and returns the selection.

    ``losses``: of every unit with nothing chosen, shape (units,).  ``clean(trial)``: whether nothing more is to
    be looked for.  ``together(candidates)``: whether these can be fitted together at all.

    Single candidates come first; if the best leaves something, pairs of the best few with every other, because
    two faults may hide each other; then one more at a time.
    """
    rounds: list[Round] = []
    current: Trial | None = None
    unsettled: Trial | None = None
    held = losses
    while current is None or len(current.candidates) < rules.most:
        chosen = current.candidates if current else ()
        rest = [c for c in field_ if c.name not in {x.name for x in chosen} and together((*chosen, c))]
        trials = yield [Entry((*chosen, c), current) for c in rest]
        round_ = _decide(tuple(c.name for c in chosen), trials, held, rules, clean)
        rounds.append(round_)
        if round_.winner is None:
            break
        stuck = False
        unsettled = yield from _unsettled(round_.winner, rest, rules, clean, together)
        left = unsettled is not None or not clean(round_.winner)
        if not chosen and rules.most > 1 and rules.leaders and left:
            pairs = list(_pairs(round_.trials[: rules.leaders], field_, together))
            if 0 < rules.sketched < len(pairs):
                sketches = yield [replace(pair, sketch=True) for pair in pairs]
                order = np.argsort([sketch.losses.mean() for sketch in sketches], kind="stable")
                pairs = [pairs[i] for i in order[: rules.sketched]]
            more = yield pairs
            # then no other pair holds the winner either
            stuck = not _take_a_pair(round_, round_.winner, more, held, rules, clean)
            if not stuck:
                unsettled = yield from _unsettled(round_.winner, field_, rules, clean, together)
        current, held = round_.winner, round_.winner.losses
        if stuck or (unsettled is None and clean(current)):
            break
    return Selection(rounds, current, unsettled)


def _unsettled(
    winner: Trial,
    others: Sequence[Any],
    rules: Rules,
    clean: Callable[[Trial], bool],
    together: Callable[[Sequence[Any]], bool],
) -> Generator[list[Entry], list[Trial], Trial | None]:
    """The sketch of a winner that leaves nothing to be looked for with one more that takes off too much for that, if
    there is one."""
    most = rules.most_beside(winner.gain)
    if not (most < inf and clean(winner)) or set(winner.names) & set(rules.no_sign_beside):
        return None
    asked = [(*winner.candidates, c) for c in others if c.name not in (*winner.names, *rules.no_sign_beside)]
    sketches = yield [Entry(candidates, winner, sketch=True) for candidates in asked if together(candidates)]
    best = min(sketches, key=lambda t: t.losses.mean(), default=None)
    return best if best is not None and paired(winner.losses, best.losses)[0] > most else None


def _decide(
    before: tuple[str, ...],
    trials: Iterable[Trial],
    held: np.ndarray,
    rules: Rules,
    clean: Callable[[Trial], bool],
) -> Round:
    """The winner, if there is one, and those that do as well."""
    least = rules.least_gain(float(held.mean()))
    judged = []
    for trial in trials:
        gain, error = paired(held, trial.losses)
        little = (
            ""
            if gain > least
            else f"it takes {gain:.2f} off a {rules.unit}, too little to be worth a name: {least:.2f} is"
        )
        refusal = rules.falls_short(trial, held) or little
        judged.append(replace(trial, gain=gain, gain_error=error, refusal=refusal))
    judged.sort(key=lambda t: -t.gain)
    good = [t for t in judged if not t.refusal]
    if not good:
        return Round(before, judged, None)
    return Round(before, judged, *_simplest(good, rules, clean))


def _simplest(good: Sequence[Trial], rules: Rules, clean: Callable[[Trial], bool]) -> tuple[Trial, list[Trial]]:
    """Of the trials that earn it, best first: the simplest of those as good as the best, and the others of those.

    Where some leave nothing to be looked for, one of these wins.
    """
    leave_nothing = [t for t in good if clean(t)]
    whole = leave_nothing or good
    best = whole[0]
    also = (1.0 - rules.alike_if_clean) * best.gain if leave_nothing else inf

    def is_whole(trial: Trial) -> bool:
        return any(trial is x for x in whole)

    alike = [t for t in good if is_alike(t, best, rules) or (t.gain >= also and is_whole(t))]
    as_good = [t for t in alike if is_whole(t) and t.gain >= rules.tie * best.gain]
    winner = min(as_good, key=lambda t: (t.parameters, -t.gain))
    return winner, [t for t in alike if t is not winner]


def is_alike(trial: Trial, best: Trial, rules: Rules) -> bool:
    """Whether unseen units cannot tell two trials apart: within a standard error of their paired difference."""
    behind, error = paired(trial.losses, best.losses)
    return trial is best or behind <= max(error, rules.alike * best.gain)


def _pairs(
    leaders: Sequence[Trial], field_: Sequence[Any], together: Callable[[Sequence[Any]], bool]
) -> Iterator[Entry]:
    seen = set()
    for leader in leaders:
        (first,) = leader.candidates
        for other in field_:
            pair = frozenset((first.name, other.name))
            if len(pair) == 2 and pair not in seen and together((first, other)):
                seen.add(pair)
                yield Entry((first, other), leader)


def _take_a_pair(
    round_: Round,
    winner: Trial,
    pairs: Iterable[Trial],
    held: np.ndarray,
    rules: Rules,
    clean: Callable[[Trial], bool],
) -> bool:
    """Let a pair win where each of its two earns its place over the other alone, and over the winner so far."""
    single = {t.names[0]: t for t in round_.trials}
    judged = []
    for trial in pairs:
        gain, error = paired(held, trial.losses)
        rivals = {name: single[name] for name in trial.names if name in single} | {winner.names[0]: winner}
        shorts = {name: _falls_short_beside(trial, rival, gain, rules) for name, rival in rivals.items()}
        refusal = next((f"over {name} alone: {why}" for name, why in shorts.items() if why), "")
        judged.append(replace(trial, gain=gain, gain_error=error, refusal=refusal))
    round_.trials = sorted([*round_.trials, *judged], key=lambda t: -t.gain)
    good = sorted((t for t in judged if not t.refusal), key=lambda t: -t.gain)
    if not good:
        return False
    round_.winner, round_.alternatives = _simplest(good, rules, clean)
    return True


def _falls_short_beside(trial: Trial, rival: Trial, gain: float, rules: Rules) -> str:
    """Why a pair with this gain does not do so much better than another trial that two names are worth it; empty if it
    does."""
    beside, _ = paired(rival.losses, trial.losses)
    least = rules.least_beside * gain
    little = (
        "" if beside > least else f"the other takes {beside:.2f} off, too little to be worth a name: {least:.2f} is"
    )
    return rules.falls_short(trial, rival.losses) or little


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
