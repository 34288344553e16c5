"""Any model on any log, beside the measured displacement and beside the baselines."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain, EstimateTrace
from sma_actuator.identify.errors import LogError, log_error
from sma_actuator.identify.fitting import make_data
from sma_actuator.identify.traces import Trace, make_trace, make_traces
from sma_actuator.logs.bench_log import BenchLog

from .baselines import all_baselines


@dataclass(frozen=True, slots=True)
class Replay:
    """One log replayed."""

    trace: Trace
    estimates_m: dict[str, np.ndarray]  #: displacement by every model, shape (n,)
    errors: dict[str, LogError]  #: of every model


def estimate(trace: Trace, config: Config, constant_load_N: float | None = None) -> EstimateTrace:
    """What the node would have estimated; ``constant_load_N``: as if it took the load for constant."""
    signals = trace.signals
    if constant_load_N is not None:
        load_N = np.full(len(trace.log), constant_load_N)
        signals = dataclasses.replace(signals, load_N=load_N, stress_Pa=load_N / config.wire.area_m2)
    return Chain(config).run(signals)


def estimate_m(trace: Trace, config: Config, constant_load_N: float | None = None) -> np.ndarray:
    """The displacement of :func:`estimate`, shape (n,)."""
    return estimate(trace, config, constant_load_N).displacement_m


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
        data = make_data([t for t in make_traces(calibration, first) if t.kind != "fatigue"], full_stroke_m)
        for baseline in all_baselines():
            baseline.fit(data)
            baselines.append(baseline)
            progress(0.8 * len(baselines) / len(all_baselines()))
    out = []
    for i, log in enumerate(logs):
        # Every model with its own calibrations of circuit and load cell, and its own effects on them.
        found = {name: estimate(make_trace(log, config), config) for name, config in models.items()}
        trace = make_trace(log, first).through(next(iter(found.values())))
        estimates = {name: e.displacement_m for name, e in found.items()}
        estimates.update({baseline.name: _where_read(baseline, trace) for baseline in baselines})
        errors = {n: log_error(trace.name, trace.signals, e, range_m, full_stroke_m) for n, e in estimates.items()}
        out.append(Replay(trace, estimates, errors))
        progress(1.0 - 0.2 * (1.0 - (i + 1) / len(logs)))
    return out


def _where_read(baseline, trace: Trace) -> np.ndarray:
    """A baseline's estimate; NaN where a reading is missing."""
    good = np.isfinite(trace.resistance_Ohm + trace.stress_Pa)
    out = np.full(len(good), np.nan)
    out[good] = baseline.predict(trace.rows(good))
    return out


def winners(replays: Sequence[Replay]) -> list[tuple[str, str, str]]:
    """(log, best in the working range, best in the full range)."""
    rows = []
    for r in replays:
        judged = [e for e in r.errors.items() if np.isfinite(e[1].working_percent)]
        best = min(judged, key=lambda e: e[1].working_percent)[0] if judged else "no sample in the working range"
        rows.append((r.trace.name, best, min(r.errors.items(), key=lambda e: e[1].full_percent)[0]))
    return rows
