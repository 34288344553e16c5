"""What a model that was just identified is good for, and what not, in words: from logs or cycles it has not seen.

A mean over all that was measured hides where it fails.  So it is judged per load and per region: the working range,
what lies beyond it at the hot and at the cold end of the stroke, and the partial cycles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sma_actuator.identify.ranges import MARGIN, determinate_interval_m, full_cycles
from sma_actuator.logs.cycles import SAME_LOAD
from sma_actuator.logs.experiments import Experiment, IdentificationError
from sma_actuator.logs.kinds import FOLLOWED

from .unseen import Unseen

GOOD_percent = 2.0  #: of full stroke; the thesis's own models leave 1 to 3.5 % in replay and 2.6 to 4.4 % under control
POOR_percent = 4.0
_NARROW = 0.5  #: share of the stroke
_WIDENS = 0.1  #: share of the stroke that leaving a load out must give to be worth a word
_CLEARLY = 1.3  #: times as large is an error clearly larger than another
_ONE_OF = 20  #: places is further off than what is said of them
_PLACES = 20  #: of the stroke that count alike
_SEEN = 10  #: samples from which on a place counts as one
#: Times the next lighter load, from which on what is between them is worth a word.  What it costs goes with the square
#: of the logarithm: of two loads, between which it goes along a line, 5 % at 3 times and 0.7 % at 1.5; of more it is
#: judged by loads left out, and was off by 1.8 % where 0.5 was said at 3 times.
APART_ON_A_LINE, APART = 1.5, 2.2
_FEWEST = 10  #: samples that a region of a load is judged by
REGIONS = ("working range", "hot end", "cold end", "partial cycles")


@dataclass(frozen=True, slots=True)
class Verdict:
    """The judgement."""

    good_for_control: bool
    sentences: list[str]  #: the first says it all; then for what not, why, and what would mend it
    regions: dict[str, float]  #: mean absolute error, % of full stroke
    loads: list[dict[str, float]] = field(default_factory=list)  #: of each load, by region
    left_out: str = "cycles"  #: what the figures are of

    def as_mapping(self) -> dict[str, Any]:
        """For machines."""
        return {
            "good_for_control": self.good_for_control,
            "sentences": self.sentences,
            "error_pct_stroke": self.regions,
            "loads": self.loads,
        }


def judge(
    unseen: Unseen,
    experiments: Sequence[Experiment],
    range_m: tuple[float, float],
    full_stroke_m: float,
    *,
    model_type: str,
    seen_too: bool,
    replayed: Unseen | None = None,
    bounds: Sequence[str] = (),
    foreign_loads_N: tuple[float, float] | None = None,
) -> Verdict:
    """The verdict on a model of ``model_type`` with a working range.

    ``unseen``: what it was judged on; ``seen_too``: on cycles it was fitted on, since there are no others;
    ``replayed``: the logs that it was fitted on, as it estimates them by itself.  A fit that is shown the displacement
    meanwhile may do better on what was left out than the model on any: none is called better than it replays these.
    ``foreign_loads_N``: below and above which the node calls a load foreign, where the logs are of one load.
    """
    regions, loads = _by_load(unseen, range_m)
    in_replay, by_load_in_replay = _by_load(unseen if replayed is None else replayed, range_m)
    other = "" if model_type == "whole_range" else "; `--model whole_range` is for that"
    working, by_itself = regions.get("working range", math.inf), in_replay.get("working range", 0.0)
    on_what = "on the cycles it was fitted on" if seen_too else f"on {unseen.what} it has not seen"
    off = unseen
    if by_itself > _CLEARLY * working:
        on_what = f"in replay of its own logs; on {unseen.what} left out, shown where the wire was, by {working:.1f} %"
        working, off = by_itself, unseen if replayed is None else replayed
    low_m, high_m = range_m
    stroke_m = float(np.subtract(*np.percentile(unseen.place_m, (99.5, 0.5))))
    share = min((high_m - low_m) / stroke_m, 1.0)
    word = "good" if working <= GOOD_percent else "fair" if working <= POOR_percent else "NOT good"
    only = ", but only" if share < _NARROW else ""
    where = f"{low_m * 1e3:.2f} to {high_m * 1e3:.2f} mm ({share:.0%} of the stroke in these logs)"
    sentences = [f"{word} for control{only} from {where}: it errs by {working:.1f} % of full stroke there {on_what}"]
    if (rare := _rare(off, range_m)) is not None:
        sentences[0] += f"; one place of {_ONE_OF} by more than {rare:.1f} %"
    if working > GOOD_percent:
        sentences.append(
            "its curves do not follow these loops; look at the page's loops, measure more cycles at each load, or fit "
            f"another model{other}"
        )
    sentences += _about_loads(loads, by_load_in_replay, working)
    if foreign_loads_N is not None:
        sentences.append(_about_one_load(unseen, foreign_loads_N))
    sentences += _about_gaps(experiments)
    sentences += _about_ends(unseen, regions, range_m, other)
    sentences += _about_partial_cycles(regions, other)
    sentences += _about_a_second_round(experiments) if model_type == "whole_range" else []
    sentences += _about_the_range(experiments, range_m, stroke_m, full_stroke_m) if share < _NARROW else []
    sentences += bounds
    return Verdict(working <= POOR_percent, sentences, regions, loads, unseen.what)


def _rare(found: Unseen, range_m: tuple[float, float]) -> float | None:
    """What one of so many places in the working range exceeds."""
    inside = (found.place_m >= range_m[0]) & (found.place_m <= range_m[1])
    if np.count_nonzero(inside) < _FEWEST:
        return None
    error, counts = found.error_percent[inside], _alike(found)[inside]
    order = np.argsort(error)
    return float(error[order][np.searchsorted(np.cumsum(counts[order]), (1.0 - 1.0 / _ONE_OF) * counts.sum())])


def _alike(found: Unseen) -> np.ndarray:
    """What each sample counts, so that every place counts alike at every load: whoever drives the wire asks for any of
    them, and in a calibration it lies at its cold end most of the time."""
    low_m, high_m = np.percentile(found.place_m, (0.5, 99.5))
    place = np.clip(found.place_m, low_m, high_m) // max((high_m - low_m) / _PLACES, 1e-9)
    _, which, samples = np.unique(
        np.column_stack([found.load_N, place]), axis=0, return_inverse=True, return_counts=True
    )
    return 1.0 / np.maximum(samples, _SEEN)[which.ravel()]


def _by_load(found: Unseen, range_m: tuple[float, float]) -> tuple[dict[str, float], list[dict[str, float]]]:
    """Errors by region, of all loads together and of each."""
    loads = [
        {"load_N": load_N, **_regions(found, range_m, here)}
        for load_N, here in _loads(found)
        if np.count_nonzero(here) >= _FEWEST
    ]
    return _regions(found, range_m, np.ones(len(found.place_m), dtype=bool)), loads


def _regions(unseen: Unseen, range_m: tuple[float, float], here: np.ndarray) -> dict[str, float]:
    low_m, high_m = range_m
    inside = (unseen.place_m >= low_m) & (unseen.place_m <= high_m)
    chosen = (inside, unseen.place_m < low_m, unseen.place_m > high_m, inside & unseen.partial)
    counts = _alike(unseen)
    return {
        name: round(float(np.average(unseen.error_percent[rows & here], weights=counts[rows & here])), 3)
        for name, rows in zip(REGIONS, chosen, strict=True)
        if np.count_nonzero(rows & here) >= _FEWEST
    }


def _loads(unseen: Unseen) -> list[tuple[float, np.ndarray]]:
    """Every load, those alike as one, and which samples are of it."""
    values = np.unique(unseen.load_N)
    groups = np.split(values, np.flatnonzero(np.diff(values) > SAME_LOAD * np.abs(values[1:])) + 1)
    return [(float(f"{g.mean():.4g}"), np.isin(unseen.load_N, g)) for g in groups if len(g)]


def _about_loads(
    loads: Sequence[Mapping[str, float]], in_replay: Sequence[Mapping[str, float]], working: float
) -> list[str]:
    """Loads at which the model is clearly worse than elsewhere, on cycles left out or in replay."""
    errors: dict[float, float] = {}
    for one in (*loads, *in_replay):
        errors[one["load_N"]] = max(errors.get(one["load_N"], 0.0), one.get("working range", 0.0))
    bad = {load_N: error for load_N, error in errors.items() if error > GOOD_percent and error > _CLEARLY * working}
    if not bad or len(loads) < 2:
        return []
    words = ", ".join(f"{load_N:.3g} N ({error:.1f} %)" for load_N, error in sorted(bad.items()))
    return [
        (
            f"not for {words}: the model does not reach there; measure at loads beside it, or leave it out and keep "
            "away from it"
        )
    ]


def _about_one_load(unseen: Unseen, foreign_N: tuple[float, float]) -> str:
    return (
        f"for one load, {float(np.mean(unseen.load_N)):.3g} N: another costs up to some 2 % of full stroke for each "
        f"tenth that it differs (measured on the virtual bench); below {foreign_N[0]:.2f} and above {foreign_N[1]:.2f} "
        "N the node calls the estimate outside its calibration, and switches off where that lasts "
        "(estimator_outside); to use other loads record pulses at two or three more weights and give identify all the "
        "logs"
    )


def _about_gaps(experiments: Sequence[Experiment]) -> list[str]:
    """Loads that no log is of, between some that are far from each other; a spring is at all those of its log."""
    spans_N = sorted(
        tuple(np.nanpercentile(t.signals.load_N, (50.0, 50.0) if t.constant_load else (5.0, 95.0))) for t in experiments
    )
    reached_N = np.maximum.accumulate([high_N for _, high_N in spans_N])
    gaps = [
        (below_N, above_N)
        for below_N, (above_N, _) in zip(reached_N, spans_N[1:], strict=False)
        if above_N > (1.0 + SAME_LOAD) * below_N
    ]
    apart = APART_ON_A_LINE if len(gaps) == 1 else APART
    return [
        f"between {below_N:.3g} and {above_N:.3g} N no log has a load: where one is three times the other it errs by "
        "up to some 5 % of full stroke midway (measured in three wires of two physics); record pulses at a weight "
        "between them and give identify all the logs"
        for below_N, above_N in gaps
        if above_N > apart * below_N
    ]


def _about_ends(unseen: Unseen, regions: Mapping[str, float], range_m: tuple[float, float], other: str) -> list[str]:
    out, good = [], []
    for name, words, share in (
        ("hot end", f"shorter than {range_m[0] * 1e3:.2f} mm", float((unseen.place_m < range_m[0]).mean())),
        ("cold end", f"longer than {range_m[1] * 1e3:.2f} mm", float((unseen.place_m > range_m[1]).mean())),
    ):
        if name not in regions:
            continue
        if regions[name] > GOOD_percent:
            out.append(
                f"not for the {name} ({words}, {share:.0%} of the samples): {regions[name]:.1f} %, since resistance "
                f"hardly moves with displacement there; keep setpoints inside{other}"
            )
        else:
            good.append(f"the {name} too ({regions[name]:.1f} %)")
    return ([f"good at {' and '.join(good)}"] if good else []) + out


def _about_partial_cycles(regions: Mapping[str, float], other: str) -> list[str]:
    if "partial cycles" not in regions:
        return [
            (
                "partial cycles are not judged by themselves: no log is of them alone inside the working range; a "
                "controller drives little else, so record some (characterise does) and give them to identify"
            )
        ]
    error = regions["partial cycles"]
    if error > GOOD_percent:
        return [f"not for partial cycles ({error:.1f} %): its transitions do not follow these minor loops{other}"]
    return [f"partial cycles: {error:.1f} %"]


def _about_a_second_round(experiments: Sequence[Experiment]) -> list[str]:
    """What a model that learns has not seen, where none of its logs was driven by one."""
    if any(t.log.metadata.get("kind") == FOLLOWED for t in experiments):
        return []
    return [
        "it has not seen what a controller does: a second round (characterise --follow) shows it that, and is judged"
    ]


def _about_the_range(
    experiments: Sequence[Experiment], range_m: tuple[float, float], stroke_m: float, full_stroke_m: float
) -> list[str]:
    """Which load makes the working range as narrow as it is."""
    try:
        full = full_cycles(experiments)
        intervals = np.array([determinate_interval_m(t) for t in full])
    except IdentificationError:
        return []
    loads_N = np.array([float(np.nanmean(t.signals.load_N)) for t in full])
    margin_m = MARGIN * full_stroke_m
    best: tuple[float, str] = (_WIDENS * stroke_m, "")
    for load_N in np.unique(loads_N):
        others = np.abs(loads_N - load_N) > SAME_LOAD * load_N
        if np.count_nonzero(others) < 2:
            continue
        low_m, high_m = intervals[others, 0].max() + margin_m, intervals[others, 1].min() - margin_m
        gain_m = (high_m - low_m) - (range_m[1] - range_m[0])
        if gain_m > best[0]:
            best = (
                gain_m,
                (
                    f"the range is narrow for the sake of {load_N:.3g} N; without its logs it would be about "
                    f"{low_m * 1e3:.2f} to {high_m * 1e3:.2f} mm"
                ),
            )
    return (
        [best[1]]
        if best[1]
        else [
            (
                "the range is narrow: at some load resistance stops telling displacement early; a larger load or "
                "`--model whole_range` widens it"
            )
        ]
    )
