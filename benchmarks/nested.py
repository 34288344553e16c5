"""Laplace's evidence, by which tracing weighs effects, beside nested sampling's, which assumes no form of it.

    pip install dynesty
    python benchmarks/nested.py [--only EFFECT ...] [--physics NAME] [--json FILE]

For each effect a session in which it is hidden; for that effect and the rival that comes nearest to it, the logarithm
of the evidence over that of nothing: by Laplace at the likeliest parameters (Kass and Raftery 1995), and by dynesty
(Speagle 2020) with the same likelihood and what was known before the logs, a normal distribution within what is
possible.  A time at which something happened once stays where the fit has it, by either.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import dynesty
import numpy as np
from blind_cases import ALLOYS, BENCH, _load_for, _session, _signs, single
from blind_trial import THESIS, WHOLE_RANGE
from fits_from_nothing import identified
from kept import kept
from rich.console import Console
from rich.table import Table
from scipy.stats import norm

from sma_actuator.bench.hidden import TWINS
from sma_actuator.console import write_json
from sma_actuator.diagnosis.trace.candidates import candidate, untestable
from sma_actuator.diagnosis.trace.evidence import Evidence
from sma_actuator.diagnosis.trace.likeliest import likeliest
from sma_actuator.diagnosis.trace.problem import Likeliest
from sma_actuator.diagnosis.trace.rows import Rows
from sma_actuator.diagnosis.trace.scales import scales_of
from sma_actuator.plant.worlds import HOME

EFFECTS = ("lead_resistance", "shunt", "creep", "reference_lag", "load_cell_drift")
LIVE_POINTS = 80
SEED = 7


def nested(rows: Rows, found: Likeliest) -> tuple[float, float, int]:
    """Logarithm of the evidence, its standard deviation, and how often the chain ran."""
    each = [_nested(rows, found, none) for none in found.problem.without]
    log_z, deviation = np.array([z for z, _, _ in each]), np.array([d for _, d, _ in each])
    share = np.exp(log_z - np.logaddexp.reduce(log_z))
    mean = float(np.logaddexp.reduce(log_z)) - math.log(len(each))
    return mean, float(np.sqrt(np.sum((share * deviation) ** 2))), sum(calls for _, _, calls in each)


def _nested(rows: Rows, found: Likeliest, none: np.ndarray) -> tuple[float, float, int]:
    """The same where some sizes are nothing."""
    p = found.problem
    some = np.setdiff1d(np.arange(len(p.usual)), none)
    below, above = (norm.cdf(((edge - p.usual) / p.spread)[some]) for edge in (p.low, p.high))

    def from_cube(cube: np.ndarray) -> np.ndarray:
        u = p.usual.copy()
        u[some] += p.spread[some] * norm.ppf(below + cube * (above - below))
        return p.clipped(u)

    def log_likelihood(u: np.ndarray) -> float:
        return rows.usual.log_likelihood(float(np.sum(rows.usual.whiten(p.residual(u)) ** 2)))

    sampler = dynesty.NestedSampler(
        lambda cube: log_likelihood(from_cube(cube)),
        lambda cube: cube,
        len(some),
        nlive=LIVE_POINTS,
        rstate=np.random.default_rng(SEED),
    )
    sampler.run_nested(dlogz=0.1, print_progress=False)
    result = sampler.results
    return float(result.logz[-1]), float(result.logzerr[-1]), int(np.sum(result.ncall))


def compared(effect: str, alloy: str, model: str, physics: str, number: int) -> list[dict] | str:
    """The effect in a session that hides it, and its nearest rival; a sentence where these logs could not show it."""
    case = single(effect, alloy, 1.0, _load_for(effect, number), 1000 + number, _signs(effect, number), True, physics)
    config = identified(alloy, physics, model)
    evidence = Evidence(kept(f"session {case}", BENCH, lambda: _session(case)), config)
    scales, rows = scales_of(evidence), Rows(evidence)
    reasons = untestable(list(TWINS), scales)
    if effect in reasons:
        return reasons[effect]
    nothing = rows.nothing().log_evidence
    fits = {n: likeliest(evidence, [candidate(n, scales)], rows.usual) for n in TWINS if n not in reasons}
    laplace = {name: found.log_evidence(rows.usual) - nothing for name, found in fits.items()}
    rival = max((n for n in laplace if n != effect), key=laplace.__getitem__)
    out = []
    for name in (effect, rival):
        log_z, deviation, calls = nested(rows, fits[name])
        found = {"hidden": effect, "alloy": alloy, "model": model, "physics": physics, "name": name, "calls": calls}
        found |= {"parameters": len(fits[name].u), "laplace": laplace[name]}
        out.append(found | {"nested": log_z - nothing, "deviation": deviation})
    return out


def main() -> int:
    """Print the table; 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", choices=list(TWINS), default=EFFECTS, help="these effects alone")
    parser.add_argument("--physics", default=HOME, metavar="NAME", help="default %(default)s")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here")
    args = parser.parse_args()
    found: list[dict] = []
    for effect in args.only:
        number = list(TWINS).index(effect)
        alloy, model = ALLOYS[number % 2], (THESIS, WHOLE_RANGE)[number // 2 % 2]
        two = compared(effect, alloy, model, args.physics, number)
        said = two if isinstance(two, str) else ", ".join(f"{x['name']} {x['nested']:.2f}" for x in two)
        print(f"{effect}: {said}", flush=True)  # a chain is run some thousand times for each
        found += [] if isinstance(two, str) else two
    table = Table(title="logarithm of the evidence over that of nothing")
    for header in ("hidden", "alloy, model", "effect", "parameters", "Laplace", "nested", "off"):
        table.add_column(header, justify="left" if header in ("hidden", "alloy, model", "effect") else "right")
    for x in found:
        said = f"{x['nested']:.2f} ± {x['deviation']:.2f}"
        off = f"{x['laplace'] - x['nested']:+.2f}"
        words = x["hidden"], f"{x['alloy']}, {x['model']}", x["name"], str(x["parameters"])
        table.add_row(*words, f"{x['laplace']:.2f}", said, off)
    Console(width=120).print(table)
    pairs = list(zip(found[::2], found[1::2], strict=True))
    off = [abs((a["laplace"] - b["laplace"]) - (a["nested"] - b["nested"])) for a, b in pairs]
    print(
        f"odds of the effect against its rival: off by at most a factor {math.exp(max(off)):.2f} (in {len(off)} pairs)"
    )
    write_json(args, found)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
