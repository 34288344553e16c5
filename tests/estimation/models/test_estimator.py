"""The estimator: one chain for a sample and for a log, honest about what it does not know."""

import dataclasses
import itertools
import json
import os
import subprocess
import sys
from math import inf, nan

import numpy as np
import pytest

from sma_actuator.base.share import shared_file
from sma_actuator.base.signals import Quality, Signals
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.estimation.estimator import Estimator


@pytest.fixture
def config(make_config):
    return Config.from_mapping(make_config())


def signals(n=400, seed=0, resistance_Ohm=5.0):
    """n samples of a wire that goes twice through its loop, as arrays."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(n) * 0.05
    resistance = resistance_Ohm * (1.0 + 0.06 * np.cos(time_s)) + 1e-3 * rng.standard_normal(n)
    power = np.where(np.sin(time_s) > 0.0, 0.6, 0.013)
    load = 1.0 + 0.01 * rng.standard_normal(n)
    return Signals(time_s, resistance, np.sqrt(power / resistance), power, load, load / 1.82e-8)


def sample(arrays, i):
    values = (getattr(arrays, field.name) for field in dataclasses.fields(Signals))
    return Signals(*(value if np.isscalar(value) else float(value[i]) for value in values))


def test_sample_by_sample_gives_the_numbers_of_replay(config):
    arrays = signals()
    live, replay = Estimator(config), Estimator(config)
    trace = replay.run(arrays)
    for i in range(len(arrays.time_s)):
        estimate = live.step(sample(arrays, i))
        for name in ("displacement_m", "strain", "velocity_m_s", "branch", "quality"):
            assert getattr(estimate, name) == getattr(trace, name)[i], f"{name} of sample {i}"


@pytest.mark.parametrize(
    ("field", "value"),
    (
        *itertools.product(("time_s", "resistance_Ohm", "stress_Pa", "power_W"), (nan, inf, -inf)),
        *(("resistance_Ohm", value) for value in (-5.0, 0.0, 0.99, 20.1, 9.9e37)),
    ),
)
def test_an_impossible_reading_leaves_the_memory_as_it_was(config, field, value):
    arrays = signals(50)
    disturbed, clean = Estimator(config), Estimator(config)
    for i in range(49):
        last = disturbed.step(sample(arrays, i))
        clean.step(sample(arrays, i))
    invalid = disturbed.step(dataclasses.replace(sample(arrays, 48), **{field: value}))
    assert invalid.quality is Quality.INVALID
    assert invalid.displacement_m == last.displacement_m
    assert disturbed.step(sample(arrays, 49)).displacement_m == clean.step(sample(arrays, 49)).displacement_m


@pytest.mark.parametrize("stress_Pa", (400e6, -400e6, 1e308), ids="{:g} Pa".format)
def test_a_stress_beyond_calibration_acts_as_the_stress_at_the_margin(config, stress_Pa):
    # A cubic in stress is anything at all out there; one such reading must not cost the estimate its memory.
    arrays = signals(60)
    lo, hi = config.model.stress_range
    margin = 0.05 * (hi - lo)
    wild, bounded = Estimator(config), Estimator(config)
    at = {400e6: hi + margin, -400e6: lo - margin, 1e308: hi + margin}[stress_Pa]
    for i in range(60):
        seen = sample(arrays, i)
        far, near = (wild, stress_Pa), (bounded, at)
        a, b = (e.step(dataclasses.replace(seen, stress_Pa=s) if i == 30 else seen) for e, s in (far, near))
        assert a.displacement_m == b.displacement_m
        assert (a.quality is Quality.OUTSIDE_CALIBRATION) == (i == 30)
    arrays.stress_Pa[30] = stress_Pa
    assert Estimator(config).run(arrays).displacement_m[-1] == a.displacement_m


def test_velocity_survives_a_clock_that_is_set_back(config):
    estimator = Estimator(config)
    for i in range(400):
        time_s = (1e6 if i < 200 else 0.0) + i * 0.05
        estimate = estimator.step(Signals(time_s, 5.0 + i * 1e-4, 0.05, 0.0125, 1.0, 55e6))
    assert estimate.velocity_m_s == pytest.approx(4.3e-3 * 1e-4 / 0.05, rel=1e-3)


def test_replay_treats_gaps_as_the_node_does(config):
    arrays = signals(60)
    arrays.resistance_Ohm[[0, 20, 21]] = nan
    arrays.resistance_Ohm[[40, 59]] = 0.0
    arrays.time_s[50] = nan
    trace, live = Estimator(config).run(arrays), Estimator(config)
    for i in range(60):
        estimate = live.step(sample(arrays, i))
        assert estimate.quality == trace.quality[i]
        np.testing.assert_equal(estimate.displacement_m, trace.displacement_m[i])


@pytest.mark.parametrize(
    ("change", "quality"),
    (
        ({}, Quality.DETERMINATE),
        ({"resistance_Ohm": 5.6}, Quality.INDETERMINATE_COLD),
        ({"resistance_Ohm": 4.3}, Quality.INDETERMINATE_HOT),
        ({"stress_Pa": 400e6}, Quality.OUTSIDE_CALIBRATION),
    ),
)
def test_quality_names_the_reason(config, change, quality):
    ordinary = Signals(0.0, 5.0, 0.3, 0.45, 1.0, 55e6)
    assert Estimator(config).step(dataclasses.replace(ordinary, **change)).quality is quality


def test_velocity_is_the_slope_of_a_steady_motion(config):
    estimator = Estimator(config)
    for i in range(200):
        estimate = estimator.step(Signals(i * 0.05, 5.0 + i * 1e-3, 0.05, 0.0125, 1.0, 55e6))
    assert estimate.velocity_m_s == pytest.approx(4.3e-3 * 1e-3 / 0.05, rel=1e-3)


_WITHOUT_NUMBA = """
import json, sys
from sma_actuator.config import Config
from sma_actuator.estimation.estimator import Estimator
from sma_actuator.base.jit import COMPILED
from test_estimator import signals

assert not COMPILED
config = Config.from_mapping(json.loads(sys.argv[1]))
print(json.dumps(Estimator(config).run(signals(resistance_Ohm=float(sys.argv[2]))).displacement_m.tolist()))
"""


@pytest.mark.parametrize(
    ("name", "changes", "resistance_Ohm"),
    (
        ("flexinol", {}, 5.0),
        ("flexinol_normalised", {}, 5.0),
        ("furukawa", {"variant": "direct_switching"}, 1.9),
        ("furukawa", {"variant": "transition"}, 1.9),
        ("furukawa_normalised", {}, 1.9),
    ),
)
def test_numbers_do_not_depend_on_numba(name, changes, resistance_Ohm):
    pytest.importorskip("numba")
    mapping = read_parameter_file(shared_file(f"config/{name}.yaml"))
    mapping["model"] = {**mapping["model"], **changes}
    plain = subprocess.run(
        [sys.executable, "-c", _WITHOUT_NUMBA, json.dumps(mapping), str(resistance_Ohm)],
        env={**os.environ, "SMA_ACTUATOR_NO_JIT": "1", "PYTHONPATH": os.path.dirname(__file__)},
        capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    compiled = Estimator(Config.from_mapping(mapping)).run(signals(resistance_Ohm=resistance_Ohm)).displacement_m
    np.testing.assert_allclose(json.loads(plain.stdout), compiled, rtol=0, atol=1e-12)
