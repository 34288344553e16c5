"""How much of a normal distribution lies within bounds, also where that is next to nothing."""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

LEAST = 1e-12  #: share beyond its bounds from which one is no bound
POINTS = 128  #: of the lattice over which bounds that depend on each other are integrated
#: Whose roots make the lattice; of more bounds than these a few go together on it.
PRIMES = 2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0, 31.0, 37.0, 41.0, 43.0, 47.0, 53.0


def log_share_within(mean: np.ndarray, covariance: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
    """Logarithm of the share of a normal distribution with ``low`` <= x <= ``high``.

    Exact where one bound counts.  Several are gone through one after the other, each where those before it leave it,
    which is in the mean over a lattice (A. Genz, *Numerical computation of multivariate normal probabilities*, J.
    Comput. Graph. Stat. 1 (1992) 141-149); the tightest first.
    """
    deviation = np.sqrt(np.diag(covariance))
    one_by_one = log_share_between((low - mean) / deviation, (high - mean) / deviation)
    bound = np.argsort(one_by_one)[: np.count_nonzero(one_by_one < -LEAST)]
    if len(bound) < 2:
        return float(np.sum(one_by_one[bound]))
    root = np.linalg.cholesky(covariance[np.ix_(bound, bound)])
    shares, at = np.zeros(POINTS), np.zeros((len(bound), POINTS))
    lattice = (np.sqrt(np.resize(PRIMES, len(bound)))[:, None] * np.arange(1, POINTS + 1)) % 1.0
    for i, k in enumerate(bound):
        centre = mean[k] + root[i, :i] @ at[:i]
        below, above = (low[k] - centre) / root[i, i], (high[k] - centre) / root[i, i]
        shares += log_share_between(below, above)
        at[i] = _between(below, above, np.abs(2.0 * lattice[i] - 1.0))
    return float(np.logaddexp.reduce(shares)) - float(np.log(POINTS))


def log_share_between(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Logarithm of the share of the standard normal distribution between two of its deviations."""
    low, high = np.where(low > 0.0, -high, low), np.where(low > 0.0, -low, high)  # the tail that has digits
    return log_ndtr(high) + np.log1p(-np.exp(log_ndtr(low) - log_ndtr(high)))


def _between(low: np.ndarray, high: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Where so much of what the standard normal distribution has between two of its deviations lies below."""
    side = np.where(low > 0.0, -1.0, 1.0)
    low, high = np.where(side < 0.0, -high, low), np.where(side < 0.0, -low, high)
    return side * ndtri_exp(np.logaddexp(log_ndtr(low), np.log(share) + log_share_between(low, high)))
