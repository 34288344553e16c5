"""The R-phase model: its step is exact, keeps to its side of the asymptote, and does not mind the sampling rate."""

import math
from decimal import Decimal

import numpy as np
import pytest
from forward_step import forward_step
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from sma_actuator.base.sections import Wire
from sma_actuator.estimation.models.flexinol import (
    LOOP_SLACK,
    FlexinolCoefficients,
    FlexinolModel,
    FlexinolNormalisedCoefficients,
)

A_H, B_H = 4.0e-3, -17.0e-3
A_C, B_C = 6.0e-3, -28.5e-3
A_0, TAU = 0.5e-3, 12.0
WIRE = Wire(alloy="ni-ti", length=0.1, diameter=0.1524e-3)
WORKING_RANGE_m = (0.3e-3, 3.9e-3)
UNBOUNDED_m = (-1e3, 1e3)  # a working range so wide that the bounds of the loop never act
SLACK_m = LOOP_SLACK * (WORKING_RANGE_m[1] - WORKING_RANGE_m[0])


def model(tau=TAU, a_0=A_0, displacement_range_m=WORKING_RANGE_m):
    return FlexinolModel(
        a_h=[A_H],
        b_h=[B_H],
        a_c=[A_C],
        b_c=[B_C],
        a_0=a_0,
        tau=tau,
        stress_range_Pa=(0.0, 175e6),
        displacement_range_m=displacement_range_m,
    )


def started(z, heating, resistance=4.9, **kwargs):
    """A model at ``resistance``, ``z`` away from the asymptote of the branch it is about to take; unbounded."""
    m = model(displacement_range_m=UNBOUNDED_m, **kwargs)
    displacement = A_H * (resistance - z) + B_H if heating else A_C * (resistance + z) + B_C
    m.reset(resistance, 50e6)
    m._state[:] = resistance, displacement
    return m, displacement


@pytest.mark.parametrize("heating", (True, False), ids=("heating", "cooling"))
@pytest.mark.parametrize("z", (0.001, 0.05, 0.3))
@pytest.mark.parametrize("change", (0.4, 0.02, -0.1), ids=("far", "near", "backwards"))
def test_one_step_is_the_solution_of_the_differential_equation(heating, z, change):
    m, start = started(z, heating)
    change = -change if heating else change  # towards the asymptote: R falls on heating
    a, b = (A_H, B_H) if heating else (A_C, B_C)

    def slope(resistance, displacement):
        away = resistance - (displacement - b) / a if heating else (displacement - b) / a - resistance
        return (a - A_0) * np.exp(-TAU * away) + A_0

    fine = solve_ivp(slope, (4.9, 4.9 + change), [start], rtol=1e-11, atol=1e-15, method="DOP853").y[0, -1]
    assert m.step(4.9 + change, 50e6, heating) == pytest.approx(fine, abs=1e-10)


@pytest.mark.parametrize(("z", "change"), ((1e-5, 0.05), (1e-3, 0.5), (0.2, 0.5), (1e-5, 2.0), (2.0, -1.5)))
def test_a_sharp_transition_is_left_and_reached_as_the_closed_form_says(z, change):
    # τ = 1000/Ω: e^(τ k ΔR) overflows a float, its logarithm does not.
    tau, k = 1000.0, 1.0 - A_0 / A_H
    m, _ = started(z, heating=True, tau=tau)
    displacement = m.step(4.9 + change, 50e6, True)
    away = 4.9 + change - (displacement - B_H) / A_H
    exact = Decimal(tau * z).exp() - 1
    expected = float((1 + exact * Decimal(tau * k * change).exp()).ln()) / tau
    assert away == pytest.approx(expected, abs=1e-12)


def test_far_from_the_asymptote_the_slope_is_the_initial_one():
    m, start = started(z=5.0, heating=True, resistance=6.0)
    assert m.step(5.9, 50e6, True) - start == pytest.approx(-0.1 * A_0, rel=1e-9)


def test_on_the_asymptote_it_stays_there():
    m = model()
    m.reset(4.5, 50e6)
    for resistance in np.linspace(4.5, 5.2, 15):
        assert m.step(resistance, 50e6, False) == pytest.approx(A_C * resistance + B_C, abs=1e-15)


@given(
    heating=st.booleans(),
    z=st.floats(0.0, 50.0),
    tau=st.floats(0.01, 1e5),
    changes=st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=20),
)
def test_no_change_of_resistance_crosses_the_asymptote(heating, z, tau, changes):
    m, _ = started(z, heating, tau=tau)
    resistance = 4.9
    for change in changes:
        resistance += change
        displacement = m.step(resistance, 50e6, heating)
        a, b = (A_H, B_H) if heating else (A_C, B_C)
        away = resistance - (displacement - b) / a if heating else (displacement - b) / a - resistance
        assert math.isfinite(displacement)
        assert away >= -1e-9


@given(
    start=st.floats(4.6, 5.2),
    end=st.floats(4.4, 5.4),
    heating=st.booleans(),
    z=st.floats(0.0, 0.5),
    pieces=st.integers(2, 60),
)
def test_the_sampling_rate_does_not_matter(start, end, heating, z, pieces):
    coarse, _ = started(z, heating, start)
    fine, _ = started(z, heating, start)
    for resistance in np.linspace(start, end, pieces + 1)[1:]:
        stepped = fine.step(resistance, 50e6, heating)
    assert stepped == pytest.approx(coarse.step(end, 50e6, heating), abs=1e-12)


@given(z=st.floats(0.0, 0.5), dither=st.floats(1e-4, 0.05), times=st.integers(1, 50))
def test_dithering_on_one_branch_comes_back_to_where_it_was(z, dither, times):
    m, start = started(z, heating=True)
    for _ in range(times):
        m.step(4.9 + dither, 50e6, True)
        displacement = m.step(4.9, 50e6, True)
    assert displacement == pytest.approx(start, abs=1e-12)


def loop(resistance):
    """Lower and upper asymptote."""
    return sorted((A_H * resistance + B_H, A_C * resistance + B_C))


@given(
    start=st.floats(4.6, 5.6),
    share=st.floats(0.0, 1.0).filter(lambda x: x in (0.0, 1.0) or 1e-5 < x < 1.0 - 1e-5),
    end=st.floats(4.3, 5.7),
    heating=st.booleans(),
    tau=st.floats(10.0, 1000.0),
    pieces=st.integers(2, 60),
)
def test_the_bounds_of_the_loop_do_not_bring_the_sampling_rate_back(start, share, end, heating, tau, pieces):
    coarse, fine = model(tau=tau), model(tau=tau)
    lo, hi = loop(start)
    for m in (coarse, fine):
        m._state[:] = start, lo + share * (hi - lo)
    for resistance in np.linspace(start, end, pieces + 1)[1:]:
        stepped = fine.step(resistance, 50e6, heating)
    assert stepped == pytest.approx(coarse.step(end, 50e6, heating), abs=1e-11)


@given(readings=st.lists(st.tuples(st.floats(0.1, 30.0), st.booleans()), min_size=1, max_size=30))
def test_no_sequence_of_readings_and_branches_leaves_the_loop(readings):
    m = model(tau=300.0)
    m.reset(4.9, 50e6)
    for resistance, heating in readings:
        lo, hi = loop(resistance)
        assert lo - SLACK_m <= m.step(resistance, 50e6, heating) <= hi + SLACK_m


@pytest.mark.parametrize("spike", (3.5, 4.3, 5.7, 9.0), ids="{} Ω".format)
@pytest.mark.parametrize("at", (5, 25, 45), ids="sample {}".format)
def test_one_bad_reading_of_resistance_is_forgotten_within_half_a_loop(spike, at):
    resistances = np.concatenate([np.linspace(5.2, 4.4, 30), np.linspace(4.4, 5.2, 30)])
    disturbed = resistances.copy()
    disturbed[at] = spike
    stress, heating = np.full(60, 50e6), np.arange(60) < 30
    clean, bad = model(tau=300.0), model(tau=300.0)
    clean.reset(5.2, 50e6)
    bad.reset(5.2, 50e6)
    error_m = np.abs(clean.run(resistances, stress, heating) - bad.run(disturbed, stress, heating))
    width_m = max(hi - lo for lo, hi in map(loop, resistances))
    assert error_m[at + 1 :].max() <= width_m + SLACK_m
    assert error_m[-1] <= SLACK_m


def test_beyond_the_asymptote_displacement_waits_while_resistance_comes_back():
    # At the cold end R rises with temperature while δ stands still, until the heating curve is met.
    m, start = started(z=-0.1, heating=True)
    assert m.step(4.95, 50e6, True) == start
    assert m.step(5.0, 50e6, True) == pytest.approx(start, abs=1e-15)
    assert m.step(5.1, 50e6, True) > start


def test_beyond_the_asymptote_the_state_is_drawn_to_it():
    m, _ = started(z=-0.1, heating=True)
    away = []
    for resistance in np.linspace(4.9, 4.2, 8)[1:]:
        displacement = m.step(resistance, 50e6, True)
        away.append(abs(resistance - (displacement - B_H) / A_H))
    assert away == sorted(away, reverse=True)
    assert away[-1] < 0.1 * away[0]


def test_the_forward_step_diverges_where_the_exact_one_does_not():
    tau = 300.0  # a sharp corner, and 20 samples a second through it
    resistances = np.concatenate([np.linspace(5.2, 4.5, 15), np.linspace(4.5, 5.2, 15)])
    heating = np.arange(30) < 15
    exact = model(tau=tau, displacement_range_m=UNBOUNDED_m)
    start = exact.reset(5.2, 50e6)
    worst_m, displacement = {"exact": 0.0, "forward": 0.0}, {"exact": start, "forward": start}
    for previous, resistance, on in zip(resistances, resistances[1:], heating[1:]):
        lo, hi = sorted((A_H * resistance + B_H, A_C * resistance + B_C))
        for name in ("exact", "forward"):
            if name == "exact":
                displacement[name] = exact.step(resistance, 50e6, bool(on))
            elif worst_m[name] < 0.1:  # as far as it can be followed
                asymptotes = ((A_H, B_H), (A_C, B_C))
                displacement[name] = forward_step(resistance, previous, displacement[name], on, asymptotes, A_0, tau)
            worst_m[name] = max(worst_m[name], lo - displacement[name], displacement[name] - hi)
    assert worst_m["exact"] < 1e-9  # never outside the loop
    assert worst_m["forward"] > 0.1  # metres, of a wire that moves 4 mm


def test_one_sample_and_many_give_the_same_numbers():
    rng = np.random.default_rng(3)
    resistance = 4.9 + 0.3 * np.sin(np.linspace(0, 20, 500)) + 0.002 * rng.standard_normal(500)
    stress = 60e6 + 1e6 * rng.standard_normal(500)
    heating = np.gradient(resistance) < 0
    one, many = model(), model()
    one.reset(resistance[0], stress[0])
    many.reset(resistance[0], stress[0])
    stepped = [one.step(r, s, bool(h)) for r, s, h in zip(resistance, stress, heating)]
    pieces = (slice(0, 200), slice(200, None))
    in_pieces = np.concatenate([many.run(resistance[piece], stress[piece], heating[piece]) for piece in pieces])
    np.testing.assert_array_equal(stepped, in_pieces)


def test_a_change_of_stress_moves_the_asymptote_not_the_displacement():
    m = FlexinolModel(
        a_h=[A_H],
        b_h=[B_H, 1e-11],
        a_c=[A_C],
        b_c=[B_C, 1e-11],
        a_0=A_0,
        tau=TAU,
        stress_range_Pa=(0.0, 175e6),
        displacement_range_m=(0.0, 4e-3),
    )
    before = m.reset(4.9, 50e6)
    assert m.step(4.9, 60e6, False) == pytest.approx(before, abs=1e-15)
    assert m.limits_m(4.9, 60e6)[1] == pytest.approx(A_C * 4.9 + B_C + 60e6 * 1e-11)


def coefficients(**changes):
    values = {
        "calibrated_length": 0.1,
        "calibrated_diameter": 0.1524e-3,
        "heating_slope": (A_H,),
        "heating_intercept": (B_H,),
        "cooling_slope": (A_C,),
        "cooling_intercept": (B_C,),
        "initial_slope": A_0,
        "transition_rate": TAU,
        "stress_range": (0.0, 175e6),
        "displacement_range": (0.3e-3, 3.9e-3),
    }
    return FlexinolCoefficients(**{**values, **changes})


@pytest.mark.parametrize(
    ("wire", "words"),
    (
        (Wire(alloy="ni-ti-cu", length=0.1, diameter=0.1524e-3), "wire.alloy is ni-ti-cu"),
        (Wire(alloy="ni-ti", length=0.12, diameter=0.1524e-3), "wire.length: 0.12 m"),
        (Wire(alloy="ni-ti", length=0.1, diameter=0.2e-3), "wire.diameter: 0.0002 m"),
    ),
)
def test_coefficients_of_another_wire_are_refused_in_a_sentence(wire, words):
    (problem,) = coefficients().mismatches(wire)
    assert words in problem


def test_a_range_must_ascend():
    (problem,) = coefficients(stress_range=(1e8, 0.0)).mismatches(WIRE)
    assert problem.startswith("model.stress_range")


def test_normalised_coefficients_of_a_wire_are_its_exclusive_model():
    # Put R = R_0 (1 + λ) into 5.1 and divide by L_0.
    rho = 0.95e-6
    initial = rho * WIRE.length / WIRE.area_m2
    normalised = FlexinolNormalisedCoefficients(
        martensite_resistivity=rho,
        heating_slope=(A_H * initial / WIRE.length,),
        heating_intercept=((B_H + A_H * initial) / WIRE.length,),
        cooling_slope=(A_C * initial / WIRE.length,),
        cooling_intercept=((B_C + A_C * initial) / WIRE.length,),
        initial_slope=A_0 * initial / WIRE.length,
        transition_rate=TAU * initial,
        stress_range=(0.0, 175e6),
        strain_range=(0.003, 0.039),
    )
    exclusive, built = model(), normalised.build(WIRE)
    for heating, resistance in ((False, 5.3), (True, 5.0), (True, 4.7), (False, 4.9)):
        expected = exclusive.step(resistance, 60e6, heating)
        assert built.step(resistance, 60e6, heating) == pytest.approx(expected, abs=1e-12)
    assert built.displacement_range_m == pytest.approx((0.3e-3, 3.9e-3))


def test_a_wire_twice_as_long_moves_twice_as_far():
    normalised = FlexinolNormalisedCoefficients(
        martensite_resistivity=0.95e-6,
        heating_slope=(0.2,),
        heating_intercept=(0.04,),
        cooling_slope=(0.3,),
        cooling_intercept=(0.045,),
        initial_slope=0.02,
        transition_rate=60.0,
        stress_range=(0.0, 175e6),
        strain_range=(0.003, 0.039),
    )
    long = Wire(alloy="ni-ti", length=0.2, diameter=0.1524e-3)
    one, two = normalised.build(WIRE), normalised.build(long)
    resistance = 0.95e-6 * 0.1 / WIRE.area_m2
    for heating, part in ((False, 1.0), (True, 0.95), (True, 0.85), (False, 0.9)):
        half = one.step(part * resistance, 60e6, heating)
        assert two.step(2 * part * resistance, 60e6, heating) == pytest.approx(2 * half, rel=1e-12)
