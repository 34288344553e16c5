"""What an estimate may be off since another load hung on the wire."""

import math

import pytest

from sma_actuator.base.calibration import Calibration, HotEndSection, RestSection
from sma_actuator.estimation.other_load import UNSEEN, OtherLoad

LIGHT_Pa, HEAVY_Pa = 50e6, 100e6
SHORT_m, LIGHT_m, HEAVY_m = 1e-3, 4e-3, 6e-3  #: contracted, and cold under either load


@pytest.fixture
def hang():
    """Hangs a load for ten seconds; tell it where the wire is."""
    stresses_Pa = (LIGHT_Pa, HEAVY_Pa)
    known = Calibration(
        rest=RestSection(cold_stress=stresses_Pa, cold_resistance=(5.0, 5.1), cold_displacement=(LIGHT_m, HEAVY_m)),
        hot_end=HotEndSection(
            contracted_stress=stresses_Pa, contracted_resistance=(4.0, 4.0), contracted_displacement=(SHORT_m, SHORT_m)
        ),
    )
    assert known.ends_known
    wire, clock = OtherLoad(known), [0.0]

    def go(stress_Pa, share):
        long_m = LIGHT_m if stress_Pa == LIGHT_Pa else HEAVY_m
        for _ in range(200):
            clock[0] += 0.05
            found_m = wire.step(clock[0], stress_Pa, SHORT_m + share * (long_m - SHORT_m))
        return found_m

    return go


def test_under_one_load_there_is_nothing(hang):
    assert [hang(LIGHT_Pa, share) for share in (1.0, 0.5, 0.0, 0.7, 1.0)] == [0.0] * 5


@pytest.mark.parametrize(("first_Pa", "then_Pa"), [(HEAVY_Pa, LIGHT_Pa), (LIGHT_Pa, HEAVY_Pa)])
def test_a_cold_wire_is_as_long_as_it_was_until_it_has_contracted(hang, first_Pa, then_Pa):
    hang(first_Pa, 1.0)
    whole_m = UNSEEN * (HEAVY_m - LIGHT_m)
    assert hang(then_Pa, 1.0) == pytest.approx(whole_m, rel=1e-3)
    assert hang(then_Pa, 0.4) == pytest.approx(0.4 * whole_m, rel=1e-3), "so much has not contracted"
    assert hang(then_Pa, 1.0) == pytest.approx(0.4 * whole_m, rel=1e-3), "nor since"
    assert hang(then_Pa, 0.0) == 0.0
    assert hang(then_Pa, 1.0) == 0.0


def test_with_the_old_load_on_again_it_is_what_it_was(hang):
    hang(LIGHT_Pa, 0.0)
    hang(LIGHT_Pa, 1.0)
    assert hang(HEAVY_Pa, 1.0) > 0.0
    assert hang(LIGHT_Pa, 1.0) == pytest.approx(UNSEEN * (HEAVY_m - LIGHT_m), rel=1e-3), "the heavy one stretched it"
    hang(LIGHT_Pa, 0.0)
    assert hang(LIGHT_Pa, 1.0) == 0.0


def test_a_load_that_hangs_on_a_warm_wire_says_nothing(hang):
    hang(HEAVY_Pa, 0.5)
    assert hang(LIGHT_Pa, 0.5) == 0.0


@pytest.mark.parametrize("stress_Pa", [1.15 * LIGHT_Pa, 0.85 * LIGHT_Pa])
def test_a_load_that_is_hardly_another_is_none(hang, stress_Pa):
    hang(LIGHT_Pa, 1.0)
    assert hang(stress_Pa, 1.0) == 0.0


def test_what_is_no_reading_changes_nothing(hang):
    hang(HEAVY_Pa, 1.0)
    before_m = hang(LIGHT_Pa, 1.0)
    assert hang(LIGHT_Pa, math.nan) == pytest.approx(before_m)
    assert hang(LIGHT_Pa, 0.5) == pytest.approx(0.5 * before_m)


def test_without_a_calibration_nobody_knows():
    assert OtherLoad(Calibration()).step(0.0, LIGHT_Pa, LIGHT_m) == 0.0
