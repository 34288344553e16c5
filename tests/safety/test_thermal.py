"""The heat balance against its closed form, and the current it leaves."""

import math
from dataclasses import replace

import pytest

from sma_actuator.safety.thermal import HeatBalance, derated_limit_A


@pytest.fixture
def parameters(config):
    return replace(config.thermal, heat_capacity=0.01, heat_loss=0.005, derate_temperature=160.0, max_temperature=200.0)


def test_one_step_follows_the_exponential_to_the_settled_temperature(parameters):
    heat = HeatBalance(20.0)
    tau_s, settled_C = 0.01 / 0.005, 20.0 + 0.5 / 0.005
    assert heat.step(0.5, 3.0, 20.0, parameters) == pytest.approx(settled_C - 100.0 * math.exp(-3.0 / tau_s), abs=1e-12)


def test_a_thousand_small_steps_are_one_large_one(parameters):
    one, many = HeatBalance(20.0), HeatBalance(20.0)
    one.step(0.5, 3.0, 20.0, parameters)
    for _ in range(1000):
        many.step(0.5, 0.003, 20.0, parameters)
    assert many.temperature_C == pytest.approx(one.temperature_C, abs=1e-9)


def test_it_obeys_the_heat_balance(parameters):
    heat = HeatBalance(80.0)
    dt_s = 1e-6
    rate_K_s = (heat.step(0.5, dt_s, 20.0, parameters) - 80.0) / dt_s
    assert 0.01 * rate_K_s == pytest.approx(0.5 - 0.005 * (80.0 - 20.0), rel=1e-5)


@pytest.mark.parametrize(
    "arguments",
    [(math.nan, 1.0, 20.0), (math.inf, 1.0, 20.0), (0.1, math.nan, 20.0), (0.1, -1.0, 20.0), (0.1, 1.0, math.nan)],
)
def test_what_is_not_known_does_not_cool_the_wire(parameters, arguments):
    heat = HeatBalance(150.0)
    assert heat.step(*arguments, parameters) == 150.0


@pytest.mark.parametrize(
    ("temperature_C", "limit_A"),
    [
        (-300.0, 0.4),
        (20.0, 0.4),
        (160.0, 0.4),
        (180.0, 0.225),
        (200.0, 0.05),
        (1e300, 0.05),
        (math.inf, 0.05),
        (math.nan, 0.05),
    ],
)
def test_the_current_limit_falls_from_the_maximum_to_the_bias(parameters, temperature_C, limit_A):
    assert derated_limit_A(temperature_C, 0.4, 0.05, parameters) == pytest.approx(limit_A)
