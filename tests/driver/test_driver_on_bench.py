"""The whole loop against the virtual bench, in its own virtual time: no thread, no waiting, no chance."""

import itertools
import math

import pytest

from sma_actuator.base.signals import Mode
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.safety.faults import FAULTS


class Rig:
    """A driver on a bench, and everything it has put out."""

    def __init__(self, mapping):
        self.config = Config.from_mapping(mapping)
        self.bench = VirtualBench.from_name("flexinol", seed=1)
        self.clock = VirtualClock(self.bench)
        self.outputs = []
        self.supply = InProcessSupply(self.bench, self.config)
        daq = InProcessDaq(self.bench, self.config)
        self.driver = Driver(self.config, self.supply, daq, self.clock, on_output=self.outputs.append)

    @property
    def status(self):
        return self.outputs[-1].status

    def enable(self):
        self.driver.run_for(0.5)
        assert self.driver.enable(True)[0], self.driver.enable(True)[1]
        self.driver.run_for(1.0)
        assert self.bench.supply.output_on

    def run_until(self, condition, within_s):
        """Seconds until ``condition()``; fails when it does not come true in time."""
        start_s = self.bench.time_s
        while not condition():
            assert self.bench.time_s - start_s < within_s, f"not within {within_s} s: {self.status}"
            self.driver.run_for(0.05)
        return self.bench.time_s - start_s


@pytest.fixture
def rig(make_config):
    return lambda **changes: Rig(make_config(**changes))


def test_no_current_flows_before_enable(rig):
    rig = rig()
    rig.driver.run_for(2.0)
    assert len(rig.outputs) > 30
    assert all(output.status.mode is Mode.OFF for output in rig.outputs)
    assert not rig.bench.supply.output_on


def test_what_was_disabled_by_hand_can_be_enabled_again(rig):
    rig = rig()
    rig.enable()
    assert rig.driver.enable(False)[0]
    rig.driver.run_for(1.0)
    assert rig.status.mode is Mode.OFF and rig.status.fault == "", rig.status.message
    rig.enable()
    assert rig.status.mode is Mode.HOLD


def test_a_setpoint_is_reached_by_the_estimate(rig):
    rig = rig()
    rig.enable()
    rig.driver.offer_setpoint(0.0025)
    rig.run_until(lambda: abs(rig.outputs[-1].estimate.displacement_m - 0.0025) < 1e-4, within_s=20.0)
    assert rig.driver.refusals() == []
    assert rig.status.mode is Mode.TRACKING


def test_two_runs_give_the_same_numbers(rig):
    def run():
        one = rig()
        one.enable()
        one.driver.offer_setpoint(0.0025)
        one.driver.run_for(2.0)
        return [(o.signals.time_s, o.command.current_A) for o in one.outputs]

    assert run() == run()


def test_the_loop_keeps_its_rate(rig):
    rig = rig(**{"loop.rate": 100.0, "loop.samples_per_block": 10})
    rig.driver.run_for(0.1)  # the DAQ's first block has to fill
    before = rig.driver.statistics()
    rig.driver.run_for(30.0)
    statistics = rig.driver.statistics()
    assert statistics.steps - before.steps == 3000
    assert statistics.overruns == before.overruns
    assert statistics.period_mean_s == pytest.approx(0.01)
    assert statistics.period_max_s == pytest.approx(0.01)


def test_answers_that_take_longer_than_a_period_are_counted_as_overruns(rig):
    rig = rig(**{"loop.rate": 100.0, "loop.samples_per_block": 10})
    rig.driver.run_for(0.1)
    rig.bench.inject("slow_answers", 0.006)
    rig.driver.run_for(1.0)
    assert 40 <= rig.driver.statistics().overruns <= 60


@pytest.mark.parametrize(
    ("bench_fault", "fault", "instrument"),
    [
        ("supply_hangup", "supply_lost", "supply"),
        ("supply_silent", "supply_lost", "supply"),
        ("daq_hangup", "daq_lost", "daq"),
        ("daq_silent", "daq_lost", "daq"),
    ],
)
class TestLostInstrument:
    def test_the_output_is_off_within_the_watchdogs_time(self, rig, bench_fault, fault, instrument):
        rig = rig(**{"supply.watchdog_timeout": 1.0})
        rig.enable()
        rig.bench.inject(bench_fault)
        # Where the supply itself is cut off, only its watchdog can reach the output.
        rig.run_until(lambda: not rig.bench.supply.output_on, within_s=1.7)
        assert rig.status.fault == fault
        assert list(rig.driver.lost_instruments) == [instrument]

    def test_it_is_found_again_and_the_fault_passes_but_nothing_drives_until_it_is_enabled(
        self, rig, bench_fault, fault, instrument
    ):
        rig = rig()
        rig.enable()
        rig.bench.inject(bench_fault)
        rig.driver.run_for(3.0)
        ok, sentence = rig.driver.clear_fault()
        assert not ok
        assert f"the {instrument} still does not answer" in sentence
        assert rig.status.message.endswith("; ~/enable once it answers again")
        refused, sentence = rig.driver.enable(True)
        assert not refused and "ask again once it answers" in sentence
        rig.driver.run_for(60.0)
        rig.bench.clear(bench_fault)
        rig.run_until(lambda: rig.status.fault == "", within_s=6.0)
        for _ in range(20):
            rig.driver.offer_setpoint(0.002)
            rig.driver.run_for(0.5)
            assert not rig.bench.supply.output_on and rig.status.message == "off"
        rig.enable()
        assert rig.status.fault == ""


def test_attempts_to_reconnect_become_rarer_up_to_the_configured_wait(rig, monkeypatch):
    rig = rig(**{"instruments.reconnect_backoff_max": 1.0})
    rig.driver.run_for(0.2)
    rig.bench.inject("supply_hangup")
    attempts_s = []
    monkeypatch.setattr(
        rig.supply, "open", lambda _open=rig.supply.open: (attempts_s.append(rig.bench.time_s), _open())
    )
    rig.driver.run_for(10.0)
    waits_s = [b - a for a, b in itertools.pairwise(attempts_s)]
    assert waits_s[0] < 0.25
    assert waits_s == sorted(waits_s)
    assert waits_s[-1] == pytest.approx(1.0, abs=0.06)


def test_a_trip_of_the_supply_is_cleared_by_clear_fault(rig):
    rig = rig()
    rig.enable()
    rig.bench.supply.trip("OVP")
    rig.run_until(lambda: rig.status.fault == "supply_tripped", within_s=0.3)
    rig.driver.run_for(0.5)
    ok, sentence = rig.driver.clear_fault()
    assert ok, sentence
    assert rig.bench.supply.trips == []
    rig.enable()


def test_a_commander_that_stops_feeding_is_a_lost_node(make_config):
    one = Rig(make_config())
    fed = Driver(
        one.config,
        one.supply,
        InProcessDaq(one.bench, one.config),
        one.clock,
        on_output=one.outputs.append,
        feed_timeout_s=0.9,
    )
    one.driver = fed
    for _ in range(10):
        fed.feed()
        fed.run_for(0.2)
    fed.feed()
    assert fed.enable(True)[0]
    fed.feed()
    fed.run_for(0.8)
    assert one.bench.supply.output_on
    one.run_until(lambda: not one.bench.supply.output_on, within_s=0.25)
    assert one.status.fault == "node_lost"


def test_live_parameters_reach_the_actuator(rig):
    rig = rig()
    rig.enable()
    rig.driver.offer_setpoint(0.0)
    rig.driver.run_for(3.0)
    hot_C = rig.config.thermal.max_temperature
    rig.driver.update(rig.config.replace({"thermal.derate_temperature": 40.0, "thermal.max_temperature": 41.0}))
    rig.run_until(lambda: rig.status.fault == "too_hot", within_s=1.0)
    assert hot_C > 41.0
    assert not rig.bench.supply.output_on


def test_an_exception_in_the_output_callback_ends_with_the_output_off(rig):
    rig = rig()
    rig.enable()

    def broken(_):
        raise ZeroDivisionError("in the callback")

    rig.driver._on_output = broken
    with pytest.raises(ZeroDivisionError):
        rig.driver.run_for(0.1)
    assert not rig.bench.supply.output_on
    assert rig.bench.supply.current_A == 0.0


def test_every_output_is_a_finite_current_below_the_limit_also_for_a_setpoint_of_nan(rig):
    rig = rig()
    rig.enable()
    for position_m in (math.nan, math.inf, -1.0, 1.0):
        rig.driver.offer_setpoint(position_m)
        rig.driver.run_for(0.5)
    assert rig.driver.refusals()
    assert all(0.0 <= o.command.current_A <= rig.config.supply.max_current for o in rig.outputs)


def test_a_watchdog_that_stopped_holding_is_noticed_before_the_next_enable(rig):
    wire = rig()
    wire.driver.run_for(0.5)
    wire.bench.inject("watchdog_dead", 0.0)
    done, words = wire.driver.enable(True)
    assert not done
    assert "the supply's watchdog does not hold" in words
    wire.driver.run_for(0.5)
    assert not wire.bench.supply.output_on
    assert wire.status.fault == "watchdog_not_held"


def test_the_word_of_a_supply_whose_relay_is_welded_is_not_repeated(rig):
    """Off is told and read back, and current flows on: the status must not say off."""
    wire = rig()
    wire.enable()
    wire.bench.inject("output_welded")
    assert wire.driver.enable(False)[0]
    wire.driver.run_for(0.1)
    wire.bench.supply.set_current(0.2)  # at its front panel
    wire.run_until(lambda: wire.status.fault == "supply_disagrees", within_s=1.5)
    assert wire.bench.truth.current_A == pytest.approx(0.2, rel=0.01) and not wire.bench.supply.output_on
    assert wire.status.message.startswith("the output is read back as off, and 0.2 A flow: pull the supply's plug")
    assert wire.status.values["output"].startswith("read back as off, and")
    wire.bench.clear()
    wire.driver.run_for(1.0)
    assert wire.status.values["output"] == "off"


def test_clearing_no_fault_leaves_a_wire_that_is_driven_as_it_is(rig):
    rig = rig()
    rig.enable()
    assert rig.driver.clear_fault() == (True, "there is no fault to clear")
    rig.driver.run_for(1.0)
    assert rig.bench.supply.output_on
    assert rig.status.fault == ""


def test_a_limit_that_was_changed_behind_the_driver_prevents_enabling_and_is_programmed_again(rig):
    rig = rig()
    rig.driver.run_for(0.5)
    rig.bench.supply.set_ocp(1.0)
    done, words = rig.driver.enable(True)
    assert not done
    assert "a limit of the supply does not hold" in words
    rig.driver.run_for(0.5)
    assert rig.bench.supply.ocp_A == rig.config.supply.over_current_trip
    assert rig.status.fault == "limits_not_held"
    assert rig.driver.clear_fault()[0]
    rig.enable()


@pytest.mark.parametrize("change", ["ocp_A", "voltage_V", "ocp_on", "ovp_on", "watchdog_on"])
def test_a_setting_that_is_changed_while_driving_is_found_within_the_published_time(rig, change):
    rig = rig()
    rig.enable()
    fault = "watchdog_not_held" if change == "watchdog_on" else "limits_not_held"
    setattr(rig.bench.supply, change, {"ocp_A": 1.0, "voltage_V": 12.0}.get(change, False))
    within_s = FAULTS[fault].within(rig.config) + 0.05
    rig.run_until(lambda: rig.status.fault == fault, within_s)
    assert not rig.bench.supply.output_on
    rig.driver.run_for(0.5)
    assert rig.driver.clear_fault()[0]
    rig.enable()


@pytest.mark.parametrize("instrument", ["supply", "daq"])
@pytest.mark.parametrize("manner", ["silent", "hangup"])
@pytest.mark.parametrize("rate_Hz", [5.0, 20.0, 100.0])
def test_a_lost_instrument_is_named_within_the_published_time(rig, instrument, manner, rate_Hz):
    rig = rig(
        **{
            "loop.rate": rate_Hz,
            "loop.samples_per_block": 10,
            "safety.reading_timeout": 0.4 + 1.0 / rate_Hz,
            "loop.overruns_to_fault": 100,
        }
    )
    rig.enable()
    start_s = rig.bench.time_s
    rig.bench.inject(f"{instrument}_{manner}")
    while not rig.status.fault:
        rig.driver.run_for(1e-3)
    assert rig.status.fault == f"{instrument}_lost"
    assert rig.outputs[-1].signals.time_s <= rig.bench.time_s
    assert rig.bench.time_s - start_s <= FAULTS[rig.status.fault].within(rig.config) + 1e-6


@pytest.mark.parametrize("rate_Hz", [1.0, 20.0])
def test_a_node_that_is_gone_is_named_within_the_published_time(make_config, rate_Hz):
    changes = {"loop.rate": rate_Hz, "safety.reading_timeout": 3.0, "supply.watchdog_timeout": 3.0}
    one = Rig(make_config(**changes))
    one.driver = Driver(
        one.config,
        one.supply,
        InProcessDaq(one.bench, one.config),
        one.clock,
        on_output=one.outputs.append,
        feed_timeout_s=0.9,
    )
    one.driver.run_for(2.0)
    one.driver.feed()
    start_s = one.bench.time_s
    while not (one.status.fault == "node_lost" and not one.bench.supply.output_on):
        one.driver.run_for(1e-3)
        assert one.bench.time_s - start_s <= FAULTS["node_lost"].within(one.config) + 1e-6


@pytest.mark.parametrize("rate_Hz", [5.0, 20.0])
def test_an_output_that_stays_on_is_named_within_the_published_time(rig, rate_Hz):
    """The supply answers, and does nothing of what it is told: it is told to be off when another fault is there."""
    rig = rig(**{"loop.rate": rate_Hz, "loop.samples_per_block": 10, "safety.reading_timeout": 0.4 + 1.0 / rate_Hz})
    rig.enable()
    rig.bench.supply.set_output = lambda on: None
    rig.bench.inject("load_spike", 20.0)
    while not rig.status.fault:
        rig.driver.run_for(1e-3)
    start_s = rig.bench.time_s
    within_s = FAULTS["output_not_confirmed"].within(rig.config)
    while not rig.driver.output_words.endswith("not confirmed"):
        rig.driver.run_for(1e-3)
        assert rig.bench.time_s - start_s <= within_s + 1e-6
    done, words = rig.driver.enable(False)
    assert (done, "told to be off, not confirmed" in words) == (False, True)
    rig.driver.run_for(1.0 / rate_Hz)
    assert rig.status.values["output"] == "told to be off, not confirmed"
