"""Any model on any log, beside the measured displacement and beside the baselines."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sma_actuator.base.one_thread import one_thread
from sma_actuator.base.signals import Signals, Verdict
from sma_actuator.config import Config
from sma_actuator.estimation.chain import ESTIMATOR_RESET, Chain, Estimates
from sma_actuator.estimation.health import ModelHealth
from sma_actuator.identify.fitters.fitting import make_data
from sma_actuator.identify.verdict.errors import LogError, log_error
from sma_actuator.logs.bench_log import BenchLog, require_reference
from sma_actuator.logs.experiments import Experiment, make_experiment
from sma_actuator.logs.kinds import MANY, make_experiments

from .baselines import all_baselines

#: Errors that differ by less, as a share of themselves or in % of full stroke, tell nobody which model is better.
AS_GOOD, AS_GOOD_percent = 0.02, 0.01
LIVE = "displacement_estimate_m"  #: column of a node's recording: what it had estimated


@dataclass(frozen=True, slots=True)
class Replay:
    """One log replayed."""

    experiment: Experiment
    estimates_m: dict[str, np.ndarray]  #: displacement by every model, shape (n,)
    errors: dict[str, LogError]  #: of every model
    #: Of the first model, where the log holds what the node had estimated: the largest difference from it, and the
    #: number of readings over which.
    from_live_m: float = math.nan
    live_readings: int = 0
    #: Of the first model, % of full stroke, as its calibration has its own: as if surroundings were what they are taken
    #: for, where the node learns from motion what they are.
    judged_percent: float = math.nan


def estimate(experiment: Experiment, config: Config, constant_load_N: float | None = None) -> Estimates:
    """What the node would have estimated; ``constant_load_N``: as if it took the load for constant."""
    signals = experiment.signals
    if constant_load_N is not None:
        load_N = np.full(len(experiment.log), constant_load_N)
        signals = dataclasses.replace(signals, load_N=load_N, stress_Pa=load_N / config.wire.area_m2)
    chain = Chain(config)
    resets_s = [time_s for time_s, event in experiment.log.events if ESTIMATOR_RESET in event]
    bounds = [0, *np.searchsorted(signals.time_s, resets_s), len(signals.time_s)]
    pieces = []
    for start, stop in itertools.pairwise(bounds):
        if start:
            chain.reset()
        pieces.append(chain.run(_part(signals, slice(start, stop))))
    return pieces[0] if len(pieces) == 1 else _together(pieces)


def health(experiment: Experiment, config: Config) -> tuple[Verdict, list[tuple[float, Verdict]]]:
    """What the node would have said of its model's health at the end of a log, and when it changed its mind."""
    judge = ModelHealth(config, config.supply.bias_current)
    changes = judge.run(estimate(experiment, config))
    return judge.verdict, changes


def _part(signals: Signals, chosen: slice) -> Signals:
    fields = {f.name: getattr(signals, f.name) for f in dataclasses.fields(signals)}
    return Signals(**{name: v[chosen] if np.ndim(v) else v for name, v in fields.items()})


def _together(pieces: Sequence[Any]) -> Any:
    """Records of arrays, one after the other; what is one number for all stays it."""
    first = pieces[0]
    if dataclasses.is_dataclass(first):
        names = [f.name for f in dataclasses.fields(first)]
        kind: Any = type(first)
        return kind(**{name: _together([getattr(piece, name) for piece in pieces]) for name in names})
    return np.concatenate(pieces) if np.ndim(first) else first


def estimate_m(experiment: Experiment, config: Config, constant_load_N: float | None = None) -> np.ndarray:
    """The displacement of :func:`estimate`, shape (n,)."""
    return estimate(experiment, config, constant_load_N).displacement_m


@one_thread()
def replay(
    logs: Sequence[BenchLog],
    models: Mapping[str, Config],
    calibration: Sequence[BenchLog] = (),
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[Replay]:
    """Replay every log through every model, and through the baselines where there are ``calibration`` logs.

    The working range is the first model's, for all of them, so that all are judged on the same
    samples.  Raises BenchLogError.
    """
    first = next(iter(models.values()))
    range_m = first.model.build(first.wire).displacement_range_m
    full_stroke_m = first.wire.full_stroke_m
    baselines = []
    if calibration:
        data = make_data([t for t in make_experiments(calibration, first) if t.kind != MANY], full_stroke_m)
        for baseline in all_baselines():
            baseline.fit(data)
            baselines.append(baseline)
            progress(0.8 * len(baselines) / len(all_baselines()))
    out = []
    for i, log in enumerate(logs):
        if LIVE not in log:
            require_reference(log)
        # Every model with its own calibrations of circuit and load cell, and its own effects on them.
        made = {n: make_experiment(log, config, with_reference=False) for n, config in models.items()}
        found = {n: estimate(made[n], config) for n, config in models.items()}
        of_first = next(iter(made.values()))
        experiment = of_first.through(next(iter(found.values())))
        estimates = {name: e.displacement_m for name, e in found.items()}
        estimates.update({baseline.name: _where_read(baseline, experiment) for baseline in baselines})
        errors = {
            n: log_error(
                experiment.name, experiment.signals, np.where(experiment.judged, e, np.nan), range_m, full_stroke_m
            )
            for n, e in estimates.items()
        }
        live = _from_live(experiment, estimates[next(iter(models))])
        out.append(Replay(experiment, estimates, errors, *live, _judged_percent(of_first, first)))
        progress(1.0 - 0.2 * (1.0 - (i + 1) / len(logs)))
    return out


def _judged_percent(experiment: Experiment, config: Config) -> float:
    """The error that a calibration would have of a log."""
    judged = Chain(config).judge(experiment.signals)
    away_m = np.abs(judged.displacement_m - experiment.through(judged).displacement_m)[experiment.judged]
    away_m = away_m[np.isfinite(away_m)]
    return 100.0 * float(away_m.mean()) / config.wire.full_stroke_m if len(away_m) else math.nan


def _from_live(experiment: Experiment, estimate_m: np.ndarray) -> tuple[float, int]:
    """Largest difference from what the node estimated where the wire was driven, and the number of readings."""
    if LIVE not in experiment.log:
        return math.nan, 0
    away_m = np.abs(estimate_m - experiment.log[LIVE])[np.isfinite(experiment.resistance_Ohm)]
    away_m = away_m[np.isfinite(away_m)]
    return (float(away_m.max()), len(away_m)) if len(away_m) else (math.nan, 0)


def _where_read(baseline, experiment: Experiment) -> np.ndarray:
    """A baseline's estimate; NaN where a reading is missing."""
    good = np.isfinite(experiment.resistance_Ohm + experiment.stress_Pa)
    out = np.full(len(good), np.nan)
    out[good] = baseline.predict(experiment.rows(good))
    return out


#: An error within this of what the model had on its own logs is the model's own.
AS_AT_CALIBRATION = 1.5


def verdict(replays: Sequence[Replay], config: Config) -> tuple[str, str]:
    """The verdict on the first model, in a word (as calibrated, changed, not judged) and in a sentence; ``config`` is
    its."""
    name = next(iter(replays[0].errors))
    percents = {r.experiment.name: r.errors[name].full_percent for r in replays}
    errors = {log: percent for log, percent in percents.items() if math.isfinite(percent)}
    if not errors:
        where = "these logs" if len(replays) > 1 else "this log"
        if any(r.experiment.log.has_reference for r in replays):
            return "not judged", f"{name} has no estimate anywhere in {where}; see `sma-actuator check-log`."
        said = f"Nobody measured the displacement in {where}; {name} cannot be judged."
        return "not judged", f"{said} Give a log with a measured displacement."
    mean, worst = float(np.mean(list(errors.values()))), max(errors, key=lambda log: errors[log])
    text = f"{name} errs by {mean:.2f} % of the full stroke"
    if len(errors) > 1:
        text += f" in the mean over {len(errors)} logs, most in {worst} ({errors[worst]:.2f} %)"
    calibrated = config.calibration
    if not calibrated.known:
        return "not judged", text + "; its file does not say how good it was on its own logs."
    largest = max(calibrated.error, calibrated.largest_error)
    own = f"its calibration ({calibrated.error:.2f} %, up to {largest:.2f} % in one log)"
    if errors[worst] <= AS_AT_CALIBRATION * largest:
        return "as calibrated", f"{text}, about as at {own}."
    judged = max(r.judged_percent for r in replays if r.experiment.name in errors)
    if judged <= AS_AT_CALIBRATION * largest:  # false where one is not known
        text += ", by what a node learns from motion of its surroundings; as if they were those of its calibration it"
        return "as calibrated", f"{text} errs by {judged:.2f} % at the most, about as at {own}."
    return (
        "changed",
        (
            f"{text}, where it was {calibrated.error:.2f} % at its calibration: something has changed, or the wire was "
            "driven as it never was there; `sma-actuator trace` says which."
        ),
    )


def winners(replays: Sequence[Replay]) -> list[tuple[str, list[str], list[str]]]:
    """(log, best in the working range, best in the full range); those as good as the best are all named."""
    return [
        (
            r.experiment.name,
            _best({name: error.working_percent for name, error in r.errors.items()}),
            _best({name: error.full_percent for name, error in r.errors.items()}),
        )
        for r in replays
    ]


def _best(errors_percent: Mapping[str, float]) -> list[str]:
    judged = {name: error for name, error in errors_percent.items() if math.isfinite(error)}
    if not judged:
        return []
    least = min(judged.values())
    return [name for name, error in judged.items() if error <= least + max(AS_GOOD * least, AS_GOOD_percent)]
