"""Instruments that hear nothing on a serial line until they are told to be remote: opened, driven, left to people."""

import math
import time

import pytest
from accepted import UNSAFE
from families import FAMILIES
from serial_line import SerialInstrument

from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentLost, open_daq, open_supply
from sma_actuator.instruments.clock import MonotonicClock

#: Dialect → what makes it remote and what gives its front panel back, by its manual.
SERIAL = {
    "agilent_e3631a": ("SYST:REM", "SYST:LOC"),
    "agilent_e3632a": ("SYST:REM", "SYST:LOC"),
    "agilent_66xx": ("SYST:REM", "SYST:LOC"),
    "bk_9115": ("SYST:REM", "SYST:LOC"),
    "itech_it6800": ("SYST:REM", "SYST:LOC"),
    "kepco_bop": ("SYST:REM ON", "SYST:REM OFF"),
    "rs_hmp": ("SYST:MIX", "SYST:LOC"),
    "rs_hmc804x": ("SYST:MIX", "SYST:LOC"),
    "rs_nge100": ("SYST:MIX", "SYST:LOC"),
}


class InLocal:
    """An instrument as it comes, in local: it hears nothing but what makes it remote."""

    def __init__(self, answer, remote, local):
        self._answer, self._remote, self._local = answer, remote, local
        self.remote = False
        self.deaf_to: list[str] = []

    def __call__(self, line):
        if line in (self._remote, self._local):
            self.remote = line == self._remote
            if hasattr(self._answer, "remote"):
                self._answer.remote = self.remote
            return None
        if not self.remote:
            self.deaf_to.append(line)
            return None
        return self._answer(line)


def _wait_until(holds):
    deadline_s = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < deadline_s
        time.sleep(0.001)


@pytest.fixture(params=SERIAL)
def stand(request, make_config):
    """(emulator, its state, how to make a supply for it)."""
    emulator = FAMILIES[request.param]()
    instrument = InLocal(emulator, *SERIAL[request.param])
    with SerialInstrument(instrument, hears=emulator.hears, says=emulator.says) as line:
        changes = dict(UNSAFE)
        changes |= {"instruments.supply.resource": line.resource, "instruments.supply.dialect": request.param}
        config = Config.from_mapping(make_config(**changes, **{"supply.watchdog_timeout": 0.0}))
        yield emulator, instrument, lambda: open_supply(config)
        assert emulator.refused == [] and instrument.deaf_to == []


def test_it_is_made_remote_before_anything_and_its_front_panel_is_given_back_with_the_output_off(stand):
    emulator, instrument, make = stand
    supply = make()
    supply.open()
    assert not emulator.out.on and instrument.remote
    supply.set_current(0.1)
    supply.set_output(True)
    assert supply.read_back().output_on and emulator.out.on
    assert supply.shut_down()
    supply.close()
    _wait_until(lambda: not instrument.remote)  # the last line may still be on its way
    assert not emulator.out.on


def test_off_is_heard_although_somebody_has_pressed_its_local_key(stand):
    emulator, instrument, make = stand
    supply = make()
    supply.open()
    supply.set_output(True)
    supply.read_back()
    instrument.remote = False
    assert supply.shut_down()
    assert not emulator.out.on
    supply.close()


def test_who_switches_off_for_a_program_that_is_gone_gives_the_front_panel_back(stand):
    emulator, instrument, make = stand
    emulator.out.on = True
    make().switch_off_beside(10.0)
    assert not emulator.out.on
    _wait_until(lambda: not instrument.remote)  # the last line may still be on its way


def test_a_multiplexer_on_a_serial_line_is_made_remote_too(make_config):
    """34970A: on RS-232, unlike on GPIB, it does not become remote by itself (error 550)."""

    def answer(line):
        replies = {"*IDN?": "HEWLETT-PACKARD,34970A,0,13-2-2", "SYST:ERR?": '+0,"No error"', "READ?": "+1.5,+0.1,+0.3"}
        return replies.get(line)

    instrument = InLocal(answer, "SYST:REM", "SYST:LOC")
    with SerialInstrument(instrument) as line:
        changes = {"instruments.daq.resource": line.resource, "instruments.daq.dialect": "keysight_daq970a"}
        daq = open_daq(Config.from_mapping(make_config(**changes, **{"loop.samples_per_block": 1})), MonotonicClock())
        daq.open()
        reading = daq.read_block()
        assert math.isclose(reading.supply_voltage_V, 1.5) and instrument.remote
        daq.close()
        _wait_until(lambda: not instrument.remote)
        assert instrument.deaf_to == []


def test_one_that_hears_nothing_may_want_to_be_remote(make_config):
    with SerialInstrument(InLocal(lambda line: None, "SYST:REM", "SYST:LOC")) as line:
        changes = {"instruments.daq.resource": line.resource, "instruments.daq.timeout": 0.2}
        with pytest.raises(
            InstrumentLost, match=r"does it obey in remote alone, .*SYST:REM \(remote, in its dialect\)"
        ):
            open_daq(Config.from_mapping(make_config(**changes)), MonotonicClock()).open()
