"""The wire as a whole: energy, closed forms, and the shape of the loops in the thesis's figures.

All in the physics that has closed forms and that the figures were drawn with: cosines that begin and end somewhere.
What holds in every physics is in test_worlds.py.
"""

import math
import os
import subprocess
import sys

import numpy as np
import pytest

from sma_actuator.bench import Spring, VirtualBench, Weight

WIRES = ("flexinol", "furukawa")
HEATING_A = {"flexinol": 0.30, "furukawa": 0.50}


def powered(name, **kwargs):
    bench = VirtualBench.from_name(name, physics="liang_rogers", **kwargs)
    bench.supply.set_voltage(6.0)
    bench.supply.set_current(0.05)
    bench.supply.set_output(True)
    return bench


def drive(bench, current_A, duration_s, step_s=0.01):
    """Hold a current; return (n, 4): temperature, displacement, resistance, R-phase."""
    bench.supply.set_current(current_A)
    rows, end_s = [], bench.time_s + duration_s
    while bench.time_s < end_s - 1e-9:
        bench.advance(bench.time_s + step_s)
        t = bench.truth
        rows.append((t.temperature_C, t.displacement_m, t.resistance_Ohm, t.r_phase))
    return np.array(rows)


def full_cycle(name, force_N):
    bench = powered(name, load=Weight(force_N))
    bench.advance(2.0)
    return drive(bench, HEATING_A[name], 5.0), drive(bench, 0.05, 12.0)


def displacement_gap(heating, cooling, resistance_Ohm):
    """Difference of δ between heating and cooling at a resistance, on the transforming parts."""
    up = heating[np.argmax(heating[:, 2]) : np.argmin(heating[:, 2])]
    down = cooling[np.argmin(cooling[:, 2]) : np.argmax(cooling[:, 2])]
    return np.interp(resistance_Ohm, up[::-1, 2], up[::-1, 1]) - np.interp(resistance_Ohm, down[:, 2], down[:, 1])


@pytest.mark.parametrize("name", WIRES)
def test_no_energy_is_lost_or_made_however_it_transforms(name):
    bench = powered(name, load=Spring(200.0, 0.5))
    began_J = bench.heat_J[2]
    for current_A, duration_s in ((0.3, 1.0), (0.1, 0.7), (0.35, 2.0), (0.05, 6.0)):
        drive(bench, current_A, duration_s)
        put_in_J, lost_J, held_J = bench.heat_J
        assert held_J - began_J == pytest.approx(put_in_J - lost_J, abs=1e-12)
    assert put_in_J > 0.1


@pytest.mark.parametrize("name", WIRES)
def test_the_latent_heat_shows_in_the_temperature(name):
    bench = powered(name, load=Weight(0.98))
    wire, c = bench.setup.wire, bench.constants
    mass_kg = wire.material.density_kg_m3 * math.pi * wire.diameter_m**2 / 4 * wire.length_m
    before = bench.truth
    drive(bench, HEATING_A[name], 6.0)
    put_in_J, lost_J, _ = bench.heat_J
    assert bench.truth.martensite == 0.0 and before.martensite == 1.0
    sensible_J = c.transformation.heat_capacity_J_K * (bench.truth.temperature_C - before.temperature_C)
    assert put_in_J - lost_J - sensible_J == pytest.approx(mass_kg * wire.material.latent_heat_J_kg, rel=1e-9)


def test_without_transformation_it_warms_and_cools_exponentially():
    bench = powered("flexinol", load=Weight(0.98))
    c = bench.constants
    time_constant_s = c.transformation.heat_capacity_J_K / c.heat_loss_W_K
    resistance_Ohm = bench.truth.resistance_Ohm
    bench.advance(time_constant_s)
    final_K = 0.05**2 * resistance_Ohm / c.heat_loss_W_K
    assert bench.truth.temperature_C - 22.0 == pytest.approx(final_K * (1 - math.exp(-1)), rel=0.01)


@pytest.mark.parametrize("name", WIRES)
def test_stroke_is_some_four_percent_and_grows_with_stress(name):
    strokes = []
    for force_N in (0.49, 0.98, 1.96):
        heating, cooling = full_cycle(name, force_N)
        strokes.append((cooling[:, 1].max() - heating[:, 1].min()) / VirtualBench.from_name(name).setup.wire.length_m)
    assert strokes[0] < strokes[1] < strokes[2]
    assert strokes[0] > 0.02 and 0.038 < strokes[2] < 0.05


def test_flexinol_rises_in_resistance_at_first_and_then_falls_about_linearly():
    heating, _ = full_cycle("flexinol", 0.98)
    peak = np.argmax(heating[:, 2])
    assert heating[peak, 2] - heating[0, 2] > 0.05
    transforming = heating[peak : np.argmin(heating[:, 2])]
    middle = transforming[(transforming[:, 1] > 0.8e-3) & (transforming[:, 1] < 3.8e-3)]
    line = np.polyfit(middle[:, 2], middle[:, 1], 1)
    assert np.abs(np.polyval(line, middle[:, 2]) - middle[:, 1]).max() < 0.03 * 4e-3
    assert 4.0 < heating[:, 2].min() < heating[:, 2].max() < 6.0


def test_flexinols_r_phase_and_its_gap_shrink_with_stress():
    gaps, r_phase = [], []
    for force_N in (0.49, 0.98, 1.96):
        heating, cooling = full_cycle("flexinol", force_N)
        gaps.append(displacement_gap(heating, cooling, 5.0))
        r_phase.append(cooling[:, 3].max())
        assert heating[:, 3].max() < 1e-9  # none on the way up
    assert gaps[0] > 1.0e-3 and gaps[0] > gaps[1] > gaps[2] > 0.0
    assert r_phase[0] > 0.7 and r_phase[0] > r_phase[1] > r_phase[2] and r_phase[2] < 0.2


def test_furukawa_has_hardly_a_gap_no_r_phase_and_a_smooth_curve():
    for force_N in (0.49, 0.98, 1.96):
        heating, cooling = full_cycle("furukawa", force_N)
        assert abs(displacement_gap(heating, cooling, 1.8)) < 0.02 * 2.4e-3
        assert cooling[:, 3].max() == 0.0
        down = cooling[np.argmin(cooling[:, 2]) : np.argmax(cooling[:, 2])]
        assert (np.diff(down[:, 1]) > -1e-9).all()
        assert 1.5 < heating[:, 2].min() < heating[:, 2].max() < 2.3


def test_furukawas_cold_resistance_follows_stress_and_its_hot_one_does_not():
    ends = [
        (cooling[:, 2].max(), heating[:, 2].min())
        for heating, cooling in (full_cycle("furukawa", f) for f in (0.49, 1.96))
    ]
    (cold_low, hot_low), (cold_high, hot_high) = ends
    assert cold_high - cold_low > 0.08
    assert abs(hot_high - hot_low) < 0.02


@pytest.mark.parametrize("name", WIRES)
def test_the_makers_current_contracts_in_about_a_second_and_cooling_takes_some(name):
    current_A = {"flexinol": 0.41, "furukawa": 0.66}[name]
    bench = powered(name, load=Weight(1.96))
    heating = drive(bench, current_A, 2.0)
    stroke = heating[0, 1] - heating[:, 1].min()
    assert 0.2 < 0.01 * np.argmax(heating[0, 1] - heating[:, 1] > 0.95 * stroke) < 1.5


def test_a_stiff_spring_balances_the_wire_at_every_moment():
    bench = powered("flexinol", load=Spring(800.0, 0.3, 0.004))
    bench.supply.set_current(0.35)
    for i in range(1, 61):
        bench.advance(i * 0.05)
        t = bench.truth
        assert t.load_N == pytest.approx(0.3 + 800.0 * (0.004 - t.displacement_m), abs=1e-6)
    assert t.load_N > 2.0


def test_the_numbers_are_the_same_compiled_and_not():
    code = (
        "from sma_actuator.bench import VirtualBench, Spring\n"
        "for name in ('flexinol', 'furukawa'):\n"
        "    b = VirtualBench.from_name(name, seed=3, load=Spring(150.0, 0.6)); s = b.supply\n"
        "    s.set_voltage(6.0); s.set_output(True)\n"
        "    for i in range(20):\n"
        "        s.set_current(0.05 + 0.3 * (i * 7 % 10) / 10); b.advance(b.time_s + 0.1)\n"
        "    print(*[repr(float(x)) for x in b._state], *[repr(float(x)) for x in b.daq.block(3)[0].ravel()])\n"
    )
    results = [
        np.array(
            subprocess.run(
                [sys.executable, "-c", code],
                env={**os.environ, **extra},
                capture_output=True,
                text=True,
                check=True,
                timeout=120,
            ).stdout.split(),
            dtype=float,
        )
        for extra in ({}, {"SMA_ACTUATOR_NO_JIT": "1"})
    ]
    np.testing.assert_allclose(results[0], results[1], rtol=1e-12, atol=1e-12)
