"""The Ni-Ti-Cu model: two curves, three ways to use them, and one activation curve for any wire."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.base.sections import Wire
from sma_actuator.estimation.models.furukawa import VARIANTS, FurukawaCoefficients, FurukawaNormalisedCoefficients

WIRE = Wire(alloy="ni-ti-cu", length=0.06, diameter=0.2e-3)
RATE = 15.0


def coefficients(variant="transition", **changes):
    values = {
        "calibrated_length": 0.06,
        "calibrated_diameter": 0.2e-3,
        "variant": variant,
        "heating_G0": (-6e-3, 1e-11),
        "heating_G1": (5e-3,),
        "heating_G2": (-0.5e-3, 1e-13, 1e-22),
        "cooling_G0": (-6.3e-3, 2e-11),
        "cooling_G1": (5.1e-3,),
        "cooling_G2": (-0.5e-3,),
        "transition_rate": RATE,
        "stress_range": (0.0, 175e6),
        "displacement_range": (0.2e-3, 2.2e-3),
    }
    return FurukawaCoefficients(**{**values, **changes})


def curve(branch, resistance, stress):
    of = {"H": "heating", "C": "cooling"}[branch]
    g = [getattr(coefficients(), f"{of}_G{i}") for i in range(3)]
    return sum(np.polynomial.polynomial.polyval(stress, p) * resistance**i for i, p in enumerate(g))


def test_direct_switching_is_the_curve_of_the_branch():
    model = coefficients("direct_switching").build(WIRE)
    assert model.step(1.9, 40e6, True) == pytest.approx(curve("H", 1.9, 40e6), abs=1e-15)
    assert model.step(1.9, 40e6, False) == pytest.approx(curve("C", 1.9, 40e6), abs=1e-15)


def test_average_is_the_mean_of_the_two_whatever_the_branch():
    model = coefficients("average").build(WIRE)
    mean = (curve("H", 1.9, 40e6) + curve("C", 1.9, 40e6)) / 2
    assert model.step(1.9, 40e6, True) == pytest.approx(mean, abs=1e-15)
    assert model.step(1.9, 40e6, False) == pytest.approx(mean, abs=1e-15)


def test_transition_follows_its_closed_form_after_each_reversal():
    # 5.72: h = (h_S − 1) e^{η(R − R_S)} + 1 while R falls; 5.73: h = h_S e^{−η(R − R_S)} while it rises.
    model = coefficients("transition").build(WIRE)
    model.reset(2.1, 40e6)  # h = 0
    model.step(2.1, 40e6, True)
    h = 1 - np.exp(RATE * (1.95 - 2.1))
    expected = h * curve("H", 1.95, 40e6) + (1 - h) * curve("C", 1.95, 40e6)
    assert model.step(1.95, 40e6, True) == pytest.approx(expected, abs=1e-15)
    model.step(1.95, 40e6, False)
    h *= np.exp(-RATE * (2.0 - 1.95))
    expected = h * curve("H", 2.0, 40e6) + (1 - h) * curve("C", 2.0, 40e6)
    assert model.step(2.0, 40e6, False) == pytest.approx(expected, abs=1e-15)


@given(moves=st.lists(st.tuples(st.floats(-1.0, 1.0), st.booleans()), min_size=1, max_size=40))
def test_transition_never_leaves_the_space_between_the_curves(moves):
    model = coefficients("transition").build(WIRE)
    resistance = 1.9
    model.reset(resistance, 40e6)
    for change, heating in moves:
        resistance = min(max(resistance + change, 1.4), 2.3)
        lo, hi = sorted((curve("H", resistance, 40e6), curve("C", resistance, 40e6)))
        assert lo - 1e-12 <= model.step(resistance, 40e6, heating) <= hi + 1e-12


def test_transition_has_no_jump_at_a_reversal():
    model = coefficients("transition").build(WIRE)
    model.reset(2.0, 40e6)
    before = model.step(1.9, 40e6, False)
    assert model.step(1.9, 40e6, True) == pytest.approx(before, abs=1e-15)


@pytest.mark.parametrize("variant", VARIANTS)
def test_one_sample_and_many_give_the_same_numbers(variant):
    resistance = 1.9 + 0.2 * np.sin(np.linspace(0, 15, 300))
    stress = 40e6 + 1e6 * np.cos(np.linspace(0, 40, 300))
    heating = np.gradient(resistance) < 0
    one, many = coefficients(variant).build(WIRE), coefficients(variant).build(WIRE)
    one.reset(resistance[0], stress[0])
    many.reset(resistance[0], stress[0])
    stepped = [one.step(r, s, bool(h)) for r, s, h in zip(resistance, stress, heating)]
    np.testing.assert_array_equal(stepped, many.run(resistance, stress, heating))


def test_normalised_model_is_5_75_to_5_87():
    model = FurukawaNormalisedCoefficients(
        austenite_resistivity=0.8e-6,
        martensite_resistivity=(1.1e-6, 5e-16),
        activation=(0.01, 1.2, -0.2),
        mechanical_strain=(0.0, 2e-11),
        stroke_strain=(0.02, 2e-10),
        stress_range=(0.0, 2e8),
        strain_range=(0.003, 0.04),
    ).build(WIRE)
    stress, per_resistivity = 60e6, WIRE.length / WIRE.area_m2
    least, greatest = 0.8e-6 * per_resistivity, (1.1e-6 + 5e-16 * stress) * per_resistivity
    resistance = least + 0.4 * (greatest - least)
    activation = 0.01 + 1.2 * 0.4 - 0.2 * 0.4**2
    expected = WIRE.length * (2e-11 * stress + activation * (0.02 + 2e-10 * stress))
    assert model.step(resistance, stress, True) == pytest.approx(expected, rel=1e-12)
    (of_one,) = model.run(np.array([resistance]), np.array([stress]), np.array([False]))
    assert of_one == pytest.approx(expected, rel=1e-12)


def test_a_ni_ti_wire_is_refused():
    (problem,) = coefficients().mismatches(Wire(alloy="ni-ti", length=0.06, diameter=0.2e-3))
    assert "model of ni-ti-cu, but wire.alloy is ni-ti" in problem
