"""The heat of a wire beside its resistance: what a model of the whole range, and an expectation of errors, see of it.

A heat balance keeps the wire's *heat content* as a temperature,

    E = T - λ_R R - λ_X X,     dE/dt = (P/h - G (x - s) / (1 - a)) / τ,     x = T - T_ambient,     G = 1 + g max(x, 0),
                               ds/dt = (a x - s) / τ_s,

where s is how far its near surroundings have warmed up: a tube, a coating, the clamps.  In balance they take a share a
of the wire's rise; with a = 0 the air begins at the wire.  What is known of wires is a small share.  E holds
the latent heat in λ_R and λ_X, where X is how far δ lies between the ends of the stroke at the present stress.
E is an integral of power: δ enters only through the heat lost, so that an error of δ cannot run in a circle with the
temperature that is made of it.  The features are

* R as it would be under a usual load (a load that stretches the wire raises its resistance though nothing transforms),
  σ and an apparent temperature θ = E + λ_θ R,
* how far θ, less what stress adds to it, has come from its last turns: plays of several widths [K],
* how far R has come from its own: plays of several widths [Ω].
"""

from __future__ import annotations

from collections.abc import Sequence
from math import nan, sqrt
from typing import Any

import numpy as np

from sma_actuator.base.balance import gains
from sma_actuator.base.jit import jit
from sma_actuator.base.sections import ThermalParameters

from . import orientation

DIRECT = 3  #: features that are no plays: R, σ, θ
STRESS, APPARENT = 1, 2  #: of them
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
#: Where each stands in the memory: time, heat content, resistance and X of the sample before, warmth of the near
#: surroundings, the power it rested at before the first one (NaN: that one's own), whether the widest play has come to
#: its other end, so that what the wire was before the first sample is forgotten (1), then the plays.
TIME_AT, HEAT_AT, RESISTANCE_AT, SHARE_AT, NEAR_AT, RESTED_AT, KNOWN_AT, PLAYS_AT = range(8)
REMEMBERED = PLAYS_AT  #: numbers beside the plays
NEAR = 7  #: where those of the near surroundings begin in KNOWN


def at_usual_load(resistance: Any, stress: Any, resistances: np.ndarray) -> Any:
    """The resistance [Ω] that the wire would have under the usual load, as far between the hot one's and the cold one's
    as it is under this stress; of one sample or of n."""
    hot = resistances[0] + stress * resistances[1]
    cold = resistances[2] + stress * resistances[3]
    return resistances[4] + (resistance - hot) * (resistances[5] / (cold - hot))


at_usual_load_now = jit(at_usual_load)  # of one sample


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
    state[NEAR_AT] = thermal[NEAR_SHARE] * rise
    state[TIME_AT] = time
    state[HEAT_AT] = temperature - thermal[LATENT_K_Ohm] * resistance - thermal[LATENT_K] * share
    state[RESISTANCE_AT] = resistance
    state[SHARE_AT] = share
    state[KNOWN_AT] = 0.0
    state[PLAYS_AT] = nan


@jit
def temperature_of(thermal: np.ndarray, state: np.ndarray) -> float:
    """Of the wire at the sample before [°C]."""
    temperature: float = (
        state[HEAT_AT] + thermal[LATENT_K_Ohm] * state[RESISTANCE_AT] + thermal[LATENT_K] * state[SHARE_AT]
    )
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
    step = max(time - state[TIME_AT], 0.0)
    temperature = temperature_of(thermal, state)
    wire, near = gains(
        temperature - ambient,
        state[NEAR_AT],
        power / thermal[HEAT_LOSS_W_K],
        step,
        thermal[TIME_CONSTANT_s],
        thermal[NEAR_SHARE],
        thermal[NEAR_TIME_s],
        thermal[LOSS_GROWTH_1_K],
    )
    state[HEAT_AT] += wire
    state[NEAR_AT] += near
    state[TIME_AT] = time
    state[RESISTANCE_AT] = resistance
    apparent = state[HEAT_AT] + thermal[APPARENT_K_Ohm] * resistance
    out[0] = resistance
    out[1] = stress
    out[2] = apparent
    first = state[PLAYS_AT] != state[PLAYS_AT]  # NaN
    count = len(widths_K)
    for k in range(count):
        shifted = apparent - stress * (thermal[NARROW_K_Pa] if k < NARROW else thermal[WIDE_K_Pa])
        if first:  # at rest the wire has come from where it was hotter
            state[PLAYS_AT + k] = shifted + widths_K[k]
        state[PLAYS_AT + k] = min(max(state[PLAYS_AT + k], shifted - widths_K[k]), shifted + widths_K[k])
        out[DIRECT + k] = shifted - state[PLAYS_AT + k]
        if k == count - 1 and state[PLAYS_AT + k] == shifted - widths_K[k]:
            state[KNOWN_AT] = 1.0
    for k in range(len(widths_Ohm)):
        place = PLAYS_AT + count + k
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
            at_rest(time[i], power[i], ambient[i], resistance[i], share[i], thermal, state)
        features(time[i], power[i], ambient[i], resistance[i], stress[i], thermal, widths_K, widths_Ohm, state, out[i])
        state[SHARE_AT] = share[i]


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
