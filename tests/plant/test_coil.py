"""A coil and a bundle: what the closed forms of springs and of wires side by side say, the bench does."""

import dataclasses
import math

import numpy as np
import pytest

from sma_actuator.base.parameters import from_mapping
from sma_actuator.base.sections import Wire
from sma_actuator.bench import Setup, VirtualBench
from sma_actuator.derived import still_air_W_m2K
from sma_actuator.plant import coil, physics
from sma_actuator.plant.loads import Spring, Weight
from sma_actuator.plant.worlds import wire_in_world

COIL = {"alloy": "ni-ti", "form": "coil", "length": 0.115, "diameter": 0.254e-3, "coil_diameter": 1.524e-3}
BUNDLE = {"alloy": "ni-ti", "form": "bundle", "length": 0.1, "diameter": 0.1016e-3, "wires": 4}


def at_C(temperature_C, load, world="liang_rogers"):
    """A coil that has this temperature, hanging on a load."""
    return VirtualBench(Setup(wire_in_world("coil", world), load=load, ambient_C=temperature_C)).truth


def driven(bench, current_A, seconds):
    """Its truth after a pulse."""
    bench.supply.set_voltage(20.0)
    bench.supply.set_output(True)
    bench.supply.set_current(current_A)
    bench.advance(bench.time_s + seconds)
    return bench.truth


def test_a_hot_coil_is_a_linear_spring():
    wire = wire_in_world("coil", "liang_rogers")
    turns = wire.length_m / (math.pi * wire.coil_diameter_m)
    shear_Pa = wire.material.austenite.modulus_Pa / 3.0
    stiffness_N_m = shear_Pa * wire.diameter_m**4 / (8.0 * wire.coil_diameter_m**3 * turns)
    for force_N in (0.05, 0.2):
        assert at_C(130.0, Weight(force_N)).displacement_m == pytest.approx(force_N / stiffness_N_m, rel=1e-6)
    pulled = at_C(130.0, Spring(40.0, preload_N=0.1, preload_displacement_m=0.01))
    assert pulled.load_N == pytest.approx(0.1 + 40.0 * (0.01 - pulled.displacement_m), abs=1e-8)
    assert pulled.load_N == pytest.approx(stiffness_N_m * pulled.displacement_m, rel=1e-6)


def test_its_resistance_is_that_of_the_length_of_its_wire():
    wire = wire_in_world("coil", "liang_rogers")
    per_resistivity = wire.length_m / (math.pi * wire.diameter_m**2 / 4.0)
    hot, phase = at_C(130.0, Weight(0.1)), wire.material.austenite
    warmer = 1.0 + phase.resistivity_temperature_coefficient_1_K * (130.0 - wire.material.reference_temperature_C)
    assert hot.resistance_Ohm == pytest.approx(phase.resistivity_Ohm_m * warmer * per_resistivity, rel=1e-9)
    assert at_C(130.0, Weight(0.2)).resistance_Ohm == hot.resistance_Ohm, "twist does not make a wire longer or thinner"


def test_the_pull_is_the_moment_of_the_rings():
    bench = VirtualBench.from_name("coil", load=Weight(0.15))
    wire, rings = bench.setup.wire, bench._wire.cells
    shear_Pa = rings[:, coil.RING_STRESS] / math.sqrt(3.0)
    radius_m = rings[:, coil.RING_RADIUS] * wire.diameter_m / 2.0
    area_m2 = rings[:, physics.CELL_LENGTH_SHARE] * math.pi * wire.diameter_m**2 / 4.0
    torque_Nm = float(np.sum(shear_Pa * radius_m * area_m2))
    assert torque_Nm == pytest.approx(0.15 * wire.coil_diameter_m / 2.0, rel=1e-6)


def test_it_transforms_last_where_it_is_twisted_most():
    bench = VirtualBench.from_name("coil", load=Weight(0.15))
    cold_m = bench.truth.displacement_m
    hot_m = driven(bench, 0.7, 30.0).displacement_m
    assert cold_m - hot_m > 0.4 * bench.setup.wire.length_m, "a coil moves by a good share of the length of its wire"
    driven(bench, 0.32, 30.0)
    martensite = bench._wire.cells[:, physics.CELL_MARTENSITE]
    assert 0.05 < bench.truth.martensite < 0.9 and np.all(np.diff(martensite) > 0.01), "more stress, sooner martensite"


@pytest.mark.parametrize("world", ["measured", "lagoudas", "in_training", "other_r_phase"])
def test_no_heat_is_lost_in_the_section(world):
    bench = VirtualBench.from_name("coil", load=Spring(3.0, 0.1, 0.04), physics=world)
    first_J = bench.heat_J[2]
    for current_A in (0.7, 0.1, 0.5, 0.3):
        driven(bench, current_A, 15.0)
    put_in_J, lost_J, held_J = bench.heat_J
    assert put_in_J - lost_J == pytest.approx(held_J - first_J, abs=1e-9 * put_in_J)


def test_five_rings_are_enough():
    wire = wire_in_world("coil")
    c, traces = physics.constants(wire, 1.25), []
    for count in (coil.RINGS, 4 * coil.RINGS):
        state, ring, inputs = (
            coil.cold_state(wire, c, 22.0, 0.15, count=count),
            np.zeros((1, 5)),
            np.zeros(physics.INPUTS),
        )
        inputs[physics.VOLTAGE_LIMIT], inputs[physics.OUTPUT_ON], inputs[physics.FORCE] = 20.0, 1.0, 0.15
        inputs[physics.OCP] = inputs[physics.OVP] = 99.0
        inputs[physics.AMBIENT], inputs[physics.LOSS_FACTOR], inputs[physics.CURRENT_FACTOR] = 22.0, 1.0, 1.0
        trace = []
        for current_A in np.concatenate((np.linspace(0.1, 0.6, 20), np.linspace(0.6, 0.1, 20))):
            inputs[physics.CURRENT_SET] = current_A
            coil.simulate(1000, 1e-3, c, state, inputs, ring, 0)
            trace.append((state.whole[physics.DISPLACEMENT], state.whole[physics.RESISTANCE]))
        traces.append(np.array(trace))
    few, many = traces
    away = np.abs(few - many).max(axis=0) / np.ptp(many, axis=0)
    assert np.all(away < 0.006), away


@pytest.mark.parametrize(("connection", "current", "resistance"), [("parallel", 4.0, 1.0 / 4.0), ("series", 1.0, 4.0)])
def test_a_bundle_is_as_many_wires(connection, current, resistance):
    single = Wire(**{**BUNDLE, "form": "wire", "wires": 1})
    several = Wire(**BUNDLE, connection=connection)
    one = VirtualBench.from_name("bundle", load=Weight(0.8), like=single)
    many = VirtualBench.from_name("bundle", load=Weight(3.2), like=several)
    for current_A, seconds in ((0.2, 1.0), (0.1, 2.0), (0.04, 3.0)):
        a, b = driven(one, current_A, seconds), driven(many, current * current_A, seconds)
        assert b.displacement_m == pytest.approx(a.displacement_m, rel=1e-4)  # the supply sets steps of 20 µA
        assert b.resistance_Ohm == pytest.approx(resistance * a.resistance_Ohm, rel=1e-4)
        assert b.power_W == pytest.approx(4.0 * a.power_W, rel=1e-3)
        assert b.stress_Pa == pytest.approx(a.stress_Pa)


@pytest.mark.parametrize(
    "wire",
    [
        Wire(alloy="ni-ti", length=0.1, diameter=0.15e-3),
        Wire(**COIL),
        Wire(**BUNDLE, connection="series"),
        Wire(**BUNDLE, connection="parallel"),
    ],
    ids=lambda wire: wire.form_text or "wire",
)
def test_parameters_and_bench_mean_the_same(wire):
    bench = VirtualBench.from_name("flexinol", like=wire)
    c = bench.constants
    assert c.length_m == pytest.approx(wire.strain_length_m, rel=1e-12)
    assert c.area_m2 == pytest.approx(wire.area_m2, rel=1e-12)
    assert c.path_m / c.path_area_m2 == pytest.approx(wire.resistance_Ohm(1.0), rel=1e-12)
    assert c.heat_loss_W_K == pytest.approx(bench.setup.wire.heat_transfer_W_m2K * wire.surface_m2, rel=1e-12)
    material = bench.setup.wire.material
    heat_J_K = material.density_kg_m3 * material.specific_heat_J_kgK * wire.volume_m3
    assert c.transformation.heat_capacity_J_K == pytest.approx(heat_J_K, rel=1e-12)
    assert wire.resistivity_Ohm_m(wire.resistance_Ohm(0.9e-6)) == pytest.approx(0.9e-6, rel=1e-12)


@pytest.mark.parametrize("diameter_m", [25e-6, 50e-6, 0.1e-3, 0.3e-3, 0.5e-3])
def test_a_thinner_wire_loses_more_per_surface_as_still_air_takes_it(diameter_m):
    """One of 25 µm lost 0.3 times what still air takes of it, so that it came far above max_temperature in
    characterise, and one of 0.5 mm twice as much, so that its largest current did not contract it."""
    home = VirtualBench.from_name("flexinol").setup.wire
    wire = VirtualBench.from_name("flexinol", like=Wire(alloy="ni-ti", length=0.1, diameter=diameter_m)).setup.wire
    times = wire.heat_transfer_W_m2K / home.heat_transfer_W_m2K
    assert times == pytest.approx(still_air_W_m2K(diameter_m) / still_air_W_m2K(home.diameter_m), rel=0.05)


def test_stress_and_strain_of_a_coil_are_wahl_s_by_von_mises():
    wire = Wire(**COIL)
    d, mean, index = wire.diameter, wire.coil_diameter, 6.0
    wahl = (4.0 * index - 1.0) / (4.0 * index - 4.0) + 0.615 / index
    shear_Pa = 8.0 * 0.2 * mean * wahl / (math.pi * d**3)
    assert wire.wahl_factor == pytest.approx(1.2525) and wire.turns == pytest.approx(24.02, abs=0.01)
    assert 0.2 / wire.area_m2 == pytest.approx(math.sqrt(3.0) * shear_Pa)
    shear = 0.03 * d / (math.pi * mean**2 * wire.turns)
    assert 0.03 / wire.strain_length_m == pytest.approx(shear / math.sqrt(3.0))
    assert wire.stress_text(100e6) == "100 MPa (0.195 N)"
    assert wire.full_stroke_m == pytest.approx(0.04 * wire.strain_length_m)
    assert dataclasses.replace(wire, full_stroke=0.03).full_stroke_m == 0.03


def test_what_hangs_on_it_unless_something_else_is_said_is_what_it_bears():
    assert VirtualBench.from_name("coil").truth.stress_Pa == pytest.approx(54e6)
    assert VirtualBench.from_name("flexinol", like=Wire(**COIL)).truth.stress_Pa == pytest.approx(54e6)
    assert VirtualBench.from_name("bundle").truth.stress_Pa == pytest.approx(54e6)
    assert VirtualBench.from_name("flexinol").truth.load_N == 0.98


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"form": "coil"}, "wire.coil_diameter: nan m; of a coil 3 to 25 times the diameter of its wire is wanted"),
        ({"form": "coil", "coil_diameter": 0.3e-3}, "0.000762 to 0.00635 m"),
        ({"form": "bundle"}, "wire.wires, connection: of a bundle two wires or more are wanted"),
        ({"form": "bundle", "wires": 4}, "in series or in parallel"),
        ({"coil_diameter": 1.5e-3}, "wire.coil_diameter: is of a coil, and form is wire"),
        ({"wires": 4}, "wire.wires, connection: are of a bundle, and form is wire"),
        ({"form": "spring"}, "'spring' is not one of wire, coil, bundle"),
    ],
)
def test_a_form_that_does_not_fit_is_a_sentence(change, sentence):
    wire, problems = from_mapping(Wire, {"alloy": "ni-ti", "length": 0.115, "diameter": 0.254e-3, **change}, "wire.")
    assert wire is None and sentence in problems[0]
