"""The kernel of the whole-range model: from what is seen of a wire's resistance and heat to its displacement.

A *physical curve*, the mixture rule of the phases solved for δ, is a quadratic in (R, σ, θ): a resistance
corrected for temperature.  A *residual*, smooth and bounded, is learned for what is left: the mean of a few learners
with one layer of tanh each.  How far they are apart says how sure they are.
Outside what the calibration has seen it fades away, and the estimate says so.

Everything is one kernel for one sample; a log is a loop over it.
"""

from __future__ import annotations

from math import exp, hypot, isnan, sqrt, tanh
from typing import NamedTuple

import numpy as np

from sma_actuator.base.jit import Floats, jit

from . import orientation, surroundings
from .heat_content import (
    APPARENT,
    DIRECT,
    KNOWN_AT,
    RESTED_AT,
    SHARE_AT,
    TIME_AT,
    at_rest,
    at_usual_load_now,
    features,
    heat_rise,
    share_of_stroke,
    temperature_of,
)

CURVE_TERMS = 10  #: of a quadratic in R, σ, θ
#: Limits: δ at the two ends of what was seen, size of the residual, novelty beyond which it fades, what is added to the
#: learners' spread before it counts, half-width of the interval of the physical curve alone; what is added to the
#: spread of those who expect a temperature.
LOWEST, HIGHEST, LARGEST, EDGE, FLOOR, CURVE_WIDTH, EXPECTED_FLOOR_K = range(7)
CENTRE, SCALE, LOW, HIGH = range(4)
#: Rows of the widths, each for cooling, the next for heating: of the interval, and of an expected temperature.
OF_INTERVAL, OF_EXPECTED = 0, 2
OUT = 7  #: numbers of a sample: what :func:`advance` says of it, and room for what learners say
_START_PASSES = 5
_INTERVAL = 1.96  #: half of one over the standard deviation
_PER_RANGE = 4.0  #: a feature that lies beyond its range by a quarter of it is as strange as twice the edge


class Numbers(NamedTuple):
    """The coefficients as the kernels want them, and room to work in; few arrays, as to hand one over takes 0.3 µs."""

    resistances: np.ndarray  #: as :func:`resistances_of` has them
    thermal: np.ndarray  #: the heat balance, in the order of the indices above
    ends: np.ndarray  #: (2, 3): hot and cold end of the stroke, quadratics in stress
    widths_K: np.ndarray  #: half-widths of the plays of temperature
    widths_Ohm: np.ndarray  #: and of resistance
    limits: np.ndarray  #: in the order of the indices above
    ranges: np.ndarray  #: (4, features): centre and scale of each, and where the calibration has seen it
    whitening: np.ndarray  #: lower triangle, (features, features)
    curve: np.ndarray  #: the physical curve, (CURVE_TERMS,)
    linear: np.ndarray  #: of each learner, (learners, CURVE_TERMS + plays)
    hidden: np.ndarray  #: (features, units): neighbours in memory are reckoned at once
    layer: np.ndarray  #: (3, units): biases, outputs, and room for the units themselves
    widths: np.ndarray  #: (4, places): over the learners' spread, in the order of the rows above
    martensite: np.ndarray  #: how long its martensite is, and what resistance says of that (:mod:`.orientation`)
    ambient: float  #: temperature of the surroundings in the calibration [°C]
    #: The same of learners of θ by all else, over its mean: they tell of other surroundings.
    expected_linear: np.ndarray
    expected_hidden: np.ndarray
    expected_layer: np.ndarray
    seen: np.ndarray  #: room for the features of a sample
    z: np.ndarray  #: for what is made of them


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
def _learned(z: np.ndarray, linear: np.ndarray, hidden: np.ndarray, layer: np.ndarray, out: np.ndarray) -> None:
    """What was learned, into ``out``: the mean of the learners, how far they are apart, and how the mean goes with θ.

    Each has a quadratic in what is seen directly, a line in the plays, and its share of the tanh units.
    """
    bias, output, units = layer[0], layer[1], layer[2]
    learners = linear.shape[0]
    each = len(units) // learners
    for k in range(len(units)):
        units[k] = bias[k]  # one by one: to copy it whole takes two seconds more to compile
    for j in range(len(z)):
        for k in range(len(units)):
            units[k] += hidden[j, k] * z[j]
    for k in range(len(units)):  # tanh is four times dearer, and no truer where 1 is added up
        units[k] = 1.0 - 2.0 / (exp(2.0 * units[k]) + 1.0)
    mean = 0.0
    square = 0.0
    slope = 0.0
    for i in range(learners):
        line = linear[i]
        value = _quadratic(z, line)
        slope += line[3] + 2.0 * line[6] * z[2] + line[8] * z[0] + line[9] * z[1]
        for j in range(DIRECT, len(z)):
            value += line[CURVE_TERMS + j - DIRECT] * z[j]
        for k in range(i * each, (i + 1) * each):
            value += output[k] * units[k]
            slope += output[k] * (1.0 - units[k] * units[k]) * hidden[APPARENT, k]
        change = value - mean
        mean += change / (i + 1)
        square += change * (value - mean)
    out[0] = mean
    out[1] = sqrt(square / learners)
    out[2] = slope / learners


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
        low, high = n.ranges[LOW, i], n.ranges[HIGH, i]
        beyond = max(beyond, max(low - n.seen[i], n.seen[i] - high) / (high - low))
    return max(sqrt(square) / n.limits[EDGE], 1.0 + _PER_RANGE * beyond if beyond > 0.0 else 0.0)


@jit
def _width(of: int, displacement: float, heating: bool, n: Numbers) -> float:
    """A width on a branch, in units of the learners' spread; linear between equally spaced places."""
    widths = n.widths
    last = widths.shape[1] - 1
    along = (displacement - n.limits[LOWEST]) / (n.limits[HIGHEST] - n.limits[LOWEST])
    place = min(max(along, 0.0), 1.0) * last
    below = min(int(place), last - 1)
    row = of + 1 if heating else of
    width: float = widths[row, below] + (place - below) * (widths[row, below + 1] - widths[row, below])
    return width


@jit
def _estimate(heating: bool, unsure_K: float, n: Numbers, out: np.ndarray) -> None:
    """δ, half of its 95 % interval and the share of the residual in it, into ``out``, from the features ``n.seen``.

    ``unsure_K``: one standard deviation of what other surroundings make of the apparent temperature.
    """
    for j in range(len(n.seen)):
        n.z[j] = (n.seen[j] - n.ranges[CENTRE, j]) / n.ranges[SCALE, j]
    lowest = n.limits[LOWEST]
    highest = n.limits[HIGHEST]
    slack = 0.05 * (highest - lowest)
    physical = min(max(_quadratic(n.z, n.curve), lowest - slack), highest + slack)
    _learned(n.z, n.linear, n.hidden, n.layer, out)
    slope_m_K = out[2] / n.ranges[SCALE, APPARENT]
    residual = n.limits[LARGEST] * tanh((out[0] - physical) / n.limits[LARGEST])
    spread = out[1]
    strangeness = _strangeness(n)
    share = 1.0 if strangeness <= 1.0 else exp(2.0 * (1.0 - strangeness))
    displacement = min(max(physical + share * residual, lowest - slack), highest + slack)
    width = _width(OF_INTERVAL, displacement, heating, n) * (n.limits[FLOOR] + spread)
    width = hypot(width, _INTERVAL * unsure_K * slope_m_K)
    width += max(lowest - displacement, displacement - highest, 0.0)  # back to where a wire has been
    out[0] = displacement
    out[1] = share * width + (1.0 - share) * max(n.limits[CURVE_WIDTH], width)
    out[2] = share


@jit
def _of_other_loads(
    resistance: float,
    stress: float,
    other_K: float,
    rise_K: float,
    rests_cold: bool,
    first: bool,
    oriented: Floats,
    usual: Floats,
    n: Numbers,
) -> float:
    """What of the resistance is of martensite that formed under another load [Ω], which a cold wire at rest tells."""
    if rests_cold and (first or orientation.told(oriented)) and orientation.no_warmer(rise_K, oriented):
        orientation.tell(resistance, stress, other_K, rise_K, usual, n.ends, n.martensite, oriented)
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
def _learn_of_surroundings(
    other_K: float,
    rise_K: float,
    off_K: float,
    step: float,
    share: float,
    heating: bool,
    around: Floats,
    n: Numbers,
    out: np.ndarray,
) -> None:
    """What a sample, estimated in ``out``, tells of the wire's surroundings."""
    if out[2] < 0.5:  # unlike the calibration: nobody knows what to expect
        return
    apparent = n.seen[APPARENT] + off_K - n.ranges[CENTRE, APPARENT]
    n.z[APPARENT] = 0.0
    said = out[OUT - 3 :]
    _learned(n.z, n.expected_linear, n.expected_hidden, n.expected_layer, said)
    within_K = _width(OF_EXPECTED, out[0], heating, n) * (n.limits[EXPECTED_FLOOR_K] + said[1])
    surroundings.tell(apparent - said[0], within_K, off_K, other_K, rise_K, step, share, around)


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
    around: Floats,
    n: Numbers,
    out: np.ndarray,
) -> None:
    """One sample: δ [m], half of its 95 % interval [m], the share of the residual, and how much longer the wire is than
    if all of it had formed under its load [m], into the first of ``out`` (OUT,).

    ``ambient``: NaN where nobody measures it; ``oriented``: the memory of :mod:`.orientation`; ``usual``: a cold wire's
    resistance by its stress; ``around``: the memory of :mod:`.surroundings`.
    """
    other_K = ambient - n.ambient
    if isnan(ambient):
        ambient = n.ambient
    first = state[TIME_AT] != state[TIME_AT]  # NaN
    rested = state[RESTED_AT] if state[RESTED_AT] == state[RESTED_AT] else power
    remembers = n.martensite[orientation.OHM_PER_m] > 0.0
    if remembers:
        rise = heat_rise(rested, n.thermal) if first else temperature_of(n.thermal, state) - ambient
        warms = heat_rise(power, n.thermal) - rise  # more than at rest: then its resistance is its heat's too
        rests_cold = rise < orientation.COLD_K and abs(warms) < orientation.RESTS_K
        resistance -= _of_other_loads(resistance, stress, other_K, rise, rests_cold, first, oriented, usual, n)
    resistance = at_usual_load_now(resistance, stress, n.resistances)
    step = 0.0 if first else max(time - state[TIME_AT], 0.0)
    rise_K = off_K = 0.0
    share = 1.0
    # At rest, in the place that agrees with the temperature that is made of it; once in the text, as it is compiled
    # wherever it stands.
    for _ in range(_START_PASSES + 1 if first else 1):
        if first:
            at_rest(time, rested, ambient, resistance, share, n.thermal, state)
        features(time, power, ambient, resistance, stress, n.thermal, n.widths_K, n.widths_Ohm, state, n.seen)
        rise_K = temperature_of(n.thermal, state) - ambient
        off_K, unsure_K = surroundings.off_K(other_K, rise_K, around)
        n.seen[APPARENT] -= off_K
        _estimate(heating, unsure_K, n, out)
        share = share_of_stroke(out[0], stress, n.ends)
    state[SHARE_AT] = share
    # What the wire was before its first sample is a guess: in another room a wrong one, and taken for a draught.
    if state[KNOWN_AT] > 0.0 and step > 0.0 and len(n.expected_linear) > 0:
        _learn_of_surroundings(other_K, rise_K, off_K, step, share, heating, around, n, out)
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
    around: Floats,
    n: Numbers,
    out: np.ndarray,
) -> None:
    """``advance`` over samples, ``out`` (samples, OUT)."""
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
            around=around,
            n=n,
            out=out[i],
        )
