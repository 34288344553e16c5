"""What a pair does at its bounds, before its first step, and where a wire has no loop any more."""

import math

import pytest
from test_pair import Rig

from sma_actuator.base.signals import Mode
from sma_actuator.cli.remote.move import beyond_words
from sma_actuator.driver import OFF_MEANWHILE
from sma_actuator.pair import PairDriver


class Held:
    """A wire as its node shows it: its loop may be given up and opened again."""

    def __init__(self, wire):
        self.wire, self.driver, self.asked = wire, wire.driver, []

    def switch_on(self, wanted):
        self.asked.append(True)
        return self.wire.switch_on(wanted)

    def switch_off(self):
        self.asked.append(False)
        return self.wire.switch_off()


class HeldRig(Rig):
    """The same joint, driven through such wires; ``said`` is what came of each step."""

    def __init__(self, **changes):
        super().__init__(**changes)
        self.wires, self.said = [Held(wire) for wire in self.pair.wires], self.pair.outputs
        self.joint = PairDriver(self.parameters, self.configs, self.wires, self.said.append)
        self.pair.take_output = self.joint.take_output

    def run(self, seconds):
        super().run(seconds)
        return self.said[-1]

    def switch_on(self):
        done, words = self.joint.switch_on()
        assert done, words
        return self.run(6.0)


@pytest.fixture
def held():
    rig = HeldRig()
    rig.run(0.5)
    return rig


def test_one_word_comes_of_each_step_of_the_first_wire_and_none_of_the_other(held):
    first, second = (wire.driver for wire in held.wires)
    for driver, more in ((first, 1), (second, 0), (second, 0), (first, 1)):
        before = len(held.said)
        driver.tick()
        assert len(held.said) - before == more


def test_a_whole_turn_may_be_asked_for_and_no_more(held):
    held.switch_on()
    assert held.joint.follow([1.0], [math.tau]) == held.joint.follow([1.0], [-math.tau]) == ""
    refused = held.joint.follow([1.0], [math.nextafter(math.tau, 7.0)])
    assert "an angle of it is more than a whole turn" in refused


def test_an_angle_that_stands_is_asked_for_in_the_very_next_step(held):
    held.switch_on()
    assert held.joint.go_to(0.05) == ""
    held.wires[0].driver.tick()
    assert held.said[-1].status.values["asked_angle_rad"] == 0.05
    assert held.said[-1].status.mode is Mode.TRACKING


def test_who_asks_for_on_again_is_told_that_it_is(held):
    held.switch_on()
    assert held.joint.switch_on() == (True, "the joint is on already")


def test_a_joint_that_is_wanted_off_when_both_wires_are_on_does_not_move(held):
    """Who asks wires for off meanwhile has been told that they are; the joint leaves them alone."""
    wanted = lambda: not all(wire.asked for wire in held.wires)  # noqa: E731
    second_on = held.wires[1].switch_on
    held.wires[1].switch_on = lambda _: second_on(lambda: True)  # was wanted when its turn had come
    assert held.joint.switch_on(wanted) == (False, OFF_MEANWHILE)
    assert not held.joint.is_driven and "the joint is off" in held.joint.command(0.1)


@pytest.mark.parametrize("many", [1, 3])
def test_a_joint_of_other_than_two_wires_is_neither_switched_on_nor_off(many):
    rig = HeldRig()
    rig.run(0.5)
    joint = PairDriver(rig.parameters, rig.configs, (rig.wires * 2)[:many])
    for ask in (joint.switch_on, joint.switch_off):
        with pytest.raises(ValueError, match=r"zip\(\)"):
            ask()


def test_a_fault_of_a_wire_without_a_loop_is_not_cleared_and_stands(held):
    held.switch_on()
    held.stand.benches[0].inject("open_wire")
    held.run(1.0)
    assert held.said[-1].status.fault == "open_wire"
    held.wires[1].driver = None
    done, words = held.joint.clear_fault()
    assert not done and words.endswith("right: it has no loop")
    held.wires[0].driver.tick()
    assert held.said[-1].status.fault == "open_wire"


def test_what_is_cleared_of_both_wires_is_gone_in_the_next_step(held):
    held.switch_on()
    held.stand.benches[0].inject("open_wire")
    held.run(1.0)
    held.stand.benches[0].clear()
    held.run(1.0)
    assert held.said[-1].status.fault == "open_wire"
    done, words = held.joint.clear_fault()
    assert done, words
    assert held.joint._status(held.said[-1].estimate).message == "off"


def test_a_loop_that_is_given_up_takes_nothing_and_the_other_wire_goes_on(held):
    held.switch_on()
    held.wires[1].driver = None
    assert held.run(0.5).status.fault == ""
    assert held.joint.is_driven


def test_where_the_first_wire_comes_back_before_the_other_has_a_loop_the_fault_stands_until_it_has(held):
    held.switch_on()
    held.stand.benches[0].inject("daq_hangup")
    held.run(1.0)
    assert held.said[-1].status.fault == "daq_lost"
    held.stand.benches[0].clear()
    other, held.wires[1].driver = held.wires[1].driver, None
    assert held.run(3.0).status.fault == "daq_lost"
    held.wires[1].driver = other
    assert held.run(0.5).status.fault == ""


def test_while_nothing_is_known_of_the_wires_no_setpoint_is_offered_to_them(held):
    held.joint.switch_on()
    held.run(3.0)
    assert [list(wire.driver.refusals()) for wire in held.wires] == [[], []]


def moving(rig):
    """On the way to an angle, whose commander nobody misses."""
    rig.switch_on()
    assert rig.joint.go_to(rig.said[-1].reference_rad + 0.2) == ""
    said = rig.run(1.0)
    assert said.status.mode is Mode.TRACKING
    return said


def test_a_motion_that_is_cancelled_ends_at_its_reference_also_where_no_silence_is_a_loss():
    rig = HeldRig(joint_command_timeout=0.0, angle_rate_limit=0.1)
    rig.run(0.5)
    reference_rad = moving(rig).reference_rad
    assert rig.joint.follow([], []) == ""
    said = rig.run(3.0)
    assert said.reference_rad == said.status.values["asked_angle_rad"] == reference_rad
    assert said.status.mode is Mode.HOLD


def test_a_motion_that_is_held_ends_where_the_joint_is_measured_to_be():
    rig = HeldRig(joint_command_timeout=0.0, angle_rate_limit=0.1)
    rig.run(0.5)
    moving(rig)
    rig.joint.hold()
    rig.wires[0].driver.tick()
    said = rig.said[-1]
    assert said.status.values["asked_angle_rad"] == said.estimate.angle_rad and said.status.mode is Mode.HOLD
    after = rig.run(2.0)
    assert after.status.values["asked_angle_rad"] == said.estimate.angle_rad, "and the way is forgotten"
    assert after.status.mode is Mode.HOLD


def test_of_an_angle_that_is_out_of_reach_the_status_says_where_the_joint_can_be_held():
    """As `move` does."""
    rig = HeldRig(joint_command_timeout=0.0, angle_rate_limit=0.5)
    rig.run(0.5)
    rig.switch_on()
    assert rig.joint.command(3.0) == ""
    status = rig.run(1.0).status
    low_rad, high_rad = status.values["lowest_rad"], status.values["highest_rad"]
    assert "angle_range" in status.limits
    assert low_rad < status.values["angle_rad"] < high_rad < 3.0
    assert f"3.000 rad is beyond where the joint can be held, {low_rad:.3f} to" in beyond_words(3.0, status)
    assert f"it is held at {high_rad:.3f} rad" in beyond_words(3.0, status)
    assert not beyond_words(0.5 * (low_rad + high_rad), status)


def test_who_switches_the_joint_on_again_finds_nothing_asked_for():
    rig = HeldRig(joint_command_timeout=0.0, angle_rate_limit=0.5)
    rig.run(0.5)
    rig.switch_on()
    assert rig.joint.command(0.15, 1.1) == ""
    asked = rig.run(2.0).status.values
    assert (asked["asked_angle_rad"], asked["asked_cocontraction_N"]) == (0.15, 1.1)
    rig.joint.switch_off()
    rig.run(1.0)
    said = rig.switch_on()
    assert said.status.values["asked_angle_rad"] != 0.15 and said.status.mode is Mode.HOLD
    assert said.status.values["asked_cocontraction_N"] == rig.parameters.cocontraction
