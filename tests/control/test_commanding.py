"""The state machine of what is wanted, alone: its table, and what holds whatever happens to it."""

import math

import hypothesis.strategies as st
import pytest
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from sma_actuator.base.signals import Mode
from sma_actuator.control.commanding import Commanding, State
from sma_actuator.control.setpoints import Trajectory

RAMP = Trajectory([0.0, 2.0], [0.004, 0.002])
LATER = Trajectory([1.0, 3.0], [0.004, 0.002])  #: its first point is

EVENTS = {
    "enable": lambda machine: machine.enable(),
    "off": lambda machine: machine.switch_off(),
    "setpoint": lambda machine: machine.track(1.0, 0.003),
    "near": lambda machine: machine.command(1.0, 0.003, 0.00301, 1e-4),
    "far": lambda machine: machine.command(1.0, 0.003, 0.0035, 1e-4),
    "trajectory": lambda machine: machine.follow(1.0, RAMP, 0.0),
    "later": lambda machine: machine.follow(1.0, RAMP, 5.0),
    "stop": lambda machine: machine.stop(),
    "cancel": lambda machine: machine.cancel(0.0031),
    "tune": lambda machine: machine.tune(),
    "hold": lambda machine: machine.lose("silence", at_bias=False),
    "bias": lambda machine: machine.lose("silence", at_bias=True),
}
#: How each state is come to, with the controller begun.
WAYS = {
    State.OFF: [],
    State.HOLDING: ["enable"],
    State.TRACKING: ["enable", "setpoint"],
    State.FOLLOWING: ["enable", "trajectory"],
    State.LOST_HOLDING: ["enable", "setpoint", "hold"],
    State.TUNING: ["enable", "tune"],
    State.LOST_AT_BIAS: ["enable", "setpoint", "bias"],
}
#: What each event makes of each state; * : and the controller begins anew; . : nothing happens.
TABLE = """
              enable    off  setpoint   near       far  trajectory  later  stop      cancel    tune    hold           bias
OFF           HOLDING*  .    .          .          .    .           .      .         .         .       .              .
HOLDING       .         OFF  TRACKING   TRACKING   .    FOLLOWING   .      HOLDING*  HOLDING   TUNING  .              .
TRACKING      .         OFF  TRACKING   TRACKING   .    FOLLOWING   .      HOLDING*  HOLDING*  TUNING  LOST_HOLDING*  LOST_AT_BIAS*
FOLLOWING     .         OFF  TRACKING   TRACKING   .    FOLLOWING   .      HOLDING*  HOLDING   TUNING  LOST_HOLDING*  LOST_AT_BIAS*
LOST_HOLDING  .         OFF  TRACKING   TRACKING   .    FOLLOWING   .      HOLDING*  HOLDING   TUNING  .              .
TUNING        .         OFF  TRACKING*  TRACKING*  .    FOLLOWING*  .      HOLDING*  HOLDING*  TUNING  .              .
LOST_AT_BIAS  .         OFF  TRACKING*  TRACKING*  .    FOLLOWING*  .      HOLDING*  HOLDING*  TUNING  .              .
"""
HEAD, *ROWS = (line.split() for line in TABLE.strip().splitlines())


def machine_in(state):
    machine = Commanding()
    for event in WAYS[state]:
        EVENTS[event](machine)
        machine.begun(1.0, 0.0035)
    assert machine.state is state
    return machine


def test_what_is_cancelled_is_held_where_its_reference_has_come_and_no_more_is_heard_of_it():
    machine = machine_in(State.FOLLOWING)
    machine.follow(1.0, RAMP, 5.0)
    machine.cancel(0.0031)
    assert machine.position_m(1.0) == 0.0031
    assert math.isnan(machine.silent_s(1.0))
    machine.advance(100.0)
    assert machine.state is State.HOLDING, "the one that was awaited does not begin"


def test_a_tuning_forgets_what_was_wanted_before():
    machine = machine_in(State.HOLDING)
    machine.track(1.0, 0.003)
    machine.follow(1.0, RAMP, 5.0)
    machine.tune()
    assert math.isnan(machine.position_m(1.0)) and math.isnan(machine.silent_s(1.0))
    machine.advance(100.0)
    assert machine.state is State.TUNING


def test_an_off_that_changes_nothing_and_a_stop_know_nothing_of_an_older_setpoint():
    machine = machine_in(State.TRACKING)
    assert machine.silent_s(3.0) == 2.0
    machine.stop()
    assert math.isnan(machine.silent_s(3.0))


def test_the_table_is_whole():
    assert list(EVENTS) == HEAD
    assert [row[0] for row in ROWS] == [state.name for state in State]


@pytest.mark.parametrize(
    ("state", "event", "after"),
    [(State[row[0]], event, after) for row in ROWS for event, after in zip(HEAD, row[1:], strict=True)],
    ids=lambda x: x.name if isinstance(x, State) else x,
)
def test_every_transition(state, event, after):
    machine = machine_in(state)
    EVENTS[event](machine)
    assert machine.state is (state if after == "." else State[after.strip("*")])
    assert machine.anew == after.endswith("*")


@pytest.mark.parametrize("state", State, ids=lambda state: state.name)
def test_each_state_says_what_is_wanted(state):
    machine = machine_in(state)
    modes = {
        State.OFF: Mode.OFF,
        State.TRACKING: Mode.TRACKING,
        State.FOLLOWING: Mode.TRACKING,
        State.TUNING: Mode.TUNING,
    }
    assert machine.mode is modes.get(state, Mode.HOLD)
    assert machine.is_driven == (state is not State.OFF)
    assert machine.wants_position == (state not in (State.OFF, State.LOST_AT_BIAS))
    assert machine.lost == ("silence" if state.name.startswith("LOST") else "")
    wanted_m = {State.OFF: math.nan, State.HOLDING: 0.0035, State.TRACKING: 0.003, State.LOST_HOLDING: 0.0035}
    if state in wanted_m:
        assert machine.position_m(1.0) == pytest.approx(wanted_m[state], nan_ok=True)


def test_a_controller_that_has_yet_to_begin_does_so_also_after_a_setpoint():
    machine = Commanding()
    machine.enable()
    machine.track(0.0, 0.003)
    assert machine.anew
    machine.begun(1.0, 0.004)
    assert not machine.anew
    assert machine.position_m(0.0) == 0.003, "the setpoint stands: only a wire that is held is held where it was"


@pytest.mark.parametrize("event", ["off", "setpoint", "trajectory", "stop", "hold", "bias"])
def test_a_joint_command_counts_wherever_it_is_until_anything_else_is_wanted(event):
    machine = machine_in(State.HOLDING)
    EVENTS["near"](machine)
    assert machine.command(2.0, 0.001, wire_m=0.003, near_m=1e-4)
    assert machine.position_m(2.0) == 0.001
    EVENTS[event](machine)
    if event == "off":
        machine.enable()
    if machine.anew:
        assert not machine.command(3.0, 0.003, wire_m=0.003, near_m=1e-4), "the controller has not begun"
        machine.begun(1.0, 0.003)
    before = machine.state
    assert not machine.command(3.0, 0.001, wire_m=0.003, near_m=1e-4)
    assert machine.state is before
    assert machine.command(3.0, 0.003, wire_m=0.003, near_m=1e-4)


def test_a_trajectory_is_followed_to_its_end_which_stands_and_only_then_there_is_silence():
    machine = machine_in(State.HOLDING)
    machine.follow(10.0, RAMP, -0.5)
    assert machine.position_m(10.5) == pytest.approx(0.003)
    machine.advance(11.0)
    assert machine.silent_s(11.0) == 0.0
    machine.advance(12.0)
    assert machine.silent_s(12.0) == 1.0
    assert machine.position_m(12.0) == 0.002
    assert machine.state is State.FOLLOWING


def test_a_trajectory_that_is_awaited_begins_in_its_time_even_if_the_setpoint_is_lost_meanwhile():
    machine = machine_in(State.TRACKING)
    machine.follow(10.0, RAMP, 1.0)
    machine.lose("silence", at_bias=True)
    machine.advance(10.9)
    assert machine.state is State.LOST_AT_BIAS
    machine.advance(11.5)
    assert machine.state is State.FOLLOWING
    assert machine.position_m(11.5) == pytest.approx(0.0035)
    assert machine.lost == ""


def test_how_long_a_trajectory_is_awaited_is_known_as_long_as_it_is():
    machine = machine_in(State.HOLDING)
    assert math.isnan(machine.begins_in_s(1.0))
    machine.follow(10.0, RAMP, 5.0)
    assert machine.begins_in_s(11.0) == 4.0
    machine.advance(15.0)
    assert math.isnan(machine.begins_in_s(15.0))


def test_to_a_first_point_that_is_later_it_is_led_in_from_where_the_reference_is():
    machine = machine_in(State.HOLDING)
    machine.follow(10.0, LATER, 0.0, reference_m=0.003)
    places_m = [machine.position_m(now_s) for now_s in (10.0, 10.5, 11.0, 12.0)]
    assert places_m == pytest.approx([0.003, 0.0035, 0.004, 0.003])


def test_so_it_is_from_where_the_wire_is_once_the_controller_has_begun_anew():
    machine = machine_in(State.LOST_AT_BIAS)
    machine.follow(10.0, LATER, 0.0)
    machine.begun(10.5, 0.003)
    assert [machine.position_m(now_s) for now_s in (10.5, 10.75, 11.0)] == pytest.approx([0.003, 0.0035, 0.004])


@pytest.mark.parametrize("event", ["setpoint", "trajectory", "stop", "off"])
def test_what_comes_meanwhile_takes_the_place_of_a_trajectory_that_is_awaited(event):
    machine = machine_in(State.HOLDING)
    machine.follow(1.0, RAMP, 1.0)
    EVENTS[event](machine)
    before = machine.state
    if before is State.OFF:
        machine.enable()
        before = State.HOLDING
    wanted_m = machine.position_m(4.0)
    machine.advance(4.0)
    assert machine.state is before
    assert machine.position_m(4.0) == pytest.approx(wanted_m, nan_ok=True)


any_time = st.floats(allow_nan=True, allow_infinity=True)


class AnyOrder(RuleBasedStateMachine):
    """Events in any order, at any time."""

    @initialize()
    def start(self):
        self.machine, self.now_s = Commanding(), 0.0

    @rule()
    def enable(self):
        self.machine.enable()

    @rule()
    def switch_off(self):
        self.machine.switch_off()
        assert math.isnan(self.machine.position_m(self.now_s))

    @rule(position_m=st.floats(0.0, 0.01), stamp_s=any_time)
    def track(self, position_m, stamp_s):
        self.machine.track(stamp_s, position_m)

    @rule(position_m=st.floats(0.0, 0.01), wire_m=any_time, stamp_s=any_time)
    def command(self, position_m, wire_m, stamp_s):
        armed, near = self.machine.armed, abs(position_m - wire_m) <= 2e-4
        counts = self.machine.command(stamp_s, position_m, wire_m, 2e-4)
        assert not counts or armed or near, "the wire was to jump"
        assert not counts or self.machine.state is State.TRACKING

    @rule(delay_s=any_time)
    def follow(self, delay_s):
        self.machine.follow(self.now_s, RAMP, delay_s)

    @rule()
    def stop(self):
        self.machine.stop()

    @rule()
    def tune(self):
        self.machine.tune()

    @rule(at_bias=st.booleans())
    def lose(self, at_bias):
        self.machine.lose("silence", at_bias)

    @rule(step_s=st.floats(0.0, 10.0))
    def advance(self, step_s):
        self.now_s += step_s
        self.machine.advance(self.now_s)

    @rule()
    def begin(self):
        self.machine.begun(self.now_s, 0.0035)

    @invariant()
    def off_remembers_nothing(self):
        if not self.machine.is_driven:
            assert math.isnan(self.machine.position_m(self.now_s))
            assert not self.machine.anew
            assert not self.machine.lost

    @invariant()
    def once_the_controller_has_begun_there_is_a_position_to_reach(self):
        if self.machine.wants_position and not self.machine.anew and not self.machine.is_tuned:
            assert math.isfinite(self.machine.position_m(self.now_s))

    @invariant()
    def joint_commands_are_followed_only_while_one_is_tracked(self):
        assert not self.machine.armed or self.machine.state is State.TRACKING

    @invariant()
    def the_setpoint_is_lost_exactly_where_the_state_says_so(self):
        assert bool(self.machine.lost) == (self.machine.state in (State.LOST_HOLDING, State.LOST_AT_BIAS))


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = settings(max_examples=100, stateful_step_count=30, deadline=None)
