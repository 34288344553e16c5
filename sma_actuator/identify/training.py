"""Whether the wire changed while it was measured: what is fitted then is of a wire that is no more.

A wire in its first tens of cycles moves its hot end cycle by cycle.  Logs need not say when they were recorded, but
within a log of full cycles one comes after the other.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from .experiments import Experiment
from .kinds import FULL, LEFT_OUT

#: Share of the full stroke that the hot end may move with a cycle; ten logs hold some sixty cycles.
STANDS = 0.0006
FEWEST_LOGS = 3
_AGREE = 0.8  #: share of the logs in which it moves the same way
_HOT_PART = 0.25  #: of the time driven, at its end


def still_in_training(experiments: Sequence[Experiment], full_stroke_m: float) -> str:
    """A sentence where the hot end moves from cycle to cycle, in one direction in the logs; "" where it stands."""
    moved_m = np.array([m for t in experiments if t.kind == FULL and t.constant_load for m in _moved_m(t)])
    if len(moved_m) < FEWEST_LOGS:
        return ""
    share = float(np.mean(moved_m)) / full_stroke_m
    same_way = float(np.mean(np.sign(moved_m) == np.sign(share)))
    if abs(share) < STANDS or same_way < _AGREE:
        return ""
    return (
        f"the wire changed while it was measured: with every full cycle its hot end moved by {abs(share):.2%} of the full "
        f"stroke, the same way in {same_way:.0%} of the logs; train it first (`characterise` does, with --training-cycles), "
        "or measure again: these logs are of a wire that is no more, and no interval knows it"
    )


def _moved_m(experiment: Experiment) -> list[float]:
    """How far the hot end moves with a cycle; nothing where there are not three."""
    bounds = np.searchsorted(experiment.cycle, np.arange(1, experiment.cycle[-1] + 2))
    ends_m = []
    for start, stop in itertools.pairwise(bounds):
        driven_m = experiment.displacement_m[start:stop][experiment.driven[start:stop]]
        if len(driven_m):
            ends_m.append(float(np.median(driven_m[-max(3, round(_HOT_PART * len(driven_m))) :])))
    cycles = len(ends_m) - 1 + experiment.log.metadata.get(LEFT_OUT, 0)
    return [(ends_m[-1] - ends_m[0]) / cycles] if len(ends_m) >= 3 else []
