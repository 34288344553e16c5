"""The curve through the tables of a calibration: SciPy's, to the last bit."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from sma_actuator.base.calibration import through, through_each

NUMBERS = st.floats(-1e3, 1e3).map(lambda x: round(x, 3))  # some of them alike, and some nothing
TABLES = st.integers(3, 8).flatmap(
    lambda n: st.tuples(
        st.lists(st.floats(1e-3, 1e3), min_size=n, max_size=n), *[st.lists(NUMBERS, min_size=n, max_size=n)] * 2
    )
)


@given(TABLES)
def test_it_is_scipys_within_its_nodes(table):
    steps, *tables = table
    nodes = np.cumsum(steps)
    at = np.concatenate((nodes, np.linspace(nodes[0], nodes[-1], 23), [np.nan]))
    for values in tables:
        np.testing.assert_array_equal(through(nodes, values, at), PchipInterpolator(nodes, values)(at))
        assert through(nodes, values, float(at[1])) == values[1]
    curves = PchipInterpolator(nodes, np.transpose(tables))(at[:2])
    np.testing.assert_allclose(through_each(nodes, np.transpose(tables), at[:2]), np.diag(curves), rtol=1e-12)


@given(TABLES)
def test_beyond_them_it_goes_on_straight_as_far_as_the_next_node_lies_within(table):
    steps, values, _ = table
    nodes = np.cumsum(steps)
    curve, ends = PchipInterpolator(nodes, values), nodes[[0, -1]]
    most = np.array([nodes[0] - nodes[1], nodes[-1] - nodes[-2]])
    for at in (ends + 0.5 * most, ends + 9.0 * most):
        further = np.clip(at - ends, *np.sort([np.zeros(2), most], axis=0))
        np.testing.assert_array_equal(through(nodes, values, at), curve(ends) + curve(ends, 1) * further)
