"""Coefficients of the whole-range model: heat balance and learned residual together, judged on what they did not see.

The fit is a damped Gauss-Newton (Levenberg-Marquardt) with a robust loss, from a start that a fixed seed gives: the
same logs give the same numbers.  The heat balance's numbers are fitted with the weights, each drawn to what is known
of such wires.  While they are fitted the displacement that the heat balance sees is the measured one.

It is judged three times over by logs left out, by loads and by cycles left out, the weights learned afresh each time.
What is promised is by the first two, as the interval is: cycles left out are like those beside them, and a controller's
are like none.
The intervals are the errors of logs and loads left out over the spread of the learners (normalised conformal
prediction, for every place and branch).  Learners that have seen every log agree more than those that were left some
out, without being right by as much: their spread counts half the way between the two, in ratios.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sma_actuator.calibration.interval import COVERAGE
from sma_actuator.estimation.models.heat_content import APPARENT, LOSS_GROWTH_1_K, NEAR, PLAYS_K, THERMAL
from sma_actuator.estimation.models.whole_range import WholeRangeCoefficients
from sma_actuator.estimation.models.whole_range_kernel import CURVE_TERMS
from sma_actuator.identify.fitters.fitting import at_bound
from sma_actuator.identify.verdict.unseen import Unseen
from sma_actuator.logs.experiments import Experiment

from .cold_wire import ColdWire
from .data import FOLDS, Data
from .heat_balance import LEAST, MOST, NAMES, heat_balance
from .judged import (
    LEARNERS_OF_LOADS,
    LOAD_LEFT_OUT,
    PLACES,
    HeldOut,
    LeftOut,
    WholeRangeFit,
    beside_the_thesis,
    errors_left_out,
    intervals_of,
    regions,
)
from .learner import LEARNERS, Team, physical_curve, terms_of, whitening_of
from .surroundings import Expected, expected

__all__ = ["HeldOut", "WholeRangeFit", "beside_the_thesis", "fit_whole_range", "regions"]
ITERATIONS = 100


def fit_whole_range(
    experiments: Sequence[Experiment],
    config,
    progress: Callable[[float], None] = lambda fraction: None,
) -> WholeRangeFit:
    """Fit to all loads, pulses and partial cycles together.

    ``config``: the bench's parameters.

    Raises IdentificationError where there are fewer than three logs, and in them fewer than three cycles.
    """
    data = Data(experiments, config)
    known, centre, scale = heat_balance(data, lambda share: progress(0.4 * share))
    z = (data.features(known)[data.rows] - centre) / scale
    rooms = expected(z, data, data.thermal_numbers(known)[LOSS_GROWTH_1_K], float(scale[APPARENT]))
    z[:, APPARENT] -= rooms.off_K / scale[APPARENT]
    progress(0.45)
    by_log = errors_left_out(z, data, data.log_fold[data.rows])
    by_load = errors_left_out(z, data, data.load_fold[data.rows], LEARNERS_OF_LOADS)
    by_both = by_log.beside(by_load, LOAD_LEFT_OUT)
    progress(0.6)
    by_cycle = errors_left_out(z, data, data.cycle[data.rows] % FOLDS)
    progress(0.8)
    team = Team(z[data.learned], data.displacement[data.rows[data.learned]], ITERATIONS, data.along_stress)
    coefficients = _coefficients(data, known, z, (centre, scale), team, by_both, rooms)
    progress(1.0)
    rows, error_percent = data.rows[data.measured], np.abs(by_cycle.error[data.measured])
    partial = np.repeat([t.kind == "partial" for t in experiments], data.lengths)[rows]
    held_out = HeldOut(float(error_percent.mean()), regions(data.displacement[rows], partial, error_percent))
    of_log = np.repeat(np.arange(len(experiments)), data.lengths)[rows]
    unseen = Unseen(
        log=of_log,
        load_N=np.array([float(np.nanmean(t.signals.load_N)) for t in experiments])[of_log],
        place_m=data.displacement[rows] * data.percent_m,
        error_percent=np.abs(by_both.error[data.measured]),
        partial=partial,
        what="cycles" if data.cuts_logs else "logs",
    )
    bounds = [
        sentence
        for name, value, least, most in zip(NAMES, known[:NEAR], LEAST[:NEAR], MOST[:NEAR], strict=True)
        if value <= least or value >= most
        for sentence in at_bound(name, value, least, most, "", "these logs do not determine it")
    ]
    return WholeRangeFit(coefficients, held_out, unseen, bounds)


def _coefficients(
    data: Data,
    known: np.ndarray,
    z: np.ndarray,
    scaling: tuple[np.ndarray, np.ndarray],
    team: Team,
    left: LeftOut,
    rooms: Expected,
) -> WholeRangeCoefficients:
    """In metres, rounded to six digits."""
    target, percent_m = data.displacement[data.rows], data.percent_m
    lowest, highest = (float(v) for v in np.percentile(data.displacement, (0.1, 99.9)))
    curve = physical_curve(z[data.learned], target[data.learned], data.along_stress)
    slack = 0.05 * (highest - lowest)
    physical = np.clip(terms_of(z[data.learned])[:, :CURVE_TERMS] @ curve, lowest - slack, highest + slack)
    learned = z[data.learned]
    value, spread = team.values(learned)
    floor = left.floor
    score = np.abs(left.error) / (floor + left.spread)
    heating = data.heating[data.rows].astype(bool)
    # How many times as well as those of the logs left out.
    agree = float(np.sqrt(np.median(left.spread[data.learned]) / np.median(spread)))
    intervals = agree * intervals_of(target + left.error, heating, score, np.linspace(lowest, highest, PLACES))
    linear, hidden, bias, output = team.parts()
    thermal = data.thermal_numbers(known)
    return WholeRangeCoefficients(
        calibrated_length=data.wire.length,
        calibrated_diameter=data.wire.diameter,
        calibrated_form=data.wire.form_text,
        thermal=_six(thermal[:THERMAL]),
        near_surroundings=_six(thermal[THERMAL:]),
        hot_end=_six(data.ends[0] * percent_m),
        cold_end=_six(data.ends[1] * percent_m),
        hot_resistance=_six(data.ends_Ohm[0]),
        cold_resistance=_six(data.ends_Ohm[1]),
        **(_of_cold_wire(data.cold_wire) if data.cold_wire else {}),
        ambient_temperature=float(f"{np.median(data.ambient):.4g}"),
        **_of_surroundings(rooms),
        play_widths_K=PLAYS_K,
        play_widths_Ohm=_six(data.plays_Ohm),
        feature_centre=_six(scaling[0]),
        feature_scale=_six(scaling[1]),
        **_where_learned(learned, scaling),
        curve=_six(curve * percent_m),
        learners=LEARNERS,
        linear=_six(linear * percent_m),
        hidden=_six(hidden),
        bias=_six(bias),
        output=_six(output * percent_m),
        largest_residual=float(f"{2.0 * np.abs(value - physical).max() * percent_m:.4g}"),
        intervals=_six(intervals.ravel()),
        spread_floor=float(f"{floor / agree * percent_m:.4g}"),
        curve_interval=float(f"{np.quantile(np.abs(left.curve_error), COVERAGE) * percent_m:.4g}"),
        stress_range=tuple(float(np.round(v)) for v in data.stress_Pa),
        displacement_range=_six(np.array([lowest, highest]) * percent_m),
        stroke=_six(np.array([lowest, highest]) * percent_m),
    )


def _where_learned(learned: np.ndarray, scaling: tuple[np.ndarray, np.ndarray]) -> dict[str, Any]:
    """Between which features, and how far from those it was learned on what is seen is new."""
    seen = learned * scaling[1] + scaling[0]
    low, high = seen.min(axis=0), seen.max(axis=0)
    tenth = 0.1 * (high - low)
    whitening = whitening_of(learned)
    novelty = np.linalg.norm(learned @ whitening.T, axis=1)
    return {
        "feature_low": _six(low - tenth),
        "feature_high": _six(high + tenth),
        "novelty": _six(whitening[np.tril_indices(len(whitening))]),
        "novelty_edge": float(f"{1.3 * np.quantile(novelty, 0.999):.4g}"),
    }


def _of_surroundings(rooms: Expected) -> dict[str, Any]:
    """What tells of other surroundings."""
    linear, hidden, bias, output = rooms.team.parts()
    return {
        "room_counts": _six(np.array([rooms.counts, rooms.counts_within])),
        "expected_linear": _six(linear),
        "expected_hidden": _six(hidden),
        "expected_bias": _six(bias),
        "expected_output": _six(output),
        "expected_within": _six(rooms.widths.ravel()),
        "expected_floor": float(f"{rooms.floor_K:.4g}"),
    }


def _of_cold_wire(cold: ColdWire) -> dict[str, Any]:
    """Of a wire whose logs show what another load left in it."""
    return {
        "cold_wire": _six(np.array(cold.resistance)),
        "other_loads": _six(np.array(cold.other_loads)),
        "cold_wire_stress": _six(np.array(cold.stress_Pa)),
        "cold_wire_resistance": _six(np.array(cold.resistance_Ohm)),
        "cold_wire_rise": float(f"{cold.rise_K:.3g}"),
    }


def _six(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(f"{v:.6g}") for v in values)
