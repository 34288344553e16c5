"""The two wires of the virtual bench, characterised once for all tests of this folder."""

from __future__ import annotations

import pytest
from characterised import Characterised


@pytest.fixture(scope="session")
def flexinol(tmp_path_factory):
    """The Ni-Ti wire, characterised."""
    return Characterised("flexinol", tmp_path_factory.mktemp("flexinol"))


@pytest.fixture(scope="session")
def furukawa(tmp_path_factory):
    """The Ni-Ti-Cu wire, characterised."""
    return Characterised("furukawa", tmp_path_factory.mktemp("furukawa"))
