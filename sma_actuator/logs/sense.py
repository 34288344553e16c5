"""What a wire can do: which way a displacement counts (extension is positive here), how far it may go, and that it only
pulls."""

from __future__ import annotations

import numpy as np

from .bench_log import BenchLog, uncalibrated_resistance_and_current

#: Correlation beyond which a displacement is told to follow a quantity; it is 0.9 to 1.0 with the resistance of the
#: wires of the virtual bench, pulses as partial cycles, and 0.97 with that of the one real wire that was measured.
_FOLLOWS = 0.5
_DRIVEN = 0.02  #: share of the largest current from which the resistance is measured
_FEWEST = 20  #: samples
_ZERO_OFF = 0.02  #: share of the largest load, below zero, that is more than the drifted zero of an unloaded cell
MOST_STROKE = 0.12  #: of a wire's length, more than any does: Ni-Ti transforms by 8 to 9 % at the most


def counts_contraction(resistance: np.ndarray, current: np.ndarray, displacement: np.ndarray) -> bool:
    """Whether a displacement falls with the resistance, as no wire's extension does; arrays of shape (n,), in any unit.

    Where the resistance does not say, the heat does.  False where neither does.
    """
    good = np.isfinite(resistance + current + displacement)
    good[good] = current[good] > _DRIVEN * np.max(current[good], initial=0.0)
    if np.count_nonzero(good) < _FEWEST:
        return False
    heat = np.convolve(current[good] ** 2, np.full(10, 0.1), mode="same")
    with_resistance, with_heat = (_correlation(values, displacement[good]) for values in (resistance[good], heat))
    return -with_resistance > _FOLLOWS or (abs(with_resistance) <= _FOLLOWS and with_heat > _FOLLOWS)


def log_counts_contraction(log: BenchLog) -> bool:
    """The same of a log of which no calibration is known."""
    displacement = log["displacement_m"] if "displacement_m" in log else log["lvdt_current_A"]
    return counts_contraction(*uncalibrated_resistance_and_current(log), displacement)


def counts_pull_as_negative(pull: np.ndarray, most: float) -> bool:
    """Whether a load cell counts a wire's pull as negative, shape (n,); ``most``: the largest load, in its unit."""
    return bool(np.nanmedian(pull) < -_ZERO_OFF * most)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Of two arrays; 0 where one of them stands still."""
    return float(np.corrcoef(a, b)[0, 1]) if np.ptp(a) > 0.0 and np.ptp(b) > 0.0 else 0.0
