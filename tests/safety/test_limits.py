"""Every limit of the table, provoked on the virtual bench: the command is bent, nothing is wrong."""

import itertools
import math
from dataclasses import replace

import pytest
from rig import Rig

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode
from sma_actuator.config import read_parameter_file
from sma_actuator.plant.loads import Spring, Weight
from sma_actuator.safety import supervisor as supervisor_module
from sma_actuator.safety.guards.program import command_invalid
from sma_actuator.safety.guards.wire import short
from sma_actuator.safety.limits import (
    CURRENT_BIAS,
    CURRENT_MAX,
    SETPOINT_RANGE,
    SETPOINT_RATE,
    STRESS_NEAR_LIMIT,
    TEMPERATURE_DERATING,
)
from sma_actuator.safety.supervisor import Supervisor
from sma_actuator.safety.thermal import WireHeat


def shown(rig, limit):
    return limit.name in rig.status.limits


def test_a_setpoint_outside_the_working_range_is_clipped_to_it(make_rig):
    rig = make_rig()
    rig.enable()
    lo_m, hi_m = rig.config.model.displacement_range
    for position_m, expected_m in ((-1e300, lo_m), (0.0, lo_m), (1.0, hi_m), (1e300, hi_m)):
        rig.track(position_m)
        assert rig.output.setpoint_m == expected_m
        assert shown(rig, SETPOINT_RANGE)
    rig.track(0.5 * (lo_m + hi_m))
    assert not shown(rig, SETPOINT_RANGE)


def test_beyond_an_end_at_the_present_load_it_is_held_there_and_nothing_winds_up():
    """A working range is one for all loads: at 0.5 N the wire does not stretch as far as this one says."""
    mapping = read_parameter_file(shared_file("config/furukawa.yaml"))
    mapping["model"]["displacement_range"] = [mapping["model"]["displacement_range"][0], 1.8e-3]
    rig = Rig(mapping, "furukawa", Weight(0.5))
    rig.run(5.0)
    rig.enable()
    _, most_m = rig.config.model.displacement_range
    longest_m = rig.status.values["longest_m"]
    assert longest_m < most_m - 0.3e-3
    rig.track(most_m)
    rig.run(10.0)
    assert shown(rig, SETPOINT_RANGE)
    assert f"at its long end, {longest_m * 1e3:.2f}" in rig.status.message
    assert rig.output.setpoint_m == pytest.approx(longest_m, abs=5e-6)
    assert rig.bench.truth.displacement_m == pytest.approx(longest_m, abs=0.05e-3)
    shortest_m = rig.status.values["shortest_m"]
    rig.track(shortest_m - 1e-3)
    rig.run(10.0)
    assert "at its short end" in rig.status.message
    rig.track(0.5 * (shortest_m + longest_m))
    rig.run(4.0)
    assert not shown(rig, SETPOINT_RANGE)
    assert rig.output.estimate.displacement_m == pytest.approx(0.5 * (shortest_m + longest_m), abs=0.08e-3)


def test_a_setpoint_that_leaps_is_followed_at_its_rate_limit(make_rig):
    rig = make_rig(**{"controller.setpoint_rate_limit": 0.0005})
    rig.enable()
    start_m = rig.status.values["limited_setpoint_m"]
    rig.track(0.0010)
    assert shown(rig, SETPOINT_RATE)
    assert start_m - rig.status.values["limited_setpoint_m"] == pytest.approx(0.0005 * 0.5, rel=1e-6)


def test_the_current_saturates_at_its_maximum_and_says_so(make_rig):
    rig = make_rig(**{"controller.kp": 1e5, "controller.setpoint_rate_limit": 1.0})
    rig.run(5.0)  # until it counts as cold
    rig.enable()
    rig.track(0.0010)
    assert any(CURRENT_MAX.name in output.status.limits for output in rig.outputs)
    assert max(output.command.current_A for output in rig.outputs) == rig.config.supply.max_current


def test_the_current_never_falls_below_the_bias_while_enabled(make_rig):
    rig = make_rig(**{"controller.kp": 1e5, "controller.setpoint_rate_limit": 1.0})
    rig.enable()
    rig.track(0.0030)
    rig.run(1.0)
    rig.track(0.0042)
    assert shown(rig, CURRENT_BIAS)
    assert rig.output.command.current_A == rig.config.supply.bias_current


def spring_rig(make_rig):
    """Contraction raises the stress: 0.5 N at 4 mm and 2 N/mm."""
    rig = make_rig(
        **{
            "wire.max_stress": 150e6,
            "safety.stress_limit_fraction": 0.5,
            "controller.setpoint_rate_limit": 0.002,
            "thermal.heat_loss_margin": 1.0,
        }
    )
    rig.bench.load = Spring(stiffness_N_m=1000.0, preload_N=0.6)
    rig.enable()
    rig.actuator.offer_setpoint(rig.now_s, 0.0)
    return rig


def test_near_the_bound_of_stress_nothing_drives_the_wire_further(make_rig):
    rig = spring_rig(make_rig)
    rig.run(30.0)
    assert any(STRESS_NEAR_LIMIT.name in output.status.limits for output in rig.outputs)
    assert rig.status.mode is Mode.TRACKING, rig.status
    bound_Pa = rig.config.safety.stress_limit_fraction * rig.config.wire.max_stress
    assert max(output.signals.stress_Pa for output in rig.outputs) < 1.3 * bound_Pa


def test_while_the_limit_of_stress_acts_the_current_only_falls(make_rig):
    rig = spring_rig(make_rig)
    rig.run(10.0)
    pairs = [
        (before.command.current_A, after.command.current_A)
        for before, after in itertools.pairwise(rig.outputs)
        if STRESS_NEAR_LIMIT.name in after.status.limits
    ]
    assert pairs
    assert all(after_A <= before_A + 1e-12 for before_A, after_A in pairs)


def test_without_the_limit_of_stress_the_wire_is_driven_into_the_fault(make_rig, monkeypatch):
    monkeypatch.setattr(Supervisor, "watch_stress", lambda *_: None)
    rig = spring_rig(make_rig)
    rig.run(30.0)
    assert rig.status.fault == "stress_above_limit"


HOT = {
    "controller": {"kp": 1e5, "setpoint_rate_limit": 1.0},
    "thermal": {"heat_loss": 2.5e-3, "derate_temperature": 80.0, "max_temperature": 120.0},
}


def test_a_hot_wire_gets_less_current_and_stays_below_the_fault(make_rig):
    rig = make_rig(**HOT)
    rig.bench.load = Weight(2.0)
    rig.enable()
    rig.track(-1.0)
    rig.run(30.0)
    assert shown(rig, TEMPERATURE_DERATING)
    assert rig.status.values["temperature_C"] < rig.config.thermal.max_temperature
    limit_A = rig.status.values["current_limit_A"]
    assert rig.config.supply.bias_current < limit_A < rig.config.supply.max_current
    assert rig.output.command.current_A <= limit_A


def test_without_derating_it_runs_into_the_fault(make_rig, monkeypatch):
    monkeypatch.setattr(supervisor_module, "derated_limit_A", lambda temperature_C, max_current_A, *_: max_current_A)
    monkeypatch.setattr(WireHeat, "power_limit_W", lambda *_: math.inf)
    rig = make_rig(**HOT)
    rig.bench.load = Weight(2.0)
    rig.enable()
    rig.track(-1.0)
    rig.run(30.0)
    assert rig.status.fault == "too_hot"


def test_a_controller_that_asks_for_too_much_is_clipped_at_the_gate(config):
    supervisor = Supervisor(config)
    supervisor.keep_heat(0.0125, 0.05, 60.0, 24.0)  # a wire that has cooled, and whose resistance is known
    command, _ = supervisor.gate(1e6, True, {})
    assert command.current_A == config.supply.max_current
    assert supervisor.latched is None


@pytest.mark.parametrize("wanted_A", [float("nan"), float("inf"), float("-inf"), -1e-9])
def test_what_is_no_current_does_not_pass_the_gate(config, wanted_A):
    supervisor = Supervisor(config)
    command, _ = supervisor.gate(wanted_A, True, {})
    assert (command.current_A, command.output_on) == (0.0, False)
    assert supervisor.latched is command_invalid


@pytest.mark.parametrize("wanted_A", [float("nan"), float("-inf"), -1e-9])
def test_nor_when_nobody_looks_at_it_before(config, wanted_A, monkeypatch):
    monkeypatch.setattr(supervisor_module, "command_invalid", replace(command_invalid, look=lambda wanted_A: ""))
    command, _ = Supervisor(config).gate(wanted_A, True, {})
    assert (command.current_A, command.output_on) == (0.0, False)


def test_with_a_latched_fault_nothing_passes_the_gate(config):
    supervisor = Supervisor(config)
    supervisor.latch(short, "")
    assert supervisor.gate(0.1, True, {})[0].output_on is False
