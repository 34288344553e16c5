"""Where resistance tells displacement: the determinate part of the stroke, found in the data.

At the ends of the stroke the resistance moves with the temperature while the wire stands still.
There the local slope dδ/dR of a full cycle falls far below that of the branch as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain
from sma_actuator.logs.cycles import IN_MOTION
from sma_actuator.logs.experiments import Experiment, IdentificationError
from sma_actuator.logs.kinds import FULL, load_numbers

MARGIN = 0.02  #: share of the full stroke that the working range keeps from where resistance stops telling
#: Share by which a load may differ from the one that all logs are of before it counts as foreign.  On the virtual bench
#: a tenth more or less costs 0.2 to 0.8 % of the full stroke (flexinol's asymptotes, measured and foreign physics), of
#: whole_range 0.7 to 2.1 % (both alloys, measured and foreign).
ONE_LOAD = 0.1
FEWEST = 5  #: samples in mid-stroke that a branch has, of all cycles of a log
_SMOOTH = 3  #: samples either side that a local slope is taken over
_FLAT = 0.4  #: share of the branch's slope below which it is called flat
_CORE = (0.25, 0.75)  #: part of the stroke that is determinate beyond doubt


def determinate_interval_m(experiment: Experiment) -> tuple[float, float]:
    """Displacements between which one log of full cycles is determinate.

    The contracted end is where heating goes flat: on cooling from there the R-phase moves the
    resistance alone, but that is a transition the models know.  The extended end is where either
    branch goes flat.  Raises IdentificationError where the log holds no full stroke.
    """
    displacement_m, resistance_Ohm = experiment.displacement_m, experiment.resistance_Ohm
    low_m, high_m = np.percentile(displacement_m, (0.5, 99.5))
    stroke_m = high_m - low_m
    if not stroke_m > 0.0:
        raise IdentificationError(f"{experiment.log.source}: the displacement does not move")
    core = (displacement_m > low_m + _CORE[0] * stroke_m) & (displacement_m < low_m + _CORE[1] * stroke_m)
    hot_m, cold_m = low_m, high_m
    for name, branch in (("heating", experiment.driven), ("cooling", ~experiment.driven)):
        inside = core & branch
        if np.count_nonzero(inside) < FEWEST:
            raise IdentificationError(
                f"{experiment.log.source}: the {name} branch has {np.count_nonzero(inside)} samples in mid-stroke, all "
                f"cycles together; {FEWEST} are wanted to fit it: measure more cycles (`characterise --pulses`), or "
                "read more often (loop.rate)"
            )
        slope = np.polyfit(resistance_Ohm[inside], displacement_m[inside], 1)[0]
        flat = branch & _is_flat(resistance_Ohm, displacement_m, slope)
        middle_m = low_m + 0.5 * stroke_m
        if name == "heating" and (ends := displacement_m[flat & (displacement_m < middle_m)]).size:
            hot_m = max(hot_m, float(np.percentile(ends, 95)))
        if (ends := displacement_m[flat & (displacement_m > middle_m)]).size:
            cold_m = min(cold_m, float(np.percentile(ends, 5)))
    return hot_m, cold_m


def _is_flat(resistance_Ohm: np.ndarray, displacement_m: np.ndarray, slope: float) -> np.ndarray:
    """Whether δ moves less than a share of what the slope promises for the way R goes, or the other way."""
    k = _SMOOTH
    dr, dd = np.zeros_like(resistance_Ohm), np.zeros_like(resistance_Ohm)
    dr[k:-k] = resistance_Ohm[2 * k :] - resistance_Ohm[: -2 * k]
    dd[k:-k] = displacement_m[2 * k :] - displacement_m[: -2 * k]
    return dd * np.sign(dr) < _FLAT * slope * np.abs(dr)


def working_range_m(experiments: Sequence[Experiment], full_stroke_m: float) -> tuple[float, float]:
    """The part of the stroke that is determinate at every load, with a margin of 2 % of the full stroke."""
    intervals = np.array([determinate_interval_m(t) for t in full_cycles(experiments)])
    low_m, high_m = intervals[:, 0].max() + MARGIN * full_stroke_m, intervals[:, 1].min() - MARGIN * full_stroke_m
    check_width(low_m, high_m, full_stroke_m)
    return float(low_m), float(high_m)


def check_width(low_m: float, high_m: float, full_stroke_m: float) -> None:
    """Raises IdentificationError where too little of the stroke is left to work in."""
    if not high_m - low_m > 0.1 * full_stroke_m:
        raise IdentificationError(
            "the determinate parts of the stroke at the several loads share less than a tenth of the full stroke "
            f"({low_m * 1e3:.2f} to {high_m * 1e3:.2f} mm); leave out the extreme loads, or check the displacement's "
            "calibration"
        )


def shortest_seen_m(experiments: Sequence[Experiment], config: Config) -> float:
    """The shortest displacement that the model sees at every load when the wire is heated as far as it goes, with a
    margin.

    A controller that is asked for less heats for ever: resistance has its minimum there, and what the model
    makes of the minimum need not be where the wire is.
    """
    estimates_m = [Chain(config).run(t.signals).displacement_m[t.driven] for t in _of_the_hot_end(experiments)]
    return max(float(np.nanmin(e)) for e in estimates_m) + MARGIN * config.wire.full_stroke_m


def shortest_m(experiments: Sequence[Experiment]) -> float:
    """The shortest displacement that the wire was seen to reach at every load."""
    return max(float(np.nanmin(t.displacement_m[t.driven])) for t in _of_the_hot_end(experiments))


def _of_the_hot_end(experiments: Sequence[Experiment]) -> Sequence[Experiment]:
    """A model of the whole range may have been fitted on springs alone, or on partial cycles."""
    return [t for t in experiments if t.kind == FULL] or experiments


def full_cycles(experiments: Sequence[Experiment]) -> list[Experiment]:
    """The experiments of full cycles at a constant load.  Raises IdentificationError where there is none."""
    found = [t for t in experiments if t.kind == FULL and t.constant_load]
    if not found:
        raise IdentificationError(
            "no log of full cycles at a constant load (open-loop pulses, from rest in the cold to rest in the heat "
            f"and back, with {IN_MOTION} readings or more in mid-stroke on the way into the heat: where there are "
            "fewer, measure at a higher rate or heat along a ramp); they are needed to find the branches and the ends "
            "of the stroke"
        )
    return found


def without_misjudged(
    experiments: Sequence[Experiment], say: Callable[[str], None] = lambda sentence: None
) -> list[Experiment]:
    """The experiments but those taken for full cycles that hold no full stroke of both branches, of which ``say`` is
    told.

    One such among others must not end their identification; where there is no other, the fit says what is wrong with
    it.
    """
    errors = {}
    for i, t in enumerate(experiments):
        if t.kind == FULL and t.constant_load:
            try:
                determinate_interval_m(t)
            except IdentificationError as error:
                errors[i] = str(error)
    kept = [t for i, t in enumerate(experiments) if i not in errors]
    if not any(t.kind == FULL and t.constant_load for t in kept):
        return list(experiments)
    for sentence in errors.values():
        say(f"left out: {sentence}")
    return kept


def lowest_order(experiments: Sequence[Experiment]) -> int:
    """Order of the polynomials in stress from which on one is looked for: logs of one load hold no slope."""
    return min(1, max(distinct_stresses(experiments), 1) - 1)


def stress_range_Pa(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Lowest and highest stress that coefficients rest on, with a margin: 2 % for noise, or ONE_LOAD where there is but
    one."""
    found = full_cycles(experiments)
    values = [t.mean_stress_Pa for t in found]
    margin = (0.02 if distinct_stresses(found) > 1 else ONE_LOAD) * max(values)
    return float(min(values) - margin), float(max(values) + margin)


def distinct_stresses(experiments: Sequence[Experiment]) -> int:
    """How many loads there are."""
    return int(load_numbers(experiments).max(initial=-1)) + 1
