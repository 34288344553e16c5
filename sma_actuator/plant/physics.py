"""Physics of one loaded wire that carries a current: heat, transformation, strain, resistance.

All kernels are scalar; :func:`simulate` is the loop over steps.  The heat balance is kept as an
enthalpy, so that no energy is lost to the solution's tolerance, however abrupt a transformation.
How the fraction of martensite follows temperature and stress is a part to choose (:mod:`.kinetics`);
a wire is one cell of one temperature or, where clamps cool its ends, several from the clamp inwards.
"""

from __future__ import annotations

from math import exp, pi, sqrt
from typing import NamedTuple

import numpy as np

from sma_actuator.base.jit import inlined, jit

from .closing import close_in
from .kinetics import (
    ACTIVATED,
    COOLING,
    MEASURED,
    START_C,
    Shift,
    SLOPE_K_Pa,
    crossed,
    half_cosine,
    logistic,
    martensite_after,
    new_memory,
    transform,
)
from .materials import Specimen

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
    CYCLES,
    HOT,
) = range(17)
STATES = 17
# Columns of the array of cells.
(
    CELL_ENTHALPY,
    CELL_TEMPERATURE,
    CELL_MARTENSITE,
    CELL_R_SHARE,
    CELL_LENGTH_SHARE,
    CELL_CONDUCTANCE_W_K,
    CELL_SLOPE_J_K,
    CELL_SLEEVE_C,
    CELL_FORMED,
    CELL_ORIENTED,
) = range(10)
CELL_COLUMNS = 10
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
SUPPLY_TIME_CONSTANT_s = 0.4e-3  #: settles within about 1 ms
HOT_BELOW, COLD_ABOVE = 0.4, 0.6  #: fractions of martensite between which a cycle is counted
CONVECTION_AT_K = 60.0  #: excess at which the heat transfer has its stated value, whatever its exponent
LOGISTIC_OF_BAND = 0.134  #: width of the logistic with the same 10-90 % width as a cosine, per width of the cosine
TOLERANCE_K = (
    1e-7  #: of the temperature that goes with a heat content; it does not add up, since the heat is what is kept
)
_END_CELLS = (0.5, 1.0, 1.5)  #: lengths of the cells next to a clamp, in units of the decay length


class Transformation(NamedTuple):
    """What decides phases and temperature from heat; the bands of the martensite are in :class:`WireState`."""

    family: int  #: of the kinetics
    heat_capacity_J_K: float
    latent_J: float
    latent_r_J: float
    has_r: bool
    rs_C: float
    rf_C: float
    r_hysteresis_K: float
    slope_r_K_Pa: float


class Constants(NamedTuple):
    """Everything about a wire and its circuit that does not change while it runs."""

    length_m: float  #: displacement over strain
    area_m2: float  #: load over stress
    path_m: float  #: of the current
    path_area_m2: float
    torsion_m2: float  #: of a coil: load over the section's mean of radius · stress (:mod:`.coil`); 0: none
    transformation: Transformation
    heat_loss_W_K: float
    sleeve_J_K: float  #: 0: none
    sleeve_inner: float  #: conductance into it over the heat loss
    sleeve_outer: float
    convection_exponent: float
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
    turned: float  #: below 0: martensite follows its load at once
    rho_m_stress: float
    geometric_factor: float
    reference_C: float
    series_Ohm: float
    untrained_strain: float
    untrained_cold_share: float
    untrained_heating_K: float
    untrained_cooling_K: float
    training_cycles: float


class WireState(NamedTuple):
    """What changes in place while a wire runs, and the bands of its kinetics.

    Cells run from the clamps inwards: their share of the length, the conductance to the one before (of the first: to
    the clamps), and their state, with the enthalpy the whole wire would have in it, and how steeply it rose at last.
    """

    whole: np.ndarray  #: (:data:`STATES`,)
    cells: np.ndarray  #: (n, :data:`CELL_COLUMNS`)
    memory_m: np.ndarray  #: (n, memory)
    memory_r: np.ndarray
    bands: np.ndarray


class Strain(NamedTuple):
    """What a wire's strain under any stress is made of."""

    transformation: float  #: where the stress orients all of the martensite
    compliance_1_Pa: float
    other: float  #: thermal expansion, and what is permanent


def constants(wire: Specimen, series_Ohm: float) -> Constants:
    """Lump a wire, and the resistances in series with it, into numbers for the kernels."""
    m = wire.material
    section_m2 = pi * wire.diameter_m**2 / 4.0
    mass_kg = m.density_kg_m3 * section_m2 * wire.length_m * wire.wires
    untrained, sleeve = wire.untrained, wire.sleeve
    index = wire.coil_diameter_m / wire.diameter_m
    wahl = (4.0 * index - 1.0) / (4.0 * index - 4.0) + 0.615 / index if index else 0.0
    return Constants(
        length_m=sqrt(3.0) * index * wire.length_m if index else wire.length_m,
        area_m2=section_m2 / (2.0 * sqrt(3.0) * index * wahl) if index else section_m2 * wire.wires,
        path_m=wire.length_m * (wire.wires if wire.in_series else 1),
        path_area_m2=section_m2 * (1 if wire.in_series else wire.wires),
        torsion_m2=section_m2 / (sqrt(3.0) * index) if index else 0.0,
        transformation=Transformation(
            family=wire.kinetics.family,
            heat_capacity_J_K=mass_kg * m.specific_heat_J_kgK,
            latent_J=mass_kg * m.latent_heat_J_kg,
            latent_r_J=mass_kg * m.latent_heat_r_J_kg,
            has_r=m.has_r_phase,
            rs_C=m.r_start_C,
            rf_C=m.r_finish_C,
            r_hysteresis_K=m.r_hysteresis_K,
            slope_r_K_Pa=1.0 / m.stress_slope_r_Pa_K,
        ),
        heat_loss_W_K=wire.heat_transfer_W_m2K * pi * wire.diameter_m * wire.length_m * wire.wires,
        sleeve_J_K=mass_kg * m.specific_heat_J_kgK * sleeve.heat_capacity if sleeve else 0.0,
        sleeve_inner=sleeve.inner_conductance if sleeve else 0.0,
        sleeve_outer=sleeve.outer_conductance if sleeve else 0.0,
        convection_exponent=wire.convection_exponent,
        rho_m=m.martensite.resistivity_Ohm_m,
        rho_a=m.austenite.resistivity_Ohm_m,
        rho_r=m.r_phase.resistivity_Ohm_m,
        alpha_m=m.martensite.resistivity_temperature_coefficient_1_K,
        alpha_a=m.austenite.resistivity_temperature_coefficient_1_K,
        alpha_r=m.r_phase.resistivity_temperature_coefficient_1_K,
        modulus_m=m.martensite.modulus_Pa,
        modulus_a=m.austenite.modulus_Pa,
        modulus_r=m.r_phase.modulus_Pa,
        expansion_m=m.martensite.expansion_1_K,
        expansion_a=m.austenite.expansion_1_K,
        expansion_r=m.r_phase.expansion_1_K,
        strain_m=m.saturation_strain,
        strain_r=m.saturation_strain_r,
        strain_stress_0=m.training_stress_Pa,
        strain_stress_scale=m.strain_stress_scale_Pa,
        strain_shape=m.strain_shape,
        turned=-1.0 if wire.turned is None else wire.turned,
        rho_m_stress=m.martensite_resistivity_stress_1_Pa,
        geometric_factor=m.geometric_factor,
        reference_C=m.reference_temperature_C,
        series_Ohm=series_Ohm,
        untrained_strain=untrained.hot_strain if untrained else 0.0,
        untrained_cold_share=untrained.cold_share if untrained else 0.0,
        untrained_heating_K=untrained.heating_K if untrained else 0.0,
        untrained_cooling_K=untrained.cooling_K if untrained else 0.0,
        training_cycles=untrained.cycles if untrained else 1.0,
    )


def _cells(wire: Specimen) -> tuple[np.ndarray, np.ndarray]:
    """Shares of the length and conductances, from the clamps inwards; both ends lie in the same cells.

    Towards the middle the temperature's distance from that of an endless wire decays as exp(−x/ℓ),
    ℓ² = k d / (4 h), so the last end cell sees the middle across its own half and one ℓ.
    """
    if not wire.clamped:
        return np.ones(1), np.zeros(1)
    conductivity_W_mK = wire.material.conductivity_W_mK
    decay_m = sqrt(conductivity_W_mK * wire.diameter_m / (4.0 * wire.heat_transfer_W_m2K))
    decay_m = min(decay_m, wire.length_m / (4.0 * sum(_END_CELLS)))  # a very short wire still has a middle
    ends_m = np.array(_END_CELLS) * decay_m
    lengths_m = np.append(ends_m, 0.5 * wire.length_m - ends_m.sum())
    half_m = np.append(0.5 * ends_m, decay_m)
    distances_m = half_m + np.append(0.0, half_m[:-1])
    area_m2 = pi * wire.diameter_m**2 / 4.0
    return 2.0 * lengths_m / wire.length_m, 2.0 * conductivity_W_mK * area_m2 / distances_m


@jit
def martensite_at(x, bands, memory, fraction, temperature_C, stress_Pa, shift, commit):
    """Martensite fraction at a temperature and stress; ``memory`` changes only if ``commit``."""
    return martensite_after(x.family, bands, memory, fraction, temperature_C, stress_Pa, shift, commit)


@inlined
def _r_band(x, temperature_C):
    """Share of R-phase along its band, as smooth as the kinetics of the martensite."""
    if x.family in (MEASURED, ACTIVATED):
        return logistic(temperature_C, 0.5 * (x.rs_C + x.rf_C), LOGISTIC_OF_BAND * (x.rs_C - x.rf_C))
    return half_cosine(temperature_C, x.rf_C, x.rs_C)


@inlined
def r_share_at(x, bands, memory, share, temperature_C, stress_Pa, shift, commit):
    """Share of R-phase in what is not martensite.

    Austenite turns to R-phase only down to where martensite starts; below, what is left of it turns
    to martensite directly.  So the higher the stress, the less R-phase (as in eq. 5.47).
    """
    if not x.has_r:
        return 0.0
    r_shift = stress_Pa * x.slope_r_K_Pa + shift.cooling_K
    martensite_start_C = bands[COOLING, START_C] + stress_Pa * bands[COOLING, SLOPE_K_Pa] + shift.cooling_K
    coldest = max(temperature_C, martensite_start_C)
    u = _r_band(x, temperature_C - r_shift - x.r_hysteresis_K)
    return transform(memory, share, u, _r_band(x, coldest - r_shift), commit)


@inlined
def strain_parts(c, martensite, r_share, temperature_C):
    """The strain's parts, against unstressed austenite at the reference temperature."""
    r = r_share * (1.0 - martensite)
    a = 1.0 - martensite - r
    transformation = c.strain_m * martensite * (1.0 + c.strain_shape * (1.0 - martensite)) + c.strain_r * r
    modulus = martensite * c.modulus_m + r * c.modulus_r + a * c.modulus_a
    expansion = martensite * c.expansion_m + r * c.expansion_r + a * c.expansion_a
    return Strain(transformation, 1.0 / modulus, expansion * (temperature_C - c.reference_C))


@inlined
def saturation_at(c, stress_Pa):
    """How much of its strain martensite has that forms under a stress."""
    return 1.0 - exp(-(stress_Pa + c.strain_stress_0) / c.strain_stress_scale)


@inlined
def _oriented(c, cells, j, parts, stress_Pa):
    """The same parts of a cell whose martensite has the orientation of the stress it formed under.

    A larger one turns all of it to :attr:`Constants.turned` of its own at the least; what transforms back takes its
    share along.
    """
    m, was, here = cells[j, CELL_MARTENSITE], cells[j, CELL_FORMED], saturation_at(c, stress_Pa)
    if m > was:
        cells[j, CELL_ORIENTED] += here * (m - was)
    elif was > 0.0:
        cells[j, CELL_ORIENTED] *= m / was
    cells[j, CELL_FORMED] = m
    cells[j, CELL_ORIENTED] = max(cells[j, CELL_ORIENTED], c.turned * here * m)
    of_r = c.strain_r * cells[j, CELL_R_SHARE] * (1.0 - m)
    of_m = (parts.transformation - of_r) * cells[j, CELL_ORIENTED] / m if m > 0.0 else 0.0
    return Strain(of_r, parts.compliance_1_Pa, parts.other + of_m)


@inlined
def strain_under(c, parts, stress_Pa):
    """Strain of which these are the parts."""
    return saturation_at(c, stress_Pa) * parts.transformation + stress_Pa * parts.compliance_1_Pa + parts.other


@inlined
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
    return rho * c.path_m / c.path_area_m2 * (1.0 + c.geometric_factor * strain)


@jit
def load_at(c, parts, load_N, force_N, stiffness_N_m, spring_at_m):
    """Tension at which wire and load have the same displacement; a wire cannot push."""
    if stiffness_N_m <= 0.0:
        return max(force_N, 0.0)
    low = 0.0
    high = max(force_N + stiffness_N_m * (spring_at_m + 0.2 * c.length_m), 0.0)
    x = min(max(load_N, low), high)
    for _ in range(60):
        delta = c.length_m * strain_under(c, parts, x / c.area_m2)
        wrong = x - max(force_N + stiffness_N_m * (spring_at_m - delta), 0.0)
        if abs(wrong) < 1e-9:
            break
        if wrong > 0.0:
            high = x
        else:
            low = x
        ahead = x + 1e-5
        delta = c.length_m * strain_under(c, parts, ahead / c.area_m2)
        slope = (ahead - max(force_N + stiffness_N_m * (spring_at_m - delta), 0.0) - wrong) / 1e-5
        x = x - wrong / slope
        if not low < x < high:
            x = 0.5 * (low + high)
    return x


@jit
def enthalpy_of(x, martensite, r_share, temperature_C):
    """Heat content [J] above austenite at 0 °C."""
    return x.heat_capacity_J_K * temperature_C - x.latent_J * martensite - x.latent_r_J * r_share * (1.0 - martensite)


@inlined
def _excess(temperature_C, of):
    """By how much the heat content at a temperature exceeds what it is to be, transforming as it must."""
    x, bands, memory_m, memory_r, martensite, r_share, stress_Pa, shift, enthalpy_J = of
    m = martensite_after(x.family, bands, memory_m, martensite, temperature_C, stress_Pa, shift, False)
    r = r_share_at(x, bands, memory_r, r_share, temperature_C, stress_Pa, shift, False)
    return enthalpy_of(x, m, r, temperature_C) - enthalpy_J


@jit
def temperature_for(
    x, bands, memory_m, memory_r, martensite, r_share, temperature_C, stress_Pa, shift, enthalpy_J, slope_J_K
):
    """Temperature at which the wire, transforming as it must, holds ``enthalpy_J``.

    ``slope_J_K`` is how steeply the heat content is expected to rise: what it was in the step before saves half of the
    tries, and the heat capacity, which it cannot be less than, is always a sound guess.
    """
    capacity = x.heat_capacity_J_K
    start_C = temperature_C + (enthalpy_J - enthalpy_of(x, martensite, r_share, temperature_C)) / slope_J_K
    of = (x, bands, memory_m, memory_r, martensite, r_share, stress_Pa, shift, enthalpy_J)
    return close_in(_excess, of, start_C, slope_J_K, capacity, TOLERANCE_K * capacity)


@inlined
def convection(exponent, excess_K):
    """Heat transfer over that at :data:`CONVECTION_AT_K` above the air: natural convection grows with the excess."""
    if exponent <= 0.0:
        return 1.0
    return (max(abs(excess_K), 0.1) / CONVECTION_AT_K) ** exponent


@inlined
def electric(c, state, inputs, on, response):
    """Supply and circuit for one step: current and voltage into ``state``; the current through the wire [A]."""
    resistance = state[RESISTANCE]
    condition = inputs[WIRE_CONDITION]
    shunted = 1.0 + inputs[SHUNT] * resistance
    seen = inputs[BRIDGE] if condition == SHORT else resistance / shunted
    total = seen + c.series_Ohm + inputs[MORE_SERIES]
    setting = inputs[CURRENT_SET] * inputs[CURRENT_FACTOR]
    target = min(setting, inputs[VOLTAGE_LIMIT] / total) if on and condition != OPEN else 0.0
    current = state[CURRENT] + response * (target - state[CURRENT])
    if current < 1e-9:
        current = 0.0
    if condition == OPEN:
        current = 0.0
        voltage = inputs[VOLTAGE_LIMIT] if on and setting > 0.0 else 0.0
    else:
        voltage = current * total
    state[CURRENT] = current
    state[VOLTAGE] = voltage
    if on and (current > inputs[OCP] or voltage > inputs[OVP]):
        state[TRIP] = TRIP_OCP if current > inputs[OCP] else TRIP_OVP
    return current / shunted if condition == NORMAL else 0.0


@inlined
def _heat(c, whole, cells, through_A, stress_Pa, loss_W_K, ambient_C, step_s):
    """The heat of every cell after one step: the current heats it, air (through the sleeve) and neighbours cool it."""
    heat_in = 0.0
    heat_out = 0.0
    before_C = ambient_C  # the temperature of the neighbour, at the beginning of the step
    for j in range(cells.shape[0]):
        temperature = cells[j, CELL_TEMPERATURE]
        surface_C = cells[j, CELL_SLEEVE_C] if c.sleeve_J_K > 0.0 else temperature
        excess_K = surface_C - ambient_C
        power = 0.0
        if through_A > 0.0:
            resistance = whole[RESISTANCE]
            if cells.shape[0] > 1:
                resistance = resistance_of(
                    c, cells[j, CELL_MARTENSITE], cells[j, CELL_R_SHARE], temperature, stress_Pa, whole[STRAIN]
                )
            power = through_A * through_A * resistance
        gained = power * step_s
        lost = loss_W_K * convection(c.convection_exponent, excess_K) * excess_K * step_s
        if c.sleeve_J_K > 0.0:
            into_air = c.sleeve_outer * lost
            lost = c.sleeve_inner * c.heat_loss_W_K * (temperature - surface_C) * step_s
            cells[j, CELL_SLEEVE_C] += (lost - into_air) / c.sleeve_J_K
        share = cells[j, CELL_LENGTH_SHARE]
        heat_in += share * gained
        heat_out += share * lost
        cells[j, CELL_ENTHALPY] += gained - lost
        if cells[j, CELL_CONDUCTANCE_W_K] > 0.0:
            flow = cells[j, CELL_CONDUCTANCE_W_K] * (temperature - before_C) * step_s
            cells[j, CELL_ENTHALPY] -= flow / share
            if j == 0:
                heat_out += flow  # the clamps take it, and stay as cold as the air
            else:
                cells[j - 1, CELL_ENTHALPY] += flow / cells[j - 1, CELL_LENGTH_SHARE]
            before_C = temperature
    whole[HEAT_IN] += heat_in
    whole[HEAT_OUT] += heat_out


@inlined
def _transform(x, bands, cells, memory_m, memory_r, stress_Pa, shift, step_s):
    """Temperature and phases of every cell from its heat; what takes time to transform has had ``step_s``."""
    for j in range(cells.shape[0]):
        of_m = memory_m[j]
        of_r = memory_r[j]
        martensite = cells[j, CELL_MARTENSITE]
        r_share = cells[j, CELL_R_SHARE]
        before_C = cells[j, CELL_TEMPERATURE]
        if x.family == ACTIVATED:
            martensite = crossed(bands, of_m, before_C, stress_Pa, shift, step_s)
        enthalpy = cells[j, CELL_ENTHALPY]
        slope = cells[j, CELL_SLOPE_J_K]
        held = enthalpy_of(x, martensite, r_share, before_C)
        t = temperature_for(x, bands, of_m, of_r, martensite, r_share, before_C, stress_Pa, shift, enthalpy, slope)
        if abs(t - before_C) > 1e-9:
            cells[j, CELL_SLOPE_J_K] = max((enthalpy - held) / (t - before_C), x.heat_capacity_J_K)
        cells[j, CELL_TEMPERATURE] = t
        if x.family != ACTIVATED:
            martensite = martensite_at(x, bands, of_m, martensite, t, stress_Pa, shift, True)
        cells[j, CELL_MARTENSITE] = martensite
        cells[j, CELL_R_SHARE] = r_share_at(x, bands, of_r, r_share, t, stress_Pa, shift, True)


@jit
def untrained_after(c, cycles):
    """How far from trained a wire is after so many cycles: 1 − (1 − exp(−N/N_0))."""
    return exp(-cycles / c.training_cycles)


@inlined
def untrained_strain_at(c, cycles, martensite):
    """By how much strain a wire that is still in training is shorter than it will be: contracted most."""
    if c.untrained_strain <= 0.0:
        return 0.0
    grown = 1.0 - (1.0 - c.untrained_cold_share) * martensite
    return c.untrained_strain * untrained_after(c, cycles) * grown


@inlined
def shift_of(c, cycles):
    """Where the bands of a wire lie that is still in training."""
    if c.untrained_heating_K == 0.0 and c.untrained_cooling_K == 0.0:
        return Shift(0.0, 0.0)
    untrained = untrained_after(c, cycles)
    return Shift(untrained * c.untrained_heating_K, untrained * c.untrained_cooling_K)


@inlined
def count_cycles(whole, martensite):
    """A cycle ends where a wire that was hot is cold again."""
    if martensite < HOT_BELOW:
        whole[HOT] = 1.0
    elif martensite > COLD_ABOVE and whole[HOT] > 0.0:
        whole[HOT] = 0.0
        whole[CYCLES] += 1.0


@inlined
def _mechanics(c, whole, cells, force_N, stiffness_N_m, spring_at_m):
    """Means over the cells, the tension that balances the load, displacement and resistance, into ``whole``."""
    n = cells.shape[0]
    enthalpy = temperature = martensite = r_phase = r_share = 0.0
    transformation = compliance = other = 0.0
    for j in range(n):
        share = cells[j, CELL_LENGTH_SHARE]
        m = cells[j, CELL_MARTENSITE]
        r = cells[j, CELL_R_SHARE]
        t = cells[j, CELL_TEMPERATURE]
        parts = strain_parts(c, m, r, t)
        if c.turned >= 0.0:
            parts = _oriented(c, cells, j, parts, whole[LOAD] / c.area_m2)
        enthalpy += share * cells[j, CELL_ENTHALPY]
        temperature += share * t
        martensite += share * m
        r_share += share * r
        r_phase += share * r * (1.0 - m)
        transformation += share * parts.transformation
        compliance += share * parts.compliance_1_Pa
        other += share * parts.other
    if n > 1 and martensite < 1.0:
        r_share = r_phase / (1.0 - martensite)
    other -= untrained_strain_at(c, whole[CYCLES], martensite)
    parts = Strain(transformation, compliance, other)
    load = load_at(c, parts, whole[LOAD], force_N, stiffness_N_m, spring_at_m)
    stress = load / c.area_m2
    strain = strain_under(c, parts, stress)
    resistance = 0.0
    for j in range(n):
        resistance += cells[j, CELL_LENGTH_SHARE] * resistance_of(
            c,
            cells[j, CELL_MARTENSITE],
            cells[j, CELL_R_SHARE],
            cells[j, CELL_TEMPERATURE],
            stress,
            strain,
        )
    count_cycles(whole, martensite)
    whole[ENTHALPY] = enthalpy
    whole[TEMPERATURE] = temperature
    whole[MARTENSITE] = martensite
    whole[R_SHARE] = r_share
    whole[LOAD] = load
    whole[STRAIN] = strain
    whole[DISPLACEMENT] = c.length_m * strain
    whole[RESISTANCE] = resistance


@inlined
def write_sample(whole, ambient_C, ring, row):
    """Write a row of ``ring``; the one that comes next."""
    ring[row, 0] = whole[CURRENT]
    ring[row, 1] = whole[VOLTAGE]
    ring[row, 2] = whole[LOAD]
    ring[row, 3] = whole[DISPLACEMENT]
    ring[row, 4] = ambient_C
    row += 1
    return 0 if row == ring.shape[0] else row


@jit
def simulate(steps, step_s, c, wire, inputs, ring, first):
    """Advance ``steps`` steps of ``step_s`` [s], writing each sample into ``ring`` (n, 5) from row ``first``.

    ``wire`` (:class:`WireState`) changes in place; ``inputs`` (:data:`INPUTS`,) hold throughout, but a
    protection that trips cuts the output at once and leaves its code in ``wire.whole[TRIP]``.
    """
    state, cells, bands = wire.whole, wire.cells, wire.bands
    memory_m, memory_r = wire.memory_m, wire.memory_r
    on = inputs[OUTPUT_ON] > 0.0
    ambient = float(inputs[AMBIENT])
    loss = c.heat_loss_W_K * float(inputs[LOSS_FACTOR])
    response = 1.0 - exp(-step_s / SUPPLY_TIME_CONSTANT_s)
    row = first
    for _ in range(steps):
        through = electric(c, state, inputs, on and state[TRIP] == 0.0, response)
        state[POWER] = through * through * state[RESISTANCE]
        stress = state[LOAD] / c.area_m2
        _heat(c, state, cells, through, stress, loss, ambient, step_s)
        _transform(c.transformation, bands, cells, memory_m, memory_r, stress, shift_of(c, state[CYCLES]), step_s)
        _mechanics(c, state, cells, inputs[FORCE], inputs[STIFFNESS], inputs[SPRING_AT])
        state[TIME] += step_s
        row = write_sample(state, ambient, ring, row)
    return row


@jit
def _cool_on_its_load(c, wire, ambient_C, force_N, stiffness_N_m, spring_at_m):
    """Fill a wire's state as :func:`cold_state` says.  One kernel, since the parts that are compiled into their callers
    are compiled anew by every process that calls them from Python: seconds at every start of a bench."""
    x = c.transformation
    whole, cells, memory_m, memory_r, bands = wire
    stress_Pa = force_N / c.area_m2
    shift = shift_of(c, 0.0)
    for j in range(cells.shape[0]):
        cells[j, CELL_TEMPERATURE] = ambient_C
        cells[j, CELL_SLOPE_J_K] = x.heat_capacity_J_K
        cells[j, CELL_MARTENSITE] = martensite_at(x, bands, memory_m[j], 0.0, ambient_C, stress_Pa, shift, True)
        cells[j, CELL_R_SHARE] = r_share_at(x, bands, memory_r[j], 0.0, ambient_C, stress_Pa, shift, True)
        cells[j, CELL_ENTHALPY] = enthalpy_of(x, cells[j, CELL_MARTENSITE], cells[j, CELL_R_SHARE], ambient_C)
        cells[j, CELL_SLEEVE_C] = ambient_C
    whole[LOAD] = force_N
    _mechanics(c, whole, cells, force_N, stiffness_N_m, spring_at_m)


def empty_state(wire: Specimen, cells: int, columns: int) -> WireState:
    """The state of a wire of so many cells, all zero and as if it had been heated through."""
    return WireState(
        whole=np.zeros(STATES),
        cells=np.zeros((cells, columns)),
        memory_m=np.array([new_memory(0.0, wire.kinetics.family) for _ in range(cells)]),
        memory_r=np.array([new_memory(0.0) for _ in range(cells)]),
        bands=wire.kinetics.bands(),
    )


def cold_state(
    wire: Specimen, c: Constants, ambient_C: float, force_N: float, stiffness_N_m: float = 0.0, spring_at_m: float = 0.0
) -> WireState:
    """A wire that has cooled to ``ambient_C`` under ``force_N``, and then hangs on its load."""
    shares, conductances_W_K = _cells(wire)
    state = empty_state(wire, len(shares), CELL_COLUMNS)
    state.cells[:, CELL_LENGTH_SHARE], state.cells[:, CELL_CONDUCTANCE_W_K] = shares, conductances_W_K
    _cool_on_its_load(c, state, float(ambient_C), float(force_N), float(stiffness_N_m), float(spring_at_m))
    return state
