"""What was found, as numbers for machines and as sentences for people."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sma_actuator.base.calibration import Calibration
from sma_actuator.base.parameters import declaration_of, to_mapping
from sma_actuator.calibration.expectation import learn
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.effects import EFFECTS, NOT_THE_MODEL, QUANTITIES

from . import why
from .anatomy import anatomy
from .errors import losses
from .evidence import Evidence
from .experiments import best_experiment
from .likeliest import likeliest
from .limits import LIMITS
from .probability import NO_NAMES
from .rows import NOTHING, SOMETHING_ELSE, Rows
from .tracing import Tracing, of_the_model

DRAWS = 1000
UNUSUAL_sigma = 2.0  #: rms deviation of a witness from the calibration above which it is worth a word
LEAST_SAID = 0.02  #: probability from which a name is worth a word
DEPENDS = 0.1  #: share of the residual's mean square from which a dependence is worth naming


def summary(tracing: Tracing, model_file: Path | None = None) -> dict[str, Any]:
    """The report for machines; errors are mean absolute, in % of full stroke, over cycles that the fit had not seen."""
    evidence = tracing.evidence
    weight = np.bincount(np.concatenate(evidence.unit), minlength=evidence.units)  # their samples
    before, after = tracing.before.percent, tracing.after.percent
    left = anatomy(tracing.after.comparison)
    at_first = anatomy(tracing.before.comparison)
    alternatives = _alternatives(tracing)
    goes_with, looks_like = _something_else(tracing)
    out: dict[str, Any] = {
        "verdict": tracing.verdict,
        "sentence": sentence(tracing, left.depends, alternatives) + _trained_first(evidence),
        "effects": _effects(tracing),
        "alternatives": alternatives,
        "names": tracing.names,
        "probable": tracing.probabilities.by_name,
        "something_else_goes_with": goes_with,
        "something_else_looks_like": looks_like,
        "probabilities": [
            {"hypothesis": list(names), "probability": share} for names, share in tracing.probabilities.of.items()
        ],
        "witnesses": _witnesses(tracing),
        "candidates": why.as_numbers(why.whys(tracing)),
        "untestable": [{"name": name, "reason": why} for name, why in tracing.untestable.items()],
        "error_before_pct_stroke": _mean(before, weight),
        "error_before_interval": _interval(before, weight),
        "error_after_pct_stroke": _mean(after, weight),
        "error_after_interval": _interval(after, weight),
        # Every unit weighs the same.
        "unexpected_before_pct_stroke": float(tracing.before.unexpected_percent.mean()),
        "unexpected_after_pct_stroke": float(tracing.after.unexpected_percent.mean()),
        "floor_pct_stroke": evidence.floor_percent,
        "excess_explained": tracing.share,
        "loss_after_over_calibration": _ratio(float(tracing.after.losses.mean()), evidence.expected_loss),
        "floor_from_calibration": bool(evidence.calibration.known),
        "cycles": int(evidence.units),
        "residual_before": _anatomy(at_first),
        "residual_after": _anatomy(left),
        "notes": []
        if len(evidence.logs.sessions) == 1
        else [
            (
                f"these logs are {len(evidence.logs.sessions)} sessions, each where the clock does not go on from the "
                "log before it: of what changes from one to the next only a slip can show, and no drift; where they "
                "are one, let time_s go on from log to log"
            )
        ],
        "model_file": str(model_file) if model_file else None,
        "logs": [t.log.source for t in evidence.logs.experiments],
    }
    return _plain(out)


def probable(report: dict[str, Any]) -> str:
    """The most probable names in a line; empty where none were reckoned."""
    likely = [f"{name} {share:.0%}" for name, share in report["probable"].items() if share >= LEAST_SAID]
    return ", ".join(likely)


def explained(report: dict[str, Any], names: Sequence[str]) -> list[dict[str, Any]]:
    """Of a report's candidates those with these names, behind what was given, or came nearest to it."""
    rows = report["candidates"]
    if not names or not rows:
        return []
    first = rows[0]
    return [
        first,
        *(row for row in rows[1:] if row["effects"] != first["effects"] and set(row["effects"]) & set(names)),
    ]


def sentence(tracing: Tracing, depends: dict[str, float], alternatives: Sequence[dict[str, Any]]) -> str:
    """The verdict as a colleague would say it: what it is, how sure that is, what to do next."""
    of, names = tracing.probabilities.of, _likeliest_first(tracing)
    nothing = of.get((NOTHING,), 0.0)
    if tracing.verdict == "none" or tracing.probabilities.best == (NOTHING,):
        return _nothing(tracing, nothing)
    if tracing.verdict == "traced":
        return _said(tracing, names, alternatives)
    most = [name for name, share in depends.items() if share >= DEPENDS][:3]
    text = "There is an error that no candidate explains"
    text += (
        f"; it still depends on {', '.join(QUANTITIES[name] for name in most)}."
        if most
        else "; it depends on nothing that was looked at."
    )
    goes_with, looks_like = (
        " or ".join(f"{_words(what)} ({share:.0%})" for what, share in some.items() if share >= DEPENDS)
        for some in _something_else(tracing)
    )
    text += f" By its form it goes with {goes_with}." if goes_with else ""
    by_name = tracing.probabilities.by_name
    likely = [n for n, share in by_name.items() if n not in NO_NAMES and share >= LEAST_SAID][: LIMITS.names]
    if tracing.leaves_more and tracing.probabilities.best[0] not in NO_NAMES:
        off, usual = (math.sqrt(squares) for squares in (tracing.after.left, tracing.lets_be_left))
        text += (
            f" The most probable names leave {off:.1f} times what the calibration did, and {usual:.1f} times "
            "is the most that a usual session and their own forms let expect: they are not all of it, or others are"
        )
    elif tracing.probabilities.best[0] in NO_NAMES:
        text += f" It looks like {looks_like}, but has not quite that form." if looks_like else ""
        text += " Something else than any of them is the most probable"
    else:
        text += f" No {LIMITS.names} names together are probable enough"
    shares = _listed([f"{n} {by_name[n]:.0%}" for n in likely])
    text += f"; of the names {shares}." if likely else f"; no name has {LEAST_SAID:.0%}."
    if names:
        text += (
            f" {' and '.join(names)} would take off part of it (that is the error after), and may be the wrong name."
        )
    if tracing.untestable:
        lacking = "; ".join(f"{name} ({why})" for name, why in tracing.untestable.items())
        text += f" It may be what these logs could not have shown: {lacking}."
    return text


def _something_else(tracing: Tracing) -> tuple[dict[str, float], dict[str, float]]:
    """What something else would go with, and which effects it would look like, the most probable first; nothing where
    that was not asked."""
    found = tracing.hypotheses.get((SOMETHING_ELSE,))
    return (dict(found.goes_with), dict(found.looks_like)) if found else ({}, {})


def _words(what: str) -> str:
    """Of smooth errors, what they go with as a person reads it."""
    words = [QUANTITIES[name].split(" [")[0] if name in QUANTITIES else name for name in what.split(" and ")]
    return " and ".join(words).replace("place", "the place of the wire")


def _trained_first(evidence: Evidence) -> str:
    changed = evidence.calibration.training.changed / evidence.full_stroke_m
    if not changed:
        return ""
    return (
        f" The wire changed while it was calibrated: its hot end moved by {changed * 100:.1f} % of full stroke, and "
        "what the model lacks of these logs may be no more than that. Train it first (characterise does, with "
        "--training-cycles), and identify it again."
    )


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


#: What to do next, by the part in which the fault lies.
NEXT = {
    "circuit": "Look at leads, contacts and channels.",
    "load cell": "Calibrate the load cell again.",
    "mechanism": "Look at the crimps and the joint.",
    "reference": "Check the displacement sensor.",
}


def _nothing(tracing: Tracing, share: float) -> str:
    """That nothing is missing, or that these logs do not rule out that something is, or that something is and they do
    not tell what."""
    off = f"{tracing.before.unexpected_percent.mean():.2f} % of full stroke"
    if share >= LIMITS.enough:
        text = (
            f"Nothing is missing, with a probability of {share:.0%}: of the error {off} is not what the calibration "
            "lets expect, and that is usual"
        )
        calibration = tracing.evidence.config.calibration
        if not calibration.known or tracing.before.unexpected_percent.mean() <= calibration.largest_error:
            return f"{text}."
        return (
            f"{text} of a model that is as unsure as this one says it is here; in no log of its calibration was it off "
            f"by more than {calibration.largest_error:.2g} %."
        )
    others = [(n, p) for n, p in tracing.probabilities.by_name.items() if n != NOTHING and p >= LEAST_SAID]
    text = (
        f"Nothing need be missing ({share:.0%}), but these logs do not rule it out"
        if tracing.verdict == "none"
        else f"Something is missing ({1.0 - share:.0%}), but these logs do not tell what"
    )
    text += (
        f": of the error {off} is not what the calibration lets expect, where {tracing.evidence.floor_percent:.2f} % "
        "is usual"
    )
    text += f", and it may be {_listed([f'{n} ({p:.0%})' for n, p in others[: LIMITS.names]])}." if others else "."
    number = tracing.evidence.readings
    return f"{text} They say as much as {number:.0f} readings that share no error; other currents and loads say more."


def _likeliest_first(tracing: Tracing) -> list[str]:
    """Names of what was fitted in the end, the most probable first."""
    fitted = tracing.fit.names if tracing.fit else ()
    return [name for name in tracing.probabilities.by_name if name in fitted]


def _said(tracing: Tracing, names: Sequence[str], alternatives: Sequence[dict[str, Any]]) -> str:
    before, after = (float(e.unexpected_percent.mean()) for e in (tracing.before, tracing.after))
    share = f"{max(1.0 - after / before, 0.0):.0%} of what is unusual in these logs"
    beside, by_name = tracing.beside, tracing.probabilities.by_name
    certain = [n for n in names if n not in beside]
    what = "; and ".join(f"{EFFECTS[n].WORDS} ({n})" for n in certain)
    text = f"{what[0].upper()}{what[1:]}"
    if beside:
        perhaps = ", ".join(f"{n} {by_name[n]:.0%}" for n in beside)
        text += f", and something beside that: {perhaps}. With {_listed([n for n in names if n in beside])} it explains"
        text += f" {share}"
    else:
        text += f": that explains {share}"
    after_it = tracing.after.witnesses
    mended = [
        n
        for n, off in tracing.before.witnesses.items()
        if off > UNUSUAL_sigma and after_it.get(n, off) <= UNUSUAL_sigma
    ]
    text += (
        f", and {_listed(mended)} {'is' if len(mended) == 1 else 'are'} as at the calibration with it."
        if mended
        else "."
    )
    still = [f"{name} ({off:.1f} standard deviations)" for name, off in after_it.items() if off > UNUSUAL_sigma]
    text += f" Still off with it: {_listed(still)}." if still else ""
    if beside:
        text += f" That it has happened has a probability of {min(by_name[n] for n in certain):.0%}."
    else:
        alone = "this alone" if len(names) == 1 else "these together"
        text += f" That it is {alone} has a probability of {tracing.probabilities.of[tracing.probabilities.best]:.0%}"
        among = f"; that it is among {_listed(tracing.names)}, {tracing.probabilities.within(tracing.names):.0%}"
        text += f"{among if alternatives else ''}."
    if alternatives:
        told = dict.fromkeys(a["experiment"]["what"] for a in alternatives if a["experiment"])
        text += f" To tell: {'; or '.join(told)}." if told else ""
    parts = dict.fromkeys(EFFECTS[n].PART for n in names)
    return " ".join([text, *(NEXT[part] for part in parts if part in NEXT), _allowed_for(names)])


def _allowed_for(names: Sequence[str]) -> str:
    """What becomes of the model: it allows for what is in the wire or in what measures its resistance and load."""
    allowed = of_the_model(names)
    left = [n for n in names if n not in allowed]
    if not allowed:
        return "The model is left alone."
    what = " and ".join(allowed) if left else "it" if len(allowed) == 1 else "them"
    return f"The extended model allows for {what}" + (f", and leaves {' and '.join(left)} alone." if left else ".")


def _witnesses(tracing: Tracing) -> list[dict[str, Any]]:
    """How close what was found comes to its signature: each witness, with the share of what was unusual that is
    gone."""
    out = []
    for name, before in tracing.before.witnesses.items():
        after = tracing.after.witnesses.get(name, before)
        explained = 1.0 - (after / before) ** 2 if before > UNUSUAL_sigma else None
        out.append({"name": name, "off_before": before, "off_after": after, "explained": explained})
    return out


def _effects(tracing: Tracing) -> list[dict[str, Any]]:
    if tracing.fit is None or tracing.verdict != "traced":
        return []
    found = tracing.fit
    shares = _shares(tracing)
    out = []
    for name in _likeliest_first(tracing):
        declared = {f.name: declaration_of(f) for f in dataclasses.fields(EFFECTS[name])}  # type: ignore[arg-type]
        out.append(
            {
                "name": name,
                "part": EFFECTS[name].PART,
                "what": EFFECTS[name].WORDS,
                "remedy": EFFECTS[name].REMEDY,
                "parameters": {
                    p: {
                        "what": declared[p].description,
                        "value": value,
                        "unit": declared[p].unit,
                        "interval": list(found.intervals[name].get(p, (value, value))),
                    }
                    for p, value in found.values[name].items()
                },
                "share": shares[name],
                "probability": tracing.probabilities.by_name[name],
                "in_the_model": EFFECTS[name].PART not in NOT_THE_MODEL,
            }
        )
    return out


def _shares(tracing: Tracing) -> dict[str, float]:
    """What each effect takes off the excess loss: of several, what is lost when it alone is left out of the fit."""
    found = tracing.chosen.fitted
    if len(found.candidates) == 1:
        return {found.candidates[0].name: float(tracing.share)}
    evidence = tracing.evidence
    all_, covariance = losses(evidence, found.rows).mean(), Rows(evidence).usual
    lost = {}
    for c in found.candidates:
        others = [x for x in found.candidates if x is not c]
        without = likeliest(evidence, others, covariance, found.values)
        lost[c.name] = max(float(losses(evidence, without.rows).mean() - all_), 0.0)
    total = sum(lost.values()) or 1.0
    return {name: float(x / total * tracing.share) for name, x in lost.items()}


def _alternatives(tracing: Tracing) -> list[dict[str, Any]]:
    """The other names that it may be, and the experiment that would tell each from what is most probable."""
    if tracing.verdict != "traced":
        return []
    out = []
    best = tracing.chosen
    for name, one in tracing.alternatives.items():
        experiment = best_experiment(tracing.evidence, best.fitted.effects, one.fitted.effects)
        out.append(
            {
                "name": name,
                "part": EFFECTS[name].PART,
                "what": EFFECTS[name].WORDS,
                "instead_of": next((n for n in best.names if n not in one.names), best.names[-1]),
                "probability": tracing.probabilities.by_name[name],
                "experiment": experiment
                and {
                    "what": experiment.what,
                    "duration_s": experiment.duration_s,
                    "predicted_difference_m": experiment.difference_m,
                },
            }
        )
    return out


def _anatomy(found) -> dict[str, Any]:
    return {
        "sensor_noise_pct_stroke": found.noise_percent,
        "share_repeating_every_cycle": found.repeats,
        "share_explained_by": dict(list(found.depends.items())[:8]),
    }


def _ratio(a: float, b: float) -> float:
    return a / b if b else math.nan


def _mean(values: np.ndarray, weight: np.ndarray) -> float:
    return float(np.average(values, weights=weight)) if len(values) else math.nan


def _interval(values: np.ndarray, weight: np.ndarray) -> list[float]:
    """95 % interval of the weighted mean, cycles drawn anew."""
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(values), size=(DRAWS, len(values)))
    means = (values[drawn] * weight[drawn]).sum(axis=1) / weight[drawn].sum(axis=1)
    return [float(x) for x in np.percentile(means, (2.5, 97.5))]


def _plain(value: Any) -> Any:
    """Numbers that JSON knows: what is not finite becomes null."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def extended(mapping: dict[str, Any], tracing: Tracing, report: dict[str, Any], when: str) -> dict[str, Any] | None:
    """The model's parameters with what was found in them; None where nothing of it belongs into a model."""
    found = tracing.fit
    if tracing.verdict != "traced" or found is None:
        return None
    names = of_the_model(found.names)
    if not names:
        return None
    out = dict(mapping)
    effects = dict(out.get("effects") or {})
    before, after = report["error_before_pct_stroke"], report["error_after_pct_stroke"]
    logs = ", ".join(Path(t.log.source).name for t in tracing.evidence.logs.experiments)
    for name in names:
        c = next(c for c in found.candidates if c.name == name)
        effects[name] = {**c.fixed, **found.values[name]}
    effects["order"] = [n for n in effects.get("order", []) if n not in names] + names
    share = {e["name"]: e["share"] for e in report["effects"]}
    effects["history"] = list(effects.get("history", [])) + [
        f"{when}{name}, from {logs}: {before:.2f} to {after:.2f} % of full stroke"
        + (f" together with {' and '.join(n for n in found.names if n != name)}" if len(found.names) > 1 else "")
        + f", {share[name]:.0%} of what was in excess"
        for name in names
    ]
    out["effects"] = effects
    if "calibration" in out:
        out["calibration"] = to_mapping(_anew(out, tracing))
    return out


def _anew(mapping: dict[str, Any], tracing: Tracing) -> Calibration:
    """The calibration with what a model with new effects leaves.

    An effect that has come since the calibration changes how large the errors are, and not what residual to expect
    beside it; one that was there already was part of that, which is learned anew from these logs.
    """
    evidence, full_m = tracing.evidence, tracing.evidence.full_stroke_m
    errors = [
        float(np.mean(np.abs(measured_m - p.shown_m))) / full_m * 100
        for measured_m, p in zip(evidence.logs.measured_m, tracing.after.comparison.predictions, strict=True)
    ]
    config = Config.for_tools(mapping)
    known = dataclasses.replace(config.calibration, error=float(np.mean(errors)), largest_error=max(errors))
    if evidence.beyond_floor and known.expectation.known:
        found = [Chain(config).judge(t.signals) for t in evidence.logs.experiments]
        known = dataclasses.replace(known, expectation=learn(evidence.logs.experiments, found, config))
    return known
