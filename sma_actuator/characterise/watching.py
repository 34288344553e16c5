"""What the load cell reads while a person hangs something, and whether it hangs still."""

from __future__ import annotations

import collections
import time

import numpy as np

from sma_actuator.base.newtons import newtons
from sma_actuator.console.asking import Shown
from sma_actuator.estimation.circuit import signals_from_reading
from sma_actuator.instruments import InstrumentError

from .rig import Rig

WINDOW_s = 1.0  #: in which it must not move
_FEWEST = 3  #: readings in it
_STILL_N, _STILL_V = 0.02, 0.002
_STILL_SHARE = 0.01  #: of the reading
#: By this share of what was asked for something else may hang there: a hook that was not weighed, a cell that creeps.
#: No more, since the loads that are planned stand 1.4 times apart.
_OTHER_SHARE = 0.1


class LoadWatch:
    """Reads the load cell of a rig that drives nothing."""

    def __init__(self, rig: Rig, expected_N: tuple[float, float] | None = None):
        """``expected_N``: the least and the most that should hang there, where that can be compared."""
        self._rig, self._expected_N = rig, expected_N
        self._seen: collections.deque[tuple[float, float, float]] = collections.deque()

    def look(self) -> Shown:
        """The reading now; its state is ``settled``, ``moving`` or ``none``."""
        try:
            reading = self._rig.daq.read_block()
        except InstrumentError as error:
            self._seen.clear()
            return Shown(f"load cell: no reading ({error})", "none")
        voltage_V = float(np.mean(reading.load_cell_voltage_V))
        load_N = float(np.mean(signals_from_reading(reading, self._rig.config).load_N))
        now_s = time.monotonic()
        self._seen.append((now_s, voltage_V, load_N))
        while len(self._seen) > _FEWEST and self._seen[1][0] < now_s - WINDOW_s:
            self._seen.popleft()
        state = "settled" if self._settled(now_s) else "moving"
        text = f"load cell: {voltage_V:.4f} V"
        if self._rig.config.load_cell.calibrated:
            wanted = "" if self._expected_N is None else f" of {_in_words(self._expected_N)}"
            text += f", {newtons(load_N)} N{wanted} by its calibration"
        return Shown(f"{text}: {state}", state)

    def wrong(self) -> str:
        """Why what hangs there is not what was asked for; nothing where it may be, by all that the cell scatters."""
        if self._expected_N is None or not self._seen:
            return ""
        loads_N = [load_N for _, _, load_N in self._seen]
        load_N, scatter_N = float(np.mean(loads_N)), float(np.ptp(loads_N))
        least_N, most_N = (max(_OTHER_SHARE * each_N, scatter_N) for each_N in self._expected_N)
        if self._expected_N[0] - least_N <= load_N <= self._expected_N[1] + most_N:
            return ""
        return (
            f"the load cell reads {newtons(load_N)} N, not {_in_words(self._expected_N)}: hang what is asked for, name "
            "what hangs there (--loads, --spring), or have the load cell calibrated (without --skip load_cell)"
        )

    def _settled(self, now_s: float) -> bool:
        times, voltage_V, loads_N = zip(*self._seen, strict=True)
        if now_s - times[0] < WINDOW_s or len(times) < _FEWEST:
            return False
        values, still = (loads_N, _STILL_N) if self._rig.config.load_cell.calibrated else (voltage_V, _STILL_V)
        return float(np.ptp(values)) <= max(still, _STILL_SHARE * abs(float(np.mean(values))))


def _in_words(expected_N: tuple[float, float]) -> str:
    return " to ".join(newtons(each_N) for each_N in dict.fromkeys(expected_N)) + " N"
