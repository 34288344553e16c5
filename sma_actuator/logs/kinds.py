"""What a log holds, seen in its data: full cycles, partial cycles, one load after another, many cycles alike.

Which cycles are full is the judgement of :mod:`sma_actuator.logs.cycles`.  A log of several kinds or loads is cut into
stretches of one each.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .bench_log import BenchLog, uncalibrated_resistance_and_current
from .cycles import SAME_LOAD, cycle_numbers, cycles_of, which_are_full
from .errors import BenchLogError
from .experiments import (
    NOT_FITTED,
    Experiment,
    IdentificationError,
    judged_rows,
    make_experiment,
    sessions,
)

#: Kinds of logs that are fitted, which begin the names of their files.
FULL, PARTIAL, LEVELS, MANY, FOLLOWED = "pulses", "partial", "levels", "fatigue", "followed"
#: Currents held one after the other, and setpoints followed by a control law: partial cycles that are never cut, since
#: each stands on those before.
WHOLE = (LEVELS, FOLLOWED)
#: In the metadata of an experiment: how many full cycles its log has beside those that are fitted.
LEFT_OUT = "cycles_left_out"
_WINDOW_s = 1.0  #: over which a load is steady or not
_STEADY_N = 0.02  #: or SAME_LOAD of the load
_STEADY_SHARE = 0.9  #: of the time, with weights; a spring's load moves with the wire
_SHORTEST = 10  #: samples of a stretch
_MOST_CUTS = 3  #: of one log: more, and it is no programme, and is left whole as what most of its cycles are
_ENOUGH = 8  #: full cycles of a stretch that are fitted: they repeat each other, and each costs time
_MANY = 15  #: full cycles in a row of which no fit needs more, where other logs of that load have full cycles too


def with_kinds(experiments: Sequence[Experiment], remembered: bool = False) -> list[Experiment]:
    """Stretches of the experiments, each of one load and one kind of cycles.

    ``remembered``: for a model that knows the wire's past; a stretch then begins where the one before it ended, and
    none of its cycles is left out.
    """
    stretches = [
        stretch
        for experiment in experiments
        for stretch in ([experiment] if experiment.kind in WHOLE else _of_one_load(experiment))
    ]
    seen = [cycles_of(t.displacement_m, t.driven, t.cycle) for t in stretches]
    fulls = which_are_full(seen, [t.mean_stress_Pa for t in stretches])
    out: list[Experiment] = []
    for stretch, full in zip(stretches, fulls, strict=True):
        if stretch.kind == MANY or stretch.kind in WHOLE:
            out.append(stretch if stretch.kind == MANY else dataclasses.replace(stretch, kind=PARTIAL))
            continue
        out += _of_one_kind(stretch, full, 0.0 if remembered else _WINDOW_s)
    load, full = load_numbers(out), np.array([t.kind == FULL for t in out])
    many = full & (np.array([t.cycle[-1] for t in out]) >= _MANY)
    many &= np.isin(load, load[full & ~many])
    out = [dataclasses.replace(t, kind=MANY) if is_one else t for t, is_one in zip(out, many, strict=True)]
    return [_enough(t) if t.kind == FULL and not remembered else t for t in out]


def _enough(experiment: Experiment) -> Experiment:
    """An experiment of full cycles with some of them, spread over the log; the first and the last among them."""
    cycles = int(experiment.cycle[-1])
    if cycles <= _ENOUGH:
        return experiment
    kept = np.unique(np.concatenate(([0], np.round(np.linspace(1, cycles, _ENOUGH)).astype(int))))
    inside = np.isin(experiment.cycle, kept)
    piece = experiment.rows(inside)
    metadata = {**experiment.log.metadata, LEFT_OUT: cycles - _ENOUGH}
    number = np.searchsorted(kept, experiment.cycle[inside])
    return dataclasses.replace(piece, cycle=number, log=dataclasses.replace(piece.log, metadata=metadata))


def make_experiments(logs: Sequence[BenchLog], config: Any, remembered: bool = False) -> list[Experiment]:
    """Traces of the logs that a model is fitted on, each of one load and one kind of cycles.

    ``remembered``: as in :func:`with_kinds`.  Logs of calibration and training are left out, and logs in which the
    current never moves.  Raises IdentificationError where none is left.
    """
    experiments = [judged_rows(t) for log in logs_to_fit(logs) for t in sessions(make_experiment(log, config))]
    if not experiments:
        raise IdentificationError(
            "no log to fit: pulses or partial cycles of a wire with a measured displacement are needed"
        )
    return with_kinds(experiments, remembered)


def usable_logs(logs: Sequence[BenchLog], config: Any, say: Callable[[str], None]) -> list[BenchLog]:
    """Those of the logs to fit that can be used; of the others ``say`` is told; raises what is wrong with the first
    where none can be."""
    kept, errors = [], []
    for log in logs_to_fit(logs):
        try:
            make_experiment(log, config)
            kept.append(log)
        except BenchLogError as error:
            errors.append(error)
    if errors and not kept:
        raise errors[0]
    for each in errors:
        say(f"left out: {each}")
    return kept


def logs_to_fit(logs: Sequence[BenchLog]) -> list[BenchLog]:
    """Those of neither calibration nor training, in which the current moves."""
    return [log for log in logs if log.metadata.get("kind") not in NOT_FITTED and _is_cycled(log)]


def load_numbers(experiments: Sequence[Experiment]) -> np.ndarray:
    """The number of each experiment's load, from the lightest, 0; those within SAME_LOAD of each other have one."""
    stress_Pa = np.array([t.mean_stress_Pa for t in experiments])
    out, number, first = np.zeros(len(stress_Pa), dtype=int), 0, np.inf
    for row in np.argsort(stress_Pa, kind="stable"):
        if stress_Pa[row] > first + SAME_LOAD * max(abs(first), 1e6):
            number, first = number + 1, stress_Pa[row]
        first = min(first, stress_Pa[row])
        out[row] = number
    return out


def _is_cycled(log: BenchLog) -> bool:
    """Whether the current moves by more than a tenth of itself, or nobody can tell."""
    current = uncalibrated_resistance_and_current(log)[1]
    known = current[np.isfinite(current)]
    return not len(known) or float(np.ptp(known)) > 0.1 * float(np.abs(known).max())


def _of_one_load(experiment: Experiment) -> list[Experiment]:
    """An experiment cut where another weight was hung; one whose load moves with the wire is left whole."""
    load_N, time_s = experiment.signals.load_N, experiment.signals.time_s
    if experiment.constant_load or len(load_N) < 2 * _SHORTEST:
        return [experiment]
    width = max(3, round(_WINDOW_s / float(np.median(np.diff(time_s)))))
    if len(load_N) < 2 * width:
        return [experiment]
    windows = np.lib.stride_tricks.sliding_window_view(load_N, width)
    low, high = np.percentile(windows, (10, 90), axis=1)
    steady = high - low <= np.maximum(SAME_LOAD * np.abs(windows.mean(axis=1)), _STEADY_N)
    if steady.mean() < _STEADY_SHARE:
        return [experiment]
    middle = np.concatenate(
        (np.full(width // 2, steady[0]), steady, np.full(len(load_N) - len(steady) - width // 2, steady[-1]))
    )
    edges = np.flatnonzero(np.diff(np.concatenate(([False], middle, [False])).astype(int)))
    runs = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST]
    merged: list[tuple[int, int]] = []
    for a, b in runs:
        mean_N = float(load_N[a:b].mean())
        if merged and abs(float(load_N[slice(*merged[-1])].mean()) - mean_N) <= max(SAME_LOAD * abs(mean_N), _STEADY_N):
            merged[-1] = (merged[-1][0], b)
        else:
            merged.append((a, b))
    return [
        stretch for stretch in (_cut(experiment, a, b, experiment.kind) for a, b in merged) if stretch.cycle[-1] > 0
    ] or [experiment]


def _of_one_kind(experiment: Experiment, full: np.ndarray, rest_s: float) -> list[Experiment]:
    """An experiment cut where full cycles follow partial ones or the other way round.

    A cut keeps so much of the rest before its first cycle, as a log of its own would have it.
    """
    turns = np.flatnonzero(full[1:] != full[:-1]) + 1
    if len(turns) == 0 or len(turns) > _MOST_CUTS:
        return [dataclasses.replace(experiment, kind=FULL if len(full) and full.mean() >= 0.5 else PARTIAL)]
    starts = [0, *(int(np.searchsorted(experiment.cycle, turn + 1)) for turn in turns), len(experiment.cycle)]
    kinds = [FULL if full[k] else PARTIAL for k in (0, *turns)]
    time_s = experiment.signals.time_s
    rest = [int(np.searchsorted(time_s, time_s[start] - rest_s)) for start in starts[1:-1]]
    before = [0, *(max(start, at) for start, at in zip(starts, rest, strict=False))]
    return [_cut(experiment, a, b, kind) for a, b, kind in zip(before, starts[1:], kinds, strict=True)]


def _cut(experiment: Experiment, start: int, stop: int, kind: str) -> Experiment:
    inside = np.zeros(len(experiment.cycle), dtype=bool)
    inside[start:stop] = True
    piece = experiment.rows(inside)
    name = f"{experiment.log.source} ({kind or 'load'} from {piece.signals.time_s[0]:.0f} s)"
    return dataclasses.replace(
        piece,
        kind=kind,
        cycle=cycle_numbers(piece.driven),
        log=dataclasses.replace(piece.log, source=name),
        part_of=experiment.part_of or experiment.log.source,
    )
