"""What the page says agrees with its verdict."""

from types import SimpleNamespace

import pytest

from sma_actuator.diagnosis.trace.page import _race
from sma_actuator.report import Page


@pytest.mark.parametrize("verdict", ["traced", "unexplained", "none"])
def test_a_bar_is_called_named_only_where_something_was_named(verdict):
    best, other = (
        SimpleNamespace(names=(name,), gain=gain, gain_error=0.1) for name, gain in (("creep", 3.0), ("slip", 1.0))
    )
    round_ = SimpleNamespace(before=(), trials=[best, other], alternatives=[], winner=best)
    page = Page("What the model lacks", "…")
    _race(page, SimpleNamespace(verdict=verdict, rounds=[round_]))
    (caption,) = [part["caption"] for part in page.parts if part["kind"] == "figure"]
    assert ("Green: named" in caption) == (verdict == "traced")
    assert ("is not named" in caption) == (verdict != "traced")
