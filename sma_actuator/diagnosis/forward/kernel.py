"""The loop of the forward model: duty in, slider position out.

Heat, kinetics, strain and spring are the kernels of :mod:`sma_actuator.plant.physics`; here is
only what joins them — the drive, the parts of a wire that is not uniform, friction, the sensor.
"""

from __future__ import annotations

from math import exp, pi

import numpy as np

from sma_actuator.base.jit import jit
from sma_actuator.plant.physics import (
    enthalpy_of,
    load_at,
    martensite_at,
    new_memory,
    r_share_at,
    resistance_of,
    strain_of,
    temperature_for,
)

from .wire import ForwardWire, segments

STEFAN_BOLTZMANN = 5.670e-8  #: W/(m²·K⁴)
CONVECTION_AT_K = 60.0  #: excess at which h(T) has the stated value, whatever its exponent
#: Columns of what :func:`simulate` returns.
POSITION, TEMPERATURE, MARTENSITE, LOAD, RESISTANCE, POWER = range(6)


@jit
def _advance(c, p, share, shift, loss_factor, memory_m, memory_r, duty, step_s, out):
    """Fill ``out`` (n, 6), row i at the end of step i; ``p`` is the array made by :func:`simulate`."""
    supply, mean_heats, ambient, stiffness, preload = p[0], p[1] > 0.0, p[2], p[3], p[4]
    friction, breakaway, backlash, lag = p[5], p[6], p[7], p[8]
    cooling_factor, exponent, radiation, surround, beyond, start_strain, slack = (
        p[9],
        p[10],
        p[11],
        p[12],
        p[13],
        p[14],
        p[15],
    )
    parts = share.shape[0]
    temperature = np.full(parts, ambient)
    enthalpy = np.zeros(parts)
    martensite = np.zeros(parts)
    r_share = np.zeros(parts)
    load = max(preload - friction, 0.0)  # the last thing it did was to cool, so the slider followed the spring
    mean_m = 0.0
    mean_r = 0.0
    for j in range(parts):
        stress = load / c.area_m2 + shift[j] / c.slope_K_Pa
        martensite[j] = martensite_at(c, memory_m[j], 0.0, ambient, stress, True)
        r_share[j] = r_share_at(c, memory_r[j], 0.0, ambient, stress, True)
        enthalpy[j] = enthalpy_of(c, martensite[j], r_share[j], ambient)
        mean_m += share[j] * martensite[j]
        mean_r += share[j] * r_share[j]
    mean_t = ambient
    slider = c.length_m * strain_of(c, mean_m, mean_r, mean_t, load / c.area_m2)
    spring_at = slider
    start = slider
    least_m = mean_m
    strain = slider / c.length_m
    resistance = resistance_of(c, mean_m, mean_r, mean_t, load / c.area_m2, strain)
    seen = 0.0
    shown = 0.0
    moving = 0.0
    body = ambient
    absolute = ambient + 273.15
    for i in range(duty.shape[0]):
        volts_2 = duty[i] * supply * supply
        if mean_heats:
            volts_2 *= duty[i]
        total = resistance + c.series_Ohm
        power = volts_2 * resistance / (total * total)
        factor = 1.0 if duty[i] > 1e-3 else cooling_factor
        lost_all = 0.0
        mean_m = 0.0
        mean_r = 0.0
        mean_t = 0.0
        around = body if surround > 0.0 else ambient
        for j in range(parts):
            over = temperature[j] - around
            h = c.heat_loss_W_K * factor * loss_factor[j]
            if surround > 0.0:
                h /= 1.0 - beyond
            if exponent > 0.0:
                h *= (max(abs(over), 0.1) / CONVECTION_AT_K) ** exponent
            kelvin = temperature[j] + 273.15
            lost = h * over + radiation * (kelvin**4 - absolute**4)
            slope = h + 4.0 * radiation * kelvin**3
            a = slope * step_s / c.heat_capacity_J_K
            gain = (power - lost) * step_s * (1.0 - exp(-a)) / a  # exact while nothing transforms
            lost_all += share[j] * h * over
            enthalpy[j] += gain
            stress = load / c.area_m2 + shift[j] / c.slope_K_Pa
            t = temperature_for(
                c, memory_m[j], memory_r[j], martensite[j], r_share[j], temperature[j], stress, enthalpy[j]
            )
            temperature[j] = t
            martensite[j] = martensite_at(c, memory_m[j], martensite[j], t, stress, True)
            r_share[j] = r_share_at(c, memory_r[j], r_share[j], t, stress, True)
            mean_m += share[j] * martensite[j]
            mean_r += share[j] * r_share[j]
            mean_t += share[j] * t
        if surround > 0.0:
            body += (lost_all - c.heat_loss_W_K / beyond * (body - ambient)) * step_s / surround
        least_m = min(least_m, mean_m)
        lasting = start_strain * c.length_m * (1.0 - least_m)  # recovered once, not restored by the bias
        at = spring_at + lasting
        if friction + breakaway > 0.0:
            hold = friction + (breakaway if moving == 0.0 else 0.0)
            before = slider + lasting  # slider's place in the wire's own displacement
            was = moving
            moving = 0.0
            high = load_at(c, mean_m, mean_r, mean_t, load, preload + hold, stiffness, at)
            low = load_at(c, mean_m, mean_r, mean_t, load, max(preload - hold, 0.0), stiffness, at)
            at_high = c.length_m * strain_of(c, mean_m, mean_r, mean_t, high / c.area_m2)
            at_low = c.length_m * strain_of(c, mean_m, mean_r, mean_t, low / c.area_m2)
            if before > at_high or (was < 0.0 and before >= at_high):
                moving = -1.0
            elif before < at_low or (was > 0.0 and before <= at_low):
                moving = 1.0
            if moving == 0.0:
                inside = (before - at_low) / (at_high - at_low) if at_high > at_low else 0.5
                load = low + inside * (high - low)
            else:
                if breakaway > 0.0:
                    load = load_at(
                        c, mean_m, mean_r, mean_t, load, max(preload - moving * friction, 0.0), stiffness, at
                    )
                else:
                    load = high if moving < 0.0 else low
                slider = c.length_m * strain_of(c, mean_m, mean_r, mean_t, load / c.area_m2) - lasting
        else:
            load = load_at(c, mean_m, mean_r, mean_t, load, preload, stiffness, at)
            slider = c.length_m * strain_of(c, mean_m, mean_r, mean_t, load / c.area_m2) - lasting
        resistance = resistance_of(c, mean_m, mean_r, mean_t, load / c.area_m2, slider / c.length_m)
        position = start - slider
        if slack > 0.0:
            position = max(position - slack, 0.0)
        if position > seen + 0.5 * backlash:
            seen = position - 0.5 * backlash
        elif position < seen - 0.5 * backlash:
            seen = position + 0.5 * backlash
        if lag > 0.0:
            shown += (seen - shown) * (1.0 - exp(-step_s / lag))
        else:
            shown = seen
        out[i, 0] = shown
        out[i, 1] = mean_t
        out[i, 2] = mean_m
        out[i, 3] = load
        out[i, 4] = resistance
        out[i, 5] = power


def simulate(wire: ForwardWire, duty: np.ndarray, step_s: float) -> np.ndarray:
    """Slider position [m] above the cold start, mean temperature [°C], martensite, tension [N], resistance [Ω], power [W].

    ``duty`` (n,) is the mean over each step; the result (n, 6) is at the end of each.
    """
    e = wire.effects
    share, shift, loss = segments(e)
    area_m2 = pi * wire.wire.diameter_m * wire.wire.length_m
    p = np.array([
        wire.drive.supply_V, float(wire.drive.heats == "mean"), wire.surroundings.ambient_C, wire.bias.stiffness_N_m,
        wire.bias.preload_N, e.friction_N, e.breakaway_N, e.backlash_m, e.sensor_lag_s, e.cooling_loss_factor,
        e.convection_exponent, e.emissivity * STEFAN_BOLTZMANN * area_m2, e.surround_J_K, e.surround_share, e.start_strain,
        e.slack_m,
    ])  # fmt: skip
    memory_m = np.array([new_memory(0.0) for _ in share])
    out = np.empty((len(duty), 6))
    if e.dead_time_s > 0.0:
        # Shift the energy, not the samples, so that the result is smooth in the dead time.
        ends = np.arange(len(duty) + 1) * step_s
        duty = np.diff(np.interp(ends - e.dead_time_s, ends, np.concatenate([[0.0], np.cumsum(duty)])))
    _advance(
        wire.constants(),
        p,
        share,
        shift,
        loss,
        memory_m,
        memory_m.copy(),
        np.ascontiguousarray(duty, float),
        step_s,
        out,
    )
    return out
