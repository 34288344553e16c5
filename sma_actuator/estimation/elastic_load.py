"""Where the wire is by what it pulls: under a spring the load rises as the wire contracts, and tells its displacement.

Resistance tells it less well than the model is sure of where another phase hides in it; a spring does not know of
phases.  So what the model says where it is surest is learned as a line of displacement over stress, and the two are
weighed by how sure each is.  A load that does not go with the displacement, as a weight, makes no line, and one that is
changed from outside ends it.

Sources
    R. E. Kalman, "A new approach to linear filtering and prediction problems", J. Basic Eng. 82 (1960) 35: two
    measurements of one thing, each with its variance; here the second one's are found by least squares that forget.
"""

from __future__ import annotations

from math import exp, isfinite, nan, sqrt

import numpy as np

from sma_actuator.base.jit import Floats, floats, jit

#: The line learns once in so much of the stroke, and remembers so many times that.
LEARNS, REMEMBERED = 0.01, 150.0
#: It wants to have learned so often, over so much of the stroke (standard deviation), and to leave no more than this
#: share of the variance: a weight's load goes with nothing.
LEAST, SPREAD, LEFT = 30.0, 0.1, 0.1
#: No model is surer than this share of the stroke (standard deviation), nor is the line surer than the model was where
#: it has learned: what that is off by everywhere, both are.
SUREST = 0.005
#: Beyond the stresses that it has learned, by more than this share of their range, the line says nothing.
BEYOND = 0.1
#: A load that moves the line's place by more than this share of the stroke within so short a time, and the wire by less
#: than a third of it, was changed from outside.
MOVED, WITHIN_s, FOLLOWED = 0.05, 0.3, 1.0 / 3.0
#: Where the model is as sure as this, and so many standard deviations away for so long in all, and nowhere as sure and
#: near, the line is not the load's any more.
SURE, AWAY, REFUTED_s = 0.006, 5.0, 1.0
#: Further away than this share of the stroke no phase takes a model: a load cell that stands still is no spring.
FAR = 0.3
#: So many standard deviations away a place counts for a quarter, and one further away for less and less.
LIKELY = 2.0

#: What is remembered: the time; stress and displacement as they were lately; the way since the line has learned; how
#: often it has, and the sum of the weights, and with each the model's variance; means and sums of squares of stress and
#: displacement; which stresses it has seen; for how long the model contradicts it.
(
    _TIME_s,
    _LATELY_Pa,
    _LATELY_m,
    _BEFORE_m,
    _WAY,
    _TIMES,
    _WEIGHT,
    _VARIANCES_m2,
    _STRESS_Pa,
    _PLACE_m,
    _STRESSES,
    _PRODUCTS,
    _PLACES,
    _LOWEST_Pa,
    _HIGHEST_Pa,
    _CONTRADICTED_s,
) = range(16)


class ElasticLoad:
    """What the load tells of one wire's displacement, beside the model."""

    def __init__(self, stroke_m: float):
        self._stroke_m = stroke_m
        self.reset()

    def reset(self) -> None:
        """Forget the load."""
        self._state = floats(16)
        self._state[_TIME_s] = nan

    def step(self, time_s: float, stress_Pa: float, displacement_m: float, uncertainty_m: float) -> tuple[float, float]:
        """Displacement and half of its 95 % interval [m], of what the model and the load tell of a sample."""
        return _told(self._state, time_s, stress_Pa, displacement_m, uncertainty_m, self._stroke_m)

    def run(
        self, time_s: np.ndarray, stress_Pa: np.ndarray, displacement_m: np.ndarray, uncertainty_m: np.ndarray
    ) -> None:
        """The same of n samples, into ``displacement_m`` and ``uncertainty_m``."""
        _told_all(self._state, time_s, stress_Pa, displacement_m, uncertainty_m, self._stroke_m)


@jit
def _told_all(
    state: Floats,
    time_s: np.ndarray,
    stress_Pa: np.ndarray,
    place_m: np.ndarray,
    uncertainty_m: np.ndarray,
    stroke_m: float,
) -> None:
    for n in range(len(time_s)):
        place_m[n], uncertainty_m[n] = _told(state, time_s[n], stress_Pa[n], place_m[n], uncertainty_m[n], stroke_m)


@jit
def _told(
    state: Floats, time_s: float, stress_Pa: float, place_m: float, uncertainty_m: float, stroke_m: float
) -> tuple[float, float]:
    """See :meth:`ElasticLoad.step`."""
    if not isfinite(uncertainty_m):
        return place_m, uncertainty_m
    step_s = time_s - state[_TIME_s]
    if not step_s >= 0.0:  # the first, or a clock that went back
        state[_LATELY_Pa], state[_LATELY_m], state[_BEFORE_m], step_s = stress_Pa, place_m, place_m, 0.0
    state[_TIME_s] = time_s
    model_m = max(0.5 * uncertainty_m, SUREST * stroke_m)
    told_m, told_half_m, likely = place_m, uncertainty_m, 1.0
    slope_m_Pa, rest_m2 = _line(state, stroke_m)
    if slope_m_Pa < 0.0:
        line_m = state[_PLACE_m] + slope_m_Pa * (stress_Pa - state[_STRESS_Pa])
        line_m2 = rest_m2 + state[_VARIANCES_m2] / state[_WEIGHT]
        away = (place_m - line_m) ** 2 / (model_m**2 + line_m2)
        likely = (1.0 + away / LIKELY**2) ** -2
        if model_m < SURE * stroke_m:
            state[_CONTRADICTED_s] = state[_CONTRADICTED_s] + step_s if away > AWAY**2 else 0.0
        refuted = state[_CONTRADICTED_s] > REFUTED_s or abs(place_m - line_m) > FAR * stroke_m
        if refuted or _is_another(state, slope_m_Pa, stress_Pa, place_m, stroke_m):
            _forget(state)
        elif _has_seen(state, stress_Pa):
            share = model_m**2 / (model_m**2 + line_m2)
            told_m = place_m + share * (line_m - place_m)
            told_half_m = min(uncertainty_m, 2.0 * sqrt(line_m2))  # they are not independent
    lately = 1.0 - exp(-step_s / WITHIN_s)
    state[_LATELY_Pa] += lately * (stress_Pa - state[_LATELY_Pa])
    state[_LATELY_m] += lately * (place_m - state[_LATELY_m])
    state[_WAY] += abs(place_m - state[_BEFORE_m])
    state[_BEFORE_m] = place_m
    if state[_WAY] >= LEARNS * stroke_m:
        state[_WAY] = 0.0
        _learn(state, stress_Pa, place_m, model_m, likely * (SUREST * stroke_m / model_m) ** 4)
    return told_m, told_half_m


@jit
def _line(state: Floats, stroke_m: float) -> tuple[float, float]:
    """How far the wire is moved by a stress [m/Pa], and the variance about that line [m²]; 0 where there is none."""
    if state[_TIMES] < LEAST or not state[_STRESSES] > 0.0:
        return 0.0, 0.0
    slope_m_Pa = state[_PRODUCTS] / state[_STRESSES]
    rest_m2 = max(state[_PLACES] - slope_m_Pa * state[_PRODUCTS], 0.0) / state[_WEIGHT]
    spread_m2 = state[_PLACES] / state[_WEIGHT]
    if spread_m2 < (SPREAD * stroke_m) ** 2 or rest_m2 > LEFT * spread_m2:
        return 0.0, 0.0
    return slope_m_Pa, rest_m2


@jit
def _is_another(state: Floats, slope_m_Pa: float, stress_Pa: float, place_m: float, stroke_m: float) -> bool:
    """Whether the load was changed from outside: it moved, and the wire did not as the line says."""
    should_m = slope_m_Pa * (stress_Pa - state[_LATELY_Pa])
    return abs(should_m) > MOVED * stroke_m and (place_m - state[_LATELY_m]) / should_m < FOLLOWED


@jit
def _has_seen(state: Floats, stress_Pa: float) -> bool:
    """Whether a stress is one that the line has learned of, or near these."""
    beyond_Pa = BEYOND * (state[_HIGHEST_Pa] - state[_LOWEST_Pa])
    return state[_LOWEST_Pa] - beyond_Pa <= stress_Pa <= state[_HIGHEST_Pa] + beyond_Pa


@jit
def _forget(state: Floats) -> None:
    """Begin another line."""
    state[_TIMES] = state[_WEIGHT] = state[_VARIANCES_m2] = 0.0
    state[_STRESSES] = state[_PRODUCTS] = state[_PLACES] = 0.0
    state[_CONTRADICTED_s] = 0.0


@jit
def _learn(state: Floats, stress_Pa: float, place_m: float, model_m: float, weight: float) -> None:
    """One more point of the line (weighted sums that forget, about their means); ``model_m``: how sure the model is."""
    kept = 1.0 - 1.0 / REMEMBERED
    first = state[_TIMES] == 0.0
    state[_TIMES] = kept * state[_TIMES] + 1.0
    state[_WEIGHT] = kept * state[_WEIGHT] + weight
    state[_VARIANCES_m2] = kept * state[_VARIANCES_m2] + weight * model_m**2
    part = weight / state[_WEIGHT]
    off_Pa, off_m = (0.0, 0.0) if first else (stress_Pa - state[_STRESS_Pa], place_m - state[_PLACE_m])
    if first:
        state[_STRESS_Pa], state[_PLACE_m] = stress_Pa, place_m
        state[_LOWEST_Pa] = state[_HIGHEST_Pa] = stress_Pa
    state[_STRESS_Pa] += part * off_Pa
    state[_PLACE_m] += part * off_m
    left = weight * (1.0 - part)
    state[_STRESSES] = kept * state[_STRESSES] + left * off_Pa * off_Pa
    state[_PRODUCTS] = kept * state[_PRODUCTS] + left * off_Pa * off_m
    state[_PLACES] = kept * state[_PLACES] + left * off_m * off_m
    mean_Pa = state[_STRESS_Pa]
    state[_LOWEST_Pa] = min(mean_Pa + kept * (state[_LOWEST_Pa] - mean_Pa), stress_Pa)
    state[_HIGHEST_Pa] = max(mean_Pa + kept * (state[_HIGHEST_Pa] - mean_Pa), stress_Pa)
