"""What the load cell reads while a person hangs something, and whether it hangs still."""

from __future__ import annotations

import collections
import time

import numpy as np

from sma_actuator.console.asking import Shown
from sma_actuator.estimation.circuit import signals_from_reading
from sma_actuator.instruments import InstrumentError

from .rig import Rig

WINDOW_s = 1.0  #: in which it must not move
_FEWEST = 3  #: readings in it
_STILL_N, _STILL_V = 0.02, 0.002
_STILL_SHARE = 0.01  #: of the reading


class LoadWatch:
    """Reads the load cell of a rig that drives nothing."""

    def __init__(self, rig: Rig, expected_N: float | None = None):
        """``expected_N``: what should hang there, where that can be compared."""
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
            wanted = "" if self._expected_N is None else f" of {self._expected_N:.3f} N"
            text += f", {load_N:.3f} N{wanted} by its calibration"
        return Shown(f"{text}: {state}", state)

    def _settled(self, now_s: float) -> bool:
        times, voltage_V, loads_N = zip(*self._seen, strict=True)
        if now_s - times[0] < WINDOW_s or len(times) < _FEWEST:
            return False
        values, still = (loads_N, _STILL_N) if self._rig.config.load_cell.calibrated else (voltage_V, _STILL_V)
        return float(np.ptp(values)) <= max(still, _STILL_SHARE * abs(float(np.mean(values))))
