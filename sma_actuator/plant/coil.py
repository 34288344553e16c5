"""Physics of a wire that is wound to a coil: its wire is twisted, most at the surface and not at all in the middle.

The section is cut into rings, each with its own stress, phases and memory, and one temperature for all: heat crosses a
wire of 0.25 mm in some milliseconds.  Torsion of a ring is told as tension of a straight wire by von Mises, ε = γ/√3
and σ = √3 τ, so a ring has the strain, the kinetics and the resistivity of :mod:`.physics`.  With the spring index
C = D/d, the length L = π D n of the wire and the radius r of a ring over that of the wire,

    δ = √3 C L ε,    ε(r) = r ε,    F = (π d²/4) / (√3 C) · <r σ(r)>,    1/R = (π d²/4) / L · <1/ρ(r)>,

where <> is the mean over the section.  For an elastic wire that is F = G d⁴ δ/(8 D³ n) with G = E/3.  Displacement and
twist stay proportional however far the coil is pulled out, as long as its ends do not turn and bending is left out: the
torsion of a helix of n turns is 2 π n h/L² at any height h.  Curvature (Wahl's factor) raises the stress at the inner
side and lowers it at the outer one: it belongs to what a wire bears, not to a mean over the section, and is left out
here.

Sources
    A. M. Wahl, *Mechanical Springs*, 2nd ed., McGraw-Hill 1963. C. Liang, C. A. Rogers, "Design of shape memory alloy
    springs with applications in vibration control", J. Intell. Mater. Syst. Struct. 8 (1997) 314: transformation
    and plasticity over the section of a spring.  S.-M. An, J. Ryu, M. Cho, K.-J. Cho, "Engineering design framework for
    a shape memory alloy coil spring actuator using a static two-state model", Smart Mater. Struct. 21 (2012) 055009.
"""

from __future__ import annotations

from math import copysign, exp

import numpy as np

from sma_actuator.base.jit import inlined, jit

from .closing import close_in
from .materials import Specimen
from .physics import (
    AMBIENT,
    CELL_COLUMNS,
    CELL_LENGTH_SHARE,
    CELL_MARTENSITE,
    CELL_R_SHARE,
    CELL_SLOPE_J_K,
    CELL_TEMPERATURE,
    CYCLES,
    DISPLACEMENT,
    ENTHALPY,
    FORCE,
    HEAT_IN,
    HEAT_OUT,
    LOAD,
    LOSS_FACTOR,
    MARTENSITE,
    OUTPUT_ON,
    POWER,
    R_SHARE,
    RESISTANCE,
    SPRING_AT,
    STIFFNESS,
    STRAIN,
    TEMPERATURE,
    TIME,
    TOLERANCE_K,
    TRIP,
    Constants,
    SUPPLY_TIME_CONSTANT_s,
    WireState,
    convection,
    count_cycles,
    electric,
    empty_state,
    enthalpy_of,
    martensite_at,
    r_share_at,
    resistance_of,
    shift_of,
    strain_parts,
    untrained_strain_at,
    write_sample,
)

RINGS = 5  #: of equal area: displacement and resistance lie within 0.5 % of their range of those with forty
# Columns of a ring beside those of a cell, whose share of the length is its share of the section here.
RING_RADIUS, RING_STRESS, RING_TRANSFORMATION, RING_COMPLIANCE, RING_OTHER = range(CELL_COLUMNS, CELL_COLUMNS + 5)
RING_COLUMNS = CELL_COLUMNS + 5


@inlined
def _excess(temperature_C, of):
    """By how much the section's heat content at a temperature exceeds what it is to be, transforming as it must."""
    x, bands, rings, memory_m, memory_r, shift, enthalpy_J = of
    held_J = 0.0
    for j in range(rings.shape[0]):
        stress = abs(rings[j, RING_STRESS])
        m = martensite_at(x, bands, memory_m[j], rings[j, CELL_MARTENSITE], temperature_C, stress, shift, False)
        r = r_share_at(x, bands, memory_r[j], rings[j, CELL_R_SHARE], temperature_C, stress, shift, False)
        held_J += rings[j, CELL_LENGTH_SHARE] * enthalpy_of(x, m, r, temperature_C)
    return held_J - enthalpy_J


@jit
def _temperature(x, bands, rings, memory_m, memory_r, start_C, shift, enthalpy_J, slope_J_K):
    """Temperature of a section that holds ``enthalpy_J``, as :func:`.physics.temperature_for` has it of a wire."""
    capacity = x.heat_capacity_J_K
    of = (x, bands, rings, memory_m, memory_r, shift, enthalpy_J)
    return close_in(_excess, of, start_C, slope_J_K, capacity, TOLERANCE_K * capacity)


@inlined
def _transform(x, bands, whole, rings, memory_m, memory_r, shift):
    """Temperature of the section from its heat, and the phases of every ring."""
    before_C = whole[TEMPERATURE]
    held_J = _excess(before_C, (x, bands, rings, memory_m, memory_r, shift, 0.0))
    t = _temperature(x, bands, rings, memory_m, memory_r, before_C, shift, whole[ENTHALPY], rings[0, CELL_SLOPE_J_K])
    if abs(t - before_C) > 1e-9:
        rings[0, CELL_SLOPE_J_K] = max((whole[ENTHALPY] - held_J) / (t - before_C), x.heat_capacity_J_K)
    whole[TEMPERATURE] = t
    for j in range(rings.shape[0]):
        stress = abs(rings[j, RING_STRESS])
        rings[j, CELL_TEMPERATURE] = t
        rings[j, CELL_MARTENSITE] = martensite_at(
            x, bands, memory_m[j], rings[j, CELL_MARTENSITE], t, stress, shift, True
        )
        rings[j, CELL_R_SHARE] = r_share_at(x, bands, memory_r[j], rings[j, CELL_R_SHARE], t, stress, shift, True)


@inlined
def _ring_stress(c, ring, strain):
    """Stress at which a ring has a strain; what orients its martensite is odd in stress, and was trained as it is
    loaded."""
    transformation = ring[RING_TRANSFORMATION]
    compliance = ring[RING_COMPLIANCE]
    trained = c.strain_stress_0 * ring[RING_RADIUS]
    wanted = strain - ring[RING_OTHER]
    low = (wanted - transformation) / compliance
    high = (wanted + transformation) / compliance
    x = min(max(ring[RING_STRESS], low), high)
    for _ in range(60):
        along = x + trained
        left = exp(-abs(along) / c.strain_stress_scale)
        wrong = copysign(1.0 - left, along) * transformation + x * compliance - wanted
        if abs(wrong) < 1e-13:
            break
        if wrong > 0.0:
            high = x
        else:
            low = x
        x -= wrong / (left / c.strain_stress_scale * transformation + compliance)
        if not low < x < high:
            x = 0.5 * (low + high)
    return x


@inlined
def _pull(c, rings, strain):
    """Load of a coil whose surface has a strain, and how steeply it rises with that; the rings' stresses move on."""
    mean = 0.0
    slope = 0.0
    for j in range(rings.shape[0]):
        ring = rings[j]
        radius = ring[RING_RADIUS]
        stress = _ring_stress(c, ring, radius * strain)
        ring[RING_STRESS] = stress
        left = exp(-abs(stress + c.strain_stress_0 * radius) / c.strain_stress_scale)
        softness = left / c.strain_stress_scale * ring[RING_TRANSFORMATION] + ring[RING_COMPLIANCE]
        mean += ring[CELL_LENGTH_SHARE] * radius * stress
        slope += ring[CELL_LENGTH_SHARE] * radius * radius / softness
    return c.torsion_m2 * mean, c.torsion_m2 * slope


@jit
def _mechanics(c, whole, rings, force_N, stiffness_N_m, spring_at_m):
    """The strain at which coil and load pull alike, displacement and resistance, into ``whole``; a coil does not
    push."""
    martensite = r_phase = 0.0
    temperature = whole[TEMPERATURE]
    for j in range(rings.shape[0]):
        ring = rings[j]
        m = ring[CELL_MARTENSITE]
        parts = strain_parts(c, m, ring[CELL_R_SHARE], temperature)
        ring[RING_TRANSFORMATION] = parts.transformation
        ring[RING_COMPLIANCE] = parts.compliance_1_Pa
        ring[RING_OTHER] = 0.0 - untrained_strain_at(c, whole[CYCLES], m) * ring[RING_RADIUS]
        martensite += ring[CELL_LENGTH_SHARE] * m
        r_phase += ring[CELL_LENGTH_SHARE] * ring[CELL_R_SHARE] * (1.0 - m)
    strain = whole[STRAIN]
    low, high = -0.5, 0.5
    load = 0.0
    for _ in range(60):
        load, slope = _pull(c, rings, strain)
        asked = force_N + stiffness_N_m * (spring_at_m - c.length_m * strain)
        wrong = load - max(asked, 0.0)
        if abs(wrong) < 1e-9:
            break
        if wrong > 0.0:
            high = strain
        else:
            low = strain
        if asked > 0.0:
            slope += stiffness_N_m * c.length_m
        strain -= wrong / slope
        if not low < strain < high:
            strain = 0.5 * (low + high)
    conductance = 0.0
    for j in range(rings.shape[0]):
        ring = rings[j]
        conductance += ring[CELL_LENGTH_SHARE] / resistance_of(
            c, ring[CELL_MARTENSITE], ring[CELL_R_SHARE], temperature, abs(ring[RING_STRESS]), 0.0
        )
    count_cycles(whole, martensite)
    whole[MARTENSITE] = martensite
    whole[R_SHARE] = r_phase / (1.0 - martensite) if martensite < 1.0 else 0.0
    whole[LOAD] = max(load, 0.0)
    whole[STRAIN] = strain
    whole[DISPLACEMENT] = c.length_m * strain
    whole[RESISTANCE] = 1.0 / conductance


@jit
def simulate(steps, step_s, c, wire, inputs, ring, first):
    """As :func:`.physics.simulate`, of a coil."""
    state, rings, bands = wire.whole, wire.cells, wire.bands
    memory_m, memory_r = wire.memory_m, wire.memory_r
    on = inputs[OUTPUT_ON] > 0.0
    ambient = float(inputs[AMBIENT])
    loss_W_K = c.heat_loss_W_K * float(inputs[LOSS_FACTOR])
    response = 1.0 - exp(-step_s / SUPPLY_TIME_CONSTANT_s)
    row = first
    for _ in range(steps):
        through = electric(c, state, inputs, on and state[TRIP] == 0.0, response)
        state[POWER] = through * through * state[RESISTANCE]
        excess_K = state[TEMPERATURE] - ambient
        gained = state[POWER] * step_s
        lost = loss_W_K * convection(c.convection_exponent, excess_K) * excess_K * step_s
        state[HEAT_IN] += gained
        state[HEAT_OUT] += lost
        state[ENTHALPY] += gained - lost
        _transform(c.transformation, bands, state, rings, memory_m, memory_r, shift_of(c, state[CYCLES]))
        _mechanics(c, state, rings, inputs[FORCE], inputs[STIFFNESS], inputs[SPRING_AT])
        state[TIME] += step_s
        row = write_sample(state, ambient, ring, row)
    return row


@jit
def _cool_on_its_load(c, wire, ambient_C, force_N, stiffness_N_m, spring_at_m):
    """Fill a coil's state as :func:`cold_state` says."""
    x = c.transformation
    whole, rings, memory_m, memory_r, bands = wire
    shift = shift_of(c, 0.0)
    whole[TEMPERATURE] = ambient_C
    for j in range(rings.shape[0]):
        ring = rings[j]
        stress = ring[RING_RADIUS] * force_N / c.area_m2
        ring[RING_STRESS] = stress
        ring[CELL_TEMPERATURE] = ambient_C
        ring[CELL_SLOPE_J_K] = x.heat_capacity_J_K
        ring[CELL_MARTENSITE] = martensite_at(x, bands, memory_m[j], 0.0, ambient_C, stress, shift, True)
        ring[CELL_R_SHARE] = r_share_at(x, bands, memory_r[j], 0.0, ambient_C, stress, shift, True)
        whole[ENTHALPY] += ring[CELL_LENGTH_SHARE] * enthalpy_of(
            x, ring[CELL_MARTENSITE], ring[CELL_R_SHARE], ambient_C
        )
    _mechanics(c, whole, rings, force_N, stiffness_N_m, spring_at_m)


def cold_state(
    wire: Specimen,
    c: Constants,
    ambient_C: float,
    force_N: float,
    stiffness_N_m: float = 0.0,
    spring_at_m: float = 0.0,
    count: int = RINGS,
) -> WireState:
    """A coil that has cooled to ``ambient_C`` under ``force_N``, and then hangs on its load; ``count`` rings of equal
    area."""
    edges = np.arange(count + 1) / count  # squares of the radii
    state = empty_state(wire, count, RING_COLUMNS)
    state.cells[:, CELL_LENGTH_SHARE] = 1.0 / count
    state.cells[:, RING_RADIUS] = np.sqrt(0.5 * (edges[:-1] + edges[1:]))  # as stiff in torsion as the ring
    _cool_on_its_load(c, state, float(ambient_C), float(force_N), float(stiffness_N_m), float(spring_at_m))
    return state
