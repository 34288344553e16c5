"""A wire driven over one port: supply and DAQ are one board, spoken to over one connection."""

import pytest
from virtual_board import VirtualBoard

from sma_actuator.base.parameters import ConfigError
from sma_actuator.check.found import Level
from sma_actuator.check.selftest import SelfTest
from sma_actuator.driver import Driver
from sma_actuator.instruments import InstrumentLost, InstrumentRefused


@pytest.fixture
def board():
    return VirtualBoard(load_N=0.49)


@pytest.fixture
def driver(board, monkeypatch):
    config, supply, daq = board.instruments(monkeypatch)
    driver = Driver(config, supply, daq, board)
    driver.open()
    driver.run_for(0.5)
    done, words = driver.enable(True)
    assert done, words
    driver.run_for(3.0)
    yield driver
    driver.stop()
    assert not board.world.heats


def test_the_self_test_finds_nothing_wrong(board, monkeypatch):
    found = SelfTest(*board.instruments(monkeypatch), board).run()
    assert [each for each in found if each.level is Level.WRONG] == []
    assert {each.part for each in found} >= {"bias", "resistance", "linearity", "watchdog", "output"}
    assert not board.world.heats


def test_a_wire_goes_where_it_is_told(board, driver):
    for target_m in (0.0025, 0.0012, 0.0022):
        for _ in range(24):
            driver.offer_setpoint(target_m)
            output = driver.run_for(0.25)
        assert output.status.fault == "", output.status.message
        assert output.estimate.displacement_m == pytest.approx(target_m, abs=0.1e-3)
        assert board.bench.truth.displacement_m == pytest.approx(output.estimate.displacement_m, abs=0.15e-3)


def test_a_cable_that_is_pulled_cuts_the_current_and_all_is_found_again(board, driver):
    board.is_unplugged = True
    pulled_s = board.now_s()
    driver.run_for(0.2)
    assert "daq" in driver.lost_instruments
    while board.world.heats:
        driver.run_for(0.05)
    assert board.now_s() - pulled_s <= board.config.supply.watchdog_timeout + 0.1
    board.is_unplugged = False
    driver.run_for(3.0)
    assert not driver.lost_instruments
    assert driver.output_is_off
    assert driver.clear_fault()[0]
    done, words = driver.enable(True)
    assert done, words
    driver.run_for(0.5)
    assert board.world.heats


def test_a_board_that_starts_anew_is_found_again_and_does_not_go_on_by_itself(board, driver):
    board.board.reset()
    driver.run_for(1.0)
    assert not board.world.heats
    assert driver.run_for(0.1).status.fault


def test_the_daq_does_not_open_the_line_before_the_supply(board, monkeypatch):
    _, supply, daq = board.instruments(monkeypatch)
    with pytest.raises(InstrumentLost, match="not connected"):
        daq.open()
    supply.open()
    daq.open()
    daq.close()
    assert not supply.read_back().output_on
    supply.close()


def test_a_port_has_one_program(board, monkeypatch):
    _, supply, _ = board.instruments(monkeypatch)
    _, other, _ = board.instruments(monkeypatch)
    supply.open()
    with pytest.raises(InstrumentRefused, match="only one may"):
        other.open()
    supply.close()


def test_one_line_has_one_manner(board, monkeypatch):
    with pytest.raises(ConfigError, match=r"instruments\.daq: has the same resource as instruments\.supply"):
        board.instruments(monkeypatch, command_pause=0.01)
