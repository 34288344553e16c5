"""The board behind a pseudo-terminal, its firmware a process of its own: what is ended, stopped or pulled ends with the
current off.

Time is the board's own: what the machine takes away from it is not counted.
"""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from drive import config_at
from virtual_board import VirtualBench, Weight
from waiting import STARTS_SOON

from sma_actuator.check.found import Level
from sma_actuator.check.selftest import SelfTest
from sma_actuator.driver import Driver
from sma_actuator.instruments import open_instruments
from sma_actuator.instruments.clock import MonotonicClock

from run import MICROPYTHON, SimulatedBoard  # isort: skip

HERE = Path(__file__).parent
#: The wait of the firmware, what the world may lag, and a look of the test.
MEASURING_s = 0.3
LONGEST_s = 60.0


@pytest.fixture
def board(request):
    """Whose firmware is run by what a test names."""
    if request.param == "micropython" and not MICROPYTHON.exists():
        pytest.skip("MicroPython is not there; `make micropython` installs it")
    with SimulatedBoard(VirtualBench.from_name("flexinol", load=Weight(0.49)), request.param == "micropython") as board:
        yield board


def by(*interpreters):
    """The firmware is run by each of these."""
    return pytest.mark.parametrize("board", interpreters, indirect=True)


def wait_until(condition):
    until_s = time.monotonic() + LONGEST_s
    while not condition():
        assert time.monotonic() < until_s
        time.sleep(0.005)


@contextlib.contextmanager
def driven(board):
    """A driver in this process, whose wire is driven."""
    config, clock = config_at(board.resource), MonotonicClock()
    with Driver(config, *open_instruments(config, clock), clock) as driver:
        driver.start()
        enable(driver)
        wait_until(lambda: board.world.heats)
        yield driver


def enable(driver):
    until_s = time.monotonic() + LONGEST_s
    while not (answer := driver.enable(True, timeout_s=LONGEST_s))[0]:
        assert time.monotonic() < until_s, answer
        driver.clear_fault()
        time.sleep(0.1)


class ClockOfTheBoard:
    def __init__(self, board):
        self._board = board

    def now_s(self):
        return self._board.world.time_s

    def sleep_until_s(self, deadline_s):
        wait_until(lambda: self.now_s() >= deadline_s)


def seconds_to_off(board):
    begun_s = board.world.time_s
    wait_until(lambda: not board.world.heats)
    return board.world.off_since_s - begun_s


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
@by("cpython", "micropython")
def test_firmware_that_stands_still_is_off_and_found_again_and_a_line_that_is_cut_is_off(board, number):
    with driven(board) as driver:
        before = board.firmware
        before.send_signal(number)
        assert seconds_to_off(board) <= 0.5 + MEASURING_s
        wait_until(lambda: board.firmware is not before)
        wait_until(lambda: not driver.lost_instruments)
        assert not board.world.heats
        enable(driver)
        wait_until(lambda: board.world.heats)
        board.cut_line()
        assert seconds_to_off(board) <= 0.5 + MEASURING_s


@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
@by("cpython", pytest.param("micropython", marks=pytest.mark.long))
def test_a_program_that_is_ended_leaves_the_wire_without_current(board, number):
    program = [sys.executable, str(HERE / "drive.py"), board.resource]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True, env=STARTS_SOON) as driving:
        assert driving.stdout.readline() == "it flows\n"
        wait_until(lambda: board.world.heats)
        driving.send_signal(number)
        assert seconds_to_off(board) <= 0.5 + MEASURING_s
        driving.wait(LONGEST_s)


@pytest.mark.long
@by("cpython", "micropython")
def test_the_self_test_over_a_real_line(board):
    config, clock = config_at(board.resource), ClockOfTheBoard(board)
    found = SelfTest(config, *open_instruments(config, clock), clock).run()
    assert [each for each in found if each.level is Level.WRONG and each.part != "rate"] == []
    assert "the load is 0.49 N and pulls" in {each.sentence for each in found}


def test_the_ports_own_file_hears_and_says_bytes():
    """By this Python, whose standard input has to be as unbuffered as the board's is."""
    program = (
        "import os, sys, types\n"
        f"sys.path.insert(0, {str(HERE.parents[1] / 'boards' / 'rp2040')!r})\n"
        "sys.stdin = types.SimpleNamespace(buffer=os.fdopen(0, 'rb', buffering=0), fileno=lambda: 0)\n"
        "import usb\n"
        "assert usb.read() == b''\n"
        "usb.write(b'ready\\n'); sys.stdout.flush()\n"
        "usb.wait(60000)\n"
        "usb.write(usb.read()); sys.stdout.flush()\n"
    )
    ours, theirs = os.pipe()
    with subprocess.Popen([sys.executable, "-c", program], stdin=ours, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        os.write(theirs, b"*IDN?\n")
        assert process.stdout.read() == b"*IDN?\n"
        assert process.wait(LONGEST_s) == 0
    os.close(ours)
    os.close(theirs)
