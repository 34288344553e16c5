"""The candidates compete; one is named only if it earns its parameters on cycles it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from joblib import Parallel, delayed

from sma_actuator.estimation.effects import EFFECTS, NOT_THE_MODEL
from sma_actuator.logs.errors import BenchLogError

from .candidates import Candidate, candidate, scales_of, untestable
from .evidence import INDEPENDENT, Evidence, Prediction
from .fitting import Fit, fit

MOST_EFFECTS = 3
LAST_BLOCK = 0.15  #: share of the cycles, the latest, that is looked at once, when all is chosen
SIGNIFICANT = 2.5  #: standard errors of the gain on held-out cycles
WORTH = 0.1  #: share of what is in excess that an effect must at least explain
PAIR_FIRST = 3  #: so many of the best single candidates are tried with every other
#: An error within this of what the calibration had at the same places is the model's own …
NONE_ERROR = 1.25
#: … and one beyond this is real: between the two only an effect that leaves it clean is named, and else nothing is said.
REAL_ERROR = 1.5
ALIKE = 0.05  #: share of the gain within which two fits count as alike in any case
#: Clean: mean loss, over that of a log like the calibration's, up to which nothing more is to be found …
CLEAN_LOSS = 1.8
#: … or the share of the excess loss that is explained, together with an error within the floor.
CLEAN_SHARE = 0.93
Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Trial:
    """One entry of the race."""

    names: tuple[str, ...]
    gain: float  #: mean fall of a held-out cycle's loss
    gain_error: float  #: its standard error over cycles
    fit: Fit


@dataclass(slots=True)
class Round:
    """What competed after what, and who won."""

    before: tuple[str, ...]
    trials: list[Trial]
    winner: Trial | None
    alternatives: list[Trial] = field(default_factory=list)


@dataclass(slots=True)
class Tracing:
    """The result."""

    verdict: str  #: none, traced or unexplained
    fit: Fit | None
    rounds: list[Round]
    alternatives: dict[str, Trial]  #: other names for one of the effects, and how they do with the rest
    untestable: dict[str, str]
    train: (
        np.ndarray
    )  #: bool, shape (units,): cycles of which some were held out in turn; the others are the last block
    losses: dict[str, np.ndarray]  #: held-out loss of every unit, before and after
    errors_percent: dict[str, np.ndarray]  #: mean absolute error of every unit, % of full stroke, before and after
    predictions: dict[str, list[Prediction]]  #: before and after
    floor_percent: float
    expected_loss: float
    share: float  #: of the excess loss that is explained


def trace(
    evidence: Evidence,
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    jobs: int = 2,
    progress: Progress = lambda what, fraction: None,
) -> Tracing:
    """Find what the model lacks in these logs.

    ``only``: names of the only candidates; ``without``: of those left out.  ``jobs``: fits at a time, by joblib, so
    that ``joblib.parallel_config("dask")`` around the call spreads them over a cluster.  Raises BenchLogError where
    an effect of ``only`` cannot be fitted on these logs.
    """
    scales = scales_of(evidence)
    names = [n for n in EFFECTS if (not only or n in only) and n not in without]
    if evidence.beyond_floor and not only:  # what circuit and sensors did at the calibration, it has absorbed
        names = [n for n in names if EFFECTS[n].PART == "wire"]
    reasons = untestable(names, scales)
    if only and reasons:
        raise BenchLogError("; ".join(f"{n} cannot be fitted on these logs: {why}" for n, why in reasons.items()))
    field_ = [candidate(n, scales) for n in names if n not in reasons]
    last = max(1, round(LAST_BLOCK * evidence.units))
    train = np.arange(evidence.units) < evidence.units - last
    before = evidence.predict({})
    base = evidence.losses(evidence.residual({}))
    errors = evidence.errors_percent(before)
    floor = NONE_ERROR * evidence.floor_percent(before)
    expected = _expected_loss(evidence)
    result = Tracing(
        "none",
        None,
        [],
        {},
        reasons,
        train,
        {"before": base, "after": base},
        {"before": errors, "after": errors},
        {"before": before, "after": before},
        floor,
        expected,
        0.0,
    )
    if float(errors.mean()) <= floor and not only:
        return result
    with _fitters(evidence, train, jobs) as fits_of:
        current, held = None, base
        if only:
            trials = _race(fits_of, [(tuple(field_), None)], train, held, progress) if field_ else []
            result.rounds.append(Round((), trials, trials[0] if trials else None))
            current = trials[0].fit if trials else None
            held = current.held_out if current else base
        while not only and len(current.names if current else ()) < MOST_EFFECTS:
            chosen = current.candidates if current else ()
            rest = [c for c in field_ if c.name not in {x.name for x in chosen}]
            trials = _race(fits_of, [((*chosen, c), current) for c in rest], train, held, progress)
            round_ = _decide(evidence, tuple(c.name for c in chosen), trials, train, held, expected)
            result.rounds.append(round_)
            if round_.winner is None:
                break
            if len(chosen) == 0 and not _clean(evidence, round_.winner.fit, base, train, expected):
                more = _race(fits_of, _pairs(trials, rest), train, held, progress)
                best_pair = max(more, key=lambda t: t.gain, default=None)
                if best_pair is not None and _pays(best_pair, round_.winner, train):
                    round_.trials += more
                    round_.winner = best_pair
                    round_.alternatives = [
                        t for t in more if t is not best_pair and not t.fit.at_bound and _alike(t, best_pair, train)
                    ]
            current = round_.winner.fit
            held = current.held_out
            if _clean(evidence, current, base, train, expected):
                break
    if current is not None:
        result.fit = current
        result.predictions["after"] = evidence.predict(current.effects)
        result.losses["after"] = held
        result.errors_percent["after"] = current.held_out_percent
        result.share = _share(held, base, train, expected)
        result.alternatives = _alternatives(result.rounds, current)
    found = current is not None
    if evidence.beyond_floor:  # then every effect that pays counts, and what remains is the model's as it is
        result.verdict = "traced" if found else "none"
    else:
        real = float(errors.mean()) > REAL_ERROR / NONE_ERROR * floor
        clean = found and _clean(evidence, current, base, train, expected)
        result.verdict = "traced" if clean else "unexplained" if real or only else "none"
    return result


def _expected_loss(evidence: Evidence) -> float:
    """Mean loss of a cycle that is like those of the calibration."""
    if evidence.beyond_floor:
        return 0.0
    rests = sum(map(len, evidence.rests))
    return 0.5 * (INDEPENDENT + 2.0 * rests / evidence.units)


@contextmanager
def _fitters(evidence: Evidence, train: np.ndarray, jobs: int) -> Iterator[Callable]:
    """A function that gives the fits of entries, (candidates, what is known of some of them), in their order."""
    if jobs == 1:
        yield lambda entries: (fit(evidence, names, train, known) for names, known in entries)
        return
    with Parallel(n_jobs=jobs, return_as="generator") as pool:
        yield lambda entries: pool(delayed(fit)(evidence, names, train, known) for names, known in entries)


def _race(fits_of, entries, train, held, progress) -> list[Trial]:
    """Trials of ``entries``, best first."""
    trials = []
    for f in fits_of(entries) if entries else ():
        difference = (held - f.held_out)[train]
        trials.append(Trial(f.names, float(difference.mean()), _standard_error(difference), f))
        progress("race", len(trials) / len(entries))
    return sorted(trials, key=lambda t: -t.gain)


def _standard_error(values: np.ndarray) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("inf")


def _decide(evidence, before, trials: list[Trial], train, held, expected) -> Round:
    """The winner, if there is one, and those that do as well."""
    round_ = Round(before, trials, None)
    excess = max(float(held[train].mean()) - expected, 1e-9)
    good = [t for t in trials if t.gain > SIGNIFICANT * t.gain_error and t.gain > WORTH * excess and not t.fit.at_bound]
    if not good:
        return round_
    best = good[0]
    alike = [t for t in good if _alike(t, best, train)]
    winner = min((t for t in alike if t.gain >= 0.99 * best.gain), key=lambda t: (t.fit.parameters, -t.gain))
    round_.winner = winner
    round_.alternatives = [t for t in alike if t is not winner]
    return round_


def _alike(trial: Trial, best: Trial, train: np.ndarray) -> bool:
    """Whether held-out cycles cannot tell two fits apart: within a standard error of their paired difference."""
    difference = (trial.fit.held_out - best.fit.held_out)[train]
    return float(difference.mean()) <= max(_standard_error(difference), ALIKE * best.gain)


def _pays(pair: Trial, single: Trial, train: np.ndarray) -> bool:
    difference = (single.fit.held_out - pair.fit.held_out)[train]
    return difference.mean() > SIGNIFICANT * _standard_error(difference) and not pair.fit.at_bound


def _pairs(trials: list[Trial], rest: Sequence[Candidate]) -> list[tuple[tuple[Candidate, Candidate], Fit]]:
    seen, out = set(), []
    for trial in trials[:PAIR_FIRST]:
        (first,) = trial.fit.candidates
        for other in rest:
            key = frozenset((first.name, other.name))
            if len(key) == 2 and key not in seen:
                seen.add(key)
                out.append(((first, other), trial.fit))
    return out


def _share(held, base, train, expected) -> float:
    excess = float(base[train].mean()) - expected
    return min((float(base[train].mean()) - float(held[train].mean())) / excess, 1.0) if excess > 0 else 0.0


def _clean(evidence, fit_: Fit, base, train, expected) -> bool:
    """Whether what remains is like the calibration: the error no larger, and nothing that shows in the loss."""
    held = fit_.held_out
    if float(held[train].mean()) > CLEAN_LOSS * expected and _share(held, base, train, expected) < CLEAN_SHARE:
        return False
    predictions = evidence.predict(fit_.effects)
    errors = evidence.errors_percent(predictions)
    return float(errors.mean()) <= REAL_ERROR * evidence.floor_percent(predictions)


def _alternatives(rounds: list[Round], current: Fit) -> dict[str, Trial]:
    """Names that would do as well for one of the effects found."""
    out: dict[str, Trial] = {}
    for r in rounds:
        for t in r.alternatives:
            others = [n for n in t.names if n not in current.names]
            if len(others) == 1:
                out.setdefault(others[0], t)
    return out


def of_the_model(names: Sequence[str]) -> list[str]:
    """Those of the effects that belong into a model file; the others are named and left alone."""
    return [n for n in names if EFFECTS[n].PART not in NOT_THE_MODEL]
