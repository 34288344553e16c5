"""What the calibration says of the heat of this very wire."""

import math
from dataclasses import replace

import pytest
from calibrated import CALIBRATION

from sma_actuator.base.calibration import Calibration, HotEndSection, PowerSection
from sma_actuator.safety.thermal import WireHeat
from sma_actuator.safety.transformed import (
    CAPACITY_WITHIN,
    FALLS,
    LEAST_SLOPE_1_K,
    MOST_SLOPE_1_K,
    Transforms,
    cold_Ohm,
    contracted_Ohm,
    least_slope_1_K,
    most_contracted_Ohm,
    returns_at_most_C,
    shows_cold,
    shows_cold_no_more,
    transforms_at_C,
)


@pytest.fixture
def parameters(config):
    return replace(config.thermal, ambient_temperature=24.0)


def transforms_C(calibration, parameters, resistance_Ohm, stress_Pa):
    """As the kernel of the heat balance asks it."""
    known = Transforms(calibration, parameters)
    return transforms_at_C(known.row, resistance_Ohm, stress_Pa, known.shifts_K_Pa[1], known.then_C)


class TestTransformsAt:
    @pytest.fixture
    def calibration(self):
        return CALIBRATION

    @pytest.mark.parametrize(
        ("resistance_Ohm", "by_balance_C"), [(4.0, 90.0), (4.5, 80.0), (5.0, 70.0), (3.0, 90.0), (6.0, 70.0)]
    )
    def test_it_is_the_heating_wire_s_temperature_and_what_the_heat_capacity_may_be_off(
        self, parameters, calibration, resistance_Ohm, by_balance_C
    ):
        found_C = transforms_C(calibration, parameters, resistance_Ohm, 1e8)
        assert found_C == pytest.approx(20.0 + CAPACITY_WITHIN * (by_balance_C - 20.0))

    def test_half_way_between_the_resistances_is_half_way(self, parameters, calibration):
        other = replace(calibration, rest=replace(calibration.rest, cold_resistance=(7.0,)))
        assert transforms_C(other, parameters, 5.5, 1e8) == pytest.approx(20.0 + CAPACITY_WITHIN * 60.0)

    def test_without_the_surroundings_of_then_those_of_the_parameters_are_taken(self, parameters, calibration):
        found_C = transforms_C(replace(calibration, ambient_temperature=math.nan), parameters, 4.0, 1e8)
        assert found_C == pytest.approx(24.0 + CAPACITY_WITHIN * 66.0)

    @pytest.mark.parametrize("resistance_Ohm", [math.nan])
    def test_without_a_resistance_nobody_knows(self, parameters, calibration, resistance_Ohm):
        assert transforms_C(calibration, parameters, resistance_Ohm, 1e8) == math.inf

    def test_nor_without_a_calibration_or_with_one_whose_resistance_tells_nothing(self, parameters, calibration):
        assert transforms_C(Calibration(), parameters, 4.5, 1e8) == math.inf
        for unknown in (
            replace(calibration, power=PowerSection()),
            replace(calibration, rest=replace(calibration.rest, cold_resistance=())),
        ):
            assert transforms_C(unknown, parameters, 4.5, 1e8) == math.inf
        half = replace(calibration, hot_end=replace(calibration.hot_end, contracted_resistance=()))
        assert transforms_C(half, parameters, 4.5, 1e8) == math.inf
        flat = replace(calibration, rest=replace(calibration.rest, cold_resistance=(4.0,)))
        assert [transforms_C(flat, parameters, resistance_Ohm, 1e8) for resistance_Ohm in (4.0, 4.5)] == 2 * [math.inf]


class TestReturnsAt:
    def test_it_is_where_the_contracted_wire_begins_to_come_back_under_this_load(self, parameters):
        known = Transforms(CALIBRATION, parameters)
        found_C = [
            returns_at_most_C(known.return_C, each_Pa, known.shifts_K_Pa[0], known.then_C) for each_Pa in (1e8, 0.0)
        ]
        assert found_C == pytest.approx([20.0 + CAPACITY_WITHIN * 60.0, 20.0 + CAPACITY_WITHIN * 30.0])

    @pytest.mark.parametrize(("calibration", "stress_Pa"), [(Calibration(), 1e8), (CALIBRATION, math.nan)])
    def test_without_a_calibration_or_a_load_nobody_knows(self, parameters, calibration, stress_Pa):
        known = Transforms(calibration, parameters)
        assert returns_at_most_C(known.return_C, stress_Pa, known.shifts_K_Pa[0], known.then_C) == math.inf


class TestShowsCold:
    @pytest.mark.parametrize(
        ("shown_Ohm", "cold"),
        [(5.0, True), (5.0 * (1.0 + 0.9 * FALLS), True), (5.0 * (1.0 - 1.1 * FALLS), False), (5.5, False)],
    )
    def test_it_is_as_much_as_was_measured_cold_to_within_what_contracting_takes_off(self, parameters, shown_Ohm, cold):
        row = Transforms(CALIBRATION, parameters).row
        assert shows_cold(row, shown_Ohm, 1e8, cold_Ohm(row, 1e8)) == cold

    @pytest.mark.parametrize(
        ("calibration", "shown_Ohm", "stress_Pa"),
        [
            (Calibration(), 5.0, 1e8),
            (CALIBRATION, math.nan, 1e8),
            (CALIBRATION, 5.0, math.nan),
            (CALIBRATION, 5.0, 0.8e8),
            (CALIBRATION, 5.0, 1.2e8),
        ],
    )
    def test_without_a_calibration_a_resistance_or_a_load_that_was_seen_nobody_knows(
        self, parameters, calibration, shown_Ohm, stress_Pa
    ):
        row = Transforms(calibration, parameters).row
        assert not shows_cold(row, shown_Ohm, stress_Pa, cold_Ohm(row, stress_Pa))


class TestTheMostThatItShowsContracted:
    """The calibrated wire shows 5.0 Ω cold, and 4.4 Ω contracted that is no hotter than it can be now."""

    @pytest.mark.parametrize(
        ("shown_cold_Ohm", "most_Ohm"),
        [(5.0, 4.4), (5.5, 4.84), (4.9, 4.4), (math.inf, math.inf)],
        ids=["the calibrated one", "a thinner one", "never less", "not seen cold"],
    )
    def test_is_as_much_more_as_it_has_shown_cold(self, parameters, shown_cold_Ohm, most_Ohm):
        known_Ohm = cold_Ohm(Transforms(CALIBRATION, parameters).row, 1e8)
        assert contracted_Ohm(4.4, 4.6, shown_cold_Ohm, known_Ohm) == pytest.approx(most_Ohm)

    def test_is_what_it_shows_however_hot_where_nobody_knows(self, parameters):
        assert contracted_Ohm(4.4, 4.6, 5.0, cold_Ohm(Transforms(Calibration(), parameters).row, 1e8)) == 4.6
        known_Ohm = cold_Ohm(Transforms(CALIBRATION, parameters).row, 1e8)
        assert contracted_Ohm(math.inf, math.inf, 5.0, known_Ohm) == math.inf

    @pytest.mark.parametrize(("just_Ohm", "alike"), [(4.9, False), (5.1, True), (math.inf, False)])
    def test_may_be_as_much_as_cold(self, parameters, just_Ohm, alike):
        assert shows_cold_no_more(cold_Ohm(Transforms(CALIBRATION, parameters).row, 1e8), just_Ohm) == alike
        assert not shows_cold_no_more(cold_Ohm(Transforms(Calibration(), parameters).row, 1e8), just_Ohm)


class TestAWireOfWhichNothingIsKnownYet:
    """It shows 5.0 Ω cold, and 8 % more as it warms up to where it transforms, as one with an R-phase does."""

    @pytest.fixture
    def begun(self, parameters):
        parameters = replace(parameters, heat_capacity=0.01, heat_loss=0.005, heat_loss_margin=2.5)

        def at(shown_Ohm, falls_1_s=0.0):
            heat, since_s = WireHeat(parameters), 0.0
            heat.transforms = Transforms(CALIBRATION, parameters)

            def step(seconds, power_W, rises_1_s):
                nonlocal since_s, shown_Ohm
                for _ in range(round(seconds / 0.05)):
                    since_s += 0.05
                    shown_Ohm *= 1.0 + 0.05 * rises_1_s
                    heat.step(
                        power_W, 0.05, math.nan, parameters, shown_Ohm, 1.0, 4.4, 4.2, wire_W=power_W, stress_Pa=1e8
                    )
                    if power_W == 0.0 and not heat.cools:
                        break
                return heat, since_s

            step(6.0, 0.0, -falls_1_s)
            return step

        return at

    def test_is_known_to_be_cold_within_a_second_and_warms_up_without_being_taken_for_hot(self, begun):
        step = begun(5.0)
        heat, since_s = step(0.0, 0.0, 0.0)
        assert since_s < 1.0 and heat.at_most_C <= 20.0 + CAPACITY_WITHIN * 60.0
        heat, _ = step(2.0, 0.3, 0.04)
        assert heat.at_most_C < 150.0

    def test_another_one_is_waited_for_no_longer_but_not_called_cold(self, begun):
        heat, since_s = begun(5.2)(0.0, 0.0, 0.0)
        assert since_s < 1.0 and heat.at_most_C > 90.0

    def test_one_that_cools_hot_is_not_called_cold_though_it_passes_what_the_cold_one_shows(self, begun):
        _, since_s = begun(5.01, falls_1_s=0.02)(0.0, 0.0, 0.0)
        assert since_s > 1.6  # what its heat balance with the margin takes from 200 to 150 °C


@pytest.mark.parametrize(
    "slope_Ohm_K, shown_1_K",
    [(2e-3, 5e-4 / CAPACITY_WITHIN**2), (1e-4, LEAST_SLOPE_1_K), (1.0, MOST_SLOPE_1_K), (math.nan, LEAST_SLOPE_1_K)],
    ids=["as seen, less what is not known of it", "no wire shows less", "nor more", "nobody saw it"],
)
def test_austenite_rises_by_what_was_seen_of_this_wire(slope_Ohm_K, shown_1_K):
    hot_end = HotEndSection(contracted_resistance=(3.9, 4.0), contracted_slope=slope_Ohm_K)
    assert least_slope_1_K(hot_end) == pytest.approx(shown_1_K)


class TestTheMostThatAContractedWireShows:
    """At 200 °C, of one that showed 4.4 Ω at 90 °C: its resistance rises by a thousandth a kelvin at most."""

    @pytest.fixture
    def at_most(self, config):
        return lambda **known: most_contracted_Ohm(replace(config.calibration.hot_end, **known), 200.0)

    @pytest.mark.parametrize(("temperature_C", "times"), [(90.0, 1.0 + MOST_SLOPE_1_K * 110.0), (210.0, 1.0)])
    def test_it_follows_from_the_largest_of_any_load(self, at_most, temperature_C, times):
        shown_Ohm = at_most(contracted_resistance=(4.3, 4.4, 4.2), contracted_temperature=temperature_C)
        assert shown_Ohm == pytest.approx(times * 4.4)

    @pytest.mark.parametrize("known", [{}, {"contracted_resistance": (4.4,)}, {"contracted_temperature": 90.0}])
    def test_where_nobody_knows_it_may_be_any(self, at_most, known):
        assert at_most(**known) == math.inf
