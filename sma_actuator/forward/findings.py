"""A tracing in sentences, and in numbers for machines."""

from __future__ import annotations

import numpy as np

from ..parameters import to_mapping
from .fitting import predict
from .runs import IDLE_DUTY, Run
from .tracing import EARNS_RATIO, Tracing
from .wire import ForwardWire

_AFTER_S = 8.0  #: the movement after power off is looked for within this


def power_off_index(run: Run) -> int | None:
    """Step at which the power goes off for good, if the run goes on for a while."""
    powered = np.flatnonzero(run.coarse_duty > IDLE_DUTY)
    if not len(powered) or (len(run.coarse_duty) - powered[-1]) * run.step_s < _AFTER_S:
        return None
    return int(powered[-1]) + 1


def power_off_rise_m(run: Run, position_m: np.ndarray) -> float:
    """How far the slider still moves in the sense of contraction after the power went off."""
    off = power_off_index(run)
    steps = int(_AFTER_S / run.step_s)
    return float(position_m[off : off + steps].max() - position_m[off - 3 : off].mean())


def standstill_s(run: Run, position_m: np.ndarray) -> float:
    """How long the slider stays within 0.3 % of the stroke after the power went off."""
    off = power_off_index(run)
    moved = np.abs(position_m[off:] - position_m[off - 3 : off].mean()) > 0.003 * run.stroke_m
    return float(np.argmax(moved) * run.step_s)


def percent(run: Run, error_m: float) -> float:
    """An error in % of the run's stroke."""
    return 100.0 * error_m / run.stroke_m


def sentences(found: Tracing) -> list[str]:
    """What was found, most important first."""
    judged = found.judged
    before = 1e3 * np.array(found.plain.held_out_m)
    after = 1e3 * np.array(found.held_out.held_out_m)
    stroke_mm = 1e3 * float(np.mean([run.stroke_m for run in judged]))
    how = ", ".join(run.name for run in judged)
    heats = {name: 1e3 * float(np.mean(values)) for name, values in found.heats.items()}
    other = "mean" if found.heated_by == "rms" else "rms"
    out = [
        f"The {_voltage(found.heated_by)} voltage heats the wire: held-out error {heats[found.heated_by]:.2f} mm, "
        f"with the {_voltage(other)} voltage {heats[other]:.2f} mm (mean over {how})."
    ]
    if found.chosen:
        names = " and ".join(c.name for c in found.chosen)
        out.append(
            f"Named: {names}. Held-out error {before.mean():.3f} → {after.mean():.3f} mm RMS "
            f"({100 * before.mean() / stroke_mm:.2f} → {100 * after.mean() / stroke_mm:.2f} % of the stroke; "
            f"{100 * (1 - found.left):.0f} % less in the geometric mean over runs)."
        )
        for c, (_, ratio) in zip(found.chosen, found.dropped, strict=True):
            value = found.fitted.wire.value
            values = ", ".join(f"{f.name.partition('.')[2]} {value(f.name):.4g} {f.unit}".strip() for f in c.free)
            out.append(f"{c.name}: {c.sentence}; {values}. Without it the held-out error is {ratio:.2f} times as large.")
    else:
        out.append(
            f"No effect is named: none of {len(found.rounds[0])} competitors earns its parameters on held-out runs. "
            f"The plain model's held-out error is {before.mean():.3f} mm RMS ({100 * before.mean() / stroke_mm:.2f} % of the stroke)."
        )
    mine = {c.name for c in found.chosen}
    rivals = [f"{' + '.join(names)} ({ratio:.2f})" for names, ratio in found.paths if set(names) != mine and ratio < 1.15 * found.left]
    if rivals:
        out.append(
            f"Not far behind, from other starts: {', '.join(rivals)} of the plain error, against {found.left:.2f}. "
            "More runs would have to tell these apart."
        )
    for line in _power_off(found):
        out.append(line)
    for one, two, rms_m in found.repeat_m:
        out.append(f"{one} and {two} were driven alike and differ by {1e3 * rms_m:.2f} mm RMS: of that the duty can explain nothing.")
    refused = next((e for e in found.rounds[-1] if e.ratio <= EARNS_RATIO and not e.earns), None)
    if refused:
        out.append(
            f"Not named, though it would leave {refused.ratio:.2f} of the held-out error: {' + '.join(refused.names)} "
            f"({refused.verdict}). Something that acts like it is still unexplained."
        )
    worst = int(np.argmax(after))
    out.append(f"Left unexplained: {after.min():.2f} to {after.max():.2f} mm RMS on held-out runs, most in {judged[worst].name}.")
    fitted = zip(found.fitted.free, found.fitted.values, strict=True)
    bound = [f"{f.name.rpartition('.')[2]} at {v:.4g}" for f, v in fitted if f.at_bound(v)]
    if bound:
        out.append(f"At their bounds, so not measured: {', '.join(bound)}. The wire asks for something else there.")
    return out


def _voltage(name: str) -> str:
    return {"rms": "RMS", "mean": "mean"}[name]


def _power_off(found: Tracing) -> list[str]:
    rigid = {"wire.martensite_expansion_1_K": 0.0, "wire.austenite_expansion_1_K": 0.0}
    out = []
    for run in {r.name: r for fitted, judged in found.folds for r in (*fitted, *judged)}.values():
        if power_off_index(run) is None:
            continue
        measured = power_off_rise_m(run, run.coarse_position_m)
        if measured < 0.002 * run.stroke_m:
            continue
        wires: list[ForwardWire] = [found.fitted_plain.wire, found.fitted.wire, found.fitted.wire.with_values(rigid)]
        plain, full, without = (1e3 * power_off_rise_m(run, predict(w, run)) for w in wires)
        out.append(
            f"{run.name}: after power off the slider still moves {1e3 * measured:.2f} mm the way of contraction; "
            f"the plain model gives {plain:.2f} mm, with the effects {full:.2f} mm, and the same without "
            f"thermal expansion {without:.2f} mm: the kinetics have no such movement."
        )
        stands, modelled = standstill_s(run, run.coarse_position_m), standstill_s(run, predict(found.fitted.wire, run))
        if stands - modelled > 0.25:
            out.append(
                f"{run.name}: before that it stands for {stands:.1f} s, in the model for {modelled:.1f} s: like a dead band (play or "
                "friction), but the runs do not give it one size."
            )
    return out


def summary(found: Tracing) -> dict:
    """The result for machines; lengths in metres."""
    names = [run.name for run in found.judged]
    entry = lambda e: {  # noqa: E731
        "effects": list(e.names), "held_out_rms_m": dict(zip(names, e.held_out_m, strict=True)), "ratio": e.ratio,
        "earns": bool(e.earns), "verdict": e.verdict or "earns its parameters", "values": e.values,
    }  # fmt: skip
    return {
        "heated_by": found.heated_by,
        "held_out_rms_m_by_voltage": {k: dict(zip(names, v, strict=True)) for k, v in found.heats.items()},
        "held_out_rms_m_without_thermal_expansion": dict(zip(names, found.without_expansion_m, strict=True)),
        "folds": [{"fitted": [r.name for r in fitted], "judged": [r.name for r in judged]} for fitted, judged in found.folds],
        "stroke_m": {run.name: run.stroke_m for run in found.judged},
        "before": entry(found.plain) | {"verdict": "the plain model"},
        "after": entry(found.held_out) | {"verdict": "the plain model and the named effects"},
        "named": [
            {
                "effect": c.name, "says": c.sentence, "place": c.place, "signature": c.signature, "ratio_without": ratio,
                "values": {
                    f.name: {"value": found.fitted.wire.value(f.name), "unit": f.unit, "lo": f.lo, "hi": f.hi} for f in c.free
                },
            }
            for c, (_, ratio) in zip(found.chosen, found.dropped, strict=True)
        ],
        "paths": [{"effects": list(names), "ratio": ratio} for names, ratio in found.paths],
        "rounds": [[entry(e) for e in entries] for entries in found.rounds],
        "fitted": {
            f.name: {"value": float(v), "unit": f.unit, "lo": f.lo, "hi": f.hi, "at_bound": bool(f.at_bound(v))}
            for f, v in zip(found.fitted.free, found.fitted.values, strict=True)
        },
        "wire": to_mapping(found.fitted.wire),
        "repeatability_rms_m": [{"runs": [a, b], "rms_m": v} for a, b, v in found.repeat_m],
        "sentences": sentences(found),
    }  # fmt: skip
