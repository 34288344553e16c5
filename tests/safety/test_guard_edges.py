"""Every guard at its edges, one step at a time: on the bound, a hair beyond it, with nothing there to look at, with
NaN."""

import math
import re
from dataclasses import replace
from itertools import count
from random import Random

import numpy as np
import pytest

from sma_actuator.base.signals import Branch, Command, Estimate, Quality, Reading, Signals, SupplyState
from sma_actuator.config import Config
from sma_actuator.safety.alive import WINDOW
from sma_actuator.safety.drift import LAG_s, WINDOW_s
from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.formula import seconds
from sma_actuator.safety.guards.estimate import APART_s, estimate_invalid, estimator_outside
from sma_actuator.safety.guards.program import clock_jump, command_invalid, loop_overrun
from sma_actuator.safety.guards.readings import (
    are_inside,
    daq_lost,
    load_dead,
    reading_implausible,
    reading_not_finite,
    reading_saturated,
    reading_stale,
    readings_repeat,
    reference_doubted,
    sensor_stuck,
)
from sma_actuator.safety.guards.setpoints import (
    TRIES,
    Bucket,
    no_motion,
    setpoint_flood,
    setpoint_not_finite,
    setpoint_stale,
)
from sma_actuator.safety.guards.supply import (
    SETTING_TOLERANCE_A,
    current_drifts,
    measurements_disagree,
    second_commander,
    supply_disagrees,
    supply_lost,
    supply_tripped,
    voltage_drifts,
)
from sma_actuator.safety.guards.wire import (
    COMPLIANCE,
    COOLING_TIMES,
    heat_loss_wrong,
    load_spike,
    open_wire,
    seems_open,
    short,
    stress_above_limit,
    too_hot,
)
from sma_actuator.safety.records import NEVER_READ, Action, Fault, Guard, Memory, Step, Waited
from sma_actuator.safety.supervisor import Supervisor
from sma_actuator.safety.thermal import WireHeat

NOW_s = 100.0
CURRENT_A = 0.2
TOLD = Command(CURRENT_A, True)
OFF = Command(0.0, False)
READING = Reading(NOW_s, 1.3, 0.2, 0.08)
SIGNALS = Signals(NOW_s, 5.25, CURRENT_A, 0.21, 0.98, 54e6)
SUPPLY = SupplyState(NOW_s, CURRENT_A, True, 1.3, CURRENT_A)
ESTIMATE = Estimate(NOW_s, 0.002, 0.02, 0.0, Branch.HEATING, Quality.DETERMINATE)
MEMORY = {"reading_s": NOW_s, "daq_s": NOW_s, "supply_s": NOW_s, "load_N": 0.98}
NAN = math.nan


@pytest.fixture
def step(config: Config):
    """A step in which nothing is wrong, but for what a test changes; ``signals__load_N=1.0`` reaches inside."""

    def make(**changes):
        heat = WireHeat(config.thermal)
        heat.step(0.0, 1e6, config.thermal.ambient_temperature, config.thermal)  # cooled for long
        whole = {
            "config": config,
            "memory": Memory(**MEMORY),
            "now_s": NOW_s,
            "dt_s": 0.05,
            "driven": True,
            "settled": True,
            "raw": READING,
            "reading": READING,
            "signals": SIGNALS,
            "estimate": ESTIMATE,
            "supply": SUPPLY,
            "told": TOLD,
            "heat": heat,
        }
        for name, value in changes.items():
            part, _, inner = name.partition("__")
            whole[part] = replace(whole[part], **{inner: value}) if inner else value
        return Step(**whole)

    return make


def said(guard, step) -> str:
    """What a guard says, and that it says it of itself: the same step again gives the same."""
    return guard.look(step)


ALL = (
    clock_jump,
    loop_overrun,
    daq_lost,
    reading_saturated,
    reading_not_finite,
    reading_stale,
    readings_repeat,
    reference_doubted,
    reading_implausible,
    sensor_stuck,
    open_wire,
    short,
    stress_above_limit,
    load_spike,
    too_hot,
    supply_tripped,
    second_commander,
    supply_lost,
    supply_disagrees,
    measurements_disagree,
    estimator_outside,
    estimate_invalid,
)


@pytest.mark.parametrize("guard", ALL, ids=lambda guard: guard.name)
def test_a_step_in_which_nothing_is_wrong_has_no_fault(guard, step):
    assert said(guard, step()) == ""


@pytest.mark.parametrize(
    "guard",
    [
        reading_saturated,
        reading_not_finite,
        reading_implausible,
        sensor_stuck,
        open_wire,
        short,
        stress_above_limit,
        load_spike,
        supply_disagrees,
        measurements_disagree,
    ],
    ids=lambda guard: guard.name,
)
def test_without_a_reading_a_guard_of_readings_says_nothing_whatever_the_signals_are(guard, step):
    wild = Signals(NOW_s, 1e9, -5.0, NAN, -1e9, 1e12)
    blind = step(raw=None, reading=None, signals=wild, memory=Memory(**MEMORY, count={"open_wire": 5}))
    assert said(guard, blind) == ""


# --- values at and beyond their bounds: guard, what is changed, whether it is a fault ---------------------------------

BOUNDS = [
    (clock_jump, {"dt_s": 0.5}, False),
    (clock_jump, {"dt_s": 0.5001}, True),
    (clock_jump, {"dt_s": 0.0}, False),
    (clock_jump, {"dt_s": -1e-9}, True),
    (clock_jump, {"dt_s": NAN}, True),
    (clock_jump, {"dt_s": 5.0, "driven": False}, False),
    (clock_jump, {"dt_s": 5.0, "waited": Waited(supply_s=4.9)}, False),
    (clock_jump, {"dt_s": 5.0, "waited": Waited(daq_s=4.9)}, False),
    (reading_saturated, {"raw__supply_voltage_V": 9.999}, False),
    (reading_saturated, {"raw__supply_voltage_V": 10.0}, True),
    (reading_saturated, {"raw__supply_voltage_V": -10.0}, True),
    (reading_saturated, {"raw__supply_voltage_V": -9.999}, False),
    (reading_saturated, {"raw__reference_voltage_V": 10.0}, True),
    (reading_saturated, {"raw__reference_voltage_V": -10.0}, True),
    (reading_saturated, {"raw__load_cell_voltage_V": 10.0}, True),
    (reading_saturated, {"raw__load_cell_voltage_V": -10.0}, True),
    (reading_saturated, {"raw__load_cell_voltage_V": -math.inf}, True),
    (reading_not_finite, {"raw__load_cell_voltage_V": NAN}, True),
    (reading_not_finite, {"raw__time_s": math.inf}, True),
    (reading_not_finite, {"raw__lvdt_current_A": NAN}, False),
    (reading_implausible, {"signals__resistance_Ohm": 20.0}, False),
    (reading_implausible, {"signals__resistance_Ohm": 20.001}, True),
    (reading_implausible, {"signals__load_N": -0.5}, False),
    (reading_implausible, {"signals__load_N": -0.5001}, True),
    (reading_implausible, {"signals__load_N": NAN}, True),
    (reading_implausible, {"signals__current_A": -0.025}, False),
    (reading_implausible, {"signals__current_A": -0.0251}, True),
    (reading_implausible, {"signals__current_A": NAN}, True),
    (short, {"signals__resistance_Ohm": 1.0}, False),
    (short, {"signals__resistance_Ohm": 0.999}, True),
    (short, {"signals__resistance_Ohm": 0.1, "settled": False}, False),
    (stress_above_limit, {"signals__stress_Pa": 175e6}, False),
    (stress_above_limit, {"signals__stress_Pa": 175.1e6}, True),
    (stress_above_limit, {"signals__stress_Pa": NAN}, True),
    (load_spike, {"signals__load_N": 2.98}, False),
    (load_spike, {"signals__load_N": 2.981}, True),
    (load_spike, {"signals__load_N": -1.021}, True),
    (supply_tripped, {"supply__tripped": "OVP"}, True),
    (supply_tripped, {"supply": None}, False),
    (second_commander, {"supply__current_setting_A": CURRENT_A + 0.0019}, False),
    (second_commander, {"supply__current_setting_A": CURRENT_A - 0.0019}, False),
    (second_commander, {"supply__current_setting_A": CURRENT_A + 0.0021}, True),
    (second_commander, {"supply__current_setting_A": CURRENT_A - 0.0021}, True),
    (second_commander, {"supply__current_setting_A": CURRENT_A - 0.0060, "supply__cut_off_A": 0.0045}, False),
    (second_commander, {"supply__current_setting_A": CURRENT_A - 0.0060, "supply__cut_off_A": 0.0035}, True),
    (second_commander, {"supply__current_setting_A": NAN}, False),
    (second_commander, {"supply": None}, False),
    (second_commander, {"told": OFF, "told_s": NOW_s + 0.01}, False),
    (second_commander, {"told": OFF, "told_s": NOW_s}, True),
    (second_commander, {"supply__output_on": False}, True),
    (second_commander, {"supply__output_on": False, "supply__tripped": "WDOG"}, False),
    (second_commander, {"told": OFF}, True),
    (second_commander, {"told": OFF, "supply__output_on": False}, False),
    (estimate_invalid, {"estimate__quality": Quality.INVALID}, True),
    (estimate_invalid, {"estimate__displacement_m": NAN}, True),
    (estimate_invalid, {"estimate__quality": Quality.OUTSIDE_CALIBRATION}, False),
    (estimate_invalid, {"estimate__quality": Quality.INVALID, "settled": False}, False),
]


@pytest.mark.parametrize(("guard", "changes", "is_fault"), BOUNDS, ids=lambda value: getattr(value, "name", str(value)))
def test_a_bound_is_where_it_is_said_to_be(guard, changes, is_fault, step):
    assert bool(said(guard, step(**changes))) is is_fault


CHANNELS = ("supply_voltage_V", "reference_voltage_V", "load_cell_voltage_V")


@pytest.mark.parametrize("name", CHANNELS)
@pytest.mark.parametrize(
    ("value_V", "is_inside"),
    [(9.999, True), (-9.999, True), (10.0, False), (-10.0, False), (math.inf, False), (NAN, False)],
)
def test_one_channel_at_the_end_of_the_converter_is_enough_for_a_reading_to_be_of_no_use(name, value_V, is_inside):
    """A converter that is driven too far gives its last number, which is the bound itself."""
    assert are_inside(replace(READING, **{name: value_V}), 10.0) is is_inside


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"raw__load_cell_voltage_V": NAN}, "load cell: not a finite number"),
        (
            {"raw": Reading(math.inf, NAN, -math.inf, 0.08)},
            "time, supply voltage, reference voltage: not a finite number",
        ),
        ({"raw": Reading(NOW_s, 1.7e308, 1.7e308, 0.08)}, ""),  # too large together alone
    ],
)
def test_it_is_said_which_channels_are_not_finite(changes, words, step):
    assert said(reading_not_finite, step(**changes)) == words


# --- what takes time: how long, and what starts it anew ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("guard", "remembered", "missing"),
    [
        (daq_lost, "daq_s", {"raw": None}),
        (reading_stale, "reading_s", {"reading": None}),
        (supply_lost, "supply_s", {"supply": None}),
        (supply_lost, "supply_s", {"supply__current_setting_A": NAN}),
        (supply_lost, "supply_s", {"supply__voltage_V": math.inf}),
        (supply_lost, "supply_s", {"supply__current_A": NAN}),
    ],
)
class TestSilence:
    def test_counts_from_the_last_answer(self, guard, remembered, missing, step):
        memory = Memory(**MEMORY)
        assert said(guard, step(memory=memory)) == ""
        assert said(guard, step(memory=memory, now_s=NOW_s + 0.5, **missing)) == ""
        words = said(guard, step(memory=memory, now_s=NOW_s + 0.51, **missing))
        assert "0.51 s; safety.reading_timeout is 0.5 s" in words
        assert getattr(memory, remembered) == NOW_s

    def test_an_answer_is_remembered_with_its_time(self, guard, remembered, missing, step):
        memory = Memory(**MEMORY)
        assert said(guard, step(memory=memory, now_s=NOW_s + 7.0)) == ""
        assert getattr(memory, remembered) == NOW_s + 7.0

    def test_that_there_never_was_an_answer_is_silence(self, guard, remembered, missing, step):
        assert said(guard, step(memory=Memory(), **missing))


def stuck_at(step, memory, begun_s, seconds, **changes):
    """What is said of a channel in steps of the loop, and at which time after the first [s]."""
    period_s = 1.0 / step().config.loop.rate
    for number in range(round(seconds / period_s) + 1):
        if words := said(sensor_stuck, step(memory=memory, now_s=begun_s + number * period_s, **changes)):
            return words, number * period_s
    return "", seconds


def test_a_channel_is_stuck_after_its_time_and_not_before(step, config):
    memory = Memory(**MEMORY)
    stuck_s, period_s = config.safety.stuck_time, 1.0 / config.loop.rate
    words, after_s = stuck_at(step, memory, NOW_s, 2.0 * stuck_s)
    assert stuck_s - 1e-9 <= after_s <= stuck_s + period_s + 1e-9
    assert words.startswith("supply voltage: 1.3 V for 2")
    assert words.endswith("s to the last digit; safety.stuck_time is 2 s")


def test_two_readings_that_are_alike_by_chance_say_little_where_they_come_late(step, config):
    memory = Memory(**MEMORY)
    for number in range(5):
        late = step(memory=memory, now_s=NOW_s + number * config.safety.stuck_time)
        assert said(sensor_stuck, late) == ""


def test_a_reading_counts_for_two_periods_of_the_loop_at_most_however_late_it_comes(step, config):
    memory = Memory(**MEMORY)
    enough = math.ceil(config.safety.stuck_time * config.loop.rate / 2.0)
    words = [bool(said(sensor_stuck, step(memory=memory, now_s=NOW_s + 0.5 * number))) for number in range(enough + 2)]
    assert words.index(True) in (enough, enough + 1)  # a sum of so many times may meet its bound or not


@pytest.mark.parametrize("name", CHANNELS)
def test_a_channel_that_has_moved_is_stuck_after_the_whole_time_again(name, step, config):
    """Though the others stood all the while."""
    memory = Memory(**MEMORY)
    stuck_s, period_s = config.safety.stuck_time, 1.0 / config.loop.rate
    assert stuck_at(step, memory, NOW_s, 0.5 * stuck_s)[0] == ""
    moved = replace(READING, **{name: getattr(READING, name) + 1e-6})
    begun_s = NOW_s + 0.5 * stuck_s + period_s
    assert said(sensor_stuck, step(memory=memory, now_s=begun_s, reading=moved)) == ""
    others = [each for each in CHANNELS if each != name]
    alone = replace(moved, **{each: getattr(moved, each) + 1e-6 for each in others})
    words, after_s = stuck_at(step, memory, begun_s + period_s, 2.0 * stuck_s, reading=alone)
    assert words
    assert stuck_s - period_s - 1e-9 <= after_s <= stuck_s + 1e-9


@pytest.mark.parametrize("name", CHANNELS)
def test_each_channel_is_watched_for_itself(name, step, config):
    """The other two move on; the memory of one channel is not that of another."""
    memory = Memory(**MEMORY)
    stuck_s = config.safety.stuck_time
    others = [each for each in CHANNELS if each != name]
    assert stuck_at(step, memory, NOW_s, 0.9 * stuck_s) == ("", 0.9 * stuck_s)
    moved = replace(READING, **{each: getattr(READING, each) + 1e-6 for each in others})
    begun_s = NOW_s + 0.9 * stuck_s
    assert 0.0 < stuck_at(step, memory, begun_s, stuck_s, reading=moved)[1] < 0.3 * stuck_s
    moved = replace(moved, **{name: getattr(READING, name) + 1e-6})
    begun_s += 0.3 * stuck_s
    assert said(sensor_stuck, step(memory=memory, now_s=begun_s, reading=moved)) == ""
    # Only since then the moved channel stands where it is.
    again = replace(moved, **{each: getattr(moved, each) + 1e-6 for each in others})
    assert stuck_at(step, memory, begun_s, 0.5 * stuck_s, reading=again)[0] == ""


def test_what_a_channel_did_without_current_does_not_count(step, config):
    memory = Memory(**MEMORY)
    stuck_s = config.safety.stuck_time
    assert stuck_at(step, memory, NOW_s, 0.9 * stuck_s)[0] == ""
    assert said(sensor_stuck, step(memory=memory, told=OFF, now_s=NOW_s + 0.9 * stuck_s)) == ""
    assert memory.channels is NEVER_READ
    assert stuck_at(step, memory, NOW_s + stuck_s, 0.9 * stuck_s)[0] == ""


def test_current_off_the_command_is_a_fault_once_it_lasts(step, config):
    memory = Memory(**MEMORY)
    lasts_s, tolerance_A = config.safety.disagreement_time, config.safety.current_disagreement
    for within_A in (tolerance_A - 1e-6, -tolerance_A + 1e-6):
        assert said(supply_disagrees, step(memory=memory, signals__current_A=CURRENT_A + within_A)) == ""
        assert memory.since_s == {}
    for off_A in (tolerance_A + 1e-4, -tolerance_A - 1e-4, NAN):
        assert said(supply_disagrees, step(memory=memory, signals__current_A=CURRENT_A + off_A)) == ""
        early = step(memory=memory, signals__current_A=CURRENT_A + off_A, now_s=NOW_s + lasts_s - 0.01)
        assert said(supply_disagrees, early) == ""
        assert said(supply_disagrees, step(memory=memory, signals__current_A=CURRENT_A + off_A, now_s=NOW_s + lasts_s))
        assert said(supply_disagrees, step(memory=memory)) == ""


@pytest.mark.parametrize(("short_V", "blamed"), [(0.01, True), (1.0, False)])
def test_less_current_at_the_compliance_voltage_is_laid_to_that(step, config, short_V, blamed):
    """Channels and sense resistor were to be looked at, where 1.9 V did not drive 1.94 A through a cold coil."""
    memory, lasts_s = Memory(**MEMORY), config.safety.disagreement_time
    at_V = config.supply.max_voltage - short_V
    changes = {"memory": memory, "signals__current_A": 0.9 * CURRENT_A - 0.03, "reading__supply_voltage_V": at_V}
    said(supply_disagrees, step(**changes))
    words = said(supply_disagrees, step(**changes, now_s=NOW_s + lasts_s))
    assert words and ("drives no more through this circuit" in words) == blamed


def test_current_that_flows_while_the_output_is_off_is_one_too(step, config):
    memory = Memory(**MEMORY)
    off = {"memory": memory, "told": Command(CURRENT_A, False)}
    assert said(supply_disagrees, step(**off)) == ""
    assert "0.2 A flow, 0 A were commanded" in said(supply_disagrees, step(**off, now_s=NOW_s + 0.5))
    assert said(supply_disagrees, step(**off, signals__current_A=0.0, now_s=NOW_s + 0.6)) == ""


def test_a_setting_may_be_as_coarse_as_the_tolerance(step):
    told = Command(0.0, True)
    assert said(second_commander, step(told=told, supply__current_setting_A=SETTING_TOLERANCE_A)) == ""
    assert said(second_commander, step(told=told, supply__current_setting_A=math.nextafter(SETTING_TOLERANCE_A, 1.0)))


@pytest.mark.parametrize(
    ("told", "output_on", "words"),
    [
        (OFF, True, "the supply says 0.2 A, output on; it was told 0 A, output off"),
        (TOLD, False, "the supply says 0.2 A, output off; it was told 0.2 A, output on"),
    ],
)
def test_it_is_said_what_the_supply_was_told_and_what_it_says(told, output_on, words, step):
    assert said(second_commander, step(told=told, supply__output_on=output_on)) == words


def test_current_and_voltage_may_differ_by_the_tolerance(step, config):
    """Beside zero, where the difference is the number itself."""
    tolerance_A, tolerance_V = config.safety.current_disagreement, config.safety.voltage_disagreement
    none = {"told": Command(0.0, True), "signals__current_A": 0.0, "supply__current_A": 0.0}
    none |= {"reading": replace(READING, supply_voltage_V=0.0), "supply__voltage_V": 0.0}
    for guard, name, tolerance in (
        (supply_disagrees, "signals__current_A", tolerance_A),
        (measurements_disagree, "supply__current_A", tolerance_A),
        (measurements_disagree, "supply__voltage_V", tolerance_V),
    ):
        memory = Memory(**MEMORY)
        said(guard, step(memory=memory, **{**none, name: tolerance}))
        assert memory.since_s == {}
        memory = Memory(**MEMORY)
        said(guard, step(memory=memory, **{**none, name: math.nextafter(tolerance, 1.0)}))
        assert memory.since_s == {guard.name: NOW_s}
        assert memory.in_all == {f"{guard.name}, however late": (0.0, NOW_s, True)}


class TestADaqThatIsLate:
    """While the current moves it shows another one than is told: that of a moment before."""

    @pytest.fixture
    def driven(self, config, step):
        """``driven(guard, currents, behind, period_s)``: until when nothing is said, where the DAQ is readings behind;
        None: ever."""

        def driven(guard, currents, behind, period_s, odd=-1, times=1.0):
            memory = Memory(**MEMORY)
            at_rate = replace(config, loop=replace(config.loop, rate=1.0 / period_s))
            for number, current_A in enumerate(currents):
                shown_A, now_s = times * currents[max(number - behind, 0)], NOW_s + number * period_s
                shown_A += 0.1 * (number == odd)
                signals = {"signals__current_A": shown_A, "reading": replace(READING, supply_voltage_V=6.5 * shown_A)}
                supply = {"supply__current_A": current_A, "supply__voltage_V": 6.5 * current_A}
                told = Command(current_A, True)
                made = step(config=at_rate, memory=memory, now_s=now_s, told=told, **signals, **supply)
                if said(guard, made):
                    return number * period_s
            return None

        return driven

    @pytest.mark.parametrize("guard", [supply_disagrees, measurements_disagree], ids=lambda guard: guard.name)
    @pytest.mark.parametrize(("period_s", "behind"), [(0.05, 1), (0.05, 4), (0.1, 2), (0.5, 1), (0.5, 2)])
    def test_by_two_tenths_of_a_second_or_two_readings_is_not_accused(self, driven, guard, period_s, behind):
        to_and_fro = [0.2 + 0.15 * math.sin(3.0 * number * period_s) for number in range(400)]
        assert driven(guard, to_and_fro, behind, period_s) is None

    @pytest.mark.parametrize("guard", [supply_disagrees, measurements_disagree], ids=lambda guard: guard.name)
    @pytest.mark.parametrize(("period_s", "behind"), [(0.05, 7), (0.1, 4), (0.5, 4)])
    def test_by_more_is(self, driven, guard, period_s, behind):
        ramp = [0.05 + 0.2 * min(number * period_s, 2.0) for number in range(100)]
        assert driven(guard, ramp, behind, period_s) is not None

    @pytest.mark.parametrize("guard", [supply_disagrees, measurements_disagree], ids=lambda guard: guard.name)
    def test_nor_for_one_reading_that_is_odd_besides(self, driven, guard):
        ramp = [0.05 + 0.15 * 0.05 * number for number in range(40)]
        assert driven(guard, ramp, 4, 0.05, odd=30) is None

    @pytest.mark.parametrize("guard", [supply_disagrees, measurements_disagree], ids=lambda guard: guard.name)
    @pytest.mark.parametrize("swings_s", [0.3, 0.45, 0.6])
    def test_a_command_that_swings_through_twice_itself_hides_the_double_for_no_longer(self, driven, guard, swings_s):
        """What it was just before is now twice what it is, again and again."""
        swings = [0.1 + 0.1 * (math.sin(2.0 * math.pi * number * 0.02 / swings_s) > 0.9) for number in range(400)]
        assert driven(guard, swings, 0, 0.02, times=2.0) <= 2.0

    @pytest.mark.parametrize("guard", [supply_disagrees, measurements_disagree], ids=lambda guard: guard.name)
    @pytest.mark.parametrize("period_s", [0.02, 0.05, 0.1, 0.5])
    def test_a_supply_that_stands_still_is_found_in_the_promised_time(self, driven, config, guard, period_s):
        """It keeps the current that it had when a setpoint came: all of the step later is off."""
        step_A = [0.05] + [0.3] * 100
        at_rate = replace(config, loop=replace(config.loop, rate=1.0 / period_s))
        assert driven(guard, step_A, 1000, period_s) <= guard.within(at_rate) + 1e-9


class TestMeasurementsDisagree:
    """What the supply measures beside what the DAQ measures, of one circuit."""

    @pytest.mark.parametrize(
        ("measured", "what"),
        [
            (
                {"supply__current_A": CURRENT_A + 0.021},
                "current: the supply measures 0.221 A, the DAQ 0.2 A, for 0.5 s; ",
            ),
            (
                {"supply__current_A": CURRENT_A - 0.021},
                "current: the supply measures 0.179 A, the DAQ 0.2 A, for 0.5 s; ",
            ),
            ({"supply__current_A": NAN}, "current: the supply measures nan A, the DAQ 0.2 A, for 0.5 s; "),
            ({"supply__voltage_V": 1.81}, "voltage: the supply measures 1.81 V, the DAQ 1.3 V, for 0.5 s; "),
            ({"supply__voltage_V": 0.79}, "voltage: the supply measures 0.79 V, the DAQ 1.3 V, for 0.5 s; "),
            ({"supply__current_A": 1.0, "supply__voltage_V": 9.0}, "current: the supply measures 1 A, "),
        ],
    )
    def test_is_a_fault_once_it_lasts(self, measured, what, step, config):
        memory = Memory(**MEMORY)
        lasts_s = config.safety.disagreement_time
        assert said(measurements_disagree, step(memory=memory, **measured)) == ""
        assert said(measurements_disagree, step(memory=memory, **measured, now_s=NOW_s + lasts_s - 0.01)) == ""
        assert said(measurements_disagree, step(memory=memory, **measured, now_s=NOW_s + lasts_s)).startswith(what)
        assert said(measurements_disagree, step(memory=memory, now_s=NOW_s + lasts_s)) == ""
        assert memory.since_s == {}

    @pytest.mark.parametrize(
        "measured",
        [
            {"supply__current_A": CURRENT_A + 0.019},
            {"supply__current_A": CURRENT_A - 0.019},
            {"supply__voltage_V": 1.79},
            {"supply__voltage_V": 0.81},
            {"supply__voltage_V": 9.0, "told": OFF},
            {"supply": None},
            {"reading": None, "supply__voltage_V": 9.0},
        ],
    )
    def test_is_none_within_the_tolerance_nor_where_there_is_nothing_to_compare(self, measured, step, config):
        memory = Memory(**MEMORY)
        assert said(measurements_disagree, step(memory=memory, **measured)) == ""
        assert memory.since_s == {}
        assert said(measurements_disagree, step(memory=memory, **measured, now_s=NOW_s + 9.0)) == ""


OPEN = {"reading__supply_voltage_V": 5.7, "signals__current_A": 0.09}


@pytest.mark.parametrize(
    ("changes", "is_open"),
    [
        ({}, True),
        ({"reading__supply_voltage_V": 5.69}, False),
        ({"signals__current_A": 0.1}, False),
        ({"signals__current_A": NAN}, True),
        ({"told": Command(CURRENT_A, False)}, False),
    ],
)
def test_a_wire_is_open_at_the_compliance_voltage_with_little_current_in_two_steps(changes, is_open, step):
    memory = Memory(**MEMORY)
    both = {**OPEN, **changes, "memory": memory}
    assert said(open_wire, step(**both)) == ""
    assert bool(said(open_wire, step(**both))) is is_open
    assert said(open_wire, step(memory=memory)) == ""
    assert said(open_wire, step(**both)) == ""  # two running, counted anew


def test_a_load_that_grows_bit_by_bit_has_not_jumped(step, config):
    memory = Memory(**MEMORY)
    for number in range(1, 6):
        heavier = replace(SIGNALS, load_N=SIGNALS.load_N + 0.9 * number * config.safety.load_spike)
        assert said(load_spike, step(signals=heavier, memory=memory)) == ""


def test_the_compliance_voltage_begins_at_its_share_of_the_limit(step):
    share_V = COMPLIANCE * step().config.supply.max_voltage
    for voltage_V, is_open in ((share_V, True), (math.nextafter(share_V, 0.0), False)):
        changes = {"reading": replace(READING, supply_voltage_V=voltage_V), "signals__current_A": 0.0}
        assert seems_open(step(**changes)) is is_open


def test_an_open_wire_is_no_implausible_one(step):
    """Whatever the last of the current makes of its resistance, it is named for what it is, one reading later."""
    open_V, dying_A = 0.99 * step().config.supply.max_voltage, 2e-5
    signals = replace(SIGNALS, resistance_Ohm=open_V / dying_A, current_A=dying_A)
    reading = replace(READING, supply_voltage_V=open_V)
    assert said(reading_implausible, step(raw=reading, reading=reading, signals=signals)) == ""
    reading = replace(READING, supply_voltage_V=0.5 * open_V)
    assert "safety.resistance_max" in said(reading_implausible, step(raw=reading, reading=reading, signals=signals))


def test_too_hot_is_what_it_may_be_at_most(step, config):
    heat = WireHeat(config.thermal)  # of which nothing is known: as hot as it may be
    assert heat.at_most_C == config.thermal.max_temperature
    assert said(too_hot, step(heat=heat)) == ""
    heat.step(1.0, 0.01, config.thermal.ambient_temperature, config.thermal)
    assert heat.at_most_C > config.thermal.max_temperature
    assert "thermal.max_temperature is 200 °C" in said(too_hot, step(heat=heat))


def test_too_much_stress_is_said_in_megapascals(step):
    assert said(stress_above_limit, step(signals__stress_Pa=176.5e6)) == "176.5 MPa; wire.max_stress is 175 MPa"


class TestHeatLossWrong:
    """A wire that the balance calls cold, and that stays contracted."""

    RISE_K, POSITION_m = 60.0, 1e-3

    @pytest.fixture
    def look(self, step, make_config):
        """``look(memory, later_s, rise_K, position_m, **changes)``: what the guard says."""
        hot_end = {"cooling_position": self.POSITION_m, "cooling_stress": [54e6], "cooling_rise": [self.RISE_K]}
        config = Config.from_mapping(make_config(calibration={"hot_end": hot_end}))

        def look(memory, later_s=0.0, rise_K=10.0, position_m=0.5e-3, half_m=NAN, warmer_K=0.0, **changes):
            heat = WireHeat(config.thermal)
            heat.ambient.temperature_C += warmer_K
            heat.step(rise_K * config.thermal.heat_loss, 1e6, heat.ambient.temperature_C, config.thermal)
            estimate = replace(ESTIMATE, displacement_m=position_m, uncertainty_m=half_m)
            now = {"config": config, "heat": heat, "estimate": estimate, "memory": memory, "now_s": NOW_s + later_s}
            return said(heat_loss_wrong, step(**{**now, **changes}))

        return look

    def test_is_a_fault_after_some_of_the_wires_time_constants(self, look, config):
        memory = Memory(**MEMORY)
        lasts_s = COOLING_TIMES * config.thermal.heat_capacity / config.thermal.heat_loss
        assert look(memory) == look(memory, lasts_s - 1e-3) == ""
        ambient_C = config.thermal.ambient_temperature
        assert look(memory, lasts_s + 1e-3).startswith(
            f"for {lasts_s:.3g} s the wire is contracted to 0.5 mm and the balance says {ambient_C + 10.0:.0f} °C; "
        )
        assert f"warmer than {ambient_C:.0f} °C" in look(memory, lasts_s + 1e-3)

    @pytest.mark.parametrize(
        ("changes", "is_one"),
        [
            ({}, True),
            ({"rise_K": 0.49 * RISE_K}, True),
            ({"rise_K": 0.51 * RISE_K}, False),
            ({"position_m": math.nextafter(POSITION_m, 0.0)}, True),
            ({"position_m": POSITION_m}, False),
            ({"position_m": NAN}, False),
            ({"half_m": 0.499e-3}, True),
            ({"half_m": 0.5e-3}, False),
            ({"warmer_K": 40.0, "rise_K": 9.9}, True),
            ({"warmer_K": 40.0, "rise_K": 10.1}, False),
            ({"warmer_K": RISE_K, "rise_K": 0.0}, False),
            ({"warmer_K": -4.0, "rise_K": 31.9}, True),
            ({"warmer_K": -4.0, "rise_K": 32.1}, False),
            ({"settled": False}, False),
            ({"estimate": replace(ESTIMATE, displacement_m=0.5e-3, quality=Quality.INDETERMINATE_HOT)}, True),
            ({"estimate": replace(ESTIMATE, displacement_m=0.5e-3, quality=Quality.OUTSIDE_CALIBRATION)}, False),
        ],
    )
    def test_looks_at_a_wire_whose_place_is_known_and_that_should_be_cold(self, changes, is_one, look):
        memory = Memory(**MEMORY)
        look(memory, **changes)
        assert bool(memory.since_s) is is_one

    @pytest.mark.parametrize(("rise_K", "is_one"), [(39.9, True), (40.1, False)])
    def test_counts_from_the_surroundings_of_the_calibration_where_it_says_them(
        self, rise_K, is_one, look, config, make_config
    ):
        """20 K warmer than now."""
        then_C = config.thermal.ambient_temperature + 20.0
        hot_end = {"cooling_position": self.POSITION_m, "cooling_stress": [54e6], "cooling_rise": [self.RISE_K]}
        warm = make_config(calibration={"ambient_temperature": then_C, "hot_end": hot_end})
        memory = Memory(**MEMORY)
        look(memory, rise_K=rise_K, config=Config.from_mapping(warm))
        assert bool(memory.since_s) is is_one

    @pytest.mark.parametrize(("cold_m", "is_one"), [(1.01 * POSITION_m, True), (0.99 * POSITION_m, False)])
    def test_is_none_under_a_load_that_leaves_the_cold_wire_shorter(self, cold_m, is_one, look, make_config):
        ends = {"stress": [54e6], "resistance": [4.0], "displacement": [0.2e-3]}
        hot_end = {"cooling_position": self.POSITION_m, "cooling_stress": [54e6], "cooling_rise": [self.RISE_K]}
        hot_end |= {f"contracted_{name}": value for name, value in ends.items()}
        rest = {f"cold_{name}": value for name, value in (ends | {"displacement": [cold_m]}).items()}
        memory = Memory(**MEMORY)
        look(memory, config=Config.from_mapping(make_config(calibration={"hot_end": hot_end, "rest": rest})))
        assert bool(memory.since_s) is is_one

    @pytest.mark.parametrize(("longer_m", "is_one"), [(-0.4e-3, True), (-0.6e-3, False)])
    def test_a_wire_that_is_shorter_since_it_cooled_under_another_load_is_not_contracted(self, longer_m, is_one, look):
        memory = Memory(**MEMORY)
        look(memory, longer_m=longer_m)
        assert bool(memory.since_s) is is_one

    def test_is_not_looked_for_where_the_calibration_does_not_say_what_a_cooling_wire_shows(self, step):
        memory = Memory(**MEMORY)
        said(heat_loss_wrong, step(memory=memory))
        assert memory.since_s == {}


class TestOverruns:
    """A leaky count of deadlines: in periods, how long each step came after the one before."""

    @pytest.fixture
    def missed(self, step, config):
        """``missed(*periods)``: the fault's words after such steps, and how many of them it took."""

        def look(*periods, memory=None, **seen):
            memory = memory or Memory(**MEMORY)
            for number, each in enumerate(periods, start=1):
                words = said(loop_overrun, step(memory=memory, dt_s=each / config.loop.rate, **seen))
                if words:
                    return number
            return None

        return look

    @pytest.fixture
    def most(self, config):
        return config.loop.overruns_to_fault

    def test_as_many_missed_running_as_the_parameter_says_are_one(self, missed, most):
        assert missed(*most * [2.0]) == most
        assert missed(*most * [NAN]) == most
        assert missed(*(3 * most) * [1.6]) == math.ceil(most / 0.6)

    @pytest.mark.parametrize("periods", [(1.0,), (1.5,), (1.6, 0.4), (2.2, 0.2), (2.0, 1.0, 1.0), (4.0, *6 * (1.0,))])
    def test_a_third_of_them_may_be_missed_for_ever(self, missed, periods):
        assert missed(*periods * 1000) is None

    @pytest.mark.parametrize("periods", [(2.0, 1.0), (2.9, 0.1), (3.0, 1.0, 1.0), (8.0, *7 * (1.0,)), (3.0, 0.6)])
    def test_more_are_a_stutter(self, missed, most, periods):
        assert missed(*periods * 10 * most) is not None

    def test_one_gap_or_two_are_none_however_long(self, missed, most):
        gap = 0.9 * most
        assert missed(gap, 1.0, gap, *most * [1.0]) is None
        assert missed(gap, 1.0, gap, 1.0, gap) == 5
        assert missed(0.6 * most, 0.6 * most) == 2, "half of them each"

    @pytest.mark.parametrize(("most", "periods", "told"), [(1, 1.0, False), (1, 2.0, True), (2, 4.0, False)])
    def test_where_a_single_one_is_a_fault_it_is(self, step, config, most, periods, told):
        strict = replace(config, loop=replace(config.loop, overruns_to_fault=most))
        late = step(config=strict, memory=Memory(**MEMORY), dt_s=periods / config.loop.rate)
        assert bool(said(loop_overrun, late)) == told

    @pytest.mark.parametrize(("gap_s", "gaps"), [(0.102, 11), (0.251, 5), (0.336, 4), (0.499, 3)])
    def test_however_quick_the_loop_is_gaps_are_none_until_they_take_twice_the_time_out(
        self, step, config, gap_s, gaps
    ):
        """With twenty steps between them, which pay for all that a gap counts of the deadlines."""
        memory, quick = Memory(**MEMORY), replace(config, loop=replace(config.loop, rate=1000.0))
        said_of = [
            [said(loop_overrun, step(memory=memory, config=quick, dt_s=each)) for each in (*20 * [0.001], gap_s)]
            for _ in range(gaps)
        ]
        assert not any(any(each) for each in (*said_of[:-1], said_of[-1][:-1]))
        owed_s = gaps * (gap_s - 0.001) - (gaps - 1) * 0.01
        assert 1.0 <= owed_s < 1.0 + gap_s - 0.01 and f"{owed_s:.3g} s, less" in said_of[-1][-1]

    @pytest.mark.parametrize("silent", ["raw", "supply"])
    def test_a_step_without_an_answer_is_the_instruments(self, missed, most, silent):
        memory = Memory(**MEMORY)
        assert missed(*(most - 1) * [2.0], memory=memory) is None
        assert missed(*(3 * most) * [2.0], memory=memory, **{silent: None}) is None
        assert missed(2.0, memory=memory) == 1

    def test_behind_an_output_that_is_off_none_is_counted(self, missed, most):
        memory = Memory(**MEMORY)
        assert missed(*(most - 1) * [2.0], memory=memory) is None
        assert missed(*(3 * most) * [2.0], memory=memory, driven=False) is None
        assert missed(*(most - 1) * [2.0], memory=memory) is None
        assert missed(2.0, memory=memory) == 1


@pytest.mark.parametrize("quality", [Quality.OUTSIDE_CALIBRATION, Quality.INVALID])
def test_an_estimate_outside_is_a_fault_once_it_lasts(quality, step, config):
    memory = Memory(**MEMORY)
    lasts_s = config.safety.outside_calibration_time
    outside = {"memory": memory, "estimate__quality": quality}
    assert said(estimator_outside, step(**outside)) == ""
    assert said(estimator_outside, step(**outside, now_s=NOW_s + lasts_s - 0.01)) == ""
    assert "54 MPa" in said(estimator_outside, step(**outside, now_s=NOW_s + lasts_s))
    assert said(estimator_outside, step(**outside, now_s=NOW_s + lasts_s + 0.1, settled=False)) == ""
    assert said(estimator_outside, step(**outside, now_s=NOW_s + lasts_s + 0.2)) == ""
    at_the_end = step(memory=memory, estimate__quality=Quality.INDETERMINATE_HOT, now_s=NOW_s + 99.0)
    assert said(estimator_outside, at_the_end) == ""


# --- what is not asked in each step -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wanted_A", "is_fault"),
    [
        *((0.0, False), (0.4, False), (np.float64(0.4), False), (-1e-12, True), (math.inf, True), (-math.inf, True)),
        *((NAN, True), (None, True), (np.array([0.4]), True), ("0.4", True)),
    ],
)
def test_a_command_is_a_finite_current_of_at_least_zero(wanted_A, is_fault):
    assert bool(command_invalid.look(wanted_A)) is is_fault


@pytest.mark.parametrize(("position_m", "is_fault"), [(0.002, False), (NAN, True), (math.inf, True)])
def test_a_setpoint_is_a_finite_position(position_m, is_fault):
    assert bool(setpoint_not_finite.look(position_m)) is is_fault


@pytest.mark.parametrize(
    ("age_s", "timeout_s", "is_lost"),
    [
        (1e9, 0.0, False),
        (2.0, 2.0, False),
        (2.01, 2.0, True),
        (-2.0, 2.0, False),
        (-2.01, 2.0, True),
        (NAN, 2.0, True),
        (0.5, 0.4, True),
    ],
)
def test_a_setpoint_is_lost_after_its_time(age_s, timeout_s, is_lost, make_config):
    config = Config.from_mapping(make_config(**{"controller.setpoint_timeout": timeout_s}))
    assert bool(setpoint_stale.look(age_s, False, config)) is is_lost


@pytest.mark.parametrize(("age_s", "is_lost"), [(0.4, False), (0.41, True), (-0.41, True), (NAN, True)])
def test_joint_commands_are_lost_after_a_time_of_their_own(age_s, is_lost, make_config):
    config = Config.from_mapping(make_config(**{"controller.joint_command_timeout": 0.4}))
    assert bool(setpoint_stale.look(age_s, True, config)) is is_lost


@pytest.mark.parametrize("by_joint_command", [False, True])
def test_it_is_said_which_of_the_two_was_lost_and_what_its_time_is(by_joint_command, make_config):
    changes = {"controller.joint_command_timeout": 0.4, "controller.setpoint_timeout": 2.0}
    words = setpoint_stale.look(3.0, by_joint_command, Config.from_mapping(make_config(**changes)))
    name = "controller.joint_command_timeout is 0.4 s" if by_joint_command else "controller.setpoint_timeout is 2 s"
    assert words == f"none for 3 s; {name}"


@pytest.mark.parametrize(("tries", "is_fault"), [(0, False), (TRIES - 1, False), (TRIES, True), (TRIES + 1, True)])
def test_backing_off_in_vain_is_a_fault_after_as_many_times_as_are_promised(tries, is_fault):
    assert bool(no_motion.look(tries)) is is_fault


class TestBucket:
    def test_a_burst_is_a_tenth_of_a_second_worth_and_then_one_comes_for_each_period(self):
        bucket = Bucket()
        assert [bucket.take(0.0, 1000.0) for _ in range(101)] == [True] * 100 + [False]
        assert [bucket.take(0.0105, 1000.0) for _ in range(11)] == [True] * 10 + [False]

    def test_a_burst_is_ten_at_least(self):
        bucket = Bucket()
        assert [bucket.take(0.0, 2.0) for _ in range(11)] == [True] * 10 + [False]

    def test_a_clock_that_stands_or_runs_back_fills_nothing_and_nan_breaks_nothing(self):
        bucket = Bucket()
        for _ in range(10):
            bucket.take(5.0, 1.0)
        assert not bucket.take(5.0, 1.0)
        assert not bucket.take(4.0, 1.0)
        assert not bucket.take(NAN, 1.0)
        assert not bucket.take(4.9, 1.0)
        assert bucket.take(5.9, 1.0)

    def test_a_clock_that_runs_back_takes_nothing_away(self):
        bucket = Bucket()
        assert [bucket.take(now_s, 1.0) for now_s in (5.0, 4.5, *[4.5] * 8, 4.5)] == [True] * 10 + [False]

    def test_the_guard_says_which_rate_was_exceeded(self, config):
        bucket = Bucket()
        words = [setpoint_flood.look(bucket, 0.0, config) for _ in range(101)]
        assert not any(words[:100])
        assert "1000 Hz" in words[100]


# --- the table and the last gate --------------------------------------------------------------------------------------


def test_what_latches_while_the_output_is_off_is_what_must_be_known_before_it_goes_on():
    assert {fault.name for fault in FAULTS.values() if fault.while_off} == {
        "unhandled_exception",
        "node_lost",
        "loop_hung",
        "output_not_confirmed",
        "supply_tripped",
        "watchdog_not_held",
        "limits_not_held",
        "second_commander",
        "supply_disagrees",
        "too_hot",
    }
    for fault in FAULTS.values():
        assert fault.latches or not fault.while_off
        assert fault.latches is (fault.action is Action.OFF)


def test_a_fault_latches_only_where_it_says_so_and_only_then_has_to_be_cleared():
    mild = Fault("mild", words="it is mild", remedy="Wait", detector="a test", within=seconds(1.0), action=Action.BIAS)
    assert (mild.latches, mild.while_off, mild.action_by) == (False, False, "")
    assert mild.advice == "Wait."
    assert replace(mild, latches=True).advice == "Wait. Then ~/clear_fault and ~/enable."


def test_what_is_not_looked_for_in_each_step_is_what_somebody_else_looks_for():
    not_each = {name for name, fault in FAULTS.items() if isinstance(fault, Guard) and not fault.each_step}
    assert not_each == {"command_invalid", "setpoint_not_finite", "setpoint_flood", "setpoint_stale", "no_motion"}


class TestGate:
    @pytest.fixture
    def gate(self, config, monkeypatch):
        """``gate(wanted_A, limit_A)``: the command that passes."""

        def command(wanted_A, limit_A, driven=True, faults=()):
            supervisor = Supervisor(config)
            monkeypatch.setattr(supervisor, "_heat_leaves_A", limit_A)
            return supervisor.gate(wanted_A, driven, dict.fromkeys(faults, "as a test says"))[0]

        return command

    @pytest.mark.parametrize(
        ("wanted_A", "limit_A", "passes_A"),
        [(0.1, 0.4, 0.1), (0.4, 0.4, 0.4), (0.5, 0.4, 0.4), (0.5, 0.9, 0.4), (0.3, 0.2, 0.2), (0.0, 0.4, 0.0)],
    )
    def test_the_least_of_what_is_wanted_and_allowed_passes(self, gate, wanted_A, limit_A, passes_A):
        assert gate(wanted_A, limit_A) == Command(passes_A, True)

    @pytest.mark.parametrize("limit_A", [-0.1, -1e-12])
    def test_a_limit_that_is_no_current_lets_nothing_pass(self, gate, limit_A):
        assert gate(0.3, limit_A) == Command(0.0, False)

    def test_without_being_driven_nothing_passes(self, gate):
        assert gate(0.3, 0.4, driven=False) == Command(0.0, False)

    @pytest.mark.parametrize(("fault", "passes_A"), [(estimate_invalid, 0.05), (setpoint_not_finite, 0.3)])
    def test_a_fault_whose_action_is_the_bias_leaves_the_bias(self, gate, fault, passes_A):
        assert gate(0.3, 0.4, faults=[fault]) == Command(passes_A, True)


class Driven:
    """Steps of a wire that is held, one every 50 ms; what a guard remembers goes on from one to the next."""

    PERIOD_s = 0.05

    def __init__(self, guard, step):
        self.guard, self.step, self.memory, self.now_s, self.number = guard, step, Memory(**MEMORY), NOW_s, 0

    def words(self, seconds, **changes):
        """After how long the guard says something [s], and what; (inf, "") where it does not."""
        begun_s = self.now_s
        for _ in range(round(seconds / self.PERIOD_s)):
            self.now_s += self.PERIOD_s
            self.number += 1
            now = {
                "supply": replace(SUPPLY, voltage_V=1.3 + 1e-3 * (self.number % 2))
            } | changes  # shows its last digit
            if (reading := changes.get("reading", READING)) is not None:
                reading = replace(reading, time_s=self.now_s)
            words = said(
                self.guard, self.step(**now | {"memory": self.memory, "now_s": self.now_s, "reading": reading})
            )
            if words:
                return self.now_s - begun_s, words
        return math.inf, ""


DRIFTED = {
    current_drifts: {"signals__current_A": 1.02 * CURRENT_A},
    voltage_drifts: {"reading": replace(READING, supply_voltage_V=1.4)},
}
NOTHING = (math.inf, "")


@pytest.mark.parametrize("guard", DRIFTED, ids=lambda guard: guard.name)
class TestDrifts:
    @pytest.fixture
    def driven(self, guard, step):
        return Driven(guard, step)

    def test_what_was_measured_from_the_first_is_right_and_what_it_drifts_to_once_it_was_said(self, driven, guard):
        assert driven.words(5.0, **DRIFTED[guard]) == NOTHING
        assert driven.words(5.0)[1]
        assert driven.words(20.0) == NOTHING
        assert driven.words(5.0, **DRIFTED[guard])[1]

    def test_it_is_said_in_the_promised_time(self, driven, guard, config):
        assert driven.words(5.0) == NOTHING
        assert driven.words(5.0, **DRIFTED[guard])[0] <= guard.within(config) + 1e-9

    def test_where_there_is_nothing_to_compare_nothing_is_said(self, driven, guard):
        for nothing in ({"reading": None}, {"supply": None}, {"told": OFF}, {"reading": None, "supply": None}):
            assert driven.words(5.0) == NOTHING
            assert driven.words(5.0, **{**DRIFTED[guard], **nothing}) == NOTHING

    def test_a_pause_begins_the_means_anew_and_forgets_nothing(self, driven, guard):
        assert driven.words(5.0) == NOTHING
        assert driven.words(0.3, **DRIFTED[guard]) == NOTHING
        assert driven.words(0.1, **DRIFTED[guard], told=OFF) == NOTHING
        after_s, words = driven.words(5.0, **DRIFTED[guard])
        known_s = {current_drifts: LAG_s, voltage_drifts: WINDOW_s}[guard]  # a current that stands sooner
        assert words and after_s > known_s

    def test_a_jump_is_another_guards(self, driven, guard):
        assert driven.words(5.0) == NOTHING
        jumped = {"signals__current_A": CURRENT_A + 0.021, "reading": replace(READING, supply_voltage_V=1.81)}
        assert driven.words(5.0, **jumped) == NOTHING


def test_what_drifts_is_said_with_both_differences(step):
    driven = Driven(current_drifts, step)
    assert driven.words(5.0) == NOTHING
    words = driven.words(5.0, signals__current_A=1.02 * CURRENT_A, supply__current_A=CURRENT_A + 0.003)[1]
    found_mA = float(re.fullmatch(r"at 0.2 A the DAQ measures \+(\S+) mA more than .*", words)[1])
    assert 2.0 < found_mA <= 4.0
    assert words.endswith("the supply +3 mA more than it was told; safety.current_drift is 0.005")
    driven = Driven(voltage_drifts, step)
    assert driven.words(5.0) == NOTHING
    words = driven.words(5.0, reading=replace(READING, supply_voltage_V=1.4))[1]
    found_mV = float(re.fullmatch(r"at 1.3 V the DAQ measures \+(\S+) mV more than .*", words)[1])
    assert 29.5 < found_mV <= 101.0


class TestDriftOfTheCurrent:
    @pytest.fixture
    def driven(self, step):
        driven = Driven(current_drifts, step)
        assert driven.words(5.0) == NOTHING
        return driven

    def test_none_is_looked_for_at_the_compliance_voltage(self, driven, config):
        at_V = COMPLIANCE * config.supply.max_voltage
        assert driven.words(5.0, **DRIFTED[current_drifts], supply__voltage_V=at_V) == NOTHING
        assert driven.words(5.0, **DRIFTED[current_drifts], supply__voltage_V=math.nextafter(at_V, 0.0))[1]

    @pytest.mark.parametrize(("setting_A", "is_said"), [(1.025 * CURRENT_A, False), (CURRENT_A, True), (NAN, True)])
    def test_between_what_was_told_and_what_is_set_the_supply_may_deliver_any(self, driven, setting_A, is_said):
        words = driven.words(5.0, **DRIFTED[current_drifts], supply__current_setting_A=setting_A)[1]
        assert bool(words) == is_said


@pytest.mark.parametrize(
    "nothing", [{"supply__voltage_V": NAN}, {"signals__current_A": 0.0}, {"signals__current_A": NAN}]
)
def test_no_drift_of_a_voltage_is_looked_for_without_current_or_the_supplys_own(step, nothing):
    driven = Driven(voltage_drifts, step)
    assert driven.words(5.0) == NOTHING
    assert driven.words(5.0, **DRIFTED[voltage_drifts], **nothing) == NOTHING


class TestReferenceDoubted:
    @pytest.mark.parametrize("side", [1.0, -1.0])
    def test_a_place_beyond_the_length_of_the_wire(self, step, config, side):
        at_m = side * config.wire.length
        assert said(reference_doubted, step(signals__reference_displacement_m=at_m)) == ""
        assert said(reference_doubted, step(signals__reference_displacement_m=math.nextafter(at_m, side * 1.0)))

    def test_it_says_both(self, step):
        beyond = step(signals__reference_displacement_m=0.999)
        assert said(reference_doubted, beyond) == "999 mm, of a wire of 100 mm"

    def test_without_a_reading_nothing_is(self, step):
        assert said(reference_doubted, step(reading=None, signals__reference_displacement_m=0.2)) == ""


class TestReadingsRepeat:
    @pytest.fixture
    def alive(self, step):
        """A memory of 300 readings none of which was like the one before."""
        memory = Memory(**MEMORY)
        for number in range(300):
            reading = replace(READING, supply_voltage_V=1.3 + 1e-4 * (number % 7))
            assert said(readings_repeat, step(memory=memory, reading=reading)) == ""
        return memory

    def test_a_block_that_comes_again_and_again_and_what_is_usual_is_then_seen_anew(self, step, alive):
        words = [said(readings_repeat, step(memory=alive)) for _ in range(12)]
        assert any(words[:10])
        assert "never had so often" in next(filter(None, words))
        assert sum(map(bool, words)) == 1

    @pytest.mark.parametrize("nothing", [{"told": OFF}, {"reading": None}])
    def test_not_while_nothing_flows_or_is_read(self, step, alive, nothing):
        assert not any(said(readings_repeat, step(memory=alive, **nothing)) for _ in range(100))


class TestLoadDead:
    """A load cell with noise, on a wire of 4 mm of stroke that is moved to and fro by 3 mm of it."""

    PERIOD_s = 0.0625  #: a power of two: sums of it are exact
    SPRING_N_m = 400.0

    @pytest.fixture
    def read(self, step):
        """``read(place_m, load_N, **changes)``: what the guard says of the next reading."""
        memory, random, times_s = Memory(**MEMORY), Random(0), count(NOW_s, self.PERIOD_s)

        def read(place_m=1e-3, load_N=1.0, shown_m=NAN, **changes):
            now = {
                "memory": memory,
                "now_s": next(times_s),
                "estimate__displacement_m": place_m,
                "signals": replace(SIGNALS, load_N=load_N, reference_displacement_m=shown_m),
                "reading__load_cell_voltage_V": 0.08 + random.gauss(0.0, 1e-4),
            }
            return said(load_dead, step(**{**now, **changes}))

        return read

    def move(self, read, motions, spring_N_m, **changes):
        """What is said while the wire is moved so often, by ten readings each; the last motion has turned."""
        there = [0.5e-3 + 0.3e-3 * number for number in range(10)]
        ways_m = there + [each + 0.3e-3 for each in reversed(there)]
        places_m = [ways_m[number % 20] for number in range(10 * motions + 4)]
        return "".join(read(place_m, 2.0 - spring_N_m * place_m, **changes) for place_m in places_m)

    @pytest.mark.parametrize("quality", [Quality.DETERMINATE, Quality.INDETERMINATE_COLD, Quality.INDETERMINATE_HOT])
    def test_a_load_that_does_not_follow_the_wire_any_more_is_dead(self, read, quality):
        assert self.move(read, 4, self.SPRING_N_m) == ""
        assert "N belong to a motion of" in self.move(read, 4, 0.0, estimate__quality=quality)

    @pytest.mark.parametrize(
        "changes",
        [
            {"driven": False},
            {"settled": False},
            {"driven": False, "settled": False},
            {"estimate__quality": Quality.OUTSIDE_CALIBRATION},
            {"estimate__quality": Quality.INVALID},
        ],
        ids=str,
    )
    def test_where_the_wire_has_no_place_of_its_own_nothing_has_to_follow_it(self, read, changes):
        """While it is not driven, or its estimate is not to be relied on."""
        assert self.move(read, 4, self.SPRING_N_m) == ""
        assert self.move(read, 4, 0.0, **changes) == ""

    def test_one_that_changes_by_itself_while_the_sensor_contradicts_the_position_is_none_after_a_second(self, read):
        """A weight, to and fro, that gets half as heavy where the wire stands; until then the sensor agrees."""
        assert self.move(read, 4, 0.0) == ""
        assert read(0.999e-3, 2.0, 0.999e-3) == ""
        words = [read(0.999e-3, 1.0, 3e-3) for _ in range(round(APART_s / self.PERIOD_s) + 1)]
        assert words[:-1] == [""] * (len(words) - 1)
        assert words[-1] == "since it changed by itself the displacement sensor contradicts the position, 0.999 mm"

    @pytest.mark.parametrize(("least_noise", "is_dead"), [(0.0, False), (0.1, True)])
    def test_no_noise_at_all_is_too_little_unless_the_least_is_zero(self, read, config, least_noise, is_dead):
        """Its last values go on evenly, in steps without a rounding."""
        for _ in range(4 * WINDOW):
            assert read() == ""
        config = replace(config, safety=replace(config.safety, least_noise=least_noise))
        evenly_V = [0.0625 + number / 2**20 for number in range(WINDOW)]
        words = [read(config=config, reading__load_cell_voltage_V=each) for each in evenly_V]
        assert any("its noise is" in each for each in words) is is_dead
