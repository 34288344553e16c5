"""Does every fit of tracing find what is there?  A fit that begins at nothing beside one that begins at the truth.

    python benchmarks/fits_from_nothing.py [--physics NAME …] [--models …] [--only EFFECT …] [--json FILE]

Every effect is hidden in a session of each physics, and its own candidate fitted twice: as tracing does, and from
what the bench really did.  The share of the second's gain that the first reaches should be 95 % and more.  A candidate
whose form cannot take the truth (its bounds, or another law) is judged against what its fit makes of it.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from blind_cases import ALLOYS, Case, SESSION_s, _load_for, _session, _signs, calibration, single
from kept import BENCH, MODEL, kept
from rich.console import Console
from rich.table import Table

from sma_actuator.bench.hidden import TWINS
from sma_actuator.bench.hidden.hiding import HiddenBench
from sma_actuator.config import Config
from sma_actuator.console import write_json
from sma_actuator.diagnosis.trace.candidates import Candidate, candidate, untestable
from sma_actuator.diagnosis.trace.evidence import Evidence
from sma_actuator.diagnosis.trace.likeliest import likeliest
from sma_actuator.diagnosis.trace.rows import Rows
from sma_actuator.diagnosis.trace.scales import scales_of
from sma_actuator.estimation.effects.free import Scales
from sma_actuator.identify import identify
from sma_actuator.plant.worlds import HOME, WORLDS

WANTED = 0.95  #: share of the gain of a start at the truth
THESIS, WHOLE_RANGE = "thesis", "whole_range"  #: types of model: the alloy's own, or the one for any wire
LEAST_GAIN = 20.0  #: nats in a whole session, below which there is nothing to be found


@dataclass(frozen=True)
class Found:
    """One effect in one session."""

    effect: str
    physics: str
    alloy: str
    model: str
    load: str
    gain: float  #: nats taken off the session by the fit that begins at nothing
    from_truth: float  #: by the one that begins at the truth

    @property
    def share(self) -> float:
        """Of the gain of a start at the truth."""
        return self.gain / self.from_truth


def truth(case: Case, scales: Scales) -> dict[str, float]:
    """What the candidate's parameters are in a session with one hidden effect, as far as its form knows the twin's."""
    ((name, strength),) = case.hidden.items()
    bench = HiddenBench.from_name(
        case.alloy, seed=case.seed, physics=case.physics, hidden=case.hidden, session_s=SESSION_s
    )
    (twin,) = bench.hidden
    length_m, tau_s = bench.constants.length_m, getattr(twin, "tau_s", 0.0)
    first = getattr(twin, "first", 0.0)
    known: Mapping[str, dict[str, float]] = {
        "lead_resistance": {"resistance": strength},
        "contact_drift": {"resistance": strength, "time_constant": tau_s},
        "voltage_offset": {"offset": strength},
        "reference_self_heating": {"coefficient": strength, "time_constant": tau_s},
        "shunt": {"conductance": strength},
        "sense_resistance": {"change": strength},
        "load_cell_drift": {"offset": strength * first, "rate": strength * (1.0 - first) / SESSION_s},
        "load_cell_gain": {"gain": strength},
        "load_cell_nonlinearity": {"bend": strength},
        "heat_loss": {"change": strength},
        "self_heating": {"temperature_coefficient": strength},
        "ambient_temperature": {"difference": strength},
        "thermal_expansion": {"coefficient": strength, "time_constant": scales.thermal_s},
        "elastic_compliance": {"compliance": strength},
        # The square root of the cycles is twice the form's g, and what scatters goes with the strain.
        "fatigue": {
            "displacement": 0.5 * strength,
            "resistance": 0.5 * strength * getattr(twin, "scatter", 0.0) / length_m,
        },
        "creep": {"compliance": strength, "time_constant": tau_s},
        "minor_loop_memory": {
            "after_heating": strength,
            "after_cooling": strength,
            "fading": 0.15,
            "relaxation_time": tau_s,
        },
        "rate": {"relaxation_time": strength},
        "slip": {"length": strength, "time": getattr(twin, "at_s", 0.0)},
        "backlash": {"width": strength},
        "reference_lag": {"time_constant": strength},
        "reference_gain": {"gain": strength},
        "reference_nonlinearity": _bend(strength, *getattr(twin, "between_m", (0.0, 1.0))),
        "reference_drift": {"rate": strength / SESSION_s},
        "first_pulse_set": {"length": strength},
        "current_feedthrough": {"coupling": strength},
        "channel_delay": {"delay": strength},
        "prior_wear": {
            "displacement": strength,
            "resistance": strength * getattr(twin, "scatter", 0.0) / length_m,
            "cold_share": getattr(twin, "cold_share", 0.4),
        },
    }
    return known[name]


def _bend(middle_m: float, low_m: float, high_m: float) -> dict[str, float]:
    return {"bend": -4.0 * middle_m / (high_m - low_m) ** 2, "low": low_m, "high": high_m}


def _gain(rows: Rows, c: Candidate, known: Mapping[str, dict[str, float]] | None = None) -> float:
    """Nats that a fit takes off what it makes small; ``known``: where it begins."""
    found = likeliest(rows.evidence, [c], rows.usual, known)
    plain = float(np.sum(rows.usual.whiten(rows.plain) ** 2))
    return 0.5 * (plain - found.problem.cost(rows.usual, found.rows, found.u))


def judge(case: Case, config: Config, model: str) -> Found | str:
    """Fit twice; a sentence where these logs could not show the effect."""
    (name,) = case.hidden
    evidence = Evidence(kept(f"session {case}", BENCH, lambda: _session(case)), config)
    scales = scales_of(evidence)
    reasons = untestable([name], scales)
    if reasons:
        return reasons[name]
    c = candidate(name, scales)
    rows, true = Rows(evidence), truth(case, scales)
    starts = {f.name: f.starts or (0.0,) for f in c.free if f.name not in true}
    # What the twin has no number for begins anywhere.
    gains = [
        _gain(rows, c, {name: {**true, **dict(zip(starts, some, strict=True))}})
        for some in itertools.product(*starts.values())
    ]
    gain = _gain(rows, c)
    return Found(name, case.physics, case.alloy, model, case.load, gain, max(gains))


def identified(alloy: str, physics: str, model: str) -> Config:
    """A model of the wire without hidden effects."""
    logs, mapping, _ = calibration(alloy, physics)
    kind = alloy if model == THESIS else model
    return Config.from_mapping(
        kept(f"identified {alloy} {physics} {kind}", MODEL, lambda: identify(logs, mapping, kind).mapping)
    )


def all_found(physics: list[str], models: list[str], names: list[str], say=print) -> list[Found]:
    """Every effect in every physics with every model, alloys and loads in turn."""
    out = []
    for turn, (world, model) in enumerate(itertools.product(physics, models)):
        for position, name in enumerate(TWINS):
            if name not in names:
                continue
            alloy = ALLOYS[(position + turn) % len(ALLOYS)]
            load = _load_for(name, position + turn)
            case = single(name, alloy, 1.0, load, 1000 + position, _signs(name, position + turn), True, world)
            found = judge(case, identified(alloy, world, model), model)
            if isinstance(found, str):
                say(f"{world}, {alloy}, {model}, {name}: {found}")
            elif found.from_truth >= LEAST_GAIN:
                say(f"{world}, {alloy}, {model}, {name}: {found.share:.1%} of {found.from_truth:.0f} nats")
                out.append(found)
    return out


def main() -> int:
    """Print the table; returns 0 where every fit reaches what is wanted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--physics", nargs="*", default=[*WORLDS], metavar="NAME", help=f"default all, {HOME} first")
    parser.add_argument("--models", nargs="*", choices=(THESIS, WHOLE_RANGE), default=(THESIS, WHOLE_RANGE))
    parser.add_argument("--only", nargs="*", choices=list(TWINS), default=list(TWINS), help="these effects alone")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here")
    args = parser.parse_args()
    found = all_found(args.physics, args.models, args.only)
    table = Table(title=f"gain of a fit from nothing over one from the truth, of {len(found)}")
    for header in ("effect", "cases", "least", "in"):
        table.add_column(header, justify="left" if header in ("effect", "in") else "right")
    for name in args.only:
        some = sorted((x for x in found if x.effect == name), key=lambda x: x.share)
        if some:
            worst = some[0]
            table.add_row(
                name,
                str(len(some)),
                f"{worst.share:.1%}",
                f"{worst.physics}, {worst.alloy}, {worst.model}, {worst.load}",
            )
    Console(width=110).print(table)
    short = [x for x in found if x.share < WANTED]
    print(f"{len(found) - len(short)} of {len(found)} reach {WANTED:.0%}")
    write_json(args, [{**x.__dict__, "share": x.share} for x in found])
    return int(bool(short))


if __name__ == "__main__":
    raise SystemExit(main())
