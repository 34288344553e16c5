"""The wire of these tests, calibrated once."""

from __future__ import annotations

import pytest
from sessions import calibrated


@pytest.fixture(scope="session")
def wire():
    """(bench's parameters, model's parameters)."""
    return calibrated()
