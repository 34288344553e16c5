"""What is printed of a time is what is computed: the text, read as Python, gives the same number."""

import pytest

from sma_actuator.safety.faults import FAULTS
from sma_actuator.safety.formula import longest, parameter_value
from sma_actuator.safety.limits import LIMITS

RATE, TIMEOUT = parameter_value("loop.rate"), parameter_value("safety.reading_timeout")


def read(text, config):
    sections = {
        name: getattr(config, name) for name in ("loop", "safety", "controller", "supply", "thermal", "instruments")
    }
    return eval(text, {"__builtins__": {}, "max": max}, sections)


@pytest.mark.parametrize("entry", [*LIMITS.values(), *FAULTS.values()], ids=lambda entry: entry.name)
def test_the_published_time_is_the_one_that_is_computed(entry, config):
    assert entry.within(config) == pytest.approx(read(str(entry.within), config), rel=1e-12)


@pytest.mark.parametrize(
    "formula",
    [
        (1 + RATE) * 2,
        2 / (RATE * TIMEOUT),
        2 / (RATE / TIMEOUT),
        3 * (TIMEOUT + 1 / RATE),
        (RATE + 1) / (TIMEOUT + 2),
        longest(0.5, 3 / RATE) + (1 + TIMEOUT),
        2 / RATE / TIMEOUT,
    ],
    ids=str,
)
def test_brackets_stand_where_they_are_needed(formula, config):
    assert formula(config) == pytest.approx(read(str(formula), config), rel=1e-12)
