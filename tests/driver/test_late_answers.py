"""A late answer is no lost instrument: a limit while it lasts, counted, and over as soon as the answer is there."""

import contextlib
import math
import time
from dataclasses import replace

import pytest
from liar import Liar

from sma_actuator.base.signals import Mode
from sma_actuator.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.bench.server import background
from sma_actuator.config import Config
from sma_actuator.driver import Driver
from sma_actuator.instruments import InstrumentLate, InstrumentLost
from sma_actuator.instruments.byte_streams import Manner
from sma_actuator.instruments.session import Session
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.limits import ANSWER_LATE

LATE_s = 0.3  #: longer than a time-out, shorter than safety.reading_timeout


class Rig:
    """A driver that drives a wire of the bench, in the bench's own time."""

    def __init__(self, mapping):
        self.config = Config.from_mapping(mapping)
        self.bench = VirtualBench.from_name("flexinol", seed=1)
        self.outputs = []
        self.supply = InProcessSupply(self.bench, self.config)
        self.daq = InProcessDaq(self.bench, self.config)
        self.driver = Driver(
            self.config,
            self.supply,
            self.daq,
            VirtualClock(self.bench),
            on_output=self.outputs.append,
        )
        self.driver.run_for(0.5)
        assert self.driver.enable(True)[0]
        self.driver.offer_setpoint(0.0025)
        self.driver.run_for(15.0)
        self.outputs.clear()

    @property
    def last(self):
        return self.outputs[-1]

    def late(self, seconds=LATE_s):
        """The DAQ's next answer comes late, the following in time."""
        in_time = self.daq.read_block

        def late():
            self.daq.read_block = in_time
            self.bench.inject("slow_answers", seconds)
            try:
                return in_time()
            finally:
                self.bench.clear("slow_answers")

        self.daq.read_block = late
        self.driver.run_for(0.05)

    def lates(self):
        return [output for output in self.outputs if ANSWER_LATE.name in output.status.limits]


@pytest.fixture
def rig(make_config):
    return Rig(make_config())


def test_one_late_answer_is_a_limit_that_passes_by_itself(rig):
    bias_A, held_m = rig.config.supply.bias_current, rig.last.estimate.displacement_m if rig.outputs else 0.0025
    rig.late()
    rig.driver.run_for(2.0)
    assert rig.lates()
    assert all(output.command.current_A == bias_A and output.command.output_on for output in rig.lates())
    assert all(output.status.fault == "" for output in rig.outputs)
    assert rig.last.status.mode is Mode.TRACKING and rig.last.status.limits == ()
    assert rig.last.command.current_A > bias_A
    assert rig.last.estimate.displacement_m == pytest.approx(held_m, abs=1e-4)


def test_it_does_not_heat_the_wire_and_hardly_moves_it(rig):
    before_m, before_C = rig.bench.truth.displacement_m, rig.bench.truth.temperature_C
    rig.late()
    hottest_C = furthest_m = 0.0
    for _ in range(40):
        rig.driver.run_for(0.05)
        hottest_C = max(hottest_C, rig.bench.truth.temperature_C)
        furthest_m = max(furthest_m, abs(rig.bench.truth.displacement_m - before_m))
    assert hottest_C < before_C + 3.0  # as it breathes under the loop
    assert furthest_m < 0.02 * rig.config.wire.full_stroke_m


def test_late_answers_and_the_slowest_of_the_last_minute_are_counted(rig):
    assert rig.driver.statistics().late_answers == 0
    rig.late()
    rig.driver.run_for(1.0)
    rig.late()
    rig.driver.run_for(1.0)
    statistics = rig.driver.statistics()
    assert statistics.late_answers == 2
    assert LATE_s <= statistics.slowest_answer_s < LATE_s + 0.1
    assert statistics.overruns >= 2
    rig.driver.run_for(61.0)
    assert rig.driver.statistics().slowest_answer_s < 0.1


@pytest.mark.parametrize(
    ("silent", "fault"), [("daq_silent", "daq_lost"), ("supply_silent", "supply_lost"), ("slow_answers", "daq_lost")]
)
def test_where_nothing_comes_the_current_is_cut_in_the_promised_time(rig, silent, fault):
    rig.bench.inject(silent, 30.0)
    promised_s = FAULTS[fault].within(rig.config)
    began_s = rig.bench.time_s
    while not (rig.outputs and rig.last.status.fault):
        rig.driver.run_for(0.05)
        assert rig.bench.time_s - began_s < 5.0
    assert rig.last.status.fault == fault
    assert rig.outputs[0].command.current_A == rig.config.supply.bias_current  # at once, before it is known to be lost
    thought_s = rig.bench.time_s - began_s
    rig.driver.run_for(0.0 if silent == "daq_silent" else 3.0)  # a supply that is silent is cut by its watchdog
    assert rig.bench.current_A < 1e-3 or not rig.bench.supply.output_on
    assert thought_s <= promised_s + 1e-6 + (0.0 if silent == "daq_silent" else rig.config.instruments.supply.timeout)


@pytest.mark.parametrize(("name", "question"), [("daq", "read_block"), ("supply", "read_back")])
def test_what_is_of_longer_ago_than_an_answer_may_take_does_not_heat(rig, name, question):
    instrument = getattr(rig, name)
    in_time, bias_A = getattr(instrument, question), rig.config.supply.bias_current

    def late():
        said = in_time()
        return replace(said, time_s=said.time_s - LATE_s)

    setattr(instrument, question, late)
    rig.driver.run_for(3.0)
    assert rig.lates() == rig.outputs
    assert all(output.command.current_A == bias_A and output.command.output_on for output in rig.outputs)
    assert all(output.status.fault == "" for output in rig.outputs)
    setattr(instrument, question, in_time)
    rig.driver.run_for(10.0)
    assert rig.last.status.mode is Mode.TRACKING and rig.last.status.limits == ()
    assert rig.last.estimate.displacement_m == pytest.approx(0.0025, abs=1e-4)


def test_off_waits_for_a_late_supply_and_is_confirmed(rig):
    rig.bench.inject("slow_answers", LATE_s)
    with pytest.raises(InstrumentLate):
        rig.supply.read_back()
    rig.bench.clear()
    done, words = rig.driver.enable(False)
    assert (done, words) == (True, "the output is off")
    assert not rig.bench.supply.output_on
    rig.driver.run_for(1.0)
    assert rig.last.status.fault == ""


def test_a_supply_that_owes_its_answer_is_not_enabled_unseen(rig):
    assert rig.driver.enable(False)[0]
    rig.driver.run_for(0.5)
    rig.bench.inject("slow_answers", 0.3)
    done, words = rig.driver.enable(True)
    assert not done and "not enabled: virtual supply: no answer within 0.2 s" in words
    assert not rig.bench.supply.output_on
    rig.bench.clear()
    rig.driver.run_for(1.0)
    assert rig.driver.enable(True)[0]


class TestOverTcp:
    @pytest.fixture
    def liar(self):
        with background(VirtualBench.from_name("flexinol")) as server:
            liar = Liar(server.ports[0]["daq"])
            yield liar
            liar.close()

    @pytest.fixture
    def session(self, liar):
        session = Session("daq", liar.resource, Manner(), timeout_s=1.0)
        session.open()
        session.ask("*IDN?")
        session._timeout_s = 0.2
        session.patience_s = 30.0
        yield session
        session.close()

    def test_a_late_answer_is_never_taken_for_the_next(self, liar, session):
        liar.late_s = 0.5
        with pytest.raises(InstrumentLate, match=r"no complete answer to 'SYST:TIME:ELAP\?' within 0.2 s"):
            session.ask("SYST:TIME:ELAP?")
        liar.late_s = 0.0
        session._timeout_s = 10.0
        assert session.ask("SAMP:RATE?") == "1000"

    def test_where_each_is_late_it_is_that_of_the_same_question_asked_before(self, liar, session):
        liar.late_s = 0.5
        for number in range(3):
            while True:
                began_s = time.monotonic()
                with contextlib.suppress(InstrumentLate), session.within(0.2):
                    assert session.ask_for("SAMP:RATE?", str, late_counts=True) == "1000"
                    break
            assert began_s - 1.0 < session.late_since_s < time.monotonic() - 0.5
            assert liar.times_heard("SAMP:RATE?") == number + 1

    def test_one_that_is_too_old_is_asked_anew(self, liar, session):
        liar.late_s = 0.5
        with pytest.raises(InstrumentLate):
            session.ask_for("SAMP:RATE?", str, late_counts=True)
        liar.late_s = 0.0
        session._timeout_s = 10.0
        assert session.ask("*IDN?")  # which hears it
        session.patience_s = 0.1
        with session.within():
            assert session.ask_for("SAMP:RATE?", str, late_counts=True) == "1000"
        assert session.late_since_s == math.inf and liar.times_heard("SAMP:RATE?") == 2

    def test_one_that_is_late_twice_is_the_same(self, liar, session):
        liar.manner = "mute"
        asked = []
        for _ in range(3):
            with pytest.raises(InstrumentLate) as late:
                session.ask("SAMP:RATE?")
            asked.append(late.value.asked_s)
        assert len(set(asked)) == 1
        assert liar.times_heard("SAMP:RATE?") == 1

    def test_what_does_not_come_in_the_time_that_is_left_is_lost(self, liar, session):
        liar.manner = "mute"
        session.patience_s = 0.5
        began_s = time.monotonic()
        with pytest.raises(InstrumentLost) as lost:
            while True:
                try:
                    session.ask("SAMP:RATE?")
                except InstrumentLate:
                    assert time.monotonic() - began_s < 5.0
        assert not isinstance(lost.value, InstrumentLate)
        assert time.monotonic() - began_s >= 0.5
        with pytest.raises(InstrumentLost, match="not connected"):
            session.ask("SAMP:RATE?")

    def test_off_is_said_while_an_answer_is_owed(self, liar, session):
        liar.manner = "mute"
        with pytest.raises(InstrumentLate):
            session.ask("SAMP:RATE?")
        session.tell("BENC:FAUL slow_answers,0")
        deadline_s = time.monotonic() + 30.0
        while not liar.times_heard("BENC:FAUL slow_answers,0"):
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
