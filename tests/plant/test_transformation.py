"""Kinetics: Liang and Rogers' closed forms, minor loops, and what dithering must not do."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.plant import kinetics
from sma_actuator.plant.kinetics import (
    COOLING,
    HEATING,
    Shift,
    band_fraction,
    half_cosine,
    hardening_way,
    martensite_after,
    new_memory,
    transform,
)
from sma_actuator.plant.materials import WIRES
from sma_actuator.plant.measured import measured_between
from sma_actuator.plant.worlds import WORLDS, wire_in_world

FLEXINOL = WIRES["flexinol"].kinetics
SLOPE_PA_K = FLEXINOL.stress_slope_Pa_K
IN_EVERY_KINETICS = pytest.mark.parametrize(
    "k",
    [f"{wire}-{world}" for wire in ("flexinol", "furukawa") for world in ("liang_rogers", "measured", "lagoudas")],
    indirect=True,
)


@pytest.fixture(scope="module")
def k(request):
    """Kinetics by their name: to collect the tests makes none."""
    return wire_in_world(*request.param.split("-")).kinetics


class Sample:
    """A piece of martensite led through temperatures by hand."""

    def __init__(self, fraction=1.0, stress_Pa=0.0, kinetics=FLEXINOL):
        self.memory, self.fraction, self.stress_Pa = new_memory(fraction), fraction, stress_Pa
        self.family, self.bands = kinetics.family, kinetics.bands()

    def to(self, temperature_C, steps=200):
        """Go there slowly; return the fraction."""
        begin = getattr(self, "temperature_C", temperature_C)
        for i in range(1, steps + 1):
            t = begin + (temperature_C - begin) * i / steps
            self.fraction = martensite_after(
                self.family, self.bands, self.memory, self.fraction, t, self.stress_Pa, Shift(0.0, 0.0), True
            )
        self.temperature_C = temperature_C
        return self.fraction


def liang_rogers_heating(temperature_C, from_fraction, stress_Pa=0.0):
    c = FLEXINOL
    return (
        from_fraction
        / 2
        * (
            math.cos(
                math.pi
                / (c.austenite_finish_C - c.austenite_start_C)
                * (temperature_C - c.austenite_start_C - stress_Pa / SLOPE_PA_K)
            )
            + 1
        )
    )


def liang_rogers_cooling(temperature_C, from_fraction, stress_Pa=0.0):
    c = FLEXINOL
    angle = (
        math.pi
        / (c.martensite_start_C - c.martensite_finish_C)
        * (temperature_C - c.martensite_finish_C - stress_Pa / SLOPE_PA_K)
    )
    return (1 - from_fraction) / 2 * math.cos(angle) + (1 + from_fraction) / 2


@pytest.mark.parametrize("stress_Pa", [0.0, 50e6, 120e6])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_heating_and_cooling_from_the_major_loop_follow_the_closed_forms(stress_Pa, share):
    shift_K = stress_Pa / SLOPE_PA_K
    sample = Sample(stress_Pa=stress_Pa)
    sample.to(20.0 + shift_K)
    hot_C = FLEXINOL.austenite_start_C + shift_K + share * (FLEXINOL.austenite_finish_C - FLEXINOL.austenite_start_C)
    left = sample.to(hot_C)
    assert left == pytest.approx(liang_rogers_heating(hot_C, 1.0, stress_Pa), abs=1e-12)
    cold_C = (
        FLEXINOL.martensite_start_C + shift_K - share * (FLEXINOL.martensite_start_C - FLEXINOL.martensite_finish_C)
    )
    assert sample.to(cold_C) == pytest.approx(liang_rogers_cooling(cold_C, left, stress_Pa), abs=1e-12)


def test_heating_after_incomplete_cooling_starts_from_what_had_formed():
    sample = Sample(fraction=0.0)
    sample.to(80.0)
    formed = sample.to(33.0)
    assert 0.1 < formed < 0.9
    assert sample.to(57.0) == pytest.approx(liang_rogers_heating(57.0, formed), abs=1e-12)


def test_dithering_inside_the_hysteresis_does_not_ratchet():
    sample = Sample()
    sample.to(20.0)
    at_rest = sample.to(56.0)
    for _ in range(1000):
        sample.to(54.0, steps=3)
        sample.to(56.0, steps=3)
    assert sample.fraction == at_rest


def test_a_minor_loop_closes_where_it_began():
    sample = Sample()
    sample.to(20.0)
    at_turn = sample.to(57.0)
    for depth_C in (37.9, 36.0, 33.0, 35.0):
        sample.to(depth_C)
        assert sample.to(57.0) == pytest.approx(at_turn, abs=1e-12)
    assert sample.to(59.0) == pytest.approx(liang_rogers_heating(59.0, 1.0), abs=1e-12)


def test_full_heating_and_full_cooling_wipe_the_memory():
    sample = Sample()
    for temperature_C in (20.0, 57.0, 34.0, 56.0, 35.0, 90.0):
        sample.to(temperature_C)
    assert sample.fraction == 0.0 and sample.memory[3] == 0 and sample.memory[4] == 0
    sample.to(33.0)
    assert sample.to(10.0) == 1.0


@given(st.lists(st.floats(10.0, 80.0), min_size=1, max_size=60))
def test_any_history_keeps_the_fraction_possible_and_its_memory_finite(temperatures_C):
    sample = Sample()
    for temperature_C in temperatures_C:
        before, previous_C = sample.fraction, getattr(sample, "temperature_C", 10.0)
        after = sample.to(temperature_C, steps=5)
        assert 0.0 <= after <= 1.0
        assert (after <= before + 1e-12) if temperature_C >= previous_C else (after >= before - 1e-12)
    assert sample.memory[3] <= kinetics.DEPTH and sample.memory[4] <= kinetics.DEPTH


def test_more_nested_reversals_than_are_remembered_do_no_harm():
    sample = Sample()
    sample.to(20.0)
    for i in range(3 * kinetics.DEPTH):
        sample.to(60.0 - 0.1 * i)
        sample.to(30.0 + 0.1 * i)
    assert 0.0 < sample.fraction < 1.0
    assert sample.to(80.0) == 0.0
    assert sample.to(20.0) == 1.0


def test_asking_without_commitment_changes_nothing():
    memory = new_memory(1.0)
    transform(memory, 1.0, 0.4, 0.0, True)
    before = memory.copy()
    assert transform(memory, 0.4, 1.0, 0.3, False) == pytest.approx(0.4 + 0.6 * 0.3)
    assert (memory == before).all()


def test_the_cosine_is_flat_outside_its_band():
    assert half_cosine(10.0, 20.0, 30.0) == 1.0
    assert half_cosine(31.0, 20.0, 30.0) == 0.0
    assert half_cosine(25.0, 20.0, 30.0) == pytest.approx(0.5)


# --- every kinetics --------------------------------------------------------------------------------


def on_band(k, row, temperature_C, stress_Pa):
    return band_fraction(k.family, k.bands(), row, temperature_C, stress_Pa)


@IN_EVERY_KINETICS
@pytest.mark.parametrize("stress_Pa", [0.0, 60e6, 150e6])
def test_every_kinetics_lies_between_its_bands_and_ends_in_one_phase(k, stress_Pa):
    sample = Sample(kinetics=k, stress_Pa=stress_Pa)
    assert sample.to(-150.0) == pytest.approx(1.0, abs=1e-4)
    for temperature_C in range(-150, 250, 5):
        assert sample.to(float(temperature_C), 20) == pytest.approx(
            on_band(k, HEATING, temperature_C, stress_Pa), abs=1e-4
        )
    assert sample.to(250.0) == pytest.approx(0.0, abs=1e-4)
    for temperature_C in range(250, -150, -5):
        assert sample.to(float(temperature_C), 20) == pytest.approx(
            on_band(k, COOLING, temperature_C, stress_Pa), abs=1e-4
        )


@IN_EVERY_KINETICS
def test_in_every_kinetics_stress_brings_martensite_and_cooling_lags_heating(k):
    for temperature_C in range(0, 120, 4):
        for row in (HEATING, COOLING):
            at = [on_band(k, row, float(temperature_C), s) for s in (10e6, 60e6, 150e6)]
            assert at == sorted(at)
        assert on_band(k, COOLING, temperature_C, 60e6) <= on_band(k, HEATING, temperature_C, 60e6) + 2e-3


@IN_EVERY_KINETICS
@given(st.floats(40.0, 75.0), st.lists(st.floats(0.05, 0.95), min_size=1, max_size=8))
def test_in_every_kinetics_what_is_inside_a_loop_is_forgotten_when_it_closes(k, turn_C, inner):
    """Return-point memory: a walk inside a loop comes back to the point where the loop was left, and ends on it."""
    sample = Sample(kinetics=k, stress_Pa=54e6)
    sample.to(-100.0)
    high = sample.to(turn_C)
    low_C = turn_C - 35.0
    low = sample.to(low_C)
    for share in inner:
        sample.to(low_C + 35.0 * share, 10)
    assert sample.to(low_C, 40) == pytest.approx(low, abs=1e-9)
    assert sample.to(turn_C, 40) == pytest.approx(high, abs=1e-9)
    plain = Sample(kinetics=k, stress_Pa=54e6)
    plain.to(-100.0)
    assert sample.to(turn_C + 4.0) == pytest.approx(plain.to(turn_C + 4.0, 400), abs=1e-9)


@IN_EVERY_KINETICS
@given(st.lists(st.floats(-20.0, 140.0), min_size=1, max_size=40))
def test_in_every_kinetics_any_history_moves_the_fraction_the_way_the_temperature_goes(k, temperatures_C):
    sample = Sample(kinetics=k, stress_Pa=54e6)
    sample.to(-100.0)
    for temperature_C in temperatures_C:
        before, previous_C = sample.fraction, sample.temperature_C
        after = sample.to(temperature_C, steps=5)
        assert 0.0 <= after <= 1.0
        assert (after <= before + 1e-3) if temperature_C >= previous_C else (after >= before - 1e-3)


@pytest.mark.parametrize(("n", "m"), [(1.0, 1.0), (0.5, 0.5), (0.25, 0.35), (0.3, 0.2)])
def test_the_table_of_smooth_hardening_inverts_its_law(n, m):
    table = kinetics.hardening_table(n, m)
    way = hardening_way(table, n, m)
    inside = (table > 1e-6) & (table < 1.0 - 1e-6)
    assert abs(way - (1.0 - np.arange(len(table)) / kinetics.TABLE))[inside].max() < 2e-4
    assert table[0] == 1.0 and table[-1] == 0.0 and (np.diff(table) <= 0.0).all()


def test_smooth_hardening_with_one_half_is_known_in_closed_form():
    table = kinetics.hardening_table(0.5, 0.5)
    y = 1.0 - 2.0 * np.arange(len(table)) / kinetics.TABLE  # ξ^½ − (1 − ξ)^½
    assert table == pytest.approx(0.5 * (1.0 + y * np.sqrt(2.0 - y**2)), abs=2e-5)


def test_impossible_exponents_and_weights_are_refused():
    with pytest.raises(ValueError, match="exponents 0 and 0.3"):
        kinetics.hardening_table(0.0, 0.3)
    half = kinetics.Logistic(0.5, 60.0, 2.0, 8e6)
    with pytest.raises(ValueError, match="add up to 1"):
        kinetics.Measured((half,), (half, half)).bands()


def test_a_distribution_is_moved_by_its_percentiles():
    moved = measured_between(50.0, 80.0, 60.0, 20.0, 8e6)
    assert moved.quantiles_C(0.9) == pytest.approx((50.0, 20.0), abs=1e-6)
    assert moved.quantiles_C(0.1) == pytest.approx((80.0, 60.0), abs=1e-6)


def test_an_unknown_physics_is_refused_by_name():
    with pytest.raises(ValueError, match="'caloric' is no physics of the bench; one of measured, liang_rogers"):
        wire_in_world("flexinol", "caloric")
    assert len(WORLDS) >= 7
