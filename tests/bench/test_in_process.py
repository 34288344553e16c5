"""The instruments without sockets: they do what the interfaces promise, faults included."""

import math

import pytest

from sma_actuator.bench import InProcessDaq, InProcessSupply, VirtualBench, VirtualClock
from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentLost, InstrumentRefused


@pytest.fixture
def rig(make_config):
    config = Config.from_mapping(
        make_config(instruments={"daq": {"lvdt_channel": 104, "ambient_temperature_channel": 105}})
    )
    bench = VirtualBench.from_name("flexinol")
    return bench, VirtualClock(bench), InProcessSupply(bench, config), InProcessDaq(bench, config)


def test_open_sets_the_limits_and_drives_nothing(rig):
    bench, _clock, supply, daq = rig
    supply.open()
    daq.open()
    assert not bench.supply.output_on and bench.supply.voltage_V == 6.0 and bench.supply.ocp_A == 0.45
    assert bench.supply.watchdog_on and bench.supply.watchdog_delay_s == 1.0
    assert "Virtual Supply" in supply.identity and "Virtual DAQ" in daq.identity


def test_what_is_commanded_is_read_back_and_measured(rig):
    bench, clock, supply, daq = rig
    supply.open()
    daq.open()
    supply.set_current(0.2)
    supply.set_output(True)
    clock.sleep_until_s(0.5)
    state, reading = supply.read_back(), daq.read_block()
    assert state.output_on and state.current_setting_A == pytest.approx(0.2) and state.current_A == pytest.approx(0.2)
    assert reading.time_s == clock.now_s() == 0.5
    assert reading.reference_voltage_V == pytest.approx(0.2, abs=2e-4)
    assert reading.ambient_temperature_C == pytest.approx(22.0, abs=0.05)
    assert 0.315842 * reading.lvdt_current_A - 1.2195e-3 == pytest.approx(bench.truth.displacement_m, abs=2e-5)


def test_silence_costs_the_timeout_and_is_a_loss(rig):
    bench, clock, supply, daq = rig
    supply.open()
    daq.open()
    bench.inject("supply_silent")
    bench.inject("daq_silent")
    with pytest.raises(InstrumentLost):
        supply.set_current(0.1)
    assert clock.now_s() == pytest.approx(0.2) and bench.supply.current_A == 0.0
    with pytest.raises(InstrumentLost):
        daq.read_block()


def test_after_a_hangup_it_must_be_opened_again(rig):
    bench, _clock, supply, _daq = rig
    supply.open()
    bench.inject("supply_hangup")
    with pytest.raises(InstrumentLost):
        supply.read_back()
    bench.clear("supply_hangup")
    with pytest.raises(InstrumentLost, match="not open"):
        supply.read_back()
    supply.open()
    assert supply.read_back().tripped == ""


def test_silence_lets_the_watchdog_cut(rig):
    bench, clock, supply, _daq = rig
    supply.open()
    supply.set_current(0.1)
    supply.set_output(True)
    bench.inject("supply_silent")
    clock.sleep_until_s(1.1)
    assert not bench.supply.output_on
    bench.clear()
    assert supply.read_back().tripped == "WDOG"
    supply.clear_trip()
    assert supply.read_back().tripped == "" and not supply.read_back().output_on


def test_a_watchdog_that_reads_back_off_is_refused(rig):
    bench, _clock, supply, _daq = rig
    bench.inject("watchdog_dead", 0)
    with pytest.raises(InstrumentRefused, match="watchdog"):
        supply.open()


@pytest.mark.parametrize("current_A", [-0.1, 1.5, math.nan, math.inf])
def test_an_impossible_current_is_refused(rig, current_A):
    _bench, _clock, supply, _daq = rig
    supply.open()
    with pytest.raises(InstrumentRefused, match="-222"):
        supply.set_current(current_A)


def test_slow_answers_take_bench_time(rig):
    bench, clock, supply, _daq = rig
    supply.open()
    bench.inject("slow_answers", 0.2)
    supply.read_back()
    assert clock.now_s() == pytest.approx(0.2)
    bench.inject("slow_answers", 0.8)
    with pytest.raises(InstrumentLost):
        supply.read_back()


def test_shut_down_never_raises_and_cuts_where_it_can(rig):
    bench, _clock, supply, _daq = rig
    supply.shut_down()
    supply.open()
    supply.set_current(0.3)
    supply.set_output(True)
    bench.inject("supply_hangup")
    supply.shut_down()
    assert bench.supply.output_on
    bench.clear()
    supply.shut_down()
    assert not bench.supply.output_on and bench.supply.current_A == 0.0


def test_a_channel_that_does_not_exist_is_refused(make_config):
    config = Config.from_mapping(make_config(instruments={"daq": {"lvdt_channel": 209}}))
    with pytest.raises(InstrumentRefused, match="209"):
        InProcessDaq(VirtualBench.from_name("flexinol"), config).open()
