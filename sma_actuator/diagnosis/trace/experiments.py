"""The shortest experiment that would tell two explanations of one log apart, and by how much they then differ.

Each experiment is put together from the log itself (its cold rest, its hot end, one of its cycles);
both explanations, as fitted, are asked what the reference sensor would show.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from sma_actuator.base.signals import Signals
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.effects import Effect

from .anatomy import white_noise
from .evidence import Evidence

ENOUGH_percent = 2.0  #: of full stroke: a difference that nobody overlooks
NOTHING_TELLS = "none of the experiments that were tried would tell them apart"
_PERIOD_s = 0.1


@dataclass(frozen=True, slots=True)
class ProposedExperiment:
    """What to do, how long it takes, and how far apart the two explanations then are."""

    what: str
    duration_s: float
    difference_m: float


def best_experiment(
    evidence: Evidence, first: Mapping[str, Effect], second: Mapping[str, Effect]
) -> ProposedExperiment | None:
    """The shortest experiment in which the two differ by ENOUGH_percent; the one where they differ most if none does,
    and none where that is less than the reference sensor's own noise."""
    chains = [after_the_session(evidence, effects) for effects in (first, second)]
    found = []
    for what, signals in experiments(evidence):
        # What they differ by at the beginning they differ by already: only what moves them apart decides.
        difference_m = float(np.ptp(shown_m(evidence, chains[0], signals) - shown_m(evidence, chains[1], signals)))
        found.append(ProposedExperiment(what, float(np.ptp(signals.time_s)), difference_m))
    enough = [e for e in found if e.difference_m >= ENOUGH_percent / 100 * evidence.full_stroke_m]
    best = min(enough, key=lambda e: e.duration_s) if enough else max(found, key=lambda e: e.difference_m)
    noise_m = max(white_noise(measured_m) for measured_m in evidence.logs.measured_m)
    return best if best.difference_m > noise_m else None


def after_the_session(evidence: Evidence, effects: Mapping[str, Effect]) -> Chain:
    """The chain as the last log leaves it: what creeps has crept, what slipped has slipped."""
    chain = evidence.chain(effects)
    evidence.through(chain)
    return chain


def shown_m(evidence: Evidence, chain: Chain, signals: Signals) -> np.ndarray:
    """What the reference sensor would show in an experiment right after the session."""
    begin_s = float(evidence.logs.experiments[-1].signals.time_s[-1]) + 1.0
    shifted = dataclasses.replace(signals, time_s=signals.time_s - signals.time_s[0] + begin_s)
    chain = copy.deepcopy(chain)
    chain.reset()
    return np.nan_to_num(chain.judge(shifted).shown_m)


def experiments(evidence: Evidence) -> Iterator[tuple[str, Signals]]:
    """(what to do, what the channels would show) of every experiment."""
    experiment = evidence.logs.experiments[-1]
    s = experiment.signals
    cold, hot = _still(evidence, False), _still(evidence, True)
    yield "leave the wire cold at the bias current", _hold(cold, 600.0)
    yield "hold the wire hot", _hold(hot, 120.0)
    for factor in (1.5, 0.67):
        load_N = np.where(np.arange(100) < 50, cold["load_N"], factor * cold["load_N"])
        yield f"change the load of the cold wire to {factor:g} times", _hold(cold, 10.0, load_N=load_N)
    current_A = np.where(np.arange(100) < 50, cold["current_A"], 2.0 * cold["current_A"])
    yield "double the bias current of the cold wire", _hold(cold, 10.0, current_A=current_A)
    cycle = _cycle(evidence, experiment)
    chosen = {
        f.name: np.broadcast_to(getattr(s, f.name), np.shape(s.time_s))[cycle] for f in dataclasses.fields(Signals)
    }
    elapsed_s = chosen["time_s"] - chosen["time_s"][0]
    yield "one cycle, five times as slow", Signals(**{**chosen, "time_s": 5.0 * elapsed_s})
    yield "one cycle, twice as fast", Signals(**{**chosen, "time_s": 0.5 * elapsed_s})
    once_s = elapsed_s[-1] + float(np.median(np.diff(elapsed_s)))
    many = {name: np.tile(values, 30) for name, values in chosen.items()}
    many["time_s"] = np.concatenate([elapsed_s + k * once_s for k in range(30)])
    yield "thirty cycles like the last full one", Signals(**many)


def _still(evidence: Evidence, hot: bool) -> dict[str, float]:
    """What the channels show at rest: at the last rest of the kind, else where the power is lowest or highest."""
    for experiment, rests in zip(reversed(evidence.logs.experiments), reversed(evidence.logs.rests), strict=True):
        for rest in reversed(rests):
            if rest.hot == hot:
                return _mean(experiment.signals, slice(rest.start, rest.stop))
    s = evidence.logs.experiments[-1].signals
    at = int(np.argmax(s.power_W) if hot else np.argmin(s.power_W))
    return _mean(s, slice(at, at + 1))


def _mean(s: Signals, here: slice) -> dict[str, float]:
    return {
        f.name: float(np.mean(getattr(s, f.name)[here])) if np.ndim(getattr(s, f.name)) else getattr(s, f.name)
        for f in dataclasses.fields(Signals)
    }


def _hold(still: dict[str, float], duration_s: float, **changed: np.ndarray) -> Signals:
    n = round(duration_s / _PERIOD_s)
    values = {name: np.full(n, value) for name, value in still.items()}
    values |= changed
    values["time_s"] = np.arange(n) * _PERIOD_s
    values["stress_Pa"] = values["load_N"] * (still["stress_Pa"] / still["load_N"] if still["load_N"] else 0.0)
    values["power_W"] = values["current_A"] ** 2 * values["resistance_Ohm"]
    return Signals(**values)


def _cycle(evidence: Evidence, experiment) -> slice:
    """The samples of the cycle with the largest stroke."""
    cycles = [np.flatnonzero(experiment.cycle == c) for c in np.unique(experiment.cycle)]
    best = max(
        (c for c in cycles if len(c) > 10), key=lambda c: np.ptp(experiment.displacement_m[c]), default=cycles[-1]
    )
    return slice(int(best[0]), int(best[-1]) + 1)
