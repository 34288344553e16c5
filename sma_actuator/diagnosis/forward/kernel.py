"""The loop of the forward model: duty in, slider position out.

Heat, kinetics, strain and spring are the kernels of :mod:`sma_actuator.plant`; here is only what joins
them: the drive, the parts of a wire that is not uniform, friction, the sensor.
"""

from __future__ import annotations

from math import exp, pi
from typing import NamedTuple

import numpy as np

from sma_actuator.base.jit import jit
from sma_actuator.plant.kinetics import Shift, new_memory
from sma_actuator.plant.physics import (
    Strain,
    convection,
    enthalpy_of,
    load_at,
    martensite_at,
    r_share_at,
    resistance_of,
    strain_parts,
    strain_under,
    temperature_for,
)

from .wire import ForwardWire, segments

STEFAN_BOLTZMANN_W_m2_K4 = 5.670e-8  #: W/(m²·K⁴)
#: Columns of what :func:`simulate` returns.
POSITION, TEMPERATURE, MARTENSITE, LOAD, RESISTANCE, POWER = range(6)
# Columns of the array of a wire's parts.
SHARE, SHIFT_K, LOSS_FACTOR, PART_TEMPERATURE, ENTHALPY, PART_MARTENSITE, R_SHARE, SLOPE_J_K = range(8)
PART_COLUMNS = 8
# Indices of the means over the parts.
MEAN_TEMPERATURE, MEAN_MARTENSITE, MEAN_R_SHARE, LOST_W = range(4)
MEANS = 4


class Stand(NamedTuple):
    """The drive, the spring, the sensor and what they do wrong: everything about the bench that is not the wire."""

    supply_V: float
    mean_heats: bool  #: the mean of the switched voltage heats the wire, not its RMS
    ambient_C: float
    stiffness_N_m: float
    preload_N: float
    friction_N: float
    breakaway_N: float
    backlash_m: float
    lag_s: float
    cooling_factor: float
    convection_exponent: float
    radiation_W_K4: float
    surround_J_K: float
    surround_share: float
    start_strain: float
    slack_m: float


@jit
def _heat_and_transform(c, stand, bands, parts, memory_m, memory_r, means, load_N, power_W, duty, around_C, step_s):
    """Every part of the wire after a step; ``means`` over them.  Returns the parts of the mean strain."""
    radiation = stand.radiation_W_K4
    absolute = stand.ambient_C + 273.15
    factor = 1.0 if duty > 1e-3 else stand.cooling_factor
    if stand.surround_J_K > 0.0:
        factor /= 1.0 - stand.surround_share
    x = c.transformation
    stress = load_N / c.area_m2
    means[:] = 0.0
    transformation = compliance = other = 0.0
    for j in range(parts.shape[0]):
        share = parts[j, SHARE]
        before_C = parts[j, PART_TEMPERATURE]
        m = parts[j, PART_MARTENSITE]
        r = parts[j, R_SHARE]
        over = before_C - around_C
        h = c.heat_loss_W_K * factor * parts[j, LOSS_FACTOR] * convection(stand.convection_exponent, over)
        kelvin = before_C + 273.15
        lost = h * over + radiation * (kelvin**4 - absolute**4)
        a = (h + 4.0 * radiation * kelvin**3) * step_s / x.heat_capacity_J_K
        parts[j, ENTHALPY] += (power_W - lost) * step_s * (1.0 - exp(-a)) / a  # exact while nothing transforms
        shift = Shift(parts[j, SHIFT_K], parts[j, SHIFT_K])
        held = enthalpy_of(x, m, r, before_C)
        enthalpy = parts[j, ENTHALPY]
        slope = parts[j, SLOPE_J_K]
        t = temperature_for(x, bands, memory_m[j], memory_r[j], m, r, before_C, stress, shift, enthalpy, slope)
        if abs(t - before_C) > 1e-9:
            parts[j, SLOPE_J_K] = max((enthalpy - held) / (t - before_C), x.heat_capacity_J_K)
        m = martensite_at(x, bands, memory_m[j], m, t, stress, shift, True)
        r = r_share_at(x, bands, memory_r[j], r, t, stress, shift, True)
        parts[j, PART_TEMPERATURE] = t
        parts[j, PART_MARTENSITE] = m
        parts[j, R_SHARE] = r
        means[MEAN_TEMPERATURE] += share * t
        means[MEAN_MARTENSITE] += share * m
        means[MEAN_R_SHARE] += share * r
        means[LOST_W] += share * h * over
        strain = strain_parts(c, m, r, t)
        transformation += share * strain.transformation
        compliance += share * strain.compliance_1_Pa
        other += share * strain.other
    return Strain(transformation, compliance, other)


@jit
def _slide(c, stand, strain, load, slider, moving, spring_at, lasting):
    """Where the slider stands now: its tension, its place in the wire's displacement, and which way it moves."""
    stiffness = stand.stiffness_N_m
    preload = stand.preload_N
    if stand.friction_N + stand.breakaway_N <= 0.0:
        load = load_at(c, strain, load, preload, stiffness, spring_at)
        return load, c.length_m * strain_under(c, strain, load / c.area_m2) - lasting, 0.0
    hold = stand.friction_N + (stand.breakaway_N if moving == 0.0 else 0.0)
    before = slider + lasting
    was = moving
    moving = 0.0
    high = load_at(c, strain, load, preload + hold, stiffness, spring_at)
    low = load_at(c, strain, load, max(preload - hold, 0.0), stiffness, spring_at)
    at_high = c.length_m * strain_under(c, strain, high / c.area_m2)
    at_low = c.length_m * strain_under(c, strain, low / c.area_m2)
    if before > at_high or (was < 0.0 and before >= at_high):
        moving = -1.0
    elif before < at_low or (was > 0.0 and before <= at_low):
        moving = 1.0
    if moving == 0.0:
        inside = (before - at_low) / (at_high - at_low) if at_high > at_low else 0.5
        return low + inside * (high - low), slider, moving
    if stand.breakaway_N > 0.0:
        load = load_at(c, strain, load, max(preload - moving * stand.friction_N, 0.0), stiffness, spring_at)
    else:
        load = high if moving < 0.0 else low
    return load, c.length_m * strain_under(c, strain, load / c.area_m2) - lasting, moving


@jit
def _advance(c, stand, bands, parts, memory_m, memory_r, means, duty, step_s, out):
    """Fill ``out`` (n, 6), row i at the end of step i; ``parts`` hold a wire that is to be cooled from the hot end,
    ``means`` (MEANS,) is room to work in."""
    x = c.transformation
    ambient = stand.ambient_C
    # the last thing it did was to cool: the slider followed the spring
    load = max(stand.preload_N - stand.friction_N, 0.0)
    mean_m = 0.0
    mean_r = 0.0
    for j in range(parts.shape[0]):
        shift = Shift(parts[j, SHIFT_K], parts[j, SHIFT_K])
        stress = load / c.area_m2
        parts[j, PART_TEMPERATURE] = ambient
        parts[j, SLOPE_J_K] = x.heat_capacity_J_K
        parts[j, PART_MARTENSITE] = martensite_at(x, bands, memory_m[j], 0.0, ambient, stress, shift, True)
        parts[j, R_SHARE] = r_share_at(x, bands, memory_r[j], 0.0, ambient, stress, shift, True)
        parts[j, ENTHALPY] = enthalpy_of(x, parts[j, PART_MARTENSITE], parts[j, R_SHARE], ambient)
        mean_m += parts[j, SHARE] * parts[j, PART_MARTENSITE]
        mean_r += parts[j, SHARE] * parts[j, R_SHARE]
    strain = strain_parts(c, mean_m, mean_r, ambient)
    start = c.length_m * strain_under(c, strain, load / c.area_m2)
    slider = start
    least_m = mean_m
    resistance = resistance_of(c, mean_m, mean_r, ambient, load / c.area_m2, slider / c.length_m)
    seen = 0.0
    shown = 0.0
    moving = 0.0
    body = ambient
    for i in range(duty.shape[0]):
        square_V2 = duty[i] * stand.supply_V * stand.supply_V
        if stand.mean_heats:
            square_V2 *= duty[i]
        total = resistance + c.series_Ohm
        power = square_V2 * resistance / (total * total)
        around = body if stand.surround_J_K > 0.0 else ambient
        strain = _heat_and_transform(
            c, stand, bands, parts, memory_m, memory_r, means, load, power, duty[i], around, step_s
        )
        if stand.surround_J_K > 0.0:
            beyond = c.heat_loss_W_K / stand.surround_share * (body - ambient)
            body += (means[LOST_W] - beyond) * step_s / stand.surround_J_K
        mean_m = means[MEAN_MARTENSITE]
        mean_r = means[MEAN_R_SHARE]
        mean_t = means[MEAN_TEMPERATURE]
        least_m = min(least_m, mean_m)
        lasting = stand.start_strain * c.length_m * (1.0 - least_m)  # recovered once, not restored by the bias
        load, slider, moving = _slide(c, stand, strain, load, slider, moving, start + lasting, lasting)
        resistance = resistance_of(c, mean_m, mean_r, mean_t, load / c.area_m2, slider / c.length_m)
        position = start - slider
        if stand.slack_m > 0.0:
            position = max(position - stand.slack_m, 0.0)
        seen = min(max(seen, position - 0.5 * stand.backlash_m), position + 0.5 * stand.backlash_m)
        shown += (seen - shown) * (1.0 - exp(-step_s / stand.lag_s)) if stand.lag_s > 0.0 else seen - shown
        out[i, POSITION] = shown
        out[i, TEMPERATURE] = mean_t
        out[i, MARTENSITE] = mean_m
        out[i, LOAD] = load
        out[i, RESISTANCE] = resistance
        out[i, POWER] = power


def _stand(wire: ForwardWire) -> Stand:
    e = wire.effects
    surface_m2 = pi * wire.wire.diameter_m * wire.wire.length_m
    return Stand(
        supply_V=wire.drive.supply_V,
        mean_heats=wire.drive.heats == "mean",
        ambient_C=wire.surroundings.ambient_C,
        stiffness_N_m=wire.bias.stiffness_N_m,
        preload_N=wire.bias.preload_N,
        friction_N=e.friction_N,
        breakaway_N=e.breakaway_N,
        backlash_m=e.backlash_m,
        lag_s=e.sensor_lag_s,
        cooling_factor=e.cooling_loss_factor,
        convection_exponent=e.convection_exponent,
        radiation_W_K4=e.emissivity * STEFAN_BOLTZMANN_W_m2_K4 * surface_m2,
        surround_J_K=e.surround_J_K,
        surround_share=e.surround_share,
        start_strain=e.start_strain,
        slack_m=e.slack_m,
    )


def simulate(wire: ForwardWire, duty: np.ndarray, step_s: float) -> np.ndarray:
    """Slider position [m] above the cold start, mean temperature [°C], martensite, tension [N], resistance [Ω], power
    [W].

    ``duty`` (n,) is the mean over each step; the result (n, 6) is at the end of each.
    """
    share, shift_K, loss_factor = segments(wire.effects)
    parts = np.zeros((len(share), PART_COLUMNS))
    parts[:, SHARE], parts[:, SHIFT_K], parts[:, LOSS_FACTOR] = share, shift_K, loss_factor
    memory_m = np.array([new_memory(0.0) for _ in share])
    if wire.effects.dead_time_s > 0.0:
        # Shift the energy, not the samples, so that the result is smooth in the dead time.
        ends = np.arange(len(duty) + 1) * step_s
        duty = np.diff(np.interp(ends - wire.effects.dead_time_s, ends, np.concatenate([[0.0], np.cumsum(duty)])))
    out = np.empty((len(duty), 6))
    _advance(
        wire.constants,
        _stand(wire),
        wire.bands,
        parts,
        memory_m,
        memory_m.copy(),
        np.zeros(MEANS),
        np.ascontiguousarray(duty, float),
        step_s,
        out,
    )
    return out
