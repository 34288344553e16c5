"""Every family with a dialect is driven through its manual's commands: limits, on, set-points, read-back, trip, off,
and `check`."""

import itertools
import time

import pytest
from accepted import UNSAFE
from families import FAMILIES
from serial_line import SerialInstrument
from tcp_line import TcpInstrument

from sma_actuator.base.signals import Reading
from sma_actuator.check.found import passed
from sma_actuator.check.selftest import SelfTest
from sma_actuator.config import Config
from sma_actuator.instruments import LimitsNotHeld, open_supply
from sma_actuator.instruments.clock import MonotonicClock

#: What they take of the common configuration; the coarsest has steps of 10 mA.
CURRENT_A = 0.12


@pytest.fixture(params=FAMILIES)
def family(request, make_config):
    """(emulator, its line, configuration)."""
    name = request.param
    emulator = FAMILIES[name]()
    served = SerialInstrument if emulator.serial else TcpInstrument
    with served(emulator, hears=emulator.hears, says=emulator.says) as line:
        changes = dict(UNSAFE)
        changes |= {"instruments.supply.resource": line.resource, "instruments.supply.dialect": name}
        # a rate that a busy machine keeps
        changes |= {
            "supply.watchdog_timeout": 0.0,
            "loop.rate": emulator.rate_Hz,
            "loop.samples_per_block": 20,
            **emulator.parameters,
        }
        changes |= {"instruments.supply.channel": 6 if name == "tdk_genesys" else 1}
        yield emulator, line, Config.from_mapping(make_config(**changes))
        assert emulator.refused == [], "its manual has no such command"


@pytest.fixture
def opened(family):
    emulator, line, config = family
    supply = open_supply(config)
    supply.open()
    yield emulator, line, supply, config
    supply.close()


def test_it_is_opened_with_its_limits_and_its_output_off(opened):
    emulator, _, supply, config = opened
    out = emulator.out
    assert not out.on
    assert out.set_V == config.supply.max_voltage
    assert out.set_A <= 0.01
    assert not out.trips_in_cc, "it would trip where this driver works"
    if emulator.has_ovp:
        assert out.ovp_V == pytest.approx(config.supply.over_voltage_V)
    if emulator.has_ocp:
        assert out.ocp_A == pytest.approx(config.supply.over_current_trip)
    assert supply.identity == emulator.identity
    assert not emulator.errors


def test_it_is_driven_and_read_back(opened):
    emulator, _, supply, _ = opened
    state = supply.read_back()
    assert (state.output_on, state.voltage_V, state.current_A, state.tripped) == (False, 0.0, 0.0, "")
    supply.set_current(CURRENT_A)
    supply.set_output(True)
    state = supply.read_back()
    assert emulator.out.on and emulator.out.set_A == pytest.approx(CURRENT_A)
    assert (state.output_on, state.tripped) == (True, "")
    assert state.current_setting_A == pytest.approx(CURRENT_A)
    assert state.current_A == pytest.approx(CURRENT_A, abs=5e-3)
    assert state.voltage_V == pytest.approx(CURRENT_A * emulator.out.load_Ohm, abs=5e-3)
    supply.set_current(0.2)
    assert supply.read_back().current_setting_A == pytest.approx(0.2)
    supply.check_settings()
    supply.switch_off()
    assert not emulator.out.on and emulator.out.set_A <= 0.01
    assert not supply.read_back().output_on
    supply.check_settings()
    supply.set_output(True)
    assert supply.shut_down()
    assert not emulator.out.on


def test_a_trip_is_named_and_cleared_with_the_output_off(opened):
    emulator, _, supply, _ = opened
    trips = [name for name, has in (("OVP", emulator.has_ovp), ("OCP", emulator.has_ocp)) if has]
    for name in trips:
        supply.set_current(CURRENT_A)
        supply.set_output(True)
        assert supply.read_back().tripped == ""
        emulator.out.surge_V, emulator.out.surge_A = (10.0, 0.0) if name == "OVP" else (0.0, 1.0)
        state = supply.read_back()
        if not state.tripped:  # one that was asked for it before it measured
            state = supply.read_back()
        assert (state.tripped, state.current_A) == (name if emulator.says_what_tripped else "", 0.0)
        supply.clear_trip()
        state = supply.read_back()
        assert (state.tripped, state.output_on) == ("", False)


def test_a_limit_that_somebody_changes_is_found_where_it_can_be_read_back(opened):
    emulator, _, supply, _ = opened
    emulator.out.set_V = 20.0
    if "voltage_setting" in supply.reads_back:
        with pytest.raises(LimitsNotHeld, match="does not hold supply.max_voltage, 6 V"):
            supply.check_settings()
    else:
        supply.check_settings()


def test_off_is_confirmed_through_a_new_connection_where_the_old_one_is_cut(opened):
    emulator, _, supply, _ = opened
    supply.set_current(CURRENT_A)
    supply.set_output(True)
    supply.read_back()
    supply._session.cut()
    supply._session.close()
    assert supply.shut_down()
    assert not emulator.out.on


class Wire:
    """A DAQ at the emulator's output, with a little noise."""

    identity = "a DAQ"

    def __init__(self, emulator, config, clock):
        self._emulator, self._config, self._clock = emulator, config, clock
        self._noise = itertools.cycle((1e-5, -1e-5))

    def open(self):
        pass

    def close(self):
        pass

    def read_block(self):
        voltage_V, current_A = self._emulator.out.measure()
        noise_V = next(self._noise)
        reference_V = current_A * self._config.circuit.reference_resistance
        return Reading(self._clock.now_s(), voltage_V + noise_V, reference_V + noise_V, 0.05 + noise_V)


def test_check_finds_nothing_wrong(family):
    emulator, _, config = family
    clock = MonotonicClock()
    test = SelfTest(config, open_supply(config), Wire(emulator, config, clock), clock)
    began_s = time.monotonic()
    found = test.run()
    assert passed(found), [each.sentence for each in found]
    assert test.off_confirmed and not emulator.out.on
    assert time.monotonic() - began_s < 60.0


@pytest.mark.parametrize("name", FAMILIES)
def test_what_must_be_accepted_is_what_its_manual_lacks(name, make_config):
    emulator = FAMILIES[name]()
    changes = {
        "instruments.supply.dialect": name,
        "supply.allow_no_watchdog": True,
        "supply.allow_single_session": True,
    }
    reads_back = open_supply(Config.from_mapping(make_config(**changes))).reads_back
    assert ("over_current_trip" in reads_back) == emulator.has_ocp
