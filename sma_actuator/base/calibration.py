"""What a model's own logs looked like: the section ``calibration`` that `identify` writes.

One section below it for each file of the room :mod:`sma_actuator.calibration`, of its name: there stands how it is
learned, and how a later log is held against it.  What a node looks up in it at every sample stands here.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from itertools import pairwise
from math import nan
from typing import Any

import numpy as np

from .parameters import parameter, section

#: Where the hot end of a wire that wears or trains has moved, the cold one has moved by this share of that: what is
#: left in place is less while it is martensite.
COLD_SHARE = 0.4


#: Fields of the section ``expectation`` in files of before, which nothing asks any more.
OF_BEFORE = ("expected_size", "expected_white")


#: Of what a wire's hot end moved while it was calibrated: how much longer such a wire is since then than what was
#: fitted, which is the mean of the calibration: between nothing, where most came with the first cycles, and half, where
#: it came evenly; and how far off that is in the mean.
SINCE_THEN, SINCE_THEN_WITHIN = 0.25, 0.125


def left_in_place(share_of_stroke: np.ndarray, cold_share: float = COLD_SHARE) -> np.ndarray:
    """How much of what the hot end has moved is there, shape (n,): all of it contracted, ``cold_share`` cold."""
    return 1.0 - (1.0 - cold_share) * np.clip(share_of_stroke, 0.0, 1.0)


def unknown_since_then_m(training: TrainingSection) -> float:
    """What half a 95 % interval of an estimate has more, of a wire that changed while it was calibrated [m]."""
    return (SINCE_THEN + 2.0 * SINCE_THEN_WITHIN) * training.changed


@dataclass(frozen=True, slots=True)
class RestSection:
    """Where the wire stood still; a value for each of its stresses."""

    cold_stress: tuple[float, ...] = parameter((), "stresses at cold rest", "Pa", -1e9, 1e9, optional=True)
    cold_resistance: tuple[float, ...] = parameter((), "resistance at cold rest", "Ω", 0.0, 1e6, optional=True)
    cold_displacement: tuple[float, ...] = parameter((), "displacement at cold rest", "m", -10.0, 10.0, optional=True)
    cold_power: float = parameter(nan, "power at cold rest", "W", 0.0, 1e6, optional=True)
    hot_stress: tuple[float, ...] = parameter((), "stresses at the hot end", "Pa", -1e9, 1e9, optional=True)
    hot_resistance: tuple[float, ...] = parameter((), "resistance at the hot end", "Ω", 0.0, 1e6, optional=True)
    hot_displacement: tuple[float, ...] = parameter((), "displacement at the hot end", "m", -10.0, 10.0, optional=True)
    hot_longer: tuple[float, ...] = parameter(
        (), "how much longer a wire is there per watt less, at most", "m/W", 0.0, 1e6, optional=True
    )
    hot_power: float = parameter(nan, "power at the hot end", "W", 0.0, 1e6, optional=True)
    hot_to_go: float = parameter(
        0.0, "how far a contracted wire had yet to shrink when its pulses ended, rms", "m", 0.0, 10.0, optional=True
    )
    resistance_scatter: float = parameter(nan, "rms scatter of the resistance at rest", "Ω", 0.0, 1e6, optional=True)
    displacement_scatter: float = parameter(
        nan, "rms scatter of the displacement at rest", "m", 0.0, 10.0, optional=True
    )

    def mismatches(self) -> list[str]:
        """What of it does not fit together: a sentence for each field that must be measured again."""
        return _mismatches(
            self,
            "rest",
            cold_stress=("cold_resistance", "cold_displacement"),
            hot_stress=("hot_resistance", "hot_displacement", "hot_longer"),
        )


@dataclass(frozen=True, slots=True)
class PowerSection:
    """At which temperatures, by the heat balance, the wire transformed."""

    transformation_heating: tuple[float, ...] = parameter(
        (),
        "temperatures of the heating wire, at no stress, at equally spaced shares of its stroke, contracted first",
        "°C",
        -1e3,
        1e3,
        optional=True,
    )
    transformation_cooling: tuple[float, ...] = parameter((), "the same, cooling", "°C", -1e3, 1e3, optional=True)
    transformation_shift: tuple[float, ...] = parameter(
        (), "how much higher they are per stress, cooling and heating", "K/Pa", -1e-3, 1e-3, optional=True
    )
    latent_rise: float = parameter(
        nan, "latent heat of the whole stroke over thermal.heat_capacity", "K", -1e3, 1e3, optional=True
    )
    transformation_scatter: float = parameter(
        nan, "how far off a passage through the middle of the stroke is from these, rms", "K", 0.0, 1e3, optional=True
    )
    transformation_speed: tuple[float, ...] = parameter(
        (),
        "least and most share of the stroke that passages were ahead of their thermal lag, cooling, then heating",
        "1",
        -1.0,
        1.0,
        optional=True,
    )

    @property
    def heating(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Shares of the stroke, and the temperatures of the heating wire there, at no stress."""
        return _shares(len(self.transformation_heating)), self.transformation_heating

    def mismatches(self) -> list[str]:
        """What of it does not fit together: a sentence for each field that must be measured again."""
        return _miscounted(self, "power", transformation_shift=2, transformation_speed=4)

    def heating_C(self, share: float, stress_Pa: float) -> float:
        """Temperature, by the heat balance, of a heating wire at a share of its stroke and a stress; NaN where not
        known."""
        if not (self.transformation_heating and self.transformation_shift):
            return nan
        return interpolated(share, *self.heating) + self.transformation_shift[1] * stress_Pa


@dataclass(frozen=True, slots=True)
class HotEndSection:
    """What the wire showed contracted as far as it goes, and on the way back; a value for each of its stresses."""

    contracted_stress: tuple[float, ...] = parameter(
        (), "stresses of a wire that is contracted as far as it goes", "Pa", -1e9, 1e9, optional=True
    )
    contracted_resistance: tuple[float, ...] = parameter((), "its resistance", "Ω", 0.0, 1e6, optional=True)
    contracted_displacement: tuple[float, ...] = parameter((), "its displacement", "m", -10.0, 10.0, optional=True)
    contracted_temperature: float = parameter(
        nan, "temperature, by the heat balance, that it has the resistance at", "°C", -60.0, 1000.0, optional=True
    )
    contracted_slope: float = parameter(
        nan, "rise of its resistance with its temperature", "Ω/K", -1e3, 1e3, optional=True
    )
    cooling_position: float = parameter(
        nan, "displacement at which the rises below were noted", "m", -10.0, 10.0, optional=True
    )
    cooling_stress: tuple[float, ...] = parameter((), "stresses of the rises below", "Pa", -1e9, 1e9, optional=True)
    cooling_rise: tuple[float, ...] = parameter(
        (),
        "temperature above ambient by the heat balance when the cooling wire passed that displacement",
        "K",
        0.0,
        1e3,
        optional=True,
    )

    def mismatches(self) -> list[str]:
        """What of it does not fit together: a sentence for each field that must be measured again."""
        return _mismatches(
            self,
            "hot_end",
            contracted_stress=("contracted_resistance", "contracted_displacement"),
            cooling_stress=("cooling_rise",),
        )

    def cooling_rise_K(self, stress_Pa: float) -> float:
        """The rise above ambient at which a cooling wire passes ``cooling_position``; NaN where that is not known."""
        return interpolated(stress_Pa, self.cooling_stress, self.cooling_rise) if self.cooling_rise else nan


@dataclass(frozen=True, slots=True)
class TrainingSection:
    """Whether the wire changed while it was measured."""

    changed: float = parameter(
        0.0, "how far the hot end moved while the wire was measured, where it was still in training", "m", 0.0, 10.0
    )


@dataclass(frozen=True, slots=True)
class IntervalSection:
    """What the model left at a place, for the live interval of an estimate.

    ``residual_…`` have a value for each position, stress after stress.
    """

    scatter: float = parameter(
        nan,
        "mean absolute size of what is left beside the residuals below, of a log that they do not come from",
        "% of full stroke",
        0.0,
        1e3,
        optional=True,
    )
    residual_stress: tuple[float, ...] = parameter((), "stresses of the residuals", "Pa", -1e9, 1e9, optional=True)
    residual_position: tuple[float, ...] = parameter(
        (), "estimated displacements of the residuals", "m", -10.0, 10.0, optional=True
    )
    residual_heating: tuple[float, ...] = parameter(
        (), "mean measured less estimated displacement, heating", "m", -10.0, 10.0, optional=True
    )
    residual_cooling: tuple[float, ...] = parameter((), "the same, cooling", "m", -10.0, 10.0, optional=True)
    scatter_heating: tuple[float, ...] = parameter(
        (), "rms about them at each position, heating", "m", 0.0, 10.0, optional=True
    )
    scatter_cooling: tuple[float, ...] = parameter((), "the same, cooling", "m", 0.0, 10.0, optional=True)

    def mismatches(self) -> list[str]:
        """What of it does not fit together: a sentence for each field that must be measured again."""
        stresses, positions = len(self.residual_stress), len(self.residual_position)
        return _mismatches(self, "interval", residual_stress=(), residual_position=()) + _miscounted(
            self,
            "interval",
            residual_heating=stresses * positions,
            residual_cooling=stresses * positions,
            scatter_heating=positions,
            scatter_cooling=positions,
        )


@dataclass(frozen=True, slots=True)
class ExpectationSection:
    """What the model leaves at a place with a history, for a trace."""

    expected_stroke: tuple[float, ...] = parameter(
        (), "the stroke that what is expected was learned on", "m", -10.0, 10.0, optional=True
    )
    expected_centre: tuple[float, ...] = parameter(
        (), "mean of each feature that an error may depend on", optional=True
    )
    expected_scale: tuple[float, ...] = parameter((), "its standard deviation", lo=0.0, optional=True)
    expected_least: tuple[float, ...] = parameter((), "the least of it that was seen, in that unit", optional=True)
    expected_most: tuple[float, ...] = parameter((), "and the most", optional=True)
    expected_weights: tuple[float, ...] = parameter(
        (), "of the regression that says what residual to expect", "m", optional=True
    )
    expected_place: tuple[float, ...] = parameter(
        (),
        "of a second one that says where the wire is and does not know the model's displacement: the more the two "
        "disagree, the less is known",
        "m",
        optional=True,
    )
    expected_apart: float = parameter(
        nan, "how far they are apart where neither was fitted, median", "m", 0.0, 10.0, optional=True
    )
    expected_times: float = parameter(
        nan,
        "how many times that and what they disagree by at a place what is left there is, in the mean",
        "1",
        0.0,
        1e6,
        optional=True,
    )
    floor: float = parameter(
        nan,
        "mean absolute size of what is left beside what is expected, where that was not fitted",
        "% of full stroke",
        0.0,
        1e3,
        optional=True,
    )
    independent_time: float = parameter(
        nan, "how far apart two readings are whose errors are independent", "s", 0.0, 1e6, optional=True
    )

    def mismatches(self) -> list[str]:
        """What of it does not fit together: a sentence for each field that must be measured again."""
        features, weights = len(self.expected_centre), len(self.expected_weights)
        of_features = dict.fromkeys(("expected_scale", "expected_least", "expected_most"), features)
        return _miscounted(self, "expectation", expected_stroke=2, expected_place=weights, **of_features)

    @property
    def known(self) -> bool:
        """Whether it says what residual to expect at a place with its history, and how surely."""
        return bool(self.expected_weights)


@dataclass(frozen=True)
class Calibration:
    """What the logs looked like that the model was fitted on."""

    error: float = parameter(
        nan, "mean absolute error of the model on its own logs, full range", "% of full stroke", 0.0, 1e3, optional=True
    )
    largest_error: float = parameter(
        nan, "largest such error of a single log", "% of full stroke", 0.0, 1e3, optional=True
    )
    ambient_temperature: float = parameter(nan, "mean ambient temperature", "°C", -60.0, 100.0, optional=True)
    resistance_range: float = parameter(nan, "largest less smallest resistance", "Ω", 0.0, 1e6, optional=True)
    rest: RestSection = section(RestSection, "the wire at rest")
    power: PowerSection = section(PowerSection, "the temperatures of its transformation")
    hot_end: HotEndSection = section(HotEndSection, "the contracted wire")
    training: TrainingSection = section(TrainingSection, "whether it changed")
    interval: IntervalSection = section(IntervalSection, "what the model left, for the live interval")
    expectation: ExpectationSection = section(ExpectationSection, "what the model leaves, for a trace")

    def mismatches(self) -> list[str]:
        """What of it does not fit together: a sentence for each field that must be measured again."""
        sections = (self.rest, self.power, self.hot_end, self.interval, self.expectation)
        out = [problem for section in sections for problem in section.mismatches()]
        rest = self.rest
        if rest.hot_displacement and rest.cold_displacement and not out:
            hot_m = np.interp(rest.cold_stress, rest.hot_stress, rest.hot_displacement)
            if np.mean(hot_m) > np.mean(rest.cold_displacement):
                out.append(
                    "calibration.rest.hot_displacement: the wire is longer hot than cold, so displacement counts "
                    "contraction; turn its sign in the logs (--unit displacement_m=-mm) and identify the wire again"
                )
        return out

    def usual_ambient_C(self, otherwise_C: float) -> float:
        """How warm it was around the wire when it was calibrated; ``otherwise_C`` where nobody noted it."""
        return self.ambient_temperature if math.isfinite(self.ambient_temperature) else otherwise_C

    def share_of_stroke(self, displacement_m: Any, stress_Pa: Any) -> Any:
        """How far a displacement lies between the contracted (0) and the cold wire (1) at a stress; of numbers or
        arrays."""
        hot_m, cold_m = self.ends_m(stress_Pa)
        return (displacement_m - hot_m) / (cold_m - hot_m)

    def ends_m(self, stress_Pa: Any) -> tuple[Any, Any]:
        """The displacements of the contracted and of the cold wire at a stress, straight between those that were
        measured."""
        line = interpolated if isinstance(stress_Pa, float) else np.interp
        return (
            line(stress_Pa, self.hot_end.contracted_stress, self.hot_end.contracted_displacement),
            line(stress_Pa, self.rest.cold_stress, self.rest.cold_displacement),
        )

    def share_by_resistance(self, resistance_Ohm: Any, stress_Pa: Any) -> Any:
        """The same by the resistance, which is that share's measure but for hysteresis and a third phase."""
        hot_Ohm = np.interp(stress_Pa, self.hot_end.contracted_stress, self.hot_end.contracted_resistance)
        cold_Ohm = np.interp(stress_Pa, self.rest.cold_stress, self.rest.cold_resistance)
        return (resistance_Ohm - hot_Ohm) / (cold_Ohm - hot_Ohm)

    @property
    def ends_known(self) -> bool:
        """Whether it says where the wire ends, contracted and cold."""
        return all(stresses and displacements for stresses, displacements in self.ends)

    @property
    def ends(self) -> tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]:
        """Of both ends, contracted and cold: at which stresses [Pa] it knows them, and the displacements there [m]."""
        hot_end, rest = self.hot_end, self.rest
        return (hot_end.contracted_stress, hot_end.contracted_displacement), (rest.cold_stress, rest.cold_displacement)

    @cached_property
    def transformation_known(self) -> bool:
        """Whether it says at which temperatures the wire transforms, and between which displacements."""
        power = self.power
        complete = min(len(power.transformation_heating), len(power.transformation_cooling)) > 1
        complete = complete and len(power.transformation_shift) == 2 and math.isfinite(power.latent_rise)
        if not (complete and self.ends_known) or self.mismatches():
            return False
        hot_m = np.interp(self.rest.cold_stress, self.hot_end.contracted_stress, self.hot_end.contracted_displacement)
        return bool(np.all(np.array(self.rest.cold_displacement) > hot_m))

    @property
    def hot_end_known(self) -> bool:
        """Whether it says what a wire shows that is contracted as far as it goes."""
        line = self.hot_end.contracted_temperature + self.hot_end.contracted_slope + self.resistance_range
        return bool(self.hot_end.contracted_stress) and math.isfinite(line)

    @property
    def known(self) -> bool:
        """Whether the model says how good it was."""
        return math.isfinite(self.error)


def interpolated(at: float, nodes: Sequence[float], values: Sequence[float]) -> float:
    """``np.interp`` of one number, to the same digit: numpy takes ten times as long."""
    if at != at:
        return nan
    right = bisect_right(nodes, at)
    if right == 0 or right == len(nodes):
        return values[max(right - 1, 0)]
    slope = (values[right] - values[right - 1]) / (nodes[right] - nodes[right - 1])
    return slope * (at - nodes[right - 1]) + values[right - 1]


@lru_cache
def _shares(count: int) -> tuple[float, ...]:
    """So many equally spaced shares, from 0 to 1."""
    return tuple(np.linspace(0.0, 1.0, count).tolist())


def in_sections(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """The section ``calibration`` of a file with its fields in sections: before 0.2 they stood side by side.

    What stands in its section already counts first; what nothing asks any more is left out.
    """
    sections = {s.name: getattr(Calibration(), s.name) for s in fields(Calibration) if "section" in s.metadata}
    of = {field.name: name for name, inside in sections.items() for field in fields(inside)}
    out = {name: value for name, value in mapping.items() if name not in (*of, *OF_BEFORE)}
    for name in mapping:
        inside = out.get(of[name], {}) if name in of else None
        if isinstance(inside, Mapping):
            out[of[name]] = {name: mapping[name], **inside}
    if isinstance(expectation := out.get("expectation"), Mapping):
        out["expectation"] = {name: value for name, value in expectation.items() if name not in OF_BEFORE}
    return out


def _mismatches(of: Any, name: str, **tables_by_stress: tuple[str, ...]) -> list[str]:
    """Of stresses that do not rise, and of tables that do not hold a value for each of them."""
    out = []
    for stress, tables in tables_by_stress.items():
        stresses = getattr(of, stress)
        if any(b <= a for a, b in pairwise(stresses)):
            out.append(f"calibration.{name}.{stress}: does not rise from value to value; identify the model again")
        out += [
            f"calibration.{name}.{table}: has {len(getattr(of, table))} values for the {len(stresses)} of "
            f"calibration.{name}.{stress}; identify the model again"
            for table in tables
            if getattr(of, table) and len(getattr(of, table)) != len(stresses)
        ]
    return out


def _miscounted(of: Any, name: str, **counts: int) -> list[str]:
    """Of tables that are there and do not hold so many values."""
    return [
        f"calibration.{name}.{table}: has {found} values, and {wanted} are wanted; identify the model again"
        for table, wanted in counts.items()
        if (found := len(getattr(of, table))) and found != wanted
    ]


@lru_cache(maxsize=64)
def _curve(nodes: tuple[float, ...], values: tuple[float, ...]) -> Any:
    """Made once of every table: each step of a fit asks the same few."""
    from scipy.interpolate import PchipInterpolator  # half the time that a program takes to start which never asks

    return PchipInterpolator(nodes, values)


def through(nodes: Sequence[float] | np.ndarray, values: Sequence[float] | np.ndarray, at: Any) -> Any:
    """A smooth curve through the values at ascending nodes, without a wave between them, ``at`` other places (n,).

    Beyond its ends it goes on straight, by as much as the next node lies within.  The cold end bends strongly with
    stress: straight lines between the loads of a calibration lie up to 1.6 % of the stroke below it, and its last value
    5 % above it at the lightest load.
    """
    if len(nodes) < 3:
        return np.interp(at, nodes, values)
    curve = _curve(tuple(nodes), tuple(values))
    inside = np.clip(at, nodes[0], nodes[-1])
    further = np.clip(at - inside, nodes[0] - nodes[1], nodes[-1] - nodes[-2])
    return curve(inside) + curve(inside, 1) * further


def through_each(nodes: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The same of n tables at once, ``values`` (nodes, n), each at its own of n places."""
    inside, each = np.clip(at, nodes[0], nodes[-1]), np.arange(len(at))
    if len(nodes) < 3:
        share = (inside - nodes[0]) / max(nodes[-1] - nodes[0], 1e-300)
        return values[0] + share * (values[-1] - values[0])
    from scipy.interpolate import PchipInterpolator

    piece = np.clip(np.searchsorted(nodes, inside, side="right") - 1, 0, len(nodes) - 2)
    cubic, square, slope, value = PchipInterpolator(nodes, values).c[:, piece, each]
    on = inside - nodes[piece]
    further = np.clip(at - inside, nodes[0] - nodes[1], nodes[-1] - nodes[-2])
    steep = (3.0 * cubic * on + 2.0 * square) * on + slope
    return ((cubic * on + square) * on + slope) * on + value + steep * further
