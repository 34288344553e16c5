"""Wires that share nothing with ``sma_actuator.plant`` but the supply and the way a sample is written: what the
project's own benches agree on by birth, these need not.

A wire is cells along its length that lose their heat unequally, of grains each of which plays between two ramps of its
own: it becomes austenite along one, martensite along the other, and stays where it is between them (Preisach's grains,
I. D. Mayergoyz, "Mathematical models of hysteresis", 1991).  Grains may take their time, the more reluctant the more.
Resistances mix by Lichtenecker's rule, heat goes by convection that grows with the excess and by radiation, the room
swings.  Every number was chosen [F], within what makers and papers state, so that the wires differ from ours and from
one another: skewed distributions, unequal slopes for heating and cooling, a resistance that rises by a tenth before it
falls, an R-phase or none, grains that lag by seconds, a length that grows with the cycles.

``python benchmarks/control_worlds.py --law pid --physics grains-1 … --wire flexinol`` drives them; wires 4, 5 and 9
are Ni-Ti-Cu, the others Ni-Ti.
"""

from __future__ import annotations

from math import exp, log, pi, sin
from typing import NamedTuple

import numpy as np

from sma_actuator.base.jit import inlined, jit
from sma_actuator.bench.bench import Setup, STEP_s, VirtualBench
from sma_actuator.plant.physics import (
    AMBIENT,
    CYCLES,
    DISPLACEMENT,
    FORCE,
    LOAD,
    LOSS_FACTOR,
    MARTENSITE,
    OUTPUT_ON,
    POWER,
    R_SHARE,
    RESISTANCE,
    SPRING_AT,
    STATES,
    STIFFNESS,
    STRAIN,
    TEMPERATURE,
    TIME,
    TRIP,
    SUPPLY_TIME_CONSTANT_s,
    electric,
    write_sample,
)

CELLS, GRAINS = 5, 48
DENSITY_kg_m3, CONDUCTIVITY_W_mK, STEFAN_W_m2K4, KELVIN = 6450.0, 15.0, 5.67e-8, 273.15
USUAL_m = 0.1524e-3  #: diameter that the heat transfer is stated for; a finer wire loses more, by this power
FINER = 0.6
SWING_s = 640.0  #: of the room
REFERENCE_C = 25.0
#: Columns of the cells.
_TEMPERATURE, _MARTENSITE, _R, _RESISTANCE, _HEAT, _SLOPE, _R_PLAY = range(7)


class Alloy(NamedTuple):
    """A wire's numbers, as the kernels want them; temperatures at no load."""

    austenite_C: float  #: where a grain is half austenite on heating, mean
    spread_K: float  #: standard deviation of that
    skew: float
    hysteresis_K: float  #: median
    hysteresis_spread: float  #: of its logarithm
    ramp_K: float
    heating_Pa_K: float
    cooling_Pa_K: float
    strain: float
    strain_from_Pa: float  #: the stress below which no martensite is oriented
    strain_within_Pa: float  #: more stress that orients all but 1/e of the rest
    modulus_m_Pa: float
    modulus_a_Pa: float
    modulus_r_Pa: float
    rho_m_Ohm_m: float
    rho_a_Ohm_m: float
    rho_r_Ohm_m: float
    warms_m_1_K: float
    warms_a_1_K: float
    warms_r_1_K: float
    has_r: bool
    r_C: float
    r_width_K: float
    r_hysteresis_K: float
    r_Pa_K: float
    r_strain: float
    latent_J_kg: float
    latent_r_J_kg: float
    heat_capacity_J_kgK: float
    loss_W_m2K: float
    loss_grows_1_K: float
    emissivity: float
    uneven: float  #: heat loss of the ends of the row of cells over the mean
    room_K: float  #: swing of the room
    grows: float = 0.0  #: strain that a cycle leaves at 100 MPa, at first
    lag_s: float = 0.0  #: of a grain, median
    lag_spread: float = 0.0  #: of its logarithm


_1 = Alloy(
    *(78.0, 3.2, 0.6, 18.0, 0.18, 3.0, 7.5e6, 6.0e6, 0.042, 8e6, 45e6, 26e9, 62e9, 40e9),
    *(0.80e-6, 0.68e-6, 0.93e-6, 1.0e-3, 0.45e-3, 0.5e-3, True, 57.0, 9.0, 2.5, 16e6, 0.004),
    *(21e3, 5e3, 520.0, 78.0, 0.0018, 0.5, 0.05, 0.5),
)
_2 = Alloy(
    *(72.0, 4.5, -0.4, 24.0, 0.25, 4.0, 6.2e6, 8.5e6, 0.045, 15e6, 60e6, 22e9, 55e9, 35e9),
    *(0.82e-6, 0.66e-6, 0.92e-6, 0.8e-3, 0.9e-3, 0.5e-3, False, 50.0, 9.0, 2.5, 16e6, 0.004),
    *(17e3, 5e3, 480.0, 95.0, 0.001, 0.3, 0.10, 0.8),
)
_3 = Alloy(
    *(98.0, 3.5, 0.3, 26.0, 0.12, 3.0, 8.5e6, 7.5e6, 0.040, 10e6, 70e6, 30e9, 70e9, 42e9),
    *(0.78e-6, 0.70e-6, 0.99e-6, 1.2e-3, 0.5e-3, 0.4e-3, True, 68.0, 14.0, 4.0, 13e6, 0.007),
    *(24e3, 7e3, 550.0, 85.0, 0.0015, 0.6, 0.03, 0.4),
)
_4 = Alloy(
    *(66.0, 2.2, 0.2, 9.0, 0.2, 2.0, 6.8e6, 6.3e6, 0.041, 5e6, 40e6, 24e9, 58e9, 40e9),
    *(0.72e-6, 0.60e-6, 0.93e-6, 0.7e-3, 0.5e-3, 0.5e-3, False, 57.0, 9.0, 2.5, 16e6, 0.004),
    *(12e3, 5e3, 500.0, 80.0, 0.0016, 0.4, 0.04, 0.5),
)
_5 = Alloy(
    *(74.0, 3.0, 0.5, 14.0, 0.2, 3.0, 7.2e6, 7.0e6, 0.043, 12e6, 55e6, 28e9, 60e9, 40e9),
    *(0.76e-6, 0.64e-6, 0.83e-6, 1.1e-3, 0.4e-3, 0.5e-3, True, 58.0, 6.0, 2.0, 14e6, 0.006),
    *(14e3, 4e3, 530.0, 88.0, 0.0012, 0.5, 0.07, 0.6),
)
ALLOYS: dict[str, Alloy] = {
    "grains-1": _1,
    "grains-2": _2,
    "grains-3": _3,
    "grains-4": _4,
    "grains-5": _5,
    "grains-6": _1._replace(austenite_C=82.0, uneven=0.08, lag_s=0.08, lag_spread=1.2),
    "grains-7": _3._replace(
        austenite_C=84.0,
        rho_m_Ohm_m=0.80e-6,
        rho_r_Ohm_m=1.06e-6,
        r_C=62.0,
        r_width_K=10.0,
        r_strain=0.009,
        uneven=0.12,
    ),
    "grains-8": _2._replace(grows=1.2e-4, lag_s=0.03, lag_spread=1.0),
    "grains-9": _4._replace(
        hysteresis_K=12.0, heating_Pa_K=9e6, cooling_Pa_K=5e6, uneven=0.12, lag_s=0.1, lag_spread=1.0
    ),
}


@inlined
def _played(grains, austenite_C, martensite_C, ramp_K, temperature_C, hotter_K, colder_K, quick, out):
    """Where the grains of a cell go at a temperature, into ``out``; their mean."""
    total = 0.0
    for g in range(len(grains)):
        most = min(1.0, max(0.0, (austenite_C[g] + hotter_K - temperature_C) / ramp_K + 0.5))
        least = min(most, 1.0, max(0.0, (martensite_C[g] + colder_K - temperature_C) / ramp_K + 0.5))
        out[g] = grains[g] + quick[g] * (min(max(grains[g], least), most) - grains[g])
        total += out[g]
    return total / len(grains)


@inlined
def _r_played(a, share, temperature_C, stress_Pa):
    """The share of what is no martensite that is R-phase."""
    if not a.has_r:
        return 0.0
    below_K = a.r_C + stress_Pa / a.r_Pa_K - temperature_C
    least = min(1.0, max(0.0, below_K / a.r_width_K))
    most = min(1.0, max(0.0, (below_K + a.r_hysteresis_K) / a.r_width_K))
    return min(max(share, least), most)


@inlined
def _heat(a, martensite, r_phase, temperature_C):
    """Heat content [J/kg]."""
    return a.heat_capacity_J_kgK * temperature_C - a.latent_J_kg * martensite - a.latent_r_J_kg * r_phase


@inlined
def _strain(a, cell, stress_Pa, cycles):
    m, r, temperature_C = cell[_MARTENSITE], cell[_R], cell[_TEMPERATURE]
    left = a.grows * cycles / (1.0 + cycles / 60.0)
    oriented = 0.0
    if stress_Pa > a.strain_from_Pa:
        oriented = (a.strain - 0.3 * left) * (1.0 - exp(-(stress_Pa - a.strain_from_Pa) / a.strain_within_Pa))
    elastic = stress_Pa * (m / a.modulus_m_Pa + (1.0 - m - r) / a.modulus_a_Pa + r / a.modulus_r_Pa)
    expands = (9e-6 * (1.0 - m - r) + 6.6e-6 * m) * (temperature_C - REFERENCE_C)
    return left * stress_Pa / 100e6 + oriented * m + a.r_strain * r * min(1.0, stress_Pa / 60e6) + elastic + expands


@inlined
def _resistivity(a, cell, stress_Pa):
    m, r, rise_K = cell[_MARTENSITE], cell[_R], cell[_TEMPERATURE] - REFERENCE_C
    return exp(
        m * log(a.rho_m_Ohm_m * (1.0 + a.warms_m_1_K * rise_K + 3e-10 * stress_Pa))
        + (1.0 - m - r) * log(a.rho_a_Ohm_m * (1.0 + a.warms_a_1_K * rise_K))
        + r * log(a.rho_r_Ohm_m * (1.0 + a.warms_r_1_K * rise_K))
    )


@inlined
def _warm(a, cell, grains, austenite_C, martensite_C, quick, room, gained_J_kg, stress_Pa):
    """A cell with so much more heat: its temperature and phases, by secants."""
    wanted = cell[_HEAT] + gained_J_kg
    at, slope = cell[_TEMPERATURE], cell[_SLOPE]
    off = _heat(a, cell[_MARTENSITE], cell[_R], at) - wanted
    m = cell[_MARTENSITE]
    r = cell[_R_PLAY]
    hotter_K, colder_K = stress_Pa / a.heating_Pa_K, stress_Pa / a.cooling_Pa_K
    for _ in range(8):
        to = at - off / slope
        m = _played(grains, austenite_C, martensite_C, a.ramp_K, to, hotter_K, colder_K, quick, room)
        r = _r_played(a, cell[_R_PLAY], to, stress_Pa)
        left = _heat(a, m, r * (1.0 - m), to) - wanted
        if abs(to - at) > 1e-9:
            steep = (left - off) / (to - at)
            if steep > 0.5 * a.heat_capacity_J_kgK:
                slope = steep
        at, off = to, left
        if abs(off) < 1e-4 * a.heat_capacity_J_kgK:
            break
    for g in range(len(room)):
        grains[g] = room[g]
    cell[_TEMPERATURE], cell[_MARTENSITE], cell[_R], cell[_R_PLAY] = at, m, r * (1.0 - m), r
    cell[_HEAT], cell[_SLOPE] = _heat(a, m, r * (1.0 - m), at), slope


@inlined
def _mean_strain(a, cells, stress_Pa, cycles):
    total = 0.0
    for j in range(len(cells)):
        total += _strain(a, cells[j], stress_Pa, cycles)
    return total / len(cells)


@inlined
def _balance(a, cells, state, inputs, length_m, area_m2):
    """The tension that the load has at the length which it gives the wire."""
    force_N, stiffness_N_m, at_m = inputs[FORCE], inputs[STIFFNESS], inputs[SPRING_AT]
    load_N = state[LOAD] if stiffness_N_m > 0.0 else force_N
    for _ in range(4):
        here_m = length_m * _mean_strain(a, cells, load_N / area_m2, state[CYCLES])
        off = load_N - max(0.0, force_N + stiffness_N_m * (at_m - here_m))
        if abs(off) < 1e-7 or stiffness_N_m == 0.0:
            break
        more_m = length_m * _mean_strain(a, cells, (load_N + 1e-3) / area_m2, state[CYCLES])
        more = load_N + 1e-3 - max(0.0, force_N + stiffness_N_m * (at_m - more_m))
        load_N = max(0.0, load_N - 1e-3 * off / (more - off))
    return load_N


@jit
def _simulate(
    steps, a, c, state, cells, grains, austenite_C, martensite_C, quick, loses, room, inputs, ring, first, wire
):
    """``steps`` samples of a millisecond; ``wire``: length [m], section [m²], mass [kg], surface [m²], whether it has
    been hot since its last cycle was counted."""
    on = inputs[OUTPUT_ON] > 0.0
    response = 1.0 - exp(-STEP_s / SUPPLY_TIME_CONSTANT_s)
    length_m, area_m2, mass_kg, surface_m2 = wire[0], wire[1], wire[2], wire[3]
    count, row = len(cells), first
    conducts_W_K = CONDUCTIVITY_W_mK * area_m2 / length_m * count * count
    for _ in range(steps):
        state[TIME] += STEP_s
        ambient_C = inputs[AMBIENT] + a.room_K * sin(2.0 * pi * state[TIME] / SWING_s)
        through_A = electric(c, state, inputs, on and state[TRIP] == 0.0, response)
        state[POWER] = through_A * through_A * state[RESISTANCE]
        stress_Pa = state[LOAD] / area_m2
        for j in range(count):
            here_C = cells[j, _TEMPERATURE]
            excess_K = here_C - ambient_C
            lost_W = (
                a.loss_W_m2K
                * loses[j]
                * (1.0 + a.loss_grows_1_K * excess_K)
                * inputs[LOSS_FACTOR]
                * surface_m2
                * excess_K
            )
            lost_W += a.emissivity * STEFAN_W_m2K4 * surface_m2 * ((here_C + KELVIN) ** 4 - (ambient_C + KELVIN) ** 4)
            if j > 0:
                lost_W += conducts_W_K * (here_C - cells[j - 1, _TEMPERATURE])
            if j < count - 1:
                lost_W += conducts_W_K * (here_C - cells[j + 1, _TEMPERATURE])
            gained_J_kg = (through_A * through_A * cells[j, _RESISTANCE] - lost_W) * STEP_s / mass_kg
            _warm(a, cells[j], grains[j], austenite_C, martensite_C, quick, room, gained_J_kg, stress_Pa)
        load_N = _balance(a, cells, state, inputs, length_m, area_m2)
        stress_Pa = load_N / area_m2
        state[LOAD], state[STRAIN] = load_N, _mean_strain(a, cells, stress_Pa, state[CYCLES])
        state[DISPLACEMENT] = length_m * state[STRAIN]
        state[RESISTANCE] = state[TEMPERATURE] = state[MARTENSITE] = state[R_SHARE] = 0.0
        for j in range(count):
            drawn_out = length_m / area_m2 * (1.0 + 1.9 * _strain(a, cells[j], stress_Pa, state[CYCLES]))
            cells[j, _RESISTANCE] = _resistivity(a, cells[j], stress_Pa) * drawn_out
            state[RESISTANCE] += cells[j, _RESISTANCE] / count
            state[TEMPERATURE] += cells[j, _TEMPERATURE] / count
            state[MARTENSITE] += cells[j, _MARTENSITE] / count
            state[R_SHARE] += cells[j, _R_PLAY] / count
        if state[MARTENSITE] < 0.3:
            wire[4] = 1.0
        elif state[MARTENSITE] > 0.7 and wire[4] > 0.0:
            wire[4] = 0.0
            state[CYCLES] += 1.0
        row = write_sample(state, ambient_C, ring, row)
    return row


class GrainsBench(VirtualBench):
    """The virtual bench with such a wire in the place of its own: of ``setup.wire`` only the size counts."""

    def __init__(self, name: str, setup: Setup, seed: int = 0, cycles: float = 0.0):
        finer = (USUAL_m / setup.wire.diameter_m) ** FINER
        self._alloy = ALLOYS[name]._replace(loss_W_m2K=finer * ALLOYS[name].loss_W_m2K)
        self._done = cycles
        self._drawn = int(name.rpartition("-")[2])
        super().__init__(setup, seed)

    def _rest(self, ambient_C: float) -> None:
        a, wire = self._alloy, self.setup.wire
        rng = np.random.default_rng(self._drawn)
        normal = rng.standard_normal(GRAINS)
        normal = (normal - normal.mean()) / normal.std()
        self._austenite_C = a.austenite_C + a.spread_K * (normal + a.skew * (normal**2 - 1.0) / 3.0)
        spread = a.hysteresis_spread * (0.5 * normal + rng.standard_normal(GRAINS))
        self._martensite_C = self._austenite_C - a.hysteresis_K * np.exp(spread)
        self._loses = 1.0 + a.uneven * np.linspace(-1.0, 1.0, CELLS)[rng.permutation(CELLS)]
        lag_s = a.lag_s * np.exp(a.lag_spread * rng.standard_normal(GRAINS))
        self._quick = 1.0 - np.exp(-STEP_s / lag_s) if a.lag_s else np.ones(GRAINS)
        area_m2 = pi * wire.diameter_m**2 / 4.0
        surface_m2 = pi * wire.diameter_m * wire.length_m
        self._size = np.array([wire.length_m, area_m2, DENSITY_kg_m3 * area_m2 * wire.length_m, surface_m2, 0.0])
        self._room = np.zeros(GRAINS)
        self._state = np.zeros(STATES)
        force_N, _, _ = self.load.at(0.0)
        self._state[LOAD], self._state[CYCLES] = force_N, self._done
        stress_Pa = force_N / area_m2
        grains = np.clip((self._martensite_C + stress_Pa / a.cooling_Pa_K - ambient_C) / a.ramp_K + 0.5, 0.0, 1.0)
        self._grains = np.tile(grains, (CELLS, 1))
        martensite = float(grains.mean())
        r = _r_played(self._alloy, 1.0, ambient_C, stress_Pa)
        heat = _heat(self._alloy, martensite, r * (1.0 - martensite), ambient_C)
        cell = ambient_C, martensite, r * (1.0 - martensite), 0.0, heat, a.heat_capacity_J_kgK, r
        self._cells = np.tile(cell, (CELLS, 1)).astype(float)
        self._cells[:, _RESISTANCE] = _resistivity(self._alloy, self._cells[0], stress_Pa) * wire.length_m / area_m2
        self._state[RESISTANCE], self._state[TEMPERATURE] = self._cells[0, _RESISTANCE], ambient_C
        self._state[MARTENSITE], self._state[R_SHARE] = martensite, r

    @property
    def hottest_C(self) -> float:
        """Temperature of the wire's hottest cell [°C]."""
        return float(self._cells[:, _TEMPERATURE].max())

    @property
    def cycles(self) -> float:
        """How many the wire has done on this bench."""
        return float(self._state[CYCLES]) - self._done

    def _simulate(self, steps: int) -> None:
        self._row = _simulate(
            steps,
            self._alloy,
            self.constants,
            self._state,
            self._cells,
            self._grains,
            self._austenite_C,
            self._martensite_C,
            self._quick,
            self._loses,
            self._room,
            self._inputs,
            self._ring,
            self._row,
            self._size,
        )
        self._count(steps)
