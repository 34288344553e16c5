"""What the driver does with its instruments where leaving it out would leave the current on."""

import itertools

import pytest
from stand_ins import StandInDaq, StandInSupply

from sma_actuator.base.signals import Mode
from sma_actuator.bench.bench import VirtualBench
from sma_actuator.bench.in_process import InProcessDaq, InProcessSupply, VirtualClock
from sma_actuator.config import Config
from sma_actuator.driver import NOT_ASKED, Driver, DriverStopped
from sma_actuator.driver.link import Link
from sma_actuator.instruments import InstrumentLate, InstrumentLost, InstrumentUnreachable, LimitsNotHeld, OutputStaysOn


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


@pytest.mark.parametrize(("driven", "longest_s"), [(True, 0.6), (False, 5.1)], ids=["it may be on", "it is off"])
def test_a_supply_that_may_be_on_and_was_away_is_told_off_soon_after_it_is_back(rig, driven, longest_s):
    driver, supply, bench = rig
    if driven:
        _driven(driver)
    bench.inject("watchdog_dead")  # as of a supply that has just restarted, with the output as it was before
    bench.inject("supply_hangup")
    driver.run_for(20.0)
    assert bench.supply.output_on is driven
    tried = []
    supply.open, opened = lambda: tried.append(bench.time_s) or opened(), supply.open
    driver.run_for(20.0)
    gaps_s = [after - before for before, after in itertools.pairwise(tried)]
    assert longest_s - 0.15 < max(gaps_s) < longest_s
    bench.clear()
    driver.run_for(longest_s)
    assert not bench.supply.output_on
    assert driver.output_is_off


def test_disabling_says_off_at_once_and_not_with_the_next_step(rig):
    driver, supply, bench = rig
    _driven(driver)
    supply.told.clear()
    assert driver.enable(False)[0]
    assert supply.told == ["off"]
    assert not bench.supply.output_on
    assert bench.supply.current_A == 0.0


def test_a_motion_that_is_held_ends_in_the_next_step_where_the_wire_is(rig):
    driver, _, _ = rig
    _driven(driver)
    driver.offer_setpoint(0.002)
    assert driver.run_for(0.5).status.mode is Mode.TRACKING
    driver.hold()
    held = driver.run_for(0.05)
    assert held.status.mode is Mode.HOLD and driver.refusals() == []
    assert driver.run_for(1.0).setpoint_m == held.setpoint_m == pytest.approx(held.estimate.displacement_m, abs=1e-4)


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


class Reachable:
    """An instrument that opens, or raises what a test says."""

    def __init__(self):
        self.opened_s = []
        self.error = None
        self.now_s = 100.0

    def open(self):
        self.opened_s.append(self.now_s)
        if self.error is not None:
            raise self.error


class TestLink:
    """When an instrument that is lost is tried again: every attempt may feed a watchdog, none must be missed."""

    LONGEST_s = 0.5
    TIMEOUT_s = 0.2

    @pytest.fixture
    def link(self):
        link = self.link_to(Reachable())
        link.answers = True
        return link

    def link_to(self, instrument):
        return Link("supply", instrument, self.TIMEOUT_s, self.LONGEST_s, lambda: instrument.now_s)

    def lost(self, link, error):
        assert link.ask(self.raising(error)) is None
        assert not link.answers

    def raising(self, error):
        def question():
            raise error

        return question

    def attempts(self, link, seconds, quiet_s=0.0):
        """When it is tried, by a loop of 10 ms."""
        one = link.instrument
        start_s, before = one.now_s, len(one.opened_s)
        for number in range(round(100 * seconds)):
            one.now_s = start_s + 0.01 * number
            if not link.answers:
                link.reconnect(quiet_s)
        return [round(when_s - start_s, 2) for when_s in one.opened_s[before:]]

    def test_an_answer_is_handed_on_and_none_is_asked_for_where_it_is_lost(self, link):
        assert link.ask(lambda: 7) == 7
        self.lost(link, InstrumentLost("gone"))
        assert link.ask(lambda: 7) is None

    @pytest.mark.parametrize(
        ("error", "fault"), [(InstrumentLost("gone"), "supply_lost"), (LimitsNotHeld("too high"), "limits_not_held")]
    )
    def test_why_it_is_lost_is_kept_with_the_fault_that_this_is(self, link, error, fault):
        self.lost(link, error)
        assert (link.detail, link.fault) == (str(error), fault)
        link.instrument.error = InstrumentUnreachable("nobody listens")
        self.attempts(link, 0.01)
        assert (link.detail, link.fault) == ("nobody listens", "supply_lost")

    def test_one_that_never_answered_is_tried_at_once(self):
        link = self.link_to(Reachable())
        assert (link.detail, link.fault) == (NOT_ASKED, "supply_lost")
        assert link.ask(lambda: 7) is None
        link.reconnect(60.0)
        assert link.ask(lambda: 7) == 7

    def test_attempts_begin_at_once_and_become_rarer_up_to_a_bound(self, link):
        link.instrument.error = InstrumentUnreachable("nobody listens")
        self.lost(link, InstrumentLost("gone"))
        assert self.attempts(link, 2.0, quiet_s=60.0) == pytest.approx([0.0, 0.1, 0.3, 0.7, 1.2, 1.7], abs=0.011)

    def test_one_that_was_heard_and_failed_is_followed_by_silence(self, link):
        link.instrument.error = InstrumentLost("no answer")
        self.lost(link, InstrumentLost("gone"))
        assert self.attempts(link, 2.0, quiet_s=0.6) == pytest.approx([0.0, 0.6, 1.2, 1.8], abs=0.011)

    def test_silence_is_no_shorter_than_the_wait(self, link):
        link.instrument.error = InstrumentLost("no answer")
        self.lost(link, InstrumentLost("gone"))
        assert self.attempts(link, 1.0, quiet_s=0.2) == pytest.approx([0.0, 0.2, 0.4, 0.8], abs=0.011)

    def test_one_that_does_not_obey_is_left_in_silence_first_and_once(self, link):
        link.instrument.error = InstrumentUnreachable("nobody listens")
        self.lost(link, OutputStaysOn("supply"))
        assert self.attempts(link, 1.0, quiet_s=0.6) == pytest.approx([0.6, 0.7, 0.9], abs=0.011)

    def test_but_not_for_longer_than_a_watchdog_can_be_waited_for(self, link):
        self.lost(link, OutputStaysOn("supply"))
        assert self.attempts(link, 3.0, quiet_s=60.0) == pytest.approx([2.0], abs=0.011)

    def test_after_an_answer_a_loss_is_looked_into_at_once_again(self, link):
        link.instrument.error = InstrumentUnreachable("nobody listens")
        self.lost(link, InstrumentLost("gone"))
        self.attempts(link, 2.0)
        link.instrument.error = None
        while not link.answers:
            self.attempts(link, 0.02)
        assert link.ask(lambda: 7) == 7
        self.lost(link, InstrumentLost("gone"))
        assert self.attempts(link, 1.0, quiet_s=60.0) == pytest.approx([0.0], abs=0.011)

    def test_one_that_opens_and_answers_nothing_is_opened_ever_more_rarely(self, link):
        """As an instrument that says who it is, and nothing else; opening it takes many times as long as a question."""
        one, when_s = link.instrument, []
        self.lost(link, InstrumentLost("gone"))
        start_s = one.now_s
        for number in range(200):
            one.now_s = start_s + 0.01 * number
            link.reconnect(60.0)
            if link.answers:
                when_s.append(round(one.now_s - start_s, 2))
                self.lost(link, InstrumentLost("no answer"))
        assert when_s == pytest.approx([0.0, 0.1, 0.3, 0.7, 1.2, 1.7], abs=0.011)

    def taking(self, link, seconds, error=None):
        """A question whose answer takes so long, or that long to fail."""

        def question():
            link.instrument.now_s += seconds
            if error is not None:
                raise error
            return 7

        return question

    def test_it_is_waited_for_while_it_is_asked_for_as_long_as_its_answer_may_take(self, link):
        seen_s = []

        def question():
            for _ in range(3):
                link.instrument.now_s += 0.08
                seen_s.append(link.waited_s())

        for _ in range(2):
            link.ask(question)
        assert seen_s == pytest.approx([0.08, 0.16, 0.2, 0.28, 0.36, 0.4])

    @pytest.mark.parametrize("error", [InstrumentLate("late", 1.0), InstrumentLost("gone")], ids=["late", "lost"])
    def test_an_answer_that_does_not_come_is_among_the_slowest(self, link, error):
        link.ask(self.taking(link, 0.15, error))
        assert link.slowest.longest_s(link.instrument.now_s) == pytest.approx(0.15)

    def test_one_that_must_answer_is_asked_until_it_has(self, link):
        late = self.taking(link, 0.3, InstrumentLate("late", 1.0))
        answers = [late, late, lambda: 7]

        def question():
            return answers.pop(0)()

        link.insist(question, 1.0)
        assert not answers and not link.late

    def test_but_not_for_longer_than_there_is_patience(self, link):
        asked_s = []

        def question():
            asked_s.append(link.instrument.now_s - 100.0)
            self.taking(link, 0.3, InstrumentLate("late", 1.0))()

        link.insist(question, 1.0)
        assert link.late and asked_s == pytest.approx([0.0, 0.3, 0.6, 0.9])

    def test_what_is_told_to_one_that_owed_an_answer_is_done_once(self, link):
        """What is only told is not waited for: that it owed something is of no moment then."""
        told_s = []

        def tell():
            told_s.append(link.instrument.now_s)
            link.instrument.now_s += 0.3

        link.late = True
        link.insist(tell, 1.0)
        assert told_s == [100.0]

    def test_a_defect_is_none_of_the_instruments(self, link):
        with pytest.raises(ZeroDivisionError):
            link.ask(self.raising(ZeroDivisionError()))
        assert link.answers


def test_nobody_has_been_waited_for_before_the_first_question():
    assert Link("supply", StandInSupply(), 0.2, 5.0, lambda: 7.0).waited_s() == 0.0


def test_of_instruments_of_which_the_second_cannot_be_opened_the_output_is_known_to_be_off(make_config):
    """The supply was heard of, and has said off, when the DAQ was not to be found."""

    daq = StandInDaq(StandInSupply())
    daq.lost = True
    config = Config.from_mapping(make_config())
    bench = VirtualBench.from_name("flexinol", seed=1)
    driver = Driver(config, NotedSupply(bench, config), daq, VirtualClock(bench))
    with pytest.raises(InstrumentLost):
        driver.open()
    assert driver.output_is_off


class TestRate:
    """Five steps tell how long the instruments take; of fewer, or of an instrument that is lost, nothing is said."""

    @pytest.fixture
    def slow(self, make_config):
        class Slow(NotedSupply):
            def read_back(self):
                self._bench.advance(self._bench.time_s + 0.06)  # a step has 0.05 s
                return super().read_back()

        config = Config.from_mapping(make_config(**{"loop.overruns_to_fault": 1000}))
        bench = VirtualBench.from_name("flexinol", seed=1)
        bench.advance(0.2)
        driver = Driver(config, Slow(bench, config), InProcessDaq(bench, config), VirtualClock(bench))
        driver.open()
        yield driver
        driver.stop()

    @pytest.mark.parametrize(("steps", "refused"), [(0, False), (4, False), (5, True)])
    def test_it_is_refused_by_five_steps_and_by_no_fewer(self, slow, steps, refused):
        for _ in range(steps):
            slow.tick()
        assert ("so loop.rate can be" in slow.enable(True)[1]) is refused


class TestOutputThatComesOnLate:
    """As behind a relay: told to be on, it reads back as off for a while, and nothing flows."""

    @pytest.fixture
    def coming_on(self, make_config):
        """A function: (driver, supply, bench) with an output that comes on so much later, after a try to enable it."""
        drivers = []

        def make(late_s, **changes):
            class Late(NotedSupply):
                on_s = float("inf")

                def set_output(self, on):
                    self.told.append(f"output {on}")
                    self.on_s = self._bench.time_s + late_s if on else float("inf")
                    self._command(self._bench.supply.set_output, False)

                def read_back(self):
                    if self._bench.time_s >= self.on_s:
                        self.on_s = float("inf")
                        self._command(self._bench.supply.set_output, True)
                    return super().read_back()

            config = Config.from_mapping(make_config(**changes))
            bench = VirtualBench.from_name("flexinol", seed=1)
            supply = Late(bench, config)
            drivers.append(driver := Driver(config, supply, InProcessDaq(bench, config), VirtualClock(bench)))
            driver.run_for(0.5)
            assert driver.enable(True)[0]
            return driver, supply, bench

        yield make
        for driver in drivers:
            driver.stop()

    @pytest.mark.parametrize("late_s", [0.15, 0.8])
    def test_is_waited_for_and_then_the_wire_is_driven(self, coming_on, late_s):
        driver, supply, bench = coming_on(late_s)
        driver.offer_setpoint(3e-3)
        outputs = [driver.run_for(0.05) for _ in range(round(late_s / 0.05))]
        bias_A = supply._config.supply.bias_current
        assert all(output.command.current_A <= bias_A for output in outputs), "the law waits until something flows"
        for _ in range(100):
            driver.offer_setpoint(3e-3)
            output = driver.run_for(0.1)
        assert output.status.fault == ""
        assert bench.truth.displacement_m == pytest.approx(3e-3, abs=0.2e-3)

    def test_what_was_read_before_it_came_on_settles_nothing(self, coming_on):
        slow = {"loop.rate": 4.0, "loop.samples_per_block": 10, "safety.reading_timeout": 0.65}
        driver, supply, _ = coming_on(0.7, **slow)
        flowing = []
        while len(flowing) < 3:
            driver.offer_setpoint(2e-3)
            output = driver.run_for(0.25)
            if supply.read_back().output_on:
                flowing.append(output.setpoint_m)
        assert all(setpoint_m != setpoint_m for setpoint_m in flowing), "no law has been asked yet"

    def test_one_that_does_not_come_on_in_time_is_a_fault(self, coming_on):
        driver, supply, _ = coming_on(1.5)
        assert driver.run_for(0.9).status.fault == ""
        assert driver.run_for(0.2).status.fault == "second_commander"
        assert supply.told[-1] == "off"

    def test_one_that_has_come_on_is_switched_off_by_nobody_else(self, coming_on):
        driver, _, bench = coming_on(0.15)
        assert driver.run_for(0.4).status.fault == ""
        bench.supply.set_output(False)
        assert driver.run_for(0.15).status.fault == "second_commander"
