"""Physics of one loaded wire that carries a current: heat, transformation, strain, resistance.

All kernels are scalar; :func:`simulate` is the loop over steps.  The heat balance is kept as an
enthalpy, so that no energy is lost to the solution's tolerance, however abrupt a transformation.
"""

from __future__ import annotations

from math import cos, exp, pi
from typing import NamedTuple

import numpy as np

from sma_actuator.base.jit import jit

from .materials import Wire

DEPTH = 12  #: nested reversals a transformation remembers
_MEMORY = 5 + 4 * DEPTH
_EPS = 1e-9

# Indices of the state array.
(
    TIME,
    ENTHALPY,
    TEMPERATURE,
    MARTENSITE,
    R_SHARE,
    LOAD,
    DISPLACEMENT,
    RESISTANCE,
    CURRENT,
    VOLTAGE,
    TRIP,
    STRAIN,
    POWER,
    HEAT_IN,
    HEAT_OUT,
) = range(15)
STATES = 15
# Indices of the inputs array.
(
    CURRENT_SET,
    VOLTAGE_LIMIT,
    OUTPUT_ON,
    OCP,
    OVP,
    FORCE,
    STIFFNESS,
    SPRING_AT,
    AMBIENT,
    LOSS_FACTOR,
    WIRE_CONDITION,
    CURRENT_FACTOR,
    BRIDGE,
    MORE_SERIES,
    SHUNT,
) = range(15)
INPUTS = 15
# Columns of the ring of samples.
COLUMNS = ("current_A", "voltage_V", "load_N", "displacement_m", "ambient_C")
NORMAL, OPEN, SHORT = 0.0, 1.0, 2.0
TRIP_OVP, TRIP_OCP = 1.0, 2.0
SUPPLY_TIME_CONSTANT_S = 0.4e-3  #: settles within about 1 ms


class Constants(NamedTuple):
    """Everything about a wire and its circuit that does not change while it runs."""

    length_m: float
    area_m2: float
    heat_capacity_J_K: float
    latent_J: float
    latent_r_J: float
    heat_loss_W_K: float
    as_C: float
    af_C: float
    ms_C: float
    mf_C: float
    rs_C: float
    rf_C: float
    r_hysteresis_K: float
    has_r: bool
    slope_K_Pa: float
    slope_r_K_Pa: float
    rho_m: float
    rho_a: float
    rho_r: float
    alpha_m: float
    alpha_a: float
    alpha_r: float
    modulus_m: float
    modulus_a: float
    modulus_r: float
    expansion_m: float
    expansion_a: float
    expansion_r: float
    strain_m: float
    strain_r: float
    strain_stress_0: float
    strain_stress_scale: float
    strain_shape: float
    rho_m_stress: float
    geometric_factor: float
    reference_C: float
    series_Ohm: float


def constants(wire: Wire, series_Ohm: float) -> Constants:
    """Lump a wire, and the resistances in series with it, into numbers for the kernels."""
    m = wire.material
    area_m2 = pi * wire.diameter_m**2 / 4.0
    mass_kg = m.density_kg_m3 * area_m2 * wire.length_m
    return Constants(
        wire.length_m,
        area_m2,
        mass_kg * m.specific_heat_J_kgK,
        mass_kg * m.latent_heat_J_kg,
        mass_kg * m.latent_heat_r_J_kg,
        wire.heat_transfer_W_m2K * pi * wire.diameter_m * wire.length_m,
        m.austenite_start_C,
        m.austenite_finish_C,
        m.martensite_start_C,
        m.martensite_finish_C,
        m.r_start_C,
        m.r_finish_C,
        m.r_hysteresis_K,
        m.has_r_phase,
        1.0 / m.stress_slope_Pa_K,
        1.0 / m.stress_slope_r_Pa_K,
        m.martensite.resistivity_Ohm_m,
        m.austenite.resistivity_Ohm_m,
        m.r_phase.resistivity_Ohm_m,
        m.martensite.resistivity_temperature_coefficient_1_K,
        m.austenite.resistivity_temperature_coefficient_1_K,
        m.r_phase.resistivity_temperature_coefficient_1_K,
        m.martensite.modulus_Pa,
        m.austenite.modulus_Pa,
        m.r_phase.modulus_Pa,
        m.martensite.expansion_1_K,
        m.austenite.expansion_1_K,
        m.r_phase.expansion_1_K,
        m.saturation_strain,
        m.saturation_strain_r,
        m.training_stress_Pa,
        m.strain_stress_scale_Pa,
        m.strain_shape,
        m.martensite_resistivity_stress_1_Pa,
        m.geometric_factor,
        m.reference_temperature_C,
        series_Ohm,
    )


@jit
def half_cosine(temperature_C, finish_C, start_C):
    """Liang and Rogers' cosine: 1 at or below ``finish_C``, 0 at or above ``start_C`` (eq. 2.5–2.8)."""
    if temperature_C <= finish_C:
        return 1.0
    if temperature_C >= start_C:
        return 0.0
    return 0.5 * (1.0 + cos(pi * (temperature_C - finish_C) / (start_C - finish_C)))


def new_memory(fraction: float) -> np.ndarray:
    """The memory of a transformation that stands, fully cooled (1) or fully heated (0).

    Layout: direction (+1 heating, −1 cooling), extreme of its driving coordinate, extreme of the
    other one, number of remembered heating and of cooling reversals, then their coordinates and
    fractions.
    """
    memory = np.zeros(_MEMORY)
    memory[0:3] = (-1.0, 1.0, 1.0) if fraction == 1.0 else (1.0, 0.0, 0.0)
    return memory


@jit
def transform(memory, fraction, u, v, commit):
    """Fraction of the low-temperature phase after its driving coordinates became ``u`` and ``v``.

    ``u`` falls from 1 to 0 over the heating band, ``v`` rises from 0 to 1 over the cooling band.
    From any reversal (u_0 = 1 or v_0 = 0, ξ_0) the fraction is Liang and Rogers': ξ_0·u on heating,
    (1 − ξ_0)·v + ξ_0 on cooling.  Two things are added.  ξ_0 is taken anew only when the reverse
    transformation has moved, not when the temperature merely turned; and a minor loop closes
    where it began and is then forgotten (return-point memory).  So dithering does not ratchet.

    ``memory`` changes only if ``commit``.
    """
    heating = memory[0] > 0.0
    extreme = float(memory[1])
    other = float(memory[2])
    n_heat = int(memory[3])
    n_cool = int(memory[4])
    if heating:
        if u < extreme:
            pass
        elif v > other + _EPS:
            if commit and extreme > 0.0:
                if n_heat == DEPTH:
                    for i in range(1, DEPTH):
                        memory[4 + i] = memory[5 + i]
                        memory[4 + DEPTH + i] = memory[5 + DEPTH + i]
                    n_heat = DEPTH - 1
                memory[5 + n_heat] = extreme
                memory[5 + DEPTH + n_heat] = fraction
            n_heat += 1 if extreme > 0.0 else 0
            heating = False
            extreme = other
            other = u
        else:
            if commit and v < other:
                memory[2] = v
            return fraction
    else:
        if v > extreme:
            pass
        elif u < other - _EPS:
            if commit and extreme < 1.0:
                if n_cool == DEPTH:
                    for i in range(1, DEPTH):
                        memory[4 + 2 * DEPTH + i] = memory[5 + 2 * DEPTH + i]
                        memory[4 + 3 * DEPTH + i] = memory[5 + 3 * DEPTH + i]
                    n_cool = DEPTH - 1
                memory[5 + 2 * DEPTH + n_cool] = extreme
                memory[5 + 3 * DEPTH + n_cool] = fraction
            n_cool += 1 if extreme < 1.0 else 0
            heating = True
            extreme = other
            other = v
        else:
            if commit and u > other:
                memory[2] = u
            return fraction

    if heating:
        if u <= 0.0:
            fraction = 0.0
            n_heat = 0
            n_cool = 0
        else:
            while n_heat > 0 and u <= memory[4 + n_heat]:
                extreme = float(memory[4 + n_heat])
                fraction = float(memory[4 + DEPTH + n_heat])
                n_heat -= 1
                n_cool = max(n_cool - 1, 0)
            end_u = 0.0
            end = 0.0
            if n_heat > 0:
                end_u = float(memory[4 + n_heat])
                end = float(memory[4 + DEPTH + n_heat])
            if extreme > end_u:
                fraction = end + (fraction - end) * (u - end_u) / (extreme - end_u)
        extreme = u
        other = min(other, v)
    else:
        if v >= 1.0:
            fraction = 1.0
            n_heat = 0
            n_cool = 0
        else:
            while n_cool > 0 and v >= memory[4 + 2 * DEPTH + n_cool]:
                extreme = float(memory[4 + 2 * DEPTH + n_cool])
                fraction = float(memory[4 + 3 * DEPTH + n_cool])
                n_cool -= 1
                n_heat = max(n_heat - 1, 0)
            end_v = 1.0
            end = 1.0
            if n_cool > 0:
                end_v = float(memory[4 + 2 * DEPTH + n_cool])
                end = float(memory[4 + 3 * DEPTH + n_cool])
            if extreme < end_v:
                fraction = end + (fraction - end) * (end_v - v) / (end_v - extreme)
        extreme = v
        other = max(other, u)
    if commit:
        memory[0] = 1.0 if heating else -1.0
        memory[1] = extreme
        memory[2] = other
        memory[3] = n_heat
        memory[4] = n_cool
    return fraction


@jit
def martensite_at(c, memory, fraction, temperature_C, stress_Pa, commit):
    """Martensite fraction at a temperature and stress; bands shift with stress (eq. 2.9, 2.10)."""
    t = temperature_C - stress_Pa * c.slope_K_Pa
    return transform(memory, fraction, half_cosine(t, c.as_C, c.af_C), half_cosine(t, c.mf_C, c.ms_C), commit)


@jit
def r_share_at(c, memory, share, temperature_C, stress_Pa, commit):
    """Share of R-phase in what is not martensite.

    Austenite turns to R-phase only down to where martensite starts; below, what is left of it turns
    to martensite directly.  So the higher the stress, the less R-phase (as in eq. 5.47).
    """
    if not c.has_r:
        return 0.0
    shift = stress_Pa * c.slope_r_K_Pa
    u = half_cosine(temperature_C - shift - c.r_hysteresis_K, c.rf_C, c.rs_C)
    coldest = max(temperature_C, c.ms_C + stress_Pa * c.slope_K_Pa)
    return transform(memory, share, u, half_cosine(coldest - shift, c.rf_C, c.rs_C), commit)


@jit
def strain_of(c, martensite, r_share, temperature_C, stress_Pa):
    """Strain against unstressed austenite at the reference temperature."""
    r = r_share * (1.0 - martensite)
    a = 1.0 - martensite - r
    saturation = 1.0 - exp(-(stress_Pa + c.strain_stress_0) / c.strain_stress_scale)
    transformation = saturation * (
        c.strain_m * martensite * (1.0 + c.strain_shape * (1.0 - martensite)) + c.strain_r * r
    )
    modulus = martensite * c.modulus_m + r * c.modulus_r + a * c.modulus_a
    expansion = martensite * c.expansion_m + r * c.expansion_r + a * c.expansion_a
    return transformation + stress_Pa / modulus + expansion * (temperature_C - c.reference_C)


@jit
def resistance_of(c, martensite, r_share, temperature_C, stress_Pa, strain):
    """Resistance [Ω]: mixture of the phases' resistivities (2.12, 2.15) times the geometry's change (2.13)."""
    dt = temperature_C - c.reference_C
    r = r_share * (1.0 - martensite)
    a = 1.0 - martensite - r
    rho = (
        martensite * c.rho_m * (1.0 + c.alpha_m * dt) * (1.0 + c.rho_m_stress * stress_Pa)
        + r * c.rho_r * (1.0 + c.alpha_r * dt)
        + a * c.rho_a * (1.0 + c.alpha_a * dt)
    )
    return rho * c.length_m / c.area_m2 * (1.0 + c.geometric_factor * strain)


@jit
def load_at(c, martensite, r_share, temperature_C, load_N, force_N, stiffness_N_m, spring_at_m):
    """Tension at which wire and load have the same displacement; a wire cannot push."""
    if stiffness_N_m <= 0.0:
        return max(force_N, 0.0)
    low = 0.0
    high = max(force_N + stiffness_N_m * (spring_at_m + 0.2 * c.length_m), 0.0)
    x = min(max(load_N, low), high)
    for _ in range(60):
        delta = c.length_m * strain_of(c, martensite, r_share, temperature_C, x / c.area_m2)
        wrong = x - max(force_N + stiffness_N_m * (spring_at_m - delta), 0.0)
        if abs(wrong) < 1e-9:
            break
        if wrong > 0.0:
            high = x
        else:
            low = x
        ahead = x + 1e-5
        delta = c.length_m * strain_of(c, martensite, r_share, temperature_C, ahead / c.area_m2)
        slope = (ahead - max(force_N + stiffness_N_m * (spring_at_m - delta), 0.0) - wrong) / 1e-5
        x = x - wrong / slope
        if not low < x < high:
            x = 0.5 * (low + high)
    return x


@jit
def enthalpy_of(c, martensite, r_share, temperature_C):
    """Heat content [J] above austenite at 0 °C."""
    return c.heat_capacity_J_K * temperature_C - c.latent_J * martensite - c.latent_r_J * r_share * (1.0 - martensite)


@jit
def temperature_for(c, memory_m, memory_r, martensite, r_share, temperature_C, stress_Pa, enthalpy_J):
    """Temperature at which the wire, transforming as it must, holds ``enthalpy_J``."""
    capacity = c.heat_capacity_J_K
    t1 = temperature_C + (enthalpy_J - enthalpy_of(c, martensite, r_share, temperature_C)) / capacity
    m = martensite_at(c, memory_m, martensite, t1, stress_Pa, False)
    r = r_share_at(c, memory_r, r_share, t1, stress_Pa, False)
    f1 = enthalpy_of(c, m, r, t1) - enthalpy_J
    if abs(f1) <= 1e-9 * capacity:
        return t1
    # Heat content rises with temperature: walk until the sign changes, then close in (Illinois).
    t0 = t1
    f0 = f1
    for _ in range(40):
        t1 = t0
        f1 = f0
        t0 = t1 - f1 / capacity
        m = martensite_at(c, memory_m, martensite, t0, stress_Pa, False)
        r = r_share_at(c, memory_r, r_share, t0, stress_Pa, False)
        f0 = enthalpy_of(c, m, r, t0) - enthalpy_J
        if f0 * f1 <= 0.0:
            break
    for _ in range(60):
        if abs(f0) <= 1e-9 * capacity:
            return t0
        t = t0 - f0 * (t0 - t1) / (f0 - f1)
        m = martensite_at(c, memory_m, martensite, t, stress_Pa, False)
        r = r_share_at(c, memory_r, r_share, t, stress_Pa, False)
        f = enthalpy_of(c, m, r, t) - enthalpy_J
        if f * f0 < 0.0:
            t1 = t0
            f1 = f0
        else:
            f1 *= 0.5
        t0 = t
        f0 = f
    return t0


@jit
def simulate(steps, step_s, c, state, inputs, memory_m, memory_r, ring, first):
    """Advance ``steps`` steps of ``step_s`` [s], writing each sample into ``ring`` (n, 5) from row ``first``.

    ``state`` (:data:`STATES`,), ``memory_m`` and ``memory_r`` change in place; ``inputs``
    (:data:`INPUTS`,) hold throughout, but a protection that trips cuts the output at once and
    leaves its code in ``state[TRIP]``.
    """
    time_s = float(state[TIME])
    enthalpy = float(state[ENTHALPY])
    temperature = float(state[TEMPERATURE])
    martensite = float(state[MARTENSITE])
    r_share = float(state[R_SHARE])
    load = float(state[LOAD])
    resistance = float(state[RESISTANCE])
    current = float(state[CURRENT])
    trip = float(state[TRIP])
    heat_in = float(state[HEAT_IN])
    heat_out = float(state[HEAT_OUT])
    setting = float(inputs[CURRENT_SET]) * float(inputs[CURRENT_FACTOR])
    limit = float(inputs[VOLTAGE_LIMIT])
    on = inputs[OUTPUT_ON] > 0.0 and trip == 0.0
    ocp = float(inputs[OCP])
    ovp = float(inputs[OVP])
    force = float(inputs[FORCE])
    stiffness = float(inputs[STIFFNESS])
    spring_at = float(inputs[SPRING_AT])
    ambient = float(inputs[AMBIENT])
    loss = c.heat_loss_W_K * float(inputs[LOSS_FACTOR])
    condition = float(inputs[WIRE_CONDITION])
    bridge = float(inputs[BRIDGE])
    series = c.series_Ohm + float(inputs[MORE_SERIES])
    shunt = float(inputs[SHUNT])
    response = 1.0 - exp(-step_s / SUPPLY_TIME_CONSTANT_S)
    rows = ring.shape[0]
    row = first
    strain = 0.0
    voltage = 0.0
    power = 0.0
    displacement = 0.0
    for _ in range(steps):
        seen = resistance / (1.0 + shunt * resistance)
        if condition == SHORT:
            seen = bridge
        total = seen + series
        target = 0.0
        if on and condition != OPEN:
            target = min(setting, limit / total)
        current += response * (target - current)
        if current < 1e-9:
            current = 0.0
        if condition == OPEN:
            current = 0.0
            voltage = limit if on and setting > 0.0 else 0.0
        else:
            voltage = current * total
        if on and (current > ocp or voltage > ovp):
            trip = TRIP_OCP if current > ocp else TRIP_OVP
            on = False
        through = current / (1.0 + shunt * resistance)
        power = through * through * resistance if condition == NORMAL else 0.0
        stress = load / c.area_m2
        gained = power * step_s
        lost = loss * (temperature - ambient) * step_s
        heat_in += gained
        heat_out += lost
        enthalpy += gained - lost
        temperature = temperature_for(c, memory_m, memory_r, martensite, r_share, temperature, stress, enthalpy)
        martensite = martensite_at(c, memory_m, martensite, temperature, stress, True)
        r_share = r_share_at(c, memory_r, r_share, temperature, stress, True)
        load = load_at(c, martensite, r_share, temperature, load, force, stiffness, spring_at)
        stress = load / c.area_m2
        strain = strain_of(c, martensite, r_share, temperature, stress)
        displacement = c.length_m * strain
        resistance = resistance_of(c, martensite, r_share, temperature, stress, strain)
        time_s += step_s
        ring[row, 0] = current
        ring[row, 1] = voltage
        ring[row, 2] = load
        ring[row, 3] = displacement
        ring[row, 4] = ambient
        row += 1
        if row == rows:
            row = 0
    state[TIME] = time_s
    state[ENTHALPY] = enthalpy
    state[TEMPERATURE] = temperature
    state[MARTENSITE] = martensite
    state[R_SHARE] = r_share
    state[LOAD] = load
    state[DISPLACEMENT] = displacement
    state[RESISTANCE] = resistance
    state[CURRENT] = current
    state[VOLTAGE] = voltage
    state[TRIP] = trip
    state[STRAIN] = strain
    state[POWER] = power
    state[HEAT_IN] = heat_in
    state[HEAT_OUT] = heat_out
    return row


def cold_state(c: Constants, ambient_C: float, load_N: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State and memories of a wire that has cooled to ``ambient_C`` under ``load_N``; (state, memory_m, memory_r)."""
    memory_m = new_memory(0.0)
    memory_r = new_memory(0.0)
    stress_Pa = load_N / c.area_m2
    martensite = martensite_at(c, memory_m, 0.0, ambient_C, stress_Pa, True)
    r_share = r_share_at(c, memory_r, 0.0, ambient_C, stress_Pa, True)
    state = np.zeros(STATES)
    state[TEMPERATURE] = ambient_C
    state[MARTENSITE] = martensite
    state[R_SHARE] = r_share
    state[LOAD] = load_N
    state[ENTHALPY] = enthalpy_of(c, martensite, r_share, ambient_C)
    state[STRAIN] = strain_of(c, martensite, r_share, ambient_C, stress_Pa)
    state[DISPLACEMENT] = c.length_m * state[STRAIN]
    state[RESISTANCE] = resistance_of(c, martensite, r_share, ambient_C, stress_Pa, state[STRAIN])
    return state, memory_m, memory_r
