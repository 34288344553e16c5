"""Every fault of the table, provoked on the virtual bench; and no guard without which that would still work."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from sma_actuator.actuator import Actuator, following, offered
from sma_actuator.base.signals import Command, Mode, Quality
from sma_actuator.control.pid import PidController
from sma_actuator.plant.loads import Weight
from sma_actuator.safety import supervisor as supervisor_module
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.limits import LIMITS
from sma_actuator.safety.records import NOT_WAITED, Action, Guard


@dataclass
class Scenario:
    """How a fault is provoked, and how the provocation ends."""

    provoke: Callable
    relent: Callable = lambda rig: rig.bench.clear()
    changes: dict = field(default_factory=dict)
    tracking: bool = True


def bench_fault(name, value=math.nan, **kwargs):
    return Scenario(lambda rig: rig.bench.inject(name, value), lambda rig: rig.bench.clear(name), **kwargs)


def lie_about_readings(lie, **kwargs):
    def relent(rig):
        rig.reading_of = lambda reading: reading

    return Scenario(lambda rig: setattr(rig, "reading_of", lie), relent, **kwargs)


def lie_about_supply(lie, **kwargs):
    def relent(rig):
        rig.state_of = lambda state: state

    return Scenario(lambda rig: setattr(rig, "state_of", lie), relent, **kwargs)


def weight(force_N, **kwargs):
    def hang(force):
        def action(rig):
            rig.bench.load = Weight(force)

        return action

    return Scenario(hang(force_N), hang(0.49), **kwargs)


def reported(fault, **kwargs):
    return Scenario(
        lambda rig: rig.actuator.raise_fault(rig.now_s, fault, "said the driver"), lambda rig: None, **kwargs
    )


def repeat_last_reading(rig):
    last = []

    def repeat(reading):
        last.append(reading)
        return last[0]

    rig.reading_of = repeat


def flood(rig):
    for _ in range(1000):
        rig.actuator.offer_setpoint(rig.now_s, 0.003)


def jump(seconds):
    return Scenario(lambda rig: setattr(rig, "skew_s", rig.skew_s + seconds), lambda rig: None)


def slow_loop(rig):
    rig.period_s = 2.0 / rig.config.loop.rate


def keep_rate(rig):
    rig.period_s = 1.0 / rig.config.loop.rate


def raise_in_estimator(rig):
    def step(signals):
        raise ArithmeticError("provoked")

    rig.genuine = rig.actuator._chain.step
    rig.actuator._chain.step = step


def mend_estimator(rig):
    rig.actuator._chain.step = rig.genuine


class Poisoned(PidController):
    """A controller that has let a NaN in."""

    def step(self, *_):
        return math.nan


def poison_controller(rig):
    rig.genuine = rig.actuator._following.controller
    rig.actuator._following.controller = Poisoned(rig.config.controller, rig.config.supply.bias_current)


def mend_controller(rig):
    rig.actuator._following.controller = rig.genuine


def cold_but_contracted(rig):
    """The balance has called the wire cold for a while; then it shows the resistance of a contracted one."""
    rig.run(8.0)
    rig.reading_of = lambda r: replace(r, supply_voltage_V=r.reference_voltage_V * 5.7)


def repeat_values_with_new_times(rig):
    rig.run(12.0)
    last = rig.daq.read_block()
    rig.reading_of = lambda reading: replace(last, time_s=reading.time_s)


def only_dither_is_left_of_the_load(rig):
    """While the wire is tracked; before, nothing but the channel's own noise was to be seen for a while."""
    rig.run(20.0)
    rig.track()
    last, dither = rig.daq.read_block(), np.random.default_rng(1)
    rig.reading_of = lambda r: replace(r, load_cell_voltage_V=last.load_cell_voltage_V + dither.normal(0.0, 5e-6))


def another_scale_of_the_voltages(rig):
    """Of both by +10 %, after they have been seen for a while, of a wire that is held still: the resistance stays."""
    rig.run(9.0)
    rig.reading_of = lambda reading: replace(
        reading,
        reference_voltage_V=1.1 * reading.reference_voltage_V,
        supply_voltage_V=1.1 * reading.supply_voltage_V,
    )


def another_sense_resistor(rig):
    """By −4 %, after it has been seen for a while: the rest of the circuit stays what it is."""
    rig.run(6.0)

    def lie(reading):
        more_V = -0.04 * reading.reference_voltage_V
        return replace(
            reading,
            reference_voltage_V=reading.reference_voltage_V + more_V,
            supply_voltage_V=reading.supply_voltage_V + more_V,
        )

    rig.reading_of = lie


def seem_to_grow(rig):
    """A resistance that rises however much it is heated."""
    start_s = rig.bench.time_s
    rig.reading_of = lambda r: replace(r, supply_voltage_V=r.reference_voltage_V * (6.5 + (r.time_s - start_s) * 0.04))
    rig.run(8.0)  # until it is as warm as all the current there is makes it


SCENARIOS = {
    "unhandled_exception": Scenario(raise_in_estimator, mend_estimator),
    "node_lost": reported("node_lost"),
    "loop_hung": reported("loop_hung"),
    "partner_off": reported("partner_off"),
    "command_invalid": Scenario(poison_controller, mend_controller),
    "clock_jump": jump(-5.0),
    "supply_tripped": Scenario(lambda rig: rig.bench.supply.trip("OCP"), lambda rig: rig.supply.clear_trip()),
    "watchdog_not_held": reported("watchdog_not_held"),
    "output_not_confirmed": reported("output_not_confirmed"),
    "limits_not_held": reported("limits_not_held"),
    "second_commander": bench_fault("second_commander", 0.39, tracking=False),
    "supply_lost": lie_about_supply(lambda state: None),
    "daq_lost": lie_about_readings(lambda reading: None),
    "reading_stale": Scenario(repeat_last_reading, lambda rig: setattr(rig, "reading_of", lambda reading: reading)),
    "reading_saturated": bench_fault("channel_saturated", 103),
    "open_wire": bench_fault("open_wire"),
    "short": bench_fault("short_wire", 0.0),
    "reading_implausible": lie_about_readings(lambda r: replace(r, load_cell_voltage_V=r.load_cell_voltage_V - 0.1)),
    "sensor_stuck": bench_fault("channel_stuck", 103),
    "stress_above_limit": weight(3.4, changes={"safety.load_spike": 10.0}),
    "load_spike": bench_fault("load_spike", 2.2),
    "too_hot": bench_fault(
        "hot_ambient",
        95.0,
        tracking=False,
        changes={
            "instruments": {"daq": {"ambient_temperature_channel": 105}},
            "thermal": {"heat_capacity": 1e-5, "derate_temperature": 85.0, "max_temperature": 90.0},
        },
    ),
    "heat_loss_wrong": Scenario(
        cold_but_contracted,
        lambda rig: setattr(rig, "reading_of", lambda reading: reading),
        changes={
            "calibration.hot_end": {"cooling_position": 2.2e-3, "cooling_stress": [2e7], "cooling_rise": [15.0]},
            "safety.voltage_drift": 1.0,
        },
        tracking=False,
    ),
    "ambient_doubted": lie_about_readings(lambda r: replace(r, ambient_temperature_C=-59.0)),
    "supply_disagrees": bench_fault("current_disagrees", 0.6),
    "measurements_disagree": lie_about_supply(lambda state: replace(state, current_A=state.current_A + 0.05)),
    "readings_repeat": Scenario(
        repeat_values_with_new_times, lambda rig: setattr(rig, "reading_of", lambda reading: reading)
    ),
    "load_dead": Scenario(
        only_dither_is_left_of_the_load, lambda rig: setattr(rig, "reading_of", lambda reading: reading), tracking=False
    ),
    "reference_doubted": lie_about_readings(lambda r: replace(r, lvdt_current_A=2.4)),
    "position_contradicted": lie_about_readings(lambda r: replace(r, lvdt_current_A=0.03)),
    "current_drifts": Scenario(another_sense_resistor, lambda rig: setattr(rig, "reading_of", lambda reading: reading)),
    "voltage_drifts": Scenario(
        another_scale_of_the_voltages,
        lambda rig: setattr(rig, "reading_of", lambda reading: reading),
        changes={"safety.current_drift": 1.0},
        tracking=False,
    ),
    "estimator_outside": weight(
        1.5, changes={"model.stress_range": [0.0, 60e6], "safety.outside_calibration_time": 1.0}
    ),
    "loop_overrun": Scenario(slow_loop, keep_rate),
    "setpoint_stale": Scenario(
        lambda rig: None,
        lambda rig: None,
        changes={"controller.setpoint_timeout": 1.0, "controller.on_setpoint_loss": "off"},
    ),
    "no_motion": Scenario(
        seem_to_grow,
        lambda rig: setattr(rig, "reading_of", lambda reading: reading),
        changes={
            "controller.kp": 1e5,
            "controller.setpoint_rate_limit": 1.0,
            # All that the parameters allow: a current that heat has lowered says nothing of an end.
            "thermal.heat_loss_margin": 1.0,
            "thermal.derate_temperature": 300.0,
            "thermal.max_temperature": 400.0,
            "safety.voltage_disagreement": 5.0,
            "safety.voltage_drift": 1.0,
        },
    ),
    "setpoint_flood": Scenario(flood, lambda rig: None),
    "reading_not_finite": bench_fault("channel_nan", 103),
    "estimate_invalid": bench_fault("current_disagrees", 0.45, tracking=False),
    "setpoint_not_finite": Scenario(lambda rig: rig.actuator.offer_setpoint(rig.now_s, math.nan), lambda rig: None),
}

#: Those that are no guards of every step: where they are asked.
ASKED_IN = {
    "command_invalid": supervisor_module,
    "setpoint_stale": following,
    "setpoint_flood": offered,
    "no_motion": following,
    "setpoint_not_finite": offered,
}
#: What the driver sees and the actuator is told; its tests provoke them.
REPORTED = {f.name for f in FAULTS.values() if not isinstance(f, Guard)} - {"unhandled_exception"}
LATCHING = [name for name, fault in FAULTS.items() if fault.latches or fault.action_by]
PASSING = [
    "ambient_doubted",
    "reference_doubted",
    "position_contradicted",
    "reading_not_finite",
    "estimate_invalid",
    "setpoint_not_finite",
    "setpoint_flood",
]


def provoked(make_rig, fault):
    scenario = SCENARIOS[fault]
    rig = make_rig(**scenario.changes)
    rig.enable()
    if scenario.tracking:
        rig.track()
        assert rig.status.mode is Mode.TRACKING
    scenario.provoke(rig)
    return rig, scenario


def test_every_fault_has_a_scenario_and_a_way_to_be_seen():
    assert set(FAULTS) == set(SCENARIOS)
    assert {name for name, fault in FAULTS.items() if not (isinstance(fault, Guard) and fault.each_step)} == {
        *ASKED_IN,
        *REPORTED,
        "unhandled_exception",
    }


def test_no_name_stands_for_both_a_limit_and_a_fault():
    assert not set(LIMITS) & set(FAULTS)


#: What only the driver sees, and the test that measures its time there.
MEASURED_IN_THE_DRIVER = {
    "node_lost": "test_a_node_that_is_gone_is_named_within_the_published_time",
    "partner_off": "test_a_fault_of_one_wire_switches_both_off_within_a_period",
    "loop_hung": "test_the_watchman_cuts_the_supply_and_the_status_says_so",
    "watchdog_not_held": "test_a_setting_that_is_changed_while_driving_is_found_within_the_published_time",
    "limits_not_held": "test_a_setting_that_is_changed_while_driving_is_found_within_the_published_time",
    "output_not_confirmed": "test_an_output_that_stays_on_is_named_within_the_published_time",
}


def test_of_every_fault_the_published_time_is_measured():
    tests = "".join(path.read_text() for path in (Path(__file__).parents[1] / "driver").glob("test_*.py"))
    assert set(MEASURED_IN_THE_DRIVER) == REPORTED
    for name in MEASURED_IN_THE_DRIVER.values():
        assert f"def {name}(" in tests


@pytest.mark.parametrize("fault", [name for name in FAULTS if name not in MEASURED_IN_THE_DRIVER])
def test_fault_is_named_within_the_published_time(make_rig, fault):
    rig, _ = provoked(make_rig, fault)
    within_s = FAULTS[fault].within(rig.config) + rig.period_s  # the cause comes anywhere in a period
    assert rig.seconds_until(fault, within_s) is not None, rig.status
    assert FAULTS[fault].words in rig.status.message


@pytest.mark.parametrize("fault", LATCHING)
class TestLatchingFault:
    def test_switches_the_output_off_in_the_step_that_names_it(self, make_rig, fault):
        rig, _ = provoked(make_rig, fault)
        rig.seconds_until(fault, 10.0)
        assert rig.output.command == Command(0.0, False)
        assert rig.status.mode is Mode.OFF
        rig.skew_s = 0.0
        assert not rig.bench.supply.output_on

    def test_its_output_stays_off_when_its_cause_has_gone_until_cleared_and_enabled(self, make_rig, fault):
        rig, scenario = provoked(make_rig, fault)
        rig.seconds_until(fault, 10.0)
        scenario.relent(rig)
        rig.run(2.0)
        if FAULTS[fault].until_back:
            assert rig.status.fault == ""
        else:
            assert rig.status.fault == fault
            ok, sentence = rig.actuator.enable(rig.now_s, True)
            assert not ok
            assert FAULTS[fault].words in sentence
        assert rig.actuator.offer_setpoint(rig.now_s, 0.003)
        assert rig.run(1.0).command == Command(0.0, False)
        assert rig.actuator.clear_fault(rig.now_s)[0]
        assert rig.run(1.0).command == Command(0.0, False), "cleared is not enabled"
        rig.enable()


@pytest.mark.parametrize("fault", PASSING)
class TestPassingFault:
    def test_leaves_the_output_on_at_no_more_than_its_action_allows(self, make_rig, fault):
        rig, _ = provoked(make_rig, fault)
        before_A = rig.written.current_A
        rig.seconds_until(fault, 1.0)
        most_A = rig.config.supply.bias_current if FAULTS[fault].action is Action.BIAS else 1.5 * before_A + 0.01
        assert rig.output.command.output_on
        assert 0.0 < rig.output.command.current_A <= most_A

    def test_passes_with_its_cause(self, make_rig, fault):
        rig, scenario = provoked(make_rig, fault)
        rig.seconds_until(fault, 1.0)
        mode = rig.status.mode
        scenario.relent(rig)
        rig.run(1.5)
        assert rig.status.fault == ""
        assert rig.status.mode is mode


@pytest.mark.parametrize("fault", sorted(set(FAULTS) - REPORTED - {"unhandled_exception"}))
def test_without_its_guard_the_fault_is_not_seen(make_rig, fault, monkeypatch):
    within = FAULTS[fault].within
    if FAULTS[fault].each_step:
        monkeypatch.setitem(FAULTS, fault, replace(FAULTS[fault], each_step=False))
    else:
        monkeypatch.setattr(ASKED_IN[fault], fault, replace(FAULTS[fault], look=lambda *_: ""))
    rig, _ = provoked(make_rig, fault)
    assert rig.seconds_until(fault, within(rig.config) + 1.0) is None


def test_without_its_guard_an_exception_reaches_the_driver(make_rig, monkeypatch):
    monkeypatch.setattr(Actuator, "step", lambda self, *seen: self._step(*seen, NOT_WAITED, False))
    rig, _ = provoked(make_rig, "unhandled_exception")
    with pytest.raises(ArithmeticError):
        rig.step()


@pytest.mark.parametrize("lie", [math.nan, math.inf, -math.inf], ids=str)
@pytest.mark.parametrize("channel", ["time_s", "supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V"])
def test_a_reading_that_is_not_finite_gives_the_bias_and_then_off(make_rig, channel, lie):
    rig = make_rig()
    rig.enable()
    rig.track()
    rig.reading_of = lambda reading: replace(reading, **{channel: lie})
    before = rig.output.estimate
    rig.step()
    assert rig.status.fault in ("reading_not_finite", "reading_saturated")
    assert rig.output.command.current_A <= rig.config.supply.bias_current
    assert rig.output.estimate.displacement_m == before.displacement_m
    rig.run(rig.config.safety.reading_timeout + 2 * rig.period_s)
    assert rig.output.command == Command(0.0, False)
    assert rig.status.fault in ("reading_stale", "reading_saturated")


@pytest.mark.parametrize("channel", ["supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V"])
def test_each_channel_can_be_stuck(make_rig, channel):
    rig = make_rig()
    rig.enable()
    rig.track(1.0)  # at the bias: with a current that rises another guard is faster
    stands = []

    def stick(reading):
        stands.append(getattr(reading, channel))
        return replace(reading, **{channel: stands[0]})

    rig.reading_of = stick
    assert rig.seconds_until("sensor_stuck", FAULTS["sensor_stuck"].within(rig.config))


@pytest.mark.parametrize(
    "lie",
    [
        lambda r: replace(r, load_cell_voltage_V=-0.1),
        lambda r: replace(r, reference_voltage_V=-r.reference_voltage_V),
        lambda r: replace(r, supply_voltage_V=r.reference_voltage_V * 30.0),
    ],
    ids=["load far below zero", "current backwards", "too much resistance"],
)
def test_what_no_wire_can_give_is_implausible(make_rig, lie):
    rig = make_rig()
    rig.enable()
    rig.reading_of = lie
    assert rig.seconds_until("reading_implausible", 2 * rig.period_s)


@pytest.mark.parametrize("shift_s", [-1e9, -1.0, 1.0, 1e9])
def test_readings_of_another_time_are_stale_and_forgotten(make_rig, shift_s):
    rig = make_rig()
    rig.enable()
    rig.reading_of = lambda reading: replace(reading, time_s=reading.time_s + shift_s)
    assert rig.seconds_until("reading_stale", FAULTS["reading_stale"].within(rig.config))
    rig.reading_of = lambda reading: reading
    rig.run(0.2)
    rig.actuator.clear_fault(rig.now_s)
    rig.enable()


@pytest.mark.parametrize("jump_s", [5.0, -5.0, math.nan], ids=["ahead", "back", "not a number"])
def test_the_clock_must_not_jump(make_rig, jump_s):
    rig = make_rig()
    rig.enable()
    rig.skew_s += jump_s
    assert rig.step().status.fault == "clock_jump"
    assert rig.output.command == Command(0.0, False)


@pytest.mark.parametrize(
    "lie",
    [lambda s: replace(s, output_on=False), lambda s: replace(s, current_setting_A=0.3)],
    ids=["output switched off", "current set"],
)
def test_one_read_back_is_enough_to_see_a_second_commander_while_tracking(make_rig, lie):
    rig = make_rig()
    rig.enable()
    rig.track()
    rig.state_of = lie
    assert rig.step().status.fault == "second_commander"


def test_somebody_else_switching_the_output_on_prevents_enabling(make_rig):
    rig = make_rig()
    rig.bench.supply.set_current(0.2)
    rig.bench.supply.set_output(True)
    rig.run(0.1)
    assert rig.status.fault == "second_commander"
    assert not rig.bench.supply.output_on, "and it is switched off again"
    assert not rig.actuator.enable(rig.now_s, True)[0]


@pytest.mark.parametrize("behind", [1, 4])
def test_a_daq_that_is_late_by_two_tenths_of_a_second_is_no_disagreement(make_rig, behind):
    rig, late = make_rig(), []
    rig.enable()

    def shown(reading):
        late.append(reading)
        return replace(late[-1 - behind] if len(late) > behind else reading, time_s=reading.time_s)

    rig.reading_of = shown
    for position_m in (0.0030, 0.0010, 0.0025, 0.0005):
        rig.track(position_m)
        rig.run(4.0)
        assert rig.status.fault == "", rig.status.message


def test_current_while_the_output_is_off_is_a_disagreement(make_rig):
    rig = make_rig()
    rig.reading_of = lambda r: replace(r, reference_voltage_V=0.1, supply_voltage_V=0.6)
    assert rig.seconds_until("supply_disagrees", FAULTS["supply_disagrees"].within(rig.config))


def test_a_read_back_that_is_not_a_number_counts_as_silence(make_rig):
    rig = make_rig()
    rig.enable()
    rig.state_of = lambda state: replace(state, current_setting_A=math.nan)
    assert rig.seconds_until("supply_lost", FAULTS["supply_lost"].within(rig.config))


def test_a_gap_of_one_reading_does_not_disturb_the_current(make_rig):
    rig = make_rig()
    rig.enable()
    rig.track()
    rig.run(5.0)
    before_A = rig.written.current_A
    assert rig.config.supply.bias_current < before_A < rig.config.supply.max_current
    rig.reading_of = lambda reading: None
    assert rig.step().command.current_A == before_A


def test_while_there_is_no_estimate_the_controller_waits(make_rig):
    rig = make_rig(**{"controller.kp": 0.0, "controller.ki": 50.0})  # the integral alone, far from saturation
    rig.enable()
    rig.track()
    rig.run(2.0)
    genuine, controller = rig.actuator._chain.step, rig.actuator._following.controller

    def blind(signals):
        measured, estimate = genuine(signals)
        return measured, replace(estimate, quality=Quality.INVALID)

    rig.actuator._chain.step = blind
    before_A = controller.integral_A
    rig.run(2.0)
    assert controller.integral_A == before_A
    rig.actuator._chain.step = genuine
    rig.step()
    assert abs(controller.integral_A - before_A) > 0.0
    most_A = rig.config.controller.ki * abs(controller.error_m) * rig.config.safety.reading_timeout
    assert abs(controller.integral_A - before_A) <= most_A * (1 + 1e-9), "nor does it catch up with the gap"


def test_a_pause_of_the_loop_while_the_output_is_off_harms_nobody(make_rig):
    rig = make_rig()
    rig.bench.advance(rig.bench.time_s + 5.0)
    rig.step()
    rig.enable()


def test_the_first_fault_is_the_one_that_stays(make_rig):
    rig = make_rig()
    rig.enable()
    rig.actuator.raise_fault(rig.now_s, "daq_lost", "first")
    rig.actuator.raise_fault(rig.now_s, "supply_lost", "second")
    rig.step()
    assert rig.status.fault == "daq_lost"
    assert "first" in rig.status.message


def test_a_fault_that_is_not_in_the_table_is_refused(make_rig):
    with pytest.raises(ValueError, match="bad_weather"):
        make_rig().actuator.raise_fault(0.0, "bad_weather", "")
