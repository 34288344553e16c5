"""Martensite is as long as the load made it under which it formed."""

from math import hypot, nan, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sma_actuator.base.lookup import row_of
from sma_actuator.estimation.models.orientation import (
    CONTACTS,
    FOLLOWED,
    PLAY,
    SHORTEST,
    USUALLY,
    WARMER_1_K,
    WITHIN,
    begin,
    follow,
    longer_all_m,
    longer_m,
    nothing_known,
    tell,
    told,
    unsure_m,
)
from sma_actuator.estimation.models.surroundings import UNMEASURED_K

#: Contracted it is 0.2 mm long whatever its load; cold it is 1 mm and 2 mm per 100 MPa longer.
ENDS = np.array([[2e-4, 0.0, 0.0], [1.2e-3, 2e-11, 0.0]])
LIGHT_Pa, HEAVY_Pa = 50e6, 100e6
LIGHT_m, HEAVY_m = 2e-3, 3e-3  #: its stroke under these
USUAL = row_of(((0.0, 100e6), (5.0, 5.2)))
PER_m, SCATTER_Ohm, READING_Ohm = 100.0, 1e-3, 4e-3


def wire(stays=1.0, turned=1.0, rested_K=nan):
    return np.array([PER_m, SCATTER_Ohm, READING_Ohm, stays, turned, rested_K])


def driven(known, *course, first=(1.0, LIGHT_Pa)):
    """Its memory after it had these shares of martensite under these loads, one after the other."""
    state = nothing_known()
    begin(first[0], 0.0, 1.0, first[1], ENDS, state)
    for share, stress_Pa in course:
        follow(share, stress_Pa, ENDS, known, state)
    return state


@given(
    shares=st.lists(st.floats(0.0, 1.0), max_size=30),
    stays=st.floats(0.0, 1.0),
    turned=st.floats(0.0, 1.0),
    stress_Pa=st.floats(0.0, 200e6),
)
def test_under_one_load_nothing_is_longer_than_that_makes_it(shares, stays, turned, stress_Pa):
    known = wire(stays, turned)
    state = driven(known, *((share, stress_Pa) for share in shares), first=(1.0, stress_Pa))
    assert longer_m(stress_Pa, ENDS, known, state) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("stays", [0.0, 0.4, 1.0])
def test_what_stays_under_a_lighter_load(stays):
    known = wire(stays)
    state = driven(known, (1.0, LIGHT_Pa), first=(1.0, HEAVY_Pa))
    assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(stays * (HEAVY_m - LIGHT_m))
    assert longer_m(HEAVY_Pa, ENDS, known, state) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("turned", "length_m"), [(0.0, LIGHT_m), (0.6, LIGHT_m), (0.8, 2.4e-3), (1.0, HEAVY_m)])
def test_a_heavier_load_turns_cold_martensite_so_far(turned, length_m):
    known = wire(turned=turned)
    state = driven(known, (1.0, HEAVY_Pa))
    assert longer_m(HEAVY_Pa, ENDS, known, state) == pytest.approx(length_m - HEAVY_m)


def test_each_part_keeps_the_load_that_it_formed_under():
    """A quarter formed under the heavy load; then the load becomes light, and the rest forms."""
    known = wire()
    state = driven(known, (0.25 + PLAY, HEAVY_Pa), (1.0 + PLAY, LIGHT_Pa), first=(0.0, HEAVY_Pa))
    assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.25 * (HEAVY_m - LIGHT_m))


@given(left=st.floats(0.0, 1.0))
def test_what_becomes_austenite_takes_its_share_along(left):
    known = wire()
    state = driven(known, (max(left - PLAY, 0.0), LIGHT_Pa), (1.0 + PLAY, LIGHT_Pa), first=(1.0, HEAVY_Pa))
    assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(left * (HEAVY_m - LIGHT_m), abs=PLAY * HEAVY_m)


@given(
    course=st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 200e6)), min_size=1, max_size=30),
    stays=st.floats(0.0, 1.0),
    turned=st.floats(0.0, 1.0),
    sure=st.floats(0.0, 1.0),
)
def test_whatever_it_went_through_it_is_as_long_as_one_of_its_loads_makes_it_at_most(course, stays, turned, sure):
    known, state = wire(stays, turned), nothing_known()
    begin(course[0][0], 0.0, sure, course[0][1], ENDS, state)
    stroke_m = [ENDS[1, 0] + ENDS[1, 1] * stress_Pa - ENDS[0, 0] for _, stress_Pa in course]
    for share, stress_Pa in course:
        follow(share, stress_Pa, ENDS, known, state)
        assert abs(longer_m(stress_Pa, ENDS, known, state)) <= max(stroke_m) - min(stroke_m) + 1e-12
        assert min(unsure_m(stress_Pa, ENDS, known, state)) >= 0.0


def test_a_small_cycle_is_between_last_first_and_each_in_its_share():
    """Half becomes austenite, forms again under the light load and becomes austenite once more: of what formed under
    the heavy one all is left if the last goes first, half if each part goes in its share."""
    known, half = wire(), ((0.5 - PLAY, LIGHT_Pa), (1.0 + PLAY, LIGHT_Pa), (0.5 - PLAY, LIGHT_Pa))
    state = driven(known, *half, first=(1.0, HEAVY_Pa))
    assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.375 * (HEAVY_m - LIGHT_m))
    more_m = HEAVY_m - LIGHT_m
    assert unsure_m(LIGHT_Pa, ENDS, known, state) == pytest.approx((FOLLOWED * 0.375 * more_m, 0.125 * more_m))


@pytest.mark.parametrize("sure", [0.0, 0.5, 1.0])
def test_a_wire_on_a_spring_is_taken_for_cooled_on_it_where_its_length_is_not_told(sure):
    known, state = wire(turned=0.0), nothing_known()
    begin(1.0, 0.0, sure, LIGHT_Pa, ENDS, state)
    follow(0.5 - PLAY, HEAVY_Pa, ENDS, known, state)
    shorter_m = 0.5 * sure * (HEAVY_m - LIGHT_m)
    assert longer_m(HEAVY_Pa, ENDS, known, state) == pytest.approx(-shorter_m, abs=1e-9)
    # Once it has stretched it is known what formed when: another load is no other spring.
    follow(0.75 + PLAY, HEAVY_Pa, ENDS, known, state)
    follow(0.5 - PLAY, LIGHT_Pa, ENDS, known, state)
    left_m = 0.5 * (1.0 - sure) * (HEAVY_m - LIGHT_m)
    in_turn, mixed = left_m, left_m + (0.25 * sure / 1.5) * (HEAVY_m - LIGHT_m)
    assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.5 * (in_turn + mixed), rel=0.02, abs=1e-6)


def test_noise_of_the_share_is_no_transformation():
    known = wire()
    state = driven(known, *((0.5 + noise, LIGHT_Pa) for noise in 50 * [0.9 * PLAY, -0.9 * PLAY]), first=(0.5, HEAVY_Pa))
    assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.5 * (HEAVY_m - LIGHT_m), rel=1e-9)


class TestTheColdWireAsAStrainGauge:
    @pytest.mark.parametrize("off_m", [-8e-4, 6e-4, 1e-3])
    def test_its_resistance_says_how_much_longer_it_is(self, off_m):
        state, known = nothing_known(), wire(stays=0.0)
        for _ in range(20):
            tell(5.1 + PER_m * off_m, LIGHT_Pa, 0.0, 0.0, USUAL, ENDS, known, state)
        assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(off_m, rel=0.06)
        by_chance_m, either_way_m = unsure_m(LIGHT_Pa, ENDS, known, state)
        assert by_chance_m > hypot(WITHIN * off_m, 1.8 * CONTACTS * 5.1 / PER_m) and either_way_m == 0.0
        assert told(state)

    @pytest.mark.parametrize("share", [-1.0, 0.5, 1.0])
    def test_other_contacts_are_no_other_length(self, share):
        state, known = nothing_known(), wire()
        tell(5.1 * (1.0 + share * CONTACTS), LIGHT_Pa, 0.0, 0.0, USUAL, ENDS, known, state)
        assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.0, abs=1e-9)

    @pytest.mark.parametrize("warmer_K", [-15.0, 10.0])
    @pytest.mark.parametrize("per_K", [3e-4, 7e-4, 1.1e-3])
    def test_a_room_that_is_warmer_is_no_other_length(self, warmer_K, per_K):
        state, known = nothing_known(), wire(stays=0.0)
        tell(5.1 * (1.0 + per_K * warmer_K), LIGHT_Pa, warmer_K, 0.0, USUAL, ENDS, known, state)
        half_m, _ = unsure_m(LIGHT_Pa, ENDS, known, state)
        assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.0, abs=1e-9)
        assert half_m == 0.0  # it was seen to follow its load at once

    @pytest.mark.parametrize("off", [-1.0, 1.0])
    def test_a_room_that_nobody_measures_is_no_other_length(self, off):
        state, known = nothing_known(), wire(stays=0.0)
        tell(5.1 * (1.0 + off * WARMER_1_K * UNMEASURED_K), LIGHT_Pa, nan, 0.0, USUAL, ENDS, known, state)
        assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.0, abs=1e-9)

    @pytest.mark.parametrize("warmer_K", [-10.0, 10.0])
    def test_how_sure_its_length_is_knows_of_the_room(self, warmer_K):
        longer = []
        for room_K in (0.0, warmer_K):
            state, known = nothing_known(), wire(stays=0.0)
            for _ in range(20):
                tell(5.1 * (1.0 + WARMER_1_K * room_K) + PER_m * 1e-3, LIGHT_Pa, room_K, 0.0, USUAL, ENDS, known, state)
            longer.append((longer_m(LIGHT_Pa, ENDS, known, state), unsure_m(LIGHT_Pa, ENDS, known, state)[0]))
        (usual_m, sure_m), (elsewhere_m, unsure) = longer
        assert 0.8 * usual_m < elsewhere_m < usual_m and unsure > 1.5 * sure_m

    @pytest.mark.parametrize("rise_K", [0.0, 3.0, 5.0])
    @pytest.mark.parametrize("per_K", [3e-4, 7e-4, 1.1e-3])
    def test_one_that_has_just_been_switched_on_is_colder_and_no_shorter(self, rise_K, per_K):
        """Its usual resistance is that at the bias current, which keeps it some kelvins above the room."""
        state, known = nothing_known(), wire(stays=0.0, rested_K=3.0)
        tell(5.1 * (1.0 + per_K * (rise_K - 3.0)), LIGHT_Pa, 0.0, rise_K, USUAL, ENDS, known, state)
        assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.0, abs=1e-9)

    def test_readings_are_averaged_and_what_is_no_more_than_their_scatter_is_nothing(self):
        rng = np.random.default_rng(1)
        state, known = nothing_known(), wire(stays=0.0)
        tell(5.1 + 3.5 * READING_Ohm, LIGHT_Pa, 0.0, 0.0, USUAL, ENDS, known, state)
        once_m, (unsure_once_m, _) = longer_m(LIGHT_Pa, ENDS, known, state), unsure_m(LIGHT_Pa, ENDS, known, state)
        assert once_m > 1e-5
        for _ in range(400):
            tell(5.1 + rng.normal(0.0, READING_Ohm), LIGHT_Pa, 0.0, 0.0, USUAL, ENDS, known, state)
        assert abs(longer_m(LIGHT_Pa, ENDS, known, state)) < SCATTER_Ohm / PER_m
        assert unsure_m(LIGHT_Pa, ENDS, known, state)[0] < 0.5 * unsure_once_m

    def test_a_wire_that_remembers_may_be_longer_though_its_resistance_does_not_say_so(self):
        for known, least_m in (
            (wire(stays=0.0), 0.0),
            (wire(), USUALLY * LIGHT_m),
            (wire(0.0, 0.8), 0.2 * USUALLY * LIGHT_m),
        ):
            state = nothing_known()
            tell(5.1, LIGHT_Pa, 0.0, 0.0, USUAL, ENDS, known, state)
            square = (SCATTER_Ohm**2 + READING_Ohm**2 + (CONTACTS * 5.1) ** 2) / PER_m**2
            assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.0, abs=1e-9)
            half_m = 2.0 * least_m / sqrt(1.0 + least_m**2 / square)
            assert unsure_m(LIGHT_Pa, ENDS, known, state) == pytest.approx((half_m, 0.0), abs=1e-9)

    def test_a_wire_that_seems_shorter_than_any_is_warm(self):
        state, known = nothing_known(), wire()
        tell(4.0, LIGHT_Pa, 0.0, 0.0, USUAL, ENDS, known, state)
        assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx((SHORTEST - 1.0) * LIGHT_m)

    def test_it_forgets_as_it_contracts(self):
        state, known = nothing_known(), wire(stays=0.0)
        tell(5.2, LIGHT_Pa, 0.0, 0.0, USUAL, ENDS, known, state)
        began_m, (unsure_m_, _) = longer_m(LIGHT_Pa, ENDS, known, state), unsure_m(LIGHT_Pa, ENDS, known, state)
        follow(0.5 - PLAY, LIGHT_Pa, ENDS, known, state)
        assert not told(state)
        follow(1.0, LIGHT_Pa, ENDS, known, state)
        assert not told(state)  # all martensite again, but not as it began: what was read then is of the past
        assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.5 * began_m)
        assert unsure_m(LIGHT_Pa, ENDS, known, state) == pytest.approx((0.5 * unsure_m_, 0.0))
        # Contracted by half once more, a quarter is left; if the last goes first half, which the interval has.
        follow(0.5 - PLAY, LIGHT_Pa, ENDS, known, state)
        assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.25 * began_m, rel=0.02)
        told_m = sqrt(unsure_m_**2 - (FOLLOWED * began_m) ** 2)
        by_chance_m = hypot(0.5 * told_m, FOLLOWED * 0.25 * began_m)
        assert unsure_m(LIGHT_Pa, ENDS, known, state) == pytest.approx((by_chance_m, 0.25 * began_m), rel=0.02)
        follow(-PLAY, LIGHT_Pa, ENDS, known, state)
        assert longer_m(LIGHT_Pa, ENDS, known, state) == pytest.approx(0.0, abs=1e-12)


def test_of_a_measured_displacement_it_takes_off_what_other_loads_left():
    """A wire that was cooled under the heavy load, heated and cooled under the light one, twice."""
    known, share = wire(), np.concatenate([np.ones(10), *2 * [np.linspace(1.0, 0.0, 50), np.linspace(0.0, 1.0, 50)]])
    old = np.minimum.accumulate(share)
    displacement_m = ENDS[0, 0] + LIGHT_m * share + (HEAVY_m - LIGHT_m) * old
    out = np.empty(len(share))
    longer_all_m(
        displacement_m,
        np.full(len(share), LIGHT_Pa),
        np.arange(len(share)) == 0,
        np.full(len(share), ENDS[0, 0] + LIGHT_m),
        ENDS,
        known,
        nothing_known(),
        out,
    )
    np.testing.assert_allclose(out, (HEAVY_m - LIGHT_m) * old, atol=2.0 * PLAY * HEAVY_m)
    np.testing.assert_allclose(out[-100:], 0.0, atol=2.0 * PLAY * HEAVY_m)


@pytest.mark.parametrize("off_m", [-3e-4, 2e-4])
def test_a_wire_that_begins_where_it_usually_rests_is_as_long_as_its_load_makes_it(off_m):
    """However far a quadratic in stress is off there."""
    share = np.concatenate([np.ones(10), np.linspace(1.0, 0.0, 50), np.linspace(0.0, 1.0, 50)])
    displacement_m = ENDS[0, 0] + (LIGHT_m + off_m) * share
    out = np.empty(len(share))
    longer_all_m(
        displacement_m,
        np.full(len(share), LIGHT_Pa),
        np.arange(len(share)) == 0,
        np.full(len(share), displacement_m[0]),
        ENDS,
        wire(),
        nothing_known(),
        out,
    )
    np.testing.assert_allclose(out, 0.0, atol=1e-9)
