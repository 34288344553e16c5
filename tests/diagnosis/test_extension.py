"""Identification ends with the effects that the model lacks, as far as they help logs they were not fitted on."""

import dataclasses
import json

import numpy as np
import pytest

from sma_actuator.cli.main import main
from sma_actuator.config import Config, read_parameter_file
from sma_actuator.diagnosis.extension import extend
from sma_actuator.estimation.chain import Chain
from sma_actuator.estimation.effects import EFFECTS

YIELDS_m_per_N = 1e-4


@pytest.fixture(scope="module")
def foreign(tmp_path_factory):
    """Logs of a wire of other physics than those that the models come from, and its bench file among them."""
    out = tmp_path_factory.mktemp("foreign") / "spool"
    words = ["characterise", "--virtual", "flexinol", "--physics", "foreign", "--out", str(out), "-q"]
    words += ["--loads", "0.3,0.6,1.0,2.0", "--pulses", "2", "--set-points", "3"]
    for part in ("lead_resistance", "load_cell", "lvdt", "training", "fatigue", "levels"):
        words += ["--skip", part]
    assert main(words) == 0
    return out


def identified(folder, bench, out, *more):
    """The command, and its JSON."""
    words = ["identify", str(folder), "--config", str(bench), "--order", "2", "--jobs", "1", "--out", str(out), "-q"]
    code = main([*words, "--json", str(out.with_suffix(".json")), *more])
    return code, json.loads(out.with_suffix(".json").read_text())


@pytest.mark.long  # below, the same of logs that are made up, without the command
def test_what_helps_other_logs_is_added_said_and_part_of_the_calibration(foreign, tmp_path, capsys):
    bench = foreign / "bench.yaml"
    code, found = identified(foreign, bench, tmp_path / "with.yaml")
    assert code == 0
    said = capsys.readouterr().out
    assert "extension: added self_heating" in said and "logs that the effects were not fitted on" in said
    extension = found["extension"]
    assert extension["added"] == ["self_heating"]
    assert extension["error_after_pct_stroke"] < 0.8 * extension["error_before_pct_stroke"]
    config = Config.load(tmp_path / "with.yaml")
    assert config.effects.active["self_heating"] is not None
    assert "identify added self_heating" in read_parameter_file(tmp_path / "with.yaml")["effects"]["history"][0]
    _, plain = identified(foreign, bench, tmp_path / "without.yaml", "--no-extension")
    without = Config.load(tmp_path / "without.yaml")
    assert "extension" not in plain and not without.effects.active
    assert config.calibration.error < without.calibration.error, "the calibration is that of the extended model"


@pytest.fixture
def fitted(identified_flexinol):
    return identified_flexinol


def measured_by(fitted, config):
    """``fitted`` with logs that say what ``config`` estimates, but for noise."""
    noise = np.random.default_rng(3)
    experiments = []
    for one in fitted.experiments:
        columns = {name: values for name, values in one.log.columns.items() if name != "lvdt_current_A"}
        estimate_m = Chain(config).run(one.signals).displacement_m
        columns["displacement_m"] = estimate_m + 20e-6 * noise.standard_normal(len(estimate_m))
        experiments.append(dataclasses.replace(one, log=dataclasses.replace(one.log, columns=columns)))
    return dataclasses.replace(fitted, experiments=tuple(experiments))


def test_an_effect_that_only_follows_noise_stays_out(fitted):
    extended = extend(measured_by(fitted, fitted.config), jobs=1)
    assert extended.added == ()
    assert extended.result.mapping == fitted.mapping
    assert extended.sentences


@pytest.mark.parametrize("kinds", [("pulses",), pytest.param(("pulses", "partial"), marks=pytest.mark.long)])
def test_one_that_the_wire_has_and_the_model_lacks_is_added(fitted, kinds):
    """The pulses of four loads show it as well as all logs do, in a third of the time."""
    fitted = dataclasses.replace(fitted, experiments=tuple(one for one in fitted.experiments if one.kind in kinds))
    has = {"effects.order": ["elastic_compliance"], "effects.elastic_compliance.compliance": YIELDS_m_per_N}
    extended = extend(measured_by(fitted, fitted.config.replace(has)), jobs=1)
    assert extended.added == ("elastic_compliance",)
    assert extended.after_percent < 0.8 * extended.before_percent
    found = extended.result.config.effects.active["elastic_compliance"]
    assert found.compliance == pytest.approx(YIELDS_m_per_N, rel=0.05)


def test_what_calibration_logs_cannot_tell_is_never_added():
    assert {name for name, effect in EFFECTS.items() if not effect.LASTS} == {"fatigue", "creep", "rate"}
