"""Instruments that answer are given the time that a busy machine takes; what must not answer is asked by shorter ones."""

import pytest

from sma_actuator.instruments import supply


@pytest.fixture(scope="session")
def make_config(make_config):
    """The common configuration, with patience where a test says nothing else."""

    def make(**changes):
        mapping = make_config(**changes)
        for role in ("supply", "daq"):
            mapping.setdefault("instruments", {}).setdefault(role, {}).setdefault("timeout", 10.0)
        mapping["safety"].setdefault("reading_timeout", 30.0)
        return mapping

    return make


@pytest.fixture(autouse=True)
def confirmed_slowly(monkeypatch):
    """Nor is half a second enough on a busy machine for an instrument that would confirm."""
    for name in ("_CONFIRM_s", "_CONFIRM_BESIDE_s"):
        monkeypatch.setattr(supply, name, 10.0)
