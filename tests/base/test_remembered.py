"""What was reckoned before is not reckoned again."""

import copy
import pickle

import numpy as np

from sma_actuator.base.remembered import MOST, Remembered


def test_what_the_same_arrays_decide_is_reckoned_once():
    known, asked = Remembered(), []

    def twice(values):
        return known.of(lambda: asked.append(1) or 2.0 * values, values)

    a, b = np.arange(5.0), np.arange(5.0) + 1e-15
    np.testing.assert_array_equal(twice(a), twice(a.copy()))
    assert len(asked) == 1
    twice(b)
    assert len(asked) == 2  # another last bit is another question


def test_the_oldest_is_forgotten_first_and_a_copy_knows_nothing():
    known, asked = Remembered(), []
    for number in (*range(MOST), 0, MOST, 0, 1):  # 0 was asked for again before there was one too many, 1 was not
        known.of(lambda n=number: asked.append(n), np.array([number]))
    assert asked == [*range(MOST + 1), 1]
    for again in (copy.deepcopy(known), pickle.loads(pickle.dumps(known))):
        again.of(lambda: asked.append("anew"), np.array([0]))
    assert asked[-2:] == ["anew", "anew"]


def test_values_of_one_array_are_not_those_of_its_neighbour():
    known, asked = Remembered(), []
    for arrays in (([1.0], [2.0, 0.0]), ([1.0, 2.0], [0.0])):
        known.of(lambda: asked.append(1), *map(np.array, arrays))
    assert len(asked) == 2
