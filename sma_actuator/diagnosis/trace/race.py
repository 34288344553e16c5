"""What the model lacks in some logs: the effects that compete, and what follows from who wins.

The competition is that of :mod:`sma_actuator.diagnosis.selection`; a unit is a cycle.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sma_actuator.base.one_thread import one_thread
from sma_actuator.base.parameters import declaration_of
from sma_actuator.diagnosis.selection import (
    Entry,
    Progress,
    Round,
    Rules,
    Selection,
    Trial,
    paired,
    run,
    select,
)
from sma_actuator.estimation.effects import EFFECTS, NOT_THE_MODEL, QUANTITIES
from sma_actuator.logs.errors import BenchLogError

from .analysis import BLOCKED, bend, quantities, size
from .candidates import Candidate, candidate, scales_of, untestable
from .evidence import Evidence
from .fitting import Fit, fit, sketch
from .limits import LIMITS
from .witnesses import Prediction


def usual(before: float) -> float:
    """How far off a witness may be that was so far off before."""
    return (
        min(LIMITS.usual_deviation, max(LIMITS.well_deviation, LIMITS.worse * before))
        if before <= LIMITS.usual_deviation
        else max(LIMITS.usual_deviation, LIMITS.left_share * before)
    )


@dataclass(frozen=True, slots=True)
class Held:
    """One thing that a name is held against."""

    what: str  #: a witness, a trend, or LOSS
    found: float  #: what is left of it with the name, on cycles that the fit has not seen …
    most: float  #: … and what may be

    @property
    def refuses(self) -> bool:
        """Whether it speaks against the name."""
        return self.found > self.most


LOSS = "the loss of a cycle"


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
    )  #: bool, shape (units,): cycles some of which were held out in turn; the others are the last block
    losses: dict[str, np.ndarray]  #: held-out loss of every unit, before and after
    errors_percent: dict[str, np.ndarray]  #: mean absolute error of every unit, % of full stroke, before and after
    news_percent: dict[str, np.ndarray]  #: what of that the calibration does not let expect, likewise
    predictions: dict[str, list[Prediction]]  #: before and after
    gate_percent: float  #: how much of these there may be
    expected_loss: float
    share: float  #: of the excess loss that is explained
    witnesses: dict[str, dict[str, float]]  #: how far each is off, before and after (:meth:`Evidence.witnesses`)
    unusual: list[str]  #: those that are not as usual after
    judge: Judge  #: what every name was held against
    singles: dict[str, Trial]  #: of every name that was tried alone
    field: tuple[str, ...]  #: names that could have been given, where it was to be found out which
    beside: tuple[str, float] | None = None  #: a further name that would take off too much, and how much over the gain


@dataclass(frozen=True)
class Work:
    """Fits effects to evidence, for the competition."""

    evidence: Evidence
    train: np.ndarray

    def __call__(self, entry: Entry) -> Trial:
        """The trial of some effects."""
        known = entry.start.fit if entry.start else None
        if entry.sketch:
            return Trial(entry.candidates, sketch(self.evidence, entry.candidates, self.train, known), None)
        fitted = fit(self.evidence, entry.candidates, self.train, known)
        return Trial(entry.candidates, fitted.held_out[self.train], fitted, _objection(fitted))


@dataclass(frozen=True)
class Judge:
    """What is in excess of a log like the calibration's, and when it is gone."""

    evidence: Evidence
    rows: np.ndarray  #: of the model as it is
    losses: np.ndarray  #: its losses, of the cycles that are held out in turn
    expected: float  #: mean loss of a cycle that is like those of the calibration
    news_percent: float  #: what of the error the calibration does not let expect
    train: np.ndarray  #: bool, shape (units,): those cycles
    witnesses: dict[str, float]  #: how far each is off there with the model as it is
    quantities: dict[str, np.ndarray]  #: what a residual may depend on, of every sample compared

    def excess(self, mean_loss: float) -> float:
        """What is lost beyond that."""
        return mean_loss - self.expected

    def share(self, trial: Trial) -> float:
        """Share of the excess that a trial explains."""
        before = self.excess(float(self.losses.mean()))
        return min((float(self.losses.mean()) - float(trial.losses.mean())) / before, 1.0) if before > 0.0 else 0.0

    def clean(self, trial: Trial) -> bool:
        """Whether what remains is like the calibration, in all that it shows: the signature of a name that is right."""
        return not any(held.refuses for held in self.held(trial))

    def settles(self, selection: Selection) -> bool:
        """Whether what was chosen leaves nothing to be looked for."""
        return selection.chosen is not None and selection.unsettled is None and self.clean(selection.chosen)

    @property
    def certain(self) -> bool:
        """Whether a witness says that something happened, however small the error."""
        return self.evidence.knows_its_scatter and max(self.witnesses.values(), default=0.0) > LIMITS.certain_deviation

    def convincing(self, selection: Selection) -> bool:
        """Whether what was chosen is all that there is to what might as well be nothing."""
        trial = selection.chosen
        if trial is None or len(trial.candidates) > 1 or not self.settles(selection):
            return False
        if self.certain:
            return True
        left = float(trial.fit.held_out_news_percent.mean())
        return self.share(trial) >= LIMITS.hint_share and left <= self.evidence.floor_percent

    def unusual(self, trial: Trial) -> list[str]:
        """What is off by more than is usual with a trial's effects, on cycles its fits have not seen."""
        return [held.what for held in self.held(trial) if held.refuses and held.what != LOSS]

    def held(self, trial: Trial) -> list[Held]:
        """All that a trial's effects are held against, on cycles that their fits have not seen."""
        most = max(LIMITS.most_loss * self.expected, LIMITS.most_loss_share * float(self.losses.mean()))
        out = [Held(LOSS, float(trial.losses.mean()), most)]
        if not self.evidence.knows_its_scatter:
            return out
        rows = trial.fit.held_out_rows
        witnesses = self.evidence.witnesses(rows, self.train)
        out += [Held(name, found, usual(self.witnesses[name])) for name, found in witnesses.items()]
        telling = {"time_s", *(c.effect.TELL_TALE for c in trial.candidates)}
        few = self.train.sum() < LIMITS.fewest_for_time
        asked = [n for n in self.quantities if n in telling or self.evidence.expects_what_repeats]
        was = size(self.evidence, self.rows, self.train)
        return out + [self._trend(n, rows, n in telling, was) for n in asked if not (few and n in BLOCKED)]

    def _trend(self, name: str, rows: np.ndarray, telling: bool, was: float) -> Held:
        """How much of what is left of ``was`` still goes with a quantity; ``telling``: one that gives the effect
        away."""
        blocked = name in BLOCKED
        most, share = (
            (LIMITS.trend, LIMITS.trend_share) if telling else (LIMITS.trend_elsewhere, LIMITS.trend_share_elsewhere)
        )
        most = max(most, (LIMITS.trend_share_in_time if blocked else share) * was)
        left = bend(self.evidence, rows, self.quantities[name], self.train, blocked)
        return Held(f"the trend over {QUANTITIES[name]}", left, most)

    def _worth(self, mean_loss: float) -> float:
        """What an effect must at least take off."""
        return max(
            LIMITS.least_of_rest * self.excess(mean_loss),
            LIMITS.least_of_all * self.excess(float(self.losses.mean())),
            1e-9,
        )

    def _most_beside(self, gain: float) -> float:
        """What a second name may take off beside a first that has this gain and leaves nothing unusual.

        As much as it likes where what the model always leaves is not expected: that goes with all kinds of names
        itself.
        """
        return LIMITS.most_beside * gain if self.evidence.expects_what_repeats else math.inf

    @property
    def rules(self) -> Rules:
        """What it takes to be named."""
        return Rules(
            significant=LIMITS.significant,
            decisive=LIMITS.decisive,
            least_gain=self._worth,
            alike=LIMITS.alike,
            alike_if_clean=LIMITS.alike_if_clean,
            tie=LIMITS.tie,
            leaders=LIMITS.leaders,
            sketched=LIMITS.sketched,
            least_beside=0.0 if self.evidence.beyond_floor else LIMITS.least_beside,
            most_beside=self._most_beside,
            no_sign_beside=tuple(name for name, effect in EFFECTS.registered.items() if effect.ROUGH),
            most=LIMITS.most_missing if self.evidence.beyond_floor else LIMITS.most_new,
        )


@one_thread()
def trace(
    evidence: Evidence,
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    jobs: int = 2,
    progress: Progress = lambda what, fraction: None,
    explain: Sequence[str] = (),
) -> Tracing:
    """Find what the model lacks in these logs.

    ``only``: names of the only candidates, fitted together without a race; ``without``: of those left out.
    ``explain``: names that are tried alone, whether they competed or not, to say what speaks for and against them.
    ``jobs``: fits at a time, by joblib, so that ``joblib.parallel_config("dask")`` around the call spreads them over
    a cluster.  Raises BenchLogError where an effect of ``only`` cannot be fitted on these logs.
    """
    field_, reasons = _field(evidence, only, without)
    last = max(1, round(LIMITS.last_block * evidence.units))
    train = np.arange(evidence.units) < evidence.units - last
    predictions = evidence.predict({})
    rows, news = evidence.rows(predictions), evidence.news_percent(predictions)
    judge = Judge(
        evidence,
        rows,
        evidence.losses(rows)[train],
        _expected_loss(evidence),
        float(news.mean()),
        train,
        evidence.witnesses(rows, train),
        quantities(evidence, predictions),
    )
    result = _nothing(evidence, reasons, train, judge)
    result.field = () if only else tuple(c.name for c in field_)
    work = Work(evidence, train)
    if only or judge.certain or judge.news_percent > LIMITS.hint * evidence.floor_percent:
        if only:
            selection = _together(work, field_, judge)
        else:
            contest = select(field_, judge.losses, judge.rules, judge.clean)
            (selection,) = run([contest], [work], jobs, partial(progress, "race"))
        result.singles = _singles(selection)
        if only or judge.news_percent > result.gate_percent or judge.convincing(selection):
            _conclude(result, evidence, selection, judge)
            result.verdict = _verdict(result, selection, judge, asked=bool(only))
    _try(result, work, [name for name in explain if name not in result.singles])
    return result


def _singles(selection: Selection) -> dict[str, Trial]:
    """Of every name that competed alone, how it did."""
    return {t.names[0]: t for t in selection.trials if len(t.names) == 1}


def _try(result: Tracing, work: Work, names: Sequence[str]) -> None:
    """Fit some effects alone, each by itself, where these logs could show it."""
    scales = scales_of(work.evidence)
    result.untestable |= untestable(list(names), scales)
    for name in names:
        if name not in result.untestable:
            trial = work(Entry((candidate(name, scales),), None))
            gain, error = paired(result.judge.losses, trial.losses)
            refusal = result.judge.rules.falls_short(trial, result.judge.losses)
            result.singles[name] = replace(trial, gain=gain, gain_error=error, refusal=refusal)


def _field(evidence: Evidence, only: Sequence[str], without: Sequence[str]) -> tuple[list[Candidate], dict[str, str]]:
    """Who competes, and why others cannot."""
    scales = scales_of(evidence)
    names = [n for n in EFFECTS if (not only or n in only) and n not in without]
    if evidence.beyond_floor and not only:  # what circuit and sensors did at the calibration, it has absorbed
        names = [n for n in names if EFFECTS[n].PART == "wire"]
    reasons = untestable(names, scales)
    if only and reasons:
        raise BenchLogError("; ".join(f"{n} cannot be fitted on these logs: {why}" for n, why in reasons.items()))
    return [candidate(n, scales) for n in names if n not in reasons], reasons


def _nothing(evidence: Evidence, reasons: dict[str, str], train: np.ndarray, judge: Judge) -> Tracing:
    """The result before anything is found."""
    predictions = evidence.predict({})
    losses = evidence.losses(evidence.residual({}))
    errors, news = evidence.errors_percent(predictions), evidence.news_percent(predictions)
    return Tracing(
        verdict="none",
        fit=None,
        rounds=[],
        alternatives={},
        untestable=reasons,
        train=train,
        losses={"before": losses, "after": losses},
        errors_percent={"before": errors, "after": errors},
        news_percent={"before": news, "after": news},
        predictions={"before": predictions, "after": predictions},
        gate_percent=LIMITS.gate * evidence.floor_percent,
        expected_loss=judge.expected,
        share=0.0,
        witnesses={"before": judge.witnesses, "after": judge.witnesses},
        unusual=[],
        judge=judge,
        singles={},
        field=(),
    )


def _together(work: Work, field_: Sequence[Candidate], judge: Judge) -> Selection:
    """All candidates at once, without a race."""
    if not field_:
        return Selection([Round((), [], None)], None)
    trial = work(Entry(tuple(field_), None))
    gain, error = paired(judge.losses, trial.losses)
    trial = replace(trial, gain=gain, gain_error=error)
    return Selection([Round((), [trial], trial)], trial)


def _conclude(result: Tracing, evidence: Evidence, selection: Selection, judge: Judge) -> None:
    """Put what was chosen into the result."""
    result.rounds = selection.rounds
    if selection.chosen is None:
        return
    found: Fit = selection.chosen.fit
    result.fit = found
    result.predictions["after"] = evidence.predict(found.effects)
    result.losses["after"] = found.held_out
    result.errors_percent["after"] = found.held_out_percent
    result.news_percent["after"] = found.held_out_news_percent
    result.share = judge.share(selection.chosen)
    result.witnesses["after"] = evidence.witnesses(found.held_out_rows, result.train)
    result.unusual = judge.unusual(selection.chosen)
    if selection.unsettled is not None:
        (further,) = set(selection.unsettled.names) - set(selection.chosen.names)
        more, _ = paired(selection.chosen.losses, selection.unsettled.losses)
        result.beside = further, more / selection.chosen.gain
    result.alternatives = _alternatives(result.rounds, found)


def _verdict(result: Tracing, selection: Selection, judge: Judge, asked: bool) -> str:
    found = selection.chosen is not None
    if judge.evidence.beyond_floor:  # then every effect that pays counts, and what remains is the model's as it is
        return "traced" if found else "none"
    if judge.settles(selection):
        return "traced"
    real = float(result.news_percent["before"].mean()) > result.gate_percent
    return "unexplained" if real or asked else "none"


def _expected_loss(evidence: Evidence) -> float:
    """Mean loss of a cycle that is like those of the calibration."""
    if evidence.beyond_floor:
        return 0.0
    others = len(evidence.unit_of_row) - evidence.rows_of_samples
    return 0.5 * (float(evidence.independent.mean()) + others / evidence.units)


def _alternatives(rounds: list[Round], current: Fit) -> dict[str, Trial]:
    """Names that would do as well for one of the effects found; the best of them."""
    out: dict[str, Trial] = {}
    for r in rounds:
        for t in r.alternatives:
            others = [n for n in t.names if n not in current.names]
            if len(others) == 1:
                out.setdefault(others[0], t)
    best = sorted(out, key=lambda name: out[name].losses.mean())[: LIMITS.most_names - 1]
    return {name: out[name] for name in out if name in best}


def of_the_model(names: Sequence[str]) -> list[str]:
    """Those of the effects that belong into a model file; the others are named and left alone."""
    return [n for n in names if EFFECTS[n].PART not in NOT_THE_MODEL]


def _objection(found: Fit) -> str:
    """Why a fit may not be chosen, whatever it gains; empty if it may."""
    return "; ".join(_at_its_end(found, *where.split(".")) for where in found.at_bound)


def _at_its_end(found: Fit, name: str, parameter: str) -> str:
    value, (low, high) = found.values[name][parameter], found.intervals[name][parameter]
    effect = EFFECTS[name]
    unit = declaration_of(next(f for f in dataclasses.fields(effect) if f.name == parameter)).unit  # type: ignore[arg-type]
    unit = "" if unit == "1" else f" {unit}"
    if parameter in effect.ESSENTIAL and low <= 0.0 <= high:
        return f"{name}'s {parameter} may as well be nothing ({low:.2g} to {high:.2g}{unit})"
    return f"{name}'s {parameter} comes to {value:.3g}{unit}, the end of what is possible: there it is another effect"
