"""The wires that share nothing with the plant are wires: they lose what they get, contract, come back and remember."""

import sys
from importlib import import_module
from math import pi
from pathlib import Path

import pytest

from sma_actuator.bench.bench import Setup
from sma_actuator.bench.real import wire_of
from sma_actuator.plant.loads import Weight
from sma_actuator.plant.worlds import HOME

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
grains = import_module("grains")  # by the name that its kernels are kept under

STILL = {"room_K": 0.0, "uneven": 0.0}


def bench(name, stress_Pa=60e6):
    specimen = wire_of("flexinol", HOME)
    area_m2 = 0.25 * pi * specimen.diameter_m**2
    made = grains.GrainsBench(name, Setup(specimen, load=Weight(stress_Pa * area_m2)))
    made.supply.set_voltage(20.0)
    made.supply.set_output(True)
    return made


def held(made, current_A, for_s=40.0):
    """Its truth after that current has flowed for so long."""
    made.supply.set_current(current_A)
    made.advance(made.time_s + for_s)
    return made.truth


@pytest.mark.parametrize("name", grains.ALLOYS)
def test_heated_it_contracts_and_cooled_it_comes_back(name):
    made = bench(name)
    cold = held(made, 0.05)
    current_A = 0.2
    while made.truth.martensite > 0.05:
        current_A *= 1.1
        hot = held(made, current_A, 10.0)
    assert hot.temperature_C < 140.0
    assert 0.02 < cold.strain - hot.strain < 0.05
    assert hot.resistance_Ohm < 0.97 * cold.resistance_Ohm
    again = held(made, 0.05)
    grown = 2.0 * grains.ALLOYS[name].grows
    assert again.strain == pytest.approx(cold.strain, abs=1e-4 + grown)


def test_warm_and_still_it_loses_what_the_current_brings(monkeypatch):
    alloy = grains.ALLOYS["grains-3"]._replace(**STILL)
    monkeypatch.setitem(grains.ALLOYS, "grains-3", alloy)
    made = bench("grains-3")
    truth = held(made, 0.15, 60.0)
    excess_K = truth.temperature_C - made.ambient_C
    surface_m2 = pi * made.setup.wire.diameter_m * made.setup.wire.length_m
    convected_W = alloy.loss_W_m2K * (1.0 + alloy.loss_grows_1_K * excess_K) * surface_m2 * excess_K
    here_K, room_K = truth.temperature_C + grains.KELVIN, made.ambient_C + grains.KELVIN
    radiated_W = alloy.emissivity * grains.STEFAN_W_m2K4 * surface_m2 * (here_K**4 - room_K**4)
    assert excess_K > 10.0
    assert truth.power_W == pytest.approx(convected_W + radiated_W, rel=2e-3)


def test_a_small_cycle_closes_where_it_began(monkeypatch):
    """Preisach's grains: what a turn has left is left by the next one too."""
    monkeypatch.setitem(grains.ALLOYS, "grains-1", grains.ALLOYS["grains-1"]._replace(**STILL))
    made = bench("grains-1")
    held(made, 0.05)
    current_A = 0.2
    while (before := held(made, current_A, 20.0)).martensite > 0.6:
        current_A *= 1.03
    between = held(made, 0.85 * current_A, 20.0)
    after = held(made, current_A, 20.0)
    assert 0.1 < before.martensite < 0.9
    assert between.martensite - before.martensite > 1e-3
    assert after.martensite == pytest.approx(before.martensite, abs=2e-4)
