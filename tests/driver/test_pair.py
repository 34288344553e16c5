"""Two wires on one joint of the virtual bench, each with its driver, in the bench's own time."""

import copy
import math

import pytest

from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode
from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.bench.joint import JointBench
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.control.pair import PairParameters
from sma_actuator.pair import PairDriver, SteppedPair
from sma_actuator.pair.fit import mismatches
from sma_actuator.plant.joint import Joint
from sma_actuator.safety.faults import FAULTS

FILE = shared_file("config/pair.yaml")
NAMES = ("left", "right")


class Rig:
    """A joint of the bench, its pair, and what both wires have put out."""

    def __init__(self, rates=(20.0, 20.0), **changes):
        parameters = {**read_parameter_file(FILE, "joint"), "joint_command_timeout": 0.0, **changes}
        self.parameters = PairParameters.from_mapping(parameters)
        self.configs = [
            Config.load(FILE, name).replace({"loop.rate": rate}) for name, rate in zip(NAMES, rates, strict=True)
        ]
        at_zero_m = self.parameters.displacement_at_zero
        joint = Joint(self.parameters.pulley_radius, at_zero_m, self.parameters.series_stiffness)
        self.stand = JointBench.from_name("flexinol", joint, seed=1)
        benches, configs = self.stand.benches, self.configs
        self.instruments = [(InProcessSupply(b, c), InProcessDaq(b, c)) for b, c in zip(benches, configs, strict=True)]
        self.pair = SteppedPair(self.parameters, configs, self.instruments, VirtualClock(benches[0]))
        self.highest_N = 0.0

    def run(self, seconds):
        end_s = self.stand.benches[0].time_s + seconds
        while self.stand.benches[0].time_s < end_s - 1e-9:
            self.output = self.pair.run_for(0.05)
            self.highest_N = max(self.highest_N, *self.tensions_N)
        return self.output

    @property
    def tensions_N(self):
        return [bench.truth.load_N for bench in self.stand.benches]

    @property
    def on(self):
        return [bench.supply.output_on for bench in self.stand.benches]

    def status(self, number):
        return self.pair.wires[number].driver.call(
            lambda actuator, _: actuator._output({}, set(), math.nan, None).status
        )

    def switch_on(self):
        done, words = self.pair.switch_on()
        assert done, words
        self.run(6.0)
        assert self.output.status.fault == "", self.output.status.message


@pytest.fixture
def rig():
    rig = Rig()
    rig.run(0.5)
    assert rig.output.status.mode is Mode.OFF and rig.output.estimate.angle_rad != rig.output.estimate.angle_rad
    rig.switch_on()
    return rig


def test_the_slack_is_taken_up_and_the_joint_held_where_it_is(rig):
    assert rig.output.status.mode is Mode.HOLD and rig.output.status.message.startswith("holding")
    rig.run(8.0)
    assert rig.tensions_N == pytest.approx([0.8, 0.8], abs=0.1)
    seen = rig.output.estimate
    assert seen.angle_rad == pytest.approx(rig.output.reference_rad, abs=0.02)
    assert abs(rig.stand.angle_rad - seen.angle_rad) <= seen.uncertainty_rad
    assert rig.highest_N < rig.parameters.tension_limit


def test_angle_and_co_contraction_are_reached_and_no_tension_comes_to_its_limit(rig):
    for angle_rad, tension_N in ((0.25, 0.8), (-0.25, 1.4), (0.1, 0.4)):
        assert rig.pair.command(angle_rad, tension_N) == ""
        rig.run(15.0)
        seen = rig.output.estimate
        assert rig.output.status.mode is Mode.TRACKING
        assert seen.angle_rad == pytest.approx(angle_rad, abs=0.02)
        assert rig.stand.angle_rad == pytest.approx(angle_rad, abs=0.07)  # what the model of the wires leaves, and more
        assert abs(rig.stand.angle_rad - seen.angle_rad) <= 1.5 * seen.uncertainty_rad
        assert min(rig.tensions_N) == pytest.approx(tension_N, abs=0.1)
    assert rig.highest_N < rig.parameters.tension_limit


def test_no_load_of_a_joint_that_swings_is_called_dead(rig):
    """Each wire pulls at the other, and in quick partial cycles its own model is a tenth of the stroke off."""
    began_s = rig.stand.benches[0].time_s
    while (time_s := rig.stand.benches[0].time_s - began_s) < 60.0:
        rig.pair.command(0.25 * math.sin(2.0 * math.pi * time_s / 15.0), (0.4, 1.3)[int(time_s / 3.0) % 2])
        status = rig.run(0.05).status
        assert status.fault in ("", "position_contradicted"), status.message


def test_the_tensions_balance_at_every_step_where_a_wire_transforms(rig):
    """But for what turns the pulley: 0.25 N at 1 rad/s."""
    for angle_rad in (0.25, -0.25):
        for _ in range(400):
            rig.pair.command(angle_rad, 1.5)
            rig.run(0.05)
            first_N, second_N = rig.tensions_N
            assert abs(first_N - second_N) < 0.5


def test_a_commander_that_falls_silent_is_lost_and_the_joint_held_where_it_is():
    rig = Rig(joint_command_timeout=0.5, angle_rate_limit=0.1)
    rig.run(0.5)
    rig.switch_on()
    for _ in range(5):
        assert rig.pair.command(0.25) == ""
        assert rig.run(0.1).status.mode is Mode.TRACKING
    there_rad = rig.run(0.6).estimate.angle_rad
    status = rig.output.status
    assert (status.mode, status.fault) == (Mode.HOLD, "setpoint_stale")
    assert "joint_command_timeout is 0.5 s" in status.message
    assert rig.run(5.0).estimate.angle_rad == pytest.approx(there_rad, abs=0.05)
    assert rig.output.reference_rad < 0.2, "it was to be held on its way"
    assert rig.pair.command(math.nan, math.nan) == "" and rig.run(0.1).status.fault, "NaN is no command"
    assert rig.pair.command(0.25) == ""
    assert (rig.run(0.1).status.mode, rig.output.status.fault) == (Mode.TRACKING, "")


def test_a_trajectory_of_angles_is_waited_for_followed_and_its_last_angle_stands():
    rig = Rig(joint_command_timeout=0.5, angle_rate_limit=2.0)
    assert rig.pair.follow([1.0], [0.1]) == "trajectory refused: the joint is off; call ~/enable first"
    rig.run(0.5)
    rig.switch_on()
    assert rig.pair.follow([1.0, 3.0], [0.05, 0.15], delay_s=2.0) == ""
    assert "holding (a trajectory begins in 2 s" in rig.run(0.2).status.message
    assert rig.run(1.7).status.mode is Mode.HOLD, "it was to begin later"
    began_s = rig.output.time_s + 0.1  # a period after it was handed over the two seconds began
    status = rig.run(2.1).status
    between_rad = 0.05 + 0.05 * (rig.output.time_s - began_s - 1.0)
    assert status.values["asked_angle_rad"] == pytest.approx(between_rad, abs=0.006)
    assert rig.run(3.0).status.values["asked_angle_rad"] == 0.15
    assert (rig.output.status.mode, rig.output.status.fault) == (Mode.TRACKING, ""), "nobody was to be missed"
    assert rig.run(6.0).estimate.angle_rad == pytest.approx(0.15, abs=0.03)

    begins_s = rig.output.time_s + 0.05
    assert rig.pair.follow([4.0], [-0.2]) == "", "it is led in from where the joint is"
    led_rad = 0.15 - 0.35 / 4.0 * (rig.run(1.0).time_s - begins_s)
    assert rig.output.status.values["asked_angle_rad"] == pytest.approx(led_rad, abs=0.006)
    assert rig.run(3.2).status.values["asked_angle_rad"] == -0.2
    assert rig.pair.command(math.nan, 0.9) == ""  # how hard is no word on where
    assert rig.run(0.7).status.fault == "" and rig.output.status.values["asked_angle_rad"] == -0.2
    assert rig.pair.command(0.1) == "" and rig.run(0.1).status.values["asked_angle_rad"] == 0.1
    assert rig.run(1.0).status.fault == "setpoint_stale", "a command after it is one of a stream"
    assert rig.pair.follow([4.0], [-0.2]) == "" and rig.run(0.1).status.mode is Mode.TRACKING
    assert rig.pair.follow([], []) == "" and rig.run(0.1).status.mode is Mode.HOLD
    rig.pair.follow([4.0], [-0.2], delay_s=1.0)
    assert rig.pair.switch_off()[0]
    rig.switch_on()
    assert rig.output.status.mode is Mode.HOLD, "it was for the time before"


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (([1.0], [15.0]), "more than a whole turn, or none; radians are wanted"),
        (([1.0], [math.nan]), "more than a whole turn, or none; radians are wanted"),
        (([2.0, 1.0], [0.1, 0.2]), "is not after that of point 0"),
        (([1.0], [0.1], None, -5.0), "its last point was due 4 s ago"),
    ],
)
def test_a_trajectory_that_cannot_be_followed_is_refused_and_nothing_moves(rig, points, words):
    assert words in rig.pair.follow(*points)
    assert rig.run(0.1).status.mode is Mode.HOLD


def test_the_worlds_torque_is_held_against_and_shares_the_limit(rig):
    rig.pair.command(0.0, 2.0)
    rig.stand.torque_Nm = 0.004  # a newton at the pulley
    rig.run(20.0)
    assert rig.output.estimate.torque_Nm == pytest.approx(-0.004, abs=5e-4)
    assert min(rig.tensions_N) == pytest.approx(0.9 * 2.2 - 1.0, abs=0.1)
    assert rig.highest_N < rig.parameters.tension_limit
    assert "cocontraction" in rig.output.status.limits
    assert abs(rig.stand.angle_rad) < 0.07


@pytest.mark.parametrize("number", (0, 1))
@pytest.mark.parametrize("cause", ("open_wire", "daq_hangup", "node_lost"))
def test_a_fault_of_one_wire_switches_both_off_within_a_period(rig, number, cause):
    other = 1 - number
    if cause == "node_lost":
        rig.pair.wires[number].driver.call(lambda actuator, now_s: actuator.raise_fault(now_s, cause, "provoked"))
    else:
        rig.stand.benches[number].inject(cause)
    bench, steps = rig.stand.benches[0], 0
    while rig.on[number]:
        assert (steps := steps + 1) < 100
        rig.pair.run_for(0.05)
    off_s = bench.time_s
    while rig.on[other]:
        rig.pair.run_for(0.05)
        assert bench.time_s - off_s <= FAULTS["partner_off"].within(rig.configs[other]) + 1e-9
    rig.run(0.1)
    fault, partner = rig.status(number), rig.status(other)
    assert fault.fault == {"open_wire": "open_wire", "daq_hangup": "daq_lost", "node_lost": "node_lost"}[cause]
    assert partner.fault == "partner_off" and f"{NAMES[number]}: off: {FAULTS[fault.fault].words}" in partner.message
    joint = rig.output.status
    assert joint.mode is Mode.OFF and joint.fault == fault.fault
    assert joint.message.startswith(f"off: {NAMES[number]}: off: {FAULTS[fault.fault].words}")
    assert "joint is off" in rig.pair.command(0.1)
    refused, words = rig.pair.switch_on()
    asked_again = FAULTS[fault.fault].until_back and number == 0  # else the other says it, which did not lose anything
    assert not refused and ("ask again once it answers" if asked_again else "clear_fault") in words and not any(rig.on)
    rig.stand.benches[number].clear()
    rig.run(1.0)
    done, words = rig.pair.clear_fault()
    assert done, words
    rig.switch_on()


@pytest.mark.parametrize("number", (0, 1))
def test_an_instrument_that_comes_back_leaves_the_joint_off_and_ready_without_a_person(rig, number):
    rig.stand.benches[number].inject("daq_hangup")
    while any(rig.on):
        rig.pair.run_for(0.05)
    assert "~/enable once it answers again" in rig.run(1.0).status.message
    assert rig.status(1 - number).fault == "partner_off", "it has not come back yet"
    rig.stand.benches[number].clear()
    rig.run(3.0)
    assert rig.status(0).fault == rig.status(1).fault == rig.output.status.fault == ""
    assert rig.on == [False, False] and rig.output.status.message == "off"
    rig.switch_on()


def test_what_is_cleared_of_one_wire_is_so_of_the_other(rig):
    rig.stand.benches[0].inject("open_wire")
    while any(rig.on):
        rig.pair.run_for(0.05)
    rig.stand.benches[0].clear()
    rig.run(3.0)
    assert rig.status(1).fault == "partner_off", "such a fault wants a person"
    assert rig.pair.wires[0].driver.clear_fault()[0]
    rig.run(0.5)
    assert rig.status(1).fault == rig.output.status.fault == ""


def test_a_setpoint_stands_and_a_motion_that_is_cancelled_ends_where_its_reference_has_come():
    rig = Rig(joint_command_timeout=0.5, angle_rate_limit=0.1)
    rig.run(0.5)
    assert "the joint is off" in rig.pair.go_to(0.2)
    rig.switch_on()
    began_rad = rig.output.reference_rad
    assert rig.pair.go_to(began_rad + 0.2) == ""
    assert rig.run(1.5).status.mode is Mode.TRACKING, "nobody is to be missed"
    reference_rad = rig.output.reference_rad
    assert began_rad + 0.05 < reference_rad < began_rad + 0.19, "it is on its way"
    assert rig.pair.follow([], []) == ""
    for _ in range(40):
        assert rig.run(0.05).reference_rad == pytest.approx(reference_rad, abs=0.1 * 0.05 + 1e-9), "no step"
    assert rig.output.status.mode is Mode.HOLD
    assert rig.run(5.0).estimate.angle_rad == pytest.approx(reference_rad, abs=0.02)


@pytest.mark.parametrize("number", (0, 1))
def test_a_wire_that_is_switched_off_by_hand_takes_the_other_with_it_without_a_fault(rig, number):
    assert rig.pair.wires[number].switch_off()[0]
    rig.run(0.1)
    assert rig.on == [False, False]
    assert rig.status(0).fault == rig.status(1).fault == rig.output.status.fault == ""
    rig.switch_on()


def test_the_joint_is_switched_off_by_hand(rig):
    assert rig.pair.switch_off() == (True, "left: the output is off; right: the output is off")
    assert rig.on == [False, False]
    rig.run(1.0)
    assert rig.output.status.mode is Mode.OFF and rig.output.status.message == "off"
    assert rig.status(0).fault == rig.status(1).fault == ""


def test_where_one_wire_cannot_be_switched_on_neither_is():
    rig = Rig()
    rig.run(0.5)
    rig.stand.benches[1].inject("channel_saturated", 103)
    rig.run(0.5)
    done, words = rig.pair.switch_on()
    assert not done and words.startswith("right: not enabled")
    rig.run(0.5)
    assert rig.on == [False, False]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"tension_limit": 3.1},
            "tension_limit: 3.1 N is above 2.87 N, where safety.stress_limit_fraction of the wire left",
        ),
        (
            {"least_cocontraction": 0.1},
            "least_cocontraction: 0.1 N is below 0.23 N, the least that the model of the wire",
        ),
        ({"displacement_at_zero": [0.0004, 0.1]}, "there is no angle at which both wires are in the working ranges"),
    ],
)
def test_wires_that_do_not_suit_the_joint_are_refused(changes, words):
    rig = Rig()
    with pytest.raises(ConfigError) as caught:
        PairDriver(rig.parameters.replace(changes), rig.configs, ())
    assert words in str(caught.value)


def test_the_shipped_file_is_the_shipped_wire_twice():
    wire = read_parameter_file(shared_file("config/flexinol.yaml"))
    for number, name in enumerate(NAMES):
        own = copy.deepcopy(wire) | {"joint_name": name}
        for instrument, port in (("supply", 5025), ("daq", 5026)):
            own["instruments"][instrument]["resource"] = f"TCPIP::127.0.0.1::{port + 2 * number}::SOCKET"
        assert read_parameter_file(FILE, name) == own, "run: python benchmarks/coefficients.py"


def test_what_the_wires_bear_and_were_identified_on_suits_the_joint_to_the_last_bit():
    configs = [Config.load(FILE, name) for name in NAMES]
    safety, wire, model = configs[0].safety, configs[0].wire, configs[0].model.build(configs[0].wire)
    most_N = safety.stress_limit_fraction * wire.max_stress * wire.area_m2
    least_N = model.stress_range_Pa[0] * wire.area_m2
    given = {**read_parameter_file(FILE, "joint"), "cocontraction": 1.2 * least_N}

    def found(tension_limit, least_cocontraction):
        changes = {"tension_limit": tension_limit, "least_cocontraction": least_cocontraction}
        return [words.split(":")[0] for words in mismatches(PairParameters.from_mapping(given | changes), configs)]

    assert found(most_N, least_N) == []
    assert found(math.nextafter(most_N, math.inf), least_N) == 2 * ["tension_limit"]
    assert found(most_N, math.nextafter(least_N, 0.0)) == 2 * ["least_cocontraction"]


def test_a_pair_has_two_wires_whatever_is_handed_over():
    rig = Rig()
    with pytest.raises(ValueError, match=r"zip\(\)"):
        mismatches(rig.parameters, [*rig.configs, rig.configs[0]])
    instruments = [*rig.instruments, rig.instruments[0]]
    with pytest.raises(ValueError, match=r"zip\(\)"):
        SteppedPair(rig.parameters, rig.configs, instruments, VirtualClock(rig.stand.benches[0]))


def test_a_stepped_pair_steps_as_often_as_its_faster_wire_and_leaves_both_off():
    rig = Rig(rates=(20.0, 10.0))
    rig.run(0.5)
    with rig.pair as pair:
        rig.switch_on()
        before = len(pair.outputs)
        pair.run_for(1.0)
        assert len(pair.outputs) - before == rig.configs[0].loop.rate == 20.0
        assert rig.on == [True, True]
    assert rig.on == [False, False]
