"""Where the wire stands still: cold at the bias current, and hot at full contraction.

There resistance and displacement depend on load and surroundings alone and repeat from cycle to
cycle far better than the loop between; so they witness faults that the displacement hides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .experiments import Experiment

WINDOW_s = 1.0  #: averaged
SETTLED = {
    False: 4.0,
    True: 2.0,
}  #: thermal time constants that the current has stood, cold and hot (heated, it does not wait)
#: Share of its range that the current may move meanwhile, cold and hot: a guard against overheating takes it back towards the end of a pulse.
STILL = {False: 0.06, True: 0.1}
STEADY = 0.015  #: share of its range that R or δ may move from half a window to the next
TO_GO = 0.012  #: share of its range that δ of a settled wire may have before it


@dataclass(frozen=True, slots=True)
class Rest:
    """One stretch of WINDOW_s at rest: samples ``start`` … ``stop`` − 1 of its experiment."""

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
    """Rests of an experiment: the last second before the current is switched on (cold) or off (hot), where all is steady.

    The current must have stood for SETTLED thermal time constants: a wire that has just been switched
    off does not move yet, and is not at rest.  A load that changed is none either.
    """
    time_s, driven, current_A = experiment.signals.time_s, experiment.driven, experiment.signals.current_A
    turns = np.flatnonzero(driven[1:] != driven[:-1]) + 1
    ranges = [
        (values, np.subtract(*np.nanpercentile(values, (99.0, 1.0))))
        for values in (experiment.resistance_Ohm, experiment.displacement_m)
    ]
    range_A = np.subtract(*np.nanpercentile(current_A, (99.0, 1.0)))
    rests = []
    for turn in np.append(turns, len(time_s)):
        hot = bool(driven[turn - 1])
        settling_s = max(SETTLED[hot] * thermal_time_constant_s, 2.0 * WINDOW_s)
        begun = int(np.searchsorted(time_s, time_s[turn - 1] - settling_s))
        start = int(np.searchsorted(time_s, time_s[turn - 1] - WINDOW_s))
        if turn - start < 4 or time_s[turn - 1] - time_s[begun] < 0.9 * settling_s or (driven[begun:turn] != hot).any():
            continue
        if np.ptp(current_A[begun + 1 : turn - 1]) > STILL[hot] * range_A:
            continue
        load_N, still_m = experiment.signals.load_N, experiment.displacement_m
        steady = (
            all(abs(_moved(values, start, turn)) <= STEADY * span for values, span in ranges)
            and abs(_moved(load_N, start, turn)) <= 0.02 * abs(np.mean(load_N[start:turn])) + 0.005
        )
        if steady:
            moved_m = abs(_moved(still_m, start, turn))
            to_go = float(moved_m / max(ranges[1][1], 1e-12) * thermal_time_constant_s / (0.5 * WINDOW_s))
            rests.append(Rest(hot, start, int(turn), int(experiment.cycle[start]), to_go))
    return rests
