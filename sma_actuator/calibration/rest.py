"""Where the wire stands still: cold at the bias current, and hot at full contraction.

There resistance and displacement depend on load, surroundings and, of a contracted wire, its temperature alone, and
repeat from cycle to cycle far better than the loop between; so they witness faults that the displacement hides.
:func:`learn` says what they were at the calibration, :class:`Usual` how far off a later rest is, in standard
deviations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from sma_actuator.base.calibration import COLD_SHARE, SINCE_THEN, SINCE_THEN_WITHIN, Calibration, RestSection, through
from sma_actuator.logs.experiments import Experiment

from .stresses import clusters, nearest, rounded

#: Averaged; no longer than a thermal time constant, since a quick wire rests no longer than that takes, and longer
#: where readings are so slow that fewer would be.
WINDOW_s, LEAST_READINGS = 1.0, 4
SETTLED = {
    False: 4.0,
    True: 2.0,
}  #: thermal time constants that the current has stood, cold and hot (heated, it does not wait)
#: Share of its range that the current may move meanwhile, cold and hot: a guard against overheating takes it back
#: towards the end of a pulse.
STILL = {False: 0.06, True: 0.1}
STEADY = 0.015  #: share of its range that R or δ may move from half a window to the next
TO_GO = 0.012  #: share of its range that δ of a settled wire may have before it
SPREAD = 1.25  #: standard deviation over mean absolute error
REPEATS = 0.003, 0.005  #: share of the ranges of R and δ to which a rest repeats at the best
#: How far a rest may be off, of those ranges, per distance from the calibration's nearest stress over its largest; and
#: so many times that per difference from the load that a cold wire came to rest under: it has the variants of that.
BETWEEN, OTHER_VARIANTS = 0.05, 2.0
BENDS_WITHIN = 0.5  #: how far the curve between these stresses may be off, of what it lies beside straight lines
#: The same of a cold wire in surroundings known to be others, per kelvin: many alloys have not transformed to the end
#: at room temperature.
PER_KELVIN = 0.005
#: A hot rest is held against the calibration's where it takes its power to within so much; and how well it is known how
#: much more resistance a contracted wire has that is warmer: of that, or where nobody knows it, per kelvin of the
#: resistance.
AS_HOT, WARMS_WITHIN, WARMS_AT_MOST = 0.3, 0.5, 5e-4
#: Temperature to which what a contracted wire has yet to go is in proportion, where it is not as hot as at the
#: calibration.
TAIL_K = 5.0
ALIKE = 0.05  #: of the largest: what stress and heat of two rests may differ by that are held against each other


@dataclass(frozen=True, slots=True)
class Rest:
    """One window at rest: samples ``start`` … ``stop`` − 1 of its experiment."""

    hot: bool
    start: int
    stop: int
    cycle: int
    to_go: float  #: share of its range that δ moves in a thermal time constant, where it goes on as in the window

    def further(self, values: np.ndarray, time_s: np.ndarray, time_constant_s: float) -> float:
        """How far ``values`` (n,) would go after the window, where they go on as in it and come to rest in so long."""
        if self.stop - self.start < 2:
            return 0.0
        return _moved(values, self.start, self.stop) / _moved(time_s, self.start, self.stop) * time_constant_s

    @property
    def settled(self) -> bool:
        """Whether it is one: a wire that loses its heat more slowly than was thought creeps on for long."""
        return self.to_go <= TO_GO


def _moved(values: np.ndarray, start: int, stop: int) -> float:
    """How far ``values`` come from the first half of a window to its second, in the mean."""
    middle = (start + stop) // 2
    return float(np.mean(values[middle:stop]) - np.mean(values[start:middle]))


def find_rests(experiment: Experiment, thermal_time_constant_s: float) -> list[Rest]:
    """Rests of an experiment: the last window before the current is switched on (cold) or off (hot), where all is
    steady.

    The current must have stood for SETTLED thermal time constants: a wire that has just been switched off does not move
    yet, and is not at rest.  A load that changed is none either, and no end is where a controller holds the wire
    between them: cold the current is the least that flows in the log, hot its power is the most, to within AS_HOT.
    """
    time_s, driven, current_A = experiment.signals.time_s, experiment.driven, experiment.signals.current_A
    turns = np.flatnonzero(driven[1:] != driven[:-1]) + 1
    ranges = [
        (values, np.subtract(*np.nanpercentile(values, (99.0, 1.0))))
        for values in (experiment.resistance_Ohm, experiment.displacement_m)
    ]
    most_A, least_A = np.nanpercentile(current_A, (99.0, 1.0))
    range_A = most_A - least_A
    least_s = (LEAST_READINGS + 1) * float(np.median(np.diff(time_s)))  # one may come late
    window_s = max(min(WINDOW_s, thermal_time_constant_s), least_s)
    rests = []
    for turn in np.append(turns, len(time_s)):
        hot = bool(driven[turn - 1])
        settling_s = max(SETTLED[hot] * thermal_time_constant_s, 2.0 * window_s)
        begun = int(np.searchsorted(time_s, time_s[turn - 1] - settling_s))
        start = int(np.searchsorted(time_s, time_s[turn - 1] - window_s))
        stood = time_s[turn - 1] - time_s[begun] >= 0.9 * settling_s and (driven[begun:turn] == hot).all()
        if turn - start < LEAST_READINGS or not stood:
            continue
        since_A = current_A[begun + 1 : turn - 1]
        mean_A = since_A.mean()
        at_end = mean_A**2 >= (1.0 - AS_HOT) * most_A**2 if hot else mean_A <= least_A + STILL[False] * range_A
        if np.ptp(since_A) > STILL[hot] * range_A or not at_end:
            continue
        load_N, still_m = experiment.signals.load_N, experiment.displacement_m
        steady = (
            all(abs(_moved(values, start, turn)) <= STEADY * span for values, span in ranges)
            and abs(_moved(load_N, start, turn)) <= 0.02 * abs(np.mean(load_N[start:turn])) + 0.005
        )
        if steady:
            moved_m = abs(_moved(still_m, start, turn))
            to_go = float(moved_m / max(ranges[1][1], 1e-12) * thermal_time_constant_s / (0.5 * window_s))
            rests.append(Rest(hot, start, int(turn), int(experiment.cycle[start]), to_go))
    return rests


def was_heated(experiment: Experiment, rest: Rest) -> bool:
    """Whether the wire was heated in this log before it rested: until then a cold one is as long as what it cooled
    under made it, another load perhaps."""
    return bool(experiment.driven[: rest.start].any())


def cold_rests(experiment: Experiment, thermal_time_constant_s: float) -> list[Rest]:
    """Where it rests cold after it was heated in this log."""
    return [
        rest
        for rest in find_rests(experiment, thermal_time_constant_s)
        if not rest.hot and was_heated(experiment, rest)
    ]


def learn(experiments: Sequence[Experiment], thermal_time_constant_s: float) -> RestSection:
    """What the wire showed at rest."""
    found = [(t, rest) for t in experiments for rest in find_rests(t, thermal_time_constant_s)]
    cooled = [(t, rest) for t, rest in found if rest.hot or was_heated(t, rest)]
    if sum(not rest.hot for _, rest in cooled) >= 2:
        found = cooled
    # A cold wire that creeps is not at rest yet, a hot one is contracted whether or not it grows warmer.
    settled = [x for x in found if x[1].hot or x[1].settled]
    if sum(not rest.hot for _, rest in settled) < 2:
        settled = found
    points = {hot: _means_at([x for x in settled if x[1].hot == hot], thermal_time_constant_s) for hot in (False, True)}
    out: dict = {}
    deviations = []
    power_W = np.median([p[3] for p in points[True]]) if points[True] else np.nan
    for hot, name in ((False, "cold"), (True, "hot")):
        rows = np.array(points[hot]).reshape(-1, 6)
        rows = rows[np.isfinite(rows).all(axis=1)]
        at_end = _at_end(rows, power_W, hot)
        rows, between = rows[at_end], rows[~at_end]
        if len(rows) < 2:
            continue
        stress_Pa = clusters(rows[:, 0])
        load = nearest(rows[:, 0], stress_Pa)
        middle = np.array([np.median(rows[load == i], axis=0) for i in range(len(stress_Pa))])
        out[f"{name}_stress"] = rounded(middle[:, 0], 0)
        out[f"{name}_resistance"] = rounded(middle[:, 1], 6)
        out[f"{name}_displacement"] = rounded(middle[:, 2], 8)
        if hot:
            # That of these rests, and not of those that are less hot.
            out["hot_power"] = hot_W = float(np.median(rows[:, 3]))
            out["hot_to_go"] = round(float(np.sqrt(np.mean(rows[:, 4] ** 2))), 8)
            out["hot_longer"] = _longer(between[np.abs(between[:, 3] / hot_W - 1.0) <= AS_HOT], middle)
        else:
            out["cold_power"] = float(np.median(rows[:, 3]))
        # What one that moves has yet to go is known of each by itself.
        still = rows[rows[:, 5] <= TO_GO] if np.any(rows[:, 5] <= TO_GO) else rows
        deviations.append(
            still[:, 1:3] - np.column_stack([through(middle[:, 0], middle[:, k], still[:, 0]) for k in (1, 2)])
        )
    if deviations:
        together = np.concatenate(deviations)
        out["resistance_scatter"] = float(np.sqrt(np.mean(together[:, 0] ** 2)))
        out["displacement_scatter"] = float(np.sqrt(np.mean(together[:, 1] ** 2)))
    return RestSection(**out)


def _at_end(rows: np.ndarray, power_W: float, hot: bool) -> np.ndarray:
    """Which rests are as hot as the hottest under their load that are about as hot as usual, or as cold as the coldest,
    shape (n,); all where nobody knows what power makes a wire hot.

    A wire that is held with some power between need be neither contracted nor cold.
    """
    if not len(rows) or not math.isfinite(power_W):
        return np.ones(len(rows), dtype=bool)
    about = np.flatnonzero(np.abs(rows[:, 3] - power_W) <= 0.15 * power_W) if hot else np.arange(len(rows))
    stress_Pa = clusters(rows[about, 0])
    load = nearest(rows[about, 0], stress_Pa)
    end_W = np.array([(np.max if hot else np.min)(rows[about[load == i], 3]) for i in range(len(stress_Pa))])
    out = np.zeros(len(rows), dtype=bool)
    out[about] = np.abs(rows[about, 3] - end_W[load]) <= ALIKE * power_W
    return out


def _longer(colder: np.ndarray, usual: np.ndarray) -> tuple[float, ...]:
    """By how much rests with less power are longer than the ``usual`` ones, per watt less, at most [m/W]; under a load
    where there are none as under the others, and nothing where there are none at all."""
    if not len(colder):
        return ()
    load = nearest(colder[:, 0], usual[:, 0])
    off_m = colder[:, 2] - through(usual[:, 0], usual[:, 2], colder[:, 0])
    less_W = np.maximum(usual[load, 3] - colder[:, 3], ALIKE * usual[load, 3])
    longer_m_W = np.abs(off_m) / less_W
    there = (longer_m_W[load == i] for i in range(len(usual)))
    return rounded(np.array([some.max() if len(some) else longer_m_W.max() for some in there]), 8)


def _means_at(found: Sequence[tuple[Experiment, Rest]], thermal_time_constant_s: float) -> list[list[float]]:
    """Stress, resistance, displacement and power of rests, how far the displacement had yet to go, and that as a share.

    A cold wire that creeps yet counts with the length that it goes to, a contracted one that grows warmer with the
    resistance: heated on and on, it would always shrink a little.
    """
    out = []
    for t, rest in found:
        here = slice(rest.start, rest.stop)
        values = (t.stress_Pa, t.resistance_Ohm, t.displacement_m, t.signals.power_W)
        means = [float(np.mean(v[here])) for v in values]
        further = [rest.further(v, t.signals.time_s, thermal_time_constant_s) for v in values]
        goes_on = 1 if rest.hot else 2
        means[goes_on] += further[goes_on]
        out.append([*means, further[2], rest.to_go])
    return out


@dataclass(frozen=True, slots=True)
class AtRest:
    """What n rests show, arrays of shape (n,)."""

    hot: np.ndarray  #: bool
    resistance_Ohm: np.ndarray  #: of a contracted wire: that it goes to
    displacement_m: np.ndarray  #: of a cold wire: that it goes to
    further_m: np.ndarray  #: how much of it there was yet to come
    further_Ohm: np.ndarray  #: of a cold wire: how much further its resistance goes
    stress_Pa: np.ndarray
    since_Pa: np.ndarray  #: how much its load has changed since the wire came there
    heat_W: np.ndarray  #: that it loses
    beside_W: np.ndarray  #: of that, what does not come from the current
    warmer_K: np.ndarray  #: how much warmer its surroundings are than the calibration's, by what is logged


@dataclass(frozen=True)
class Usual:
    """What is usual at rest."""

    calibration: Calibration
    heat_loss_W_K: float
    resistance_Ohm: float  #: range of the resistance
    stroke_m: float

    def off(self, rests: AtRest) -> np.ndarray:
        """How far off R and δ of n rests are, in standard deviations, shape (n, 2); 0 where nothing is known of such a
        rest."""
        out = np.zeros((len(rests.hot), 2))
        for hot in (False, True):
            chosen = np.flatnonzero(rests.hot == hot)
            if len(chosen):
                out[chosen] = self._off(hot, {f.name: getattr(rests, f.name)[chosen] for f in fields(AtRest)})
        return out

    def as_formed(self, rests: AtRest, formed_Pa: np.ndarray) -> AtRest:
        """The same rests where a cold wire is as it came to rest at the calibration under other loads, ``formed_Pa``
        (n,): those under which half of its martensite formed."""
        rest, cold = self.calibration.rest, ~rests.hot
        if not len(rest.cold_stress):
            return rests
        more = [
            cold * np.subtract(*(through(rest.cold_stress, values, at_Pa) for at_Pa in (formed_Pa, rests.stress_Pa)))
            for values in (rest.cold_resistance, rest.cold_displacement)
        ]
        return replace(
            rests, resistance_Ohm=rests.resistance_Ohm + more[0], displacement_m=rests.displacement_m + more[1]
        )

    def _off(self, hot: bool, is_: dict[str, np.ndarray]) -> np.ndarray:
        rest, hot_end = self.calibration.rest, self.calibration.hot_end
        ranges = np.array([self.resistance_Ohm, self.stroke_m])
        scatter = np.nan_to_num([rest.resistance_scatter, rest.displacement_scatter])
        expected, away, bent = self._expected(hot, is_)
        to_go_m = np.abs(is_["further_m"])
        known = np.ones(len(away), dtype=bool)
        warms = np.zeros(len(away))
        if not hot:
            more_W = is_["heat_W"] - rest.cold_power if math.isfinite(rest.cold_power) else is_["beside_W"]
            away = away + PER_KELVIN * np.abs(is_["warmer_K"] + more_W / self.heat_loss_W_K)
        elif math.isfinite(rest.hot_power):
            known = np.abs(is_["heat_W"] / rest.hot_power - 1.0) <= AS_HOT
            warmer_K = is_["warmer_K"] + (is_["heat_W"] - rest.hot_power) / self.heat_loss_W_K
            warms = WARMS_AT_MOST * expected[:, 0] * np.abs(warmer_K)
            if math.isfinite(hot_end.contracted_slope):
                expected[:, 0] += hot_end.contracted_slope * warmer_K
                warms = WARMS_WITHIN * np.abs(hot_end.contracted_slope * warmer_K)
            to_go_m = to_go_m + rest.hot_to_go * np.maximum(1.0, np.abs(warmer_K) / TAIL_K)
            if len(rest.hot_longer):
                longer_m_W = np.interp(is_["stress_Pa"], rest.hot_stress, rest.hot_longer)
                to_go_m = to_go_m + longer_m_W * np.maximum(rest.hot_power - is_["heat_W"], 0.0)
        away = np.hypot(away, to_go_m / self.stroke_m)
        squares = scatter**2 + (ranges * REPEATS) ** 2 + np.outer(away, ranges) ** 2 + bent**2
        # What training does to the length of a cold wire is known, but not what to its resistance.
        changed_m = self.calibration.training.changed
        changed = np.array([changed_m / self.stroke_m * self.resistance_Ohm, self._changed_m(hot)])
        squares += (SPREAD * SINCE_THEN_WITHIN * changed) ** 2
        squares[:, 0] += warms**2 + is_["further_Ohm"] ** 2
        shown = np.column_stack((is_["resistance_Ohm"], is_["displacement_m"]))
        return np.where(known[:, None], (shown - expected) / np.sqrt(squares), 0.0)

    def _expected(self, hot: bool, is_: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """R and δ of the calibration at the rests' stresses, (n, 2).

        And how far off they may be: of the ranges, (n,), and because they bend between the calibration's loads, (n, 2).
        """
        rest, stress_Pa = self.calibration.rest, is_["stress_Pa"]
        nodes_Pa = np.asarray(rest.hot_stress if hot else rest.cold_stress)
        if not len(nodes_Pa):
            return self._of_the_others(hot, is_), np.zeros(len(stress_Pa)), np.zeros((len(stress_Pa), 2))
        tables = (rest.hot_resistance, rest.hot_displacement) if hot else (rest.cold_resistance, rest.cold_displacement)
        expected = np.column_stack([through(nodes_Pa, values, stress_Pa) for values in tables])
        straight = np.column_stack([np.interp(stress_Pa, nodes_Pa, values) for values in tables])
        bent = BENDS_WITHIN * np.abs(expected - straight)
        expected[:, 1] += SINCE_THEN * self._changed_m(hot)
        away_Pa = np.min(np.abs(stress_Pa[:, None] - nodes_Pa), axis=1)
        if not hot:
            away_Pa = away_Pa + OTHER_VARIANTS * np.abs(is_["since_Pa"])
        return expected, BETWEEN * away_Pa / np.max(np.abs(nodes_Pa)), bent

    @staticmethod
    def _of_the_others(hot: bool, is_: dict[str, np.ndarray]) -> np.ndarray:
        """The mean of the session's own rests of the same stress, and heat."""
        same = np.ones((len(is_["stress_Pa"]),) * 2, dtype=bool)
        for values in (is_["stress_Pa"], is_["heat_W"]) if hot else (is_["stress_Pa"],):
            same &= np.abs(values[:, None] - values) <= ALIKE * np.max(np.abs(values))
        shown = np.column_stack((is_["resistance_Ohm"], is_["displacement_m"]))
        return (same @ shown) / same.sum(axis=1)[:, None]

    def _changed_m(self, hot: bool) -> float:
        """How far that end moved while the wire was calibrated."""
        return self.calibration.training.changed * (1.0 if hot else COLD_SHARE)
