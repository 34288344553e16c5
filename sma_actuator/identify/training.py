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
from .ranges import load_numbers

#: Share of the full stroke that the hot end may move with a cycle; ten logs hold some sixty cycles.
STANDS = 0.0006
FEWEST_LOGS = 3
_AGREE = 0.8  #: share of the logs in which it moves the same way
_HOT_PART = 0.25  #: of the time driven, at its end


def still_in_training(experiments: Sequence[Experiment], full_stroke_m: float) -> str:
    """A sentence where the hot end moves from cycle to cycle, in one direction in the logs; "" where it stands."""
    share = change_while_measured_m(experiments, full_stroke_m) / full_stroke_m
    if not share:
        return ""
    return (
        f"the wire changed while it was measured: its hot end moves with every full cycle, always the same way, {share:.1%} of "
        "the full stroke in all of these logs together; train it first (`characterise` does, with --training-cycles), or measure "
        "again: these logs are of a wire that is no more"
    )


def change_while_measured_m(experiments: Sequence[Experiment], full_stroke_m: float) -> float:
    """How far the hot end has moved in all cycles of the logs together; 0 where it stands.

    With a cycle it moves at each load as in the full cycles there.
    """
    load = load_numbers(experiments)
    moved_m, change_m = [], 0.0
    for number in np.unique(load):
        logs = [t for t, here in zip(experiments, load == number, strict=True) if here]
        found_m = [m for t in logs if t.kind == FULL and t.constant_load for m in _moved_m(t)]
        moved_m += found_m
        if found_m:
            change_m += float(np.mean(found_m)) * sum(_cycles(t) for t in logs)
    if len(moved_m) < FEWEST_LOGS:
        return 0.0
    mean_m = float(np.mean(moved_m))
    same_way = float(np.mean(np.sign(moved_m) == np.sign(mean_m)))
    return abs(change_m) if abs(mean_m) >= STANDS * full_stroke_m and same_way >= _AGREE else 0.0


def _cycles(experiment: Experiment) -> int:
    """All that its log holds."""
    return int(experiment.cycle[-1]) + int(experiment.log.metadata.get(LEFT_OUT, 0))


def _moved_m(experiment: Experiment) -> list[float]:
    """How far the hot end of a log moves with a cycle; nothing where there are not three."""
    bounds = np.searchsorted(experiment.cycle, np.arange(1, experiment.cycle[-1] + 2))
    ends_m = []
    for start, stop in itertools.pairwise(bounds):
        driven_m = experiment.displacement_m[start:stop][experiment.driven[start:stop]]
        if len(driven_m):
            ends_m.append(float(np.median(driven_m[-max(3, round(_HOT_PART * len(driven_m))) :])))
    return [(ends_m[-1] - ends_m[0]) / (_cycles(experiment) - 1)] if len(ends_m) >= 3 else []
