"""What a wire can do: which way a displacement counts (extension is positive here), how far it may go, and that it only
pulls."""

from __future__ import annotations

import numpy as np

from sma_actuator.estimation.lag import lagged

from .bench_log import BenchLog, uncalibrated_resistance_and_current

#: Correlation beyond which a displacement is told to follow a quantity.  With heat, late as the wire's temperature is,
#: it is -0.83 to -0.97 for wires of three physics, pulses, levels and partial cycles; with resistance 0.4 to 1.0 of
#: most, and -0.3 to -0.9 of a Ni-Ti wire whose resistance rises as it contracts.
_FOLLOWS = 0.5
_DRIVEN = 0.02  #: share of the largest current from which the resistance is measured
_FEWEST = 20  #: samples
_ZERO_OFF = 0.02  #: share of the largest load, below zero, that is more than the drifted zero of an unloaded cell
#: Share of its length that a wire expands at the most with its heat, where it does not transform: 11e-6 /K over 180 K.
EXPANDS = 0.002
MOST_STROKE = 0.12  #: of a wire's length, more than any does: Ni-Ti transforms by 8 to 9 % at the most


def counts_contraction(resistance: np.ndarray, current: np.ndarray, displacement: np.ndarray) -> bool:
    """Whether a displacement grows with the wire's heat, as no wire's extension does; arrays (n,), in any unit.

    Where the heat does not say, as in a wire that is not heated by its current, the resistance does: it falls with the
    extension of most.  False where neither does.
    """
    good = np.isfinite(resistance + current + displacement)
    good[good] = current[good] > _DRIVEN * np.max(current[good], initial=0.0)
    if np.count_nonzero(good) < _FEWEST:
        return False
    with_heat = _with_heat(current[good] ** 2, displacement[good])
    if abs(with_heat) > _FOLLOWS:
        return with_heat > 0.0
    return _correlation(resistance[good], displacement[good]) < -_FOLLOWS


def _with_heat(heat: np.ndarray, displacement: np.ndarray) -> float:
    """Correlation of a displacement with heat that comes late, as a first-order lag, by the time at which it is the
    largest, up to a tenth of the log."""
    sample, found = np.arange(len(heat)), 0.0
    for samples in 2.0 ** np.arange(2.0, np.log2(len(heat) / 10.0)):
        found = max(found, _correlation(lagged(sample, heat, samples), displacement), key=abs)
    return found


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
