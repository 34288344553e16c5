"""The worlds beside home: each conserves energy, drives, and has what it says it has."""

import math

import numpy as np
import pytest

from sma_actuator.bench import Spring, VirtualBench, Weight
from sma_actuator.plant import physics
from sma_actuator.plant.materials import WIRES
from sma_actuator.plant.worlds import DRAWN, HOME, IN_TRAINING, WORLDS, wire_in_world, world_of

AWAY = [name for name in WORLDS if name != HOME]
DRAWN_WORLDS = [f"{DRAWN}{number}" for number in range(1, 7)]
HEATING_A = {"flexinol": 0.33, "furukawa": 0.55}


def powered(wire, world, load=None):
    bench = VirtualBench.from_name(wire, load=load or Weight(0.98), physics=world)
    bench.supply.set_voltage(6.0)
    bench.supply.set_current(0.05)
    bench.supply.set_output(True)
    return bench


def cycle(bench, wire, hot_s=6.0, cold_s=12.0):
    """Displacement at the hot end and at the cold one."""
    bench.supply.set_current(HEATING_A[wire])
    bench.advance(bench.time_s + hot_s)
    hot_m = bench.truth.displacement_m
    bench.supply.set_current(0.05)
    bench.advance(bench.time_s + cold_s)
    return hot_m, bench.truth.displacement_m


@pytest.mark.parametrize("wire", HEATING_A)
@pytest.mark.parametrize("world", AWAY + DRAWN_WORLDS)
def test_every_world_drives_both_alloys_and_no_energy_is_lost(wire, world):
    bench = powered(wire, world, Spring(200.0, 0.5))
    began_J = bench.heat_J[2]
    hot_m, cold_m = cycle(bench, wire, hot_s=10.0)  # the hottest take as long at this current
    assert cold_m - hot_m > 0.015 * WIRES[wire].length_m
    put_in_J, lost_J, held_J = bench.heat_J
    assert put_in_J > 0.1
    assert held_J - began_J == pytest.approx(put_in_J - lost_J, abs=1e-11)


@pytest.mark.parametrize("wire", HEATING_A)
def test_each_world_is_far_from_home(wire):
    """By at least three times what the models err at home, somewhere on the way."""

    def trace(world):
        bench = powered(wire, world)
        rows = []
        for k in range(160):
            bench.supply.set_current(HEATING_A[wire] if 5 < k < 45 or 100 < k < 112 else 0.05)
            bench.advance(bench.time_s + 0.1)
            rows.append((bench.truth.displacement_m, bench.truth.resistance_Ohm))
        return np.array(rows)

    home = trace(HOME)
    for world in AWAY:
        assert abs(trace(world) - home)[:, 0].max() > 0.03 * 0.04 * WIRES[wire].length_m, world


def test_with_clamps_the_ends_stay_cold_and_the_mean_is_that_of_a_fin():
    bench = powered("flexinol", "clamped")
    plain = VirtualBench.from_name("flexinol", load=Weight(0.98))
    wire, c = bench.setup.wire, bench.constants
    bench.supply.set_current(0.05)
    bench.advance(120.0)
    cells = bench._wire.cells
    temperatures_C = cells[:, physics.CELL_TEMPERATURE]
    assert (np.diff(temperatures_C) > 0.0).all() and len(temperatures_C) >= 3
    assert cells[:, physics.CELL_LENGTH_SHARE].sum() == pytest.approx(1.0)
    # A fin between two cold ends: mean rise = rise of an endless wire · (1 − tanh(L/2ℓ) / (L/2ℓ)).
    rise_K = temperatures_C[-1] - 22.0
    surface_W_m2K = wire.heat_transfer_W_m2K * (rise_K / physics.CONVECTION_AT_K) ** wire.convection_exponent
    decay_m = math.sqrt(wire.material.conductivity_W_mK * wire.diameter_m / (4.0 * surface_W_m2K))
    half = wire.length_m / 2.0 / decay_m
    fin = 1.0 - math.tanh(half) / half
    assert bench.truth.temperature_C - 22.0 == pytest.approx(rise_K * fin, rel=0.03)
    assert len(plain._wire.cells) == 1 and c.convection_exponent > 0.0


def test_natural_convection_grows_with_the_excess_and_is_as_stated_at_sixty_kelvin():
    assert physics.convection(0.15, 60.0) == 1.0
    assert physics.convection(0.15, 120.0) == pytest.approx(2.0**0.15)
    assert physics.convection(0.0, 5.0) == 1.0


def test_a_convecting_wire_settles_where_heat_in_is_heat_out():
    bench = powered("furukawa", "vertical")
    bench.supply.set_current(0.25)
    bench.advance(60.0)
    c, t = bench.constants, bench.truth
    excess_K = t.temperature_C - 22.0
    lost_W = c.heat_loss_W_K * excess_K * (excess_K / physics.CONVECTION_AT_K) ** c.convection_exponent
    assert lost_W == pytest.approx(t.power_W, rel=1e-3)


def test_training_moves_the_hot_end_as_on_the_measured_wire():
    """1 − exp(−N/25), by the strains of the record; the cold end by two fifths; the hysteresis narrows."""
    bench = powered("furukawa", "in_training", Weight(3.0))
    ends_m = [cycle(bench, "furukawa", 4.0, 14.0) for _ in range(30)]
    assert bench._state[physics.CYCLES] == 30
    hot, cold = np.array(ends_m).T / bench.setup.wire.length_m
    n = np.arange(30)
    expected = IN_TRAINING.hot_strain * (np.exp(-1 / 25) - np.exp(-n[-1] / 25))
    assert hot[-1] - hot[1] == pytest.approx(expected, rel=0.08)
    line = np.polyfit(1.0 - np.exp(-n / 25), hot, 1)
    assert np.abs(np.polyval(line, 1.0 - np.exp(-n / 25)) - hot).max() < 0.02 * (hot[-1] - hot[0])
    assert 0.2 < (cold[-1] - cold[1]) / (hot[-1] - hot[1]) < 0.7


def test_another_intermediate_phase_shows_in_both_alloys():
    for wire in HEATING_A:
        home, other = wire_in_world(wire, "measured").material, wire_in_world(wire, "other_r_phase").material
        assert other.has_r_phase and other.r_start_C > home.r_start_C
        bench = powered(wire, "other_r_phase", Weight(0.49))
        cycle(bench, wire, 6.0, 0.0)
        most = 0.0
        bench.supply.set_current(0.05)
        for _ in range(120):
            bench.advance(bench.time_s + 0.1)
            most = max(most, bench.truth.r_phase)
        assert most > 0.2, wire


@pytest.mark.parametrize("wire", HEATING_A)
def test_oriented_martensite_keeps_the_load_that_it_formed_under_until_it_is_austenite(wire):
    """Cooled under the light load and hung on the heavy one it is turned to 0.7 of what forming there makes of it; the
    other way round it stays as long, but for what is elastic."""
    light, heavy = Weight(0.49), Weight(1.47)
    formed_m, hot_m = {}, {}
    for load in (light, heavy):
        bench = powered(wire, "oriented", load)
        hot_m[load], formed_m[load] = cycle(bench, wire, 8.0, 20.0)
    full_m = {load: formed_m[load] - hot_m[load] for load in formed_m}
    for first, then in ((light, heavy), (heavy, light)):
        bench = powered(wire, "oriented", first)
        cycle(bench, wire, 8.0, 20.0)
        bench.load = then
        bench.advance(bench.time_s + 1.0)
        elastic_m = (then.force_N - first.force_N) / bench.constants.area_m2 / bench.constants.modulus_m
        elastic_m *= bench.constants.length_m
        kept_m = bench.truth.displacement_m - elastic_m
        wanted_m = max(formed_m[first], formed_m[first] + 0.7 * full_m[then] - full_m[first])
        assert kept_m == pytest.approx(wanted_m, abs=0.03 * full_m[then])
        assert abs(kept_m - formed_m[then]) > 0.05 * full_m[then]
        assert cycle(bench, wire, 8.0, 20.0)[1] == pytest.approx(formed_m[then], abs=0.01 * full_m[then])


def test_a_number_draws_the_same_physics_every_time_and_another_number_another():
    drawn = [wire_in_world("flexinol", world) for world in DRAWN_WORLDS]
    assert drawn == [wire_in_world("flexinol", world) for world in DRAWN_WORLDS]
    assert len({wire.material.stress_slope_Pa_K for wire in drawn}) == len(drawn)
    assert len({type(world_of(f"{DRAWN}{n}").wire(WIRES["furukawa"]).kinetics) for n in range(20)}) == 3
    assert {wire_in_world("furukawa", f"{DRAWN}{n}").clamped for n in range(20)} == {True, False}


@pytest.mark.parametrize("name", ["drawn-", "drawn-x", "drawn--1", "drawn-²", "elsewhere"])
def test_what_is_no_physics_is_refused_with_those_there_are(name):
    with pytest.raises(
        ValueError, match=f"'{name}' is no physics of the bench; one of measured, .* or drawn- and a number"
    ):
        wire_in_world("flexinol", name)


def test_a_sleeve_warms_up_with_the_wire_and_keeps_it_warm():
    """In balance the two resistances to heat add up; afterwards the wire cools as fast as the sleeve lets it."""
    bench = powered("flexinol", "sleeved")
    wire, c = bench.setup.wire, bench.constants
    sleeve = wire.sleeve
    bench.supply.set_current(0.05)
    bench.advance(300.0)
    cell = bench._wire.cells[0]
    power_W = 0.05**2 * bench.truth.resistance_Ohm
    surface_K, inside_K = cell[physics.CELL_SLEEVE_C] - 22.0, cell[physics.CELL_TEMPERATURE] - 22.0
    loss_W_K = c.heat_loss_W_K * (surface_K / physics.CONVECTION_AT_K) ** wire.convection_exponent
    assert surface_K == pytest.approx(power_W / (sleeve.outer_conductance * loss_W_K), rel=1e-6)
    assert inside_K - surface_K == pytest.approx(power_W / (sleeve.inner_conductance * c.heat_loss_W_K), rel=1e-6)
    bench.supply.set_current(HEATING_A["flexinol"])
    bench.advance(bench.time_s + 6.0)
    hot_C = bench._wire.cells[0].copy()
    bench.supply.set_current(0.0)
    bench.advance(bench.time_s + 1.0)
    lost_K = hot_C[physics.CELL_TEMPERATURE] - bench._wire.cells[0][physics.CELL_TEMPERATURE]
    assert 0.0 < hot_C[physics.CELL_SLEEVE_C] - bench._wire.cells[0][physics.CELL_SLEEVE_C] < 0.5 * lost_K
