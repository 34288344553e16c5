"""The law of a pair: its geometry against closed forms, and the bound of the tension whatever is asked for."""

import math
from dataclasses import replace

import hypothesis.strategies as st
import pytest
from hypothesis import assume, example, given

from sma_actuator.base.parameters import ConfigError
from sma_actuator.control.pair import Pair, PairParameters, WireState

RANGE_m = (0.33e-3, 3.35e-3)
JOINT = {
    "wires": ["left", "right"],
    "pulley_radius": 0.004,
    "displacement_at_zero": [0.0019, 0.0017],
    "series_stiffness": 2e4,
    "tension_limit": 2.2,
    "cocontraction": 0.8,
    "least_cocontraction": 0.3,
}
angles = st.floats(-0.3, 0.3)
tensions = st.floats(0.06, 2.0)
anything = st.one_of(st.floats(), st.sampled_from([math.nan, math.inf, -math.inf, 1e308]))


def pair_of(**changes):
    return Pair(PairParameters.from_mapping({**JOINT, **changes}), (RANGE_m, RANGE_m))


def taut(pair, angle_rad, tensions_N, uncertainties_m=(1e-4, 1e-4)):
    places_m = pair.displacements_m(angle_rad, tensions_N)
    return [WireState(*each) for each in zip(places_m, uncertainties_m, tensions_N, strict=True)]


def test_the_displacements_are_those_of_a_pulley_with_springs_in_series():
    first_m, second_m = pair_of().displacements_m(0.1, (1.0, 0.6))
    assert first_m == pytest.approx(0.0019 - 0.4e-3 - 1.0 / 2e4)
    assert second_m == pytest.approx(0.0017 + 0.4e-3 - 0.6 / 2e4)
    assert pair_of(series_stiffness=0.0).displacements_m(0.1, (1.0, 0.6)) == pytest.approx((0.0015, 0.0021))


@given(angle_rad=angles, first_N=tensions, second_N=tensions)
def test_what_both_wires_show_is_where_they_were_put(angle_rad, first_N, second_N):
    pair = pair_of()
    seen = pair.see(taut(pair, angle_rad, (first_N, second_N)))
    assert seen.angle_rad == pytest.approx(angle_rad, abs=1e-12)
    assert seen.uncertainty_rad == pytest.approx(1e-4 / 0.004)
    assert seen.cocontraction_N == min(first_N, second_N)
    assert seen.torque_Nm == pytest.approx(0.004 * (first_N - second_N))


@given(common_m=st.floats(-3e-4, 3e-4))
def test_what_both_wires_have_from_one_model_leaves_the_angle_alone(common_m):
    pair = pair_of()
    wires = taut(pair, 0.1, (1.0, 1.0))
    seen = pair.see([replace(wire, displacement_m=wire.displacement_m + common_m) for wire in wires])
    assert seen.angle_rad == pytest.approx(0.1, abs=1e-12)


def test_what_they_contradict_each_other_by_is_uncertain_beside_what_their_calibration_leaves():
    pair = pair_of()
    first, second = taut(pair, 0.1, (1.0, 1.0), uncertainties_m=(1e-4, 2e-4))
    wrong = replace(second, displacement_m=second.displacement_m + 0.4e-3)  # 0.1 rad further
    seen = pair.see((first, wrong))
    assert seen.angle_rad == pytest.approx(0.15)
    assert seen.uncertainty_rad == pytest.approx(math.hypot(0.1, 1.5e-4 / 0.004))


def test_the_velocity_is_that_of_the_pulley():
    pair = pair_of()
    first, second = taut(pair, 0.1, (1.0, 1.0))
    turning = [replace(first, velocity_m_s=-0.4e-3), replace(second, velocity_m_s=0.4e-3)]
    assert pair.see(turning).velocity_rad_s == pytest.approx(0.1)


def test_a_slack_wire_says_nothing_and_two_say_that_nobody_knows():
    pair = pair_of()
    first, _ = taut(pair, 0.1, (1.0, 0.0))
    assert pair.see((first, WireState(0.004, 1e-4, 0.0))).angle_rad == pytest.approx(0.1)
    assert math.isnan(pair.see((WireState(0.004, 1e-4, 0.0), WireState(0.004, 1e-4, 0.01))).angle_rad)


def test_the_range_of_angles_is_where_both_wires_are_in_theirs():
    pair = pair_of()
    low_rad, high_rad = pair.range_rad(1.0)
    given_m = 1.0 / 2e4
    assert high_rad == pytest.approx(min(0.0019 - given_m - 0.33e-3, 3.35e-3 - 0.0017 + given_m) / 0.004)
    assert low_rad == pytest.approx(-min(3.35e-3 - 0.0019 + given_m, 0.0017 - given_m - 0.33e-3) / 0.004)


def test_where_it_should_be_with_the_tension_that_is_asked_for_nothing_is_asked_for_but_that():
    pair = pair_of()
    pair.command(0.1, 0.8)
    wires = taut(pair, 0.1, (0.8, 0.8))
    for _ in range(50):
        setpoints_m = pair.step(wires, 0.05)
    assert setpoints_m == pytest.approx([wire.displacement_m for wire in wires], abs=1e-12)
    assert pair.limits == ()


def test_too_little_tension_shortens_both_wires_alike_and_too_much_lengthens_them():
    for tension_N, sign in ((0.5, -1.0), (1.1, 1.0)):
        pair = pair_of()
        wires = taut(pair, 0.0, (tension_N, tension_N))
        moved_m = [s - w.displacement_m for s, w in zip(pair.step(wires, 0.05), wires, strict=True)]
        assert moved_m[0] == pytest.approx(moved_m[1])
        assert moved_m[0] * sign == pytest.approx(5e-4 * 0.3, rel=0.05)


@given(asked_N=st.floats(0.0, 1e4), torque_Nm=st.floats(-0.05, 0.05))
def test_the_co_contraction_and_the_worlds_torque_share_the_limit(asked_N, torque_Nm):
    pair = pair_of()
    assert pair.command(0.0, asked_N) == ""
    shared_N = pair.shared_N(torque_Nm)
    assert shared_N >= 0.0
    assert shared_N + abs(torque_Nm) / 0.004 <= 0.9 * 2.2 + 1e-9 or shared_N == 0.0
    assert shared_N <= max(asked_N, 0.3)


@given(
    asked_rad=anything,
    asked_N=anything,
    angle_rad=angles,
    first_N=st.floats(0.0, 4.0),
    second_N=st.floats(0.0, 4.0),
    steps=st.integers(1, 5),
    dt_s=st.sampled_from([0.0, 0.01, 0.05, 10.0]),
)
@example(asked_rad=0.0, asked_N=0.0, angle_rad=0.0, first_N=0.0, second_N=2.2, steps=1, dt_s=0.0)
def test_whatever_is_asked_for_a_wire_at_the_limit_of_its_tension_is_asked_to_be_longer(
    asked_rad, asked_N, angle_rad, first_N, second_N, steps, dt_s
):
    pair = pair_of()
    wires = taut(pair, angle_rad, (first_N, second_N))
    refusal = pair.command(asked_rad, asked_N)
    refused = math.isinf(asked_rad) or math.isinf(asked_N) or asked_N < 0.0
    assert bool(refusal) == refused
    for _ in range(steps):
        setpoints_m = pair.step(wires, dt_s)
    assert all(math.isfinite(setpoint_m) for setpoint_m in setpoints_m)
    assume(max(first_N, second_N) >= 2.2)
    for wire, setpoint_m in zip(wires, setpoints_m, strict=True):
        assert setpoint_m > wire.displacement_m


@given(asked_rad=st.floats(-10.0, 10.0), angle_rad=angles, tension_N=tensions)
def test_no_step_of_the_angle_asks_for_more_pull_than_the_limit_leaves(asked_rad, angle_rad, tension_N):
    pair = pair_of()
    pair.command(asked_rad)
    wires = taut(pair, angle_rad, (tension_N, tension_N))
    for _ in range(100):
        pair.step(wires, 0.05)
    lead_m = 0.004 * abs(pair.reference_rad - angle_rad)
    assert lead_m <= pair.parameters.tension_gain * (2.2 - max(tension_N, 0.8)) + 1e-12


def test_nothing_is_asked_for_where_a_reading_is_missing():
    pair = pair_of()
    first, second = taut(pair, 0.0, (0.8, 0.8))
    assert all(map(math.isnan, pair.step((first, WireState(math.nan, math.nan, second.load_N)), 0.05)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"wires": ["left"]}, "wires: [left]; the names of the nodes of two wires are wanted"),
        ({"wires": ["left", "left"]}, "wires: [left, left]; the names of the nodes of two wires are wanted"),
        ({"displacement_at_zero": [0.002]}, "displacement_at_zero: 1 are given; one for each wire is wanted"),
        ({"cocontraction": 0.1}, "cocontraction: 0.1 N is not between least_cocontraction, 0.3 N, and tension_limit"),
        ({"pulley_radius": 4.0}, "metres are wanted: 4 mm is 0.004"),
        ({"radius": 0.004}, "radius: no such parameter"),
    ],
)
def test_parameters_that_cannot_be_are_refused_in_a_sentence(changes, words):
    with pytest.raises(ConfigError) as caught:
        PairParameters.from_mapping({**JOINT, **changes})
    assert words in str(caught.value)
