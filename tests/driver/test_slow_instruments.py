"""Instruments that are slow and honest: what they allow is measured and said, and what is asked of them is waited
for."""

import re
import threading
import time

import pytest
from waiting import Elapsed

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.bench.server import background
from sma_actuator.check.found import Level
from sma_actuator.check.selftest import SelfTest
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.instruments import highest_rate_Hz, open_daq, open_supply
from sma_actuator.instruments.clock import MonotonicClock

SOON_s = 60.0


@pytest.fixture
def slow(make_config):
    """``slow(delay_s, rate_Hz, **parameters)``: a running driver of a bench whose every answer takes that long, and the
    bench."""
    ends = []

    def make(delay_s, rate_Hz, **parameters):
        virtual = VirtualBench.from_name("flexinol")
        virtual.advance(0.01)
        context = background(virtual)
        server = context.__enter__()
        ends.append(lambda: context.__exit__(None, None, None))
        timeout_s = 4.0
        changes = {
            "loop.rate": rate_Hz,
            "safety.reading_timeout": 2.0 * timeout_s + 2.0 / rate_Hz,
            "supply.watchdog_timeout": 60.0,
            "loop.overruns_to_fault": 1000,
        }
        for role in ("supply", "daq"):
            changes[f"instruments.{role}.resource"] = f"TCPIP::127.0.0.1::{server.ports[0][role]}::SOCKET"
            changes[f"instruments.{role}.timeout"] = timeout_s
        config = Config.from_mapping(make_config(**{**changes, **parameters}))
        outputs = []
        clock = MonotonicClock()
        driver = Driver(config, open_supply(config), open_daq(config, clock), clock, on_output=outputs.append)
        ends.append(driver.stop)
        driver.open()
        driver._supply._session.tell(f"BENC:FAUL slow_answers,{delay_s}")
        driver.start()
        elapsed = Elapsed()
        while len(outputs) < 6:
            assert elapsed.look() < SOON_s
            time.sleep(0.01)
        return driver, virtual

    yield make
    for end in reversed(ends):
        end()


def enabled(driver):
    """Enable, as often as a machine that stalls wants it; the last answer."""
    elapsed = Elapsed()
    while True:
        done, words = driver.enable(True, timeout_s=SOON_s)
        if done or elapsed.look() > SOON_s:
            return done, words
        driver.clear_fault(SOON_s)
        time.sleep(0.1)


def test_at_1_Hz_with_answers_of_a_third_of_a_second_it_is_driven(slow):
    driver, virtual = slow(0.3, 1.0)
    done, words = enabled(driver)
    assert done, words
    assert virtual.supply.output_on, "on is said when it is"
    assert driver.enable(False, timeout_s=SOON_s) == (True, "the output is off")
    assert not virtual.supply.output_on


def test_off_is_confirmed_by_a_supply_that_takes_longer_than_half_a_second(slow):
    driver, virtual = slow(0.3, 1.0)
    assert enabled(driver)[0]
    assert driver.stop(), "off takes three of its answers, and is waited for"
    assert driver.output_words == "the output is off"
    assert not virtual.supply.output_on


def test_on_is_said_when_it_is_read_back(slow):
    driver, virtual = slow(0.0, 5.0)
    for _ in range(3):
        assert enabled(driver)[0]
        assert virtual.supply.output_on
        assert driver.enable(False, timeout_s=SOON_s)[0]


def test_a_rate_that_the_instruments_do_not_allow_is_refused_before_current_flows(slow):
    driver, virtual = slow(0.1, 20.0)
    done, words = driver.enable(True, timeout_s=SOON_s)
    assert not done
    assert "not enabled: a step takes the instruments 0.2" in words
    assert "so loop.rate can be" in words and "Hz at the most; it is 20 Hz" in words
    assert not virtual.supply.output_on


def test_off_ends_an_enable_that_waits(slow):
    driver, virtual = slow(0.3, 1.0)
    answers = []
    asking = threading.Thread(target=lambda: answers.append(driver.enable(True, timeout_s=SOON_s)))
    asking.start()
    time.sleep(0.05)
    began_s = time.monotonic()
    driver.cancel_enable()
    asking.join(SOON_s)
    assert time.monotonic() - began_s < 5.0
    assert not answers[0][0] and "it was switched off meanwhile" in answers[0][1]
    assert driver.enable(False, timeout_s=SOON_s)[0]
    assert not virtual.supply.output_on


@pytest.mark.parametrize(
    ("delay_s", "level"), [(0.0, None), (0.01, Level.OK), (0.016, Level.WARNING), (0.04, Level.WRONG)]
)
def test_check_measures_and_states_the_highest_rate(make_config, delay_s, level):
    """In the bench's own time, where an answer takes exactly so long: a step that looks at a setting has three."""
    config = Config.from_mapping(make_config(**{"supply.watchdog_timeout": 0.0, "supply.allow_no_watchdog": True}))
    bench = VirtualBench.from_name("flexinol")
    bench.advance(0.2)
    if delay_s:
        bench.inject("slow_answers", delay_s)
    test = SelfTest(config, InProcessSupply(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
    said = [each for each in test.run() if each.part == "speed"]
    assert [each.level for each in said] == ([] if level is None else [level])
    if level is Level.WRONG:
        assert (
            "too long for loop.rate, 20 Hz, or the time-outs; write loop.rate: 6.7, loop.samples_per_block: 25"
            in said[0].sentence
        )
    elif said:
        takes = f"{delay_s * 1e3:.3g} ms"
        words = f"a step takes the supply {takes}, a look at one of its settings {takes} and the DAQ {takes}"
        assert words in said[0].sentence
        rate_Hz = re.search(r"loop.rate can be ([\d.]+) Hz at the most; it is 20 Hz", said[0].sentence)[1]
        assert float(rate_Hz) == pytest.approx(highest_rate_Hz(3 * delay_s), rel=0.01)
