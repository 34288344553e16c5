"""Whatever is put into the chain: where there is no number, the quality says so."""

import dataclasses
from math import inf, isfinite, nan
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from sma_actuator.base.signals import Quality, Signals
from sma_actuator.config import Config
from sma_actuator.estimation.chain import Chain

CONFIG = Path(__file__).parents[2] / "config"
ODD = [nan, inf, -inf, 1e308, -1e308, 1e38, -1e9, -1.0, -0.0, 0.0, 5e-324]
NAMES = [field.name for field in dataclasses.fields(Signals)]


def among(*usual):
    """Mostly what a wire gives, else anything."""
    return st.one_of(st.sampled_from(usual), st.sampled_from(usual), st.sampled_from(ODD), st.floats())


SAMPLES = st.lists(
    st.fixed_dictionaries(
        {
            "time_s": among(0.0, 0.05, 1.0, 100.0),
            "resistance_Ohm": among(4.3, 4.6, 5.0, 5.4),
            "current_A": among(0.05, 0.3),
            "power_W": among(0.01, 0.5),
            "load_N": among(0.5, 1.0),
            "stress_Pa": among(27e6, 55e6),
            "reference_displacement_m": among(0.003),
            "ambient_temperature_C": among(22.0, nan),
            "tare_N": among(0.0),
        }
    ),
    min_size=1,
    max_size=8,
)
SLIP_AND_CREEP = {
    "slip": {"length": 3e-4, "time": 1.0},
    "ambient_temperature": {"temperature_coefficient": 1e-3, "fading": 1e6},
}


def shown(displacement_m, strain, velocity_m_s, quality):
    """Whether an estimate says what it may: numbers, or that it is none."""
    return quality == Quality.INVALID or all(map(isfinite, (displacement_m, strain, velocity_m_s)))


@pytest.mark.parametrize("examples", [40, pytest.param(150, marks=pytest.mark.long)])
@pytest.mark.parametrize("effects", [None, SLIP_AND_CREEP], ids=["plain", "with effects"])
@pytest.mark.parametrize("model", ["flexinol", "furukawa", "flexinol_normalised", "furukawa_normalised"])
def test_an_estimate_that_is_no_number_is_invalid(model, effects, examples):
    config = Config.load(CONFIG / f"{model}.yaml")
    if effects:
        config = config.replace({"effects": effects})

    @settings(max_examples=examples, deadline=None, derandomize=True)
    @given(SAMPLES)
    def holds(samples):
        live, replay = Chain(config), Chain(config)
        with np.errstate(all="ignore"):
            for sample in samples:
                found = live.step(Signals(**sample))[1]
                assert shown(found.displacement_m, found.strain, found.velocity_m_s, found.quality), found
            experiment = replay.run(Signals(**{name: np.array([s[name] for s in samples]) for name in NAMES}))
        for row in zip(
            experiment.displacement_m, experiment.strain, experiment.velocity_m_s, experiment.quality, strict=True
        ):
            assert shown(*row), row

    holds()
