"""From the plain model's residual to the effects that earn their parameters on runs they were not fitted on.

An effect is chosen on leave-one-run-out folds; the error that is stated is that of a run on which
nothing was chosen or fitted.  Choosing is a fit too: on the folds of the choice the error always falls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from .candidates import CANDIDATES, Candidate
from .fitting import Fit, fit, plain_parameters, plain_starts, residual_m
from .runs import Run
from .wire import ForwardWire

EARNS_RATIO = (
    0.95  #: held-out error with the effect over that without, geometric mean over runs, and one standard error
)
EARNS_STROKE = 0.0005  #: and at least this share of the stroke: less is noise
WORSE_RATIO = 1.03  #: no run may become this much worse: what a bench has, it has in every run
AGREE_RATIO = 0.5  #: span of an effect's value over the folds, over its median: a bench has one value
AGREE_SPAN = 0.05  #: or over the span that physics leaves it, if that is more
NOTHING_STROKE = 0.002  #: a held-out error below this share of the stroke is that of the position sensor
_LEADERS = 2  #: the best few that earn it alone are tried with a second; no more than two effects are ever named
_RACE_EVALUATIONS = 15
_FINAL_EVALUATIONS = 60

#: A fold: runs to fit, runs to judge.
Fold = tuple[tuple[Run, ...], tuple[Run, ...]]
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Entry:
    """One competitor in a choice."""

    effects: tuple[Candidate, ...]
    held_out_m: tuple[float, ...]  #: RMS on each run, fitted on the others of the choice
    ratio: float  #: geometric mean over runs, against the plain model
    verdict: str  #: "" if it earned its place
    fits: tuple[Fit, ...] = field(repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its effects."""
        return tuple(c.name for c in self.effects)

    @property
    def earns(self) -> bool:
        """Whether it may be chosen."""
        return not self.verdict

    @property
    def values(self) -> dict[str, list[float]]:
        """Its values in each fold."""
        return {f.name: [float(found.wire.value(f.name)) for found in self.fits] for c in self.effects for f in c.free}

    @property
    def size(self) -> tuple[int, int]:
        """Effects, and values of theirs."""
        return len(self.effects), len(self.values)


@dataclass(frozen=True)
class Choice:
    """What some runs, among themselves, ask for."""

    runs: tuple[Run, ...]
    folds: tuple[Fold, ...]
    heats: dict[str, tuple[float, ...]]  #: held-out RMS [m] of the plain model for each voltage
    plain: Entry
    entries: tuple[Entry, ...]  #: all that competed, best first
    winner: Entry  #: the plain model if none earned it
    alike: tuple[Entry, ...]  #: others that earn it and are as good within a standard error
    fitted_plain: Fit  #: on all of ``runs``
    fitted: Fit  #: with the winner's effects
    fitted_heats: dict[str, Fit]  #: the plain model for each voltage
    fitted_rigid: Fit  #: the plain model without thermal expansion

    @property
    def heated_by(self) -> str:
        """The voltage with the smaller held-out error."""
        return self.plain.fits[0].wire.drive.heats


@dataclass(frozen=True)
class Judgement:
    """A choice, and the runs that had no part in it."""

    choice: Choice
    judged: tuple[Run, ...]
    before_m: tuple[float, ...]
    after_m: tuple[float, ...]
    heats_m: dict[str, tuple[float, ...]]
    rigid_m: tuple[float, ...]


@dataclass(frozen=True)
class Tracing:
    """All that was found."""

    choice: Choice  #: on all the runs that were given to fit
    judgements: tuple[Judgement, ...]  #: one for ``--judge``, else one for each run
    named: tuple[Candidate, ...]
    verdict: str  #: none, traced or unexplained
    fitted: Fit  #: on all the runs given to fit, with the named effects
    repeat_m: tuple[tuple[str, str, float], ...]  #: pairs of runs with one duty, and how far they differ (RMS)

    @property
    def nested(self) -> bool:
        """Whether each run was judged in turn."""
        return len(self.judgements) > 1

    @property
    def judged(self) -> tuple[Run, ...]:
        """Judged runs, in the order of ``before_m`` and ``after_m``."""
        return tuple(run for j in self.judgements for run in j.judged)

    @property
    def by_run(self) -> tuple[Judgement, ...]:
        """The judgement of each of ``judged``."""
        return tuple(j for j in self.judgements for _ in j.judged)

    @property
    def before_m(self) -> tuple[float, ...]:
        """RMS of the plain model on each judged run."""
        return tuple(e for j in self.judgements for e in j.before_m)

    @property
    def after_m(self) -> tuple[float, ...]:
        """RMS with what was chosen without the run."""
        return tuple(e for j in self.judgements for e in j.after_m)

    def heats_m(self, name: str) -> tuple[float, ...]:
        """RMS of the plain model heated by that voltage."""
        return tuple(e for j in self.judgements for e in j.heats_m[name])

    @property
    def rigid_m(self) -> tuple[float, ...]:
        """RMS of the plain model without thermal expansion."""
        return tuple(e for j in self.judgements for e in j.rigid_m)

    @property
    def falls(self) -> bool:
        """Whether the error on unseen runs falls by what an effect has to earn."""
        return float(np.mean(self.after_m)) < EARNS_RATIO * float(np.mean(self.before_m))

    def chosen_in(self, name: str) -> float:
        """Share of the judgements whose own choice has that effect."""
        return float(np.mean([name in j.choice.winner.names for j in self.judgements]))

    @property
    def provisional(self) -> tuple[str, ...]:
        """Effects that some choice took and that are not named."""
        winners = (self.choice.winner, *(j.choice.winner for j in self.judgements))
        return tuple(
            dict.fromkeys(name for w in winners for name in w.names if name not in [c.name for c in self.named])
        )


def trace(
    wire: ForwardWire,
    runs: Sequence[Run],
    judge: Sequence[Run] = (),
    progress: Progress = lambda what, share: None,
    pool: Executor | None = None,
    candidates: Sequence[Candidate] = CANDIDATES,
) -> Tracing:
    """Choose effects on ``runs`` and judge the choice: on ``judge``, or on each run in turn, chosen on the others."""
    do = pool.map if pool else map
    groups = [tuple(runs)]
    if not judge:
        groups += [tuple(r for r in runs if r is not out) for out in runs]
    choice, *others = _choose(do, wire, groups, candidates, progress)
    if judge:
        judgements = (_judged(choice, tuple(judge)),)
    else:
        judgements = tuple(_judged(c, (out,)) for c, out in zip(others, runs, strict=True))
    found = Tracing(choice, judgements, (), "unexplained", choice.fitted_plain, repeats([*runs, *judge]))
    named = tuple(c for c in choice.winner.effects if found.chosen_in(c.name) > 0.5)
    if named and found.falls:
        fitted = choice.fitted
        if len(named) < len(choice.winner.effects):
            fitted = next(iter(do(_fit_named, [(choice, named)])))
        return replace(found, named=named, verdict="traced", fitted=fitted)
    strokes_m = [run.stroke_m for run in found.judged]
    if not choice.winner.effects and np.mean(np.divide(found.before_m, strokes_m)) < NOTHING_STROKE:
        return replace(found, verdict="none")
    return found


def _judged(choice: Choice, judged: tuple[Run, ...]) -> Judgement:
    def on(found: Fit) -> tuple[float, ...]:
        return tuple(_rms(found, run) for run in judged)

    heats = {name: on(f) for name, f in choice.fitted_heats.items()}
    return Judgement(choice, judged, on(choice.fitted_plain), on(choice.fitted), heats, on(choice.fitted_rigid))


def _choose(
    do, wire: ForwardWire, groups: Sequence[tuple[Run, ...]], candidates: Sequence[Candidate], progress: Progress
) -> list[Choice]:
    """What each group of runs chooses; the groups go side by side, so that no process waits."""
    every = [tuple((tuple(r for r in group if r is not out), (out,)) for out in group) for group in groups]
    variants = {heats: wire.with_values({"drive.heats": heats}) for heats in ("rms", "mean")}
    fitted = _counted(
        do(_fit_plain, [(v, folds) for folds in every for v in variants.values()]), len(every) * len(variants), "plain model", 0.0, 0.1,
        progress,
    )  # fmt: skip
    plains, heats = [], []
    for i, folds in enumerate(every):
        fits = dict(zip(variants, fitted[len(variants) * i :], strict=False))
        heats.append({name: _held_out(f, folds) for name, f in fits.items()})
        best = min(variants, key=lambda name: _mean(heats[i][name]))
        plains.append(Entry((), heats[i][best], 1.0, "", tuple(fits[best])))

    jobs = [(plains[i].fits, (c,), folds, _RACE_EVALUATIONS) for c in candidates for i, folds in enumerate(every)]
    fits = _counted(do(_fit_with, jobs), len(jobs), "each effect alone", 0.1, 0.45, progress)
    alone: list[list[Entry]] = [[] for _ in every]
    for number, ((_, added, folds, _), f) in enumerate(zip(jobs, fits, strict=True)):
        i = number % len(every)
        alone[i].append(_entry(plains[i], added, f, folds))

    jobs, where = [], []
    for i, folds in enumerate(every):
        for first, second in _pairs(alone[i], candidates):
            jobs.append((first.fits, (second,), folds, _RACE_EVALUATIONS))
            where.append((i, (*first.effects, second)))
    fits = _counted(do(_fit_with, jobs), len(jobs), "in pairs", 0.45, 0.9, progress)
    entries = [list(e) for e in alone]
    for (i, pair), f in zip(where, fits, strict=True):
        entries[i].append(_pair_entry(plains[i], pair, f, every[i], alone[i]))

    ranked = [_ranked(e) for e in entries]
    jobs = [(wire, group, plains[i], ranked[i]) for i, group in enumerate(groups)]
    ends = _counted(do(_finish, jobs), len(jobs), "last fits", 0.9, 1.0, progress)
    out = []
    for i, (winner, fitted_heats, rigid, found) in enumerate(ends):
        best = ranked[i][winner] if winner is not None else plains[i]
        alike = tuple(e for e in ranked[i] if e is not best and len(e.names) <= len(best.names) and _as_good(e, best))
        plain_fit = fitted_heats[plains[i].fits[0].wire.drive.heats]
        entries[i].sort(key=lambda e: e.ratio)
        out.append(
            Choice(
                groups[i], every[i], heats[i], plains[i], tuple(entries[i]), best, alike, plain_fit, found or plain_fit, fitted_heats,
                rigid,
            )
        )  # fmt: skip
    return out


def _counted(results: Iterable, total: int, what: str, begin: float, end: float, progress: Progress) -> list:
    out = []
    for result in results:
        out.append(result)
        progress(what, begin + (end - begin) * len(out) / max(total, 1))
    return out


def _pairs(alone: Sequence[Entry], candidates: Sequence[Candidate]) -> list[tuple[Entry, Candidate]]:
    """The best few that stand on their own, each with every other effect that has values of its own."""
    leaders = sorted((e for e in alone if e.earns), key=lambda e: e.ratio)[:_LEADERS]
    out, seen = [], set()
    for leader in leaders:
        for c in candidates:
            pair = frozenset((*leader.names, c.name))
            if len(pair) == 2 and pair not in seen and not set(c.parameters) & set(leader.effects[0].parameters):
                seen.add(pair)
                out.append((leader, c))
    return out


def repeats(runs: Sequence[Run]) -> tuple[tuple[str, str, float], ...]:
    """Pairs of runs driven alike, and the RMS of their difference [m]: a model of the duty alone cannot fit both."""
    out = []
    for a, b in combinations(runs, 2):
        n = min(len(a.coarse_duty), len(b.coarse_duty))
        alike = len(a.coarse_duty) == len(b.coarse_duty) and abs(a.step_s - b.step_s) < 1e-6
        if alike and np.max(np.abs(a.coarse_duty[:n] - b.coarse_duty[:n])) < 5e-3:
            out.append(
                (a.name, b.name, float(np.sqrt(np.mean((a.coarse_position_m[:n] - b.coarse_position_m[:n]) ** 2))))
            )
    return tuple(out)


def _mean(values: Sequence[float]) -> float:
    """Geometric, so that a run that nobody can explain does not drown the others."""
    return float(np.exp(np.mean(np.log(np.maximum(values, 1e-9)))))


def _rms(found: Fit, run: Run) -> float:
    return float(np.sqrt(np.mean(residual_m(found.wire, run) ** 2)))


def _held_out(fits: Sequence[Fit], folds: Sequence[Fold]) -> tuple[float, ...]:
    return tuple(_rms(f, run) for f, (_, judged) in zip(fits, folds, strict=True) for run in judged)


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
        if len(new) == 2:  # two values bend into one another: try the other side too
            starts.append(np.concatenate([base.values, [0.7 * f.lo + 0.3 * f.hi for f in new]]))
        out.append(fit(base.wire, (*base.free, *new), runs, starts, evaluations))
    return out


def _finish(job: tuple[ForwardWire, Sequence[Run], Entry, Sequence[Entry]]):
    """On all runs of a choice: (place of the winner among ``ranked``, plain fits by voltage, without expansion, winner's fit)."""
    wire, runs, plain, ranked = job
    heats = {}
    for name in ("rms", "mean"):
        variant = wire.with_values({"drive.heats": name})
        free = plain_parameters(variant)
        heats[name] = fit(variant, free, runs, plain_starts(free), _FINAL_EVALUATIONS)
    best = heats[plain.fits[0].wire.drive.heats]
    cold = best.wire.with_values({"wire.martensite_expansion_1_K": 0.0, "wire.austenite_expansion_1_K": 0.0})
    rigid = fit(cold, best.free, runs, [best.values, *plain_starts(best.free)[:1]], _FINAL_EVALUATIONS)
    for place, entry in enumerate(ranked):
        found = _fit_all(entry, runs)
        # What the last fit drives to a bound of the possible has not been measured after all.
        if not any(f.at_bound(found.wire.value(f.name)) for c in entry.effects for f in c.free):
            return place, heats, rigid, found
    return None, heats, rigid, None


def _fit_all(entry: Entry, runs: Sequence[Run]) -> Fit:
    return fit(entry.fits[0].wire, entry.fits[0].free, runs, [f.values for f in entry.fits], _FINAL_EVALUATIONS)


def _fit_named(job: tuple[Choice, Sequence[Candidate]]) -> Fit:
    choice, named = job
    return _fit_all(next(e for e in choice.entries if set(e.names) == {c.name for c in named}), choice.runs)


def _change(after: Sequence[float], before: Sequence[float]) -> tuple[float, float]:
    """Mean over runs of the logarithm of an error's ratio, and its standard error."""
    logs = np.log(np.maximum(after, 1e-9)) - np.log(np.maximum(before, 1e-9))
    return float(logs.mean()), float(logs.std(ddof=1) / np.sqrt(len(logs)))


def _no_gain(after: Sequence[float], before: Sequence[float]) -> str:
    """Why these errors are not surely less than those; "" if they are."""
    mean, error = _change(after, before)
    if mean > np.log(EARNS_RATIO):
        return "held-out error not 5 % less"
    if mean + error > np.log(EARNS_RATIO):
        return "held-out error not 5 % less beyond a standard error"
    worst = max(a / b for a, b in zip(after, before, strict=True))
    return f"makes one held-out run {worst:.2f} times worse" if worst > WORSE_RATIO else ""


def _entry(plain: Entry, effects: tuple[Candidate, ...], fits: Sequence[Fit], folds: Sequence[Fold]) -> Entry:
    errors = _held_out(fits, folds)
    entry = Entry(effects, errors, _mean(errors) / _mean(plain.held_out_m), "", tuple(fits))
    verdict = _no_gain(errors, plain.held_out_m)
    stroke_m = float(np.mean([run.stroke_m for _, judged in folds for run in judged]))
    if not verdict and np.mean(plain.held_out_m) - np.mean(errors) < EARNS_STROKE * stroke_m:
        verdict = f"gains less than {EARNS_STROKE:.2%} of the stroke"
    return replace(entry, verdict=verdict or _not_measured(entry))


def _not_measured(entry: Entry) -> str:
    for c in entry.effects:
        for f in c.free:
            values = entry.values[f.name]
            if any(f.at_bound(v) for v in values):
                return f"{f.name} runs to its bound: {f.lo:g} to {f.hi:g} {f.unit}".rstrip()
            if np.ptp(values) > max(AGREE_RATIO * abs(float(np.median(values))), AGREE_SPAN * (f.hi - f.lo)):
                span = f"{min(values):.3g} to {max(values):.3g} {f.unit}".rstrip()
                return f"{f.name} differs from fold to fold: {span}"
    return ""


def _pair_entry(
    plain: Entry, pair: tuple[Candidate, ...], fits: Sequence[Fit], folds: Sequence[Fold], alone: Sequence[Entry]
) -> Entry:
    """Each of the two has to earn it again, over the other alone."""
    entry = _entry(plain, pair, fits, folds)
    for one in (e for e in alone if e.effects[0] in pair):
        why = _no_gain(entry.held_out_m, one.held_out_m)
        if entry.earns and why:
            return replace(entry, verdict=f"over {one.names[0]} alone: {why}")
    return entry


def _ranked(entries: Sequence[Entry]) -> list[Entry]:
    """Those that earn it: the simplest of those as good as the best within a standard error first, then the rest."""
    earn = sorted((e for e in entries if e.earns), key=lambda e: e.ratio)
    good = [e for e in earn if _as_good(e, earn[0])]
    good.sort(key=lambda e: (e.size, e.ratio))
    return good + [e for e in earn if e not in good]


def _as_good(entry: Entry, best: Entry) -> bool:
    if entry is best:
        return True
    mean, error = _change(entry.held_out_m, best.held_out_m)
    return mean <= error
