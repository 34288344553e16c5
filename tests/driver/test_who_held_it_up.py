"""Time that the loop waits for an instrument is that instrument's: the fault names it, whoever is first to see it.

In the bench's own time, so that every order of step and watchman is tried, and none is left to chance.
"""

import itertools

import pytest

from sma_actuator.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.safety.records import Waited

PATIENCE_s, RATE_Hz = 1.0, 10.0
LOOK_s = 0.05  #: how often the watchman looks


class Rig:
    """A driven wire.  Its instruments' answers come late from a moment on; the watchman looks while time goes by."""

    def __init__(self, mapping):
        self.config = Config.from_mapping(mapping)
        self.bench = VirtualBench.from_name("flexinol", seed=1)
        self.supply, self.daq = InProcessSupply(self.bench, self.config), InProcessDaq(self.bench, self.config)
        self.outputs, self.late_s, self.asked, self.watched = [], {}, 0, False
        for instrument in (self.supply, self.daq):
            self._make_late(instrument)
        self._advance, self.bench.advance = self.bench.advance, self.advance
        self.driver = Driver(
            self.config, self.supply, self.daq, VirtualClock(self.bench), on_output=self.outputs.append
        )
        self.driver.run_for(0.5)
        assert self.driver.enable(True)[0]
        self.driver.run_for(1.0)
        self.asked = 0

    def _make_late(self, instrument):
        in_time = instrument._reach

        def late(timeout_s):
            self.asked += 1
            seconds, from_question = self.late_s.get(instrument.name, (0.0, 0))
            self.bench.inject("slow_answers", seconds if self.asked > from_question else 0.0)
            in_time(timeout_s)

        instrument._reach = late

    def advance(self, until_s):
        while until_s - self.bench.time_s > 5e-4:
            self._advance(min(until_s, self.bench.time_s + LOOK_s))
            if self.watched:
                self.driver._loop.watchman.look()

    def until_a_fault(self, within_s=4.0):
        """Name of the first; what comes after it must not take its place."""
        until_s = self.bench.time_s + within_s
        while not (self.outputs and self.outputs[-1].status.fault):
            assert self.bench.time_s < until_s
            self.driver.run_for(1.0 / RATE_Hz)
        return self.outputs[-1].status


@pytest.fixture
def make_rig(make_config):
    made = []

    def make(supply_timeout_s):
        changes = {
            "loop.rate": RATE_Hz,
            "instruments.supply.timeout": supply_timeout_s,
            "instruments.daq.timeout": 0.3,
            "safety.reading_timeout": PATIENCE_s,
            "supply.watchdog_timeout": 0.0,
            "supply.allow_no_watchdog": True,
        }
        made.append(Rig(make_config(**changes)))
        return made[-1]

    yield make
    for one in made:
        one.late_s, one.watched = {}, False
        one.driver.stop()


@pytest.mark.parametrize("watched", [False, True])
@pytest.mark.parametrize("who", [("supply",), ("daq",), ("supply", "daq")])
def test_what_is_latched_names_the_instrument_that_is_late(make_rig, who, watched):
    rig = make_rig(0.5)
    for late_s, from_question in itertools.product((0.7, 0.97, 1.0, 1.03, 1.6), range(8)):
        rig.late_s, rig.watched, rig.asked = dict.fromkeys(who, (late_s, from_question)), watched, 0
        status = rig.until_a_fault()
        assert status.fault in {f"{name}_lost" for name in who} | {"output_not_confirmed"}, (late_s, from_question)
        assert not any(word in status.message for word in ("hangs", "jumped", "overruns")), status.message
        rig.late_s, rig.watched = {}, False
        rig.driver.run_for(3.0)
        assert not rig.bench.supply.output_on
        assert rig.driver.clear_fault()[0]
        assert rig.driver.enable(True)[0]
        rig.driver.run_for(0.6)
        assert rig.outputs[-1].status.fault == ""


@pytest.mark.parametrize("where", ["between the steps", "while it waits for the supply", "while it waits for the DAQ"])
@pytest.mark.parametrize(("watched", "fault"), [(False, "clock_jump"), (True, "loop_hung")])
def test_a_process_that_was_stopped_is_no_late_instrument(make_rig, where, watched, fault):
    rig = make_rig(0.3)
    rig.watched = watched
    instrument = rig.daq if "DAQ" in where else rig.supply
    in_time = instrument._reach

    def stopped(timeout_s):
        instrument._reach = in_time
        rig.advance(rig.bench.time_s + 2.0 * PATIENCE_s)
        in_time(timeout_s)

    if where == "between the steps":
        rig.advance(rig.bench.time_s + 2.0 * PATIENCE_s)
        rig.driver.run_for(1.0 / RATE_Hz)
    else:
        instrument._reach = stopped
    assert rig.until_a_fault().fault == fault


@pytest.mark.parametrize(
    ("elapsed_s", "daq_s", "supply_s", "name"),
    [
        (1.1, 0.0, 0.9, "supply"),
        (1.1, 0.6, 0.3, "daq"),
        (1.1, 0.2, 0.2, ""),
        (1.1, 0.0, 0.51, "supply"),
        (1.1, 0.0, 0.49, ""),
        (5.0, 0.0, 0.5, ""),
    ],
)
def test_whose_time_it_is_is_who_took_most_of_it_but_for_the_period(elapsed_s, daq_s, supply_s, name):
    most, words = Waited(daq_s, supply_s).most(elapsed_s, 0.1)
    assert most == name
    assert words == (f", {max(daq_s, supply_s):.3g} s of them waiting for the {name}" if name else "")
