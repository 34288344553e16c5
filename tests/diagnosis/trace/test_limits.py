"""The constants of tracing: few, and each one scale."""

import numpy as np
import pytest

from sma_actuator.diagnosis.trace.limits import LIMITS


def test_where_the_form_of_an_effect_ends_that_of_something_else_begins():
    assert max(LIMITS.forms) == LIMITS.form < min(LIMITS.nearly)
    assert LIMITS.nearly[-1] == pytest.approx(1.0) and LIMITS.larger[-1] == pytest.approx(LIMITS.largest)
    for first, scales in ((LIMITS.form, LIMITS.nearly), (1.0, LIMITS.larger)):
        assert np.ptp(np.diff(np.log([first, *scales]))) == pytest.approx(0.0, abs=1e-9)
