"""The bench as an object: time, loads, measuring chain, protections, faults."""

import math

import numpy as np
import pytest

from sma_actuator.bench import Chain, Schedule, Setup, Spring, VirtualBench, Weight
from sma_actuator.bench.chain import LSB_V
from sma_actuator.bench.faults import FAULTS, parse_fault
from sma_actuator.bench.supply import SettingRefused
from sma_actuator.plant.loads import parse_load
from sma_actuator.plant.materials import WIRES


def powered(name="flexinol", current_A=0.2, **kwargs):
    bench = VirtualBench.from_name(name, **kwargs)
    bench.supply.set_voltage(6.0)
    bench.supply.set_current(current_A)
    bench.supply.set_output(True)
    return bench


def test_a_seed_fixes_every_sample_however_the_bench_is_asked():
    slow, fast, other = powered(seed=7), powered(seed=7), powered(seed=8)
    for i in range(1, 301):
        slow.advance(i / 1000)
        slow.daq.block(1)
    fast.advance(0.3)
    other.advance(0.3)
    np.testing.assert_array_equal(slow.daq.block(100)[0], fast.daq.block(100)[0])
    assert (other.daq.block(100)[0] != fast.daq.block(100)[0]).any()


def test_time_stands_still_for_the_past():
    bench = powered()
    bench.advance(0.5)
    before = bench.truth
    bench.advance(0.2)
    assert bench.truth == before and bench.time_s == 0.5


def test_the_chain_obeys_its_calibrations_without_noise():
    chain = Chain(noise_V=(0.0,) * 5, quantised=False)
    bench = VirtualBench(Setup(WIRES["flexinol"], chain, Weight(0.98), 22.0))
    bench.supply.set_voltage(6.0)
    bench.supply.set_current(0.1)
    bench.supply.set_output(True)
    bench.advance(0.5)
    (net_V, ref_V, cell_V, shunt_V, ambient_C), truth = bench.daq.block(1)[0][0], bench.truth
    assert ref_V == pytest.approx(0.1 * 1.0)
    assert 1.0 * (net_V / ref_V - 1.0) - 0.25 == pytest.approx(truth.resistance_Ohm, rel=1e-4)
    assert 12.7297 * cell_V - 0.0598 == pytest.approx(0.98)
    assert 0.315842 * shunt_V / 10.0 - 1.2195e-3 == pytest.approx(truth.displacement_m)
    assert ambient_C == 22.0


def test_the_converter_has_sixteen_bits_and_noise_averages_out():
    bench = powered(current_A=0.05)
    bench.advance(2.0)
    samples, times_s = bench.daq.block(1000)
    steps = samples[:, 1] / LSB_V
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert 0.5 < samples[:, 1].std() / 1.5e-4 < 1.5
    assert samples[:, 1].mean() == pytest.approx(0.05, abs=2e-5)
    np.testing.assert_allclose(np.diff(times_s), 1e-3, rtol=1e-9)
    assert times_s[-1] == bench.time_s


def test_more_samples_than_exist_are_refused():
    bench = powered()
    bench.advance(0.01)
    with pytest.raises(ValueError, match="10 exist"):
        bench.daq.block(11)


def test_current_and_voltage_limit_each_other_within_milliseconds():
    bench = powered(current_A=0.3)
    bench.advance(0.005)
    assert bench.truth.current_A == pytest.approx(0.3, rel=1e-4)
    bench.supply.set_voltage(1.0)
    bench.advance(0.010)
    assert bench.truth.current_A == pytest.approx(1.0 / (bench.truth.resistance_Ohm + 1.25), rel=1e-3)
    assert bench.voltage_V == pytest.approx(1.0, rel=1e-3)


def test_loads_act_when_they_should():
    bench = powered(load=Schedule([(0.0, Weight(0.5)), (0.5, Weight(1.5)), (1.0, Spring(100.0, 1.0))]))
    for until_s, force_N in ((0.499, 0.5), (0.502, 1.5), (0.999, 1.5)):
        bench.advance(until_s)
        assert bench.truth.load_N == pytest.approx(force_N)
    bench.advance(1.01)
    assert bench.truth.load_N == pytest.approx(1.0 + 100.0 * (0.004 - bench.truth.displacement_m), abs=1e-6)


@pytest.mark.parametrize(
    "text", ["", "weight", "weight:x", "weight:-1", "weight:nan", "spring:5", "schedule:1,2,0,3", "rope:1"]
)
def test_an_impossible_load_is_refused_in_a_sentence(text):
    with pytest.raises(ValueError, match="no load"):
        parse_load(text)


def test_an_unknown_wire_or_fault_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="flexinol, furukawa"):
        VirtualBench.from_name("nitinol")
    with pytest.raises(ValueError, match="open_wire"):
        powered().inject("earthquake")
    with pytest.raises(ValueError, match="no channel 7"):
        powered().inject("channel_stuck", 7)


@pytest.mark.parametrize("value", [-0.1, 1.1, math.nan, math.inf])
def test_the_supply_refuses_what_is_outside_its_range(value):
    supply = powered().supply
    with pytest.raises(SettingRefused) as refused:
        supply.set_current(value)
    assert refused.value.code == -222 and supply.current_A == pytest.approx(0.2)


@pytest.mark.parametrize("name", ["OCP", "OVP"])
def test_a_protection_trips_latches_and_cuts(name):
    bench = powered(current_A=0.3)
    bench.supply.set_ocp(0.2) if name == "OCP" else bench.supply.set_ovp(1.5)
    bench.advance(0.02)
    assert bench.supply.trips == [name] and not bench.supply.output_on
    assert bench.truth.current_A < 1e-3
    with pytest.raises(SettingRefused):
        bench.supply.set_output(True)
    bench.supply.clear_trips()
    assert not bench.supply.output_on


def test_the_watchdog_cuts_when_it_says_and_not_before():
    bench = powered()
    bench.supply.set_watchdog_delay(0.5)
    bench.supply.watchdog_on = True
    bench.advance(0.4)
    bench.supply.heard(bench.time_s)
    bench.advance(0.899)
    assert bench.supply.output_on
    bench.advance(0.901)
    assert bench.supply.trips == ["WDOG"] and not bench.supply.output_on
    bench.advance(0.91)
    assert bench.truth.current_A == pytest.approx(0.0, abs=1e-6)


def _current_after(fault, value=math.nan, current_A=0.3):
    bench = powered(current_A=current_A)
    bench.advance(0.5)
    bench.inject(fault, value)
    bench.advance(1.0)
    return bench


def test_fault_open_wire():
    bench = _current_after("open_wire")
    assert bench.truth.current_A == 0.0 and bench.voltage_V == pytest.approx(6.0)
    bench.clear("open_wire")
    bench.advance(1.1)
    assert bench.truth.current_A == pytest.approx(0.3)


def test_fault_short_wire():
    bench = _current_after("short_wire")
    assert bench.voltage_V == pytest.approx(0.3 * 1.25, rel=1e-3)
    assert bench.truth.temperature_C < powered_temperature_C()


def powered_temperature_C():
    bench = powered(current_A=0.3)
    bench.advance(0.5)
    return bench.truth.temperature_C


def test_fault_channel_stuck():
    bench = _current_after("channel_stuck", 102)
    samples = bench.daq.block(100)[0]
    assert np.ptp(samples[:, 1]) == 0.0 and np.ptp(samples[:, 0]) > 0.0


def test_fault_channel_swapped():
    bench = _current_after("channel_swapped", 103)
    swapped = bench.daq.block(100)[0]
    bench.clear()
    assert (swapped[:, [0, 1, 3, 2, 4]] == bench.daq.block(100)[0]).all()
    with pytest.raises(ValueError, match="no channel 105"):
        bench.inject("channel_swapped", 105)


def test_fault_channel_sinks():
    bench = powered()
    bench.advance(0.5)
    before_V = bench.daq.block(100)[0][:, 2].mean()
    bench.inject("channel_sinks", 103)
    bench.advance(2.55)
    assert bench.daq.block(100)[0][:, 2].mean() == pytest.approx(0.81 * before_V, rel=0.01)


def test_fault_channel_saturated():
    assert (_current_after("channel_saturated", 103).daq.block(10)[0][:, 2] > 1e30).all()


def test_fault_channel_nan():
    samples = _current_after("channel_nan", 101).daq.block(10)[0]
    assert np.isnan(samples[:, 0]).all() and np.isfinite(samples[:, 1:]).all()


def test_fault_load_spike():
    assert _current_after("load_spike", 3.0).truth.load_N == pytest.approx(0.98 + 3.0)


def test_fault_current_disagrees():
    bench = _current_after("current_disagrees", 0.5)
    assert bench.truth.current_A == pytest.approx(0.15) and bench.supply.current_A == pytest.approx(0.3)


def test_fault_output_welded():
    bench = _current_after("output_welded")
    bench.supply.set_output(False)
    bench.advance(bench.time_s + 0.1)
    assert bench.truth.current_A == pytest.approx(0.3) and not bench.supply.output_on


def test_fault_second_commander():
    assert _current_after("second_commander", 0.1).supply.current_A == pytest.approx(0.1)


def test_fault_watchdog_dead():
    bench = powered()
    bench.inject("watchdog_dead")
    bench.supply.set_watchdog_delay(0.1)
    bench.supply.watchdog_on = True
    bench.advance(1.0)
    assert bench.supply.output_on and bench.supply.watchdog_on


@pytest.mark.parametrize(("fault", "warmer"), [("draught", False), ("hot_ambient", True)])
def test_faults_of_the_surroundings(fault, warmer):
    plain = powered(current_A=0.3)
    plain.advance(1.0)
    assert (_current_after(fault).truth.temperature_C > plain.truth.temperature_C) == warmer


def test_a_fault_can_be_timed():
    bench = powered()
    bench.inject("load_spike", 2.0, at_s=0.5)
    bench.advance(0.499)
    assert bench.truth.load_N == pytest.approx(0.98)
    bench.advance(0.51)
    assert bench.truth.load_N == pytest.approx(2.98)


def test_the_words_of_the_command_line():
    assert parse_fault("load_spike=4@12.5") == ("load_spike", 4.0, 12.5)
    name, value, at_s = parse_fault("open_wire")
    assert name == "open_wire" and math.isnan(value) and at_s == 0.0
    with pytest.raises(ValueError, match="NAME=VALUE@SECONDS"):
        parse_fault("load_spike=much")


def test_every_fault_says_what_its_value_is():
    for fault in FAULTS.values():
        assert bool(fault.value) == math.isfinite(fault.default), fault


def test_a_wire_goes_on_from_the_cycles_it_has_done():
    def pulse(bench):
        for current_A, seconds in ((0.34, 6.0), (0.05, 12.0)):
            bench.supply.set_current(current_A)
            bench.advance(bench.time_s + seconds)
            yield bench.truth.displacement_m

    worked = powered(physics="in_training")
    first, *_, last = [place_m for _ in range(4) for place_m in pulse(worked)][::2]
    assert worked.cycles == 4.0
    again, _ = pulse(powered(physics="in_training", cycles=3.0))
    assert abs(again - last) < 0.1 * abs(last - first)
