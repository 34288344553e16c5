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
from .analysis import anatomy
from .evidence import Evidence
from .experiments import best_experiment
from .fitting import Fit, fit
from .limits import LIMITS
from .probability import probabilities
from .race import Tracing, of_the_model, usual

DRAWS = 1000
SELDOM = 0.05  #: share of redrawn cycles on which an alternative does best, below which it does surely less well
LEAST_SAID = 0.02  #: probability from which a name is worth a word
DEPENDS = 0.1  #: share of the residual's mean square from which a dependence is worth naming


def summary(evidence: Evidence, tracing: Tracing, model_file: Path | None = None) -> dict[str, Any]:
    """The report for machines; errors are mean absolute, in % of full stroke, over cycles that the fit had not seen."""
    weight = evidence.samples_of_unit
    before, after = tracing.errors_percent["before"], tracing.errors_percent["after"]
    last = ~tracing.train
    left = anatomy(evidence, tracing.predictions["after"])
    at_first = anatomy(evidence, tracing.predictions["before"])
    alternatives = _alternatives(evidence, tracing)
    found = why.whys(evidence, tracing)
    out: dict[str, Any] = {
        "verdict": tracing.verdict,
        "sentence": sentence(tracing, left.depends, alternatives) + _trained_first(evidence.changed_percent),
        "effects": _effects(evidence, tracing),
        "alternatives": alternatives,
        "witnesses": _witnesses(tracing),
        **_probabilities(evidence, tracing),
        "candidates": why.as_numbers(found),
        "untestable": [{"name": name, "reason": why} for name, why in tracing.untestable.items()],
        "error_before_pct_stroke": _mean(before, weight),
        "error_before_interval": _interval(before, weight),
        "error_after_pct_stroke": _mean(after, weight),
        "error_after_interval": _interval(after, weight),
        "last_block": {
            "cycles": int(last.sum()),
            "error_before_pct_stroke": _mean(before[last], weight[last]),
            "error_after_pct_stroke": _mean(after[last], weight[last]),
        },
        # What the gate is held against: every unit weighs the same.
        "news_before_pct_stroke": float(tracing.news_percent["before"].mean()),
        "news_after_pct_stroke": float(tracing.news_percent["after"].mean()),
        "gate_pct_stroke": tracing.gate_percent,
        "excess_explained": tracing.share,
        "loss_after_over_calibration": _ratio(
            float(tracing.losses["after"][tracing.train].mean()), tracing.expected_loss
        ),
        "floor_from_calibration": bool(evidence.calibration.known),
        "cycles": int(evidence.units),
        "residual_before": _anatomy(at_first),
        "residual_after": _anatomy(left),
        "race": [
            {
                "after": list(r.before),
                "trials": [
                    {
                        "effects": list(t.names),
                        "gain": t.gain,
                        "standard_error": t.gain_error,
                        "parameters": t.fit.parameters,
                        "at_bound": list(t.fit.at_bound),
                    }
                    for t in r.trials
                ],
                "winner": list(r.winner.names) if r.winner else None,
            }
            for r in tracing.rounds
        ],
        "notes": []
        if evidence.logs.one_session or len(evidence.logs.experiments) == 1
        else [
            (
                "the logs do not follow each other on one clock: each counts as a session, and what changes from one "
                "to the next (a slip, a drift) cannot show; where they are one session, let time_s go on from log to "
                "log"
            )
        ],
        "model_file": str(model_file) if model_file else None,
        "logs": [t.log.source for t in evidence.logs.experiments],
    }
    return _plain(out)


def _probabilities(evidence: Evidence, tracing: Tracing) -> dict[str, Any]:
    """How probable every hypothesis is, and what follows from that alone; empty where it is not asked what happened
    since."""
    if evidence.beyond_floor or not evidence.knows_its_scatter or not tracing.field:
        return {"probabilities": [], "probable": {}, "by_probability": None}
    found = probabilities(evidence, tracing.field)
    verdict, names = found.verdict
    return {
        "probabilities": [{"hypothesis": list(some), "probability": share} for some, share in found.of.items()],
        "probable": found.by_name,
        "by_probability": {"verdict": verdict, "effects": names},
    }


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
    if tracing.verdict == "none" and tracing.gate_percent == 0.0:
        return "No candidate takes anything off this error on cycles that it has not seen."
    if tracing.verdict == "none":
        return (
            f"Nothing is missing: of the error {tracing.news_percent['before'].mean():.2f} % of full stroke is not "
            f"what the calibration lets expect, and up to {tracing.gate_percent:.2f} % is usual for these logs."
        )
    names = list(tracing.fit.names) if tracing.fit else []
    if tracing.verdict == "traced":
        return _said(tracing, names, alternatives)
    most = [name for name, share in depends.items() if share >= DEPENDS][:3]
    text = "There is an error that no candidate explains"
    text += (
        f"; it still depends on {', '.join(QUANTITIES[name] for name in most)}."
        if most
        else "; it depends on nothing that was looked at."
    )
    if tracing.beside:
        further, share = tracing.beside
        text += (
            f" {' and '.join(names)} would leave nothing unusual, but {further} beside that would take off {share:.0%} "
            "more: a relative of what is there leaves such a rest, so it may be the wrong name."
        )
    elif names:
        text += f" {' and '.join(names)} would take off part of it (that is the error after), and may be the wrong name"
        text += (
            f": even with it {_listed(tracing.unusual)} would not agree with the calibration."
            if tracing.unusual
            else "."
        )
    if tracing.untestable:
        lacking = "; ".join(f"{name} ({why})" for name, why in tracing.untestable.items())
        text += f" It may be what these logs could not have shown: {lacking}."
    return text


def _trained_first(changed_percent: float) -> str:
    if not changed_percent:
        return ""
    return (
        f" The wire changed while it was calibrated: its hot end moved by {changed_percent:.1f} % of full stroke, and "
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


def _said(tracing: Tracing, names: Sequence[str], alternatives: Sequence[dict[str, Any]]) -> str:
    before, after = (float(tracing.news_percent[w].mean()) for w in ("before", "after"))
    what = "; and ".join(f"{EFFECTS[n].WORDS} ({n})" for n in names)
    text = (
        f"{what[0].upper()}{what[1:]}: that explains {max(1.0 - after / before, 0.0):.0%} of what is unusual in "
        f"these logs"
    )
    mended = [name for name, off in tracing.witnesses["before"].items() if off > LIMITS.usual_deviation]
    text += (
        f", and {_listed(mended)} {'is' if len(mended) == 1 else 'are'} as at the calibration with it."
        if mended
        else "."
    )
    if alternatives:
        text += "".join(_instead(alternatives, name, several=len(names) > 1) for name in names)
        text += " To tell: "
        text += "; or ".join(dict.fromkeys(a["experiment"]["what"] for a in alternatives)) + "."
    elif tracing.rounds:
        text += " Nothing else that was tried does that."
    plain = [name for name, off in tracing.witnesses["before"].items() if off > LIMITS.certain_deviation]
    if before <= tracing.gate_percent and plain:
        text += (
            f" By its size alone ({before:.2f} % of full stroke, where {tracing.gate_percent:.2f} % may be usual) "
            f"it could be nothing; {_listed(plain)} could not."
        )
    elif before <= tracing.gate_percent:
        text += (
            f" It is small: by its size alone ({before:.2f} % of full stroke, where {tracing.gate_percent:.2f} % "
            f"may be usual) it could be nothing."
        )
    parts = dict.fromkeys(EFFECTS[n].PART for n in names)
    return " ".join([text, *(NEXT[part] for part in parts if part in NEXT), _allowed_for(names)])


def _instead(alternatives: Sequence[dict[str, Any]], name: str, several: bool) -> str:
    """What it could be in the place of one name: what does as well, and what does less and leaves nothing unusual
    either."""
    others = [a for a in alternatives if a["instead_of"] == name]
    as_well = " or ".join(a["name"] for a in others if a["confidence"] >= SELDOM)
    less = " or ".join(a["name"] for a in others if a["confidence"] < SELDOM)
    text = ""
    if as_well:
        text += f" Instead of {name} it could as well be {as_well}." if several else f" It could as well be {as_well}."
    if less:
        instead = f" instead of {name}" if several else ""
        text += f" Less well, but leaving nothing unusual either, {less} explains it{instead}."
    return text


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
    for name, before in tracing.witnesses["before"].items():
        after = tracing.witnesses["after"].get(name, before)
        out.append(
            {
                "name": name,
                "off_before": before,
                "off_after": after,
                "usual": usual(before),
                "explained": 1.0 - (after / before) ** 2 if before > LIMITS.usual_deviation else None,
            }
        )
    return out


def _effects(evidence: Evidence, tracing: Tracing) -> list[dict[str, Any]]:
    if tracing.fit is None or tracing.verdict != "traced":
        return []
    found = tracing.fit
    confidence = confidences(tracing)
    shares = _shares(evidence, tracing, found)
    out = []
    for name in found.names:
        declared = {f.name: declaration_of(f) for f in dataclasses.fields(EFFECTS[name])}  # type: ignore[arg-type]
        out.append(
            {
                "name": name,
                "stage": EFFECTS[name].PART,
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
                "confidence": confidence.get(name, 1.0),
                "in_the_model": EFFECTS[name].PART not in NOT_THE_MODEL,
            }
        )
    return out


def _shares(evidence: Evidence, tracing: Tracing, found: Fit) -> dict[str, float]:
    """What each effect takes off the excess loss: what is lost when it alone is left out of the fit."""
    train = tracing.train
    base, all_ = tracing.losses["before"][train].mean(), found.held_out[train].mean()
    if len(found.names) == 1:
        return {found.names[0]: float(tracing.share)}
    lost = {}
    for c in found.candidates:
        others = [x for x in found.candidates if x is not c]
        lost[c.name] = max(fit(evidence, others, train, found).held_out[train].mean() - all_, 0.0)
    total = sum(lost.values()) or 1.0
    scale = float(tracing.share) if base > all_ else 0.0
    return {name: float(x / total * scale) for name, x in lost.items()}


def confidences(tracing: Tracing) -> dict[str, float]:
    """How often each of several explanations that are alike does best when the cycles are drawn anew."""
    out: dict[str, float] = {}
    for r in tracing.rounds:
        alike = [r.winner, *(t for t in tracing.alternatives.values() if t in r.alternatives)] if r.winner else []
        if len(alike) < 2:
            continue
        losses = np.array([t.fit.held_out[tracing.train] for t in alike])
        rng = np.random.default_rng(1)
        drawn = rng.integers(losses.shape[1], size=(DRAWS, losses.shape[1]))
        best = np.argmin(losses[:, drawn].mean(axis=2), axis=0)
        share = np.bincount(best, minlength=len(alike)) / DRAWS
        for t, p in zip(alike, share, strict=True):
            for name in _own(t, alike):
                out[name] = float(p)
    return out


def _own(trial, alike) -> list[str]:
    """The effects of one of several alike that not all of them have."""
    common = set.intersection(*(set(t.names) for t in alike))
    return [n for n in trial.names if n not in common]


def _alternatives(evidence: Evidence, tracing: Tracing) -> list[dict[str, Any]]:
    if tracing.verdict != "traced":
        return []
    confidence = confidences(tracing)
    out = []
    for name, trial in tracing.alternatives.items():
        winner = next(r.winner for r in tracing.rounds if r.winner and trial in r.alternatives)
        experiment = best_experiment(evidence, winner.fit.effects, trial.fit.effects)
        out.append(
            {
                "name": name,
                "stage": EFFECTS[name].PART,
                "what": EFFECTS[name].WORDS,
                "instead_of": next((n for n in winner.names if n not in trial.names), winner.names[-1]),
                "confidence": confidence.get(name, 0.0),
                "why": "on cycles that the fits had not seen the two do as well as each other, or leave nothing "
                "unusual both",
                "experiment": {
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


def extended(
    mapping: dict[str, Any], evidence: Evidence, tracing: Tracing, report: dict[str, Any], when: str
) -> dict[str, Any] | None:
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
    logs = ", ".join(Path(t.log.source).name for t in evidence.logs.experiments)
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
        out["calibration"] = to_mapping(_anew(out, evidence, tracing))
    return out


def _anew(mapping: dict[str, Any], evidence: Evidence, tracing: Tracing) -> Calibration:
    """The calibration with what a model with new effects leaves.

    An effect that has come since the calibration changes how large the errors are, and not what residual to expect
    beside it; one that was there already was part of that, which is learned anew from these logs.
    """
    full_m = evidence.full_stroke_m
    errors = [
        float(np.mean(np.abs(measured_m - p.shown_m))) / full_m * 100
        for measured_m, p in zip(evidence.logs.measured_m, tracing.predictions["after"], strict=True)
    ]
    config = Config.for_tools(mapping)
    known = dataclasses.replace(config.calibration, error=float(np.mean(errors)), largest_error=max(errors))
    if evidence.beyond_floor and known.expectation.known:
        found = [Chain(config).run(t.signals) for t in evidence.logs.experiments]
        known = dataclasses.replace(known, expectation=learn(evidence.logs.experiments, found, config))
    return known
