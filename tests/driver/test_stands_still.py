"""A driver that stands still, beside a supply without a watchdog: who waits for its end says off for it.

Processes of their own on the virtual bench, which is asked what flows."""

import contextlib
import os
import signal
import time

import pytest
from program import Program
from waiting import Elapsed, Stalls

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.server import background
from sma_actuator.instruments.afterwards import STANDS_STILL_s, WITHIN_s

SOON_s = 60.0
READING_TIMEOUT_s, TIMEOUT_s = 2.5, 1.0
#: As docs/safety.md promises.
SILENT_s = READING_TIMEOUT_s + TIMEOUT_s + STANDS_STILL_s

_PROGRAM = """
import json, sys, time
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.instruments import open_daq, open_supply
from sma_actuator.instruments.clock import MonotonicClock

config, clock = Config.from_mapping(json.loads(sys.argv[1])), MonotonicClock()
driver = Driver(config, open_supply(config), open_daq(config, clock), clock)
driver.start()
while not driver.enable(True, timeout_s=30.0)[0]:
    driver.clear_fault(30.0)
    time.sleep(0.1)
print(driver._supply._afterwards._process.pid, flush=True)
for line in sys.stdin:
    while not (latched := driver.call(lambda actuator, now_s: actuator.latched)):
        time.sleep(0.01)
    print(latched, flush=True)
"""


class Driven(Program):
    """A process that drives the bench's wire."""

    def latched(self):
        """The fault that it comes to, waited for."""
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()

    def stand_still(self):
        self.process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, self.process.pid, os.WSTOPPED | os.WNOWAIT)


@pytest.fixture
def bench():
    with background(VirtualBench.from_name("flexinol")) as server:
        yield server


@pytest.fixture
def drive(make_config, bench):
    changes = {
        "supply.watchdog_timeout": 0.0,
        "supply.allow_no_watchdog": True,
        "safety.reading_timeout": READING_TIMEOUT_s,
    }
    for role in ("supply", "daq"):
        changes[f"instruments.{role}.resource"] = f"TCPIP::127.0.0.1::{bench.ports[0][role]}::SOCKET"
        changes[f"instruments.{role}.timeout"] = TIMEOUT_s
    with contextlib.ExitStack() as stack:
        yield lambda **more: stack.enter_context(contextlib.closing(Driven(_PROGRAM, make_config(**changes, **more))))


def is_off_as_promised(supply):
    with contextlib.closing(Stalls()) as stalls:
        stopped_s = time.monotonic()
        while supply.output_on:
            assert stalls.since(stopped_s) < SILENT_s + TIMEOUT_s + WITHIN_s
            time.sleep(0.005)
    assert time.monotonic() - stopped_s > READING_TIMEOUT_s, "a program that runs says off itself by then"


def test_it_is_off_in_the_promised_time_and_stays_off_where_the_program_goes_on(bench, drive):
    supply, driven = bench.benches[0].supply, drive(**{"instruments.supply.exclusive_lock": False})
    elapsed = Elapsed()
    while elapsed.look() < 1.2 * SILENT_s:  # one that goes on is left alone
        assert supply.output_on
        time.sleep(0.05)
    driven.stand_still()
    is_off_as_promised(supply)
    driven.process.send_signal(signal.SIGCONT)
    assert driven.latched()  # clock_jump, loop_overrun or loop_hung: whichever of its threads runs first
    assert not supply.output_on
    driven.process.kill()
    _, said = driven.process.communicate(timeout=SOON_s)
    assert f"process {driven.process.pid}, which drove the supply at" in said
    assert "stands still: the output is off, confirmed by the supply\n" in said


def test_a_program_that_locks_the_supply_and_stands_still_is_killed(bench, drive):
    driven = drive()
    driven.stand_still()
    is_off_as_promised(bench.benches[0].supply)
    assert driven.process.wait(timeout=SOON_s) == -signal.SIGKILL
    _, said = driven.process.communicate(timeout=SOON_s)
    assert "confirmed by the supply (the process was in the way, and was killed)\n" in said
