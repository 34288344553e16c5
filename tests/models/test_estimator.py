"""The estimator: one chain for a sample and for a log, honest about what it does not know."""

import dataclasses
import json
import os
import subprocess
import sys
from math import inf, nan

import numpy as np
import pytest

from sma_actuator.config import Config
from sma_actuator.estimator import Estimator
from sma_actuator.signals import Quality, Signals


@pytest.fixture
def config(make_config):
    return Config.from_mapping(make_config())


def signals(n=400, seed=0):
    """n samples of a wire that goes twice through its loop, as arrays."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(n) * 0.05
    resistance = 5.0 + 0.3 * np.cos(time_s) + 1e-3 * rng.standard_normal(n)
    power = np.where(np.sin(time_s) > 0.0, 0.6, 0.013)
    load = 1.0 + 0.01 * rng.standard_normal(n)
    return Signals(time_s, resistance, np.sqrt(power / resistance), power, load, load / 1.82e-8)


def sample(arrays, i):
    return Signals(*(getattr(arrays, f.name) if np.isscalar(getattr(arrays, f.name)) else float(getattr(arrays, f.name)[i])
                     for f in dataclasses.fields(Signals)))


def test_sample_by_sample_gives_the_numbers_of_replay(config):
    arrays = signals()
    live, replay = Estimator(config), Estimator(config)
    trace = replay.run(arrays)
    for i in range(len(arrays.time_s)):
        estimate = live.step(sample(arrays, i))
        for name in ("displacement_m", "strain", "velocity_m_s", "branch", "quality"):
            assert getattr(estimate, name) == getattr(trace, name)[i], f"{name} of sample {i}"


@pytest.mark.parametrize("field", ("resistance_Ohm", "stress_Pa", "power_W"))
@pytest.mark.parametrize("value", (nan, inf, -inf))
def test_an_input_that_is_not_finite_leaves_the_memory_as_it_was(config, field, value):
    arrays = signals(50)
    disturbed, clean = Estimator(config), Estimator(config)
    for i in range(49):
        last = disturbed.step(sample(arrays, i))
        clean.step(sample(arrays, i))
    invalid = disturbed.step(dataclasses.replace(sample(arrays, 48), **{field: value}))
    assert invalid.quality is Quality.INVALID
    assert invalid.displacement_m == last.displacement_m
    assert disturbed.step(sample(arrays, 49)).displacement_m == clean.step(sample(arrays, 49)).displacement_m


def test_replay_treats_gaps_as_the_node_does(config):
    arrays = signals(60)
    arrays.resistance_Ohm[[0, 20, 21, 59]] = nan
    trace, live = Estimator(config).run(arrays), Estimator(config)
    for i in range(60):
        estimate = live.step(sample(arrays, i))
        assert estimate.quality == trace.quality[i]
        np.testing.assert_equal(estimate.displacement_m, trace.displacement_m[i])


def test_quality_names_the_reason(config):
    ordinary = Signals(0.0, 5.0, 0.3, 0.45, 1.0, 55e6)
    assert Estimator(config).step(ordinary).quality is Quality.DETERMINATE
    assert Estimator(config).step(dataclasses.replace(ordinary, resistance_Ohm=5.6)).quality is Quality.INDETERMINATE_COLD
    assert Estimator(config).step(dataclasses.replace(ordinary, resistance_Ohm=4.3)).quality is Quality.INDETERMINATE_HOT
    assert Estimator(config).step(dataclasses.replace(ordinary, stress_Pa=400e6)).quality is Quality.OUTSIDE_CALIBRATION


def test_velocity_is_the_slope_of_a_steady_motion(config):
    estimator = Estimator(config)
    for i in range(200):
        estimate = estimator.step(Signals(i * 0.05, 5.0 + i * 1e-3, 0.05, 0.0125, 1.0, 55e6))
    assert estimate.velocity_m_s == pytest.approx(4.3e-3 * 1e-3 / 0.05, rel=1e-3)


def test_numbers_do_not_depend_on_numba(config, make_config):
    pytest.importorskip("numba")
    code = (
        "import json, sys; import test_estimator as t; from sma_actuator.config import Config;"
        "from sma_actuator.estimator import Estimator; from sma_actuator.jit import COMPILED; assert not COMPILED;"
        "print(json.dumps(Estimator(Config.from_mapping(json.loads(sys.argv[1]))).run(t.signals()).displacement_m.tolist()))"
    )
    here = os.path.dirname(__file__)
    plain = subprocess.run(
        [sys.executable, "-c", code, json.dumps(make_config())],
        env={**os.environ, "SMA_ACTUATOR_NO_JIT": "1", "PYTHONPATH": here}, capture_output=True, text=True, check=True, timeout=60,
    )
    np.testing.assert_allclose(json.loads(plain.stdout), Estimator(config).run(signals()).displacement_m, rtol=0, atol=1e-12)
