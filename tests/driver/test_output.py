"""The supply's output: from each state by each event to the state that follows, and on is never said against an off."""

import threading
from concurrent.futures import Future

import pytest

from sma_actuator.base.signals import Command, SupplyState
from sma_actuator.driver.output import Known, SupplyOutput
from sma_actuator.instruments import InstrumentLate, InstrumentLost, OutputStaysOn
from sma_actuator.safety.guards.program import loop_hung

ON, OFF = Command(0.1, True), Command(0.0, False)
SAYS_ON, SAYS_OFF = SupplyState(0.0, 0.1, True, 0.6, 0.1), SupplyState(0.0, 0.0, False, 0.0, 0.0)
WORDS = {
    Known.UNKNOWN: "the output is off",
    Known.FOUND_OFF: "the output is off",
    Known.OFF: "the output is off",
    Known.NOT_CONFIRMED: "the output is told to be off, not confirmed",
    Known.TOLD_ON: "the output is on",
    Known.READ_ON: "the output is on",
}


class Supply:
    """Notes its words; ``does`` something, or raises, at one of them."""

    def __init__(self):
        self.words, self.does, self.on = [], {}, False

    def _hear(self, word):
        self.words.append(word)
        if word in self.does:
            self.does[word]()

    def set_current(self, current_A):
        self._hear(f"current {current_A:g}")

    def set_output(self, on):
        self._hear("on")
        self.on = True

    def switch_off(self):
        self._hear("off")
        self.on = False

    def shut_down(self):
        self._hear("shut down")
        self.on = False
        return "deaf" not in self.does


class Rig:
    def __init__(self, config):
        self.supply, self.ending = Supply(), threading.Event()
        self.output = SupplyOutput(self.supply, config.safety, self.ending)

    def fail(self, word, error):
        def failing():
            raise error

        self.supply.does[word] = failing

    def said(self, call):
        """The words of a call, whatever it raises."""
        self.supply.words.clear()
        try:
            call()
        except InstrumentLost as error:
            self.supply.words.append(type(error).__name__)
        except OutputStaysOn:
            self.supply.words.append("stays on")
        return self.supply.words


@pytest.fixture
def rig(config):
    return Rig(config)


def reach(rig, known):
    """Bring the output into a state by events alone."""
    output = rig.output
    if known is not Known.UNKNOWN:
        output.opened()
    if known in (Known.OFF, Known.TOLD_ON, Known.READ_ON, Known.NOT_CONFIRMED):
        output.write(OFF, None)
    if known in (Known.TOLD_ON, Known.READ_ON, Known.NOT_CONFIRMED):
        output.write(ON, SAYS_OFF)
    if known is Known.READ_ON:
        output.seen(SAYS_ON)
    if known is Known.NOT_CONFIRMED:
        output.lost()
    assert output.known is known
    return output


@pytest.mark.parametrize("known", Known)
def test_each_state_says_what_is_known(rig, known):
    output = reach(rig, known)
    assert output.words == WORDS[known]
    assert output.known.is_off == (known in (Known.FOUND_OFF, Known.OFF))
    assert output.known.may_flow == (known in (Known.TOLD_ON, Known.READ_ON, Known.NOT_CONFIRMED))


@pytest.mark.parametrize("known", Known)
def test_off_is_said_in_every_state_but_off_and_known_once_it_is_read_back(rig, known):
    output = reach(rig, known)
    assert rig.said(lambda: output.write(OFF, None)) == ([] if known is Known.OFF else ["off"])
    assert output.known is Known.OFF
    assert rig.said(lambda: output.write(OFF, SAYS_OFF)) == []
    assert rig.said(lambda: output.write(OFF, SAYS_ON)) == ["off"]


@pytest.mark.parametrize("known", Known)
@pytest.mark.parametrize("error", [InstrumentLost("no answer"), InstrumentLate("late", 0.0), OutputStaysOn("supply")])
def test_an_off_that_is_not_read_back_is_not_confirmed_and_said_again(rig, known, error):
    output = reach(rig, known)
    rig.fail("off", error)
    rig.said(output.switch_off)
    assert output.known is Known.NOT_CONFIRMED
    rig.supply.does.clear()
    assert rig.said(lambda: output.write(OFF, SAYS_OFF)) == ["off"]
    assert output.known is Known.OFF


@pytest.mark.parametrize("known", [each for each in Known if not each.is_on])
def test_on_is_told_with_its_current_first(rig, known):
    output = reach(rig, known)
    seen = []
    rig.supply.does["current 0.1"] = rig.supply.does["on"] = lambda: seen.append(output.known)
    assert rig.said(lambda: output.write(ON, SAYS_OFF)) == ["current 0.1", "on"]
    assert seen == [Known.NOT_CONFIRMED] * 2, "from the first word on it may flow"
    assert output.known is Known.TOLD_ON
    assert rig.said(lambda: output.write(ON, None)) == []


@pytest.mark.parametrize("word", ["current 0.1", "on"])
@pytest.mark.parametrize("error", [InstrumentLost("no answer"), InstrumentLate("late", 0.0)])
def test_an_on_that_fails_halfway_may_flow_until_off_is_read_back(rig, word, error):
    output = reach(rig, Known.OFF)
    rig.fail(word, error)
    rig.said(lambda: output.write(ON, SAYS_OFF))
    assert output.known is Known.NOT_CONFIRMED
    rig.supply.does.clear()
    assert rig.said(lambda: output.write(OFF, SAYS_OFF)) == ["off"], "though the supply says that it is off"


@pytest.mark.parametrize(
    ("state", "then"), [(SAYS_ON, Known.READ_ON), (SAYS_OFF, Known.TOLD_ON), (None, Known.TOLD_ON)]
)
@pytest.mark.parametrize("known", Known)
def test_what_is_read_back_tells_on_from_told_on_and_nothing_else(rig, known, state, then):
    output = reach(rig, known)
    output.seen(state)
    assert output.known is (then if known.is_on else known)


AFTER_LOSS = {
    Known.OFF: Known.FOUND_OFF,
    Known.TOLD_ON: Known.NOT_CONFIRMED,
    Known.READ_ON: Known.NOT_CONFIRMED,
}


@pytest.mark.parametrize("known", Known)
def test_of_one_that_is_lost_it_is_not_known_what_it_was_told(rig, known):
    output = reach(rig, known)
    output.lost()
    assert output.known is AFTER_LOSS.get(known, known)
    assert rig.said(lambda: output.write(ON, None)) == ["current 0.1", "on"], "all of it is told again"


@pytest.mark.parametrize("known", Known)
@pytest.mark.parametrize("confirmed", [True, False])
def test_a_shut_down_is_off_where_it_was_read_back_and_else_what_it_was(rig, known, confirmed):
    output = reach(rig, known)
    if not confirmed:
        rig.supply.does["deaf"] = None
    output.shut_down()
    after = AFTER_LOSS.get(known, known)
    assert output.known is (Known.FOUND_OFF if confirmed and known is not Known.UNKNOWN else after)


def overrule(rig, by):
    """Have off said beside the loop."""
    if by == "off":
        rig.output.off_beside(Future(), 1.0)
    elif by == "watchman":
        rig.output.cut(loop_hung, "no step")
    else:
        rig.ending.set()


@pytest.mark.parametrize("by", ["off", "watchman", "end"])
@pytest.mark.parametrize("known", Known)
def test_no_step_says_on_after_off_was_said_beside_it(rig, known, by):
    output = reach(rig, known)
    overrule(rig, by)
    assert "on" not in rig.said(lambda: output.write(ON, SAYS_OFF))
    assert not rig.supply.on
    assert output.known is Known.OFF


def test_on_may_be_said_again_once_the_loop_has_taken_that_over(rig):
    output = reach(rig, Known.READ_ON)
    taken_over = Future()
    output.off_beside(taken_over, 1.0)
    output.cut(loop_hung, "no step")
    assert output.off_is_asked and output.was_cut
    assert output.known is Known.FOUND_OFF
    taken_over.set_result(None)
    assert "on" not in rig.said(lambda: output.write(ON, None)), "the cut is not noted yet"
    assert output.take_cut() == (loop_hung, "no step")
    assert output.take_cut() is None
    assert rig.said(lambda: output.write(ON, None)) == ["current 0.1", "on"]


@pytest.mark.parametrize("by", ["watchman", "end"])
def test_an_on_is_broken_off_where_off_is_said_between_its_words(rig, by):
    output = reach(rig, Known.OFF)
    rig.supply.does["current 0.1"] = lambda: overrule(rig, by)
    words = rig.said(lambda: output.write(ON, SAYS_OFF))
    assert "on" not in words and words[-1] == "off"
    assert output.known is Known.OFF


@pytest.mark.parametrize("by", ["watchman", "end"])
def test_an_on_whose_last_word_may_have_come_after_an_off_is_not_confirmed(rig, by):
    output = reach(rig, Known.OFF)
    rig.supply.does["on"] = lambda: overrule(rig, by)
    rig.said(lambda: output.write(ON, SAYS_OFF))
    assert output.known is Known.NOT_CONFIRMED
    assert rig.said(lambda: output.write(ON, None)) == ["off"]
    assert output.known is Known.OFF and not rig.supply.on


def test_a_current_that_is_told_while_the_output_is_cut_switches_nothing_on(rig):
    output = reach(rig, Known.READ_ON)
    rig.supply.does["current 0.2"] = lambda: overrule(rig, "watchman")
    assert rig.said(lambda: output.write(Command(0.2, True), SAYS_ON)) == ["current 0.2", "shut down"]
    assert output.known is Known.FOUND_OFF
    output.take_cut()
    assert rig.said(lambda: output.write(OFF, SAYS_OFF)) == ["off"]


def test_off_beside_waits_for_the_words_of_a_step_and_no_longer_than_it_may(rig):
    output = reach(rig, Known.OFF)
    rig.supply.does["current 0.1"] = lambda: output.off_beside(Future(), 0.01)
    assert rig.said(lambda: output.write(ON, None)) == ["current 0.1", "on"]
    assert not output.off_is_asked


def test_a_supply_that_does_not_obey_beside_the_loop_leaves_off_asked(rig):
    output = reach(rig, Known.READ_ON)
    rig.fail("off", OutputStaysOn("supply"))
    output.off_beside(Future(), 1.0)
    assert output.known is Known.NOT_CONFIRMED and output.off_is_asked
    rig.supply.does.clear()
    assert rig.said(lambda: output.write(ON, None)) == ["off"]


def test_after_an_off_that_was_read_back_no_current_is_what_it_is_known_to_be_told(rig):
    rig.output.switch_off()
    assert rig.said(lambda: rig.output.write(Command(0.0, True), None)) == ["on"]


def test_once_a_cut_is_noted_off_is_said_again_for_what_came_last_is_not_known(rig):
    rig.output.cut(loop_hung, "it hangs")
    rig.output.switch_off()
    assert rig.output.known is Known.OFF
    rig.output.take_cut()
    assert rig.output.known is Known.FOUND_OFF
    assert rig.said(lambda: rig.output.write(OFF, None)) == ["off"]
