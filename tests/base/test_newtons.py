"""A load in words has digits enough for the wire that bears it."""

import numpy as np
import pytest

from sma_actuator.base.newtons import newtons
from sma_actuator.characterise.operators import _in_grams
from sma_actuator.identify.verdict import _loads
from sma_actuator.identify.verdict.unseen import Unseen


@pytest.mark.parametrize(
    ("load_N", "words"),
    [(16.5, "16.500"), (0.98, "0.980"), (0.0074, "0.00740"), (-0.0021, "-0.00210"), (0.0, "0.000")],
)
def test_a_small_load_has_more_digits(load_N, words):
    assert newtons(load_N) == words


@pytest.mark.parametrize(("load_N", "words"), [(0.6, "61.2 g (0.600 N)"), (0.00145, "0.148 g (0.00145 N)")])
def test_a_person_is_asked_to_hang_what_counts_as_hung(load_N, words):
    """Of 0.148 g a tenth of a gram was asked for, and what is a tenth off is asked for again."""
    assert _in_grams(load_N) == words


def test_loads_of_a_thin_wire_are_not_taken_for_one_in_the_verdict():
    """25 µm bear 0.09 N; two loads of a finer coil became one of 0.001 N."""
    load_N = np.repeat([0.00061, 0.00139, 0.9812], 3)
    unseen = Unseen(np.zeros(9), load_N, np.zeros(9), np.zeros(9), np.zeros(9, bool))
    assert [each_N for each_N, _ in _loads(unseen)] == [0.00061, 0.00139, 0.9812]
