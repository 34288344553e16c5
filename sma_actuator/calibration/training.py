"""Whether the wire changed while it was measured: what is fitted then is of a wire that is no more.

A wire in its first tens of cycles moves its hot end cycle by cycle.  Logs need not say when they were recorded, but
within a log of pulses one comes after the other, and each ought to do what the one before did, if it is like that: the
first is longer where `characterise` looks for the current that a wire wants.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import scipy  # whose modules are loaded where they are first asked for: half of what a program takes to start

from sma_actuator.logs.bench_log import BenchLog
from sma_actuator.logs.experiments import Experiment, judged_rows, make_experiment
from sma_actuator.logs.kinds import PARTIAL, WHOLE, load_numbers, logs_to_fit

#: Share of the full stroke that the hot end may move with a cycle, outwards, as training does, and inwards, as a wire
#: does also that grows warmer from pulse to pulse; ten logs hold some sixty cycles.
STANDS_OUTWARDS, STANDS_INWARDS = 0.0003, 0.0006
FEWEST_LOGS = 3
_CHANCE = 0.05  #: probability that a wire whose end stands moves so much the same way in all logs (Student)
_ALIKE = 0.1  #: share by which the times may differ that two pulses are heated for
_AS_HOT = 0.01  #: and the currents with which they end: one of the next lower power is another end
_HOT_PART = 0.25  #: of the time driven, at its end
#: Share of the full stroke that a pulse may still move in that part of it: one that a guard held back ends on its way.
_OVER = 0.01


def words_of(change_m: float, full_stroke_m: float) -> str:
    """What to say of such a wire."""
    return (
        "the wire changed while it was measured: its hot end moves with every pulse, always the same way, "
        f"{change_m / full_stroke_m:.1%} of the full stroke in all of these logs together; train it first "
        "(`characterise` does, with --training-cycles), or measure again: these logs are of a wire that is no more"
    )


def change_while_measured_m(logs: Sequence[BenchLog], config) -> float:
    """How far the hot end has moved in all cycles of the logs together; 0 where it stands.

    With a cycle it moves at each load as from pulse to pulse there.
    """
    experiments = [judged_rows(make_experiment(log, config)) for log in logs_to_fit(logs)]
    load = load_numbers(experiments)
    moved_m, change_m = [], 0.0
    for number in np.unique(load):
        here = [t for t, chosen in zip(experiments, load == number, strict=True) if chosen]
        found_m = [m for t in here if t.constant_load for m in _moved_m(t, config.wire.full_stroke_m)]
        moved_m += found_m
        if found_m:
            change_m += float(np.mean(found_m)) * sum(int(t.cycle[-1]) for t in here)
    if len(moved_m) < FEWEST_LOGS:
        return 0.0
    mean_m = float(np.mean(moved_m))
    spread_m = float(np.std(moved_m, ddof=1) / np.sqrt(len(moved_m)))
    by_chance = 2.0 * float(scipy.special.stdtr(len(moved_m) - 1, -abs(mean_m) / max(spread_m, 1e-12)))
    stands = STANDS_OUTWARDS if mean_m > 0.0 else STANDS_INWARDS
    return abs(change_m) if abs(mean_m) >= stands * config.wire.full_stroke_m and by_chance < _CHANCE else 0.0


def _moved_m(experiment: Experiment, full_stroke_m: float) -> list[float]:
    """How far the hot end of a log moves with a pulse that is like the one before; nothing where none is, and of
    partial cycles."""
    # A quick wire goes any way between two readings, so their times tell nothing; a loop's end where it is told.
    if experiment.kind in (PARTIAL, *WHOLE):
        return []
    bounds = np.searchsorted(experiment.cycle, np.arange(1, experiment.cycle[-1] + 2))
    pulses: list[tuple[int, float, float]] = []  # how long it was driven, with which current and where it ended
    for start, stop in itertools.pairwise(bounds):
        driven = start + np.flatnonzero(experiment.driven[start:stop])
        if not len(driven):
            return []
        last = driven[-max(3, round(_HOT_PART * len(driven))) :]
        places_m = experiment.displacement_m[last]
        current_A, end_m = (float(np.median(values)) for values in (experiment.signals.current_A[last], places_m))
        n = len(places_m)
        moves_m = float(np.median(places_m[n // 2 :]) - np.median(places_m[: (n + 1) // 2]))
        pulses.append((len(driven), current_A, end_m if abs(moves_m) < _OVER * full_stroke_m else np.nan))
    moved_m = [
        end_m - before_m
        for (long, before_A, before_m), (heated, current_A, end_m) in itertools.pairwise(pulses)
        if abs(heated - long) <= _ALIKE * 0.5 * (heated + long) + 1.0
        and abs(current_A - before_A) <= _AS_HOT * before_A
        and np.isfinite(end_m - before_m)
    ]
    return [float(np.mean(moved_m))] if moved_m else []
