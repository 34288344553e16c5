"""Off for a supply without a watchdog whose program is gone, said by a process of its own; the bench is asked what
flows."""

import contextlib
import os
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from program import Program
from waiting import Elapsed, Stalls, wait_until

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.server import background
from sma_actuator.config import Config
from sma_actuator.instruments import InstrumentLost, InstrumentRefused, afterwards, last_word, open_supply

SOON_s = 60.0

_PROGRAM = """
import json, sys, time
from sma_actuator.instruments import open_supply
from sma_actuator.instruments.afterwards import sections_of
supply = open_supply(sections_of(json.loads(sys.argv[1]), ""))
supply.open()
supply.set_current(0.1)
supply.set_output(True)
assert supply.read_back().output_on
print(supply._afterwards._process.pid if supply._afterwards else 0, flush=True)
if sys.stdin.readline():
    supply.switch_off()
    supply.close()
    print("closed", flush=True)
    time.sleep(600.0)
"""


def is_there(process):
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def waits(process):
    """Whether it has come to where signals are ignored, with all that it needs imported."""
    ignored = re.search(r"SigIgn:\s*([0-9a-f]+)", Path(f"/proc/{process}/status").read_text())[1]
    return bool(int(ignored, 16) & 1 << (signal.SIGUSR1 - 1))


@pytest.fixture
def bench():
    with background(VirtualBench.from_name("flexinol")) as server:
        yield server


@pytest.fixture
def mapping(make_config, bench):
    def make(**changes):
        common = {"supply.watchdog_timeout": 0.0, "supply.allow_no_watchdog": True}
        resource = f"TCPIP::127.0.0.1::{bench.ports[0]['supply']}::SOCKET"
        return make_config(**{"instruments.supply.resource": resource, **common, **changes})

    return make


@pytest.fixture
def program(mapping):
    with contextlib.ExitStack() as stack:

        def start(**changes):
            one = Program(_PROGRAM, mapping(**changes))
            stack.callback(one.close)
            return one

        yield start


def until(condition):
    elapsed = Elapsed()
    while not condition():
        assert elapsed.look() < SOON_s
        time.sleep(0.01)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_it_is_off_in_the_promised_time_whatever_has_ended_the_program(bench, program, number):
    one = program()
    supply = bench.benches[0].supply
    assert supply.output_on and is_there(one.waiting)
    until(lambda: waits(one.waiting))  # before, it says off as soon as it has begun
    one.process.send_signal(number)
    with contextlib.closing(Stalls()) as stalls:
        ended_s = time.monotonic()
        while supply.output_on:
            assert stalls.since(ended_s) < afterwards.WITHIN_s
            time.sleep(0.005)
    _, said = one.process.communicate(timeout=SOON_s)
    assert f"process {one.process.pid}, which drove the supply at" in said
    assert "is gone: the output is off, confirmed by the supply" in said
    assert supply.current_A == 0.0


def test_a_program_that_has_switched_it_off_leaves_nobody(bench, program):
    one = program()
    one.process.stdin.write("off\n")
    one.process.stdin.flush()
    assert one.process.stdout.readline() == "closed\n"
    until(lambda: not is_there(one.waiting))


def test_a_supply_with_a_watchdog_has_nobody(program):
    assert program(**{"supply.watchdog_timeout": 1.0}).waiting == 0


def test_it_waits_also_where_signals_end_all_that_belongs_together(program):
    one = program()
    until(lambda: waits(one.waiting))
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGUSR1):
        os.kill(one.waiting, number)
    time.sleep(0.2)
    assert is_there(one.waiting)


class TestSwitchOff:
    """What it does, in this process."""

    @pytest.fixture
    def supply(self, mapping):
        return open_supply(Config.from_mapping(mapping()))

    @pytest.fixture
    def gone(self):
        """The number of a process that is gone."""
        process = subprocess.Popen(["true"])
        process.wait()
        return process.pid

    def test_it_says_no_word_to_a_supply_that_another_program_drives(self, bench, mapping, supply, gone):
        other = open_supply(Config.from_mapping(mapping()))
        other.open()
        other._tell_output(True)
        other.read_back()
        said = last_word.switch_off(supply, gone, 1.0)
        assert said == f"is left to process {os.getpid()}, which drives it now"
        assert other.read_back().output_on
        other.switch_off()
        other.close()

    def test_it_tries_again_while_the_connection_of_the_dead_is_there(self, supply, gone, monkeypatch):
        monkeypatch.setattr(last_word, "_AGAIN_s", 0.0)
        answers = [InstrumentRefused("its name"), InstrumentLost("its session")]

        def beside(_timeout_s):
            if answers:
                raise answers.pop()

        supply.switch_off_beside = beside
        assert last_word.switch_off(supply, gone, 1.0) == "is off, confirmed by the supply"
        assert answers == []

    def test_it_gives_up_with_words_for_a_person(self, supply, gone, monkeypatch):
        monkeypatch.setattr(last_word, "_ATTEMPTS_s", 0.0)

        def beside(_timeout_s):
            raise InstrumentLost("nothing listens there")

        supply.switch_off_beside = beside
        said = last_word.switch_off(supply, gone, 1.0)
        assert said.startswith("is NOT CONFIRMED to be off (nothing listens there); look at the supply")


def test_nobody_to_begin_is_a_warning_and_no_failure(mapping, monkeypatch, caplog):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    supply = open_supply(Config.from_mapping(mapping()))
    supply.open()
    supply.set_output(True)
    assert "nobody says off when this program is killed" in caplog.text
    supply.switch_off()
    supply.close()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_who_waits_and_is_ended_or_stopped_is_begun_anew_while_current_may_flow(mapping, caplog, number):
    """The program that was killed after it left the current on."""
    supply = open_supply(Config.from_mapping(mapping()))
    supply.open()
    supply.set_output(True)
    first = supply._afterwards._process
    supply.check_next_setting()
    assert supply._afterwards._process is first and "begun anew" not in caplog.text
    first.send_signal(number)
    wait_until(lambda: not supply._afterwards.waits, what="its end")
    supply.check_next_setting()
    assert first.poll() == -signal.SIGKILL, "nobody is left behind"
    assert supply._afterwards.waits and supply._afterwards._process.pid != first.pid
    assert "who says off when this program is killed was ended or stopped; begun anew" in caplog.text
    supply.switch_off()
    supply.close()
    assert supply._afterwards is None


def test_where_none_can_be_begun_anew_that_is_said_once(mapping, monkeypatch, caplog):
    supply = open_supply(Config.from_mapping(mapping()))
    supply.open()
    supply.set_output(True)
    supply._afterwards._process.kill()
    supply._afterwards._process.wait()
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    for _ in range(3):
        supply.check_next_setting()
    assert caplog.text.count("nobody says off when this program is killed") == 1
    supply.switch_off()
    supply.close()


def test_a_supply_that_is_looked_after_is_promised_to_be_heard_of_until_it_is_off(mapping, monkeypatch):
    said = []
    monkeypatch.setattr(afterwards.Afterwards, "promise", lambda _, silent_s: said.append(silent_s))
    config = Config.from_mapping(mapping())
    supply = open_supply(config)
    supply.open()
    supply.set_output(True)
    assert said == [], "nobody looks after it yet, as in a program that waits for a person"
    supply.check_next_setting()
    assert said == [], "nor where a self-test asks how long that takes: it was cut short, as one that stood still"
    supply.patience_s = 3.0
    supply.check_next_setting()
    assert said == [3.0 + config.instruments.supply.timeout + afterwards.STANDS_STILL_s]
    supply.switch_off()
    assert said[1:] == [0.0]
    supply.check_next_setting()
    with contextlib.suppress(InstrumentLost):  # one that was lost, for which a program that lives says off itself
        monkeypatch.setattr(supply._session, "open", Mock(side_effect=InstrumentLost("it is away")))
        supply.open()
    assert said[-1] == 0.0 and len(said) == 4
    supply.close()


class TestWait:
    """What ends it, with the parent of this process for the program."""

    @pytest.fixture
    def wait(self, monkeypatch):
        """``wait(said, looks)``: what is said to it, and after how many looks the pipe ends."""
        ours, theirs = os.pipe()
        looks = []

        def look(*_):
            looks.append(select.select([ours], [], [], 0.0)[0])
            if len(looks) > self.ends_after:
                os.close(theirs)
                looks[-1] = [ours]
            return looks[-1], [], []

        def wait(said, ends_after):
            self.ends_after = ends_after
            os.write(theirs, said)
            return last_word._wait_for_the_end(os.getppid()), len(looks)

        with os.fdopen(ours) as stdin:
            monkeypatch.setattr(last_word.sys, "stdin", stdin)
            monkeypatch.setattr(last_word, "select", SimpleNamespace(select=look))
            yield wait

    @pytest.mark.parametrize("said", [b"", b"0\n", b"1\n0\n"])
    def test_silence_alone_is_no_end_where_nothing_was_promised(self, wait, said):
        assert wait(said, 500) == (False, 501)

    @pytest.mark.parametrize("said", [b"1\n", b"0\n1\n", b"7\n1\n"])
    def test_it_is_where_the_last_promise_is_broken(self, wait, said):
        stands_still, looks = wait(said, 500)
        assert stands_still
        assert 1.0 / last_word._LOOK_s < looks - 1 <= 1.0 / last_word._LOOK_s + 1, "the first look hears it"

    def test_it_is_gone_where_it_has_another_parent(self, wait):
        assert not last_word._wait_for_the_end(os.getppid() + 1)
