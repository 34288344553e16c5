"""Tables that kernels look things up in."""

import math

import pytest

from sma_actuator.base.calibration import interpolated
from sma_actuator.base.lookup import looked_up, places_below, row_of, values_of

TABLES = [((1.0,), (7.0,)), ((), ()), ((0.0, 1.0, 4.0), (3.0, -1.0, 0.1)), ((0.1, 0.7), (0.3, 0.2))]


@pytest.mark.parametrize("table", [0, 2, 3])
@pytest.mark.parametrize("at", [-1.0, 0.0, 0.1, 0.3, 0.7, 1.0, 1.0 / 3.0, 3.999, 4.0, 5.0, math.inf, -math.inf])
def test_each_of_several_is_interpolated_to_the_digit(table, at):
    assert looked_up(row_of(*TABLES), table, at) == interpolated(at, *TABLES[table])


def test_at_no_place_there_is_no_value():
    assert math.isnan(looked_up(row_of(*TABLES), 2, math.nan))


@pytest.mark.parametrize(("at", "below"), [(-0.1, 0), (0.0, 1), (0.9, 1), (1.0, 2), (4.0, 3), (9.0, 3)])
def test_a_place_is_below_itself(at, below):
    assert places_below(row_of(*TABLES), 2, at) == below


def test_values_stand_behind_their_places():
    row = row_of(*TABLES)
    for table, (_, values) in enumerate(TABLES):
        first, count = values_of(row, table)
        assert list(row[first : first + count]) == list(values)
