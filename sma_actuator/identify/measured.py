"""What the logs say of wire and bench beside the model: parameters that then need not be given."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import scipy  # whose modules are loaded where they are first asked for: half of what a program takes to start

from sma_actuator.base.balance import Balance, gains
from sma_actuator.base.jit import jit
from sma_actuator.base.sections import Wire
from sma_actuator.config import BenchConfig
from sma_actuator.derived import LATENT, DENSITY_kg_m3, Derived, SPECIFIC_HEATS_J_kgK, derived, still_air_W_K
from sma_actuator.estimation.branch import BranchDetector, EstimatorParameters
from sma_actuator.estimation.models.heat_content import LATENT_K, usual_heat_balance
from sma_actuator.logs.bench_log import BenchLog, signals_from_log
from sma_actuator.logs.experiments import Experiment, begins_anew

_CONTRACTED = 0.02  #: of the stroke, within which of its shortest a wire is as good as contracted
_ALIKE_LOAD = 0.03  #: of a load, by which another may be less and count as no less
_TRANSFORMS = (
    0.15  #: share of a pause until its least resistance that is left out: another phase begins before it shows
)
_FEWEST = 8  #: samples of a log that say something
_FEWEST_CONTRACTED = 20  #: samples of a log that say how a contracted wire cools: 10 to 16 said thrice the truth
_TIMES_s = (0.05, 60.0)
_CLEAR = 1.2  #: by how much worse a time constant half as long or twice must fit
#: By how much worse a wire must be explained without near surroundings to have them: of eight calibrations in tubes and
#: coatings 1.55 to 24 times, of 24 of bare wires 1.16 at the most.
_SLEEVED = 1.4
#: Of the time constant, below which surroundings follow quicker than anything about a wire can: another fault of it.
_QUICK = 0.3
_MOST_SHARE = 0.9  #: of a wire's rise that near surroundings may take
_MOVES = 0.2  #: of the fast motions of a log: slower ones do not say which way the wire goes
_ALIKE = 0.002  #: share of the moving samples by which two lags may differ and be as good
_UNUSUAL = 2.5  #: factor by which a wire may cool faster or more slowly than in still air
_FLOWS = 0.02  #: share of the largest current above which a current counts as one


def lowest_current_A(logs: Sequence[BenchLog], bench: BenchConfig) -> float:
    """The current that flows when the wire is not heated: what its resistance is measured with; NaN where none is."""
    found = [signals_from_log(log, bench).current_A for log in logs]
    current_A = np.concatenate(found) if found else np.empty(0)
    current_A = current_A[np.isfinite(current_A)]
    flows = current_A[current_A > _FLOWS * np.percentile(current_A, 99.0)] if len(current_A) else current_A
    return float(f"{np.percentile(flows, 5.0):.2g}") if len(flows) else math.nan


def measured(experiments: Sequence[Experiment], mapping: Mapping[str, Any], bench: BenchConfig) -> dict[str, Derived]:
    """Parameters by dotted name that the logs tell, each with how."""
    out: dict[str, Derived] = {}
    balance = heat_balance(experiments, bench)
    if balance is not None and not _may_be(balance, bench.wire):
        balance = None  # the resistance showed something else than cooling
    time_constant_s = None if balance is None else balance.time_constant_s
    if balance is not None:
        seen = f"{balance.time_constant_s:.3g} s, with which the contracted wire is seen to warm and cool"
        capacity_J_K = _heat_capacity(mapping, bench.wire, balance, seen)
        out["thermal.heat_capacity"] = capacity_J_K
        out["thermal.heat_loss"] = Derived(
            float(f"{capacity_J_K.value / balance.time_constant_s:.3g}"), f"heat_capacity over {seen}"
        )
        if balance.near_share > 0.0:
            why = "the contracted wire is seen to warm and cool as one whose surroundings warm up with it"
            out["thermal.near_share"] = Derived(float(f"{balance.near_share:.2g}"), why)
            out["thermal.near_time"] = Derived(float(f"{balance.near_s:.2g}"), why)
    lag_s, right = branch_lag_s(
        experiments, LATENT * (time_constant_s or bench.thermal.heat_capacity / bench.thermal.heat_loss)
    )
    out["estimator.thermal_time_constant"] = Derived(
        lag_s, f"tells heating from cooling in {right:.1%} of the samples in which the wire moves"
    )
    resistance_Ohm = np.concatenate([t.resistance_Ohm for t in experiments])
    least_Ohm, largest_Ohm = np.nanpercentile(resistance_Ohm, (0.5, 99.5))
    out["safety.resistance_min"] = Derived(
        float(f"{0.5 * least_Ohm:.2g}"), f"half of the least measured, {least_Ohm:.3g} Ω"
    )
    out["safety.resistance_max"] = Derived(
        float(f"{2.0 * largest_Ohm:.2g}"), f"twice the largest measured, {largest_Ohm:.3g} Ω"
    )
    ambient_C = np.concatenate([np.atleast_1d(t.signals.ambient_temperature_C) for t in experiments])
    if np.isfinite(ambient_C).any():
        out["thermal.ambient_temperature"] = Derived(float(f"{np.nanmedian(ambient_C):.3g}"), "median of the logs")
    return out


def _may_be(balance: Balance, wire: Wire) -> bool:
    """Whether a wire may warm and cool so: with what such wires hold, and what they lose to still air or unusually."""
    least_s, largest_s = (each / still_air_W_K(wire) for each in _heat_capacities_J_K(wire))
    return least_s / _UNUSUAL < balance.time_constant_s < largest_s * _UNUSUAL


def _heat_capacities_J_K(wire: Wire) -> tuple[float, float]:
    """The least and the largest that such wires have."""
    least, largest = (DENSITY_kg_m3 * wire.volume_m3 * each for each in SPECIFIC_HEATS_J_kgK[wire.alloy])
    return least, largest


def _heat_capacity(mapping: Mapping[str, Any], wire: Wire, balance: Balance, seen: str) -> Derived:
    """Heat capacity [J/K]: the one that was given; else, of those that such wires have, the one with which it loses
    what was given, or what geometry says.

    Logs tell what a wire holds over what it loses.  What it loses to still air geometry tells within a quarter; its
    specific heat nobody within a half.  In surroundings of its own it loses what no geometry tells.
    """
    given = mapping.get("thermal", {})
    if "heat_capacity" in given:
        return Derived(given["heat_capacity"], "given")
    if balance.near_share > 0.0 and "heat_loss" not in given:
        return derived(mapping)["thermal.heat_capacity"]
    loss_W_K = given.get("heat_loss", still_air_W_K(wire))
    capacity_J_K = float(np.clip(loss_W_K * balance.time_constant_s, *_heat_capacities_J_K(wire)))
    least, largest = SPECIFIC_HEATS_J_kgK[wire.alloy]
    return Derived(
        float(f"{capacity_J_K:.3g}"),
        f"{capacity_J_K / (DENSITY_kg_m3 * wire.volume_m3):.0f} J/(kg K): of {least:g} to {largest:g}, which such "
        f"wires have, the one that loses what {'was given' if 'heat_loss' in given else 'geometry says'} in {seen}",
    )


def heat_balance(experiments: Sequence[Experiment], bench: BenchConfig) -> Balance | None:
    """The heat balance that explains best how the contracted wire's resistance moves.

    It rises with the temperature, by as much in all logs, and falls with what is left of the transformation, which the
    displacement shows: R = a + b T + c δ.  None where the logs do not tell.  Near surroundings are found where it is
    explained clearly better by them.
    """
    logs = [each for past in _pasts(experiments) if len((each := _Contracted(past, bench)).rows) >= _FEWEST_CONTRACTED]
    # One that was held part of the way is not contracted where it is shortest: others, loaded as much, are shorter.
    logs = [
        log
        for log in logs
        if log.shortest_m
        <= min(each.shortest_m for each in logs if each.stress_Pa >= (1.0 - _ALIKE_LOAD) * log.stress_Pa)
        + _CONTRACTED * bench.wire.full_stroke_m
    ]
    if not logs:
        return None

    def left(balance: Balance) -> float:
        """Squares of resistance [Ω²] that a balance does not explain."""
        parts = [log.unexplained(balance) for log in logs]
        warmth_J, resistance_Ohm = (np.concatenate(part) for part in zip(*parts, strict=True))
        rise = max(float(warmth_J @ resistance_Ohm), 0.0) / float(warmth_J @ warmth_J)
        return float(np.sum((resistance_Ohm - rise * warmth_J) ** 2))

    def left_alone(log_time: float) -> float:
        return left(Balance(math.exp(log_time)))

    low, high = (math.log(t) for t in _TIMES_s)
    grid = np.linspace(low, high, 40)
    best = grid[int(np.argmin([left_alone(x) for x in grid]))]
    step = grid[1] - grid[0]
    alone = scipy.optimize.minimize_scalar(
        left_alone, bounds=(max(best - step, low), min(best + step, high)), method="bounded"
    )
    found = Balance(math.exp(float(alone.x)))
    near = _with_near_surroundings(found.time_constant_s, left)
    if near.near_s > _QUICK * near.time_constant_s and _SLEEVED * left(near) < left(found):
        found = near
    for factor in (0.5, 2.0):
        if left(found._replace(time_constant_s=factor * found.time_constant_s)) < _CLEAR * left(found):
            return None
    return found


def _with_near_surroundings(alone_s: float, left: Callable[[Balance], float]) -> Balance:
    """The best one with near surroundings, of a wire that would have a time constant without them."""
    starts = itertools.product((0.3, 0.45, 0.65, 1.0), (0.3, 0.6, 0.8), (0.4, 1.0, 2.5, 6.0))
    begins = [Balance(k * alone_s, share, times * k * alone_s) for k, share, times in starts]

    def at(place: np.ndarray) -> Balance:
        own_s, share, near_s = place
        return Balance(math.exp(own_s), _MOST_SHARE / (1.0 + math.exp(-share)), math.exp(near_s))

    best = min(begins, key=left)
    odds = best.near_share / (_MOST_SHARE - best.near_share)
    start = [math.log(best.time_constant_s), math.log(odds), math.log(best.near_s)]
    return at(
        scipy.optimize.minimize(lambda place: left(at(place)), start, method="Nelder-Mead", options={"xatol": 0.01}).x
    )


def _pasts(experiments: Sequence[Experiment]) -> list[list[Experiment]]:
    """Each with the stretches of its log before it: the wire has their heat."""
    pasts: list[list[Experiment]] = []
    for experiment, anew in zip(experiments, begins_anew(experiments), strict=True):
        pasts.append([*([] if anew else pasts[-1]), experiment])
    return pasts


class _Contracted:
    """What the last stretch of a log says of the contracted wire."""

    def __init__(self, stretches: Sequence[Experiment], bench: BenchConfig):
        goods = [t.judged & np.isfinite(t.signals.time_s) for t in stretches]
        self._time_s = np.concatenate([t.signals.time_s[good] for t, good in zip(stretches, goods, strict=True)])
        self._power_W = np.concatenate([t.signals.power_W[good] for t, good in zip(stretches, goods, strict=True)])
        latent_K = usual_heat_balance(bench.thermal, span_Ohm=1.0)[LATENT_K]
        latent_J = []
        for experiment, good in zip(stretches, goods, strict=True):
            displacement_m, resistance_Ohm = experiment.displacement_m[good], experiment.resistance_Ohm[good]
            low_m, high_m = np.percentile(displacement_m, (0.5, 99.5)) if good.any() else (0.0, 1.0)
            martensite = np.clip((displacement_m - low_m) / max(high_m - low_m, 1e-9), 0.0, 1.0)
            latent_J.append(latent_K * bench.thermal.heat_capacity * martensite)
        self._latent_J = np.concatenate(latent_J)
        contracted = displacement_m < low_m + _CONTRACTED * bench.wire.full_stroke_m
        rows = np.flatnonzero(contracted & ~_transforms(contracted, experiment.driven[good], resistance_Ohm))
        #: Samples in which it is, and transforms no further.
        self.rows = len(self._time_s) - len(displacement_m) + rows
        self.shortest_m = low_m
        self.stress_Pa = float(np.median(experiment.stress_Pa[good][rows])) if len(rows) else math.nan
        others = np.column_stack((np.ones(len(rows)), displacement_m[rows] - low_m))
        self._others = np.linalg.qr(others / np.maximum(np.abs(others).max(axis=0, initial=0.0), 1e-30))[0]
        self._resistance_Ohm = self._less_others(resistance_Ohm[rows])

    def unexplained(self, balance: Balance) -> tuple[np.ndarray, np.ndarray]:
        """Warmth [J] by a heat balance, and resistance [Ω], less what displacement and a constant explain of them."""
        warmth_J = np.empty(len(self._time_s))
        _warmth(self._time_s, self._power_W, self._latent_J, *balance, warmth_J)
        return self._less_others(warmth_J[self.rows]), self._resistance_Ohm

    def _less_others(self, values: np.ndarray) -> np.ndarray:
        return values - self._others @ (self._others.T @ values)


def _transforms(contracted: np.ndarray, driven: np.ndarray, resistance_Ohm: np.ndarray) -> np.ndarray:
    """Where the wire cools and its resistance rises again, or is about to, though it stands: another phase comes."""
    out = np.zeros(len(driven), dtype=np.bool_)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], contracted & ~driven, [False])).astype(int)))
    for start, stop in edges.reshape(-1, 2):
        out[start + int((1.0 - _TRANSFORMS) * (int(np.argmin(resistance_Ohm[start:stop])) + 1)) : stop] = True
    return out


@jit
def _warmth(
    time: np.ndarray,
    power: np.ndarray,
    latent: np.ndarray,
    time_constant: float,
    near_share: float,
    near_time: float,
    out: np.ndarray,
) -> None:
    """Heat capacity times what the wire is above its surroundings [J], beginning in balance with its power.

    ``latent``: what it has taken up, of its latent heat, since it was cold, with the other sign.  Exact for power that
    stands from sample to sample: at the mean of both, so that slow sampling makes no lag.
    """
    held, near = power[0] * time_constant - latent[0], near_share * power[0] * time_constant
    for i in range(len(time)):
        if i > 0:
            mean = 0.5 * (power[i - 1] + power[i]) * time_constant
            step = time[i] - time[i - 1]
            wire, around = gains(held + latent[i - 1], near, mean, step, time_constant, near_share, near_time)
            held += wire
            near += around
        out[i] = held + latent[i]


def branch_lag_s(experiments: Sequence[Experiment], likely_s: float) -> tuple[float, float]:
    """The lag with which the heat balance best tells which way the wire moves, and the share that is then right.

    The one nearest to ``likely_s`` of those that are as good as the best.
    """
    parts = []
    for experiment in experiments:
        time_s = experiment.signals.time_s
        if len(time_s) < _FEWEST:
            continue
        velocity = np.gradient(_smooth(experiment.displacement_m), time_s)
        moving = np.abs(velocity) > _MOVES * np.percentile(np.abs(velocity), 95.0)
        parts.append((experiment, velocity < 0.0, moving))
    lags_s = likely_s * np.geomspace(0.25, 4.0, 17)
    right = np.zeros(len(lags_s))
    for k, lag_s in enumerate(lags_s):
        detector = BranchDetector(EstimatorParameters(thermal_time_constant=float(lag_s)))
        for experiment, contracts, moving in parts:
            time_s, resistance_Ohm, power_W = (
                np.ascontiguousarray(v)
                for v in (experiment.signals.time_s, experiment.resistance_Ohm, experiment.signals.power_W)
            )
            detector.reset(float(time_s[0]), float(resistance_Ohm[0]), float(power_W[0]))
            right[k] += np.count_nonzero((detector.run(time_s, resistance_Ohm, power_W) == contracts)[moving])
    total = sum(int(np.count_nonzero(moving)) for _, _, moving in parts)
    share = right / max(total, 1)
    good = lags_s[share >= share.max() - _ALIKE]
    chosen = good[int(np.argmin(np.abs(np.log(good / likely_s))))]
    return float(f"{chosen:.2g}"), float(share.max())


def _smooth(values: np.ndarray) -> np.ndarray:
    return np.convolve(np.pad(values, 2, mode="edge"), np.full(5, 0.2), mode="valid")
