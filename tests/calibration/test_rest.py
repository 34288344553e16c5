"""What a wire at rest shows, against its calibration, without a log: each line is a rest that somebody could have
seen."""

from dataclasses import fields, replace

import numpy as np
import pytest
from pulsed import pulsed_log

from sma_actuator.base.calibration import Calibration, HotEndSection, RestSection, TrainingSection
from sma_actuator.calibration.rest import AS_HOT, REPEATS, AtRest, Usual, learn

CALIBRATION = Calibration(
    rest=RestSection(
        cold_stress=(2e7, 4e7, 8e7),
        cold_resistance=(2.0, 2.1, 2.2),
        cold_displacement=(1e-3, 2e-3, 2.5e-3),
        hot_stress=(2e7, 4e7, 8e7),
        hot_resistance=(1.5, 1.51, 1.53),
        hot_displacement=(1e-4, 1.2e-4, 1.6e-4),
        hot_power=0.3,
    ),
    hot_end=HotEndSection(contracted_slope=5e-4),
)
USUAL = Usual(CALIBRATION, heat_loss_W_K=0.005, resistance_Ohm=0.7, stroke_m=4e-3)
COLD = AtRest(False, 2.1, 2e-3, 0.0, 0.0, 4e7, 0.0, 0.005, 0.0, 0.0)
HOT = AtRest(True, 1.51, 1.2e-4, 0.0, 0.0, 4e7, 0.0, 0.3, 0.0, 0.0)


def together(*rests):
    """Single rests as arrays."""
    return AtRest(*(np.array([getattr(rest, f.name) for rest in rests]) for f in fields(AtRest)))


def off(rest, usual=USUAL):
    (found,) = usual.off(together(rest))
    return found


def test_a_rest_like_the_calibration_s_is_not_off():
    np.testing.assert_allclose(USUAL.off(together(COLD, HOT)), 0.0, atol=1e-12)
    assert USUAL.off(together()).shape == (0, 2)


@pytest.mark.parametrize("rest", [COLD, HOT])
def test_more_resistance_or_another_length_counts_in_what_a_rest_repeats_to(rest):
    more_Ohm = replace(rest, resistance_Ohm=rest.resistance_Ohm + 3.0 * REPEATS[0] * 0.7)
    longer = replace(rest, displacement_m=rest.displacement_m + 2.0 * REPEATS[1] * 4e-3)
    np.testing.assert_allclose(off(more_Ohm), (3.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(off(longer), (0.0, 2.0), atol=1e-9)


def test_a_cold_wire_that_keeps_all_variants_is_as_under_the_load_that_it_formed_under():
    rests, formed_Pa = together(COLD, COLD, HOT), np.array([8e7, 4e7, 8e7])
    kept = USUAL.as_formed(rests, formed_Pa)
    np.testing.assert_allclose(kept.resistance_Ohm, (2.2, 2.1, 1.51))
    np.testing.assert_allclose(kept.displacement_m, (2.5e-3, 2e-3, 1.2e-4))
    unknown = Usual(Calibration(), heat_loss_W_K=0.005, resistance_Ohm=0.7, stroke_m=4e-3)
    assert unknown.as_formed(rests, formed_Pa) is rests


@pytest.mark.parametrize(
    ("rest", "but"),
    [
        (COLD, {"further_m": 1e-4}),  # it creeps on
        (COLD, {"since_Pa": 2e7}),  # it became martensite under another load
        (COLD, {"warmer_K": -5.0}),  # the room is colder
        (COLD, {"beside_W": 0.025}),  # or seems so to an effect
        (HOT, {"further_m": 1e-4}),
    ],
)
def test_a_rest_is_trusted_less(rest, but):
    shown = replace(rest, resistance_Ohm=rest.resistance_Ohm + 0.01, displacement_m=rest.displacement_m + 1e-4)
    assert (np.abs(off(replace(shown, **but))) < 0.9 * np.abs(off(shown))).all()


def test_between_the_calibration_s_loads_it_is_trusted_less_than_at_them():
    between = replace(COLD, stress_Pa=6e7, resistance_Ohm=2.3, displacement_m=3e-3)
    at = replace(COLD, stress_Pa=8e7, resistance_Ohm=2.3, displacement_m=3e-3)
    calibrated = USUAL._expected(False, {"stress_Pa": np.array([6e7, 8e7]), "since_Pa": np.zeros(2)})
    assert calibrated[1][0] > calibrated[1][1] == 0.0
    assert np.isfinite(off(between)).all() and np.isfinite(off(at)).all()


def test_a_contracted_wire_is_held_against_what_it_has_at_its_temperature():
    """0.05 W over 0.005 W/K is ten kelvin, and so is a room that is ten kelvin warmer: 5 mΩ."""
    hotter = replace(HOT, heat_W=0.35, resistance_Ohm=1.515)
    in_the_sun = replace(HOT, warmer_K=10.0, resistance_Ohm=1.515)
    np.testing.assert_allclose(off(hotter), 0.0, atol=1e-9)
    np.testing.assert_allclose(off(in_the_sun), 0.0, atol=1e-9)
    assert off(replace(hotter, resistance_Ohm=1.51))[0] < -1.0
    far = replace(HOT, heat_W=0.3 * (1.01 + AS_HOT), resistance_Ohm=9.0)
    np.testing.assert_array_equal(off(far), 0.0)  # nobody knows what it has there


def test_of_a_cold_wire_whose_resistance_still_moves_it_is_not_known_to_that():
    """In a short pause the length may have come to rest, and an intermediate phase or the last of the heat not yet
    gone: 3 rests of 21 lay 3 to 8 standard deviations off, and nothing had happened."""
    still = replace(COLD, resistance_Ohm=2.13)
    moves = replace(still, further_Ohm=-0.03)
    assert off(still)[0] > 10.0 and 0.9 < off(moves)[0] < 1.0
    assert off(moves)[1] == off(still)[1]


def test_where_pulses_ended_too_soon_a_contracted_wire_is_trusted_less_and_the_less_the_colder_it_is():
    hasty = replace(USUAL, calibration=replace(CALIBRATION, rest=replace(CALIBRATION.rest, hot_to_go=5e-5)))
    longer = replace(HOT, displacement_m=2e-4)
    as_hot, colder = off(longer, hasty)[1], off(replace(longer, heat_W=0.25), hasty)[1]
    assert off(longer)[1] > as_hot > colder > 0.0


def test_a_wire_that_changed_while_it_was_calibrated_is_longer_since_and_less_sure():
    """A quarter of what the hot end moved, two fifths of that at the cold one."""
    changed = replace(USUAL, calibration=replace(CALIBRATION, training=TrainingSection(changed=4e-4)))
    np.testing.assert_allclose(off(replace(HOT, displacement_m=1.2e-4 + 1e-4), changed), 0.0, atol=1e-9)
    np.testing.assert_allclose(off(replace(COLD, displacement_m=2e-3 + 0.4e-4), changed), 0.0, atol=1e-9)
    shown = replace(HOT, resistance_Ohm=1.52)
    assert abs(off(shown, changed)[0]) < abs(off(shown)[0])


def test_without_a_calibration_a_rest_is_held_against_the_session_s_others():
    nobody = Usual(Calibration(), heat_loss_W_K=0.005, resistance_Ohm=0.7, stroke_m=4e-3)
    apart_Ohm = 10.0 * REPEATS[0] * 0.7
    other_load = replace(COLD, stress_Pa=8e7, resistance_Ohm=5.0)
    found = nobody.off(together(COLD, replace(COLD, resistance_Ohm=2.1 + apart_Ohm), other_load))
    np.testing.assert_allclose(found[:, 0], (-5.0, 5.0, 0.0), rtol=1e-6)


def pulsed(load_N, hung_on_m):
    """A log of three pulses under a weight that was hung on the cold wire, which is ``hung_on_m`` long until it has
    been heated."""
    time_s = np.arange(0.0, 70.0, 0.05)
    driven = (time_s % 20.0 > 10.0) & (time_s < 60.0)
    contracted = np.where(driven, 1.0 - np.exp(-((time_s - 10.0) % 20.0)), np.exp(-(time_s % 20.0)))
    contracted[time_s < 10.02] = 0.0
    cold_m = np.where(time_s < 10.02, hung_on_m, 1e-3 + 2e-3 * load_N)
    displacement_m = cold_m + contracted * (5e-4 - cold_m)
    return pulsed_log(time_s, driven, displacement_m, load_N)


def test_a_cold_wire_that_was_not_heated_yet_under_its_load_is_not_its_cold_end():
    """A second round had one such rest at a load: the cold end lay 26 % of the stroke inside it, and what was longer
    was held to be out of reach."""
    rest = learn([pulsed(load_N, hung_on_m) for load_N, hung_on_m in ((0.5, 3e-3), (1.0, 1.5e-3))], 1.0)
    assert rest.cold_displacement == pytest.approx((2e-3, 3e-3), abs=2e-5)
    assert rest.displacement_scatter < 2e-5


def held(load_N, *parts):
    """A wire with a current [A] after the other, and what it is contracted by with each."""
    log, time_s = [], np.arange(0.0, 10.0, 0.05)
    begins = 0.0
    for current_A, share in parts:
        ends = np.full(len(time_s), share)
        contracted = ends + (begins - share) * np.exp(-time_s)
        log.append(np.column_stack((np.full(len(time_s), current_A), contracted)))
        begins = contracted[-1]
    current_A, contracted = np.concatenate(log).T
    found = pulsed_log(0.05 * np.arange(len(current_A)), current_A > 0.2, (1.0 - contracted) * 3e-3, load_N)
    power_W = current_A**2 * found.signals.resistance_Ohm
    return replace(found, signals=replace(found.signals, current_A=current_A, power_W=power_W))


def test_a_wire_that_is_held_between_its_ends_is_at_neither_but_shows_how_far_off_they_may_be():
    """Held currents are a part of every characterisation; with them the resistance of a contracted wire was known to
    0.03 to 0.06 ohms of 1.6 where it repeats to 0.001, and so of no sensor, lead or contact whether it was that."""
    logs = [
        held(load_N, *parts)
        for load_N in (0.5, 1.0)
        for parts in (
            ((0.05, 0.0), (0.3, 1.0), (0.05, 0.0), (0.3, 1.0), (0.28, 1.0 - 0.2 * load_N), (0.05, 0.0)),
            ((0.3, 1.0), (0.1, 0.1), (0.3, 1.0), (0.1, 0.1)),  # a stretch of one that saw no less
        )
    ]
    rest = learn(logs, 1.0)
    assert rest.hot_displacement == pytest.approx((0.0, 0.0), abs=1e-6)
    assert rest.cold_displacement == pytest.approx((3e-3, 3e-3), abs=1e-6)
    assert rest.displacement_scatter < 2e-6 and rest.resistance_scatter < 5e-4
    assert rest.cold_power == pytest.approx(0.05**2 * 5.6, rel=1e-3)
    less_W = 0.3**2 * 5.0 - 0.28**2 * (5.0 + 200.0 * np.array((0.3e-3, 0.6e-3)))
    np.testing.assert_allclose(rest.hot_longer, np.array((0.3e-3, 0.6e-3)) / less_W, rtol=1e-3)


def test_the_power_of_the_hot_end_is_that_at_which_its_resistance_was_seen():
    """Where a guard takes the current back most rests are less hot than those that are the end; by their power the same
    wire, held with as little, had nine milliohms less than it should, three standard deviations at every rest."""
    log = held(1.0, *((0.05, 0.0), (0.3, 1.0), (0.05, 0.0), (0.3, 1.0)), *((0.05, 0.0), (0.28, 1.0)) * 4)
    rest = learn([log], 1.0)
    assert rest.hot_power == pytest.approx(0.3**2 * 5.0, rel=1e-3)


def test_a_wire_that_is_held_with_less_power_may_be_as_much_longer_as_it_was_at_the_calibration():
    seen = replace(CALIBRATION.rest, hot_longer=(1e-4, 2e-3, 6e-3), cold_power=0.005)
    known = replace(USUAL, calibration=replace(CALIBRATION, rest=seen))
    longer = replace(HOT, displacement_m=1.2e-4 + 1e-4, heat_W=0.25)
    assert off(longer)[1] > 3.0 > 1.0 > off(longer, known)[1] > 0.0
    assert off(replace(longer, stress_Pa=2e7, displacement_m=2e-4), known)[1] > 2.5
    as_hot = replace(longer, heat_W=0.3)
    assert off(as_hot, known)[1] == off(as_hot)[1]


def test_a_cold_wire_that_is_held_with_more_power_is_known_as_one_in_warmer_surroundings():
    known = replace(USUAL, calibration=replace(CALIBRATION, rest=replace(CALIBRATION.rest, cold_power=0.005)))
    warmer = replace(COLD, resistance_Ohm=2.13)
    np.testing.assert_allclose(off(replace(warmer, heat_W=0.055), known), off(replace(warmer, warmer_K=10.0), known))
    assert abs(off(replace(warmer, heat_W=0.055), known)[0]) < abs(off(warmer, known)[0]) == abs(off(warmer)[0])
