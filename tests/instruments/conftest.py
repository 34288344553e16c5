"""Instruments that answer are given the time that a busy machine takes; what must not answer is asked by shorter
ones."""

import contextlib
import os
import signal
from pathlib import Path

import pytest
from accepted import UNSAFE

from sma_actuator.config import Config
from sma_actuator.instruments import open_supply


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


@pytest.fixture
def supply_of(make_config):
    """``supply_of(line, dialect, **parameters)``: a supply without watchdog and trips, not open yet."""
    made = []

    def make(line, path, **parameters):
        changes = {"instruments.supply.resource": line.resource, "instruments.supply.dialect": path}
        changes |= UNSAFE
        changes["supply.watchdog_timeout"] = 0.0
        made.append(open_supply(Config.from_mapping(make_config(**{**changes, **parameters}))))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def asked_once(monkeypatch):
    """Who finds a supply taken by another is refused at once, and not after the time that its last word may take."""
    monkeypatch.setattr("sma_actuator.instruments.supply.OFF_ANSWERS", 0)


@pytest.fixture(autouse=True)
def _nobody_speaks_after_a_test():
    """Who says off for a supply that was given up tries for half a minute: the next pty may have the same name."""
    yield
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (process / "cmdline").read_bytes().split(b"\0")
            if b"sma_actuator.instruments.last_word" in words and str(os.getpid()).encode() in words:
                os.kill(int(process.name), signal.SIGKILL)
