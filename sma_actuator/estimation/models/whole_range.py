"""The whole range: what a resistance means at a temperature, and a small learned rest (docs/whole_range.md).

The thesis's models leave out the ends of the stroke, where resistance moves with temperature and displacement
does not.  Here a heat balance stands beside the resistance.  It keeps the wire's *heat content* as a temperature,

    E = T - λ_R R - λ_X X,     dE/dt = (P/h - G (x - s) / (1 - a)) / τ,     x = T - T_ambient,     G = 1 + g max(x, 0),
                               ds/dt = (a x - s) / τ_s,

where s is how far its near surroundings have warmed up: a tube, a coating, the clamps.  In balance they take a share a
of the wire's rise; with a = 0 the air begins at the wire.  What is known of wires is a small share.  E holds
the latent heat in λ_R and λ_X, where X is how far δ lies between the ends of the stroke at the present stress.
E is an integral of power: δ enters only through the heat lost, so that an error of δ cannot run in a circle with the
temperature that is made of it.  What the estimate sees is

* R as it would be under a usual load (a load that stretches the wire raises its resistance though nothing transforms),
  σ and an apparent temperature θ = E + λ_θ R,
* how far θ, less what stress adds to it, has come from its last turns: plays of several widths [K],
* how far R has come from its own: plays of several widths [Ω].

A *physical curve*, the mixture rule of the phases solved for δ, is a quadratic in (R, σ, θ): a resistance
corrected for temperature.  A *residual*, smooth and bounded, is learned for what is left: the mean of a few learners
with one layer of tanh each.  How far they are apart says how sure they are.
Outside what the calibration has seen it fades away, and the estimate says so.

Everything is one kernel for one sample; a log is a loop over it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, hypot, isfinite, nan, sqrt, tanh
from typing import Any, NamedTuple

import numpy as np

from sma_actuator.base.balance import gains
from sma_actuator.base.jit import Floats, jit
from sma_actuator.base.lookup import row_of
from sma_actuator.base.parameters import parameter
from sma_actuator.base.sections import ThermalParameters, Wire

from . import orientation
from .checks import COUNTS_CONTRACTION, wrong_ranges, wrong_size
from .model import COEFFICIENTS

DIRECT = 3  #: features that are no plays: R, σ, θ
STRESS = 1  #: of them
CURVE_TERMS = 10  #: of a quadratic in them
(
    TIME_CONSTANT_s,
    LOSS_GROWTH_1_K,
    HEAT_LOSS_W_K,
    LATENT_K_Ohm,
    LATENT_K,
    APPARENT_K_Ohm,
    WIDE_K_Pa,
    NARROW_K_Pa,
    NEAR_SHARE,
    NEAR_TIME_s,
) = range(10)
THERMAL = 8  #: numbers of the heat balance, in this order, before those of the near surroundings
NARROW = 2  #: so many of the plays in temperature, the first, are shifted by stress as the narrow loop is
#: Half-widths; loops of Ni-Ti and Ni-Ti-Cu are 4 to 25 K wide, and where the wire lies in one, with an intermediate
#: phase on the way, shows only where the widest play is wider than the way back through it.
PLAYS_K = (1.5, 3.0, 5.0, 8.0, 12.0, 18.0)
PLAYS_OF_RANGE = (0.03, 0.10, 0.25)  #: half-widths of the plays in resistance, as shares of its range
#: What is known of wires before a log is seen: time constant (share of C/h), growth of the loss, λ_R (K per range of
#: R), λ_X (latent over specific heat, 20 to 35 K), λ_θ, 1/slopes (K/MPa); of the near surroundings the share and the
#: time constant (over C/h).
KNOWN = np.array([1.0, 0.002, 3.0, 26.0, 24.0, 0.125, 0.07, 0.0, 1.0])
# What is remembered: time, heat content, resistance and X of the sample before, warmth of the near surroundings, the
# power it rested at before the first one (NaN: that one's own), then the plays.
_TIME, _HEAT, _RESISTANCE, _SHARE, _NEAR, _RESTED, _PLAYS = range(7)
NEAR = 7  #: where the numbers of the near surroundings begin
REMEMBERED = 6  #: beside the plays
# Limits: δ at the two ends of what was seen, size of the residual, novelty beyond which it fades, what is added to the
# learners' spread before it counts, half-width of the interval of the physical curve alone.
_LOWEST, _HIGHEST, _LARGEST, _EDGE, _FLOOR, _CURVE_WIDTH = range(6)
_START_PASSES = 5
_PER_RANGE = 4.0  #: a feature that lies beyond its range by a quarter of it is as strange as twice the edge
_STILL_SEEN = 0.5  #: share of the residual below which the quality says that little of it is left


class Numbers(NamedTuple):
    """The coefficients as the kernels want them, and room to work in."""

    resistances: np.ndarray  #: as :func:`resistances_of` has them
    thermal: np.ndarray  #: the heat balance, in the order of the indices above
    ends: np.ndarray  #: (2, 3): hot and cold end of the stroke, quadratics in stress
    widths_K: np.ndarray  #: half-widths of the plays of temperature
    widths_Ohm: np.ndarray  #: and of resistance
    limits: np.ndarray  #: in the order of the indices above
    centre: np.ndarray  #: of each feature
    scale: np.ndarray
    low: np.ndarray  #: where the calibration has seen it
    high: np.ndarray
    whitening: np.ndarray  #: lower triangle, (features, features)
    curve: np.ndarray  #: the physical curve, (CURVE_TERMS,)
    linear: np.ndarray  #: of each learner, (learners, CURVE_TERMS + plays)
    hidden: np.ndarray  #: (features, units): neighbours in memory are reckoned at once
    bias: np.ndarray  #: (units,)
    output: np.ndarray  #: (units,)
    widths: np.ndarray  #: of the interval on either branch, (2, places)
    martensite: np.ndarray  #: how long its martensite is, and what resistance says of that (:mod:`.orientation`)
    seen: np.ndarray  #: room for the features of a sample
    z: np.ndarray  #: for what is made of them
    units: np.ndarray  #: and for the tanh units


def at_usual_load(resistance: Any, stress: Any, resistances: np.ndarray) -> Any:
    """The resistance [Ω] that the wire would have under the usual load, as far between the hot one's and the cold one's
    as it is under this stress; of one sample or of n."""
    hot = resistances[0] + stress * resistances[1]
    cold = resistances[2] + stress * resistances[3]
    return resistances[4] + (resistance - hot) * (resistances[5] / (cold - hot))


_at_usual_load = jit(at_usual_load)  # of one sample


@jit
def heat_rise(power: float, thermal: np.ndarray) -> float:
    """Temperature above ambient [K] at which the wire loses ``power``."""
    rise = power / thermal[HEAT_LOSS_W_K]
    growth = thermal[LOSS_GROWTH_1_K]
    if growth > 0.0 and rise > 0.0:
        rise = (sqrt(1.0 + 4.0 * growth * rise) - 1.0) / (2.0 * growth)
    return rise


@jit
def share_of_stroke(displacement: float, stress: float, ends: np.ndarray) -> float:
    """How far δ lies between the hot end (0) and the cold end (1) at a stress; ``ends`` (2, 3), quadratics in
    stress."""
    hot, cold = orientation.ends_m(stress, ends)
    return min(max((displacement - hot) / (cold - hot), 0.0), 1.0)


@jit
def at_rest(
    time: float, power: float, ambient: float, resistance: float, share: float, thermal: np.ndarray, state: np.ndarray
) -> None:
    """Start in balance with ``power`` at a share of the stroke; the plays start with the first sample."""
    rise = heat_rise(power, thermal)
    temperature = ambient + rise
    state[_NEAR] = thermal[NEAR_SHARE] * rise
    state[_TIME] = time
    state[_HEAT] = temperature - thermal[LATENT_K_Ohm] * resistance - thermal[LATENT_K] * share
    state[_RESISTANCE] = resistance
    state[_SHARE] = share
    state[_PLAYS] = nan


@jit
def _temperature(thermal: np.ndarray, state: np.ndarray) -> float:
    """Of the wire at the sample before [°C]."""
    temperature: float = state[_HEAT] + thermal[LATENT_K_Ohm] * state[_RESISTANCE] + thermal[LATENT_K] * state[_SHARE]
    return temperature


@jit
def features(
    time: float,
    power: float,
    ambient: float,
    resistance: float,
    stress: float,
    thermal: np.ndarray,
    widths_K: np.ndarray,
    widths_Ohm: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
) -> None:
    """What the estimate sees of one sample, ``out`` (DIRECT + plays,); all of ``state`` but the share X moves on.

    That of the sample before is in ``state``, where the caller puts it.
    """
    step = max(time - state[_TIME], 0.0)
    temperature = _temperature(thermal, state)
    wire, near = gains(
        temperature - ambient,
        state[_NEAR],
        power / thermal[HEAT_LOSS_W_K],
        step,
        thermal[TIME_CONSTANT_s],
        thermal[NEAR_SHARE],
        thermal[NEAR_TIME_s],
        thermal[LOSS_GROWTH_1_K],
    )
    state[_HEAT] += wire
    state[_NEAR] += near
    state[_TIME] = time
    state[_RESISTANCE] = resistance
    apparent = state[_HEAT] + thermal[APPARENT_K_Ohm] * resistance
    out[0] = resistance
    out[1] = stress
    out[2] = apparent
    first = state[_PLAYS] != state[_PLAYS]  # NaN
    count = len(widths_K)
    for k in range(count):
        shifted = apparent - stress * (thermal[NARROW_K_Pa] if k < NARROW else thermal[WIDE_K_Pa])
        if first:  # at rest the wire has come from where it was hotter
            state[_PLAYS + k] = shifted + widths_K[k]
        state[_PLAYS + k] = min(max(state[_PLAYS + k], shifted - widths_K[k]), shifted + widths_K[k])
        out[DIRECT + k] = shifted - state[_PLAYS + k]
    for k in range(len(widths_Ohm)):
        place = _PLAYS + count + k
        if first:
            state[place] = resistance
        state[place] = min(max(state[place], resistance - widths_Ohm[k]), resistance + widths_Ohm[k])
        out[DIRECT + count + k] = resistance - state[place]


@jit
def features_all(
    time: np.ndarray,
    power: np.ndarray,
    ambient: np.ndarray,
    resistance: np.ndarray,
    stress: np.ndarray,
    share: np.ndarray,
    first: np.ndarray,
    thermal: np.ndarray,
    widths_K: np.ndarray,
    widths_Ohm: np.ndarray,
    state: np.ndarray,
    out: np.ndarray,
) -> None:
    """``features`` of n samples whose share of the stroke is known; a log begins where ``first``."""
    for i in range(len(time)):
        if first[i]:
            at_rest(
                time=time[i],
                power=power[i],
                ambient=ambient[i],
                resistance=resistance[i],
                share=share[i],
                thermal=thermal,
                state=state,
            )
        features(
            time=time[i],
            power=power[i],
            ambient=ambient[i],
            resistance=resistance[i],
            stress=stress[i],
            thermal=thermal,
            widths_K=widths_K,
            widths_Ohm=widths_Ohm,
            state=state,
            out=out[i],
        )
        state[_SHARE] = share[i]


@jit
def _quadratic(z: np.ndarray, c: np.ndarray) -> float:
    """A quadratic in the first three of ``z``, of :data:`CURVE_TERMS` coefficients."""
    value: float = (
        c[0]
        + c[1] * z[0]
        + c[2] * z[1]
        + c[3] * z[2]
        + c[4] * z[0] * z[0]
        + c[5] * z[1] * z[1]
        + c[6] * z[2] * z[2]
        + c[7] * z[0] * z[1]
        + c[8] * z[0] * z[2]
        + c[9] * z[1] * z[2]
    )
    return value


@jit
def _learned(n: Numbers, out: np.ndarray) -> None:
    """What was learned, into ``out``: the mean of the learners, and how far they are apart.

    Each has a quadratic in what is seen directly, a line in the plays, and its share of the tanh units.
    """
    z, linear, hidden, units = n.z, n.linear, n.hidden, n.units
    learners = linear.shape[0]
    each = len(units) // learners
    for k in range(len(units)):
        units[k] = n.bias[k]  # one by one: to copy it whole takes two seconds more to compile
    for j in range(len(z)):
        for k in range(len(units)):
            units[k] += hidden[j, k] * z[j]
    for k in range(len(units)):  # tanh is four times dearer, and no truer where 1 is added up
        units[k] = 1.0 - 2.0 / (exp(2.0 * units[k]) + 1.0)
    mean = 0.0
    square = 0.0
    for i in range(learners):
        value = _quadratic(z, linear[i])
        for j in range(DIRECT, len(z)):
            value += linear[i, CURVE_TERMS + j - DIRECT] * z[j]
        for k in range(i * each, (i + 1) * each):
            value += n.output[k] * units[k]
        change = value - mean
        mean += change / (i + 1)
        square += change * (value - mean)
    out[0] = mean
    out[1] = sqrt(square / learners)


@jit
def _strangeness(n: Numbers) -> float:
    """How unlike the calibration a sample is: above 1 where it lies beyond all that was seen.

    By the distance in features made white, and by each feature's own range.
    """
    square = 0.0
    beyond = 0.0
    for i in range(len(n.z)):
        along = 0.0
        for j in range(i + 1):
            along += n.whitening[i, j] * n.z[j]
        square += along * along
        beyond = max(beyond, max(n.low[i] - n.seen[i], n.seen[i] - n.high[i]) / (n.high[i] - n.low[i]))
    return max(sqrt(square) / n.limits[_EDGE], 1.0 + _PER_RANGE * beyond if beyond > 0.0 else 0.0)


@jit
def _half_width(displacement: float, heating: bool, n: Numbers) -> float:
    """Half of the 95 % interval on a branch, in units of the learners' spread; linear between equally spaced places."""
    widths = n.widths
    last = widths.shape[1] - 1
    along = (displacement - n.limits[_LOWEST]) / (n.limits[_HIGHEST] - n.limits[_LOWEST])
    place = min(max(along, 0.0), 1.0) * last
    below = min(int(place), last - 1)
    row = 1 if heating else 0
    width: float = widths[row, below] + (place - below) * (widths[row, below + 1] - widths[row, below])
    return width


@jit
def _estimate(heating: bool, n: Numbers, out: np.ndarray) -> None:
    """δ, half of its 95 % interval and the share of the residual in it, into ``out``, from the features ``n.seen``."""
    for j in range(len(n.seen)):
        n.z[j] = (n.seen[j] - n.centre[j]) / n.scale[j]
    lowest = n.limits[_LOWEST]
    highest = n.limits[_HIGHEST]
    slack = 0.05 * (highest - lowest)
    physical = min(max(_quadratic(n.z, n.curve), lowest - slack), highest + slack)
    _learned(n, out)
    residual = n.limits[_LARGEST] * tanh((out[0] - physical) / n.limits[_LARGEST])
    spread = out[1]
    strangeness = _strangeness(n)
    share = 1.0 if strangeness <= 1.0 else exp(2.0 * (1.0 - strangeness))
    displacement = min(max(physical + share * residual, lowest - slack), highest + slack)
    width = _half_width(displacement, heating, n) * (n.limits[_FLOOR] + spread)
    width += max(lowest - displacement, displacement - highest, 0.0)  # back to where a wire has been
    out[0] = displacement
    out[1] = share * width + (1.0 - share) * max(n.limits[_CURVE_WIDTH], width)
    out[2] = share


@jit
def _of_other_loads(
    resistance: float, stress: float, rests_cold: bool, first: bool, oriented: Floats, usual: Floats, n: Numbers
) -> float:
    """What of the resistance is of martensite that formed under another load [Ω], which a cold wire at rest tells."""
    if rests_cold and (first or orientation.told(oriented)):
        orientation.tell(resistance, stress, usual, n.ends, n.martensite, oriented)
    if first and not orientation.told(oriented):
        return 0.0
    return n.martensite[orientation.OHM_PER_m] * orientation.longer_m(stress, n.ends, n.martensite, oriented)


@jit
def _add_other_loads(share: float, stress: float, first: bool, oriented: Floats, n: Numbers, out: np.ndarray) -> None:
    """How much longer that makes the wire, and how sure that is, into ``out``."""
    if first and not orientation.told(oriented):
        orientation.begin(share, 0.0, 0.0, stress, n.ends, oriented)
    orientation.follow(share, stress, n.ends, n.martensite, oriented)
    out[3] = orientation.longer_m(stress, n.ends, n.martensite, oriented)
    out[0] += out[3]
    by_chance_m, either_way_m = orientation.unsure_m(stress, n.ends, n.martensite, oriented)
    out[1] = hypot(out[1], by_chance_m) + either_way_m


@jit
def advance(
    time: float,
    power: float,
    ambient: float,
    resistance: float,
    stress: float,
    heating: bool,
    state: np.ndarray,
    oriented: Floats,
    usual: Floats,
    n: Numbers,
    out: np.ndarray,
) -> None:
    """One sample: δ [m], half of its 95 % interval [m], the share of the residual, and how much longer the wire is than
    if all of it had formed under its load [m], into ``out`` (4,).

    ``oriented``: the memory of :mod:`.orientation`; ``usual``: a cold wire's resistance by its stress.
    """
    first = state[_TIME] != state[_TIME]  # NaN
    rested = state[_RESTED] if state[_RESTED] == state[_RESTED] else power
    remembers = n.martensite[orientation.OHM_PER_m] > 0.0
    if remembers:
        rise = heat_rise(rested, n.thermal) if first else _temperature(n.thermal, state) - ambient
        warms = heat_rise(power, n.thermal) - rise  # more than at rest: then its resistance is its heat's too
        rests_cold = rise < orientation.COLD_K and abs(warms) < orientation.RESTS_K
        resistance -= _of_other_loads(resistance, stress, rests_cold, first, oriented, usual, n)
    resistance = _at_usual_load(resistance, stress, n.resistances)
    share = 1.0
    # At rest, in the place that agrees with the temperature that is made of it; once in the text, as it is compiled
    # wherever it stands.
    for _ in range(_START_PASSES + 1 if first else 1):
        if first:
            at_rest(
                time=time,
                power=rested,
                ambient=ambient,
                resistance=resistance,
                share=share,
                thermal=n.thermal,
                state=state,
            )
        features(
            time=time,
            power=power,
            ambient=ambient,
            resistance=resistance,
            stress=stress,
            thermal=n.thermal,
            widths_K=n.widths_K,
            widths_Ohm=n.widths_Ohm,
            state=state,
            out=n.seen,
        )
        _estimate(heating, n, out)
        share = share_of_stroke(out[0], stress, n.ends)
    state[_SHARE] = share
    if remembers:
        _add_other_loads(share, stress, first, oriented, n, out)


@jit
def advance_all(
    time: np.ndarray,
    power: np.ndarray,
    ambient: np.ndarray,
    resistance: np.ndarray,
    stress: np.ndarray,
    heating: np.ndarray,
    state: np.ndarray,
    oriented: Floats,
    usual: Floats,
    n: Numbers,
    out: np.ndarray,
) -> None:
    """``advance`` over samples, ``out`` (samples, 4)."""
    for i in range(len(time)):
        advance(
            time=time[i],
            power=power[i],
            ambient=ambient[i],
            resistance=resistance[i],
            stress=stress[i],
            heating=heating[i],
            state=state,
            oriented=oriented,
            usual=usual,
            n=n,
            out=out[i],
        )


class WholeRangeModel:
    """The model of one wire; see :class:`sma_actuator.estimation.models.ThermalStrainModel`."""

    def __init__(self, coefficients: WholeRangeCoefficients):
        c = coefficients
        self.stress_range_Pa = tuple(c.stress_range)
        self.displacement_range_m = tuple(c.displacement_range)
        self.stroke_m = tuple(c.stroke)
        self._ambient_C = c.ambient_temperature
        n = len(c.feature_centre)
        whitening = np.zeros((n, n))
        whitening[np.tril_indices(n)] = c.novelty
        self._numbers = Numbers(
            resistances=resistances_of(c.hot_resistance, c.cold_resistance, c.stress_range),
            thermal=np.array([*c.thermal, *c.near_surroundings]),
            ends=np.array([c.hot_end, c.cold_end]),
            widths_K=np.array(c.play_widths_K),
            widths_Ohm=np.array(c.play_widths_Ohm),
            limits=np.array([*c.stroke, c.largest_residual, c.novelty_edge, c.spread_floor, c.curve_interval]),
            centre=np.array(c.feature_centre),
            scale=np.array(c.feature_scale),
            low=np.array(c.feature_low),
            high=np.array(c.feature_high),
            whitening=whitening,
            curve=np.array(c.curve),
            linear=np.array(c.linear).reshape(c.learners, -1),
            hidden=np.ascontiguousarray(np.array(c.hidden).reshape(len(c.bias), n).T),
            bias=np.array(c.bias),
            output=np.array(c.output),
            widths=np.array(c.intervals).reshape(2, -1),
            martensite=np.array(
                [*(c.cold_wire or (0.0,) * orientation.OF_COLD_WIRE), *(c.other_loads or orientation.FOLLOWS_AT_ONCE)]
            ),
            seen=np.zeros(n),
            z=np.zeros(n),
            units=np.zeros(len(c.bias)),
        )
        self._state = np.zeros(_PLAYS + n - DIRECT)
        self._oriented = orientation.nothing_known()
        self._usual = row_of((c.cold_wire_stress, c.cold_wire_resistance))
        self.follows_loads = bool(c.cold_wire and c.other_loads)
        self._out = np.zeros(4)
        self.longer_m = 0.0
        self.reset()

    def reset(self, power_W: float = nan) -> None:
        """Forget the past: the next sample is that of a wire at rest, in balance with this power; NaN: with its own."""
        self._state[:] = nan
        self._state[_RESTED] = power_W
        orientation.forget(self._oriented)

    def doubt(self, displacement_m: np.ndarray) -> np.ndarray:
        """How wide the interval of an estimate is at a place, on the branch where it is wider, over the learners'
        spread."""
        n = self._numbers
        places_m = np.linspace(n.limits[_LOWEST], n.limits[_HIGHEST], n.widths.shape[1])
        return np.interp(displacement_m, places_m, n.widths.max(axis=0))

    def observe(
        self, time_s: float, resistance_Ohm: float, stress_Pa: float, heating: bool, power_W: float, ambient_C: float
    ) -> tuple[float, float, bool]:
        """Advance by one sample: δ [m], half of its 95 % interval [m], and whether the calibration has seen the
        like."""
        ambient_C = ambient_C if isfinite(ambient_C) else self._ambient_C
        out = self._out
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
        out = np.zeros((len(time_s), 4))
        ambient_C = np.where(np.isfinite(ambient_C), ambient_C, self._ambient_C)
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
            n=self._numbers,
            out=out,
        )
        if len(out):
            self.longer_m = float(out[-1, 3])
        return out[:, 0].copy(), out[:, 1].copy(), out[:, 2] > _STILL_SEEN


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
    ambient_temperature: float = parameter(
        description="temperature of the surroundings where none is measured", unit="°C", lo=-60.0, hi=100.0
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

    def _wrong_sense(self) -> list[str]:
        """The physical curve goes up from the hot and little resistant wire to the cold and resistant one."""
        by_resistance, by_temperature = self.curve[1], self.curve[DIRECT]
        hot, cold = (
            np.polynomial.polynomial.polyval(np.array(self.stress_range), end)
            for end in (self.hot_resistance, self.cold_resistance)
        )
        problems = []
        if not by_resistance > by_temperature:
            problems.append(f"model.curve: displacement falls from the hot wire to the cold one, {COUNTS_CONTRACTION}")
        if not (cold > hot).all():
            problems.append("model.cold_resistance: not above model.hot_resistance over all of model.stress_range")
        return problems

    def _wrong_lengths(self) -> list[str]:
        plays = len(self.play_widths_K) + len(self.play_widths_Ohm)
        n, m = DIRECT + plays, len(self.bias)
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
            "cold_wire": orientation.OF_COLD_WIRE if self.cold_wire else 0,
            "other_loads": len(orientation.FOLLOWS_AT_ONCE) if self.other_loads else 0,
            "cold_wire_resistance": len(self.cold_wire_stress),
        }
        problems = [
            f"model.{name}: {len(getattr(self, name))} numbers, but {count} are wanted with these plays and biases"
            for name, count in wanted.items()
            if len(getattr(self, name)) != count
        ]
        if m % self.learners:
            problems.append(f"model.bias: {m} numbers, which are not shared equally by {self.learners} learners")
        stresses = self.cold_wire_stress
        if self.cold_wire and (not stresses or any(np.diff(stresses) <= 0.0)):
            problems.append("model.cold_wire_stress: model.cold_wire wants one stress at least, each above the last")
        if len(self.intervals) % 2 or len(self.intervals) < 4:
            problems.append(f"model.intervals: {len(self.intervals)} numbers, but two rows of equal length are wanted")
        return problems

    def build(self, wire: Wire) -> WholeRangeModel:
        """The model of the wire the coefficients were fitted on."""
        return WholeRangeModel(self)


def resistances_of(hot: Sequence[float], cold: Sequence[float], stress_Pa: Sequence[float]) -> np.ndarray:
    """What :func:`at_usual_load` goes by: the hot and the cold wire's resistance [Ω], lines in stress [Pa], then the
    hot one's and what is between both in the middle of the stresses, which is the usual load."""
    usual_Pa = 0.5 * (stress_Pa[0] + stress_Pa[1])
    hot_Ohm, cold_Ohm = (float(np.polynomial.polynomial.polyval(usual_Pa, end)) for end in (hot, cold))
    return np.array([*hot, *cold, hot_Ohm, cold_Ohm - hot_Ohm])


def known_of(thermal: ThermalParameters) -> np.ndarray:
    """What is known of a wire before the model sees a log: of such wires, and of its own near surroundings."""
    known = KNOWN.copy()
    if thermal.near_share > 0.0:
        known[NEAR:] = thermal.near_share, thermal.near_time * thermal.heat_loss / thermal.heat_capacity
    return known


def thermal_numbers(known: np.ndarray, thermal: ThermalParameters, span_Ohm: float) -> np.ndarray:
    """The heat balance for the kernels, from numbers in units of what is known; ``span_Ohm``: range of the
    resistance."""
    time_constant_s = thermal.heat_capacity / thermal.heat_loss
    out = np.empty(THERMAL + 2)
    out[:] = (
        known[0] * time_constant_s,
        known[1],
        thermal.heat_loss,
        known[2] / span_Ohm,
        known[3],
        known[4] / span_Ohm,
        known[5] * 1e-6,
        known[6] * 1e-6,
        known[7],
        known[8] * time_constant_s,
    )
    return out


def usual_heat_balance(thermal: ThermalParameters, span_Ohm: float) -> np.ndarray:
    """The heat balance as far as it is known before the model sees a log."""
    return thermal_numbers(known_of(thermal), thermal, span_Ohm)
