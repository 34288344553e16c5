"""What logs would show before anything has happened: ``trace --isolability``."""

import json
import math

import numpy as np
import pytest
from sessions import session, write, write_model

from sma_actuator.bench import Spring, Weight
from sma_actuator.cli.main import main
from sma_actuator.config import Config
from sma_actuator.diagnosis.trace import Evidence
from sma_actuator.diagnosis.trace.candidates import candidate
from sma_actuator.diagnosis.trace.isolability import isolability
from sma_actuator.diagnosis.trace.limits import LIMITS
from sma_actuator.diagnosis.trace.rows import Rows
from sma_actuator.diagnosis.trace.scales import scales_of


@pytest.fixture(scope="module")
def config(wire):
    return Config.from_mapping(wire[1])


def of(wire, config, load):
    evidence = Evidence(session(wire[0], load=load, logs=1), config)
    found = isolability(evidence)
    return found, {e.name: e for e in found.effects}, evidence


@pytest.fixture(scope="module")
def under_a_weight(wire, config):
    return of(wire, config, Weight(0.98))


@pytest.fixture(scope="module")
def under_a_spring(wire, config):
    return of(wire, config, Spring(300.0, 0.5))


@pytest.mark.long
def test_under_one_weight_a_lag_of_the_wire_is_one_of_the_sensor_and_a_spring_tells_them_apart(
    under_a_weight, under_a_spring
):
    """The line of a spring is bent by what lags in the sensor, and by nothing that the wire does."""

    def times(found, name, other):
        return found[name].told_from[other] / found[name].seen_from

    weight, spring = under_a_weight[1], under_a_spring[1]
    assert times(weight, "reference_lag", "rate") > 3.0 * times(spring, "reference_lag", "rate")
    assert all(e.told_from[n] >= 0.999 * e.seen_from for e in weight.values() for n in e.told_from)


def test_what_these_logs_cannot_show_is_said(under_a_weight):
    found, effects, _ = under_a_weight
    assert "elastic_compliance" in found.untestable and "elastic_compliance" not in effects


def test_the_experiment_that_would_tell_most_comes_first_and_adds_what_a_second_look_confirms(under_a_weight):
    found, *_ = under_a_weight
    bits = [t.bits for t in found.experiments]
    assert bits == sorted(bits, reverse=True) and bits[0] > 0.0
    assert all(-1e-9 <= b <= found.most_bits - found.bits for b in bits)
    first, second, nats = found.experiments[0].parts[0]
    assert first != second and nats > 0.0


def test_a_size_at_which_an_effect_shows_is_one_at_which_its_rows_say_so(under_a_weight):
    """The sensitivity is a slope: the rows of an effect of that size are off by as many nats as were promised."""
    _, effects, evidence = under_a_weight
    effect = effects["reference_gain"]
    built = candidate("reference_gain", scales_of(evidence)).build({"gain": effect.seen_from, "pivot": 0.0})
    moved = evidence.compare({"reference_gain": built}).off - evidence.compare({}).off
    assert 0.5 * float(np.sum(Rows(evidence).usual.whiten(moved) ** 2)) == pytest.approx(LIMITS.told, rel=0.15)
    assert effect.unit == "1" and math.isfinite(effect.seen_from)


def test_the_command_writes_a_table_a_picture_and_the_experiment(wire, tmp_path, capsys):
    logs = write(session(wire[0], load=Weight(0.98), logs=1), tmp_path)
    model = write_model(wire[1], tmp_path / "wire.yaml")
    out = tmp_path / "out"
    assert main(["trace", *logs, "--config", model, "--out", str(out), "--isolability"]) == 0
    report = json.loads((out / "isolability.json").read_text())
    said = capsys.readouterr().out
    assert report["experiments"][0]["what"] in " ".join(said.split()) and "untestable: elastic_compliance" in said
    assert "data:image/png" in (out / "isolability.html").read_text()
    assert not (out / "report.json").exists()


def test_it_goes_with_no_option_of_tracing(tmp_path, capsys):
    command = ["trace", "log.csv", "--config", "model.yaml", "--out", str(tmp_path), "--isolability", "--beyond-floor"]
    assert main(command) != 0
    assert "--beyond-floor: not with --isolability, which traces nothing" in " ".join(capsys.readouterr().err.split())
