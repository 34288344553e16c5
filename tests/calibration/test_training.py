"""A wire that changes while it is measured is said to be one."""

import dataclasses
import functools
import math

import pytest
from characterised import bench_mapping, virtual_rig

from sma_actuator.calibration.training import change_while_measured_m
from sma_actuator.characterise.programs import held_currents, square_pulses
from sma_actuator.identify import identify
from sma_actuator.logs.kinds import FOLLOWED
from sma_actuator.plant.loads import Weight
from sma_actuator.plant.worlds import IN_TRAINING

LOADS_N = (0.6, 1.0, 1.5)


@functools.cache
def pulses(cycles, most_A=0.0):
    """Logs of three pulses at three loads, one after the other, of a wire that has done so many cycles before.

    ``most_A``: up to which the first goes on while the wire still contracts, as `characterise` lets it.
    """
    logs = []
    for load_N in LOADS_N:
        bench, rig, _ = virtual_rig("flexinol", seed=3, load=Weight(load_N), physics="in_training", cycles=cycles)
        with rig.opened():
            logs.append(rig.record(square_pulses(3, 0.34, 0.05, 5.0, 10.0, most_A=most_A)))
        cycles += bench.cycles
    return logs, rig.config


def test_identify_says_that_a_wire_wants_training_first():
    found = identify(pulses(0.0)[0], bench_mapping("flexinol"), "flexinol", order=1)
    (note,) = [n for n in found.notes if "changed while it was measured" in n]
    assert "--training-cycles" in note


def test_the_change_is_about_what_the_wire_went_through():
    logs, config = pulses(0.0)
    found_m = change_while_measured_m(logs, config)
    true_m = config.wire.length * IN_TRAINING.hot_strain * -math.expm1(-9.0 / IN_TRAINING.cycles)
    assert 0.6 * true_m < found_m < 1.6 * true_m


@pytest.mark.parametrize("most_A", [0.0, 0.4])
def test_a_wire_that_is_half_trained_is_known_as_one(most_A):
    """Also where the first pulse of each log is longer than those that come after."""
    logs, config = pulses(40.0, most_A)
    true_m = (
        config.wire.length
        * IN_TRAINING.hot_strain
        * (math.exp(-40.0 / IN_TRAINING.cycles) - math.exp(-49.0 / IN_TRAINING.cycles))
    )
    assert 0.6 * true_m < change_while_measured_m(logs, config) < 1.6 * true_m


def test_currents_that_are_held_say_nothing_of_training():
    """One after another ends elsewhere, and some of them follow each other after as long a time."""
    logs = []
    for load_N in LOADS_N:
        _, rig, _ = virtual_rig("flexinol", seed=3, load=Weight(load_N))
        with rig.opened():
            logs.append(rig.record(held_currents((0.05, 0.15, 0.2, 0.25, 0.29, 0.33), 5.0, 10.0)))
    assert change_while_measured_m(logs, rig.config) == 0.0


def test_nothing_is_said_of_a_wire_that_is_trained():
    logs, config = pulses(250.0)
    assert change_while_measured_m(logs, config) == 0.0


def test_pulses_that_end_on_their_way_say_nothing_of_training():
    """As where a guard holds the current back; warmer from pulse to pulse, each goes further than the one before."""
    logs = []
    for load_N in LOADS_N:
        _, rig, _ = virtual_rig("flexinol", seed=3, load=Weight(load_N))
        with rig.opened():
            logs.append(rig.record(square_pulses(3, 0.34, 0.05, 1.6, 2.0)))
    assert change_while_measured_m(logs, rig.config) == 0.0


def test_cycles_that_a_loop_ends_where_it_is_told_say_nothing_of_training():
    logs, config = pulses(0.0)
    followed = [dataclasses.replace(log, metadata={**log.metadata, "kind": FOLLOWED}) for log in logs]
    assert change_while_measured_m(followed, config) == 0.0 < change_while_measured_m(logs, config)
