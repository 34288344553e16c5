"""Two wires on one joint: where they balance, and that each is the wire it is alone."""

import math

import pytest

from sma_actuator.bench.bench import Setup, VirtualBench
from sma_actuator.bench.joint import JointBench
from sma_actuator.plant.joint import Joint, parse_joint
from sma_actuator.plant.worlds import wire_in_world

JOINT = Joint(radius_m=0.004, at_zero_m=(0.0019, 0.0019))


def driven(joint, *currents_A, seed=1):
    """A joint with its supplies on at these currents."""
    stand = JointBench.from_name("flexinol", joint, seed=seed)
    for bench, current_A in zip(stand.benches, currents_A, strict=True):
        bench.supply.set_voltage(6.0)
        bench.supply.set_output(True)
        bench.supply.set_current(current_A)
    return stand


def test_cold_wires_are_slack_and_the_joint_stays_where_it_is():
    stand = driven(JOINT, 0.0, 0.0)
    stand.advance(5.0)
    assert stand.angle_rad == 0.0
    assert all(bench.truth.load_N == 0.0 for bench in stand.benches)


@pytest.mark.parametrize("torque_Nm", (0.0, 0.002, -0.002))
def test_at_rest_moments_balance_and_the_lengths_are_those_of_the_pulley(torque_Nm):
    stand = driven(JOINT, 0.23, 0.2)
    stand.torque_Nm = torque_Nm
    stand.advance(60.0)
    first, second = (bench.truth for bench in stand.benches)
    assert 0.004 * (first.load_N - second.load_N) + torque_Nm == pytest.approx(0.0, abs=2e-6)
    for truth, sign in ((first, 1.0), (second, -1.0)):
        if truth.load_N > 0.0:
            place_m = 0.0019 - sign * 0.004 * stand.angle_rad - truth.load_N / JOINT.stiffness_N_m
            assert truth.displacement_m == pytest.approx(place_m, abs=1e-7)
    assert max(first.load_N, second.load_N) > 0.1


def test_the_wire_that_contracts_turns_the_joint_its_way():
    angles_rad = []
    for currents_A in ((0.28, 0.1), (0.1, 0.28)):
        stand = driven(JOINT, *currents_A)
        stand.advance(30.0)
        angles_rad.append(stand.angle_rad)
    assert angles_rad[0] > 0.3 and angles_rad[1] == pytest.approx(-angles_rad[0], abs=1e-6)


def test_a_joint_that_is_held_fast_by_its_damping_is_a_spring_to_each_wire():
    """The same wire, alone on a spring with its far end where the joint has it.  At rest: on the way a joint's load is
    half a step late."""
    stand = driven(Joint(radius_m=0.004, at_zero_m=(0.0019, 0.0019), stiffness_N_m=300.0, damping_Nms=1e9), 0.25, 0.1)
    alone = VirtualBench(Setup(wire_in_world("flexinol"), load=stand.joint.load(0)), seed=1)
    alone.supply.set_voltage(6.0)
    alone.supply.set_output(True)
    alone.supply.set_current(0.25)
    stand.advance(60.0)
    alone.advance(60.0)
    assert alone.truth.load_N > 0.1
    assert stand.benches[0].truth.load_N == pytest.approx(alone.truth.load_N, rel=1e-6)
    assert stand.benches[0].truth.displacement_m == pytest.approx(alone.truth.displacement_m, rel=1e-6)


def test_time_is_one_whichever_bench_is_advanced_and_the_past_does_not_change_the_numbers():
    in_one = driven(JOINT, 0.25, 0.2)
    in_one.advance(4.0)
    in_turns = driven(JOINT, 0.25, 0.2)
    for number in range(400):
        in_turns.benches[number % 2].advance(0.01 * (number + 1))
    assert in_turns.benches[0].samples == in_turns.benches[1].samples == 4000
    assert in_turns.angle_rad == in_one.angle_rad
    assert [b.truth for b in in_turns.benches] == [b.truth for b in in_one.benches]


def test_the_watchdog_of_either_supply_cuts_at_its_own_time():
    stand = driven(JOINT, 0.2, 0.2)
    silent = stand.benches[1].supply
    silent.set_watchdog_delay(0.5)
    silent.watchdog_on = True
    silent.heard(0.0)
    stand.benches[0].advance(2.0)
    assert not silent.output_on and stand.benches[0].supply.output_on


def test_joints_in_words():
    assert parse_joint("0.004,0.0019") == JOINT
    assert parse_joint("0.004,0.0019,0.002").at_zero_m == (0.0019, 0.002)
    for text in ("", "0.004", "a,b", "0,0.0019", "1,2,3,4"):
        with pytest.raises(ValueError, match="is no joint"):
            parse_joint(text)
    assert math.isfinite(JOINT.load(1).preload_displacement_m)
