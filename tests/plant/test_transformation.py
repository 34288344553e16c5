"""Kinetics: Liang and Rogers' closed forms, minor loops, and what dithering must not do."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.plant import physics
from sma_actuator.plant.materials import WIRES
from sma_actuator.plant.physics import constants, half_cosine, martensite_at, new_memory, transform

FLEXINOL = constants(WIRES["flexinol"], 1.25)


class Sample:
    """A piece of martensite led through temperatures by hand."""

    def __init__(self, fraction=1.0, stress_Pa=0.0):
        self.memory, self.fraction, self.stress_Pa = new_memory(fraction), fraction, stress_Pa

    def to(self, temperature_C, steps=200):
        """Go there slowly; return the fraction."""
        begin = getattr(self, "temperature_C", temperature_C)
        for i in range(1, steps + 1):
            t = begin + (temperature_C - begin) * i / steps
            self.fraction = martensite_at(FLEXINOL, self.memory, self.fraction, t, self.stress_Pa, True)
        self.temperature_C = temperature_C
        return self.fraction


def liang_rogers_heating(temperature_C, from_fraction, stress_Pa=0.0):
    c = FLEXINOL
    return (
        from_fraction
        / 2
        * (math.cos(math.pi / (c.af_C - c.as_C) * (temperature_C - c.as_C - stress_Pa * c.slope_K_Pa)) + 1)
    )


def liang_rogers_cooling(temperature_C, from_fraction, stress_Pa=0.0):
    c = FLEXINOL
    angle = math.pi / (c.ms_C - c.mf_C) * (temperature_C - c.mf_C - stress_Pa * c.slope_K_Pa)
    return (1 - from_fraction) / 2 * math.cos(angle) + (1 + from_fraction) / 2


@pytest.mark.parametrize("stress_Pa", [0.0, 50e6, 120e6])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_heating_and_cooling_from_the_major_loop_follow_the_closed_forms(stress_Pa, share):
    shift_K = stress_Pa * FLEXINOL.slope_K_Pa
    sample = Sample(stress_Pa=stress_Pa)
    sample.to(20.0 + shift_K)
    hot_C = FLEXINOL.as_C + shift_K + share * (FLEXINOL.af_C - FLEXINOL.as_C)
    left = sample.to(hot_C)
    assert left == pytest.approx(liang_rogers_heating(hot_C, 1.0, stress_Pa), abs=1e-12)
    cold_C = FLEXINOL.ms_C + shift_K - share * (FLEXINOL.ms_C - FLEXINOL.mf_C)
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
    assert sample.memory[3] <= physics.DEPTH and sample.memory[4] <= physics.DEPTH


def test_more_nested_reversals_than_are_remembered_do_no_harm():
    sample = Sample()
    sample.to(20.0)
    for i in range(3 * physics.DEPTH):
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
