"""A wire that truly can go no further, or has nothing left to pull at: seen within two seconds on the bench, and
safe."""

import pytest
from rig import Rig

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Mode, Quality
from sma_actuator.config import read_parameter_file
from sma_actuator.plant.loads import Spring, Weight
from sma_actuator.safety.limits import STRESS_NEAR_LIMIT

SOON_s = 2.0


def held(wire, load):
    """A wire that stands in the middle of the range that it has under that load, and the end it is then asked to go
    to."""
    rig = Rig(read_parameter_file(shared_file(f"config/{wire}.yaml")), wire=wire, load=load)
    rig.run(6.0)
    rig.enable()
    short_m, long_m = (rig.status.values[name] for name in ("shortest_m", "longest_m"))
    go(rig, 0.5 * (short_m + long_m), 8.0)
    return rig, short_m + 0.05 * (long_m - short_m)


def go(rig, place_m, seconds):
    """What was put out meanwhile."""
    before = len(rig.outputs)
    for _ in range(round(seconds / rig.period_s)):
        rig.actuator.offer_setpoint(rig.now_s, place_m)
        rig.step()
    return rig.outputs[before:]


@pytest.mark.parametrize("wire", ["flexinol", "furukawa"])
def test_a_wire_that_is_held_fast_is_seen_by_its_stress_and_off_where_it_is_beyond_what_it_may_carry(wire):
    """The heat that it has pulls on for a moment: up to 3 % beyond."""
    rig, end_m = held(wire, Weight(0.98))
    rig.bench.load = Spring(2e4, rig.output.signals.load_N, rig.bench.truth.displacement_m)
    since = go(rig, end_m, SOON_s)
    assert any(STRESS_NEAR_LIMIT.name in output.status.limits or output.status.fault for output in since)
    since += go(rig, end_m, 2.0)
    most_N = rig.config.wire.max_stress * rig.config.wire.area_m2
    beyond = [output.status.mode for output in since if output.signals.load_N > most_N]
    assert all(mode is Mode.OFF for mode in beyond[2:])
    assert rig.bench.hottest_C < rig.config.thermal.max_temperature


@pytest.mark.parametrize("wire", ["flexinol", "furukawa"])
def test_a_wire_whose_spring_broke_is_said_to_be_outside_its_calibration_and_goes_off(wire):
    rig, end_m = held(wire, Spring(150.0, 0.8))
    rig.bench.load = Weight(0.0)
    since = go(rig, end_m, SOON_s)
    assert any(output.estimate.quality is Quality.OUTSIDE_CALIBRATION for output in since)
    go(rig, end_m, rig.config.safety.outside_calibration_time)
    assert rig.status.mode is Mode.OFF and rig.status.fault == "estimator_outside"
    assert rig.bench.hottest_C < rig.config.thermal.max_temperature
