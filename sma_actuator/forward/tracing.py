"""From the plain model's residual to the effects that earn their parameters on runs they were not fitted on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from .candidates import CANDIDATES, Candidate
from .fitting import Fit, fit, plain_parameters, plain_starts, residual_m
from .runs import Run
from .wire import ForwardWire

EARNS_RATIO = 0.95  #: held-out error with the effect over that without, geometric mean over runs
EARNS_STROKE = 0.0005  #: and at least this share of the stroke: less is noise
WORSE_RATIO = 1.10  #: no run may become this much worse
ROUNDS = 4
_PATHS = 4  #: greedy addition starts from each of the best few of the first round: one alone may lead astray
_PAIRS_OF = 4  #: the best few singles also compete in pairs
_HOPELESS = 1.25  #: a candidate this much worse on held-out runs does not compete again
_RACE_EVALUATIONS = 15
_PRUNE_EVALUATIONS = 30
_FINAL_EVALUATIONS = 60

#: A fold: runs to fit, runs to judge.
Fold = tuple[tuple[Run, ...], tuple[Run, ...]]


@dataclass(frozen=True)
class Entry:
    """One competitor in one round."""

    names: tuple[str, ...]
    held_out_m: tuple[float, ...]  #: RMS on each judged run
    ratio: float  #: geometric mean over runs, against what it was added to
    verdict: str  #: "" if it earned its place
    fits: tuple[Fit, ...] = field(repr=False)

    @property
    def earns(self) -> bool:
        """Whether it may be named."""
        return not self.verdict

    @property
    def values(self) -> dict[str, list[float]]:
        """Its values in each fold."""
        mine = [f.name for c in CANDIDATES if c.name in self.names for f in c.free]
        return {name: [float(f.wire.value(name)) for f in self.fits] for name in mine}


@dataclass(frozen=True)
class Tracing:
    """All that was found."""

    folds: tuple[Fold, ...]
    heats: dict[str, tuple[float, ...]]  #: held-out RMS [m] of the plain model for each voltage, on each judged run
    without_expansion_m: tuple[float, ...]  #: the plain model with no thermal expansion
    plain: Entry
    rounds: tuple[tuple[Entry, ...], ...]  #: of the path that was taken
    paths: tuple[tuple[tuple[str, ...], float], ...]  #: where each start of the greedy addition ended, and its ratio
    chosen: tuple[Candidate, ...]
    held_out: Entry  #: the plain model and the named effects
    dropped: tuple[tuple[str, float], ...]  #: (effect, ratio without it), what each is worth in the end
    fitted_plain: Fit  #: on all fitted runs
    fitted: Fit
    repeat_m: tuple[tuple[str, str, float], ...]  #: pairs of runs with one duty, and how far they differ (RMS)

    @property
    def judged(self) -> tuple[Run, ...]:
        """Judged runs, in the order of every ``held_out_m``."""
        return tuple(run for _, judged in self.folds for run in judged)

    @property
    def heated_by(self) -> str:
        """The voltage with the smaller held-out error."""
        return min(self.heats, key=lambda name: _mean(self.heats[name]))

    @property
    def left(self) -> float:
        """Held-out error of the end over that of the plain model."""
        return _mean(self.held_out.held_out_m) / _mean(self.plain.held_out_m)


def folds_of(runs: Sequence[Run], judge: Sequence[Run]) -> tuple[Fold, ...]:
    """``judge`` judged after a fit to ``runs``; without it, each run judged after a fit to the others."""
    if judge:
        return ((tuple(runs), tuple(judge)),)
    return tuple((tuple(r for r in runs if r is not out), (out,)) for out in runs)


def trace(
    wire: ForwardWire,
    runs: Sequence[Run],
    judge: Sequence[Run] = (),
    progress: Callable[[str, float], None] = lambda what, share: None,
    pool: Executor | None = None,
    candidates: Sequence[Candidate] = CANDIDATES,
) -> Tracing:
    """Fit the plain model, let the candidates compete, and name those that earn it."""
    folds = folds_of(runs, judge)
    do = pool.map if pool else map
    progress("plain model, mean or RMS", 0.0)
    variants = [wire.with_values({"drive.heats": heats}) for heats in ("rms", "mean")]
    cold = wire.with_values({"wire.martensite_expansion_1_K": 0.0, "wire.austenite_expansion_1_K": 0.0})
    fitted = list(do(_fit_plain, [(v, folds) for v in (*variants, cold)]))
    heats = {v.drive.heats: _held_out(f, folds) for v, f in zip(variants, fitted, strict=False)}
    best = min(range(2), key=lambda i: _mean(_held_out(fitted[i], folds)))
    base = variants[best]
    plain = Entry((), _held_out(fitted[best], folds), 1.0, "", tuple(fitted[best]))
    no_expansion = _held_out(
        fitted[2] if base.drive.heats == cold.drive.heats
        else _fit_plain((cold.with_values({"drive.heats": base.drive.heats}), folds)), folds,
    )  # fmt: skip

    first = _first_round(do, plain, candidates, folds, progress)
    paths = []
    starts = [e for e in first if e.earns][:_PATHS]
    for number, start in enumerate(starts):
        report = lambda what, share, n=number: progress(what, 0.3 + 0.65 * (n + share) / len(starts))  # noqa: E731
        paths.append(_climb(do, start, candidates, folds, report))
    current, rounds = min(paths, key=lambda path: _mean(path[0].held_out_m), default=(plain, ()))
    chosen = [c for c in candidates if c.name in current.names]
    rounds = (first, *rounds)
    ends = tuple((path.names, _mean(path.held_out_m) / _mean(plain.held_out_m)) for path, _ in paths)

    progress("last fit, on all the runs", 0.95)
    all_plain = fit(base, plain_parameters(base), runs, plain_starts(plain_parameters(base)), _FINAL_EVALUATIONS)
    while True:
        chosen, current, dropped = _prune(do, plain, chosen, current, folds)
        if not chosen:
            current, final = plain, all_plain
            break
        final = fit(base, current.fits[0].free, runs, [f.values for f in current.fits], _FINAL_EVALUATIONS)
        # What the last fit drives to a bound of the possible has not been measured after all.
        possible = [c for c in chosen if not any(f.at_bound(final.wire.value(f.name)) for f in c.free)]
        if len(possible) == len(chosen):
            break
        chosen = possible
        current = _entry(plain, tuple(chosen), _fit_with((plain.fits, chosen, folds, _PRUNE_EVALUATIONS)), folds)
    progress("done", 1.0)
    return Tracing(
        folds, heats, no_expansion, plain, rounds, ends, tuple(chosen), current, dropped, all_plain, final, repeats([*runs, *judge])
    )


def _first_round(do, plain: Entry, candidates: Sequence[Candidate], folds: Sequence[Fold], progress) -> tuple[Entry, ...]:
    """Every candidate alone, and the best few in pairs; best first."""
    entries = []
    for entry in _race(do, plain, [(c,) for c in candidates], folds):
        entries.append(entry)
        progress(f"alone: {entry.names[0]}", 0.05 + 0.15 * len(entries) / len(candidates))
    best = sorted(entries, key=lambda e: e.ratio)[:_PAIRS_OF]
    pairs = [tuple(c for c in candidates if c.name in a.names + b.names) for a, b in combinations(best, 2)]
    for entry in _race(do, plain, [p for p in pairs if _independent(p)], folds):
        alone = min(e.ratio for e in entries if set(e.names) < set(entry.names))
        if entry.earns and entry.ratio > EARNS_RATIO * alone:
            entry = _replace_verdict(entry, "no better than one of the two alone")
        entries.append(entry)
        progress(" + ".join(entry.names), 0.25)
    return tuple(sorted(entries, key=lambda e: e.ratio))


def _climb(
    do, start: Entry, candidates: Sequence[Candidate], folds: Sequence[Fold], progress
) -> tuple[Entry, tuple[tuple[Entry, ...], ...]]:
    """Greedy addition from ``start``: where it ends, with all the names, and its rounds."""
    current, names, rounds, running = start, start.names, [], list(candidates)
    for number in range(1, ROUNDS):
        chosen = [c for c in candidates if c.name in names]
        sets = [(c,) for c in running if c.name not in names and not _covered(c, chosen)]
        entries = []
        for entry in _race(do, current, sets, folds):
            entries.append(entry)
            progress(" + ".join((*names, *entry.names)), (number - 1 + len(entries) / len(sets)) / (ROUNDS - 1))
        running = [c for c in running if not any(e.names == (c.name,) and e.ratio > _HOPELESS for e in entries)]
        entries.sort(key=lambda e: e.ratio)
        rounds.append(tuple(entries))
        winner = next((e for e in entries if e.earns), None)
        if winner is None:
            break
        current, names = winner, (*names, *winner.names)
    return Entry(names, current.held_out_m, current.ratio, "", current.fits), tuple(rounds)


def repeats(runs: Sequence[Run]) -> tuple[tuple[str, str, float], ...]:
    """Pairs of runs driven alike, and the RMS of their difference [m]: a model of the duty alone cannot fit both."""
    out = []
    for a, b in combinations(runs, 2):
        n = min(len(a.coarse_duty), len(b.coarse_duty))
        alike = len(a.coarse_duty) == len(b.coarse_duty) and abs(a.step_s - b.step_s) < 1e-6
        if alike and np.max(np.abs(a.coarse_duty[:n] - b.coarse_duty[:n])) < 5e-3:
            out.append((a.name, b.name, float(np.sqrt(np.mean((a.coarse_position_m[:n] - b.coarse_position_m[:n]) ** 2)))))
    return tuple(out)


def _mean(values: Sequence[float]) -> float:
    """Geometric, so that a run that nobody can explain does not drown the others."""
    return float(np.exp(np.mean(np.log(np.maximum(values, 1e-9)))))


def _held_out(fits: Sequence[Fit], folds: Sequence[Fold]) -> tuple[float, ...]:
    return tuple(
        float(np.sqrt(np.mean(residual_m(f.wire, run) ** 2))) for f, (_, judged) in zip(fits, folds, strict=True) for run in judged
    )


def _fit_plain(job: tuple[ForwardWire, Sequence[Fold]]) -> list[Fit]:
    wire, folds = job
    free = plain_parameters(wire)
    return [fit(wire, free, fitted, plain_starts(free)) for fitted, _ in folds]


def _fit_with(job: tuple[Sequence[Fit], Sequence[Candidate], Sequence[Fold], int]) -> list[Fit]:
    """Each fold's fit with the candidates' values free as well, from where it was."""
    fits, added, folds, evaluations = job
    out = []
    for base, (runs, _) in zip(fits, folds, strict=True):
        have = {f.name for f in base.free}
        new = [f for c in added for f in c.free if f.name not in have]
        starts = [np.concatenate([base.values, [f.start for f in new]])]
        if len(new) == 2 and len(added) == 1:  # two values bend into one another: try the other side too
            starts.append(np.concatenate([base.values, [0.7 * f.lo + 0.3 * f.hi for f in new]]))
        out.append(fit(base.wire, (*base.free, *new), runs, starts, evaluations))
    return out


def _race(do, current: Entry, sets: Sequence[tuple[Candidate, ...]], folds: Sequence[Fold]) -> Iterator[Entry]:
    fitted = do(_fit_with, [(current.fits, s, folds, _RACE_EVALUATIONS) for s in sets])
    for added, fits in zip(sets, fitted, strict=True):
        yield _entry(current, added, fits, folds)


def _entry(current: Entry, added: tuple[Candidate, ...], fits: Sequence[Fit], folds: Sequence[Fold]) -> Entry:
    errors = _held_out(fits, folds)
    ratio = _mean(errors) / _mean(current.held_out_m)
    judged = [run for _, runs in folds for run in runs]
    stroke_m = float(np.mean([run.stroke_m for run in judged]))
    better = sum(after < before for after, before in zip(errors, current.held_out_m, strict=True))
    worst = max(after / before for after, before in zip(errors, current.held_out_m, strict=True))
    entry = Entry(tuple(c.name for c in added), errors, ratio, "", tuple(fits))
    if ratio > EARNS_RATIO:
        return _replace_verdict(entry, "held-out error not 5 % less")
    if np.mean(current.held_out_m) - np.mean(errors) < EARNS_STROKE * stroke_m:
        return _replace_verdict(entry, f"gains less than {EARNS_STROKE:.2%} of the stroke")
    if better < 0.6 * len(errors):
        return _replace_verdict(entry, f"better on only {better} of {len(errors)} held-out runs")
    if worst > WORSE_RATIO:
        return _replace_verdict(entry, f"makes one held-out run {worst:.2f} times worse")
    for c in added:
        for f in c.free:
            values = [fold.wire.value(f.name) for fold in fits]
            if sum(f.at_bound(v) for v in values) > 0.4 * len(values):
                return _replace_verdict(entry, f"{f.name} runs to its bound: {f.lo:g} to {f.hi:g} {f.unit}".rstrip())
            if np.ptp(values) > max(1.2 * abs(float(np.median(values))), 0.1 * (f.hi - f.lo)):
                span = f"{min(values):.3g} to {max(values):.3g} {f.unit}".rstrip()
                return _replace_verdict(entry, f"{f.name} differs from fold to fold: {span}")
    return entry


def _replace_verdict(entry: Entry, verdict: str) -> Entry:
    return Entry(entry.names, entry.held_out_m, entry.ratio, verdict, entry.fits)


def _covered(candidate: Candidate, chosen: Sequence[Candidate]) -> bool:
    return set(candidate.parameters) <= {name for c in chosen for name in c.parameters}


def _independent(pair: Sequence[Candidate]) -> bool:
    return len(pair) == 2 and not set(pair[0].parameters) & set(pair[1].parameters)


def _named_entry(chosen: Sequence[Candidate], fits: Sequence[Fit], folds: Sequence[Fold], against: Entry) -> Entry:
    errors = _held_out(fits, folds)
    return Entry(tuple(c.name for c in chosen), errors, _mean(errors) / _mean(against.held_out_m), "", tuple(fits))


def _prune(do, plain: Entry, chosen: list[Candidate], current: Entry, folds: Sequence[Fold]):
    """Take out effects that those named after them have made superfluous."""
    while True:
        if len(chosen) < 2:
            return chosen, current, tuple((c.name, _mean(plain.held_out_m) / _mean(current.held_out_m)) for c in chosen)
        rest = [[c for c in chosen if c is not out] for out in chosen]
        trials = [
            _named_entry(kept, fits, folds, current)
            for kept, fits in zip(rest, do(_fit_with, [(plain.fits, kept, folds, _PRUNE_EVALUATIONS) for kept in rest]), strict=True)
        ]
        least = min(range(len(chosen)), key=lambda i: trials[i].ratio)
        if trials[least].ratio > 1.0 + 0.5 * (1.0 - EARNS_RATIO):
            full = _named_entry(chosen, current.fits, folds, plain)
            return chosen, full, tuple((c.name, t.ratio) for c, t in zip(chosen, trials, strict=True))
        chosen, current = rest[least], trials[least]
