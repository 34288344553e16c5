"""A tracing in sentences, and in numbers for machines."""

from __future__ import annotations

import numpy as np

from sma_actuator.base.parameters import to_mapping
from sma_actuator.diagnosis.falls import INSIDE

from .fitting import predict
from .race import Choice, ForwardTracing, Outcome
from .runs import IDLE_DUTY, Run
from .wire import ForwardWire

_AFTER_s = 8.0  #: the movement after power off is looked for within this


def power_off_index(run: Run) -> int | None:
    """Step at which the power goes off for good, if the run goes on for a while."""
    powered = np.flatnonzero(run.coarse_duty > IDLE_DUTY)
    if not len(powered) or (len(run.coarse_duty) - powered[-1]) * run.step_s < _AFTER_s:
        return None
    return int(powered[-1]) + 1


def power_off_rise_m(run: Run, position_m: np.ndarray, off: int) -> float:
    """How far the slider still moves in the sense of contraction after the power went off at step ``off``."""
    steps = int(_AFTER_s / run.step_s)
    return float(position_m[off : off + steps].max() - position_m[off - 3 : off].mean())


def standstill_s(run: Run, position_m: np.ndarray, off: int) -> float:
    """How long the slider stays within 0.3 % of the stroke after the power went off at step ``off``."""
    moved = np.abs(position_m[off:] - position_m[off - 3 : off].mean()) > 0.003 * run.stroke_m
    return float(np.argmax(moved) * run.step_s)


def percent(run: Run, error_m: float) -> float:
    """An error in % of the run's stroke."""
    return 100.0 * error_m / run.stroke_m


def sentences(found: ForwardTracing) -> list[str]:
    """What was found, most important first."""
    return [verdict_sentence(found), _errors(found), *_named(found), *_chosen(found), *observations(found)]


def observations(found: ForwardTracing) -> list[str]:
    """What the runs say beside the verdict and the errors."""
    choice = found.choice
    how = ", ".join(run.name for run in found.judged)
    heats = {name: 1e3 * float(np.mean(found.heats_m(name))) for name in ("rms", "mean")}
    other = "mean" if choice.heated_by == "rms" else "rms"
    out = [
        (
            f"The {_voltage(choice.heated_by)} voltage heats the wire: the plain model's error is "
            f"{heats[choice.heated_by]:.2f} mm, "
            f"with the {_voltage(other)} voltage {heats[other]:.2f} mm (mean over {how})."
        )
    ]
    out += still_shows(found)
    after = 1e3 * np.array(found.after_m)
    worst = int(np.argmax(after))
    left = f"{after.min():.2f} to {after.max():.2f} mm" if len(after) > 1 else f"{after[0]:.2f} mm"
    out.append(
        f"Left unexplained: {left} RMS on unseen "
        f"runs{f', most in {found.judged[worst].name}' if len(after) > 1 else ''}."
    )
    fitted = zip(found.fitted.free, found.fitted.values, strict=True)
    bound = [f"{f.name.rpartition('.')[2]} at {v:.4g}" for f, v in fitted if f.at_bound(v)]
    if bound:
        out.append(f"At their bounds, so not measured: {', '.join(bound)}. The wire asks for something else there.")
    return out


def verdict_sentence(found: ForwardTracing) -> str:
    """The verdict in words."""
    if found.verdict == "none":
        return (
            "Nothing is missing: on unseen runs the plain model errs by no more than a position sensor does, and "
            "no effect is chosen."
        )
    if found.verdict == "traced":
        text = f"The model lacks {' and '.join(c.name for c in found.named)}."
        places = {c.name: c.part for c in found.named if c.part in ("mechanism", "sensor", "circuit")}
        for name, place in places.items():
            text += f" {name}: the fault lies in the {place}, not in the alloy's model."
        alike = [" + ".join(names) for names in _alternatives(found)]
        if alike:
            text += f" These runs cannot tell it from {', '.join(alike[:3])}."
        return text
    shows = _shows(found)
    text = "There is an error that no candidate explains on runs it was not chosen on"
    text += f"; the residual still shows {'; '.join(shows)}." if shows else "; it shows nothing that was looked for."
    if found.provisional:
        text += f" Provisional, and maybe the wrong names: {', '.join(found.provisional)}."
    return text


def _alternatives(found: ForwardTracing) -> list[list[str]]:
    """What these runs cannot tell from what is named: as good, and without some of it."""
    mine = {c.name for c in found.named}
    return [list(e.names) for e in found.choice.alike if mine and not mine <= set(e.names)]


def _errors(found: ForwardTracing) -> str:
    """Before and after, as judged on runs that had no part in the choice."""
    before, after = 1e3 * np.array(found.before_m), 1e3 * np.array(found.after_m)
    strokes = np.array([run.stroke_m for run in found.judged])
    share = [float(np.mean(np.divide(e, strokes))) * 100.0 for e in (found.before_m, found.after_m)]
    how = (
        "each run judged once, with what was chosen and fitted on the others"
        if found.nested
        else "judged once, after the choice"
    )
    each = ", ".join(f"{r.name} {b:.3f} → {a:.3f}" for r, b, a in zip(found.judged, before, after, strict=True))
    text = f"Error on unseen runs ({how}): {before.mean():.3f} → {after.mean():.3f} mm RMS, "
    text += f"{share[0]:.2f} → {share[1]:.2f} % of the stroke"
    text += f" ({each} mm)." if len(before) > 1 else "."
    winner = found.choice.winner
    if winner.names:
        one, two = (1e3 * float(np.mean(e.held_out_m)) for e in (found.choice.plain, winner))
        text += (
            f" On the very folds that {' + '.join(winner.names)} was chosen on it is {one:.3f} → {two:.3f} mm, "
            "which is no proof: it was chosen because it does that."
        )
        new = _on_a_new_run(winner)
        text += (
            f" As far as these runs tell, the error on a new one will be {new['interval'][0]:.2f} to "
            f"{new['interval'][1]:.2f} times the plain model's "
            f"({INSIDE:.0%}), smaller with a probability of {new['probability_of_a_smaller_error']:.0%}."
        )
    return text


def _on_a_new_run(winner: Outcome) -> dict:
    """What a run that nobody has seen will show: the error over the plain model's, with a probability of INSIDE."""
    fall = winner.on_a_new_run
    return {
        "probability_of_a_smaller_error": fall.chance,
        "error_over_plain": float(np.exp(-0.5 * (fall.low + fall.high))),
        "interval": [float(np.exp(-fall.high)), float(np.exp(-fall.low))],
        "inside": INSIDE,
    }


def _named(found: ForwardTracing) -> list[str]:
    out = []
    for c in found.named:
        values = ", ".join(
            f"{f.name.partition('.')[2]} {found.fitted.wire.value(f.name):.4g} {f.unit}".strip() for f in c.free
        )
        out.append(f"{c.name}: {c.sentence}; {values}.")
    return out


def _chosen(found: ForwardTracing) -> list[str]:
    choice = found.choice
    word = " + ".join(choice.winner.names) or "nothing"
    if not found.nested:
        return [
            f"Chosen on {', '.join(r.name for r in choice.runs)} alone: {word}, of {len(choice.entries)} competitors."
        ]
    each = ", ".join(
        f"without {j.judged[0].name} {' + '.join(j.choice.winner.names) or 'nothing'}" for j in found.judgements
    )
    return [f"Chosen on all the runs together: {word}, of {len(choice.entries)} competitors; {each}."]


def still_shows(found: ForwardTracing) -> list[str]:
    """What the runs do that the model leaves open."""
    out = _power_off(found)
    for one, two, rms_m in found.repeat_m:
        out.append(
            f"{one} and {two} were driven alike and differ by {1e3 * rms_m:.2f} mm RMS: of that the duty can explain "
            f"nothing."
        )
    return out


def _runs(found: ForwardTracing) -> list[Run]:
    return list({run.name: run for run in (*found.choice.runs, *found.judged)}.values())


def _shows(found: ForwardTracing) -> list[str]:
    """The same, in a few words."""
    out = []
    wire = found.fitted.wire
    for run in _runs(found):
        off = power_off_index(run)
        if off is None:
            continue
        measured, modelled = (1e3 * power_off_rise_m(run, x, off) for x in (run.coarse_position_m, predict(wire, run)))
        if abs(measured - modelled) > 2.0 * run.stroke_m:
            out.append(
                f"a movement the way of contraction after power off of {measured:.2f} mm, in the model "
                f"{max(modelled, 0.0):.2f} mm ({run.name})"
            )
        stands, model_stands = (standstill_s(run, x, off) for x in (run.coarse_position_m, predict(wire, run)))
        if stands - model_stands > 0.25:
            out.append(f"a standstill at power off of {stands:.1f} s, in the model {model_stands:.1f} s ({run.name})")
    out += [f"{1e3 * v:.2f} mm RMS between {a} and {b}, which were driven alike" for a, b, v in found.repeat_m]
    return out


def _voltage(name: str) -> str:
    return {"rms": "RMS", "mean": "mean"}[name]


def _power_off(found: ForwardTracing) -> list[str]:
    rigid = {"wire.martensite_expansion_1_K": 0.0, "wire.austenite_expansion_1_K": 0.0}
    out = []
    for run in _runs(found):
        off = power_off_index(run)
        if off is None:
            continue
        measured = power_off_rise_m(run, run.coarse_position_m, off)
        if measured < 0.002 * run.stroke_m:
            continue
        wires: list[ForwardWire] = [
            found.choice.fitted_plain.wire,
            found.fitted.wire,
            found.fitted.wire.with_values(rigid),
        ]
        plain, full, without = (1e3 * power_off_rise_m(run, predict(w, run), off) for w in wires)
        named = f"with the named effects {full:.2f} mm, and the same " if found.named else ""
        out.append(
            f"{run.name}: after power off the slider still moves {1e3 * measured:.2f} mm the way of contraction; "
            f"the plain model gives {plain:.2f} mm, {named}without "
            f"thermal expansion {without:.2f} mm: the kinetics have no such movement."
        )
        stands, modelled = (standstill_s(run, x, off) for x in (run.coarse_position_m, predict(found.fitted.wire, run)))
        if stands - modelled > 0.25:
            out.append(
                f"{run.name}: before that it stands for {stands:.1f} s, in the model for {modelled:.1f} s: like a dead "
                "band (play or friction), but the runs do not give it one size."
            )
    return out


def summary(found: ForwardTracing) -> dict:
    """The result for machines; ``error_*`` are RMS on runs that had no part in the choice, lengths in metres unless
    named otherwise."""
    judged = found.judged
    names = [run.name for run in judged]
    before, after = np.array(found.before_m), np.array(found.after_m)
    strokes = np.array([run.stroke_m for run in judged])
    return {
        "verdict": found.verdict,
        "sentence": verdict_sentence(found),
        "effects": _effects(found),
        "provisional": list(found.provisional),
        "alternatives": _alternatives(found),
        "error_before_mm": float(1e3 * before.mean()),
        "error_after_mm": float(1e3 * after.mean()),
        "error_before_pct_stroke": float(100.0 * np.mean(before / strokes)),
        "error_after_pct_stroke": float(100.0 * np.mean(after / strokes)),
        "judged": "nested" if found.nested else "given",
        "runs": [
            {
                "run": run.name,
                "stroke_mm": 1e3 * run.stroke_m,
                "error_before_mm": float(1e3 * b),
                "error_after_mm": float(1e3 * a),
                "error_before_pct_stroke": float(percent(run, b)),
                "error_after_pct_stroke": float(percent(run, a)),
                "chosen_and_fitted_on": [r.name for r in j.choice.runs],
                "effects": list(j.choice.winner.names),
            }
            for run, b, a, j in zip(judged, before, after, found.by_run, strict=True)
        ],
        "choice": _choice(found.choice),
        "outer_choices": [_choice(j.choice) for j in found.judgements] if found.nested else [],
        "heated_by": found.choice.heated_by,
        "error_m_by_voltage": {v: dict(zip(names, found.heats_m(v), strict=True)) for v in ("rms", "mean")},
        "error_m_without_thermal_expansion": dict(zip(names, found.rigid_m, strict=True)),
        "fitted": {
            f.name: {"value": float(v), "unit": f.unit, "lo": f.lo, "hi": f.hi, "at_bound": bool(f.at_bound(v))}
            for f, v in zip(found.fitted.free, found.fitted.values, strict=True)
        },
        "wire": to_mapping(found.fitted.wire),
        "repeatability_rms_m": [{"runs": [a, b], "rms_m": v} for a, b, v in found.repeat_m],
        "sentences": sentences(found),
    }


def _effects(found: ForwardTracing) -> list[dict]:
    """What is named; the interval is the span over the folds of the choice."""
    return [
        {
            "name": c.name,
            "part": c.part,
            "says": c.sentence,
            "signature": c.signature,
            "parameters": {
                f.name.partition(".")[2]: {
                    "value": float(found.fitted.wire.value(f.name)),
                    "unit": f.unit,
                    "interval": [min(found.choice.winner.values[f.name]), max(found.choice.winner.values[f.name])],
                }
                for f in c.free
            },
            "confidence": found.chosen_in(c.name),
            "in_the_model": c.part in ("alloy", "heat"),
        }
        for c in found.named
    ]


def _choice(choice: Choice) -> dict:
    """One choice: its errors are those of the folds that it was made on."""
    names = [run.name for run in choice.runs]

    def entry(e: Outcome) -> dict:
        return {
            "effects": list(e.names),
            "leave_one_out_rms_m": dict(zip(names, e.held_out_m, strict=True)),
            "ratio": e.ratio,
            "earns": bool(e.earns),
            "verdict": e.verdict or "earns its parameters",
            "values": e.values,
        }

    return {
        "runs": names,
        "plain": entry(choice.plain) | {"verdict": "the plain model"},
        "winner": entry(choice.winner) if choice.winner.names else None,
        "on_a_new_run": _on_a_new_run(choice.winner) if choice.winner.names else None,
        "alike": [list(e.names) for e in choice.alike],
        "race": [entry(e) for e in choice.entries],
    }
