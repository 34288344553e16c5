"""The control thread: who may do what from where, and that every way out ends with the output off."""

import atexit
import dataclasses
import json
import os
import queue
import signal
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from ending import signals_end_the_program
from stand_ins import RealClock, StandInDaq, StandInSupply
from waiting import STARTS_SOON

from sma_actuator.config import Config
from sma_actuator.driver import Driver, DriverStopped
from sma_actuator.instruments import InstrumentLost

SOON_s = 60.0  #: bound of every wait; none is expected to take long
#: A loop of 100 Hz that is late as often as a busy machine has it.
HURRIED = {"loop.rate": 100.0, "loop.samples_per_block": 10, "loop.overruns_to_fault": 10000}


def seconds_of(call):
    start_s = time.monotonic()
    call()
    return time.monotonic() - start_s


@pytest.fixture
def make_driver(make_config):
    drivers = []

    def make(daq=None, supply=None, changes=None, **arguments):
        supply = supply or StandInSupply()
        daq = daq or StandInDaq(supply)
        config = Config.from_mapping(make_config(**{**HURRIED, **(changes or {})}))
        driver = Driver(config, supply, daq, RealClock(), **arguments)
        driver.stand_ins, driver.config = (supply, daq), config
        drivers.append(driver)
        return driver

    yield make
    for driver in drivers:
        driver.stand_ins[1].release.set()
        driver.stop()


class Outputs:
    """Collects outputs and wakes who waits for one."""

    def __init__(self):
        self.all = []
        self._changed = threading.Condition()

    def __call__(self, output):
        with self._changed:
            self.all.append(output)
            self._changed.notify_all()

    def wait_for(self, condition):
        with self._changed:
            assert self._changed.wait_for(lambda: self.all and condition(self.all[-1]), SOON_s), self.all[-1:]


def test_instruments_are_touched_by_the_control_thread_alone(make_driver):
    outputs = Outputs()
    driver = make_driver(on_output=outputs)
    driver.open()
    supply, _ = driver.stand_ins
    driver.start()
    outputs.wait_for(lambda _: len(outputs.all) > 3)
    driver.clear_fault()
    driver.enable(True)
    outputs.wait_for(lambda output: output.command.output_on)
    assert supply.threads == {"sma_actuator control"}


def test_a_call_is_executed_in_the_control_thread_and_brings_its_result(make_driver):
    driver = make_driver()
    driver.start()
    assert driver.call(lambda actuator, now_s: threading.current_thread().name) == "sma_actuator control"


def test_a_call_brings_back_its_exception_and_the_loop_goes_on(make_driver):
    outputs = Outputs()
    driver = make_driver(on_output=outputs)
    driver.start()
    with pytest.raises(ZeroDivisionError):
        driver.call(lambda actuator, now_s: 1 / 0)
    seen = len(outputs.all)
    outputs.wait_for(lambda _: len(outputs.all) > seen)


def test_a_call_does_not_wait_for_a_slow_loops_deadline(make_driver):
    driver = make_driver(changes={"loop.rate": 1.0, "supply.watchdog_timeout": 3.0, "safety.reading_timeout": 3.0})
    driver.start()
    # One that waited would take the period of a second, each time; a machine that stalls does not stall each time.
    assert min(seconds_of(lambda: driver.call(lambda actuator, now_s: None)) for _ in range(4)) < 0.5


def test_a_call_that_times_out_is_not_executed_later(make_driver):
    driver = make_driver()
    _, daq = driver.stand_ins
    driver.start()
    daq.hang = True
    assert daq.hanging.wait(SOON_s)
    executed = []
    with pytest.raises(TimeoutError, match="an instrument holds it up"):
        driver.call(lambda actuator, now_s: executed.append(1), timeout_s=0.05)
    with pytest.raises(TimeoutError, match="an instrument holds it up"):
        driver.enable(True, timeout_s=0.05)
    daq.hang = False
    daq.release.set()
    driver.call(lambda actuator, now_s: None)
    assert executed == [] and driver.output_is_off


@pytest.fixture
def waiting_for_the_daq(make_driver):
    """(driver, its outputs), driving; the loop waits for a DAQ that is slow and not lost."""
    outputs = Outputs()
    changes = {"safety.reading_timeout": 60.0, "supply.watchdog_timeout": 60.0}
    driver = make_driver(on_output=outputs, changes=changes)
    _, daq = driver.stand_ins
    driver.start()
    outputs.wait_for(lambda output: output.reading is not None)
    assert driver.enable(True)[0]
    outputs.wait_for(lambda output: output.command.output_on)
    daq.hang = True
    assert daq.hanging.wait(SOON_s)
    return driver, outputs


def test_off_does_not_wait_for_a_daq_that_takes_its_time(waiting_for_the_daq):
    driver, outputs = waiting_for_the_daq
    supply, daq = driver.stand_ins
    before = len(outputs.all)
    assert driver.enable(False, timeout_s=SOON_s) == (True, "the output is off")
    assert (supply.output_on, supply.current_A) == (False, 0.0)
    supply.settings.clear()
    daq.hang = False
    daq.release.set()
    outputs.wait_for(lambda _: len(outputs.all) > before + 3)
    assert ("output", True) not in supply.settings
    assert {(each.status.fault, each.command.output_on) for each in outputs.all[before:]} == {("", False)}
    assert driver.enable(True)[0]
    outputs.wait_for(lambda _: supply.output_on)


def test_off_that_a_supply_does_not_confirm_beside_the_loop_is_not_called_off(waiting_for_the_daq):
    driver, outputs = waiting_for_the_daq
    supply, daq = driver.stand_ins
    supply.lost = True
    done, words = driver.enable(False, timeout_s=0.3)
    assert not done
    assert words == "the output is told to be off, not confirmed; an instrument holds the loop up"
    assert not driver.output_is_off
    daq.hang = supply.lost = False
    daq.release.set()
    outputs.wait_for(lambda output: output.status.values["output"] == "off")


class HeldUpSupply(StandInSupply):
    """Takes its time to be told a current, once it is to."""

    def __init__(self):
        super().__init__()
        self.holds = None
        self.told = threading.Event()

    def set_current(self, current_A):
        if self.holds is not None and current_A:
            self.holds.set()
            assert self.told.wait(SOON_s)
        super().set_current(current_A)


def test_off_is_not_said_between_the_words_that_switch_on(make_driver):
    supply, outputs = HeldUpSupply(), Outputs()
    changes = {"safety.reading_timeout": 60.0, "supply.watchdog_timeout": 60.0}
    driver = make_driver(supply=supply, changes=changes, on_output=outputs)
    driver.start()
    outputs.wait_for(lambda output: output.reading is not None)
    supply.holds = threading.Event()
    enabling = threading.Thread(target=driver.enable, args=(True, SOON_s), daemon=True)
    enabling.start()
    assert supply.holds.wait(SOON_s)  # the loop is about to say "on"
    assert driver.enable(False, timeout_s=0.05) == (
        False,
        "the output is told to be off, not confirmed; an instrument holds the loop up",
    )
    answers, waits, writing = queue.Queue(), threading.Event(), driver._output._speaking

    class Awaited:
        """The same lock; it says when somebody waits for it."""

        def acquire(self, timeout):
            waits.set()
            return writing.acquire(timeout=timeout)

        release = writing.release

    driver._output._speaking = Awaited()
    asking = threading.Thread(target=lambda: answers.put(driver.enable(False, timeout_s=SOON_s)), daemon=True)
    asking.start()
    assert waits.wait(SOON_s)
    driver._output._speaking = writing
    assert not supply.output_on
    supply.told.set()
    assert answers.get(timeout=SOON_s)[0]
    assert not supply.output_on
    enabling.join(SOON_s)
    assert not enabling.is_alive()
    outputs.wait_for(lambda output: not output.command.output_on)
    assert not supply.output_on


def test_off_beside_a_loop_that_has_just_heard_it_does_not_keep_the_next_on_away(make_driver, monkeypatch):
    monkeypatch.setattr("sma_actuator.driver.driver._OFF_PATIENCE_s", 0.0)
    outputs = Outputs()
    driver = make_driver(on_output=outputs, changes={"safety.reading_timeout": 60.0, "supply.watchdog_timeout": 60.0})
    supply, _ = driver.stand_ins
    driver.start()
    outputs.wait_for(lambda output: output.reading is not None)
    assert driver.enable(True)[0]
    outputs.wait_for(lambda _: supply.output_on)
    writing = driver._output._speaking

    class Late:
        """The same lock, had when the loop has obeyed."""

        def acquire(self, timeout):
            driver.call(lambda actuator, now_s: None, timeout_s=SOON_s)
            return writing.acquire(timeout=timeout)

        def __enter__(self):
            return writing.acquire()

        def __exit__(self, *_):
            writing.release()

        release = writing.release

    driver._output._speaking = Late()
    assert driver.enable(False, timeout_s=SOON_s)[0]
    assert not supply.output_on
    driver._output._speaking = writing
    assert driver.enable(True)[0]
    outputs.wait_for(lambda _: supply.output_on)


def test_a_parameter_that_is_changed_while_an_instrument_holds_the_loop_up_is_taken_over_later(waiting_for_the_daq):
    driver, outputs = waiting_for_the_daq
    _, daq = driver.stand_ins
    wire = dataclasses.replace(driver.config.wire, max_stress=2e6)
    with pytest.raises(TimeoutError, match="it takes them over as soon as an instrument"):
        driver.update(dataclasses.replace(driver.config, wire=wire), timeout_s=0.05)
    daq.hang = False
    daq.release.set()
    outputs.wait_for(lambda output: output.status.fault == "stress_above_limit")


class LateDaq(StandInDaq):
    """Its answer comes late, and is of when it was asked."""

    def read_block(self):
        flowing_A = self.supply.current_A if self.supply.output_on else 0.0
        late = super().read_block()
        return dataclasses.replace(late, supply_voltage_V=6.5 * flowing_A, reference_voltage_V=flowing_A)


def test_what_was_read_before_a_loop_was_cut_off_is_not_taken_for_current_that_flows_on(make_driver):
    outputs, supply = Outputs(), StandInSupply()
    changes = {"safety.reading_timeout": 0.5, "safety.disagreement_time": 0.05}
    driver = make_driver(LateDaq(supply), supply, changes, on_output=outputs)
    _, daq = driver.stand_ins
    driver.start()
    outputs.wait_for(lambda output: output.reading is not None)
    assert driver.enable(True)[0]
    outputs.wait_for(lambda output: output.signals.current_A > 0.02)
    daq.hang = True
    outputs.wait_for(lambda output: output.status.fault == "loop_hung")
    daq.hang = False
    before = len(outputs.all)
    daq.release.set()
    outputs.wait_for(lambda _: len(outputs.all) > before + 3)
    assert not any("flow" in str(each.status.values["output"]) for each in outputs.all)


def test_neither_thread_keeps_the_interpreter_from_its_end(make_driver):
    """It would wait for them before what stops them is called."""
    driver = make_driver(name="wire of this test")
    driver.start()
    threads = {each.name: each.daemon for each in threading.enumerate() if "wire of this test" in each.name}
    assert threads == {"wire of this test control": True, "wire of this test watchman": True}


def test_the_watchman_stands_by_a_thread_that_has_not_begun(make_driver, monkeypatch):
    begins, looks = threading.Event(), []
    monkeypatch.setattr(Driver, "_run", lambda self: self._prepared.set_result(None) or begins.wait(SOON_s))
    driver = make_driver()
    driver.open()
    now_s = driver._clock.now_s
    driver._clock.now_s = lambda: looks.append(threading.current_thread().name) or now_s()
    driver.start()
    until_s = time.monotonic() + SOON_s
    while looks.count("sma_actuator watchman") < 3 and time.monotonic() < until_s:
        time.sleep(0.01)
    begins.set()
    assert looks.count("sma_actuator watchman") >= 3
    assert driver.stand_ins[0].shut_downs == 0


def test_the_end_of_the_interpreter_stops_what_is_still_there(make_driver, monkeypatch):
    registered = []
    monkeypatch.setattr(atexit, "register", registered.append)
    driver = make_driver()
    supply, _ = driver.stand_ins
    driver.start()
    (stop,) = [each for each in registered if "_stop_at_exit" in each.__qualname__]
    stop()
    assert supply.shut_downs == 1
    assert not driver._thread.is_alive()


def test_nothing_of_an_ended_driver_waits_for_the_end_of_the_interpreter(make_driver, monkeypatch):
    registered = []
    monkeypatch.setattr(atexit, "register", registered.append)
    monkeypatch.setattr(atexit, "unregister", registered.remove)
    driver = make_driver()
    driver.start()
    (stop,) = [each for each in registered if "_stop_at_exit" in each.__qualname__]
    driver.stop()
    driver._thread.join(SOON_s)
    assert stop not in registered


def test_a_commander_has_its_whole_time_from_the_start(make_driver):
    outputs = Outputs()
    driver = make_driver(on_output=outputs, feed_timeout_s=1000.0)
    driver.open()
    driver._loop.fed_at_s -= 1000.0  # it was made long before
    driver.start()
    outputs.wait_for(lambda _: len(outputs.all) > 3)
    assert not any(output.status.fault for output in outputs.all)


def test_calls_on_an_ended_driver_are_refused(make_driver):
    driver = make_driver()
    driver.start()
    driver.stop()
    with pytest.raises(DriverStopped):
        driver.enable(True)
    with pytest.raises(DriverStopped):
        driver.start()


def test_stop_ends_with_the_supply_shut_down(make_driver):
    driver = make_driver()
    supply, _ = driver.stand_ins
    driver.start()
    driver.enable(True)
    driver.stop()
    driver.stop()
    assert supply.shut_downs == 1
    assert (supply.output_on, supply.current_A) == (False, 0.0)


def test_stop_does_not_wait_for_a_daq_that_hangs(make_driver):
    took_s = []
    for _ in range(2):
        driver = make_driver()
        supply, daq = driver.stand_ins
        driver.start()
        daq.hang = True
        assert daq.hanging.wait(SOON_s)
        took_s.append(seconds_of(driver.stop))
        assert supply.shut_downs == 1
    assert min(took_s) < 1.0


def test_a_step_that_goes_on_after_stop_switches_nothing_on_again(make_driver):
    class Supply(StandInSupply):
        asked, hang, release = threading.Event(), threading.Event(), threading.Event()

        def check_next_setting(self):
            if self.hang.is_set():
                self.asked.set()
                self.release.wait(SOON_s)

    outputs = Outputs()
    driver = make_driver(supply=Supply(), on_output=outputs, changes={"safety.reading_timeout": 60.0})
    supply, _ = driver.stand_ins
    driver.start()
    outputs.wait_for(lambda _: len(outputs.all) > 3)
    assert driver.enable(True)[0]
    outputs.wait_for(lambda output: output.command.output_on)
    supply.hang.set()  # after the supply was read back, before it is told what that means
    assert supply.asked.wait(SOON_s)
    assert driver.stop()
    told = len(supply.settings)
    supply.release.set()
    driver._thread.join(SOON_s)
    assert not driver._thread.is_alive()
    assert ("output", True) not in supply.settings[told:]
    assert all(value == 0.0 for what, value in supply.settings[told:] if what == "current")


def test_a_new_reading_timeout_reaches_the_watchman(make_driver):
    driver = make_driver(changes={"safety.reading_timeout": 60.0})
    _, daq = driver.stand_ins
    driver.start()
    driver.update(driver.config.replace({"safety.reading_timeout": 0.5}))
    daq.hang = True
    assert daq.hanging.wait(SOON_s)
    end_s = time.monotonic() + SOON_s
    while "control loop" not in driver.lost_instruments and time.monotonic() < end_s:
        time.sleep(0.05)
    assert "safety.reading_timeout is 0.5 s" in driver.lost_instruments["control loop"]


def test_stop_does_not_wait_for_a_slow_loop(make_driver):
    took_s = []
    for _ in range(3):
        driver = make_driver(changes={"loop.rate": 1.0, "supply.watchdog_timeout": 3.0, "safety.reading_timeout": 3.0})
        supply, _ = driver.stand_ins
        driver.start()
        driver.call(lambda actuator, now_s: None)
        took_s.append(seconds_of(driver.stop))
        assert supply.shut_downs == 1
    assert min(took_s) < 0.5


@pytest.mark.parametrize("where", ["on_output", "recorder", "daq"])
def test_an_exception_nobody_handles_ends_the_loop_with_the_output_off(make_driver, where):
    failed = threading.Event()
    errors = []
    supply = StandInSupply()
    daq = StandInDaq(supply)

    def broken(*_):
        raise ZeroDivisionError(where)

    def on_failure(error):
        errors.append((error, supply.shut_downs))
        failed.set()

    arguments = {"on_failure": on_failure}
    if where == "on_output":
        arguments["on_output"] = broken
    elif where == "recorder":
        arguments["recorder"] = type("Broken", (), {"record": broken})()
    else:
        daq.read_block = broken
    driver = make_driver(daq, supply, **arguments)
    driver.start()
    assert failed.wait(SOON_s)
    ((error, shut_downs),) = errors
    assert str(error) == where
    assert shut_downs == 1, "told before the supply was shut down"
    assert driver.failure is error


def test_an_instrument_that_does_not_open_leaves_the_supply_shut_down(make_driver):
    driver = make_driver()
    supply, daq = driver.stand_ins
    daq.lost = True
    with pytest.raises(InstrumentLost, match="stand-in DAQ"):
        driver.start()
    assert supply.shut_downs == 1


def test_the_supply_is_told_only_what_is_new(make_driver):
    outputs = Outputs()
    driver = make_driver(on_output=outputs)
    supply, _ = driver.stand_ins
    driver.start()
    outputs.wait_for(lambda _: len(outputs.all) > 20)
    assert supply.settings == [("output", False), ("current", 0.0)]


def test_why_the_loop_hung_is_said_although_it_goes_on_while_the_watchman_cuts(make_driver, caplog):
    class Supply(StandInSupply):
        def shut_down(self):
            off = super().shut_down()
            if daq.release.is_set():
                return off  # at the end, when no steps are to come
            daq.release.set()
            steps = driver.statistics().steps
            while driver.statistics().steps < steps + 2 and time.monotonic() < deadline_s:
                time.sleep(1e-3)
            return off

    outputs = Outputs()
    supply = Supply()
    daq = StandInDaq(supply)
    driver = make_driver(daq, supply, on_output=outputs)
    deadline_s = time.monotonic() + 3 * SOON_s
    driver.start()
    outputs.wait_for(lambda _: len(outputs.all) > 3)
    driver.enable(True)
    outputs.wait_for(lambda output: output.command.output_on)
    daq.hang = True
    assert daq.hanging.wait(SOON_s)
    daq.hang = False
    outputs.wait_for(lambda output: output.status.fault == "loop_hung")
    while "the control loop hangs" not in caplog.text:
        assert time.monotonic() < deadline_s
        time.sleep(1e-3)
    assert "the control loop hangs (no step for" in caplog.text
    messages = [output.status.message for output in outputs.all if output.status.fault == "loop_hung"]
    assert all("the control loop hangs (no step for" in message for message in messages)


def test_an_output_that_somebody_else_switches_on_is_switched_off(make_driver):
    outputs = Outputs()
    driver = make_driver(on_output=outputs)
    supply, _ = driver.stand_ins
    driver.start()
    outputs.wait_for(lambda _: len(outputs.all) > 3)
    supply.output_on = True
    seen = len(outputs.all)
    outputs.wait_for(lambda _: len(outputs.all) > seen + 2)
    assert not supply.output_on


def test_current_is_set_before_the_output_is_switched_on(make_driver):
    outputs = Outputs()
    driver = make_driver(on_output=outputs, changes={"safety.reading_timeout": 60.0, "supply.watchdog_timeout": 60.0})
    supply, _ = driver.stand_ins
    driver.start()
    outputs.wait_for(lambda _: len(outputs.all) > 3)
    ok, sentence = driver.enable(True)
    assert ok, sentence
    outputs.wait_for(lambda output: output.command.output_on)
    driver.stop()
    first_on = supply.settings.index(("output", True))
    what, current_A = supply.settings[first_on - 1]
    assert what == "current"
    assert current_A == pytest.approx(0.05)


def test_more_setpoints_than_can_be_looked_at_are_a_flood(make_driver):
    outputs = Outputs()
    driver = make_driver(on_output=outputs)
    driver.start()
    outputs.wait_for(lambda _: len(outputs.all) > 3)
    assert driver.enable(True)[0]
    outputs.wait_for(lambda output: output.command.output_on)
    for _ in range(3000):
        driver.offer_setpoint(0.002)
    outputs.wait_for(lambda output: output.status.fault == "setpoint_flood")


def test_of_sixteen_wires_in_one_process_none_waits_for_another(make_driver):
    drivers = [make_driver(changes={"loop.rate": 20.0}, name=f"wire{i}") for i in range(16)]
    done = threading.Barrier(17)
    stepped_s: list[list[float]] = [[] for _ in drivers]
    for driver, steps_s in zip(drivers, stepped_s, strict=True):

        def on_output(_, steps_s=steps_s):
            steps_s.append(time.monotonic())
            if len(steps_s) == 20:
                done.wait(SOON_s)

        driver._on_output = on_output
    for driver in drivers:
        driver.start()
    done.wait(SOON_s)
    # A busy machine holds up all of them alike, and a pause is not in the median.
    periods_s = [statistics.median(np.diff(steps_s[:20])) for steps_s in stepped_s]
    assert min(periods_s) > 0.04 and max(periods_s) < 1.5 * min(periods_s)
    for driver in drivers:
        driver.stop()
        assert driver.stand_ins[0].shut_downs == 1


_PROGRAM = """
import json, signal, sys, threading
from stand_ins import RealClock, StandInDaq, StandInSupply
from sma_actuator.config import Config
from ending import signals_end_the_program
from sma_actuator.driver import Driver

class Supply(StandInSupply):
    def shut_down(self):
        super().shut_down()
        print("shut down", flush=True)

supply = Supply()
driver = Driver(Config.from_mapping(json.loads(sys.argv[1])), supply, StandInDaq(supply), RealClock())
driver.start()

def runs():
    print("runs", flush=True)

"""


@pytest.mark.parametrize(
    ("ending", "kill_with", "code"),
    [
        ("runs()", None, 0),
        ("runs(); sys.exit(3)", None, 3),
        ("runs(); raise ZeroDivisionError", None, 1),
        (
            # A program that is started in the background starts with SIGINT ignored.
            "signal.signal(signal.SIGINT, signal.default_int_handler); runs(); threading.Event().wait(60)",
            signal.SIGINT,
            -signal.SIGINT,
        ),
        ("with signals_end_the_program(): runs(); threading.Event().wait(60)", signal.SIGTERM, 128 + signal.SIGTERM),
        ("with signals_end_the_program(): runs(); threading.Event().wait(60)", signal.SIGHUP, 128 + signal.SIGHUP),
        ("with signals_end_the_program(): runs(); threading.Event().wait(60)", signal.SIGQUIT, 128 + signal.SIGQUIT),
    ],
    ids=["end of the program", "sys.exit", "exception", "SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT"],
)
def test_however_a_program_ends_the_supply_is_shut_down(make_config, ending, kill_with, code):
    process = subprocess.Popen(
        [sys.executable, "-c", _PROGRAM + ending, json.dumps(make_config())],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**STARTS_SOON, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])},
    )
    said = queue.Queue()
    reader = threading.Thread(target=lambda: [said.put(line) for line in process.stdout], daemon=True)
    reader.start()
    try:
        assert said.get(timeout=2 * SOON_s) == "runs\n"
        if kill_with is not None:
            process.send_signal(kill_with)
        assert said.get(timeout=SOON_s) == "shut down\n"
        assert process.wait(SOON_s) == code
    finally:
        process.kill()
        process.wait(SOON_s)
        reader.join(SOON_s)
        process.stdout.close()


def test_signals_end_the_program_where_that_was_asked_for_and_nowhere_else():
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)}
    with signals_end_the_program():
        for number in before:
            with pytest.raises(SystemExit) as ended:
                signal.raise_signal(number)
            assert ended.value.code == 128 + number
    assert {number: signal.getsignal(number) for number in before} == before


def test_a_program_started_with_sigint_ignored_shuts_the_supply_down_too(make_config):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        test_however_a_program_ends_the_supply_is_shut_down(
            make_config,
            "with signals_end_the_program(): runs(); threading.Event().wait(60)",
            signal.SIGTERM,
            128 + signal.SIGTERM,
        )
    finally:
        signal.signal(signal.SIGINT, before)
