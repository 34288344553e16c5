"""Identification ends with the effects that the model lacks, as far as they help logs they were not fitted on."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.signal import lfilter

from sma_actuator.cli.main import main
from sma_actuator.config import Config, bench_from_mapping, read_parameter_file
from sma_actuator.diagnosis.extension import NEVER, extend
from sma_actuator.estimation.chain import Chain
from sma_actuator.identify import identify
from sma_actuator.logs.bench_log import signals_from_log, write_bench_log

SLOPE_1_K = 0.6e-3  #: of the resistance with temperature, beyond what the wire of the bench has


@pytest.fixture(scope="module")
def warm(flexinol, tmp_path_factory):
    """Every other reading of the wire's logs, had its resistance risen more with its temperature."""
    folder = tmp_path_factory.mktemp("warm")
    config = bench_from_mapping(flexinol.mapping)
    thermal = config.thermal
    for log in flexinol.only("_0.300N", "_0.600N", "_1.200N"):
        s = signals_from_log(log, config)
        share = 1.0 - np.exp(-log.period_s * thermal.heat_loss / thermal.heat_capacity)
        rise_K = lfilter([share], [1.0, share - 1.0], s.power_W) / thermal.heat_loss
        columns = {
            "time_s": s.time_s,
            "resistance_Ohm": s.resistance_Ohm * (1.0 + SLOPE_1_K * rise_K),
            "current_A": s.current_A,
            "load_N": s.load_N,
            "displacement_m": s.reference_displacement_m,
        }
        thinned = {name: values[::2] for name, values in columns.items()}
        write_bench_log(folder / log.name, dataclasses.replace(log, columns=thinned))
    return folder


def identified(folder, bench, out, *more):
    """The command, and its JSON."""
    words = ["identify", str(folder), "--config", str(bench), "--order", "2", "--jobs", "1", "--out", str(out), "-q"]
    code = main([*words, "--json", str(out.with_suffix(".json")), *more])
    return code, json.loads(out.with_suffix(".json").read_text())


def test_what_helps_other_logs_is_added_said_and_part_of_the_calibration(warm, flexinol, tmp_path, capsys):
    bench = flexinol.folder / "bench.yaml"
    code, found = identified(warm, bench, tmp_path / "with.yaml")
    assert code == 0
    said = capsys.readouterr().out
    assert "extension: added self_heating" in said and "logs that the effects were not fitted on" in said
    extension = found["extension"]
    assert extension["added"] == ["self_heating"]
    assert extension["error_after_pct_stroke"] < 0.8 * extension["error_before_pct_stroke"]
    config = Config.load(tmp_path / "with.yaml")
    assert config.effects.active["self_heating"] is not None
    assert "identify added self_heating" in read_parameter_file(tmp_path / "with.yaml")["effects"]["history"][0]
    _, plain = identified(warm, bench, tmp_path / "without.yaml", "--no-extension")
    without = Config.load(tmp_path / "without.yaml")
    assert "extension" not in plain and not without.effects.active
    assert config.calibration.error < without.calibration.error, "the calibration is that of the extended model"


def test_an_effect_that_only_follows_noise_stays_out(flexinol):
    result = identify(flexinol.only("pulses", "partial"), flexinol.mapping, "flexinol", order=2)
    noise = np.random.default_rng(3)
    experiments = []
    for one in result.experiments:  # measured as the model says, but for noise
        columns = {name: values for name, values in one.log.columns.items() if name != "lvdt_current_A"}
        estimate_m = Chain(result.config).run(one.signals).displacement_m
        columns["displacement_m"] = estimate_m + 20e-6 * noise.standard_normal(len(estimate_m))
        experiments.append(dataclasses.replace(one, log=dataclasses.replace(one.log, columns=columns)))
    extended = extend(dataclasses.replace(result, experiments=tuple(experiments)), jobs=1)
    assert extended.added == ()
    assert extended.result.mapping == result.mapping
    assert extended.sentences


def test_what_calibration_logs_cannot_tell_is_never_added():
    assert {"fatigue", "rate"} <= set(NEVER)
