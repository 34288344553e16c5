"""Modes, setpoints and services of the actuator, on the virtual bench."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from sma_actuator.actuator import Actuator
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.signals import Command, Mode, Quality
from sma_actuator.config import Config
from sma_actuator.control.pid import PidController, PidParameters
from sma_actuator.plant.loads import Weight


@pytest.fixture
def rig(make_rig):
    return make_rig()


class TestEnable:
    def test_without_a_reading_it_is_refused(self, config):
        actuator = Actuator(config)
        ok, sentence = actuator.enable(0.0, True)
        assert not ok
        assert "no reading" in sentence

    def test_with_a_reading_that_has_become_old_it_is_refused(self, rig):
        assert not rig.actuator.enable(rig.now_s + 1.0, True)[0]

    @pytest.mark.parametrize(
        ("lie", "words"),
        [
            (lambda r: replace(r, load_cell_voltage_V=-1.0), "implausible"),
            (lambda r: replace(r, load_cell_voltage_V=math.nan), "not finite"),
            (lambda r: replace(r, supply_voltage_V=11.0), "saturated"),
            (lambda r: replace(r, load_cell_voltage_V=1.0), "stress above its limit"),
            (lambda r: None, "the DAQ is silent"),
        ],
    )
    def test_with_readings_that_would_be_a_fault_it_is_refused(self, rig, lie, words):
        rig.reading_of = lie
        rig.run(1.0)
        ok, sentence = rig.actuator.enable(rig.now_s, True)
        assert not ok
        assert words in sentence
        rig.reading_of = lambda reading: reading
        rig.run(0.1)
        assert rig.actuator.enable(rig.now_s, True)[0], "and nothing has latched"

    def test_while_the_supply_is_silent_it_is_refused(self, rig):
        rig.state_of = lambda state: None
        rig.run(1.0)
        ok, sentence = rig.actuator.enable(rig.now_s, True)
        assert not ok
        assert "the supply is silent" in sentence

    def test_the_first_current_is_the_bias_and_the_wire_is_held(self, rig):
        rig.actuator.enable(rig.now_s, True)
        rig.run(0.2)
        assert {output.command for output in rig.outputs[-4:]} == {Command(rig.config.supply.bias_current, True)}
        assert rig.status.mode is Mode.HOLD
        rig.run(0.5)
        held = [output for output in rig.outputs if math.isfinite(output.setpoint_m)]
        assert held[0].setpoint_m == held[0].estimate.displacement_m == held[-1].setpoint_m
        assert max(output.command.current_A for output in held) < 0.1

    def test_twice_is_once(self, rig):
        rig.enable()
        rig.track()
        assert rig.actuator.enable(rig.now_s, True) == (True, "the output is on already")
        rig.step()
        assert rig.status.mode is Mode.TRACKING

    def test_off_is_off_in_the_next_step_and_forgets_the_setpoint(self, rig):
        rig.enable()
        rig.track()
        rig.actuator.enable(rig.now_s, False)
        assert rig.step().command == Command(0.0, False)
        rig.run(0.5)
        rig.enable()
        assert rig.status.mode is Mode.HOLD

    def test_from_the_first_step_off_the_status_says_no_position(self, rig):
        """The reading of that step is of before the output went off, and its status stands while the wire moves."""
        rig.enable()
        assert rig.status.values["displacement_m"] == rig.output.estimate.displacement_m
        rig.actuator.enable(rig.now_s, False)
        rig.step()
        assert rig.status.mode is Mode.OFF
        assert math.isnan(rig.status.values["displacement_m"]) and math.isnan(rig.status.values["uncertainty_m"])


def test_until_the_controller_has_begun_nobody_is_told_where_the_wire_is_sent(rig):
    for _ in range(2):  # the second time there is one of the time before
        assert rig.actuator.enable(rig.now_s, True)[0]
        rig.step()
        assert rig.status.mode is Mode.HOLD
        assert math.isnan(rig.status.values["limited_setpoint_m"])
        rig.run(1.0)
        assert rig.status.values["limited_setpoint_m"] == rig.output.setpoint_m
        rig.actuator.enable(rig.now_s, False)
        rig.run(1.0)


def test_a_setpoint_is_reached(rig):
    rig.enable()
    rig.track(0.0025)
    rig.run(20.0)
    assert rig.output.estimate.displacement_m == pytest.approx(0.0025, abs=5e-5)


def test_setpoints_are_refused_while_the_output_is_off(rig):
    assert "enable first" in rig.actuator.offer_setpoint(rig.now_s, 0.003)
    assert "enable first" in rig.actuator.offer_trajectory(rig.now_s, [1.0], [0.003])
    rig.enable()
    assert rig.status.mode is Mode.HOLD


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_bad_setpoint_is_refused_in_a_sentence_and_the_last_one_stands(rig, bad):
    rig.enable()
    rig.track(0.0027)
    assert "finite position in metres" in rig.actuator.offer_setpoint(rig.now_s, bad)
    assert "is not finite" in rig.actuator.offer_trajectory(rig.now_s, [0.0, 1.0], [0.003, bad])
    rig.step()
    assert rig.output.setpoint_m == 0.0027
    assert rig.status.mode is Mode.TRACKING


def test_a_trajectory_is_followed_and_its_end_held(rig):
    rig.enable()
    start_s = rig.now_s
    assert rig.actuator.offer_trajectory(start_s, [0.0, 2.0], [0.0040, 0.0030]) == ""
    rig.run(1.0)
    assert rig.output.setpoint_m == pytest.approx(0.0035)
    rig.run(3.0)
    assert rig.output.setpoint_m == 0.0030
    assert rig.status.mode is Mode.TRACKING


def test_a_trajectory_with_a_later_start_is_waited_for(rig):
    rig.enable()
    rig.track(0.0040)
    assert rig.actuator.offer_trajectory(rig.now_s, [0.0, 2.0], [0.0036, 0.0030], delay_s=1.0) == ""
    rig.run(0.2)
    assert "tracking (a trajectory begins in 1 s, as it is stamped)" in rig.status.message
    rig.run(0.7)
    assert rig.output.setpoint_m == 0.0040
    rig.run(1.1)
    assert "begins" not in rig.status.message
    assert rig.output.setpoint_m == pytest.approx(0.0033, abs=1e-4)
    rig.run(2.0)
    assert rig.output.setpoint_m == 0.0030


def test_a_setpoint_that_comes_meanwhile_takes_the_place_of_a_trajectory_waited_for(rig):
    rig.enable()
    rig.actuator.offer_trajectory(rig.now_s, [0.0], [0.0030], delay_s=1.0)
    rig.track(0.0040)
    rig.run(3.0)
    assert rig.output.setpoint_m == 0.0040


def test_of_a_trajectory_that_has_begun_the_rest_is_followed_and_one_that_is_over_refused(rig):
    rig.enable()
    assert rig.actuator.offer_trajectory(rig.now_s, [0.0, 2.0], [0.0040, 0.0030], delay_s=-1.0) == ""
    rig.step()
    assert rig.output.setpoint_m == pytest.approx(0.0035, abs=1e-4)
    sentence = rig.actuator.offer_trajectory(rig.now_s, [0.0, 2.0], [0.0040, 0.0036], delay_s=-5.0)
    assert sentence == "trajectory refused: its last point was due 3 s ago"


@pytest.mark.parametrize("delay_s", [0.0, 1.0, -1.0])
@pytest.mark.parametrize("at_once", [False, True])
def test_one_whose_first_point_is_later_is_led_in_from_where_the_wire_is(rig, delay_s, at_once):
    """A single point in four seconds, as rqt's sliders send it, is a motion of four seconds."""
    rig.enable()
    if not at_once:  # else the law has not begun when it comes
        rig.track(0.0040)
        rig.run(3.0)
    begins_s = rig.now_s + max(delay_s, 0.0)
    assert rig.actuator.offer_trajectory(rig.now_s, [4.0], [0.0020], delay_s=delay_s) == ""
    rig.run(max(delay_s, 0.0) + 0.3)
    from_m, from_s = rig.output.setpoint_m, rig.now_s
    assert from_m == pytest.approx(0.0040, abs=3e-4)
    rig.run(1.0)
    left_s = begins_s + 4.0 + min(delay_s, 0.0) - from_s
    assert rig.output.setpoint_m == pytest.approx(from_m + (0.0020 - from_m) * 1.0 / left_s, abs=2e-5)
    rig.run(4.0)
    assert rig.output.setpoint_m == 0.0020


def test_the_velocities_of_a_trajectory_are_honoured(rig):
    rig.enable()
    rig.actuator.offer_trajectory(rig.now_s, [0.0, 2.0], [0.0040, 0.0030], [0.0, 0.0])
    rig.run(0.5)
    assert rig.output.setpoint_m == pytest.approx(0.0040 - 0.001 * 0.25**2 * (3 - 2 * 0.25), abs=3e-5)


def test_the_setpoint_is_not_lost_while_a_trajectory_runs_but_after_it(make_rig):
    rig = make_rig(**{"controller.setpoint_timeout": 0.5})
    rig.enable()
    rig.actuator.offer_trajectory(rig.now_s, [0.0, 2.0], [0.0040, 0.0030])
    rig.run(2.3)
    assert rig.status.mode is Mode.TRACKING
    rig.run(0.5)
    assert (rig.status.mode, rig.status.fault) == (Mode.HOLD, "setpoint_stale")


class TestJointCommands:
    """The stream of a controller manager, which knows nothing of the wire."""

    def stream(self, rig, position_m, seconds):
        for _ in range(round(seconds * rig.config.loop.rate)):
            assert rig.actuator.offer_joint_command(rig.now_s, position_m) == ""
            rig.step()
        return rig.status.values["joint_commands"]

    def test_nan_is_no_command_and_no_fault(self, rig):
        assert self.stream(rig, math.nan, 0.5) == "no number yet"
        rig.enable()
        held_m = rig.output.setpoint_m
        assert self.stream(rig, math.nan, 0.5) == "no number yet"
        assert (rig.status.mode, rig.status.fault, rig.output.setpoint_m) == (Mode.HOLD, "", held_m)

    def test_infinity_is_refused(self, rig):
        rig.enable()
        assert "finite" in rig.actuator.offer_joint_command(rig.now_s, math.inf)
        assert rig.run(0.1).status.fault == "setpoint_not_finite"

    def test_they_are_followed_once_one_is_near_and_from_then_on_wherever_they_are(self, rig):
        rig.enable()
        held_m = rig.output.setpoint_m
        assert "0.2 mm or nearer is wanted first" in self.stream(rig, held_m - 0.3e-3, 0.5)
        assert rig.output.setpoint_m == held_m
        assert self.stream(rig, held_m - 0.1e-3, 0.1) == "followed"
        assert self.stream(rig, 0.0030, 0.5) == "followed"
        assert (rig.status.mode, rig.output.setpoint_m) == (Mode.TRACKING, 0.0030)
        assert [event for output in rig.outputs for event in output.events].count("joint commands followed") == 1

    @pytest.mark.parametrize(
        "interruption",
        [
            lambda rig: (rig.actuator.enable(rig.now_s, False), rig.run(0.3), rig.enable()),
            lambda rig: rig.actuator.reset_estimator(),
            lambda rig: rig.actuator.offer_trajectory(rig.now_s, [], []),
            lambda rig: rig.run(1.0),
        ],
        ids=["off and on", "estimator", "stop", "silence"],
    )
    def test_after_an_interruption_the_wire_does_not_jump_to_where_the_stream_still_is(self, rig, interruption):
        rig.enable()
        wire_m = rig.output.estimate.displacement_m
        self.stream(rig, wire_m, 0.1)
        self.stream(rig, wire_m - 0.8e-3, 0.2)
        interruption(rig)
        rig.run(0.2)
        before_m = rig.output.setpoint_m
        assert before_m == pytest.approx(wire_m, abs=0.4e-3)
        assert self.stream(rig, wire_m - 0.8e-3, 0.5).startswith("not followed")
        assert rig.output.setpoint_m == before_m

    @pytest.mark.parametrize("action", ["hold", "bias", "off"])
    def test_a_dead_stream_is_a_lost_setpoint(self, make_rig, action):
        rig = make_rig(**{"controller.on_setpoint_loss": action})
        rig.enable()
        wire_m = rig.output.estimate.displacement_m
        self.stream(rig, wire_m, 0.1)
        self.stream(rig, wire_m - 0.3e-3, 0.3)
        self.stream(rig, math.nan, 0.4)
        assert rig.status.fault == ""
        self.stream(rig, math.nan, 0.2)
        assert rig.status.fault == "setpoint_stale"
        assert rig.status.mode is (Mode.OFF if action == "off" else Mode.HOLD)

    def test_they_count_among_those_that_may_flood_in(self, rig):
        rig.enable()
        refusals = [rig.actuator.offer_joint_command(rig.now_s, math.nan) for _ in range(200)]
        assert any("faster than safety.setpoint_flood_rate" in refusal for refusal in refusals)


class TestTheEndOfAMotion:
    """A motion that is cancelled ends at its reference, one that failed at the measured position; the current steps in
    neither."""

    @pytest.fixture
    def moving(self, make_rig):
        """A rig whose wire is drawn along, with a following error."""
        rig = make_rig()
        rig.run(5.0)
        rig.enable()
        rig.track(0.0032)
        rig.run(6.0)
        rig.actuator.offer_trajectory(rig.now_s, [0.0, 4.0], [0.0032, 0.0016])
        rig.run(2.0)
        assert abs(self.reference_m(rig) - rig.output.estimate.displacement_m) > 2e-5
        return rig

    @staticmethod
    def reference_m(rig):
        return rig.status.values["limited_setpoint_m"]

    @staticmethod
    def steps_A(rig):
        """By how much the current changed in each of the last steps; the first of them before the motion's end."""
        return np.abs(np.diff([output.command.current_A for output in rig.outputs]))

    def test_cancelled_it_ends_where_its_reference_has_come(self, moving):
        reference_m = self.reference_m(moving)
        usual_A = self.steps_A(moving)[-20:].max()
        assert moving.actuator.offer_trajectory(moving.now_s, [], []) == ""
        moving.step()
        assert (moving.status.mode, moving.output.setpoint_m) == (Mode.HOLD, reference_m)
        assert self.steps_A(moving)[-1] <= 2.0 * usual_A
        moving.run(6.0)
        assert moving.output.setpoint_m == reference_m
        assert moving.output.estimate.displacement_m == pytest.approx(reference_m, abs=1e-4)

    def test_of_a_setpoint_whose_reference_is_at_its_end_at_once_the_wire_is_held_where_it_is(self, make_rig):
        rig = make_rig()
        rig.enable()
        rig.actuator.offer_setpoint(rig.now_s, 0.0025)
        rig.run(0.5)
        assert rig.actuator.offer_trajectory(rig.now_s, [], []) == ""
        rig.step()
        assert (rig.status.mode, rig.output.setpoint_m) == (Mode.HOLD, rig.output.estimate.displacement_m)

    def test_failed_it_ends_where_the_wire_is_measured_to_be(self, moving):
        usual_A = self.steps_A(moving)[-20:].max()
        assert moving.actuator.hold(moving.now_s) == ""
        moving.step()
        held_m = moving.output.setpoint_m
        assert (moving.status.mode, held_m) == (Mode.HOLD, moving.output.estimate.displacement_m)
        assert self.steps_A(moving)[-1] <= 2.0 * usual_A

    def test_a_wire_that_is_held_already_stays_held_where_it_was(self, moving):
        moving.actuator.offer_trajectory(moving.now_s, [], [])
        moving.run(1.0)
        held_m = moving.output.setpoint_m
        moving.actuator.offer_trajectory(moving.now_s, [0.0, 1.0], [0.002, 0.003], delay_s=60.0)
        moving.actuator.offer_trajectory(moving.now_s, [], [])
        moving.run(1.0)
        assert moving.output.setpoint_m == held_m

    def test_with_the_output_off_there_is_nothing_to_end(self, make_rig):
        rig = make_rig()
        assert "the output is off" in rig.actuator.hold(rig.now_s)


class TestLostSetpoint:
    def lost(self, make_rig, action):
        rig = make_rig(**{"controller.setpoint_timeout": 2.0, "controller.on_setpoint_loss": action})
        rig.enable()
        rig.track(0.0025)
        rig.run(1.3)
        assert rig.status.mode is Mode.TRACKING
        rig.run(0.3)
        assert rig.status.fault == "setpoint_stale"
        return rig

    def test_hold_keeps_the_wire_where_it_is_without_a_jump(self, make_rig):
        rig = self.lost(make_rig, "hold")
        currents_A = np.array([output.command.current_A for output in rig.outputs[-10:]])
        assert np.abs(np.diff(currents_A)).max() < 0.05
        before_m = rig.output.setpoint_m
        rig.run(10.0)
        assert rig.output.setpoint_m == before_m
        assert rig.status.mode is Mode.HOLD
        assert rig.output.estimate.displacement_m == pytest.approx(before_m, abs=1e-4)
        assert rig.status.fault == "setpoint_stale", "and says so until there is a new one"

    def test_bias_lets_it_relax(self, make_rig):
        rig = self.lost(make_rig, "bias")
        assert rig.output.command == Command(rig.config.supply.bias_current, True)
        rig.run(5.0)
        assert rig.output.command == Command(rig.config.supply.bias_current, True)
        assert rig.status.mode is Mode.HOLD

    @pytest.mark.parametrize("action", ["hold", "bias"])
    def test_a_new_setpoint_goes_on(self, make_rig, action):
        rig = self.lost(make_rig, action)
        before_A = rig.output.command.current_A
        assert rig.actuator.offer_setpoint(rig.now_s, 0.0025) == ""
        rig.step()
        assert (rig.status.mode, rig.status.fault) == (Mode.TRACKING, "")
        assert abs(rig.output.command.current_A - before_A) < 0.1

    def test_off_latches(self, make_rig):
        rig = self.lost(make_rig, "off")
        assert rig.output.command == Command(0.0, False)
        assert rig.actuator.offer_setpoint(rig.now_s, 0.0025)
        assert rig.run(1.0).command == Command(0.0, False)

    @pytest.mark.parametrize("stamp_s", [math.nan, -1e9, 1e9])
    def test_a_setpoint_with_an_impossible_time_is_lost_at_once(self, make_rig, stamp_s):
        rig = make_rig(**{"controller.setpoint_timeout": 2.0})
        rig.enable()
        rig.actuator.offer_setpoint(stamp_s, 0.0025)
        rig.step()
        assert rig.status.fault == "setpoint_stale"


class TestSetpointFlood:
    def test_a_source_within_the_rate_is_never_refused(self, rig):
        rig.enable()
        rate_Hz = rig.config.safety.setpoint_flood_rate
        start_s = rig.now_s
        assert not any(rig.actuator.offer_setpoint(start_s + k / rate_Hz, 0.003) for k in range(5000))

    def test_of_a_source_twice_as_fast_half_is_refused(self, rig):
        rig.enable()
        rate_Hz = rig.config.safety.setpoint_flood_rate
        start_s = rig.now_s
        refused = sum(bool(rig.actuator.offer_setpoint(start_s + k / (2 * rate_Hz), 0.003)) for k in range(10000))
        assert refused == pytest.approx(5000, abs=0.11 * rate_Hz)


def test_an_estimate_without_current_is_the_last_one_and_marked_invalid(rig):
    rig.enable()
    rig.track()
    rig.run(2.0)
    rig.actuator.enable(rig.now_s, False)
    rig.run(0.2)
    last_m = rig.output.estimate.displacement_m
    assert rig.output.estimate.quality is Quality.INVALID
    assert math.isfinite(last_m)
    assert math.isnan(rig.output.signals.resistance_Ohm)


class TestUpdate:
    def test_new_gains_do_not_move_the_current(self, rig):
        rig.enable()
        rig.track(0.0028)
        rig.run(3.0)
        quiet_A = max(
            abs(b.command.current_A - a.command.current_A) for a, b in zip(rig.outputs[-20:], rig.outputs[-19:])
        )
        before_A = rig.output.command.current_A
        rig.actuator.update(rig.config.replace({"controller.kp": 5.0, "controller.ki": 20.0}))
        assert abs(rig.step().command.current_A - before_A) <= 3.0 * quiet_A + 1e-3

    def test_a_new_limit_acts_in_the_next_step(self, rig):
        rig.enable()
        rig.actuator.update(rig.config.replace({"safety.load_min": 1.0}))
        assert rig.step().status.fault == "reading_implausible"

    def test_what_is_not_live_is_refused_and_nothing_is_taken_over(self, rig):
        rig.enable()
        with pytest.raises(ConfigError, match="supply.max_current: cannot be changed while the actuator runs"):
            rig.actuator.update(rig.config.replace({"supply.max_current": 0.3, "safety.load_min": 1.0}))
        assert rig.step().status.fault == ""

    def test_coefficients_of_a_running_model_are_not_live_either(self, rig):
        with pytest.raises(ConfigError, match="model.transition_rate"):
            rig.actuator.update(rig.config.replace({"model.transition_rate": 20.0}))


class TestTare:
    def test_the_drift_of_an_unloaded_cell_is_taken_away(self, rig):
        rig.bench.load = Weight(0.0)
        rig.reading_of = lambda reading: replace(reading, load_cell_voltage_V=reading.load_cell_voltage_V + 0.02)
        rig.run(2.0)
        assert rig.output.signals.load_N == pytest.approx(0.02 * 12.7297, abs=0.01)
        ok, sentence = rig.actuator.tare_load()
        assert ok, sentence
        rig.step()
        assert rig.output.signals.load_N == pytest.approx(0.0, abs=0.01)
        assert rig.output.signals.stress_Pa == pytest.approx(0.0, abs=0.01 / rig.config.wire.area_m2)

    def test_a_load_is_not_tared_away(self, rig):
        ok, sentence = rig.actuator.tare_load()
        assert not ok
        assert "take the load off" in sentence
        rig.step()
        assert rig.output.signals.load_N == pytest.approx(0.49, abs=0.02)

    @pytest.mark.parametrize(("drift_V", "tared"), [(0.02, True), (-0.02, True), (0.04, False), (-0.04, False)])
    def test_more_than_a_tenth_of_what_the_wire_may_carry_is_no_drift_of_either_sign(self, rig, drift_V, tared):
        rig.bench.load = Weight(0.0)
        rig.reading_of = lambda r: replace(r, load_cell_voltage_V=r.load_cell_voltage_V + drift_V)
        rig.run(2.0)
        ok, sentence = rig.actuator.tare_load()
        assert ok == tared, sentence
        assert ("take the load off" in sentence) == (not tared)

    def test_not_while_the_wire_is_driven(self, rig):
        rig.enable()
        assert "driven" in rig.actuator.tare_load()[1]

    def test_not_on_old_readings(self, rig):
        rig.bench.load = Weight(0.0)
        rig.run(2.0)
        rig.reading_of = lambda reading: None
        rig.run(1.0)
        assert not rig.actuator.tare_load()[0]

    def test_not_without_readings(self, config):
        assert not Actuator(config).tare_load()[0]


class TestLeadResistance:
    def test_is_measured_with_a_short_in_place_of_the_wire(self, rig):
        rig.bench.inject("short_wire", 0.0)
        assert rig.actuator.enable(rig.now_s, True)[0]
        rig.run(2.0)
        assert rig.status.fault == "short", "which does switch the output off"
        ok, sentence, value_Ohm = rig.actuator.measure_lead_resistance()
        assert ok, sentence
        assert value_Ohm == pytest.approx(rig.bench.setup.chain.lead_resistance_Ohm, abs=0.02)

    def test_a_wire_is_no_lead(self, rig):
        rig.enable()
        ok, sentence, value_Ohm = rig.actuator.measure_lead_resistance()
        assert not ok
        assert "is there a short" in sentence
        assert math.isnan(value_Ohm)

    def test_without_current_there_is_nothing_to_measure(self, rig):
        ok, sentence, _ = rig.actuator.measure_lead_resistance()
        assert not ok
        assert "~/enable" in sentence

    def test_readings_of_an_earlier_short_do_not_count(self, rig):
        rig.bench.inject("short_wire", 0.0)
        rig.actuator.enable(rig.now_s, True)
        rig.run(1.0)
        rig.bench.clear("short_wire")
        rig.actuator.clear_fault(rig.now_s)
        assert rig.actuator.measure_lead_resistance()[0]
        assert rig.actuator.enable(rig.now_s, True)[0]
        assert not rig.actuator.measure_lead_resistance()[0]


def test_the_estimator_starts_anew_on_the_cooling_curve_and_the_wire_is_held_there(rig):
    rig.enable()
    rig.track(0.0025)
    rig.run(5.0)
    before_A = rig.output.command.current_A
    assert rig.actuator.reset_estimator()[0]
    rig.step()
    assert rig.status.mode is Mode.HOLD
    assert rig.output.setpoint_m == rig.output.estimate.displacement_m
    assert rig.output.command.current_A == pytest.approx(before_A, abs=1e-9)


def test_a_slip_does_not_unhappen_when_the_estimator_starts_anew_or_the_load_is_tared(rig, make_config):
    """The wire is longer by its length from then on, whatever is reset: the same readings, with and without."""
    plain = Config.from_mapping(make_config())
    slipped = Config.from_mapping(make_config(effects={"slip": {"length": 3e-4, "time": 1.0}}))
    rig.bench.load = Weight(0.1)
    seen = []
    rig.reading_of = lambda reading: seen.append(reading) or reading
    rig.run(6.0)
    current = [replace(r, supply_voltage_V=0.3, reference_voltage_V=0.05) for r in seen]  # bias, through 5 Ω
    actuators = [Actuator(plain), Actuator(slipped)]

    def differ_m(readings):
        outputs = [[a.step(r.time_s, r, None) for r in readings] for a in actuators]
        with_, without = outputs[1][-1].estimate, outputs[0][-1].estimate
        return with_.displacement_m - without.displacement_m

    third = len(current) // 3
    assert differ_m(current[:third]) == pytest.approx(3e-4)
    for actuator in actuators:
        assert actuator.reset_estimator()[0]
    assert differ_m(current[third : third + 2]) == pytest.approx(3e-4)
    for actuator in actuators:
        ok, sentence = actuator.tare_load()
        assert ok, sentence
    assert differ_m(current[third + 2 : third + 4]) == pytest.approx(3e-4)


def test_a_live_ambient_temperature_arrives_in_the_effects(rig, make_config):
    """Nothing measures the surroundings: what is set while the wire is driven counts from the next reading on."""
    effects = {"ambient_temperature": {"temperature_coefficient": 1e-3, "fading": 1e6}}
    old = Config.from_mapping(make_config(effects=effects))
    new = old.replace({"thermal.ambient_temperature": 60.0})
    seen = []
    rig.reading_of = lambda reading: seen.append(reading) or reading
    rig.run(0.5)
    readings = [replace(r, supply_voltage_V=0.3, reference_voltage_V=0.05) for r in seen]  # bias, through 5 Ω
    told, born, stale = Actuator(old), Actuator(new), Actuator(old)
    told.update(new)
    estimates_m = [[a.step(r.time_s, r, None).estimate.displacement_m for r in readings] for a in (told, born, stale)]
    assert estimates_m[0] == estimates_m[1]
    assert abs(estimates_m[0][-1] - estimates_m[2][-1]) > 1e-4


def test_clearing_without_a_fault_says_so(rig):
    assert rig.actuator.clear_fault(rig.now_s) == (True, "there is no fault to clear")


def test_too_hot_comes_back_while_it_is_true(make_rig):
    rig = make_rig(thermal={"ambient_temperature": 90.0, "derate_temperature": 60.0, "max_temperature": 80.0})
    rig.run(0.1)
    assert rig.status.fault == "too_hot"
    rig.actuator.clear_fault(rig.now_s)
    rig.step()
    assert rig.status.fault == "too_hot"


@pytest.mark.parametrize("lie", [lambda reading: reading, lambda reading: None], ids=["with readings", "without"])
def test_a_wire_without_current_cools_in_the_heat_balance(rig, lie):
    rig.enable()
    rig.track(0.0015)
    rig.run(5.0)
    hot_C = rig.status.values["temperature_C"]
    assert hot_C > rig.config.thermal.ambient_temperature + 20.0
    rig.actuator.enable(rig.now_s, False)
    rig.reading_of = lie
    rig.run(10.0)
    assert rig.status.values["temperature_C"] == pytest.approx(rig.config.thermal.ambient_temperature, abs=1.0)


def test_readings_slower_than_their_timeout_are_refused_as_a_configuration(make_config):
    with pytest.raises(ConfigError, match="safety.reading_timeout: 0.3 s is less than two periods"):
        Config.from_mapping(
            make_config(**{"loop.rate": 5.0, "loop.samples_per_block": 100, "safety.reading_timeout": 0.3})
        )


@pytest.mark.parametrize("instrument", ["supply", "daq"])
def test_answers_that_may_take_longer_than_what_is_promised_are_refused_as_a_configuration(make_config, instrument):
    slow = {f"instruments.{instrument}.timeout": 0.5}
    words = f"less than .*instruments.{instrument}.timeout, 0.5 s, .*faults.md says; (.*) s will do"
    with pytest.raises(ConfigError, match=words) as refused:
        Config.from_mapping(make_config(**slow))
    mend = float(re.search(words, str(refused.value))[1])
    assert Config.from_mapping(make_config(**slow, **{"safety.reading_timeout": mend})).safety.reading_timeout == mend


def test_the_same_readings_give_the_same_commands(make_rig):
    def run():
        rig = make_rig()
        rig.enable()
        rig.track(0.0025)
        rig.run(3.0)
        return [output.command for output in rig.outputs]

    assert run() == run()


def test_a_clock_that_went_back_makes_no_reading_old(rig):
    rig.skew_s = -100.0
    rig.run(0.2)
    ok, sentence = rig.actuator.enable(rig.now_s, True)
    assert ok, sentence
    rig.run(1.0)
    assert rig.status.fault == ""
    assert math.isfinite(rig.status.values["displacement_m"])


class Watched(PidController):
    """A controller that keeps what it was told of time."""

    def step(self, position_m, setpoint_m, dt_s, limit_A):
        self.told_s.append(dt_s)
        return super().step(position_m, setpoint_m, dt_s, limit_A)


def test_after_a_gap_the_controller_is_told_of_no_more_time_than_a_reading_may_be_old(make_rig, monkeypatch):
    """Else its integral would leap: for 0.8 s so little current seems to flow that there is no estimate."""
    told_s = []
    monkeypatch.setattr(Watched, "told_s", told_s, raising=False)
    monkeypatch.setattr(PidParameters, "build", lambda self, sections: Watched(self, sections.supply.bias_current))
    blind = {"current_disagreement": 0.4, "current_drift": 1.0}
    rig = make_rig(safety={"outside_calibration_time": 5.0, "reading_timeout": 0.5, **blind})
    rig.enable()
    rig.track()
    shares = dict.fromkeys(("supply_voltage_V", "reference_voltage_V"), 0.01)
    rig.reading_of = lambda r: replace(r, **{name: share * getattr(r, name) for name, share in shares.items()})
    rig.run(0.8)
    before = len(told_s)
    rig.reading_of = lambda reading: reading
    rig.run(0.2)
    assert max(told_s[before:]) == 0.5
    assert max(told_s[:before]) < 0.1


def test_clearing_a_fault_forgets_what_was_refused_a_moment_ago(rig):
    rig.enable()
    assert rig.actuator.offer_setpoint(rig.now_s, math.nan)
    rig.step()
    assert "setpoint" in rig.status.message
    said = rig.status.message
    assert rig.actuator.clear_fault(rig.now_s)[0]
    rig.step()
    assert rig.status.message != said
    assert "finite" not in rig.status.message
