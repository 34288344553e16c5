"""What the driver does with its instruments where leaving it out would leave the current on."""

import pytest
from stand_ins import StandInDaq, StandInSupply

from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config
from sma_actuator.driver import Driver, DriverStopped
from sma_actuator.instruments import InstrumentLost


class NotedSupply(InProcessSupply):
    """The bench's supply, with what it is told."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.told = []

    def set_current(self, current_A):
        self.told.append(f"current {current_A:g}")
        super().set_current(current_A)

    def set_output(self, on):
        self.told.append(f"output {on}")
        super().set_output(on)

    def switch_off(self):
        self.told.append("off")
        super().switch_off()

    def shut_down(self):
        self.told.append("shut down")
        return super().shut_down()

    def clear_trip(self):
        self.told.append("clear")
        super().clear_trip()

    def close(self):
        self.told.append("close")
        super().close()


@pytest.fixture
def rig(make_config):
    """(driver, supply, bench) in the bench's time, readings there, output off."""
    config = Config.from_mapping(make_config())
    bench = VirtualBench.from_name("flexinol", seed=1)
    supply = NotedSupply(bench, config)
    driver = Driver(config, supply, InProcessDaq(bench, config), VirtualClock(bench))
    driver.run_for(0.5)
    yield driver, supply, bench
    driver.stop()


def _driven(driver):
    assert driver.enable(True)[0]
    driver.run_for(1.0)


def test_clearing_a_fault_says_off_whatever_the_supply_was_told_before(rig):
    driver, supply, bench = rig
    _driven(driver)
    bench.inject("load_spike", 20.0)
    driver.run_for(0.5)
    bench.clear("load_spike")
    driver.run_for(0.5)
    bench.supply.set_output(True)  # behind the driver's back
    supply.told.clear()
    done, words = driver.clear_fault()
    assert done, words
    assert supply.told[:2] == ["clear", "off"]
    assert not bench.supply.output_on


def test_disabling_says_off_at_once_and_not_with_the_next_step(rig):
    driver, supply, bench = rig
    _driven(driver)
    supply.told.clear()
    assert driver.enable(False)[0]
    assert supply.told == ["off"]
    assert not bench.supply.output_on
    assert bench.supply.current_A == 0.0


def test_an_output_that_was_switched_on_by_another_is_switched_off(rig):
    driver, supply, bench = rig
    bench.supply.set_output(True)
    supply.told.clear()
    driver.run_for(0.1)
    assert "off" in supply.told
    assert not bench.supply.output_on


def test_the_same_current_is_not_sent_twice_and_another_is(rig):
    driver, supply, _ = rig
    assert driver.enable(True)[0]
    supply.told.clear()
    driver.run_for(0.2)  # bias alone, while it settles
    assert supply.told == ["current 0.05", "output True"]
    driver.run_for(1.0)
    driver.offer_setpoint(0.0)
    driver.run_for(0.5)
    assert len([line for line in supply.told if line.startswith("current")]) > 3
    assert supply.told.count("output True") == 1


def test_an_exception_shuts_the_supply_down_and_gives_both_instruments_up(rig):
    driver, supply, bench = rig
    _driven(driver)
    supply.told.clear()

    def raises():
        raise ZeroDivisionError

    supply.read_back = raises
    with pytest.raises(ZeroDivisionError):
        driver.run_for(0.1)
    assert supply.told == ["shut down", "close"]
    assert not bench.supply.output_on
    with pytest.raises(DriverStopped):
        driver.enable(True)
    with pytest.raises(DriverStopped):
        driver.tick()


def test_stopping_twice_shuts_down_once(rig):
    driver, supply, _ = rig
    _driven(driver)
    supply.told.clear()
    driver.stop()
    driver.stop()
    assert supply.told == ["shut down", "close"]


class UnopenedDaq(StandInDaq):
    def __init__(self, supply):
        super().__init__(supply)
        self.lost = True
        self.closed = 0

    def close(self):
        self.closed += 1


def test_a_daq_that_cannot_be_opened_shuts_the_opened_supply_down(make_config):
    config = Config.from_mapping(make_config())
    supply = StandInSupply()
    daq = UnopenedDaq(supply)
    driver = Driver(config, supply, daq, VirtualClock(VirtualBench.from_name("flexinol")))
    with pytest.raises(InstrumentLost):
        driver.open()
    assert (supply.opened, supply.shut_downs, daq.closed) == (1, 1, 1)
    with pytest.raises(DriverStopped):
        driver.start()


@pytest.mark.parametrize("name", ["node_lost", "unhandled_exception", "watchdog_not_held"])
def test_what_only_the_driver_sees_latches_also_while_the_output_is_off(rig, name):
    driver, _, _ = rig
    driver.call(lambda actuator, now_s: actuator.raise_fault(now_s, name, "as a test says"))
    done, words = driver.enable(True)
    assert not done
    assert "as a test says" in words
    assert driver.clear_fault()[0]
    driver.run_for(0.1)
    assert driver.enable(True)[0]
