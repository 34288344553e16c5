"""What the actuator does in the moments between: an answer that is owed, two steps at once, a step that fails."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from rig import Rig

from sma_actuator.actuator import Actuator
from sma_actuator.base.parameters import ConfigError
from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import OFF, Branch, Command, Mode, SupplyState
from sma_actuator.config import Config
from sma_actuator.control.law import LawError
from sma_actuator.estimation.chain import ESTIMATOR_RESET
from sma_actuator.plant.loads import Weight


@pytest.fixture
def rig(make_rig):
    return make_rig()


class TestAStepThatFails:
    """What no guard foresees: what is handed over as a reading is none."""

    def test_the_current_is_off_in_the_same_step_and_the_fault_says_what_it_was(self, rig):
        rig.enable()
        rig.track()
        assert rig.output.command.current_A > rig.config.supply.bias_current
        rig.reading_of = lambda reading: "no reading"
        assert rig.step().command == OFF
        assert (rig.status.mode, rig.status.fault) == (Mode.OFF, "unhandled_exception")
        assert "AttributeError" in rig.status.message
        rig.reading_of = lambda reading: reading
        assert rig.run(0.5).command == OFF
        assert rig.status.fault == "unhandled_exception", "and nobody else is accused because it went off"

    def test_so_it_is_in_the_first_step_of_all(self, config):
        output = Actuator(config).step(0.0, "no reading", None)
        assert output.command == OFF
        assert output.status.fault == "unhandled_exception"
        assert output.status.values["current_limit_A"] == 0.0

    @pytest.mark.parametrize("leaves", [SystemExit(3), RuntimeError("worn")], ids=repr)
    def test_a_law_that_is_left_by_whatever_is_named_and_its_gains_are_not_taken_over(self, rig, leaves, monkeypatch):
        def leave(*_):
            raise leaves

        rig.enable()
        rig.track()
        law = type(rig.actuator._following.controller)
        said = f"control law 'pid': {type(leaves).__name__}: {leaves}"
        monkeypatch.setattr(law, "set_gains", leave)
        with pytest.raises(LawError, match=f"^{said}$"):
            rig.actuator.update(rig.config.replace({"controller.setpoint_rate_limit": 0.02}))
        rig.step()
        assert rig.output.events == (), "nothing was changed"
        assert rig.output.command.output_on
        monkeypatch.setattr(law, "step", leave)
        assert rig.step().command == OFF
        assert (rig.status.mode, rig.status.fault) == (Mode.OFF, "unhandled_exception")
        assert f"LawError: {said}" in rig.status.message


@pytest.mark.parametrize("leaves", [SystemExit(3), KeyError("gain")], ids=repr)
def test_a_law_that_cannot_be_built_is_named(config, leaves, monkeypatch):
    def leave(*_):
        raise leaves

    monkeypatch.setattr(type(config.controller), "build", leave)
    with pytest.raises(LawError, match=f"^control law 'pid': {type(leaves).__name__}: {leaves}$"):
        Actuator(config)


def test_a_first_step_in_which_nobody_answers_is_no_failure(config):
    output = Actuator(config).step(0.0, None, None)
    assert output.command == OFF
    assert output.status.fault == ""


def test_an_output_that_is_on_before_anything_was_told_was_switched_on_by_somebody_else(config):
    actuator = Actuator(config)
    for now_s in (0.0, 0.05, 0.1):
        output = actuator.step(now_s, None, SupplyState(now_s, 0.2, True, 1.0, 0.2))
    assert output.status.fault == "second_commander"


class TestAnAnswerThatIsOwed:
    """Until it is late the current stays what it was; from then on only the bias flows; what never comes is a fault."""

    @pytest.mark.parametrize("silent", ["daq", "supply"])
    def test_only_the_bias_flows_from_the_time_out_of_that_instrument_on(self, make_rig, silent):
        rig = make_rig(
            **{
                "instruments.daq.timeout": 0.08 if silent == "daq" else 0.15,
                "instruments.supply.timeout": 0.08 if silent == "supply" else 0.15,
            }
        )
        rig.enable()
        rig.track()
        bias_A, before_A = rig.config.supply.bias_current, rig.output.command.current_A
        assert before_A > 2.0 * bias_A
        assert rig.config.loop.rate == 20.0
        setattr(rig, "reading_of" if silent == "daq" else "state_of", lambda answer: None)
        assert rig.step().command.current_A > 0.8 * before_A, "0.05 s: nothing is late"
        assert "answer_late" not in rig.status.limits
        assert rig.step().command == Command(bias_A, True), "0.1 s"
        assert "answer_late" in rig.status.limits

    def test_what_flows_on_unseen_goes_on_heating_the_wire_in_the_balance(self, make_rig):
        """Only where the supply says that it is off does the wire cool."""

        def cools_K(state_of):
            rig = make_rig()
            rig.enable()
            rig.track(0.0015)
            rig.run(3.0)
            before_C = rig.status.values["temperature_C"]
            rig.reading_of, rig.state_of = lambda reading: None, state_of
            rig.run(0.15)
            return before_C - rig.status.values["temperature_C"]

        off_K = cools_K(lambda state: replace(state, output_on=False))
        assert cools_K(lambda state: state) < 0.5 * off_K
        assert cools_K(lambda state: None) < 0.5 * off_K


@pytest.mark.parametrize("section", ["load_cell", "circuit"])
def test_nothing_is_driven_by_a_channel_that_was_never_calibrated(make_config, section):
    mapping = make_config()
    del mapping[section]
    with pytest.raises(ConfigError, match=rf"{section}\.\w+.*: missing; .* is wanted"):
        Actuator(Config.from_mapping(mapping))


class TestStepsAtOnce:
    def test_one_reading_shown_three_times_is_not_three_readings(self, rig):
        actuator, reading = Actuator(rig.config), replace(rig.output.reading, load_cell_voltage_V=0.0)
        for _ in range(3):
            actuator.step(reading.time_s, reading, None)
        done, words = actuator.tare_load()
        assert not done
        assert "3 readings" in words

    @pytest.mark.parametrize("back_s", [0.3, 100.0])
    def test_after_a_clock_that_went_back_readings_count_at_once(self, rig, back_s):
        """However little it went back: until the old time has come again every reading would be an old one."""
        rig.skew_s = -back_s
        rig.step()
        ok, sentence = rig.actuator.enable(rig.now_s, True)
        assert ok, sentence


class TestWhatTheDriverReports:
    def test_its_own_switching_off_is_not_taken_for_somebody_else_s(self, rig):
        rig.enable()
        rig.supply.set_output(False)
        rig.actuator.switched_off()
        rig.actuator.enable(rig.now_s, False)
        assert rig.run(0.2).status.fault == ""

    def test_that_of_somebody_else_is(self, rig):
        rig.enable()
        rig.supply.set_output(False)
        rig.actuator.enable(rig.now_s, False)
        assert rig.step().status.fault == "second_commander"

    def test_a_fault_that_is_over_lets_go_of_itself_alone_and_the_output_stays_off(self, rig):
        rig.enable()
        rig.actuator.raise_fault(rig.now_s, "supply_lost", "the line is cut")
        rig.actuator.end_fault("daq_lost")
        assert rig.actuator.latched == "supply_lost"
        rig.actuator.end_fault("supply_lost")
        assert rig.actuator.latched == ""
        assert rig.step().command == OFF
        assert "passed supply_lost" in rig.output.events
        assert rig.actuator.enable(rig.now_s, True)[0]

    @pytest.mark.parametrize(
        ("fault", "then"),
        [("supply_lost", "~/enable once it answers again"), ("node_lost", "~/clear_fault, then ~/enable")],
    )
    def test_the_status_says_what_to_do_then(self, rig, fault, then):
        rig.enable()
        rig.actuator.raise_fault(rig.now_s, fault, "provoked")
        rig.step()
        assert rig.status.message.endswith(f"(provoked); {then}")

    def test_a_fault_that_nobody_knows_is_refused(self, rig):
        with pytest.raises(ValueError, match="'no_such' is no fault; one of .*supply_lost"):
            rig.actuator.raise_fault(rig.now_s, "no_such", "")


class TestWhatIsTold:
    def test_each_thing_that_is_done_is_told_once_in_the_step_after_it(self, rig):
        def told():
            return rig.step().events

        actuator = rig.actuator
        rig.outputs.clear()
        rig.enable()
        assert [event for output in rig.outputs for event in output.events] == ["enabled"]
        assert actuator.reset_estimator()[0]
        assert told() == (ESTIMATOR_RESET,)
        assert actuator.tare_load() == (False, "not tared: the wire is driven; switch it off first: ~/enable false")
        assert actuator.enable(rig.now_s, False) == (True, "the output is off")
        assert told() == ("disabled",)
        assert actuator.enable(rig.now_s, False) == (True, "the output is off")
        assert told() == ()
        actuator.update(rig.config.replace({"controller.kp": 5.0}))
        assert told() == (f"controller.kp {rig.config.controller.kp} -> 5.0",)
        rig.enable()
        actuator.raise_fault(rig.now_s, "node_lost", "it is gone")
        assert "fault node_lost: it is gone" in told()
        assert told() == ()
        assert actuator.clear_fault(rig.now_s) == (
            True,
            "cleared: the node is gone (it is gone); the output stays off until ~/enable",
        )
        assert told() == ("cleared node_lost",)
        rig.bench.load = Weight(0.0)
        rig.run(2.0)
        assert actuator.tare_load()[0]
        tared, anew = told()
        assert tared.startswith("tared ") and tared.endswith(" N") and anew == ESTIMATOR_RESET

    def test_a_refused_setpoint_stays_in_the_status_for_a_second_from_its_very_moment_on(self, rig):
        rig.enable()
        for _ in range(2):
            rig.outputs.clear()
            assert "finite" in rig.actuator.offer_setpoint(rig.bench.time_s + rig.period_s, math.nan)
            rig.run(2.0)
            shown = [output.status.fault == "setpoint_not_finite" for output in rig.outputs]
            assert shown == [True] * 21 + [False] * 19

    def test_what_was_refused_by_a_clock_that_went_back_since_is_of_no_moment_known(self, rig):
        rig.enable()
        assert rig.actuator.offer_setpoint(rig.now_s + 0.5, math.nan)
        assert rig.run(0.6).status.fault == ""

    def test_the_uncertainty_is_told_where_the_position_is(self):
        rig = Rig(Config.load(shared_file("config/flexinol.yaml")).to_mapping(), load=Weight(0.98))
        rig.enable()
        rig.run(1.0)
        assert rig.status.values["uncertainty_m"] == rig.output.estimate.uncertainty_m > 0.0

    def test_at_which_end_a_setpoint_is_held(self, rig):
        rig.enable()
        for asked_m, end, at in ((0.0, "short", "shortest_m"), (0.1, "long", "longest_m")):
            rig.track(asked_m)
            assert "setpoint_range" in rig.status.limits
            assert f"(at its {end} end, {rig.status.values[at] * 1e3:.3f} mm)" in rig.status.message

    def test_why_a_joint_command_is_not_followed(self, rig):
        bias_A = rig.config.supply.bias_current
        assert rig.actuator.enable(rig.now_s, True)[0]
        assert rig.actuator.offer_joint_command(rig.now_s, 0.003) == ""
        rig.step()
        assert rig.output.command == Command(bias_A, True)
        assert rig.status.values["joint_commands"] == "not followed: where the wire is is not known yet"
        rig.run(1.0)
        wire_m = rig.output.estimate.displacement_m
        assert rig.actuator.offer_joint_command(rig.now_s, 0.003) == ""
        rig.step()
        assert rig.status.values["joint_commands"] == (
            f"not followed: 3.000 mm, and the wire is at {wire_m * 1e3:.3f} mm; "
            "0.2 mm or nearer is wanted first (controller.arming_distance)"
        )


def test_a_live_time_out_of_setpoints_counts_from_then_on(rig):
    rig.enable()
    rig.track()
    rig.run(2.0)
    assert rig.status.fault == ""
    rig.actuator.update(rig.config.replace({"controller.setpoint_timeout": 1.0}))
    assert rig.step().status.fault == "setpoint_stale"


def test_a_live_bound_of_the_flood_counts_from_then_on(rig):
    rig.enable()
    assert not any(rig.actuator.offer_setpoint(rig.now_s, 0.003) for _ in range(50))
    rig.run(0.5)
    rig.actuator.update(rig.config.replace({"safety.setpoint_flood_rate": 20.0}))
    refused = [bool(rig.actuator.offer_setpoint(rig.now_s, 0.003)) for _ in range(50)]
    assert refused[0] is False and sum(refused) >= 39


@pytest.mark.parametrize("ended_by", ["cancelling", "holding"])
def test_no_flood_keeps_a_motion_from_being_ended(rig, ended_by):
    rig.enable()
    assert rig.actuator.offer_trajectory(rig.now_s, [20.0], [0.001]) == ""
    rig.run(2.0)
    while not rig.actuator.offer_joint_command(rig.now_s, math.nan):  # as ros2_control sends them without a controller
        pass
    refusal = (
        rig.actuator.offer_trajectory(rig.now_s, [], []) if ended_by == "cancelling" else rig.actuator.hold(rig.now_s)
    )
    assert refusal == ""
    rig.run(0.2)
    assert rig.status.mode is Mode.HOLD


def test_a_wire_that_nobody_has_looked_at_counts_as_hot_and_cools_to_its_surroundings(config):
    actuator = Actuator(config)
    temperatures_C = [actuator.step(0.05 * n, None, None).status.values["temperature_C"] for n in range(400)]
    assert temperatures_C == sorted(temperatures_C, reverse=True)
    assert temperatures_C[-1] == pytest.approx(config.thermal.ambient_temperature, abs=0.1)


class TestStartingAnew:
    """What the estimate remembers of the wire's way is gone: the same reading means what it would at first."""

    @pytest.mark.parametrize("anew", [lambda a: a.reset_estimator(), lambda a: a.tare_load()], ids=["asked", "tared"])
    def test_a_reading_means_what_it_would_to_an_actuator_that_has_seen_none(self, rig, anew):
        rig.enable()
        rig.track(0.0015)
        seen = [replace(output.reading, load_cell_voltage_V=0.0) for output in rig.outputs]
        kept, forgets, fresh = (Actuator(rig.config) for _ in range(3))
        for reading in seen[:-1]:
            for actuator in (kept, forgets):
                actuator.step(reading.time_s, reading, None)
        done, words = anew(forgets)
        assert done, words
        remembered, anew_m, first = (
            actuator.step(seen[-1].time_s, seen[-1], None).estimate for actuator in (kept, forgets, fresh)
        )
        np.testing.assert_equal(astuple(anew_m), astuple(first))  # also where both are NaN
        assert remembered.branch is Branch.HEATING is not first.branch
        assert remembered.displacement_m != first.displacement_m


class TestMeasurementsOfTheCircuit:
    def test_three_readings_are_enough_for_a_tare_and_two_are_not(self, rig):
        actuator, last = Actuator(rig.config), replace(rig.output.reading, load_cell_voltage_V=0.0)
        for count in (1, 2, 3):
            reading = replace(last, time_s=last.time_s + 0.05 * count)
            actuator.step(reading.time_s, reading, None)
            assert actuator.tare_load()[0] == (count >= 3)

    @pytest.mark.parametrize(
        ("share", "is_measured"),
        [(-0.2, False), (0.05, True), (0.95, True), (1.05, False)],
        ids=["less than nothing: a channel lies", "little", "nearly the least of a wire", "no leads any more"],
    )
    def test_leads_have_from_nothing_to_less_than_a_wire_with_its_leads(self, rig, share, is_measured):
        config = rig.config.replace({"circuit.lead_resistance": 0.3})
        total_Ohm = share * (config.safety.resistance_min + 0.3)
        reference_V = 0.05 * config.circuit.reference_resistance
        actuator, last = Actuator(config), rig.output.reading
        for count in range(3):
            reading = replace(
                last,
                time_s=last.time_s + 0.05 * count,
                supply_voltage_V=reference_V + 0.05 * total_Ohm,
                reference_voltage_V=reference_V,
            )
            actuator.step(reading.time_s, reading, None)
        done, words, value_Ohm = actuator.measure_lead_resistance()
        assert done == is_measured, words
        assert ("is not that of leads" in words) != is_measured
        assert (abs(value_Ohm - total_Ohm) < 1e-9) if is_measured else math.isnan(value_Ohm)


def test_a_live_parameter_arrives_in_the_health_of_the_model(rig):
    rig.actuator.update(rig.config.replace({"thermal.ambient_tolerance": 3.0}))
    assert rig.actuator._health._tolerance_K == 3.0


@pytest.mark.parametrize("held_back", [False, True])
def test_a_wire_that_the_heat_limit_holds_back_is_tried_anew_from_colder(rig, held_back, monkeypatch):
    asked = []
    rig.enable()
    rig.track()
    reach, supervisor = rig.actuator._following._reach, rig.actuator._supervisor
    monkeypatch.setattr(type(supervisor), "let_cool", lambda _: asked.append("let cool"))
    monkeypatch.setattr(type(reach), "step", lambda reach, *_, **__: setattr(reach, "held_back", held_back))
    rig.step()
    assert bool(asked) == held_back


@pytest.mark.parametrize("astray", [False, True])
def test_the_heat_limit_hears_whether_the_wire_is_where_it_should_be(rig, astray, monkeypatch):
    rig.enable()
    rig.track()
    reach = rig.actuator._following._reach
    monkeypatch.setattr(type(reach), "step", lambda reach, *_, **__: setattr(reach, "astray", astray))
    rig.step()
    assert rig.actuator._supervisor.heat.astray == astray
