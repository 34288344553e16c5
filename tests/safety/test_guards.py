"""Guards at their bounds, one step at a time."""

import math
from dataclasses import replace

import pytest

from sma_actuator.base.signals import Command, Reading
from sma_actuator.safety.guards.wire import COMPLIANCE
from sma_actuator.safety.supervisor import Supervisor


@pytest.mark.parametrize(("share", "seen"), [(COMPLIANCE - 0.01, False), (COMPLIANCE + 0.01, True)])
def test_a_wire_is_open_only_at_the_compliance_voltage(make_rig, share, seen):
    rig = make_rig()
    rig.enable()
    volts = share * rig.config.supply.max_voltage
    rig.reading_of = lambda r: replace(
        r, supply_voltage_V=volts + 1e-4 * r.load_cell_voltage_V, reference_voltage_V=1e-4
    )
    rig.step()
    rig.step()
    assert (rig.status.fault == "open_wire") == seen, rig.status


def test_what_stood_still_before_the_output_went_off_does_not_count_after_it(make_rig):
    rig = make_rig()
    rig.enable()
    voltage_V = rig.daq.read_block().load_cell_voltage_V
    rig.reading_of = lambda r: replace(r, load_cell_voltage_V=voltage_V)
    rig.run(0.8 * rig.config.safety.stuck_time)
    rig.actuator.enable(rig.now_s, False)
    rig.run(0.8 * rig.config.safety.stuck_time)
    assert rig.actuator.enable(rig.now_s, True)[0]
    rig.run(0.5 * rig.config.safety.stuck_time)
    assert rig.status.fault == "", rig.status


@pytest.mark.parametrize("channel", ["supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V"])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_channel_at_either_end_of_its_range_is_not_used(config, channel, sign):
    supervisor, good = Supervisor(config), Reading(1.0, 0.3, 0.05, 0.04)
    assert supervisor.usable(good, 0.0, 1.0) is good
    bad = replace(good, **{channel: sign * config.safety.channel_max_voltage})
    assert supervisor.usable(bad, 0.0, 1.0) is None


def test_whatever_the_limits_say_no_more_than_max_current_passes(config, monkeypatch):
    monkeypatch.setattr(Supervisor, "_derated_A", lambda self: math.inf)
    command, _ = Supervisor(config).gate(1e6, True, {})
    assert command == Command(config.supply.max_current, True)


@pytest.mark.parametrize(
    ("channel", "number", "field", "fault"),
    [
        ("lvdt_channel", 104, "lvdt_current_A", "reference_doubted"),
        ("ambient_temperature_channel", 105, "ambient_temperature_C", "ambient_doubted"),
    ],
)
def test_a_sensor_that_the_parameters_name_and_that_gives_no_number_is_missed(make_rig, channel, number, field, fault):
    """The wire is driven on without it, and whoever looks is told; without a sensor there is nothing to tell."""
    for there in (number, 0):
        rig = make_rig(**{f"instruments.daq.{channel}": there})
        rig.enable()
        rig.track()
        rig.reading_of = lambda r: replace(r, **{field: math.nan})
        rig.run(0.2)
        assert rig.status.fault == (fault if there else ""), rig.status.message
        assert (f"{channel} says that there is one" in rig.status.message) == bool(there)
        assert rig.output.command.current_A > rig.config.supply.bias_current
