"""How the rows of the evidence move with each effect's sizes: what isolability is reckoned from."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from sma_actuator.estimation.effects import Effect
from sma_actuator.estimation.effects.free import Free

from .candidates import Candidate

PROBE = 0.5  #: of what is typical: so large an effect is asked for, as a fit's first step asks
TIMES = (0.5, 0.25, 0.75)  #: of the logs: when something may have happened that happens once


def sizes(c: Candidate) -> list[tuple[Free, float]]:
    """The parameters that an effect is in proportion to, each with what is typical; of a play or a lag its one
    shape."""
    found = [(f, f.typical) for f in c.free if f.is_size]
    return found or [(c.free[0], c.free[0].starts[0])]


def shapes(c: Candidate, duration_s: float) -> Iterator[dict[str, float]]:
    """All that it can be beside its sizes: that from which a fit begins first."""
    size_names = {f.name for f, _ in sizes(c)}
    free = [f for f in c.free if f.name not in size_names]
    times = [{c.scanned: share * duration_s} for share in TIMES] if c.scanned else [{}]
    for values, when in itertools.product(itertools.product(*(f.starts for f in free)), times):
        yield dict(zip((f.name for f in free), values, strict=True)) | when


def built(c: Candidate, shape: dict[str, float], values: np.ndarray) -> Effect:
    """The effect with its sizes at ``values`` times what is typical, as far as they are possible."""
    return c.build(
        {
            **shape,
            **{
                f.name: min(max(float(v) * typical, f.low), f.high)
                for (f, typical), v in zip(sizes(c), values, strict=True)
            },
        }
    )


def probes(c: Candidate) -> list[np.ndarray]:
    """Of each size alone, so much of what is typical as it is asked for."""
    found = []
    for i, (f, typical) in enumerate(sizes(c)):
        probe = np.zeros(len(sizes(c)))
        probe[i] = 1.0 if not f.is_size else PROBE if PROBE * typical <= f.high else -PROBE
        found.append(probe)
    return found
