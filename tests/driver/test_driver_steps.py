"""The driver's steps one by one, by a clock that stands until somebody turns it: deadlines, what is told when, what is
said of it."""

import itertools
import math
import threading
import time

import pytest
from stand_ins import StandInDaq, StandInSupply

from sma_actuator.base.realtime import RealtimeRefused
from sma_actuator.base.signals import Command, Mode, Reading, SupplyState
from sma_actuator.config import Config
from sma_actuator.driver import CURRENT_RESOLUTION_A, NOT_ASKED, OFF_MEANWHILE, CHECK_PERIOD_s, Driver, DriverStopped
from sma_actuator.driver.output import Known
from sma_actuator.instruments import InstrumentLate, InstrumentLost, InstrumentUnreachable, LimitsNotHeld, OutputStaysOn
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.guards.program import loop_hung
from sma_actuator.safety.records import Waited

RATE_Hz, PERIOD_s = 8.0, 0.125  #: so that times are sums without rounding
NAN = math.nan
QUICK_WATCHMAN = {
    "safety.reading_timeout": 0.5,
    "supply.watchdog_timeout": 60.0,
    "instruments.supply.timeout": 0.1,
    "instruments.daq.timeout": 0.1,
}


class HandClock:
    """Stands still but for who sleeps or turns it."""

    def __init__(self):
        self.s = 1000.0

    def now_s(self):
        return self.s

    def sleep_until_s(self, deadline_s):
        self.s = max(self.s, deadline_s)


class Supply(StandInSupply):
    """That notes everything it is asked and told, by name, and raises what a test says."""

    def __init__(self):
        super().__init__()
        self.words = []
        self.errors = {}

    def _note(self, name):
        self.words.append(name)
        if name in self.errors:
            raise self.errors[name]

    def open(self):
        self._note("open")
        super().open()

    def set_current(self, current_A):
        self._note(f"current {current_A:g}")
        super().set_current(current_A)

    def set_output(self, on):
        self._note(f"output {on}")
        super().set_output(on)

    def switch_off(self):
        self._note("off")
        self.output_on, self.current_A = False, 0.0

    def read_back(self):
        self._note("read")
        return super().read_back()

    def check_settings(self):
        self._note("check all")

    def check_next_setting(self):
        self._note("check one")

    def clear_trip(self):
        self._note("clear")

    def shut_down(self):
        self._note("shut down")
        return super().shut_down()

    def close(self):
        self._note("close")


class Daq(StandInDaq):
    """In the clock's time; reading a block takes as long as ``takes_s`` says, one after the other."""

    def __init__(self, supply, clock):
        super().__init__(supply)
        self.clock = clock
        self.takes_s = []
        self.closed = 0
        self.extra_A = 0.0  #: that flow whatever the supply says

    def read_block(self):
        self.clock.s += self.takes_s.pop(0) if self.takes_s else 0.0
        reading = super().read_block()
        shift_V = 6.5 * self.extra_A
        return Reading(
            self.clock.s,
            reading.supply_voltage_V + shift_V,
            reading.reference_voltage_V + self.extra_A,
            reading.load_cell_voltage_V,
        )

    def close(self):
        self.closed += 1


class Rig:
    def __init__(self, mapping, **arguments):
        self.config = Config.from_mapping(mapping)
        self.clock = HandClock()
        self.supply = Supply()
        self.supply.now_s = self.clock.now_s
        self.daq = Daq(self.supply, self.clock)
        self.outputs = []
        self.driver = Driver(
            self.config, self.supply, self.daq, self.clock, on_output=self.outputs.append, name="wire", **arguments
        )

    def steps(self, number):
        """So many; the words to the supply meanwhile."""
        before = len(self.supply.words)
        for _ in range(number):
            self.driver._step_at_deadline()
        return self.supply.words[before:]

    def drive(self):
        """Bias current flows, and one step without a check of a setting follows."""
        self.steps(3)
        done, words = self.driver.enable(True)
        assert done, words
        self.steps(2)
        assert self.supply.output_on

    @property
    def status(self):
        return self.outputs[-1].status


@pytest.fixture
def make(make_config):
    rigs = []

    def make(changes=None, **arguments):
        common = {"loop.rate": RATE_Hz, "loop.samples_per_block": 100, "safety.reading_timeout": 2.0}
        rigs.append(Rig(make_config(**{**common, **(changes or {})}), **arguments))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.driver.stop()


class TestDeadlines:
    def test_steps_come_a_period_apart_and_missed_deadlines_are_skipped(self, make):
        rig = make()
        rig.daq.takes_s = [0.02, 0.02, 0.3, 0.02, 0.125, 0.02]
        began_s = []
        for _ in range(6):
            rig.driver._step_at_deadline()
            began_s.append(rig.driver._loop.deadlines.last_step_s - 1000.0)
        assert began_s == [0.0, 0.125, 0.25, 0.625, 0.75, 1.0]
        statistics = rig.driver.statistics()
        assert (statistics.steps, statistics.overruns) == (6, 3)
        assert statistics.period_mean_s == pytest.approx(0.2)
        assert statistics.period_p99_s == pytest.approx(0.375 - 0.04 * 0.125)
        assert statistics.period_max_s == 0.375
        assert statistics.busy_mean_s == pytest.approx(0.505 / 6)
        assert statistics.busy_max_s == pytest.approx(0.3)

    def test_a_clock_that_goes_back_takes_no_deadline_twice(self, make):
        rig = make()
        rig.daq.takes_s = [0.02, -0.5]
        rig.steps(2)
        assert rig.driver.statistics().overruns == 0
        assert rig.driver._loop.deadlines.next_s(rig.clock.now_s) == 1000.25

    def test_there_are_no_figures_before_there_are_steps(self, make):
        rig = make()
        statistics = rig.driver.statistics()
        assert (statistics.steps, statistics.overruns) == (0, 0)
        assert math.isnan(statistics.period_mean_s) and math.isnan(statistics.busy_max_s)
        rig.steps(1)
        assert rig.driver.statistics().steps == 1
        assert math.isnan(rig.driver.statistics().period_mean_s)

    def test_running_for_a_time_takes_the_steps_whose_deadline_is_in_it(self, make):
        rig = make()
        output = rig.driver.run_for(1.0)
        assert output is rig.outputs[-1]
        assert (len(rig.outputs), rig.clock.s) == (8, 1001.0)
        assert rig.driver.run_for(0.0) is None
        rig.driver.run_for(0.1)
        assert (len(rig.outputs), rig.clock.s) == (9, 1001.1)

    def test_a_long_sleep_is_cut_into_pieces_between_which_calls_are_made(self, make):
        rig = make()
        rig.steps(1)
        slept_s = []
        sleep = rig.clock.sleep_until_s
        rig.clock.sleep_until_s = lambda deadline_s: (slept_s.append(deadline_s - rig.clock.s), sleep(deadline_s))
        rig.steps(1)
        assert slept_s == pytest.approx([0.05, 0.05, 0.025])

    def test_a_stop_ends_the_sleep_before_the_step(self, make):
        rig = make()
        rig.steps(1)
        steps = len(rig.outputs)
        rig.driver._stopping.set()
        assert rig.driver._step_at_deadline() is None
        assert (len(rig.outputs), rig.clock.s) == (steps, 1000.05)


class TestTold:
    def test_opening_is_done_once_and_with_it_the_output_is_known_to_be_off(self, make):
        rig = make()
        assert rig.driver.failure is None
        assert rig.driver.lost_instruments == {"supply": NOT_ASKED, "daq": NOT_ASKED}
        assert not rig.driver.output_is_off, "nothing is known yet"
        rig.driver.open()
        assert rig.driver.output_is_off
        assert rig.driver.hardware_id == "stand-in supply"
        rig.steps(2)
        assert rig.supply.words.count("open") == 1

    def test_a_current_is_sent_where_it_differs_by_more_than_the_supplies_resolution(self, make):
        rig = make()
        rig.drive()
        on_A = rig.supply.current_A
        rig.supply.words.clear()

        def write(current_A):
            rig.supply.words.clear()
            rig.driver._output.write(Command(current_A, True), None)
            return rig.supply.words

        assert write(on_A) == []
        assert write(on_A + 0.99 * CURRENT_RESOLUTION_A) == []
        # In small steps, but away from what it was told.
        assert write(on_A + 1.98 * CURRENT_RESOLUTION_A) == [f"current {on_A + 1.98 * CURRENT_RESOLUTION_A:g}"]
        assert write(on_A) == [f"current {on_A:g}"]
        assert rig.driver.output_words == "the output is on"

    def test_off_is_said_where_it_is_not_known_and_not_again(self, make):
        rig = make()
        off = SupplyState(NAN, 0.0, False, 0.0, 0.0)
        rig.driver.open()
        on = SupplyState(NAN, 0.0, True, 0.0, 0.0)
        for state, words in ((None, ["off"]), (None, []), (off, []), (on, ["off"])):
            rig.supply.words.clear()
            rig.driver._output.write(Command(0.0, False), state)
            assert rig.supply.words == words

    def test_off_is_said_again_until_it_is_confirmed(self, make):
        rig = make()
        rig.drive()
        rig.supply.errors["off"] = InstrumentLost("no answer")
        for _ in range(2):
            with pytest.raises(InstrumentLost):
                rig.driver._output.write(Command(0.0, False), None)
            assert rig.driver.output_words == "the output is told to be off, not confirmed"
            assert not rig.driver.output_is_off
        rig.supply.errors.clear()
        rig.driver._output.write(Command(0.0, False), None)
        assert rig.driver.output_words == "the output is off"
        assert rig.driver.output_is_off

    def test_current_and_output_are_told_again_where_telling_failed(self, make):
        rig = make()
        rig.driver.open()
        rig.supply.errors["output True"] = InstrumentLost("no answer")
        with pytest.raises(InstrumentLost):
            rig.driver._output.write(Command(0.1, True), None)
        assert rig.driver.output_words == "the output is told to be off, not confirmed"
        rig.supply.errors.clear()
        rig.supply.words.clear()
        rig.driver._output.write(Command(0.1, True), None)
        assert rig.supply.words == ["current 0.1", "output True"]

    def test_settings_are_looked_at_every_so_often_while_driving(self, make):
        rig = make()
        assert "check one" not in rig.steps(10)
        rig.drive()
        words = rig.steps(40)
        assert words.count("check one") == 40 * PERIOD_s / CHECK_PERIOD_s
        rig.driver.enable(False)
        assert "check one" not in rig.steps(10)

    @pytest.mark.parametrize("rate_Hz", [1.0, 1.5, 7.0, 20.0])
    def test_each_of_four_settings_is_looked_at_in_the_time_that_its_fault_promises(self, make, rate_Hz):
        slow = {"supply.watchdog_timeout": 3.0, "safety.reading_timeout": 3.0, "safety.stuck_time": 60.0}
        rig = make({"loop.rate": rate_Hz, "loop.samples_per_block": 40, **slow})
        looked_s = []
        rig.supply.check_next_setting = lambda: looked_s.append(rig.clock.s)
        rig.steps(3)
        assert rig.driver.enable(True)[0]
        rig.steps(2)
        rig.daq.takes_s = [0.4 / rate_Hz * (step % 3) for step in range(round(20 * rate_Hz))]
        rig.steps(len(rig.daq.takes_s))
        promised_s = FAULTS["limits_not_held"].within(rig.config)
        late_s = 0.8 / rate_Hz  # the longest that a reading takes here
        assert len(looked_s) > 30
        assert max(b - a for a, b in zip(looked_s, looked_s[4:])) <= promised_s + late_s

    def test_after_on_which_has_looked_at_all_of_them_they_are_looked_at_one_by_one(self, make):
        rig = make()
        rig.steps(40)
        assert rig.driver.enable(True)[0]
        assert rig.steps(2).count("check one") == 1

    def test_a_clock_that_jumps_ahead_has_each_setting_looked_at_once(self, make):
        rig = make()
        rig.drive()
        rig.daq.takes_s = [1e6]
        assert rig.steps(1).count("check one") == 4

    def test_a_setting_that_does_not_hold_is_a_fault_of_that_step(self, make):
        rig = make()
        rig.drive()
        rig.supply.errors["check one"] = LimitsNotHeld("supply: does not hold")
        while "check one" not in rig.steps(1):
            assert rig.outputs[-1].command.output_on
        assert rig.status.fault == "limits_not_held"
        assert not rig.outputs[-1].command.output_on

    @pytest.mark.parametrize("instrument", ["supply", "daq"])
    def test_an_instrument_that_does_not_answer_is_a_fault_of_that_step(self, make, instrument):
        rig = make()
        rig.drive()
        if instrument == "daq":
            rig.daq.lost = True
        else:
            rig.supply.errors["read"] = InstrumentLost("no answer")
        rig.steps(1)
        assert rig.status.fault == f"{instrument}_lost"
        assert not rig.outputs[-1].command.output_on


class TestResolution:
    """Supplies that take a current in steps, and say what they took."""

    @pytest.mark.parametrize(("step_A", "fault"), [(1e-3, ""), (5e-3, "second_commander")])
    def test_one_of_coarse_steps_is_refused_in_words_that_say_so(self, make, step_A, fault):
        rig = make({"supply.bias_current": 0.0525})
        told = rig.supply.set_current

        def take(current_A):
            told(current_A)
            rig.supply.current_A = round(current_A / step_A) * step_A

        rig.supply.set_current = take
        rig.steps(3)
        assert rig.driver.enable(True)[0]
        rig.steps(2)
        assert rig.status.fault == fault
        if fault:
            assert "the supply says 0.05 A, output on; it was told 0.0525 A, output on" in rig.status.message
            assert "in coarser steps than its dialect writes" in FAULTS[fault].advice
            assert not rig.supply.output_on

    def test_one_that_takes_no_current_at_all_is_refused(self, make):
        rig = make()
        rig.supply.set_current = lambda current_A: rig.supply.words.append("ignored")
        rig.steps(3)
        assert rig.driver.enable(True)[0]
        rig.steps(2)
        assert rig.status.fault == "second_commander"
        assert not rig.supply.output_on


class TestFed:
    @pytest.mark.parametrize(("silent_s", "fault"), [(1.0, ""), (1.125, "node_lost")])
    def test_a_commander_has_its_whole_time(self, make, silent_s, fault):
        rig = make(feed_timeout_s=1.0)
        rig.steps(1)
        rig.driver.feed()
        for _ in range(round(silent_s / PERIOD_s)):
            rig.driver._step_at_deadline()
        assert rig.status.fault == fault
        if fault:
            assert "the node has not been heard of for 1 s" in rig.status.message

    def test_nobody_has_to_feed_where_nobody_said_so(self, make):
        rig = make()
        rig.steps(1)
        rig.clock.s += 1e6
        rig.steps(3)
        assert rig.status.fault == ""


class TestSetpoints:
    def test_as_many_as_a_thousand_wait_and_one_more_is_a_flood(self, make):
        rig = make()
        rig.drive()
        raised = []
        rig.driver._actuator.raise_fault = lambda now_s, name, detail: raised.append((name, detail))
        rig.driver._actuator.offer_setpoint = lambda now_s, position_m: ""
        for number, said in (
            (1024, []),
            (1026, [("setpoint_flood", "2 setpoints came faster than the loop could look at them")]),
        ):
            for _ in range(number):
                rig.driver.offer_setpoint(0.002)
            rig.steps(1)
            assert raised == said
        rig.steps(1)
        assert len(raised) == 1, "it is said once"

    def test_they_count_from_when_they_came(self, make):
        rig = make()
        rig.steps(1)
        came_s = []
        rig.driver._actuator.offer_setpoint = lambda now_s, position_m: came_s.append((now_s, position_m)) or ""
        rig.driver.offer_setpoint(0.002)
        rig.clock.s += 0.05
        rig.driver.offer_setpoint(0.001)
        rig.steps(1)
        assert came_s == [(1000.0, 0.002), (1000.05, 0.001)]
        assert not rig.driver.has_refusals

    def test_whatever_is_offered_reaches_the_actuator_as_it_is(self, make):
        rig = make()
        rig.steps(1)
        came = []

        class Actuator:
            def __getattr__(self, name):
                return lambda *arguments: came.append((name, arguments)) or ""

        actuator, rig.driver._actuator = rig.driver._actuator, Actuator()
        rig.driver.offer_setpoint(0.001)
        rig.driver.offer_joint_command(NAN)
        rig.driver.offer_trajectory([1.0], [0.002])
        rig.driver.offer_trajectory([1.0], [0.002], [0.0], delay_s=0.5)
        rig.driver.take_offers(rig.clock.s)
        rig.driver._actuator = actuator
        assert [name for name, _ in came] == ["offer_setpoint", "offer_joint_command", *["offer_trajectory"] * 2]
        assert came[0][1] == (1000.0, 0.001)
        assert math.isnan(came[1][1][1])
        assert [arguments for _, arguments in came[2:]] == [
            (1000.0, [1.0], [0.002], None, 0.0),
            (1000.0, [1.0], [0.002], [0.0], 0.5),
        ]

    def test_refusals_are_handed_out_once_in_order_and_no_more_than_sixteen(self, make):
        rig = make()
        rig.steps(1)
        number = iter(range(100))
        rig.driver._actuator.offer_setpoint = lambda now_s, position_m: f"no {next(number)}"
        for _ in range(20):
            rig.driver.offer_setpoint(0.002)
        rig.steps(1)
        assert rig.driver.has_refusals
        assert rig.driver.refusals() == [f"no {n}" for n in range(4, 20)]
        assert rig.driver.refusals() == []
        assert not rig.driver.has_refusals


class TestLost:
    def test_one_that_is_lost_while_it_is_told_something_is_a_fault_though_it_is_found_again_at_once(self, make):
        rig = make()
        rig.steps(3)
        assert rig.driver.enable(True)[0]
        rig.supply.errors["output True"] = InstrumentLost("no answer")
        rig.steps(1)
        rig.supply.errors.clear()
        rig.steps(1)
        assert rig.driver.lost_instruments == {}
        assert rig.status.fault == "supply_lost"

    def test_a_supply_that_may_be_on_is_left_in_silence_for_its_watchdog(self, make):
        rig = make({"supply.watchdog_timeout": 0.8})
        rig.drive()
        rig.supply.errors |= {"read": InstrumentLost("no answer"), "open": InstrumentLost("no answer")}
        words = [(rig.clock.s, rig.steps(1)) for _ in range(17)]
        opened_s = [when_s for when_s, said in words if "open" in said]
        assert [b - a for a, b in itertools.pairwise(opened_s)] == [1.0]  # 1.25 × its time
        assert rig.status.fault == "supply_lost"
        assert "the output is told to be off, not confirmed" in rig.driver.lost_instruments["supply"]
        rig.supply.errors.clear()
        rig.steps(10)
        assert rig.driver.output_is_off
        assert rig.driver.lost_instruments == {}

    def test_one_that_is_off_is_tried_more_often(self, make):
        rig = make({"supply.watchdog_timeout": 60.0})
        rig.steps(1)
        rig.supply.errors |= {"read": InstrumentLost("no answer"), "open": InstrumentLost("no answer")}
        assert rig.steps(12).count("open") > 2
        assert rig.driver.lost_instruments == {"supply": "no answer"}

    def test_a_daq_that_is_lost_takes_no_current_from_the_supplys_watchdog(self, make):
        rig = make({"supply.watchdog_timeout": 60.0})
        rig.drive()
        rig.daq.lost = True
        opened = []
        rig.daq.open = lambda: opened.append(rig.clock.s) or (_ for _ in ()).throw(InstrumentLost("no answer"))
        rig.steps(12)
        assert len(opened) > 2
        assert rig.status.fault == "daq_lost"
        assert not rig.supply.output_on

    def test_what_a_reopened_supply_was_told_before_does_not_count(self, make):
        rig = make()
        rig.steps(2)
        rig.supply.errors["read"] = InstrumentLost("no answer")
        rig.steps(1)
        rig.supply.errors.clear()
        assert rig.steps(2)[:3] == ["open", "read", "off"]

    def test_an_output_that_another_switches_on_and_that_stays_on_is_not_called_off(self, make):
        rig = make()
        rig.steps(2)
        assert rig.driver.output_is_off
        rig.supply.output_on = True
        rig.supply.errors["off"] = OutputStaysOn("supply")
        rig.steps(1)
        assert not rig.driver.output_is_off
        assert rig.status.values["output"] == "told to be off, not confirmed"

    def test_off_is_said_after_one_that_was_lost_between_two_steps_is_found_again(self, make):
        rig = make()
        rig.drive()
        rig.driver.call(lambda actuator, now_s: actuator.raise_fault(now_s, "node_lost", "a test"))
        rig.steps(2)
        rig.supply.errors["clear"] = InstrumentLost("no answer")
        assert rig.driver.clear_fault() == (False, "not cleared: the output is off (no answer)")
        assert rig.steps(1) == ["open", "read", "off"]

    def test_an_output_that_is_not_confirmed_is_a_fault(self, make):
        rig = make()
        rig.drive()
        rig.supply.errors["off"] = OutputStaysOn("supply")
        done, words = rig.driver.enable(False)
        assert not done
        assert words == (
            "the output is told to be off, not confirmed: supply: was told to switch off and answers that its output "
            "is on"
        )
        assert rig.driver.call(lambda actuator, _: actuator.latched) == "output_not_confirmed"
        rig.steps(1)
        assert rig.status.message.startswith("the output is told to be off, not confirmed")
        assert rig.status.values["output"] == "told to be off, not confirmed"

    def test_a_fault_is_not_cleared_while_an_instrument_is_lost(self, make):
        rig = make()
        rig.steps(1)
        rig.daq.lost = True
        rig.steps(1)
        words = "the daq still does not answer: stand-in DAQ: no answer"
        assert rig.driver.clear_fault() == (False, words)
        rig.supply.errors |= {"read": InstrumentLost("gone"), "open": InstrumentUnreachable("away")}
        rig.steps(1)
        assert rig.driver.clear_fault()[1].startswith("the supply still does not answer: ")
        assert words in rig.driver.clear_fault()[1]

    @pytest.mark.parametrize(
        ("failing", "known"), [("clear", "on"), ("off", "told to be off, not confirmed")], ids=["clear", "off"]
    )
    def test_a_fault_is_not_cleared_where_off_is_not_confirmed(self, make, failing, known):
        rig = make()
        rig.drive()
        rig.driver.call(lambda actuator, now_s: actuator.raise_fault(now_s, "node_lost", "a test"))
        rig.supply.errors[failing] = InstrumentLost("no answer")
        done, words = rig.driver.clear_fault()
        assert not done
        assert words == f"not cleared: the output is {known} (no answer)"
        rig.supply.errors.clear()
        assert rig.steps(1)[0] == "open", "which says off first"
        assert rig.driver.output_is_off

    def test_enabling_looks_at_every_setting_first(self, make):
        rig = make()
        rig.steps(3)
        rig.supply.errors["check all"] = LimitsNotHeld("supply: does not hold its limits")
        done, words = rig.driver.enable(True)
        assert not done
        assert "supply: does not hold its limits" in words
        rig.steps(2)
        assert not rig.supply.output_on


class TestSaid:
    def test_current_behind_an_output_that_is_off_is_said_once_it_lasts(self, make):
        rig = make({"safety.current_disagreement": 0.05, "safety.disagreement_time": 0.25})
        rig.steps(2)
        rig.daq.extra_A = 0.06
        said = []
        for _ in range(4):
            rig.steps(1)
            said.append(rig.status.values["output"])
        assert said[:2] == ["off", "off"]
        assert said[2].startswith("read back as off, and 0.06 A flow: pull the supply's plug")
        assert rig.status.message.startswith("the output is read back as off, and 0.06 A flow: pull the supply's plug")
        rig.daq.extra_A = 0.0
        rig.steps(1)
        assert rig.status.values["output"] == "off"
        rig.daq.extra_A = 0.06
        rig.steps(1)
        assert rig.status.values["output"] == "off", "it begins anew"

    def test_what_flowed_before_readings_were_unusable_is_not_said_to_flow_on(self, make):
        rig = make({"safety.current_disagreement": 0.05, "safety.disagreement_time": 0.25})
        rig.drive()
        rig.daq.extra_A = 0.06
        rig.steps(1)
        rig.daq.extra_A = math.nan
        rig.driver.enable(False)
        rig.steps(10)
        assert rig.status.values["output"] == "off"

    def test_it_counts_from_the_first_reading(self, make):
        rig = make({"safety.current_disagreement": 0.05, "safety.disagreement_time": 0.25})
        rig.daq.extra_A = 0.06
        rig.steps(3)
        assert rig.status.values["output"].startswith("read back as off, and 0.06 A flow")

    def test_a_current_that_may_be_an_error_of_the_readings_is_none(self, make):
        rig = make({"safety.current_disagreement": 0.05, "safety.disagreement_time": 0.25})
        rig.steps(2)
        rig.daq.extra_A = 0.045
        rig.steps(8)
        assert rig.status.values["output"] == "off"

    def test_on_is_said_while_it_is(self, make):
        rig = make()
        rig.drive()
        assert rig.driver.output_words == "the output is on"
        assert not rig.driver.output_is_off
        assert rig.status.values["output"] == "on"
        assert "output" not in rig.status.message.split(":")[0]
        assert rig.driver.enable(False) == (True, "the output is off")

    def test_what_the_watchman_has_put_out_is_not_followed_by_what_is_older(self, make):
        rig = make()
        rig.drive()
        seen = len(rig.outputs)
        record = rig.driver._actuator.step

        def cut_meanwhile(*arguments):
            output = record(*arguments)
            rig.driver._output._cut = loop_hung, "no step for long"
            return output

        rig.driver._actuator.step = cut_meanwhile
        words = rig.steps(1)
        rig.driver._actuator.step = record
        assert len(rig.outputs) == seen
        assert "off" in words and not rig.supply.output_on
        rig.steps(1)
        assert rig.status.fault == "loop_hung"
        assert "no step for long" in rig.status.message

    def test_every_step_is_recorded_with_its_reading(self, make):
        rows = []
        rig = make(recorder=type("Recorder", (), {"record": lambda _, *row: rows.append(row)})())
        rig.steps(1)
        rig.daq.lost = True
        rig.steps(1)
        assert [output for _, output in rows] == rig.outputs
        assert isinstance(rows[0][0], Reading) and rows[1][0] is None


class TestWatchman:
    """Its own look, with the control thread's clock turned by hand."""

    @pytest.fixture(autouse=True)
    def no_sleep(self, monkeypatch):
        """How long it slept, instead of sleeping."""
        self.slept_s = []
        monkeypatch.setattr(time, "sleep", self.slept_s.append)

    def look(self, rig):
        """Let it look once."""
        looked = threading.Event()
        now_s = rig.clock.now_s

        def once():
            rig.driver._stopping.set()
            looked.set()
            return now_s()

        rig.clock.now_s = once
        rig.driver._loop.watchman.watch(rig.driver._is_over)
        rig.clock.now_s = now_s
        rig.driver._stopping.clear()
        assert looked.is_set()
        assert self.slept_s[-1] == 0.05

    @pytest.mark.parametrize(("silent_s", "cuts"), [(0.5, False), (0.5625, True)])
    def test_cuts_the_supply_where_no_step_came_for_longer_than_readings_may_be_old(self, make, silent_s, cuts):
        rig = make(QUICK_WATCHMAN)
        rig.drive()
        rig.driver._loop.watchman.alive_s = rig.clock.s
        rig.clock.s += silent_s
        rig.supply.words.clear()
        self.look(rig)
        assert rig.supply.words == (["shut down"] if cuts else [])
        assert bool(rig.driver.lost_instruments) == cuts
        if cuts:
            why = "no step for 0.562 s; safety.reading_timeout is 0.5 s"
            assert rig.driver.lost_instruments == {"control loop": why}
            assert rig.status.mode is Mode.OFF
            assert (rig.status.fault, rig.status.limits) == ("loop_hung", ())
            assert rig.status.message == f"off: the control loop hangs ({why})"
            assert rig.status.values["output"] == "off"
            assert rig.outputs[-1].command == Command(0.0, False)
            self.look(rig)
            assert rig.supply.words == ["shut down"], "it is done once"
            rig.steps(1)
            assert rig.driver.lost_instruments == {}
            assert rig.status.fault == "loop_hung"

    @pytest.mark.parametrize(("silent_s", "rests_s"), [(0.0, 0.25), (0.375, 0.125), (0.484375, 0.05), (0.6, 0.05)])
    def test_rests_until_something_can_be_wrong_but_not_for_long(self, make, silent_s, rests_s):
        rig = make(QUICK_WATCHMAN)
        rig.drive()
        watchman = rig.driver._loop.watchman
        watchman.alive_s = rig.clock.s
        rig.clock.s += silent_s
        turns = iter([False, False, True])
        watchman.watch(lambda: next(turns))
        assert self.slept_s == [0.05, rests_s]

    def test_what_was_waited_for_before_it_last_showed_life_is_nobodys_fault_now(self, make):
        """An instrument that was slow for a minute, and all the time answered, did not hold this step up."""
        rig = make(QUICK_WATCHMAN)
        rig.drive()
        rig.driver._loop.watchman._waited = lambda: Waited(daq_s=60.0)
        rig.steps(1)
        rig.driver._loop.watchman.alive_s = rig.clock.s
        rig.clock.s += 0.6
        self.look(rig)
        assert rig.status.fault == "loop_hung" and "waiting for" not in rig.status.message

    def test_rests_no_longer_where_nothing_flows(self, make):
        """A control thread that goes on may want its eyes at once."""
        rig = make(QUICK_WATCHMAN)
        rig.steps(2)
        watchman = rig.driver._loop.watchman
        watchman.alive_s = rig.clock.s
        rig.clock.s += 0.6
        turns = iter([False, False, True])
        watchman.watch(lambda: next(turns))
        assert watchman.hung and self.slept_s == [0.05, 0.05]

    def test_says_that_off_is_not_confirmed_where_it_is_not(self, make):
        rig = make(QUICK_WATCHMAN)
        rig.drive()
        rig.supply.shut_down = lambda: False
        rig.driver._loop.watchman.alive_s = rig.clock.s
        rig.clock.s += 0.6
        self.look(rig)
        assert rig.status.message.startswith("the output is told to be off, not confirmed")
        assert rig.status.values["output"] == "told to be off, not confirmed"
        assert not rig.driver.output_is_off

    def test_says_nothing_to_a_supply_that_is_off_or_lost(self, make):
        rig = make(QUICK_WATCHMAN)
        rig.steps(2)
        rig.driver._loop.watchman.alive_s = rig.clock.s
        rig.clock.s += 0.6
        rig.supply.words.clear()
        self.look(rig)
        assert rig.supply.words == []
        assert "control loop" in rig.driver.lost_instruments
        rig.steps(1)
        assert rig.status.fault == "", "nothing was cut, so nothing is latched"
        rig.drive()
        rig.driver._loop.supply.answers = False
        rig.driver._loop.watchman.alive_s = rig.clock.s
        rig.clock.s += 0.6
        rig.supply.words.clear()
        self.look(rig)
        assert rig.supply.words == []
        rig.driver._loop.supply.answers = True

    def test_goes_on_looking_after_a_hang_in_which_nothing_flowed(self, make):
        rig = make(QUICK_WATCHMAN)
        rig.steps(2)
        now_s = rig.clock.now_s

        def hang_while_off():
            rig.driver._loop.watchman.alive_s = rig.clock.s - 0.6
            rig.clock.now_s = hang_while_on
            return now_s()

        def hang_while_on():
            rig.clock.now_s = now_s
            assert rig.driver.lost_instruments, "it was noted"
            rig.drive()
            rig.driver._loop.watchman.alive_s = rig.clock.s - 0.6
            rig.driver._stopping.set()
            return now_s()

        rig.clock.now_s = hang_while_off
        rig.driver._loop.watchman.watch(rig.driver._is_over)
        rig.driver._stopping.clear()
        assert not rig.supply.output_on
        assert rig.status.fault == "loop_hung"

    def test_cuts_also_before_there_is_a_status(self, make, caplog):
        rig = make(QUICK_WATCHMAN)
        rig.driver.open()
        rig.driver._output.write(Command(0.1, True), None)
        rig.driver._loop.watchman.alive_s = rig.clock.s - 0.6
        self.look(rig)
        assert not rig.supply.output_on
        assert rig.outputs == []
        assert "the watchman failed" not in caplog.text

    def test_needs_nobody_who_listens(self, make, caplog):
        rig = make(QUICK_WATCHMAN)
        rig.drive()
        rig.driver._on_output = None
        rig.driver._loop.watchman.alive_s = rig.clock.s
        rig.clock.s += 0.6
        self.look(rig)
        assert not rig.supply.output_on
        assert "the control loop hangs (no step for 0.6 s" in caplog.text
        assert "the watchman failed" not in caplog.text
        rig.steps(1)

    def test_goes_on_looking_where_something_fails(self, make):
        rig = make(QUICK_WATCHMAN)
        rig.drive()

        def broken(_):
            raise ZeroDivisionError

        rig.driver._on_output = broken
        rig.driver._loop.watchman.alive_s = rig.clock.s
        rig.clock.s += 0.6
        self.look(rig)
        assert not rig.supply.output_on
        rig.driver._on_output = None
        rig.steps(1)


class TestEnd:
    def test_calls_that_wait_are_answered_and_both_instruments_given_up(self, make):
        rig = make()
        rig.drive()
        rig.driver._thread = threading.Thread()  # so that a call waits for it
        waiting = rig.driver.submit(lambda actuator, now_s: 1)
        cancelled = rig.driver.submit(lambda actuator, now_s: 2)
        assert cancelled.cancel()
        rig.supply.words.clear()
        rig.driver._thread = None
        assert rig.driver.stop()
        assert rig.supply.words == ["shut down", "close"]
        assert rig.daq.closed == 1
        with pytest.raises(DriverStopped, match="wire: the loop has ended"):
            waiting.result(0.0)
        with pytest.raises(DriverStopped, match="wire: the loop has ended"):
            rig.driver.submit(lambda actuator, now_s: 1).result(0.0)
        assert not any(link.answers for link in rig.driver._loop.links)
        for use in (rig.driver.open, rig.driver.start, rig.driver.tick):
            with pytest.raises(DriverStopped, match="wire: the driver has ended; make a new one"):
                use()

    def test_stop_says_whether_off_was_read_back(self, make):
        rig = make()
        rig.drive()
        rig.supply.shut_down = lambda: False
        assert not rig.driver.stop()
        assert rig.driver.output_words == "the output is told to be off, not confirmed"
        rig = make()
        rig.steps(1)
        rig.supply.shut_down = lambda: False
        assert rig.driver.stop(), "it was off before"

    def test_an_exception_is_kept_and_told_after_the_end(self, make):
        told = []
        rig = make(on_failure=lambda error: told.append((error, list(rig.supply.words))))
        rig.drive()
        error = ZeroDivisionError("a test")
        rig.daq.takes_s = None

        def broken():
            raise error

        rig.daq.read_block = broken
        with pytest.raises(ZeroDivisionError):
            rig.steps(1)
        assert rig.driver.failure is error
        assert [each for each, _ in told] == [error]
        assert told[0][1][-2:] == ["shut down", "close"]

    def test_calls_are_made_between_steps_and_a_cancelled_one_never(self, make):
        rig = make()
        rig.steps(1)
        done = []
        rig.driver._thread = threading.Thread()
        first, second, third = (
            rig.driver.submit(lambda actuator, now_s, n=n: done.append((n, now_s))) for n in range(3)
        )
        assert done == []
        assert second.cancel()
        rig.driver._thread = None
        rig.steps(1)
        assert [number for number, _ in done] == [0, 2]
        assert first.done() and third.done()
        rig.driver._thread = threading.Thread()
        fourth = rig.driver.submit(lambda actuator, now_s: now_s)
        rig.driver._thread = None
        rig.driver.tick()  # as in a loop that is late and does not sleep
        assert fourth.done()
        assert rig.driver.call(lambda actuator, now_s: now_s) == rig.clock.s

    def test_a_live_time_out_arrives_in_the_instruments_the_output_and_the_patience_for_an_answer(self, make):
        rig = make()
        rig.steps(3)
        changed = rig.config.replace({"safety.reading_timeout": 1.5})
        rig.driver.update(changed)
        assert (rig.supply.patience_s, rig.daq.patience_s) == (1.5, 1.5)
        assert rig.driver._output.safety == changed.safety
        began_s = rig.clock.s

        def late():
            rig.clock.s += 0.5
            raise InstrumentLate("late", began_s)

        rig.supply.check_settings = late
        assert not rig.driver.enable(True)[0]
        assert rig.clock.s - began_s == 1.5

    def test_a_rate_that_instruments_do_not_allow_is_refused_with_the_one_that_they_do(self, make):
        rig = make()
        rig.daq.takes_s = [0.15] * 20
        read_back = rig.supply.read_back

        def slowly():
            rig.clock.s += 0.05
            return read_back()

        rig.supply.read_back = slowly
        rig.steps(10)
        done, words = rig.driver.enable(True)
        assert not done and "so loop.rate can be 4.5 Hz at the most; it is 8 Hz" in words

    def test_an_on_that_is_wanted_no_more_when_its_turn_comes_is_none(self, make):
        rig = make()
        rig.steps(3)
        assert rig.driver.enable(True, wanted=lambda: False) == (False, OFF_MEANWHILE)
        rig.steps(2)
        assert not rig.supply.output_on

    def test_an_off_ends_an_on_that_waits_for_its_turn(self, make, monkeypatch):
        rig = make()
        rig.steps(3)
        rig.driver._thread = threading.Thread()  # whose loop is held up
        monkeypatch.setattr("concurrent.futures.wait", lambda *_: rig.driver.enable(False, timeout_s=0.0))
        assert rig.driver.enable(True, timeout_s=60.0) == (False, OFF_MEANWHILE)
        rig.driver._thread = None

    def test_an_on_that_the_supply_does_not_read_back_is_none(self, make, monkeypatch):
        rig = make()
        rig.steps(3)
        rig.driver._thread = threading.Thread()  # that takes calls, and makes no steps
        monkeypatch.setattr("concurrent.futures.wait", lambda *_: rig.driver.run_calls())
        done, words = rig.driver.enable(True, timeout_s=0.05)
        assert not done and words.endswith("has not read that back within 0.05 s")
        rig.driver._thread = None

    def test_an_on_that_ends_before_it_is_read_back_does_not_call_the_output_on(self, make, monkeypatch):
        rig = make()
        rig.steps(3)
        rig.driver._thread = threading.Thread()  # that takes calls
        monkeypatch.setattr("concurrent.futures.wait", lambda *_: rig.driver.run_calls())

        def off_is_asked_for(_):
            rig.driver._output._become(Known.TOLD_ON, 0.05)
            rig.driver.cancel_enable()

        monkeypatch.setattr("time.sleep", off_is_asked_for)
        assert rig.driver.enable(True) == (False, OFF_MEANWHILE)
        rig.driver._thread = None

    def test_where_the_system_refuses_what_the_loop_wants_its_thread_has_ended(self, make, monkeypatch):
        def refused(_):
            raise RealtimeRefused("no")

        rig, ended = make(), threading.Event()
        monkeypatch.setattr("sma_actuator.base.realtime.begin", refused)
        finish = rig.driver._finish
        rig.driver._finish = lambda: (ended.wait(0.2), finish(), ended.set())
        with pytest.raises(RealtimeRefused):
            rig.driver.start()
        assert ended.is_set() and rig.supply.shut_downs

    def test_a_call_that_began_in_the_last_moment_is_waited_for(self, make):
        rig = make()
        rig.steps(1)

        class Late:
            def __init__(self):
                self.asked = 0

            def result(self, timeout_s):
                self.asked += 1
                if self.asked == 1:
                    raise TimeoutError
                return 7

            def cancel(self):
                return False

        rig.driver.submit = lambda request: Late()
        assert rig.driver.call(lambda actuator, now_s: None, timeout_s=0.1) == 7
