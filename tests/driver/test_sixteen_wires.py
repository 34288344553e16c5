"""Sixteen wires in one process: the slow, hanging or lost instruments of some delay none of the others."""

import contextlib
import threading
import time

import pytest
from stand_ins import RealClock, StandInDaq, StandInSupply
from waiting import Stalls

from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.instruments import InstrumentUnreachable

MANY = 16
RATE_Hz = 20.0
WATCHED_s = 3.0
SOON_s = 60.0


class Unreachable(StandInDaq):
    """One whose host is down: every attempt to connect takes all the time it has."""

    def open(self):
        if self.lost:
            time.sleep(0.2)
            raise InstrumentUnreachable("stand-in DAQ: no route")


@pytest.fixture
def wires(make_config):
    """Drivers of sixteen wires, all of them driven."""
    drivers = []
    config = Config.from_mapping(
        make_config(**{"loop.rate": RATE_Hz, "safety.reading_timeout": 5.0, "loop.overruns_to_fault": 1000})
    )
    for number in range(MANY):
        supply = StandInSupply()
        daq = Unreachable(supply)
        driver = Driver(config, supply, daq, RealClock(), name=f"wire {number}")
        driver.daq = daq
        driver.start()
        drivers.append(driver)
    yield drivers
    for driver in drivers:
        driver.daq.release.set()
    ends = [threading.Thread(target=driver.stop) for driver in drivers]
    for end in ends:
        end.start()
    for end in ends:
        end.join()


def steps(drivers):
    return [driver.statistics().steps for driver in drivers]


def made_in(drivers, seconds):
    """How many steps each makes in this time."""
    before = steps(drivers)
    time.sleep(seconds)
    return [after - first for first, after in zip(before, steps(drivers), strict=True)]


def test_none_of_the_others_is_late_for_it(wires):
    hung, slow, lost, *others = wires
    usual = min(made_in(others, WATCHED_s))  # on this machine, as busy as it is
    hung.daq.hang = True
    slow.daq.delay_s = 0.4
    lost.daq.lost = True
    assert hung.daq.hanging.wait(SOON_s)
    made = made_in(wires, WATCHED_s)
    assert made[0] <= 1 and made[1] <= WATCHED_s / 0.4 + 2
    assert min(made[3:]) > 0.7 * usual
    for driver in others:  # and each answers who asks it something
        with contextlib.closing(Stalls()) as stalls:
            began_s = time.monotonic()
            done, words = driver.enable(False)
            assert (done, words) == (True, "the output is off")
            assert stalls.since(began_s) < 1.0
