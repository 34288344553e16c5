"""The whole range: what a resistance means at a temperature, and a small learned rest (docs/whole_range.md).

The thesis's models leave out the ends of the stroke, where resistance moves with temperature and displacement
does not.  Here a heat balance stands beside the resistance (:mod:`.heat_content`), and the estimate is made of both
(:mod:`.whole_range_kernel`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from sma_actuator.base.lookup import row_of
from sma_actuator.base.parameters import parameter
from sma_actuator.base.sections import Wire

from . import orientation, surroundings
from .checks import COUNTS_CONTRACTION, wrong_ranges, wrong_size
from .heat_content import DIRECT, PLAYS_AT, RESTED_AT, THERMAL, resistances_of
from .model import COEFFICIENTS
from .whole_range_kernel import CURVE_TERMS, HIGHEST, LOWEST, OF_EXPECTED, OUT, Numbers, advance, advance_all

_STILL_SEEN = 0.5  #: share of the residual below which the quality says that little of it is left


class WholeRangeModel:
    """The model of one wire; see :class:`sma_actuator.estimation.models.ThermalStrainModel`."""

    def __init__(self, coefficients: WholeRangeCoefficients):
        c = coefficients
        self.stress_range_Pa = tuple(c.stress_range)
        self.displacement_range_m = tuple(c.displacement_range)
        self.stroke_m = tuple(c.stroke)
        n = len(c.feature_centre)
        whitening = np.zeros((n, n))
        whitening[np.tril_indices(n)] = c.novelty
        self._numbers = Numbers(
            resistances=resistances_of(c.hot_resistance, c.cold_resistance, c.stress_range),
            thermal=np.array([*c.thermal, *c.near_surroundings]),
            ends=np.array([c.hot_end, c.cold_end]),
            widths_K=np.array(c.play_widths_K),
            widths_Ohm=np.array(c.play_widths_Ohm),
            limits=np.array(
                [*c.stroke, c.largest_residual, c.novelty_edge, c.spread_floor, c.curve_interval, c.expected_floor]
            ),
            ranges=np.array([c.feature_centre, c.feature_scale, c.feature_low, c.feature_high]),
            whitening=whitening,
            curve=np.array(c.curve),
            linear=np.array(c.linear).reshape(c.learners, -1),
            hidden=_hidden(c.hidden, n),
            layer=_layer(c.bias, c.output),
            widths=np.array([*c.intervals, *(c.expected_within or c.intervals)]).reshape(4, -1),
            martensite=np.array(
                [
                    *(c.cold_wire or (0.0,) * orientation.OF_COLD_WIRE),
                    *(c.other_loads or orientation.FOLLOWS_AT_ONCE),
                    c.cold_wire_rise,
                ]
            ),
            ambient=c.ambient_temperature,
            expected_linear=np.array(c.expected_linear).reshape(-1, len(c.linear) // c.learners),
            expected_hidden=_hidden(c.expected_hidden, n),
            expected_layer=_layer(c.expected_bias, c.expected_output),
            seen=np.zeros(n),
            z=np.zeros(n),
        )
        self._state = np.zeros(PLAYS_AT + n - DIRECT)
        self._oriented = orientation.nothing_known()
        self._around = surroundings.nothing_seen(c.room_counts)
        self._ambient_C = nan  #: as it was measured last
        self._taught = bool(c.expected_bias)
        self.follow_surroundings(True)
        self._usual = row_of((c.cold_wire_stress, c.cold_wire_resistance))
        self.follows_loads = bool(c.cold_wire and c.other_loads)
        self._out = np.zeros(OUT)
        self.longer_m = 0.0
        self.reset()

    def reset(self, power_W: float = nan) -> None:
        """Forget the past: the next sample is that of a wire at rest, in balance with this power; NaN: with its own."""
        self._state[:] = nan
        self._state[RESTED_AT] = power_W
        orientation.forget(self._oriented)
        surroundings.forget(self._around)

    def follow_surroundings(self, follows: bool) -> None:
        """Whether it learns, while it runs, that the wire loses more or less than in the calibration, and that
        the air is not what it is taken for."""
        surroundings.follow(follows and self._taught, self._around)

    @property
    def loses(self) -> float:
        """Heat that the wire loses, over what it lost in the calibration; 1 where nothing speaks for a draught, NaN
        where nothing could."""
        if not self._taught:
            return nan
        other_K = 0.0 if isfinite(self._ambient_C) else nan
        without_K, with_K = (surroundings.off_K(other_K, rise_K, self._around)[0] for rise_K in (0.0, 1.0))
        return 1.0 / (1.0 - min(with_K - without_K, 0.9))

    def doubt(self, displacement_m: np.ndarray) -> np.ndarray:
        """How wide the interval of an estimate is at a place, on the branch where it is wider, over the learners'
        spread."""
        n = self._numbers
        places_m = np.linspace(n.limits[LOWEST], n.limits[HIGHEST], n.widths.shape[1])
        return np.interp(displacement_m, places_m, n.widths[:OF_EXPECTED].max(axis=0))

    def observe(
        self, time_s: float, resistance_Ohm: float, stress_Pa: float, heating: bool, power_W: float, ambient_C: float
    ) -> tuple[float, float, bool]:
        """Advance by one sample: δ [m], half of its 95 % interval [m], and whether the calibration has seen the
        like."""
        out, self._ambient_C = self._out, ambient_C
        advance(
            time=time_s,
            power=power_W,
            ambient=ambient_C,
            resistance=resistance_Ohm,
            stress=stress_Pa,
            heating=heating,
            state=self._state,
            oriented=self._oriented,
            usual=self._usual,
            around=self._around,
            n=self._numbers,
            out=out,
        )
        self.longer_m = float(out[3])
        return float(out[0]), float(out[1]), bool(out[2] > _STILL_SEEN)

    def observe_all(
        self,
        time_s: np.ndarray,
        resistance_Ohm: np.ndarray,
        stress_Pa: np.ndarray,
        heating: np.ndarray,
        power_W: np.ndarray,
        ambient_C: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The same of n samples, arrays of shape (n,), by the same kernel."""
        out = np.zeros((len(time_s), OUT))
        advance_all(
            time=time_s,
            power=power_W,
            ambient=ambient_C,
            resistance=resistance_Ohm,
            stress=stress_Pa,
            heating=heating,
            state=self._state,
            oriented=self._oriented,
            usual=self._usual,
            around=self._around,
            n=self._numbers,
            out=out,
        )
        if len(out):
            self.longer_m, self._ambient_C = float(out[-1, 3]), float(ambient_C[-1])
        return out[:, 0].copy(), out[:, 1].copy(), out[:, 2] > _STILL_SEEN


def _hidden(weights: tuple[float, ...], features: int) -> np.ndarray:
    """Weights that are given unit by unit, as the kernel has them."""
    return np.ascontiguousarray(np.array(weights).reshape(-1, features).T)


def _layer(bias: tuple[float, ...], output: tuple[float, ...]) -> np.ndarray:
    return np.array([bias, output, (0.0,) * len(bias)])


@COEFFICIENTS.register("whole_range")
@dataclass(frozen=True, slots=True)
class WholeRangeCoefficients:
    """Heat balance, physical curve and learned residual of one particular wire; features are in the order
    R [Ω], σ [Pa], θ [K], plays of θ [K], plays of R [Ω]."""

    calibrated_length: float = parameter(
        description="length of the wire the coefficients were fitted on", unit="m", lo=0.005, hi=20.0
    )
    calibrated_diameter: float = parameter(description="its diameter", unit="m", lo=10e-6, hi=2e-3)
    calibrated_form: str = parameter("", "its form, where it is no straight wire (docs/coils.md)", optional=True)
    thermal: tuple[float, ...] = parameter(
        description="time constant [s], growth of the heat loss [1/K], heat loss [W/K], λ_R [K/Ω], λ_X [K], "
        "λ_θ [K/Ω], shift of wide and of narrow plays with stress [K/Pa]"
    )
    near_surroundings: tuple[float, ...] = parameter(
        (0.0, 1.0), "share of the wire's rise that they take in balance, and their time constant [s]"
    )
    hot_end: tuple[float, ...] = parameter(description="δ where all is austenite, quadratic in stress [Pa]", unit="m")
    cold_end: tuple[float, ...] = parameter(description="δ where it is cold, likewise", unit="m")
    hot_resistance: tuple[float, ...] = parameter(
        (0.0, 0.0), "resistance where all is austenite, a line in stress [Pa]", unit="Ω", optional=True
    )
    cold_resistance: tuple[float, ...] = parameter(
        (1.0, 0.0), "resistance where it is cold, likewise", unit="Ω", optional=True
    )
    cold_wire: tuple[float, ...] = parameter(
        (),
        "the cold wire as a strain gauge: Ω per m; how far off, rms, its resistance is, and a reading of it [Ω]",
        optional=True,
    )
    other_loads: tuple[float, ...] = parameter(
        (),
        "what stays of a cold wire's being longer under a load that has become less, and to what share of its stroke a "
        "heavier one turns it at the least; none where its logs do not show it",
        "1",
        0.0,
        1.0,
        optional=True,
    )
    cold_wire_stress: tuple[float, ...] = parameter(
        (), "stresses of the resistances below", "Pa", -1e9, 1e9, optional=True
    )
    cold_wire_resistance: tuple[float, ...] = parameter(
        (), "resistance of the wire that has cooled under these", "Ω", 0.0, 1e6, optional=True
    )
    cold_wire_rise: float = parameter(
        nan, "how much warmer than its surroundings it was then", "K", 0.0, 100.0, optional=True
    )
    ambient_temperature: float = parameter(
        description="temperature of the surroundings where none is measured", unit="°C", lo=-60.0, hi=100.0
    )
    room_counts: tuple[float, ...] = parameter(
        surroundings.AS_MUCH,
        "what a kelvin of other surroundings counts for the apparent temperature, and the standard deviation of that",
        "1",
        0.0,
        10.0,
        optional=True,
    )
    expected_linear: tuple[float, ...] = parameter(
        (),
        "learned: the apparent temperature by all else, over its mean, as model.linear; none where it was not",
        "K",
        optional=True,
    )
    expected_hidden: tuple[float, ...] = parameter((), "learned: the weights of its tanh units", "1", optional=True)
    expected_bias: tuple[float, ...] = parameter((), "learned: their biases", "1", optional=True)
    expected_output: tuple[float, ...] = parameter((), "learned: the weight of each", "K", optional=True)
    expected_within: tuple[float, ...] = parameter(
        (),
        "how far off that is, one standard deviation over the spread of the learners and its floor, at equally spaced "
        "displacements, cooling, then heating",
        "1",
        1e-6,
        optional=True,
    )
    expected_floor: float = parameter(
        1.0, "what is added to the spread of those learners", "K", 1e-6, 1e6, optional=True
    )
    play_widths_K: tuple[float, ...] = parameter(description="half-widths of the plays in temperature", unit="K")
    play_widths_Ohm: tuple[float, ...] = parameter(description="half-widths of the plays in resistance", unit="Ω")
    feature_centre: tuple[float, ...] = parameter(description="mean of each feature in the calibration")
    feature_scale: tuple[float, ...] = parameter(description="its standard deviation", lo=1e-30)
    feature_low: tuple[float, ...] = parameter(description="what it was at least, less a tenth of its range")
    feature_high: tuple[float, ...] = parameter(description="what it was at most, and a tenth of its range")
    novelty: tuple[float, ...] = parameter(
        description="lower triangle, row by row, that makes features white and their 95 % distance 1"
    )
    novelty_edge: float = parameter(description="novelty beyond which the residual fades", unit="1", lo=1e-3, hi=1e6)
    curve: tuple[float, ...] = parameter(description="physical curve, quadratic in scaled R, σ, θ", unit="m")
    learners: int = parameter(3, "learners, of which the mean is taken", "1", 1, 100)
    linear: tuple[float, ...] = parameter(
        description="learned: the same and a line in the plays, learner after learner", unit="m"
    )
    hidden: tuple[float, ...] = parameter(
        description="learned: weights of the tanh units, learner after learner, unit by unit", unit="1"
    )
    bias: tuple[float, ...] = parameter(description="learned: its biases", unit="1")
    output: tuple[float, ...] = parameter(description="learned: weight of each tanh", unit="m")
    largest_residual: float = parameter(description="bound of the residual", unit="m", lo=1e-12, hi=1.0)
    intervals: tuple[float, ...] = parameter(
        description="half of the 95 % interval over the spread of the learners and its floor, at equally spaced "
        "displacements over the range, cooling, then heating",
        unit="1",
        lo=0.0,
    )
    spread_floor: float = parameter(
        description="what is added to the spread of the learners for the interval", unit="m", lo=1e-12, hi=1.0
    )
    curve_interval: float = parameter(
        description="half of the 95 % interval of the physical curve alone", unit="m", lo=0.0, hi=10.0
    )
    stress_range: tuple[float, ...] = parameter(
        description="lowest and highest stress of the calibration", unit="Pa", lo=-1e9, hi=1e9
    )
    displacement_range: tuple[float, ...] = parameter(
        description="where the wire can be driven to, whatever hangs on it", unit="m", lo=-10.0, hi=10.0
    )
    stroke: tuple[float, ...] = parameter(
        description="the stroke that the calibration has seen, both ends included", unit="m", lo=-10.0, hi=10.0
    )

    def mismatches(self, wire: Wire) -> list[str]:
        """Why these coefficients do not suit ``wire``."""
        return [
            *wrong_size(self.calibrated_length, self.calibrated_diameter, self.calibrated_form, wire),
            *wrong_ranges(
                stress_range=self.stress_range, displacement_range=self.displacement_range, stroke=self.stroke
            ),
            *(self._wrong_lengths() or self._wrong_sense()),
        ]

    @property
    def resistance_rises(self) -> bool:
        """Whether the wire's resistance rises as it contracts."""
        hot_Ohm, cold_Ohm = (self._over_stress(end) for end in (self.hot_resistance, self.cold_resistance))
        return bool((hot_Ohm > cold_Ohm).all())

    def _over_stress(self, polynomial: tuple[float, ...]) -> np.ndarray:
        """Its values at the lowest and the highest stress."""
        return np.polynomial.polynomial.polyval(np.array(self.stress_range), polynomial)

    def _wrong_sense(self) -> list[str]:
        """The physical curve goes up from the hot and little resistant wire to the cold and resistant one; or down with
        resistance, where the hot one is the more resistant.

        Of a wire that was on one spring alone it may go by the load, which tells that spring's length.
        """
        by_resistance, by_temperature = self.curve[1], self.curve[DIRECT]
        hot, cold, hot_m, cold_m = (
            self._over_stress(end) for end in (self.hot_resistance, self.cold_resistance, self.hot_end, self.cold_end)
        )
        problems = []
        if self.resistance_rises:
            by_resistance = -by_resistance
        if not (cold_m > hot_m).all():
            problems.append(f"model.hot_end: not below model.cold_end, {COUNTS_CONTRACTION}")
        elif any(self.hot_end[1:]) and not by_resistance > by_temperature:
            problems.append(f"model.curve: displacement falls from the hot wire to the cold one, {COUNTS_CONTRACTION}")
        if not (self.resistance_rises or (cold > hot).all()):
            problems.append(
                "model.cold_resistance: not on one side of model.hot_resistance over all of model.stress_range"
            )
        return problems

    def _wrong_lengths(self) -> list[str]:
        plays = len(self.play_widths_K) + len(self.play_widths_Ohm)
        n, m = DIRECT + plays, len(self.bias)
        taught = bool(self.expected_bias)
        wanted = {
            "thermal": THERMAL,
            "near_surroundings": 2,
            "hot_end": 3,
            "cold_end": 3,
            "hot_resistance": 2,
            "cold_resistance": 2,
            "feature_centre": n,
            "feature_scale": n,
            "feature_low": n,
            "feature_high": n,
            "novelty": n * (n + 1) // 2,
            "curve": CURVE_TERMS,
            "linear": self.learners * (CURVE_TERMS + plays),
            "hidden": m * n,
            "output": m,
            "room_counts": 2,
            "expected_linear": self.learners * (CURVE_TERMS + plays) if taught else 0,
            "expected_hidden": len(self.expected_bias) * n,
            "expected_output": len(self.expected_bias),
            "expected_within": len(self.intervals) if taught else 0,
            "cold_wire": orientation.OF_COLD_WIRE if self.cold_wire else 0,
            "other_loads": len(orientation.FOLLOWS_AT_ONCE) if self.other_loads else 0,
            "cold_wire_resistance": len(self.cold_wire_stress),
        }
        problems = [
            f"model.{name}: {len(getattr(self, name))} numbers, but {count} are wanted with these plays and biases"
            for name, count in wanted.items()
            if len(getattr(self, name)) != count
        ]
        problems += [
            f"model.{name}: {len(biases)} numbers, which are not shared equally by {self.learners} learners"
            for name, biases in (("bias", self.bias), ("expected_bias", self.expected_bias))
            if len(biases) % self.learners
        ]
        stresses = self.cold_wire_stress
        if self.cold_wire and (not stresses or any(np.diff(stresses) <= 0.0)):
            problems.append("model.cold_wire_stress: model.cold_wire wants one stress at least, each above the last")
        if not taught and len(self.room_counts) == 2 and self.room_counts[1] > 0.0:
            problems.append("model.room_counts: its second number is 0 where no model.expected_bias tells it")
        if len(self.intervals) % 2 or len(self.intervals) < 4:
            problems.append(f"model.intervals: {len(self.intervals)} numbers, but two rows of equal length are wanted")
        return problems

    def build(self, wire: Wire) -> WholeRangeModel:
        """The model of the wire the coefficients were fitted on."""
        return WholeRangeModel(self)
