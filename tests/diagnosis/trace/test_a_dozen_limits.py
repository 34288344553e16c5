"""The constants of tracing: few, each one scale, and nothing that a calibration or the logs say themselves."""

import dataclasses

import numpy as np
import pytest
from sessions import session

from sma_actuator.base.calibration import Calibration
from sma_actuator.config import Config
from sma_actuator.diagnosis.trace import Evidence
from sma_actuator.diagnosis.trace.limits import LIMITS, Limits
from sma_actuator.diagnosis.trace.witnesses import Power
from sma_actuator.logs.bench_log import BenchLog


@pytest.fixture(scope="module")
def config(wire):
    return Config.from_mapping(wire[1])


def test_they_are_a_dozen_and_each_is_one_number():
    values = [getattr(LIMITS, field.name) for field in dataclasses.fields(Limits)]
    assert len(values) <= 12 and all(np.isscalar(value) for value in values)


def test_where_the_form_of_an_effect_ends_that_of_something_else_begins():
    assert max(LIMITS.forms) == LIMITS.form < min(LIMITS.nearly)
    assert LIMITS.nearly[-1] == pytest.approx(1.0) and LIMITS.larger[-1] == pytest.approx(LIMITS.largest)
    for first, scales in ((LIMITS.form, LIMITS.nearly), (1.0, LIMITS.larger)):
        assert np.ptp(np.diff(np.log([first, *scales]))) == pytest.approx(0.0, abs=1e-9)


def test_logs_say_how_long_errors_last_where_their_calibration_does_not(wire, config):
    """Errors of one reading each say more than such that last for seconds."""
    unknown = dataclasses.replace(config, calibration=Calibration())
    rng = np.random.default_rng(4)

    def says(lasts: int) -> float:
        logs = []
        for log in session(wire[0]):
            shown_A = log.columns["lvdt_current_A"]
            off = np.convolve(rng.standard_normal(len(shown_A)), np.ones(lasts) / np.sqrt(lasts), mode="same")
            columns = {**log.columns, "lvdt_current_A": shown_A + 0.2 * np.std(shown_A) * off}
            logs.append(BenchLog(columns, log.metadata, log.source))
        return float(Evidence(logs, unknown).independent.sum())

    assert says(1) > 3.0 * says(30)


def test_a_passage_at_another_speed_than_the_calibrations_says_less_of_the_heat_balance(wire, config):
    """Where all that rests on the latent heat differs, a wire may seem to be as much warmer as that makes it."""
    evidence = Evidence(session(wire[0]), config)
    usual, there = evidence.calibration, evidence.predict({})
    power = usual.power
    faster = dataclasses.replace(power, transformation_speed=tuple(1.0 + s for s in power.transformation_speed))
    near, far = (
        Power(evidence.logs, evidence.config, dataclasses.replace(usual, power=one)).off(there)
        for one in (power, faster)
    )
    assert len(near) and np.all(far / near < 0.5)
