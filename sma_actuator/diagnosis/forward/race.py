"""From the plain model's residual to the effects that earn their parameters on runs they were not fitted on.

An effect is chosen on leave-one-run-out folds; the error that is stated is that of a run on which
nothing was chosen or fitted.  Choosing is a fit too: on the folds of the choice the error always falls.

The competition is that of :mod:`.selection`: a unit is a run, its loss the logarithm
of the RMS error, so that a run that nobody can explain does not drown the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from math import log

import numpy as np

from sma_actuator.diagnosis.falls import NextFall, next_fall
from sma_actuator.fleet import Call, spread

from .candidates import CANDIDATES, ForwardCandidate
from .fitting import ForwardFit, fit, fit_for_new_runs, plain_parameters, plain_starts, residual_m
from .runs import Run
from .selection import Entry, Progress, Rules, Selection, Trial, run, select
from .wire import ForwardWire

EARNS_RATIO = 0.95  #: error on unseen runs with the effect over that without, geometric mean over runs
EARNS_STROKE = 0.0005  #: and at least this share of the stroke: less is noise
AGREE_RATIO = 0.5  #: span of an effect's value over the folds, over its median: a bench has one value
AGREE_SPAN = 0.05  #: or over the span that physics leaves it, if that is more
NOTHING_STROKE = 0.002  #: a held-out error below this share of the stroke is that of the position sensor
RULES = Rules(
    probable=0.8,  # of five new runs four are better with what is added
    margin=-log(EARNS_RATIO),
    worst_rise=log(1.03),
)
_RACE_EVALUATIONS = 15
_FINAL_EVALUATIONS = 60
_LEAST_m = 1e-9

#: A fold: runs to fit, runs to judge.
Fold = tuple[tuple[Run, ...], tuple[Run, ...]]


@dataclass(frozen=True)
class Outcome:
    """One competitor in a choice, in metres and beside the plain model."""

    trial: Trial
    plain_m: tuple[float, ...]  #: of the plain model on each run, fitted on the others

    @property
    def effects(self) -> tuple[ForwardCandidate, ...]:
        """Its effects."""
        return self.trial.candidates

    @property
    def fits(self) -> tuple[ForwardFit, ...]:
        """The fit of each fold."""
        return self.trial.fit

    @property
    def held_out_m(self) -> tuple[float, ...]:
        """RMS on each run, fitted on the others of the choice."""
        return tuple(float(e) for e in np.exp(self.trial.losses))

    @property
    def ratio(self) -> float:
        """Geometric mean over runs, against the plain model."""
        return _mean(self.held_out_m) / _mean(self.plain_m)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its effects."""
        return self.trial.names

    @property
    def on_a_new_run(self) -> NextFall:
        """What it will take off the logarithm of the plain model's RMS on a run that nobody has seen."""
        return next_fall(_losses(self.plain_m), self.trial.losses)

    @property
    def verdict(self) -> str:
        """Why it did not earn its place; empty if it did."""
        return self.trial.refusal

    @property
    def earns(self) -> bool:
        """Whether it may be chosen."""
        return not self.trial.refusal

    @property
    def values(self) -> dict[str, list[float]]:
        """Its values in each fold."""
        return {f.name: [float(found.wire.value(f.name)) for found in self.fits] for c in self.effects for f in c.free}


@dataclass(frozen=True)
class Choice:
    """What some runs, among themselves, ask for."""

    runs: tuple[Run, ...]
    folds: tuple[Fold, ...]
    heats: dict[str, tuple[float, ...]]  #: held-out RMS [m] of the plain model for each voltage
    plain: Outcome
    entries: tuple[Outcome, ...]  #: all that competed, best first
    winner: Outcome  #: the plain model if none earned it
    alike: tuple[Outcome, ...]  #: others that earn it and are as good within a standard error
    fitted_plain: ForwardFit  #: on all of ``runs``
    fitted: ForwardFit  #: with the winner's effects
    fitted_heats: dict[str, ForwardFit]  #: the plain model for each voltage
    fitted_rigid: ForwardFit  #: the plain model without thermal expansion

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
class ForwardTracing:
    """All that was found."""

    choice: Choice  #: on all the runs that were given to fit
    judgements: tuple[Judgement, ...]  #: one for ``--judge``, else one for each run
    named: tuple[ForwardCandidate, ...]
    verdict: str  #: none, traced or unexplained
    fitted: ForwardFit  #: on all the runs given to fit, with the named effects
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


def trace_runs(
    wire: ForwardWire,
    runs: Sequence[Run],
    judge: Sequence[Run] = (),
    progress: Progress = lambda what, share: None,
    jobs: int = 1,
    candidates: Sequence[ForwardCandidate] = CANDIDATES,
) -> ForwardTracing:
    """Choose effects on ``runs`` and judge the choice: on ``judge``, or on each run in turn, chosen on the others.

    ``jobs``: fits at a time, by joblib, so that ``joblib.parallel_config("dask")`` around the call spreads them
    over a cluster.
    """
    groups = [tuple(runs)]
    if not judge:
        groups += [tuple(r for r in runs if r is not out) for out in runs]
    choice, *others = _choose(wire, groups, candidates, progress, jobs)
    if judge:
        judgements: tuple[Judgement, ...] = (_judged(choice, tuple(judge)),)
    else:
        judgements = tuple(_judged(c, (out,)) for c, out in zip(others, runs, strict=True))
    found = ForwardTracing(choice, judgements, (), "unexplained", choice.fitted_plain, repeats([*runs, *judge]))
    named = tuple(c for c in choice.winner.effects if found.chosen_in(c.name) > 0.5)
    if named and found.falls:
        fitted = choice.fitted
        if len(named) < len(choice.winner.effects):
            names = {c.name for c in named}
            fitted = _fit_all(next(e for e in choice.entries if set(e.names) == names), choice.runs)
        return replace(found, named=named, verdict="traced", fitted=fitted)
    strokes_m = [run.stroke_m for run in found.judged]
    if not choice.winner.effects and np.mean(np.divide(found.before_m, strokes_m)) < NOTHING_STROKE:
        return replace(found, verdict="none")
    return found


def _judged(choice: Choice, judged: tuple[Run, ...]) -> Judgement:
    def on(found: ForwardFit) -> tuple[float, ...]:
        return tuple(_rms(found, run) for run in judged)

    heats = {name: on(f) for name, f in choice.fitted_heats.items()}
    return Judgement(choice, judged, on(choice.fitted_plain), on(choice.fitted), heats, on(choice.fitted_rigid))


def _choose(
    wire: ForwardWire,
    groups: Sequence[tuple[Run, ...]],
    candidates: Sequence[ForwardCandidate],
    progress: Progress,
    jobs: int,
) -> list[Choice]:
    """What each group of runs chooses; the groups go side by side."""
    every = [tuple((tuple(r for r in group if r is not out), (out,)) for out in group) for group in groups]
    variants = {heats: wire.with_values({"drive.heats": heats}) for heats in ("rms", "mean")}
    plain_calls = [(_fit_plain, (variant, folds)) for folds in every for variant in variants.values()]
    fitted = list(_counted(jobs, plain_calls, "plain model", progress))
    plains, heats = [], []
    for i, folds in enumerate(every):
        fits = dict(zip(variants, fitted[len(variants) * i :], strict=False))
        heats.append({name: _held_out(f, folds) for name, f in fits.items()})
        best = min(variants, key=lambda name: _mean(heats[i][name]))
        plains.append(Outcome(Trial((), _losses(heats[i][best]), tuple(fits[best])), heats[i][best]))
    works = [_Work(plain, folds) for plain, folds in zip(plains, every, strict=True)]
    selections = [select(candidates, plain.trial.losses, RULES, together=_together) for plain in plains]
    selected = run(selections, works, jobs, partial(progress, "effects"))
    ranked = [_ranked(s, plain) for s, plain in zip(selected, plains, strict=True)]
    end_calls = [(_finish, (wire, group, plains[i], ranked[i])) for i, group in enumerate(groups)]
    ends = list(_counted(jobs, end_calls, "last fits", progress))
    out = []
    for i, (place, fitted_heats, rigid, found) in enumerate(ends):
        winner = ranked[i][place] if place is not None else plains[i]
        alternatives = selected[i].alternatives if place == 0 else ()
        alike = tuple(Outcome(t, plains[i].plain_m) for t in alternatives if len(t.names) <= len(winner.names))
        plain_fit = fitted_heats[plains[i].fits[0].wire.drive.heats]
        entries = sorted((Outcome(t, plains[i].plain_m) for t in selected[i].trials), key=lambda e: e.ratio)
        out.append(
            Choice(
                runs=groups[i],
                folds=every[i],
                heats=heats[i],
                plain=plains[i],
                entries=tuple(entries),
                winner=winner,
                alike=alike,
                fitted_plain=plain_fit,
                fitted=found or plain_fit,
                fitted_heats=fitted_heats,
                fitted_rigid=rigid,
            )
        )
    return out


def _counted(jobs: int, calls: Sequence[Call], what: str, progress: Progress) -> Iterator:
    with spread(jobs) as do:
        for done, result in enumerate(do(calls), 1):
            progress(what, done / len(calls))
            yield result


def _together(candidates: Sequence[ForwardCandidate]) -> bool:
    """Whether no two of them have a value in common."""
    names = [name for c in candidates for name in c.value_names]
    return len(names) == len(set(names))


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


def _rms(found: ForwardFit, run: Run) -> float:
    return float(np.sqrt(np.mean(residual_m(found.wire, run) ** 2)))


def _held_out(fits: Sequence[ForwardFit], folds: Sequence[Fold]) -> tuple[float, ...]:
    return tuple(_rms(f, run) for f, (_, judged) in zip(fits, folds, strict=True) for run in judged)


def _losses(held_out_m: Sequence[float]) -> np.ndarray:
    return np.log(np.maximum(held_out_m, _LEAST_m))


def _fit_plain(wire: ForwardWire, folds: Sequence[Fold]) -> list[ForwardFit]:
    free = plain_parameters(wire)
    return [fit(wire, free, fitted, plain_starts(free)) for fitted, _ in folds]


@dataclass(frozen=True)
class _Work:
    """Fits effects beside the plain model of one group of runs, fold by fold."""

    plain: Outcome
    folds: tuple[Fold, ...]

    def __call__(self, entry: Entry) -> Trial:
        """The trial of some effects."""
        begun = entry.start.names if entry.start else ()
        bases = entry.start.fit if entry.start else self.plain.fits
        added = [c for c in entry.candidates if c.name not in begun]
        fits = tuple(_fit_with(base, added, runs) for base, (runs, _) in zip(bases, self.folds, strict=True))
        held_out_m = _held_out(fits, self.folds)
        outcome = Outcome(Trial(entry.candidates, _losses(held_out_m), fits), self.plain.plain_m)
        return replace(outcome.trial, objection=self._too_little(held_out_m) or _not_measured(outcome))

    def _too_little(self, held_out_m: Sequence[float]) -> str:
        stroke_m = float(np.mean([run.stroke_m for _, judged in self.folds for run in judged]))
        if np.mean(self.plain.plain_m) - np.mean(held_out_m) < EARNS_STROKE * stroke_m:
            return f"gains less than {EARNS_STROKE:.2%} of the stroke"
        return ""


def _fit_with(base: ForwardFit, added: Sequence[ForwardCandidate], runs: Sequence[Run]) -> ForwardFit:
    """A fit with the candidates' values free as well, from where it was."""
    new = [f for c in added for f in c.free]
    starts = [np.concatenate([base.values, [f.start for f in new]])]
    if len(new) == 2:  # two values bend into one another: try the other side too
        starts.append(np.concatenate([base.values, [0.7 * f.lo + 0.3 * f.hi for f in new]]))
    return fit(base.wire, (*base.free, *new), runs, starts, _RACE_EVALUATIONS)


def _not_measured(outcome: Outcome) -> str:
    for c in outcome.effects:
        for f in c.free:
            values = outcome.values[f.name]
            if any(f.at_bound(v) for v in values):
                return f"{f.name} runs to its bound: {f.lo:g} to {f.hi:g} {f.unit}".rstrip()
            if np.ptp(values) > max(AGREE_RATIO * abs(float(np.median(values))), AGREE_SPAN * (f.hi - f.lo)):
                span = f"{min(values):.3g} to {max(values):.3g} {f.unit}".rstrip()
                return f"{f.name} differs from fold to fold: {span}"
    return ""


def _ranked(selection: Selection, plain: Outcome) -> list[Outcome]:
    """Those that earn it: the winner, those alike, then the others by what they gain."""
    if selection.chosen is None:
        return []
    first = [selection.chosen, *selection.alternatives]
    rest = sorted((t for t in selection.trials if not t.refusal), key=lambda t: -t.gain)
    by_name = {t.names: t for t in [*first, *rest]}
    return [Outcome(t, plain.plain_m) for t in by_name.values()]


def _finish(
    wire: ForwardWire, runs: Sequence[Run], plain: Outcome, ranked: Sequence[Outcome]
) -> tuple[int | None, dict[str, ForwardFit], ForwardFit, ForwardFit | None]:
    """On all runs of a choice: (place of the winner among ``ranked``, plain fits by voltage, without expansion,
    winner's fit)."""
    heats = {}
    for name in ("rms", "mean"):
        variant = wire.with_values({"drive.heats": name})
        free = plain_parameters(variant)
        heats[name] = fit_for_new_runs(variant, free, runs, plain_starts(free), _FINAL_EVALUATIONS)
    best = heats[plain.fits[0].wire.drive.heats]
    cold = best.wire.with_values({"wire.martensite_expansion_1_K": 0.0, "wire.austenite_expansion_1_K": 0.0})
    rigid = fit_for_new_runs(cold, best.free, runs, [best.values, *plain_starts(best.free)[:1]], _FINAL_EVALUATIONS)
    for place, outcome in enumerate(ranked):
        found = _fit_all(outcome, runs)
        # What the last fit drives to a bound of the possible has not been measured after all.
        if not any(f.at_bound(found.wire.value(f.name)) for c in outcome.effects for f in c.free):
            return place, heats, rigid, found
    return None, heats, rigid, None


def _fit_all(outcome: Outcome, runs: Sequence[Run]) -> ForwardFit:
    first = outcome.fits[0]
    return fit_for_new_runs(first.wire, first.free, runs, [f.values for f in outcome.fits], _FINAL_EVALUATIONS)
