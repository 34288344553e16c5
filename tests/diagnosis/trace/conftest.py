"""The wire of these tests, calibrated once."""

from __future__ import annotations

import pytest
from once import made_once
from sessions import calibrated


@pytest.fixture(scope="session")
def wire(tmp_path_factory):
    """(bench's parameters, model's parameters)."""
    return made_once(tmp_path_factory, "calibrated", lambda _: calibrated())
